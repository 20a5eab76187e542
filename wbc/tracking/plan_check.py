"""Check that a pendulum's plan is for this robot: mass, place, inertia, soles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import polygon_margin
from wbc.robot import Snapshot
from wbc.rotations import rotations_from
from wbc.validate import Array, names_of

if TYPE_CHECKING:  # plans load CasADi
    from wbc.rmp.plan.plan import Plan

MASS_TOLERANCE = 0.01  # of mass and gravity, relative: errors of forces are as large
COM_TOLERANCE = 0.05  # m, of the first CoM, which a push may displace before the plan begins
INERTIA_TOLERANCE = 0.15  # of the first principal moments of inertia, and of the inertia, relative
SUPPORT_TOLERANCE = 2e-3  # m, of a support outside the soles
GROUND_TOLERANCE = 5e-3  # m, of soles from the ground, which plans have at z = 0


class PlanMismatchError(InvalidInputError):
    """A plan that is not for this robot: of another mass, place or inertia, or on other soles."""


def check_plan(plan: Plan, start: Snapshot, feet: Iterable[str], *, flights: bool = False) -> None:
    """Refuse a plan that the robot cannot follow on its feet.

    ``start``: the robot at rest, before the plan begins.
    ``feet``: those that stand, all the time except in flights.
    ``flights``: whether the feet leave the ground where the plan does, and come back to where they
    stood.

    Raises PlanMismatchError: another mass or gravity, a first CoM far from the robot's, another
    inertia, a flight without ``flights``, or supports outside the soles; the message has the
    numbers of all mismatches; InvalidInputError: soles that are not on the ground;
    UnknownNameError: the robot has no such foot.
    """
    polygon = sole_polygon(start, feet)
    found = [*_body_mismatches(plan, start), *_support_mismatches(plan, polygon, flights)]
    if found:
        raise PlanMismatchError(
            f"the plan is not for {start.robot.name} as it stands: {'; '.join(found)}; plan with"
            " the robot's own pendulum: key robot of the plan's file, or wbc.pendulum_of"
        )


def sole_polygon(start: Snapshot, feet: Iterable[str]) -> Array:
    """Return the hull of soles (k, 2) [m] that are on the ground z = 0.

    Raises InvalidInputError: they are not on the ground, or there are none; UnknownNameError: the
    robot has no such foot.
    """
    feet = names_of("plan, feet", feet)
    polygon = support_polygon(start, feet)
    for foot in feet:
        height = float(start.position(start.robot.foot(foot).frame)[2])
        if abs(height) > GROUND_TOLERANCE:
            raise InvalidInputError(
                f"plan: the sole of the {foot} foot is at z = {height:.3g} m; plans are on level"
                " ground at z = 0"
            )
    return polygon


def _body_mismatches(plan: Plan, start: Snapshot) -> Iterator[str]:
    robot, first = start.robot, plan.at(0.0)
    for what, unit in (("mass", "kg"), ("gravity", "m/s^2")):
        its, robots = getattr(plan.problem, what), getattr(robot, what)
        if abs(its - robots) > MASS_TOLERANCE * robots:
            yield f"its {what} is {its:.4g} {unit}, the robot's {robots:.4g}"
    distance = float(np.linalg.norm(first.com[0] - start.com))
    if distance > COM_TOLERANCE:
        yield (
            f"its CoM begins at {_numbers(first.com[0])} m, {1e3 * distance:.3g} mm from the"
            f" robot's {_numbers(start.com)}"
        )
    planned, own = np.sort(first.inertia[0]), np.linalg.eigvalsh(start.inertia)
    difference = float(np.abs(planned / own - 1.0).max())
    if difference > INERTIA_TOLERANCE:
        yield (
            f"its principal moments of inertia begin at {_numbers(planned)} kg m^2, the robot's"
            f" are {_numbers(own)}, {100.0 * difference:.0f} % apart"
        )
        return
    R = rotations_from(first.orientation[:1])[0]
    turned = np.linalg.norm((R * first.inertia[0]) @ R.T - start.inertia)
    difference = float(turned / np.linalg.norm(own))
    if difference > INERTIA_TOLERANCE:
        yield (
            "its principal axes of inertia begin turned from the robot's, by"
            f" {100.0 * difference:.0f} % of the inertia"
        )


def _support_mismatches(plan: Plan, polygon: Array, flights: bool) -> Iterator[str]:
    for phase in plan.problem.schedule:
        if phase.support is None:
            if not flights:
                yield f"phase {phase.name!r} is a flight, and the feet stay on the ground here"
            continue
        outside = -float(polygon_margin(polygon, np.array(phase.support)).min())
        if outside > SUPPORT_TOLERANCE:
            yield (
                f"phase {phase.name!r} has the CoP up to {1e3 * outside:.3g} mm outside the soles"
                " that stand"
            )


def _numbers(values: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.3g}' for value in values)})"
