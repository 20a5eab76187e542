"""Foreign pages, which a browser would connect to the viewer, are refused."""

import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus

from tests.view.live.conftest import Stage, client_of
from wbc.view.live.server import refusal


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
