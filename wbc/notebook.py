"""HTML tables of this package's objects in notebooks."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from wbc.errors import WbcError

Row = tuple[str, str]
_STYLE = "text-align:left;vertical-align:top;padding:1px 12px 1px 0;font-weight:normal"
MOST_ROWS = 12  # most rows shown of each kind
DPI, SHOWN_WIDTH = 80, 640  # of pictures: dots per inch, and width on the page [pixels]


def as_html(title: str, facts: Iterable[Row], rows: Iterable[Row] = ()) -> str:
    """Return a title and a table of names and values as HTML, in the page's own colours.

    ``facts``: names and values; empty values are left out.
    ``rows``: names and values of a kind with many: the first twelve are shown, with the total
    number.
    """
    rows = list(rows)
    told = [(name, text) for name, text in (*facts, *rows[:MOST_ROWS]) if text]
    if len(rows) > MOST_ROWS:
        told.append(("", f"and {len(rows) - MOST_ROWS} more"))
    lines = [
        f'<tr><th style="{_STYLE}">{escape(name)}</th><td style="{_STYLE}">{escape(text)}</td></tr>'
        for name, text in told
    ]
    return f"<div><b>{escape(title)}</b><table>{''.join(lines)}</table></div>"


def with_picture(table: str, figure: str, *parts: Any) -> str:
    """Return a table, and below it a picture if Matplotlib is installed.

    ``figure``: what returns the figure of ``parts``, as ``module:function``: pictures stand on a
    floor above those who show themselves.
    """
    if find_spec("matplotlib") is None:
        return table
    module, _, function = figure.partition(":")
    png = io.BytesIO()
    try:
        getattr(import_module(module), function)(*parts).savefig(png, format="png", dpi=DPI)
    except WbcError as error:  # missing meshes, a run without ticks
        return f"{table}<p>no picture: {escape(str(error))}</p>"
    data = base64.b64encode(png.getvalue()).decode()
    return f'{table}<img style="max-width:{SHOWN_WIDTH}px" src="data:image/png;base64,{data}"/>'
