"""What is written below portraits: what the marks in them are."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from matplotlib.figure import Figure

from wbc.view import style
from wbc.view.options import LAYERS
from wbc.view.portrait import Portrait

LINE, CHARACTERS = 0.14, 18.0  # inches of a line of a caption, its characters per inch


def captions(portraits: Sequence[Portrait], width: float) -> list[str]:
    """Return in lines what the marks in the pictures are, for a figure so wide [inches]."""
    there = {
        "leg": any(one.foot is not None for one in portraits),
        "soles": any(one.outlines for one in portraits),
        "obstacles": any(one.scene.solids for one in portraits),
        "targets": any(aim.distant for one in portraits for aim in one.aims),
    }
    view = portraits[0].view
    told = [
        text for name, text in LAYERS.items() if text and view.shows(name) and there.get(name, True)
    ]
    return textwrap.wrap("; ".join(told), round(CHARACTERS * width))


def write_caption(figure: Figure, lines: Sequence[str], top: float) -> None:
    """Write lines at a height above a figure's lower edge [inches]."""
    total = figure.get_size_inches()[1]
    figure.text(
        0.5, top / total, "\n".join(lines), ha="center", va="top", fontsize=7.0,
        color=style.GREY, linespacing=1.25,
    )  # fmt: skip
