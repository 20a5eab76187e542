"""Colours and the look of plots. Nothing global: every figure is styled by itself."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wbc.validate import Array

# Okabe and Ito's colours, which the colour-blind tell apart as well.
BLACK, ORANGE, SKY, GREEN = "#222222", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#8A8F98"
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)
PRINCIPAL = (VERMILION, GREEN, PURPLE)  # the ellipsoid's axes, the longest first
INDEX = "₁₂₃"
TINT: Array = np.array([0.10, 0.50, 0.78])  # of the ellipsoid

DPI = 180
SMALL, NORMAL, LARGE = 8.0, 9.0, 11.0  # points


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


def heading(figure: Figure, text: str, top: float) -> None:
    """Write a title in the middle, its upper edge at ``top`` (part of the figure's height)."""
    figure.suptitle(text, y=top, va="top", fontsize=LARGE, fontweight="bold", color=BLACK)
