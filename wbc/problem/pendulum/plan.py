"""Motion planning for a pendulum: the keys in a problem file, and how to build and solve it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.pendulum.result import PendulumHistory, PendulumResult, PendulumStatus, Support
from wbc.problem.section import (
    Components,
    Forms,
    KeysOf,
    Name,
    NonEmpty,
    NonNegative,
    Pair,
    Quaternion,
    Section,
    Size,
    Two,
)
from wbc.problem.targets import Offset
from wbc.rmp.ground import centroidal_moment_pivot
from wbc.rmp.plan import (
    Corners,
    PathLimits,
    Plan,
    PlanPhase,
    PlanProblem,
    State,
    Weights,
    check,
    hull,
    plan_arrays,
    rectangle,
    solve,
)
from wbc.rmp.plan.problem import DEGREES
from wbc.rmp.plan.schedule import MOST_INTERVALS
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.rotations import rotations_from
from wbc.tracking.pendulum import RobotPendulum
from wbc.tracking.reference import DOUBLE

# Points drawn per interval between two knots, so that curves look smooth.
POINTS_PER_INTERVAL = 4

_Durations = Annotated[Size | Two[Size], Forms("seconds, or [least, greatest]")]
_Com = Annotated[
    Components | Offset,
    Forms("[x, y, z] in metres, null where free, or {offset: [x, y, z]} from the robot's"),
]
_State = Annotated[dict[str, Any], KeysOf(State, com=_Com)]
_Limits = Annotated[dict[str, Any], KeysOf(PathLimits)]


class RectangleSpec(Section):
    """A rectangular sole on the ground, its sides along x and y."""

    at: Pair
    """Centre [x, y] [m]."""
    size: Two[Size]
    """Length along x and width along y [m]."""

    def corners(self) -> Corners:
        """Return its corners, anticlockwise."""
        return rectangle(*self.at, *self.size)


class HullSpec(Section):
    """The convex hull of several soles."""

    hull: NonEmpty[RectangleSpec]
    """The soles."""

    def corners(self) -> Corners:
        """Return its corners, anticlockwise."""
        return hull(*(sole.corners() for sole in self.hull))


class SolesSpec(Section):
    """The robot's own soles, at their positions in its posture."""

    soles: Name
    """A foot, or double for left and right together."""
    margin: NonNegative = 0.0
    """How far inside their edge the CoP stays [m]: the reserve for correcting errors."""


_Support = Annotated[
    Literal["flight"] | NonEmpty[Pair] | RectangleSpec | HullSpec | SolesSpec,
    Forms(
        "flight, corners [[x, y], ...] anticlockwise, {at: [x, y], size: [length, width]},"
        " {hull: [...]} of several, or {soles: double}"
    ),
]


class PlanPhaseSpec(Section):
    """A phase of the schedule: on one support, or in flight."""

    duration: _Durations
    """Duration [s], or [least, greatest] to let the planner choose."""
    support: _Support
    """The area on which the ground can push, or flight."""
    intervals: Annotated[int, Field(ge=1, le=MOST_INTERVALS)] = PlanPhase.intervals
    """Number of intervals of the collocation."""
    limits: _Limits = Field(default_factory=dict)
    """Limits in this phase that differ from the plan's."""
    end: _State = Field(default_factory=dict)
    """Fixed components of the state at the end of the phase."""

    def build(self, name: str, limits: PathLimits, robot: RobotPendulum | None) -> PlanPhase:
        """Return the phase; ``limits`` are the plan's.

        Raises WbcError: numbers that contradict each other, or a foot that the robot does not have.
        """
        support: Any = self.support
        if isinstance(support, SolesSpec):
            if robot is None:
                raise Misplaced("soles are a robot's; give robot, or corners", "support", "soles")
            feet = DOUBLE if support.soles == "double" else (support.soles,)
            support = robot.soles(feet, support.margin)
        elif isinstance(support, RectangleSpec | HullSpec):
            support = support.corners()
        return PlanPhase(
            name=name,
            duration=self.duration,  # type: ignore[arg-type]  # one number or two, as validated
            support=None if support == "flight" else support,
            intervals=self.intervals,
            limits=replace(limits, **self.limits) if self.limits else None,
            end=_state(self.end, robot),
        )


def _state(given: Mapping[str, Any], robot: RobotPendulum | None, whole: bool = False) -> State:
    """Return a state; of a robot's plan, if ``whole``, what is not given is as in its posture."""
    values = dict(given)
    com = values.get("com")
    if isinstance(com, Offset):
        if robot is None:
            raise Misplaced("an offset is from a robot's CoM; give robot, or a place", "com")
        values["com"] = tuple((robot.start.com + np.array(com.offset)).tolist())
    if robot is not None and whole:
        rest = {each.name: getattr(robot.rest, each.name) for each in fields(State)}
        if "inertia" in values:
            del rest["radii"]
        values = {**rest, **values}
    return State(**values)


