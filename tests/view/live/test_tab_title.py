"""The browser's tab says what is shown: many are open."""

import gzip
from urllib.request import Request, urlopen

import pytest

from tests.view.live.conftest import Stage
from wbc.view.live.process import HOST, page_address
from wbc.view.live.server import Server


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
