"""The look of plots, and files of pictures. Nothing global: every figure is styled by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.files import ending_of, system_message, write_whole
from wbc.validate import Array
from wbc.view import palette

BLACK, ORANGE, SKY, GREEN = palette.BLACK, palette.ORANGE, palette.SKY, palette.GREEN
BLUE, VERMILION, PURPLE, GREY = palette.BLUE, palette.VERMILION, palette.PURPLE, palette.GREY
YELLOW, PRINCIPAL, OBSTACLE = palette.YELLOW, palette.PRINCIPAL, (0.72, 0.55, 0.38)
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
INDEX = "₁₂₃"
TINT: Array = np.array([0.10, 0.50, 0.78])  # of the ellipsoid

DPI = 180
SMALL, NORMAL, LARGE = 8.0, 9.0, 11.0  # points
TITLE, PAD = 0.12, 0.08  # inches above a figure's title, and around plots


def plain(axes: Axes, title: str, x_label: str, y_label: str) -> None:
    """Give a plot its title and labels, two spines and a faint grid."""
    axes.set_title(title, loc="left", fontsize=NORMAL, fontweight="bold", color=BLACK)
    axes.set_xlabel(x_label, fontsize=SMALL, color=BLACK)
    axes.set_ylabel(y_label, fontsize=SMALL, color=BLACK)
    axes.tick_params(labelsize=SMALL, colors=BLACK, width=0.6, length=3)
    axes.grid(True, color="#E4E6EA", linewidth=0.6)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(GREY)
        spine.set_linewidth(0.8)


def sheet(width: float, height: float, title: str | None = None, plots: float = 0.0) -> Figure:
    """Return an empty figure with a title [inches].

    Subplots fill its lower ``plots`` inches, laid out so that every text has room; what is added
    with ``add_axes`` stays where it is put.
    """
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    if plots > 0.0:
        area = (0.0, 0.0, 1.0, plots / height)
        figure.set_layout_engine("constrained", rect=area, w_pad=PAD, h_pad=PAD)
    if title:
        top = 1.0 - TITLE / height
        figure.suptitle(title, y=top, va="top", fontsize=LARGE, fontweight="bold", color=BLACK)
    return figure


def right_axis(axes: Axes, label: str, colour: str) -> Axes:
    """Return a second vertical axis of a plot, on the right."""
    other = axes.twinx()
    other.set_ylabel(label, fontsize=SMALL, color=colour)
    other.tick_params(labelsize=SMALL, colors=colour, width=0.6, length=3)
    for side, spine in other.spines.items():
        spine.set_visible(side == "right")
        spine.set_color(GREY)
    return other


def place(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Return new axes at a place in a figure [inches]."""
    wide, high = figure.get_size_inches()
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def write_below(axes: Axes, texts: Sequence[str], apart: float, size: float) -> None:
    """Write a text per principal axis below ``axes``, ``apart`` of its width from each other."""
    for k, (text, colour) in enumerate(zip(texts, PRINCIPAL, strict=True)):
        axes.text(
            0.5 + apart * (k - 1), -0.015, text, color=colour, fontsize=size, fontweight="bold",
            ha="center", va="top", transform=axes.transAxes,
        )  # fmt: skip


# ---------------------------------------------------------------------- files

# What must not be written by each format so that the same run gives the same file.
FORMATS: Mapping[str, Mapping[str, None]] = {
    ".png": {},
    ".svg": {"Date": None},
    ".pdf": {"CreationDate": None},
}


def picture_file(path: str | Path) -> Path:
    """Return a path that a picture can be written to."""
    ending_of(path, FORMATS, f"a picture is written as {', '.join(FORMATS)}")
    path = Path(path)
    if not path.parent.is_dir():
        raise InvalidInputError(f"{path}: there is no folder {path.parent}; make it first")
    return path


def literal(text: str) -> str:
    """Return text that Matplotlib writes as it is: what is between two $ it takes for formulas."""
    return text.replace("$", r"\$")


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure to a file, png, svg or pdf by its suffix, and return its path.

    Raises InvalidInputError: see :func:`picture_file`; or the system refuses to write it.
    """
    path = picture_file(path)
    suffix = path.suffix.lower()
    try:
        options: dict[str, Any] = {"format": suffix[1:], "metadata": dict(FORMATS[suffix])}
        write_whole(path, lambda file: figure.savefig(file, dpi=DPI, **options))
    except OSError as error:
        raise InvalidInputError(f"{path}: cannot be written: {system_message(error)}") from error
    return path
