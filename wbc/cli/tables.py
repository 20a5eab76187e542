"""The kind of table that ``wbc run`` prints."""

from __future__ import annotations

from rich.console import JustifyMethod
from rich.table import Table
from rich.text import Text


def heads(*columns: str) -> Table:
    """Return an empty table under a line of heads: the first column to the left, numbers right."""
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim")
    for k, column in enumerate(columns):
        justify: JustifyMethod = "left" if k == 0 else "right"
        table.add_column(Text(f"\n{column}"), justify=justify, overflow="fold")
    return table
