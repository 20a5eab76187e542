"""Whether a pendulum's plan is one for this robot: mass, place, inertia, and soles to stand on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import polygon_margin
from wbc.robot import Snapshot
from wbc.validate import Array

if TYPE_CHECKING:  # plans load CasADi
    from wbc.rmp.plan.plan import Plan, Trajectory

MASS = 0.01  # part by which mass and gravity may differ: forces are wrong by as much
PLACE = 0.05  # m that the first CoM may be off: a push moves it before its plan begins
MOMENTS = 0.15  # part by which principal moments of inertia may differ at the beginning
OUTSIDE = 2e-3  # m that a support may stick out of the soles
LEVEL = 5e-3  # m that soles may be off the ground, which plans have at z = 0


class PlanMismatchError(InvalidInputError):
    """A plan that is not for this robot: of another mass or place, or on other soles."""


def check_fit(plan: Plan, start: Snapshot, feet: Iterable[str], *, flights: bool = False) -> None:
    """Refuse a plan that the robot cannot follow on its feet.

    Parameters
    ----------
    start:
        The robot at rest, before the plan begins.
    feet:
        That stand, all the time but for flights.
    flights:
        Whether the feet leave the ground where the plan does, and come back to where they stood.

    Raises
    ------
    PlanMismatchError
        Another mass or gravity, a first CoM far from the robot's, another inertia, a flight where
        none may be, or supports outside the soles; the message has the numbers of all that do not
        fit.
    InvalidInputError
        Soles that are not on the ground.
    UnknownNameError
        The robot has no such foot.
    """
    polygon = sole_polygon(start, feet)
    found = [*_of_the_body(plan, start), *_of_the_ground(plan, polygon, flights)]
    if found:
        raise PlanMismatchError(
            f"the plan is not for {start.robot.name} as it stands: {'; '.join(found)}; plan with"
            " the robot's own pendulum: key robot of the plan's file, or wbc.pendulum_of"
        )


def sole_polygon(start: Snapshot, feet: Iterable[str]) -> Array:
    """Return the hull of soles (k, 2) [m] that are on the ground z = 0.

    Raises
    ------
    InvalidInputError
        They are not, or there are none.
    UnknownNameError
        The robot has no such foot.
    """
    feet = tuple(feet)
    polygon = support_polygon(start, feet)
    for foot in feet:
        height = float(start.position(start.robot.foot(foot).frame)[2])
        if abs(height) > LEVEL:
            raise InvalidInputError(
                f"plan: the sole of the {foot} foot is at z = {height:.3g} m; plans are on level"
                " ground at z = 0"
            )
    return polygon


def _of_the_body(plan: Plan, start: Snapshot) -> Iterator[str]:
    robot, first = start.robot, plan.at(0.0)
    for what, planned, own, unit in (
        ("mass", plan.problem.mass, robot.mass, "kg"),
        ("gravity", plan.problem.gravity, robot.gravity, "m/s^2"),
    ):
        if abs(planned - own) > MASS * own:
            yield f"its {what} is {planned:.4g} {unit}, the robot's {own:.4g}"
    apart = float(np.linalg.norm(first.com[0] - start.com))
    if apart > PLACE:
        yield (
            f"its CoM begins at {_numbers(first.com[0])} m, {1e3 * apart:.3g} mm from the robot's"
            f" {_numbers(start.com)}"
        )
    yield from _of_the_inertia(first, start)


def _of_the_inertia(first: Trajectory, start: Snapshot) -> Iterator[str]:
    planned, own = np.sort(first.inertia[0]), np.linalg.eigvalsh(start.inertia)
    off = float(np.abs(planned / own - 1.0).max())
    if off > MOMENTS:
        yield (
            f"its principal moments of inertia begin at {_numbers(planned)} kg m^2, the robot's"
            f" are {_numbers(own)}, {100.0 * off:.0f} % apart"
        )


def _of_the_ground(plan: Plan, polygon: Array, flights: bool) -> Iterator[str]:
    for phase in plan.problem.schedule:
        if phase.support is None:
            if not flights:
                yield f"phase {phase.name!r} is a flight, and the feet stay on the ground here"
            continue
        out = -float(polygon_margin(polygon, np.array(phase.support)).min())
        if out > OUTSIDE:
            yield (
                f"phase {phase.name!r} has the CoP up to {1e3 * out:.3g} mm outside the soles that"
                " stand"
            )


def _numbers(values: Array) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"
