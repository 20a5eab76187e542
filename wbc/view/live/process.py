"""The page's own process: how it is started, and the pipe to it.

It is started as a program, not by ``multiprocessing``, so that a script needs no ``if __name__ ==
"__main__"`` guard. It ends when the pipe closes, that is, with the process that started it.
"""

from __future__ import annotations

import json
import os
import pickle
import socket
import subprocess
import sys
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from wbc.errors import InvalidInputError, WbcError
from wbc.files import system_message

HOST, PORT = "127.0.0.1", 8080
PORTS_TRIED = 50  # ports from the default on, if none was asked for
START_TIMEOUT = 60.0  # for the page to start: it loads the robot's meshes later

_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[2]); "
    "from wbc.view.live.page import main; main(int(sys.argv[1]))"
)


class PageAddress(NamedTuple):
    """The page's address; another port may be used unless it is ``exact``."""

    host: str
    port: int
    exact: bool = False


class Ready(NamedTuple):
    """The page is served, at this port."""

    port: int


class Failed(NamedTuple):
    """The page could not be served, or has ended."""

    reason: str


def page_address(host: str, port: int | None) -> PageAddress:
    """Return an address for a page; with port None the first free one from the default on."""
    if port is not None:
        reason = _port_error(host, port)
        if reason:
            raise InvalidInputError(f"viewer: cannot serve on {host}:{port}: {reason}")
        return PageAddress(host, port, exact=True)
    for candidate in range(PORT, PORT + PORTS_TRIED):
        reason = _port_error(host, candidate)
        if not reason:
            return PageAddress(host, candidate)
    raise InvalidInputError(
        f"viewer: cannot serve on {host}, ports {PORT} to {PORT + PORTS_TRIED - 1}: {reason}"
    )


def _port_error(host: str, port: int) -> str:
    """Return why a port cannot be used; empty if it can."""
    if not 0 < port < 65536:
        return "a port is a number from 1 to 65535"
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except OSError as error:
        return f"{system_message(error)}; choose another host or port"
    return ""


class PageProcess:
    """A running page, and the pipe to it; ``port``: where it is served."""

    def __init__(self, place: PageAddress, setup: object) -> None:
        ours, theirs = socket.socketpair()
        path = json.dumps([entry or os.getcwd() for entry in sys.path])
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, str(theirs.fileno()), path],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for the control process
            )
        self._socket = ours
        self._pipe = Connection(os.dup(ours.fileno()))
        answer: object = Failed("it did not answer")
        try:
            self.send(place)
            self.send(setup)
            if self._pipe.poll(START_TIMEOUT):
                answer = self.receive()
        except (OSError, EOFError):
            answer = Failed("its process has ended")
        if not isinstance(answer, Ready):
            self.close()
            raise WbcError(f"viewer: the page did not start: {getattr(answer, 'reason', answer)}")
        self.port = answer.port

    def send(self, message: object) -> None:
        """Send a message; waits while the pipe is full. Raises OSError: the page has ended."""
        self._pipe.send_bytes(pickle.dumps(message, pickle.HIGHEST_PROTOCOL))

    def receive(self) -> Any:
        """Return the next message; waits for it. Raises OSError, EOFError: the page has ended."""
        return self._pipe.recv()

    def disconnect(self) -> None:
        """Close the connection: the page ends, and :meth:`receive` raises."""
        with suppress(OSError):  # it has hung up before
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the page; no thread may be in :meth:`receive`."""
        self.disconnect()
        self._socket.close()
        self._pipe.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
