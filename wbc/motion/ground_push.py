"""The ground's push in all frames at once: CoP, CMP, margins and the pendulum's leg."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.motion.planted import AUTO
from wbc.motion.support import sole_corners, support_margins, touching
from wbc.reduction import SINGULAR
from wbc.rmp.axes import Bools
from wbc.rmp.ground import centre_of_pressure, centroidal_moment_pivot, normal_moment, pressed
from wbc.robot import Robot
from wbc.robot.series import CentroidalSeries
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class GroundPush:
    """What :class:`wbc.motion.RmpSeries` says of the ground and the leg, by the same names."""

    force: Array
    moment: Array
    cop: Array
    cmp: Array
    flight: Bools
    leg_length: Array
    leg_direction: Array
    leg_angles: Array


def ground_push(robot: Robot, whole: CentroidalSeries, height: float) -> GroundPush:
    """Return the ground's push and the leg; NaN in flight.

    Raises
    ------
    InvalidInputError
        The CoM is at the CoP in some frame.
    """
    force = whole.momentum_rate[:, :3] - robot.mass * robot.model.gravity.linear
    on = pressed(force, robot.mass).astype(bool)
    com, f, k = whole.com[on], force[on], whole.momentum_rate[on, 3:]
    p = centre_of_pressure(com, f, k, height)
    leg = com - p
    length = np.linalg.norm(leg, axis=1)
    if not (length > 0.0).all():
        raise InvalidInputError(
            "the CoM is at the CoP, on the ground: the pendulum's leg has no length; is the"
            " ground's height right?"
        )
    n = leg / length[:, None]
    return GroundPush(
        force=force,
        moment=_where(on, normal_moment(com, f, k, p)),
        cop=_where(on, p),
        cmp=_where(on, centroidal_moment_pivot(com, f, height)),
        flight=~on,
        leg_length=_where(on, length),
        leg_direction=_where(on, n),
        leg_angles=_where(on, leg_angles_of(n)),
    )


def leg_angles_of(direction: Array) -> Array:
    """Return (theta, phi) (n, 2) [rad] of unit vectors (n, 3); NaN along y, see RmpState."""
    x, y, z = direction.T
    across = np.hypot(x, z)
    angles = np.stack((np.arctan2(z, x), np.arctan2(y, across)), axis=1)
    angles[across < SINGULAR] = np.nan
    return angles


def _where(on: Bools, values: Array) -> Array:
    """Return values for all frames, NaN where ``on`` (n,) is False."""
    spread = np.full((len(on), *values.shape[1:]), np.nan)
    spread[on] = values
    return spread


def chosen_feet(robot: Robot, feet: str | Iterable[str] | None) -> tuple[str, ...]:
    """Return the feet to be judged: those named, all for ``auto``, none for None.

    Raises
    ------
    InvalidInputError
        An empty choice, or one for a robot without feet.
    UnknownNameError
        A foot that the robot does not have.
    """
    if feet is None:
        return ()
    if feet == AUTO:
        return tuple(robot.feet)
    if not robot.feet:
        raise InvalidInputError(f"{robot.name} has no feet; say which links they are, or name none")
    names = tuple(dict.fromkeys((feet,) if isinstance(feet, str) else feet))
    if not names:
        raise InvalidInputError("feet: name at least one foot that stands on the ground")
    for name in names:
        if name not in robot.feet:
            raise UnknownNameError(f"foot of {robot.name}", name, (*robot.feet, AUTO))
    return names


def judged(
    robot: Robot,
    whole: CentroidalSeries,
    names: tuple[str, ...],
    fixed: bool,
    planted: NDArray[np.intp] | None,
    push: GroundPush,
    height: float,
) -> tuple[Bools, Array | None]:
    """Return which feet stand (n, f), and the CoP's margin (n,), None if there are no feet.

    Parameters
    ----------
    fixed:
        True if the feet named stand all the time; else those near the ground do.
    planted:
        The planted foot (n,), which stands in any case unless ``fixed``.
    """
    count = len(whole.com)
    if not names:
        return np.zeros((count, 0), dtype=bool), None
    feet = tuple(robot.feet)
    columns = [feet.index(name) for name in names]
    corners = sole_corners(robot, whole.soles)[:, columns]
    standing = np.ones((count, len(names)), dtype=bool) if fixed else touching(corners, height)
    if planted is not None and not fixed:
        standing |= planted[:, None] == np.array(columns)
    standing &= ~push.flight[:, None] | fixed
    return standing, support_margins(corners, standing, push.cop)
