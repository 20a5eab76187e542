"""Where each number of a plan stands among the variables of its programme."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wbc.rmp.plan.interval import STATE, controls_of
from wbc.rmp.plan.nlp import Indices
from wbc.rmp.plan.problem import PlanProblem

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
    """Places of one phase's variables.

    Attributes
    ----------
    states, controls:
        By name, (knots, size); the first states are the last of the phase before.
    inner:
        Orientation at the inner nodes (intervals, degree - 1, 3).
    duration:
        Place of the phase's duration.
    """

    states: Mapping[str, Indices]
    controls: Mapping[str, Indices]
    inner: Indices
    duration: int

    @property
    def knots(self) -> Indices:
        """Places of state and controls at each knot (knots, nz)."""
        return np.hstack(list(self.named.values()))

    @property
    def named(self) -> dict[str, Indices]:
        """Places of states and controls by name."""
        return {**self.states, **self.controls}

    @property
    def intervals(self) -> Indices:
        """Places of each interval's variables (nz, intervals), in the order of Motion.z."""
        knots, count = self.knots, len(self.inner)
        last = np.full((count, 1), self.duration)
        return np.hstack((knots[:-1], knots[1:], self.inner.reshape(count, -1), last)).T


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of all variables.

    Attributes
    ----------
    count:
        Number of variables.
    """

    phases: tuple[PhaseLayout, ...]
    count: int


def lay_out(problem: PlanProblem) -> Layout:
    """Return the places of a problem's variables, phase by phase, knot by knot."""
    counter = _Counter()
    phases: list[PhaseLayout] = []
    before: Mapping[str, Indices] | None = None
    for phase in problem.schedule:
        first = before or {name: counter.take(3) for name in STATE}
        knots = [first]
        for _ in range(phase.intervals):
            knots.append({name: counter.take(3) for name in STATE})
        states = {name: np.array([knot[name] for knot in knots]) for name in STATE}
        controls = {
            name: np.array([counter.take(size) for _ in knots])
            for name, size in controls_of(phase.flies).items()
        }
        if phase.flies:
            # What no force changes is one variable: it cannot drift.
            states["momentum"][:] = states["momentum"][0]
        if problem.plane:
            for each in (states, controls):
                for name in set(each) & set(_MIRRORED):
                    each[name][:, 2] = each[name][:, 0]
        inner = counter.take(phase.intervals * (problem.degree - 1) * 3)
        phases.append(
            PhaseLayout(
                states=states,
                controls=controls,
                inner=inner.reshape(phase.intervals, problem.degree - 1, 3),
                duration=int(counter.take(1)[0]),
            )
        )
        before = {name: states[name][-1] for name in STATE}
    return _without_gaps(Layout(tuple(phases), counter.count))


def moving(problem: PlanProblem, name: str, size: int = 3) -> list[int]:
    """Return the components of a state or control that move on their own."""
    return list(IN_PLANE[name]) if problem.plane else list(range(size))


def still(name: str, size: int) -> list[int]:
    """Return the components of a state or control that are zero in the slice y = 0."""
    if name in _MIRRORED:
        return []
    return [c for c in range(size) if c not in IN_PLANE[name]]


class _Counter:
    """Hands out places in order."""

    def __init__(self) -> None:
        self.count = 0

    def take(self, size: int) -> Indices:
        """Return the next places (size,)."""
        self.count += size
        return np.arange(self.count - size, self.count)


def _without_gaps(layout: Layout) -> Layout:
    """Return the layout numbered anew, without places that shared variables left empty."""
    used = [np.array([phase.duration]) for phase in layout.phases]
    for phase in layout.phases:
        used += [x.ravel() for x in (phase.knots, phase.inner)]
    kept = np.unique(np.concatenate(used))
    new = np.full(layout.count, -1)
    new[kept] = np.arange(len(kept))
    phases = tuple(
        PhaseLayout(
            states={name: new[x] for name, x in phase.states.items()},
            controls={name: new[x] for name, x in phase.controls.items()},
            inner=new[phase.inner],
            duration=int(new[phase.duration]),
        )
        for phase in layout.phases
    )
    return Layout(phases, len(kept))
