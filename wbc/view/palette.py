"""Colours that pictures, reports and the live viewer share: Okabe and Ito's.

The colour-blind tell them apart as well.
"""

from __future__ import annotations

BLACK, ORANGE, SKY, GREEN = "#222222", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#8A8F98"
YELLOW, BOARD = "#F0E442", "#D2D5DA"  # of what lies on the ground, which is nearly white
PRINCIPAL = (VERMILION, GREEN, PURPLE)  # the ellipsoid's axes, the longest first


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#RRGGBB``, 0 to 255."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def unit_rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green and blue of ``#RRGGBB``, 0 to 1."""
    red, green, blue = rgb(colour)
    return red / 255.0, green / 255.0, blue / 255.0
