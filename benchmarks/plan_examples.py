"""Planning problems to start from, each with parameters; all are data and can be changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from wbc.errors import UnknownNameError
from wbc.rmp.plan import (
    PathLimits,
    PlanPhase,
    PlanProblem,
    State,
    Weights,
    at_rest,
    hull,
    rectangle,
)
from wbc.rmp.solid import SolidRmp

MASS = 30.0  # kg
HEIGHT = 0.75  # m, of the CoM
RADII = (0.22, 0.2, 0.15)  # m: an upright body is longest along z, so thin about it
SOLE = (0.22, 0.12)  # m
LIMITS = PathLimits(
    friction=0.7,
    torsion=0.03,
    normal_force=(30.0, 1200.0),
    leg_length=(0.45, 0.9),
    torque=60.0,
    radius=(0.08, 0.35),
    radius_rate=3.0,
    radius_acceleration=60.0,
)
UPRIGHT = State(com=(None, None, HEIGHT), rotation=(0.0, 0.0, 0.0), radii=RADII)
STILL = (0.0, 0.0, 0.0)


def push_recovery(impulse: float = 9.0, mass: float = MASS) -> PlanProblem:
    """Return recovery on one support from an impulse along x [N s]."""
    start = replace(at_rest((0.0, 0.0, HEIGHT), RADII), com_velocity=(impulse / mass, 0.0, 0.0))
    stance = rectangle(0.0, 0.0, *(SOLE[0], 0.3))
    return PlanProblem(
        SolidRmp(mass),
        (PlanPhase("absorb", 2.0, stance, 40),),
        start=start,
        goal=at_rest((0.0, 0.0, HEIGHT), RADII),
        nominal=UPRIGHT,
        limits=LIMITS,
    )


def push_recovery_step(impulse: float = 24.0, step: float = 0.3, mass: float = MASS) -> PlanProblem:
    """Return recovery with a step of a given length [m] from an impulse along x [N s]."""
    start = replace(at_rest((0.0, 0.0, HEIGHT), RADII), com_velocity=(impulse / mass, 0.0, 0.0))
    left, right = rectangle(0.0, 0.09, *SOLE), rectangle(step, -0.09, *SOLE)
    return PlanProblem(
        SolidRmp(mass),
        (
            PlanPhase("swing", (0.25, 0.5), left, 10),
            PlanPhase("both", 0.2, hull(left, right), 6),
            PlanPhase("stop", 1.6, hull(left, right), 24),
        ),
        start=start,
        goal=at_rest((step / 2.0, 0.0, HEIGHT), RADII),
        nominal=UPRIGHT,
        limits=LIMITS,
    )


def squat(depth: float = 0.2, duration: float = 1.0) -> PlanProblem:
    """Return a squat: down by ``depth`` [m], and up again, each in ``duration`` [s]."""
    stance = rectangle(0.0, 0.0, SOLE[0], 0.3)
    low = HEIGHT - depth
    down = replace(LIMITS, height=(0.0, HEIGHT + 0.02))
    hold = replace(LIMITS, height=(0.0, low + 0.01))
    return PlanProblem(
        SolidRmp(MASS),
        (
            PlanPhase("down", duration, stance, 16, down),
            PlanPhase("hold", 0.3, stance, 6, hold),
            PlanPhase("up", duration, stance, 16, down),
        ),
        start=at_rest((0.0, 0.0, HEIGHT), RADII),
        goal=at_rest((0.0, 0.0, HEIGHT), RADII),
        nominal=State(com=(0.0, 0.0, None), rotation=STILL, radii=RADII),
        limits=LIMITS,
    )


def lean(distance: float = 0.07, duration: float = 1.5) -> PlanProblem:
    """Return a lean: the CoM goes sideways by ``distance`` [m] in y and stays."""
    stance = rectangle(0.0, 0.0, SOLE[0], 0.3)
    return PlanProblem(
        SolidRmp(MASS),
        (PlanPhase("lean", duration, stance, 30),),
        start=at_rest((0.0, 0.0, HEIGHT), RADII),
        goal=at_rest((0.0, distance, HEIGHT), RADII),
        nominal=UPRIGHT,
        limits=LIMITS,
    )


def hop(forward: float = 0.3, rise: float = 0.15) -> PlanProblem:
    """Return a hop over ``forward`` [m] with a flight that rises by ``rise`` [m] at least."""
    first, second = (rectangle(x, 0.0, SOLE[0], 0.3) for x in (0.0, forward))
    flight = 2.0 * math.sqrt(2.0 * rise / 9.81)
    return PlanProblem(
        SolidRmp(MASS),
        (
            PlanPhase("crouch and push", (0.4, 1.0), first, 16),
            PlanPhase("flight", (flight, 1.5 * flight), None, 10),
            PlanPhase("land", (0.4, 1.0), second, 16),
        ),
        start=at_rest((0.0, 0.0, HEIGHT), RADII),
        goal=at_rest((forward, 0.0, HEIGHT), RADII),
        nominal=UPRIGHT,
        limits=LIMITS,
    )


def hop_with_turn(turn: float = math.pi, axis: str = "z") -> PlanProblem:
    """Return a hop on the spot that turns the masses by ``turn`` [rad] in the air.

    In the air the masses draw in to spin faster. Rotations are counted from the middle of the
    turn, so that a whole turn stays clear of the singular orientation; two are out of reach.

    Parameters
    ----------
    axis:
        ``"x"``, ``"y"`` (a somersault) or ``"z"`` (a pirouette).

    Raises
    ------
    UnknownNameError
        Another axis.
    """
    if axis not in ("x", "y", "z"):
        raise UnknownNameError("axis", axis, "xyz")
    place = "xyz".index(axis)
    first, last = (
        tuple(side * turn / 2.0 if k == place else 0.0 for k in range(3)) for side in (-1.0, 1.0)
    )
    about = tuple(None if k == place else 0.0 for k in range(3))
    stance = rectangle(0.0, 0.0, SOLE[0], 0.3)
    strong = replace(LIMITS, torsion=0.1, torque=150.0, radius=(0.14, 0.35))
    tucked = replace(strong, radius=(0.06, 0.35))
    rest = replace(at_rest((0.0, 0.0, HEIGHT), RADII), rotation=about)
    return PlanProblem(
        SolidRmp(MASS),
        (
            PlanPhase("wind up", (0.4, 1.0), stance, 20, end=State(rotation=first)),
            PlanPhase("flight", (0.4, 0.6), None, 20, tucked, State(rotation=last)),
            PlanPhase("land", (0.4, 1.0), stance, 20),
        ),
        start=rest,
        goal=rest,
        nominal=State(com=(None, None, HEIGHT), rotation=about, radii=RADII),
        limits=strong,
        weights=Weights(radii=0.1),
    )


def walk(
    steps: int = 4, stride: float = 0.25, width: float = 0.18, single: float = 0.45
) -> PlanProblem:
    """Return a periodic gait of an even number of steps of ``stride`` [m], CoM in a height band."""
    double = 0.15
    band = replace(LIMITS, height=(HEIGHT - 0.03, HEIGHT + 0.03), momentum=3.0)
    feet = [rectangle(k * stride, width / 2.0 * (-1.0) ** k, *SOLE) for k in range(-1, steps + 1)]
    schedule = []
    for k in range(steps):
        schedule.append(PlanPhase(f"both {k + 1}", double, hull(feet[k], feet[k + 1]), 4))
        schedule.append(PlanPhase(f"step {k + 1}", single, feet[k + 1], 8))
    return PlanProblem(
        SolidRmp(MASS),
        tuple(schedule),
        start=State(rotation=STILL, radii=RADII, radii_rates=STILL),
        nominal=UPRIGHT,
        limits=band,
        periodic=(steps * stride, 0.0),
    )


EXAMPLES: dict[str, Callable[[], PlanProblem]] = {
    "push": push_recovery,
    "push and step": push_recovery_step,
    "squat": squat,
    "lean": lean,
    "hop": hop,
    "hop with half turn": hop_with_turn,
    "hop with whole turn": partial(hop_with_turn, 2.0 * math.pi),
    "hop with somersault": partial(hop_with_turn, 2.0 * math.pi, "y"),
    "walk": walk,
}
