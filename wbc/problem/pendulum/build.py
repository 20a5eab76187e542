"""From a pendulum's description to what runs: a law with its start, or a planning problem."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.pendulum.build_plan import build_plan
from wbc.problem.pendulum.law_specs import (
    BoundsSpec,
    LqrSpec,
    MomentumQpSpec,
    SpinSpec,
    StabiliserSpec,
    StaticLeanSpec,
    SwingUpSpec,
)
from wbc.problem.pendulum.spec import PendulumSpec
from wbc.problem.pendulum.start import planar_start, solid_start
from wbc.problem.source import Source
from wbc.rmp.balance.foot import require_support
from wbc.rmp.balance.law import BalanceLaw, Bounds, Pendulum
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.simulate import Push, impulses_by_step, whole_steps
from wbc.rmp.balance.spin_change import SpinChange
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.balance.swing_up import SwingUp
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
    if (spec.law is None) == (spec.plan is None):
        mistakes.note((), Misplaced("give law (to simulate) or plan, and only one of them"))
        mistakes.raise_any()
    kind = PlanarRmp if spec.model == "rmp_planar" else SolidRmp
    pendulum = kind(spec.mass, spec.gravity)
    if spec.plan is not None:
        _refuse_strangers(spec, mistakes)
        return Planning(build_plan(spec.plan, pendulum, mistakes), spec.plan.iterations)
    return _balance(spec, pendulum, mistakes)


def _refuse_strangers(spec: PendulumSpec, mistakes: Mistakes) -> None:
    for key in ("start", "bounds", "pushes", "plant", "stop"):
        if key in spec.model_fields_set:
            mistakes.note((key,), Misplaced("belongs to a law; a plan has its own, under plan:"))
    mistakes.raise_any()


def _balance(spec: PendulumSpec, pendulum: Pendulum, mistakes: Mistakes) -> Balance:
    q, v = mistakes.require((), partial(_start, spec, pendulum))
    with mistakes.at("start"):
        # Refuses a leg or masses that cannot move.
        pendulum.forward_dynamics(q, v, np.zeros(len(pendulum.F)))
    bounds = mistakes.require(("bounds",), partial(_bounds, spec.bounds, pendulum))
    law = mistakes.require(("law",), partial(_law, spec, pendulum, bounds, q, v))
    stop, accept = spec.stop, spec.stop.accept
    if accept.spin is not None and not isinstance(law, SpinChange):
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
        pivot=isinstance(law, SwingUp),
        goal=_goal(law, q),
    )


def _goal(law: BalanceLaw, q: Array) -> Array:
    """Return the direction (3,) in which the law wants the leg of a pendulum that starts at q."""
    if isinstance(law, MomentumQp):
        from_foot = np.asarray(law.com) - (*q[:2], 0.0)
        return np.asarray(from_foot / np.linalg.norm(from_foot))
    if isinstance(law, StaticLean):
        return np.array((math.cos(law.angle), 0.0, math.sin(law.angle)))
    if isinstance(law, SpinChange):  # which leaves the leg where it was
        com, _ = law.model.com(q, np.zeros(len(law.model.V)))
        leg = com - (*q[: len(com) - 1], 0.0)
        leg = leg if len(leg) == 3 else np.array((leg[0], 0.0, leg[1]))
        return np.asarray(leg / np.linalg.norm(leg))
    return np.array((0.0, 0.0, 1.0))


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


def _law(spec: PendulumSpec, pendulum: Pendulum, bounds: Bounds, q: Array, v: Array) -> BalanceLaw:
    law = spec.law
    if isinstance(law, LqrSpec):
        return Lqr(pendulum, _upright(pendulum, q), law.foot, bounds, law.errors, law.efforts)
    if isinstance(law, SpinSpec):
        return SpinChange(pendulum, q, v, law.spin, law.within, bounds, law.rate)
    if isinstance(pendulum, PlanarRmp):
        if isinstance(law, StaticLeanSpec):
            return StaticLean(pendulum, law.angle, q[2], q[4], bounds, law.rate)
        if isinstance(law, SwingUpSpec):
            return SwingUp(pendulum, q[2], q[4], bounds)
        raise Misplaced(f"{law and law.type} needs a solid pendulum; model: rmp_solid", "type")
    if isinstance(law, MomentumQpSpec):
        com = (0.0, 0.0, q[4]) if law.com is None else law.com
        return MomentumQp(pendulum, bounds, com, q[9:], dt=spec.stop.dt)
    if isinstance(law, StabiliserSpec):
        return PointStabiliser(pendulum, bounds, float(q[4]), q[9:])
    raise Misplaced(f"{law and law.type} needs a planar pendulum; model: rmp_planar", "type")


def _upright(pendulum: Pendulum, q: Array) -> Array:
    """Return the configuration (nq,) at rest upright with the leg's length and radii of ``q``."""
    rest = q.copy()
    if isinstance(pendulum, SolidRmp):
        rest[2:4], rest[5:9] = (math.pi / 2, 0.0), (0.0, 0.0, 0.0, 1.0)
    else:
        rest[1], rest[3] = math.pi / 2, 0.0
    return rest
