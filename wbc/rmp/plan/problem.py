"""A planning problem as data: pendulum, start, goal, schedule, limits, weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.kinds import check_kind
from wbc.polygon import polygon_margin
from wbc.rmp.plan.schedule import STATE, PathLimits, PlanPhase, State, overlap
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import UNIT, SolidRmp
from wbc.validate import Array, check_fields, finite_vector, list_of, set_fields

Pendulum = PlanarRmp | SolidRmp
# Rounding allowed in comparisons with limits.
SLACK = 1e-9
# Degrees allowed for the orientation's polynomial; it needs at least that of a parabola.
DEGREES = (2, 7)
# Range of sizes [SI] that are accepted: no pendulum has others, and no programme could be scaled to
# them. Within it, products and quotients of a few are far from overflow.
SIZES = (1e-9, 1e9)


@dataclass(frozen=True)
class Weights:
    """Cost of a plan: weights of squares, integrated over its time; SI units per mass.

    Parameters
    ----------
    force_rate:
        On |f_r'|^2 / M^2 [(m/s^3)^2], in stance.
    acceleration:
        On |c''|^2 [(m/s^2)^2], in stance.
    momentum, torque:
        On |k_G|^2 / M^2 and |k_G'|^2 / M^2.
    cop_rate:
        On |p'|^2 [(m/s)^2], in stance.
    moment:
        On m_z^2 / M^2, the moment of friction about the vertical.
    radius_acceleration:
        On |r''|^2 [(m/s^2)^2].
    com, radii, rotation:
        On the squared distance from the problem's ``nominal`` state, where it has components;
        rotation in (4 tan(angle/4))^2 [rad^2].
    time:
        On the whole duration [1/s], not squared.

    Raises
    ------
    InvalidInputError
        A weight that is negative or not a number.
    """

    force_rate: float = 1e-4
    acceleration: float = 0.1
    momentum: float = 10.0
    torque: float = 0.1
    cop_rate: float = 0.1
    moment: float = 1.0
    radius_acceleration: float = 1e-2
    com: float = 1.0
    radii: float = 1.0
    rotation: float = 1.0
    time: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "weights: ", *(each.name for each in fields(self)), least=0.0)


@dataclass(frozen=True)
class PlanProblem:
    """A planning problem.

    A PlanarRmp moves in the slice y = 0 of the solid's space, in which r_1 = r_3 (= sqrt(3/2) r of
    the planar pendulum) and all else sideways is zero.

    With a stride ``periodic`` (x, y) [m] the last state shall be the first one moved by it; also
    the ground force, if the motion begins and ends in stance, and the CoP if one place can be in
    both supports.

    Rotations are counted from ``reference``, an orientation of the masses as a unit quaternion
    x y z w. Orientations up to 278 degrees from it about each axis can be reached: at a full turn
    the parameters are singular. For a long turn, choose it in the middle.

    Raises
    ------
    InvalidInputError
        A schedule or states that contradict themselves or each other; the message says how.
    """

    pendulum: Pendulum  # mass and gravity, and the space
    schedule: Sequence[PlanPhase]  # contact phases in order of time, with different names
    start: State  # fixed components of the first state; the others are free
    goal: State = field(default_factory=State)  # of the last state
    nominal: State = field(default_factory=State)  # towards which the cost pulls the motion
    limits: PathLimits = field(default_factory=PathLimits)  # for phases without their own
    weights: Weights = field(default_factory=Weights)
    periodic: tuple[float, float] | None = None
    reference: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    degree: int = 4  # of the polynomial of the orientation in each interval; all else is exact

    def __post_init__(self) -> None:
        if not isinstance(self.pendulum, Pendulum):
            raise InvalidInputError(
                f"plan: pendulum: expected SolidRmp(mass) or PlanarRmp(mass), got"
                f" {shown(self.pendulum)}"
            )
        for name in ("start", "goal", "nominal"):
            check_kind(f"plan: {name}", getattr(self, name), State, "State(com=(0.0, 0.0, 0.7))")
        check_kind("plan: limits", self.limits, PathLimits, "PathLimits(friction=0.6)")
        check_kind("plan: weights", self.weights, Weights, "Weights(com=2.0)")
        example = "PlanPhase(name, duration, support)"
        schedule = list_of("plan: schedule", self.schedule, PlanPhase, example)
        if self.pendulum.gravity == 0.0:
            raise InvalidInputError(
                "plan: gravity must be positive; without it no stance holds and nothing lands"
            )
        set_fields(self, schedule=schedule)
        if self.periodic is not None:
            stride = finite_vector("plan: periodic", self.periodic, 2)
            set_fields(self, periodic=tuple(stride.tolist()))
        reference = finite_vector("plan: reference", self.reference, 4)
        if np.abs(reference).max() > 2.0 or abs(np.linalg.norm(reference) - 1.0) > UNIT:
            raise InvalidInputError("plan: reference must be a unit quaternion (x, y, z, w)")
        set_fields(self, reference=tuple(reference.tolist()))
        low, high = DEGREES
        if isinstance(self.degree, bool) or self.degree not in range(low, high + 1):
            raise InvalidInputError(f"plan: degree must be an integer from {low} to {high}")
        _check_schedule(self)
        _check_sizes(self)
        _check_state(self, "start", self.start, self.limits_of(0), self.schedule[0])
        for name, k, state in self.waypoints:
            _check_state(self, name, state, self.limits_of(k), self.schedule[k])
        if self.plane:
            _check_slice(self)

    @property
    def mass(self) -> float:
        """Mass M [kg]."""
        return self.pendulum.mass

    @property
    def gravity(self) -> float:
        """Gravity [m/s^2]."""
        return self.pendulum.gravity

    @property
    def plane(self) -> bool:
        """True for a planar pendulum."""
        return isinstance(self.pendulum, PlanarRmp)

    @property
    def waypoints(self) -> tuple[tuple[str, int, State], ...]:
        """Fixed states at ends of phases: name, index of the phase, components; the goal last."""
        ends = [(f"end of {p.name}", k, p.end) for k, p in enumerate(self.schedule)]
        given = [each for each in ends if each[2] != State()]
        return (*given, ("goal", len(self.schedule) - 1, self.goal))

    @property
    def period(self) -> dict[str, Array]:
        """Periodic quantities by name, with their changes (3,) over the period; may be empty."""
        if self.periodic is None:
            return {}
        dx, dy = self.periodic
        names = list(STATE)
        first, last = self.schedule[0], self.schedule[-1]
        if first.support is not None and last.support is not None:
            names.append("force")
            if overlap(first.support, tuple((x - dx, y - dy) for x, y in last.support)):
                names.append("cop")
                if min(self.limits_of(k).torsion for k in (0, -1)) > 0.0:
                    names.append("moment")
        stride, none = np.array((dx, dy, 0.0)), np.zeros(3)
        return {name: stride if name in ("com", "cop") else none for name in names}

    def limits_of(self, phase: int) -> PathLimits:
        """Return the limits of a phase, by its index in the schedule."""
        own = self.schedule[phase].limits
        return self.limits if own is None else own


def _check_schedule(problem: PlanProblem) -> None:
    schedule = problem.schedule
    if not schedule:
        raise InvalidInputError("schedule: needs at least one phase")
    names = [phase.name for phase in schedule]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InvalidInputError(f"schedule: phases must have different names; twice: {twice}")
    for before, after in pairwise(schedule):
        if before.flies and after.flies:
            raise InvalidInputError(
                f"schedule: {before.name!r} and {after.name!r} are one flight; join them"
            )
    if schedule[-1].flies and problem.goal == State() and problem.periodic is None:
        raise InvalidInputError(
            f"schedule: the plan ends in the flight {schedule[-1].name!r} without a goal, so"
            " nothing tells where to; add a goal, or a stance to land in"
        )
    if schedule[0].flies and (problem.start.com is None or problem.start.com_velocity is None):
        raise InvalidInputError(
            f"schedule: the plan begins in the flight {schedule[0].name!r}, whose parabola needs"
            " com and com_velocity in the start"
        )


def _check_sizes(problem: PlanProblem) -> None:
    """Raise if a number without limits of its own is absurdly large or small."""
    sizes: dict[str, ArrayLike] = {"mass": problem.mass, "gravity": problem.gravity}
    places: dict[str, ArrayLike] = {"periodic": problem.periodic or 0.0}
    for where, limits in (("", problem.limits), *((p.name, p.limits) for p in problem.schedule)):
        for each in fields(limits) if limits is not None else ():
            sizes[f"limits: {each.name}{where and f' of {where}'}"] = getattr(limits, each.name)
    for phase in problem.schedule:
        sizes[f"phase {phase.name!r}: duration"] = phase.duration
    states = {"start": problem.start, "nominal": problem.nominal}
    states |= {name: state for name, _, state in problem.waypoints}
    for which, state in states.items():
        for name, values in state.values(problem.mass).items():
            places[f"{which}: {name}"] = np.nan_to_num(np.array(values, dtype=float))
    for what, given in (sizes | places).items():
        values = np.abs(np.atleast_1d(np.asarray(given, dtype=float)))
        small = (values > 0.0) & (values < SIZES[0]) & (what in sizes)
        large = np.isfinite(values) & (values > SIZES[1])
        if (small | large).any():
            raise InvalidInputError(
                f"{what}: {values[small | large][0]:g} is out of all proportion; use SI units,"
                f" {SIZES[0]:g} to {SIZES[1]:g}"
            )


def _check_state(
    problem: PlanProblem, which: str, state: State, limits: PathLimits, phase: PlanPhase
) -> None:
    """Raise if a fixed state violates its phase's limits, or no possible CoP lies below it."""
    given = state.values(problem.mass)
    rate, momentum = limits.radius_rate, limits.momentum
    com = given.get("com", np.full(3, np.nan))
    for what, values, (low, high) in (
        ("radii", given.get("radii"), limits.radius),
        ("radii_rates", given.get("radii_rates"), (-rate, rate)),
        ("momentum", given.get("momentum"), (-momentum, momentum)),
        ("height of the CoM", com[2:], limits.height),
    ):
        for value in () if values is None else values[np.isfinite(values)]:
            if not low - SLACK <= value <= high + SLACK:
                raise InvalidInputError(
                    f"{which}: {what}: {value:g} is not within the limits {low:g} to {high:g}"
                )
    if com[2] <= 0.0:
        raise InvalidInputError(f"{which}: the CoM must be above the ground, got {com[2]:g} m")
    if phase.support is None or not np.isfinite(com).all():
        return
    # Distances of the CoM from the support, least and greatest.
    away = max(0.0, -float(polygon_margin(phase.support, com[:2])))
    farthest = np.linalg.norm(np.array(phase.support) - com[:2], axis=1).max()
    shortest, longest = np.hypot((away, farthest), com[2])
    if shortest > limits.leg_length[1] + SLACK or longest < limits.leg_length[0] - SLACK:
        raise InvalidInputError(
            f"{which}: no CoP is possible in phase {phase.name!r}: from its support to the CoM at"
            f" {com} m the leg is {shortest:.4g} to {longest:.4g} m long, but its length must be"
            f" {limits.leg_length[0]:.4g} to {limits.leg_length[1]:.4g} m"
        )


