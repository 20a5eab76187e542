"""The title of the browser's tab; viser has no option for it, and calls every page Viser."""

from __future__ import annotations

import gzip
import html
import re

from websockets.http11 import Response

TITLE = re.compile(rb"<title>[^<]*</title>")


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
