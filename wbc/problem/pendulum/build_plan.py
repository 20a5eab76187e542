"""From a plan's description to the planner's problem, each mistake at its line."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from wbc.problem.mistakes import Mistakes
from wbc.problem.pendulum.plan_specs import (
    HullSpec,
    PlanLimitsSpec,
    PlanPhaseSpec,
    PlanSpec,
    RectangleSpec,
    StateSpec,
    SupportPolygon,
)
from wbc.rmp.plan import (
    Corners,
    Limits,
    Phase,
    PlanProblem,
    State,
    Weights,
    hull,
    rectangle,
)
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp


def build_plan(spec: PlanSpec, pendulum: PlanarRmp | SolidRmp, mistakes: Mistakes) -> PlanProblem:
    """Return the planning problem.

    Raises
    ------
    ProblemFileError
        With every mistake found.
    """
    limits = Limits()
    with mistakes.at("plan", "limits"):
        limits = _limits(Limits(), spec.limits)
    states = {name: State() for name in ("start", "goal", "nominal")}
    for name in states:
        with mistakes.at("plan", name):
            states[name] = _state(getattr(spec, name))
    phases = list[Phase]()
    for name, phase in spec.schedule.items():
        with mistakes.at("plan", "schedule", name):
            phases.append(_phase(name, phase, limits))
    given: dict[str, Any] = {
        "schedule": tuple(phases),
        "limits": limits,
        "weights": Weights(**spec.weights.model_dump()),
        "periodic": spec.periodic,
        "degree": spec.degree,
        **states,
    }
    if spec.reference is not None:
        given["reference"] = spec.reference
    return mistakes.require(("plan",), lambda: PlanProblem(pendulum, **given))


def _phase(name: str, spec: PlanPhaseSpec, limits: Limits) -> Phase:
    return Phase(
        name=name,
        duration=spec.duration,  # type: ignore[arg-type]  # one number or two, as validated
        support=_corners(spec.support),
        intervals=spec.intervals,
        limits=_limits(limits, spec.limits) if spec.limits.model_fields_set else None,
        end=_state(spec.end),
    )


def _corners(support: SupportPolygon) -> Corners | None:
    if isinstance(support, str):
        return None
    if isinstance(support, RectangleSpec):
        return _sole(support)
    if isinstance(support, HullSpec):
        return hull(*(_sole(one) for one in support.hull))
    return tuple((corner[0], corner[1]) for corner in support)


def _sole(spec: RectangleSpec) -> Corners:
    return rectangle(*spec.at, *spec.size)


def _limits(base: Limits, spec: PlanLimitsSpec) -> Limits:
    return replace(base, **spec.model_dump(exclude_none=True))


def _state(spec: StateSpec) -> State:
    return State(**spec.model_dump(exclude_none=True))
