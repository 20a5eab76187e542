"""The support polygon: what the soles that stand on the ground span, seen from above."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wbc.errors import InvalidInputError
from wbc.polygon import convex_hull
from wbc.robot import Snapshot
from wbc.validate import Array, read_only


def support_polygon(snapshot: Snapshot, feet: Iterable[str]) -> Array:
    """Return the corners (k, 2) [m] of the hull of the feet's soles, counter-clockwise, read-only.

    World x and y of the soles' corners, wherever the soles are: whether a foot touches the ground
    is the caller's knowledge.

    Parameters
    ----------
    feet:
        Feet that stand, such as ``("left", "right")``.

    Raises
    ------
    UnknownNameError
        The robot has no such foot.
    InvalidInputError
        No feet at all.
    """
    robot = snapshot.robot
    names = (feet,) if isinstance(feet, str) else tuple(feet)
    if not names:
        raise InvalidInputError("feet: name at least one foot that stands on the ground")
    corners = []
    for name in names:
        foot = robot.foot(name)
        R, p = snapshot.rotation(foot.frame), snapshot.position(foot.frame)
        corners.append(foot.polygon @ R[:2, :2].T + p[:2])
    return read_only(convex_hull(np.concatenate(corners)))
