"""What a picture shows and from where: layers and views by their names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError

# What can be drawn of a robot, and what a caption says of it.
LAYERS = {
    "robot": "",
    "ground": "",
    "ellipsoid": "blue: equimomental ellipsoid (the robot's inertia), semi-axes a₁ ≥ a₂ ≥ a₃ in mm",
    "masses": "dots on its axes: the six reaction masses M/6",
    "com": "quartered disc: CoM",
    "leg": "black: pendulum's leg, from the ground under the CoM",
    "soles": "orange: soles",
    "obstacles": "brown: obstacles",
    "targets": "yellow diamonds: targets",
    "wrenches": "red arrows: forces from outside",
}
EVERYTHING = frozenset(LAYERS)
WITHOUT = "no-"
# Azimuth (0 in front of the robot, 90 on its left) and elevation [degrees].
DIRECTIONS = {
    "front-left": (33.0, 12.0),
    "front": (0.0, 8.0),
    "front-right": (-33.0, 12.0),
    "left": (90.0, 8.0),
    "right": (-90.0, 8.0),
    "back": (180.0, 8.0),
    "back-left": (147.0, 12.0),
    "back-right": (-147.0, 12.0),
    "top": (0.0, 89.0),
}


@dataclass(frozen=True)
class View:
    """What is drawn, and where the camera stands."""

    # azimuth and elevation: where the camera stands as seen from the robot [rad]; azimuth 0 is in
    # front, pi/2 on its left.
    azimuth: float = float(np.deg2rad(DIRECTIONS["front-left"][0]))
    elevation: float = float(np.deg2rad(DIRECTIONS["front-left"][1]))
    layers: frozenset[str] = EVERYTHING  # names of LAYERS

    @classmethod
    def of(cls, view_from: str = "front-left", show: str | Iterable[str] = "all") -> View:
        """Return the view that words describe.

        ``view_from``: a name such as ``left`` or ``top``, or azimuth and elevation in degrees:
        ``60,20``.
        ``show``: ``all``, or names of layers with commas between; those that begin with ``no-`` are
        left out of all.

        Raises UnknownNameError: no such direction or layer; InvalidInputError: an elevation that is
        not within 89 degrees of level.
        """
        azimuth, elevation = np.deg2rad(_direction(view_from)).tolist()
        return cls(azimuth, elevation, _layers(show))

    def shows(self, layer: str) -> bool:
        """Return whether a layer is drawn."""
        return layer in self.layers


def _direction(text: str) -> tuple[float, float]:
    if text in DIRECTIONS:
        return DIRECTIONS[text]
    try:
        azimuth, elevation = (float(part) for part in text.split(","))
    except ValueError:
        in_numbers = any(letter.isdigit() for letter in text)
        remedy = "expected azimuth,elevation in degrees, as in 30,15" if in_numbers else ""
        raise UnknownNameError("direction to view from", text, DIRECTIONS, remedy) from None
    if not (np.isfinite(azimuth) and abs(elevation) <= 89.0):
        raise InvalidInputError(
            f"view from {text}: azimuth and elevation in degrees, the elevation within 89 of level"
        )
    return azimuth, elevation


def _layers(show: str | Iterable[str]) -> frozenset[str]:
    words = show.split(",") if isinstance(show, str) else show
    names = [word.strip() for word in words if word.strip()]
    left_out = {name.removeprefix(WITHOUT) for name in names if name.startswith(WITHOUT)}
    wanted = {name for name in names if not name.startswith(WITHOUT)}
    for name in sorted((wanted | left_out) - EVERYTHING - {"all"}):
        raise UnknownNameError("layer", name, (*LAYERS, "all"))
    drawn = EVERYTHING if "all" in wanted or not wanted else frozenset(wanted)
    return drawn - left_out
