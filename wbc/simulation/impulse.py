"""How strong a push is, for this robot on these soles: the unit M omega d."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import half_planes
from wbc.robot import Snapshot
from wbc.validate import finite_array, names_of, real_array


def capture_impulse(snapshot: Snapshot, feet: Iterable[str], direction: ArrayLike) -> float:
    """Return M omega d [N s]: what moves the capture point of a robot at rest to its soles' edge.

    It is the largest push through the CoM that is caught without a step and without angular
    momentum, given at once; d is the distance from the CoM's projection to the edge of the soles in
    the direction of the push, omega^2 = g / z with z the CoM's height over the soles.

    Parameters
    ----------
    feet:
        That stand.
    direction:
        (2,) or (3,), of which the part along x and y counts; its length does not.

    Raises
    ------
    InvalidInputError
        No direction along the ground, no feet, or a CoM that is not above the soles.
    """
    given = real_array("push, direction", direction)
    along = finite_array("push, direction", given, (3 if given.size == 3 else 2,))[:2]
    length = float(np.linalg.norm(along))
    if length == 0.0:
        raise InvalidInputError("push, direction: needs a part along the ground")
    feet = names_of("push, feet", feet)
    normals, offsets = half_planes(support_polygon(snapshot, feet))
    towards = normals @ (along / length)
    left = offsets - normals @ snapshot.com[:2]
    if left.min() <= 0.0:
        raise InvalidInputError(
            f"push: the CoM is {-1e3 * left.min():.3g} mm outside the soles; no impulse is caught"
        )
    d = float((left[towards > 0.0] / towards[towards > 0.0]).min())
    robot = snapshot.robot
    return robot.mass * math.sqrt(robot.gravity / com_height(snapshot, feet)) * d


def com_height(snapshot: Snapshot, feet: Iterable[str]) -> float:
    """Return the height of the CoM over the soles of feet, on average [m]."""
    soles = [snapshot.position(snapshot.robot.foot(foot).frame)[2] for foot in feet]
    return float(snapshot.com[2]) - float(np.mean(soles))
