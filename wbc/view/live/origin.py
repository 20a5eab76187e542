"""The origin check of connections: only the server's own pages, and programs without a browser.

Browsers let any web page open a websocket to this machine, and send the page's address in the
header ``Origin``. A connection can steer the robot, so foreign pages are refused. A page may also
use a name that resolves to this machine (DNS rebinding): a local server accepts this machine's
names only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

import websockets.asyncio.server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
Answer = Callable[[ServerConnection, Request], Response | None]
Change = Callable[[Response], Response]


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
def own_pages_only(host: str, change: Change) -> Iterator[None]:
    """Make a server started in this context refuse foreign pages; viser has no option for it.

    ``change`` is applied to each file that it serves.
    """
    serve = websocket_server.serve

    def guarded(*arguments: Any, process_request: Answer | None = None, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            reason = refusal(host, request.headers)
            if reason:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{reason}\n")
            served = None if process_request is None else process_request(connection, request)
            return None if served is None else change(served)

        return serve(*arguments, process_request=answer, **options)

    websocket_server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websocket_server.serve = serve  # type: ignore[misc]