class PlanSpec(Section):
    """A motion to plan by direct collocation."""

    schedule: Annotated[dict[Name, PlanPhaseSpec], Field(min_length=1)]
    """Phases by name, in order of time."""
    start: _State = Field(default_factory=dict)
    """Fixed components of the first state. With robot, here and in goal and nominal, components
    that are left out are those of its posture at rest; [null, null, null] is free."""
    goal: _State = Field(default_factory=dict)
    """Fixed components of the last state."""
    nominal: _State = Field(default_factory=dict)
    """The state towards which the cost pulls."""
    limits: _Limits = Field(default_factory=dict)
    """Limits of all phases; a phase may override some."""
    weights: Annotated[dict[str, Any], KeysOf(Weights)] = Field(default_factory=dict)
    """Weights of the cost, each on the integral over time of a squared quantity."""
    periodic: Pair | None = None
    """Stride [x, y] [m]: the last state is the first one moved by it."""
    reference: Quaternion | None = None
    """Orientation relative to which rotations are measured, a unit quaternion (x, y, z, w). Left
    out: the world's, or that of the robot's ellipsoid in its posture."""
    degree: Annotated[int, Field(ge=DEGREES[0], le=DEGREES[1])] = PlanProblem.degree
    """Degree of the orientation's polynomial in each interval."""
    iterations: Annotated[int, Field(ge=1, le=100_000)] = 100
    """Largest number of iterations of IPOPT."""

    def build(
        self, pendulum: PlanarRmp | SolidRmp, mistakes: Mistakes, robot: RobotPendulum | None = None
    ) -> Planning:
        """Return the planning problem, for a pendulum that may be a robot's.

        Raises ProblemFileError: with every mistake found.
        """
        given: dict[str, Any] = {"limits": PathLimits(), "schedule": ()}
        with mistakes.at("plan", "limits"):
            given["limits"] = PathLimits(**self.limits)
        for name in ("start", "goal", "nominal"):
            with mistakes.at("plan", name):
                given[name] = _state(getattr(self, name), robot, whole=True)
        for name, phase in self.schedule.items():
            with mistakes.at("plan", "schedule", name):
                given["schedule"] += (phase.build(name, given["limits"], robot),)
        with mistakes.at("plan", "weights"):
            given["weights"] = Weights(**self.weights)
        given |= {name: getattr(self, name) for name in ("periodic", "degree")}
        own = PlanProblem.reference if robot is None else robot.reference
        given["reference"] = own if self.reference is None else self.reference
        mistakes.raise_any()
        problem = mistakes.require(("plan",), lambda: PlanProblem(pendulum, **given))
        return Planning(problem, self.iterations)


@dataclass(frozen=True, eq=False)
class Planning:
    """A planning problem, and the largest number of iterations."""

    problem: PlanProblem
    iterations: int

    def solve(self) -> Plan:
        """Return the plan. Raises PlanError: there is none; the error names what is in the way."""
        return solve(self.problem, iterations=self.iterations)

    def run(self, provenance: Mapping[str, Any]) -> PendulumResult:
        """Solve for a plan and return it, checked at twice the knots.

        Raises PlanError: there is none; the error names what is in the way.
        """
        plan = self.solve()
        checked = check(plan)
        stats = plan.stats
        measures = {
            "variables": float(stats.variables),
            "constraints": float(stats.constraints),
            "iterations": float(stats.iterations),
            "seconds": stats.seconds,
            "duration": plan.duration,
            "largest defect": checked.defect,
            "largest violation": max((each.amount for each in checked.limits), default=-math.inf),
            "momentum drift in flight": checked.drift,
        }
        status = PendulumStatus.PLANNED if checked.ok else PendulumStatus.PLAN_BROKEN
        reason = "; ".join(checked.report().splitlines())
        history, arrays = plan_history(plan), plan_arrays(plan)
        return PendulumResult(status, reason, measures, history, arrays, provenance)


def plan_history(plan: Plan) -> PendulumHistory:
    """Return a plan's motion in space, at four times per interval.

    The leg's foot is the CoP. A planar pendulum is a solid one in the plane y = 0, and has three
    pairs of masses here too.
    """
    motion = plan.refined(POINTS_PER_INTERVAL)
    n = len(motion.time)
    stands = ~np.isnan(motion.cop[:, 0])
    cop, cmp = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    cop[stands] = 0.0
    cop[stands, :2] = motion.cop[stands]
    pushed = stands & (motion.force[:, 2] > 0.0)
    cmp[pushed] = centroidal_moment_pivot(motion.com[pushed], motion.force[pushed])
    spans = zip(plan.starts[:-1].tolist(), plan.starts[1:].tolist(), strict=True)
    return PendulumHistory(
        flat=False,
        time=motion.time,
        phase=tuple(plan.phases[k] for k in motion.phase),
        com=motion.com,
        com_velocity=motion.com_velocity,
        foot=cop,
        cop=cop,
        cmp=cmp,
        radii=motion.radii,
        axes=rotations_from(motion.orientation),
        momentum=motion.momentum,
        supports=tuple(
            Support(start, end, np.array(phase.support))
            for phase, (start, end) in zip(plan.problem.schedule, spans, strict=True)
            if phase.support is not None
        ),
    )
