"""Foreign pages are refused, and the browser's tab says what is shown."""

import gzip
from urllib.request import Request, urlopen

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus

from tests.view.live.conftest import Stage, client_of
from wbc.view.live.process import HOST, page_address
from wbc.view.live.server import Server, refusal


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:1"])
def test_foreign_pages_are_refused(stage: Stage, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        client_of(stage.url, origin)
    assert refused.value.response.status_code == 403


def test_the_page_itself_and_programs_are_not(stage: Stage) -> None:
    for origin in (stage.url, None):
        with client_of(stage.url, origin) as client:
            assert client.recv(timeout=20.0)


@pytest.mark.parametrize(
    ("host", "address", "origin", "refused"),
    [
        ("127.0.0.1", "localhost:8080", "http://localhost:8080", False),
        ("127.0.0.1", "LOCALHOST:8080", "http://localhost:8080", False),
        ("127.0.0.1", "[::1]:8080", "http://[::1]:8080", False),
        ("127.0.0.1", "localhost:8080", "https://localhost:8080.evil.example", True),
        ("127.0.0.1", "localhost:8080", "http://localhost:8081", True),
        ("127.0.0.1", "rebound.example:8080", "http://rebound.example:8080", True),
        ("127.0.0.1", "[::1", None, True),
        ("0.0.0.0", "robot.lab:8080", "http://robot.lab:8080", False),
        ("0.0.0.0", "robot.lab:8080", "http://evil.example", True),
    ],
)
def test_who_may(host: str, address: str, origin: str | None, refused: bool) -> None:
    headers = Headers({"Host": address})
    if origin is not None:
        headers["Origin"] = origin
    assert bool(refusal(host, headers)) == refused


def test_several_origins_are_refused() -> None:
    headers = Headers([("Host", "localhost"), ("Origin", "http://localhost"), ("Origin", "null")])
    assert refusal("127.0.0.1", headers)


def page_of(url: str, encoding: str) -> str:
    with urlopen(Request(url, headers={"Accept-Encoding": encoding})) as answer:
        body = answer.read()
        assert answer.headers.get_all("Content-Length") == [str(len(body))]
    return (gzip.decompress(body) if encoding == "gzip" else body).decode()


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_tab_names_run_robot_and_program(stage: Stage, encoding: str) -> None:
    assert f"<title>test - {stage.page._robot.name} - wbc</title>" in page_of(stage.url, encoding)


def test_a_robot_s_own_page_names_it_once_and_as_it_is() -> None:
    place = page_address(HOST, None)
    server = Server(place.host, place.port, r"<a> \1 & b", r"<a> \1 & b")
    page = page_of(f"http://{HOST}:{server.get_port()}", "gzip")
    server.stop()
    assert r"<title>&lt;a&gt; \1 &amp; b - wbc</title>" in page
