"""From a pendulum's description to what runs: a law with its start, or a planning problem."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.pendulum.build_plan import build_plan
from wbc.problem.pendulum.law_specs import BoundsSpec, LawChoice, LawSetting, SpinSpec
from wbc.problem.pendulum.plan_specs import PlanSpec
from wbc.problem.pendulum.spec import PendulumSpec
from wbc.problem.pendulum.start import planar_start, solid_start
from wbc.problem.source import Source
from wbc.rmp.balance.foot import require_support
from wbc.rmp.balance.law import BalanceLaw, Bounds, Pendulum
from wbc.rmp.balance.simulate import Push, impulses_by_step, whole_steps
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Balance:
    """A law, and what it is tried on.

    Attributes
    ----------
    q, v:
        Start (nq,), (nv,).
    plant:
        The pendulum that moves.
    goal:
        Direction (3,) in which the leg should point, from foot to CoM.
    """

    law: BalanceLaw
    plant: Pendulum
    bounds: Bounds
    q: Array
    v: Array
    pushes: tuple[Push, ...]
    pivot: bool
    goal: Array


@dataclass(frozen=True, eq=False)
class Planning:
    """A motion to plan, and the most iterations that may be spent on it."""

    problem: PlanProblem
    iterations: int


def build(spec: PendulumSpec, source: Source) -> Balance | Planning:
    """Return what the description means.

    Raises
    ------
    ProblemFileError
        With every mistake found, each with its line and key path.
    """
    mistakes = Mistakes(source)
    kind = PlanarRmp if spec.model == "rmp_planar" else SolidRmp
    pendulum = kind(spec.mass, spec.gravity)
    if spec.law is not None and spec.plan is None:
        return _balance(spec, spec.law, pendulum, mistakes)
    plan = mistakes.require((), partial(_only_plan, spec))
    _refuse_strangers(spec, mistakes)
    return Planning(build_plan(plan, pendulum, mistakes), plan.iterations)


def _only_plan(spec: PendulumSpec) -> PlanSpec:
    if spec.plan is None or spec.law is not None:
        raise Misplaced("give law (to simulate) or plan, and only one of them")
    return spec.plan


def _refuse_strangers(spec: PendulumSpec, mistakes: Mistakes) -> None:
    for key in ("start", "bounds", "pushes", "plant", "stop"):
        if key in spec.model_fields_set:
            mistakes.note((key,), Misplaced("belongs to a law; a plan has its own, under plan:"))
    mistakes.raise_any()


def _balance(
    spec: PendulumSpec, kind: LawChoice, pendulum: Pendulum, mistakes: Mistakes
) -> Balance:
    q, v = mistakes.require((), partial(_start, spec, pendulum))
    with mistakes.at("start"):
        # Refuses a leg or masses that cannot move.
        pendulum.forward_dynamics(q, v, np.zeros(len(pendulum.F)))
    bounds = mistakes.require(("bounds",), partial(_bounds, spec.bounds, pendulum))
    stop, accept = spec.stop, spec.stop.accept
    setting = LawSetting(pendulum, bounds, q, v, stop.dt)
    law = mistakes.require(("law",), partial(_law, kind, spec.model, setting))
    if accept.spin is not None and not isinstance(kind, SpinSpec):
        mistakes.note(("stop", "accept", "spin"), Misplaced("only a law of type spin has this"))
    steps = mistakes.require(("stop",), partial(whole_steps, stop.duration, stop.dt))
    pushes = list[Push]()
    for k, push in enumerate(spec.pushes):
        with mistakes.at("pushes", k):
            pushes.append(Push(push.time, push.impulse))
            impulses_by_step(pushes[-1:], pendulum, stop.dt, steps)
    mistakes.raise_any()
    return Balance(
        law=law,
        plant=type(pendulum)(spec.mass * spec.plant.mass, spec.gravity),
        bounds=bounds,
        q=q,
        v=v,
        pushes=tuple(pushes),
        pivot=kind.pivot,
        goal=kind.goal(setting),
    )


def _start(spec: PendulumSpec, pendulum: Pendulum) -> tuple[Array, Array]:
    if spec.start is None:
        raise Misplaced("a law needs a start, such as start: {leg_length: 0.7, radii: 0.2}")
    if isinstance(pendulum, PlanarRmp):
        return planar_start(spec.start, pendulum)
    return solid_start(spec.start, pendulum)


def _bounds(spec: BoundsSpec, pendulum: Pendulum) -> Bounds:
    bounds = Bounds(**spec.model_dump(exclude_none=True))
    require_support(pendulum, bounds)
    return bounds


def _law(kind: LawChoice, model: str, setting: LawSetting) -> BalanceLaw:
    if kind.needs not in (None, model):
        word = "solid" if kind.needs == "rmp_solid" else "planar"
        raise Misplaced(f"{kind.type} needs a {word} pendulum; model: {kind.needs}", "type")
    return kind.build(setting)
