"""The variables of a plan's programme: the index and the unit of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.rmp.plan.motion import controls_of
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.plan.schedule import STATE
from wbc.validate import Array

Indices = NDArray[np.int64]
# Components that move in the slice y = 0; the others stay zero there, or follow (r_3 is r_1).
IN_PLANE: Mapping[str, tuple[int, ...]] = {
    "com": (0, 2),
    "com_velocity": (0, 2),
    "orientation": (1,),
    "momentum": (1,),
    "radii": (0, 1),
    "radii_rates": (0, 1),
    "radii_accelerations": (0, 1),
    "force": (0, 2),
    "cop": (0,),
    "moment": (),
}
_MIRRORED = ("radii", "radii_rates", "radii_accelerations")


@dataclass(frozen=True, eq=False)
class PhaseLayout:
    """Indices of one phase's variables; its first state is the last one of the phase before."""

    named: Mapping[str, Indices]  # of states, then controls, by name (knots, size)
    inner: Indices  # of the orientation at the inner nodes (intervals, degree - 1, 3)
    duration: int

    @property
    def knots(self) -> Indices:
        """Indices of state and controls at each knot (knots, nz)."""
        return np.hstack(list(self.named.values()))

    @property
    def intervals(self) -> Indices:
        """Indices of each interval's variables (nz, intervals), in the order of Motion.z."""
        knots, count = self.knots, len(self.inner)
        last = np.full((count, 1), self.duration)
        return np.hstack((knots[:-1], knots[1:], self.inner.reshape(count, -1), last)).T


@dataclass(frozen=True, eq=False)
class PlanLayout:
    """Indices of all ``count`` variables, by phase."""

    phases: tuple[PhaseLayout, ...]
    count: int


def lay_out(problem: PlanProblem) -> PlanLayout:
    """Return the indices of a problem's variables, phase by phase, knot by knot."""
    count = 0

    def new(*shape: int) -> Indices:
        nonlocal count
        count += math.prod(shape)
        return np.arange(count - math.prod(shape), count).reshape(shape)

    phases = []
    last = new(1, 3 * len(STATE))
    for phase in problem.schedule:
        states = np.vstack((last, new(phase.intervals, last.size)))
        named = dict(zip(STATE, np.split(states, len(STATE), axis=1), strict=True))
        for name, size in controls_of(phase.flies).items():
            named[name] = new(phase.intervals + 1, size)
        if phase.flies:
            # A quantity that no force changes is one variable, so that it cannot drift.
            named["momentum"][:] = named["momentum"][0]
        if problem.plane:
            for name in set(named) & set(_MIRRORED):
                named[name][:, 2] = named[name][:, 0]
        inner = new(phase.intervals, problem.degree - 1, 3)
        phases.append(PhaseLayout(named, inner, int(new(1)[0])))
        last = states[-1:]
    # Renumbered without the gaps that shared variables left.
    used = np.unique(
        np.hstack([x for p in phases for x in (p.knots.ravel(), p.inner.ravel(), p.duration)])
    )
    numbered = tuple(
        PhaseLayout(
            named={name: np.searchsorted(used, x) for name, x in phase.named.items()},
            inner=np.searchsorted(used, phase.inner),
            duration=int(np.searchsorted(used, phase.duration)),
        )
        for phase in phases
    )
    return PlanLayout(numbered, len(used))


def moving(problem: PlanProblem, name: str, size: int = 3) -> list[int]:
    """Return the components of a state or control that move on their own."""
    return list(IN_PLANE[name]) if problem.plane else list(range(size))


def fixed_in_plane(name: str, size: int) -> list[int]:
    """Return the components of a state or control that are zero in the slice y = 0."""
    return [] if name in _MIRRORED else [c for c in range(size) if c not in IN_PLANE[name]]


def units_of(problem: PlanProblem) -> dict[str, float]:
    """Return one scaled unit of each kind of variable, SI, for a leg of typical length.

    That is the least of the phases' greatest lengths, or 1 m if none is given. ``time`` is the unit
    of phases' durations.
    """
    mass, gravity = problem.mass, problem.gravity
    length = min(problem.limits_of(k).leg_length[1] for k in range(len(problem.schedule)))
    length = length if math.isfinite(length) else 1.0
    speed, time = math.sqrt(gravity * length), math.sqrt(length / gravity)
    return {
        "com": length,
        "com_velocity": speed,
        "orientation": 1.0,
        "momentum": 0.1 * mass * length * speed,
        "radii": 0.3 * length,
        "radii_rates": 0.3 * speed,
        "radii_accelerations": 0.3 * gravity,
        "force": mass * gravity,
        "cop": 0.3 * length,
        "moment": 0.03 * mass * gravity * length,
        "time": time,
    }


def scale_of(problem: PlanProblem, layout: PlanLayout) -> Array:
    """Return one scaled unit of each variable (n,), SI."""
    units, scale = units_of(problem), np.ones(layout.count)
    for places in layout.phases:
        scale[places.duration] = units["time"]
        for name, where in places.named.items():
            scale[where] = units[name]
    return scale