def _check_slice(problem: PlanProblem) -> None:
    """Raise if a given value lies outside the plane y = 0."""
    # The components that are zero in the plane.
    sideways = {"com": (1,), "com_velocity": (1,), "orientation": (0, 2), "momentum": (0, 2)}
    zero = np.zeros(3)
    ends = [(name, state) for name, _, state in problem.waypoints]
    for which, state in (("start", problem.start), ("nominal", problem.nominal), *ends):
        given = state.values(problem.mass)
        for name, places in sideways.items():
            if np.nan_to_num(given.get(name, zero)[list(places)]).any():
                raise InvalidInputError(f"{which}: {name} of a planar pendulum must stay in y = 0")
        for name in ("radii", "radii_rates"):
            r = given.get(name, zero)
            if not np.array_equal(r[0], r[2], equal_nan=True):
                raise InvalidInputError(f"{which}: {name} of a planar pendulum need r_1 = r_3")
    for phase in problem.schedule:
        if phase.support is not None:
            sides = np.array(phase.support)[:, 1]
            if sides.min() > SLACK or sides.max() < -SLACK:
                raise InvalidInputError(
                    f"phase {phase.name!r}: the support does not reach the plane y = 0"
                )
    if any(problem.reference[k] != 0.0 for k in (0, 2)):
        raise InvalidInputError("plan: the reference of a planar pendulum must turn about y only")
    if problem.periodic is not None and problem.periodic[1] != 0.0:
        raise InvalidInputError("plan: the stride of a planar pendulum must be along x")
