"""The page's server, with what viser has no option for: a title, and a check of origins.

Browsers let any web page open a websocket to this machine, and send the page's address in the
header ``Origin``. A connection can steer the robot, so foreign pages are refused. A page may also
use a name that resolves to this machine (DNS rebinding): a local server accepts this machine's
names only.
"""

from __future__ import annotations

import gzip
import html
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
Answer = Callable[[ServerConnection, Request], Response | None]
TITLE = re.compile(rb"<title>[^<]*</title>")


class Server(viser.ViserServer):  # type: ignore[misc]  # not followed by mypy
    """A server that refuses foreign pages, and requests for a public tunnel.

    ``title``: of the panel; ``robot``: the robot's name, for the title of the browser's tab.
    """

    def __init__(self, host: str, port: int, title: str, robot: str) -> None:
        tab = " - ".join(dict.fromkeys((title, robot, "wbc")))
        with own_pages_only(host, tab):
            super().__init__(host, port, label=title, verbose=False)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse."""
        return None


def refusal(host: str, headers: Headers) -> str:
    """Return why a server on ``host`` refuses a request; empty if it accepts it."""
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or len(origins) > 1:
        return "one Host and at most one Origin are expected"
    address = hosts[0].lower()
    if host in LOOPBACK and _name(address) not in LOOPBACK:
        return f"{address} is no name of this machine"
    if origins and urlsplit(origins[0]).netloc.lower() != address:
        return f"pages of {origins[0]} may not steer this robot"
    return ""


def _name(address: str) -> str:
    """Return the host of an address, without its port; empty if it is invalid."""
    try:
        return urlsplit(f"//{address}").hostname or ""
    except ValueError:
        return ""


@contextmanager
def own_pages_only(host: str, title: str) -> Iterator[None]:
    """Make a server started in this context refuse foreign pages; its own get a title."""
    serve = websocket_server.serve

    def guarded(*arguments: Any, process_request: Answer | None = None, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            reason = refusal(host, request.headers)
            if reason:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
            served = None if process_request is None else process_request(connection, request)
            return None if served is None else with_title(served, title)

        return serve(*arguments, process_request=answer, **options)

    websocket_server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websocket_server.serve = serve  # type: ignore[misc]


def with_title(response: Response, title: str) -> Response:
    """Return a server's answer; if it is a page, with this title."""
    headers, body = response.headers, response.body
    if not headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = headers.get("Content-Encoding") == "gzip"
    mark = f"<title>{html.escape(title)}</title>".encode()
    body = TITLE.sub(lambda _: mark, gzip.decompress(body) if zipped else body, count=1)
    response.body = gzip.compress(body, 1) if zipped else body
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(response.body))
    return response
