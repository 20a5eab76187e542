"""Linear constraints across a plan: CoP inside its support, continuity, goal, period."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from wbc.rmp.plan.interval import STATE
from wbc.rmp.plan.layout import Layout, moving
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.plan.schedule import half_planes, overlap
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class LinearRows:
    """lower <= matrix w <= upper, w scaled, each row with its name."""

    matrix: sparse.csr_array
    lower: Array
    upper: Array
    labels: tuple[str, ...]


@dataclass(eq=False)
class _Rows:
    """Rows while they are gathered; coefficients and bounds are in scaled units."""

    entries: list[tuple[int, int, float]] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)

    def add(self, label: str, terms: dict[int, float], lower: float, upper: float) -> None:
        """Add one row: the places of its variables with their coefficients, and its bounds."""
        self.entries += [(len(self.labels), place, a) for place, a in terms.items()]
        self.lower.append(lower)
        self.upper.append(upper)
        self.labels.append(label)


def linear_rows(problem: PlanProblem, layout: Layout, units: dict[str, float]) -> LinearRows:
    """Return all linear rows of a plan."""
    rows = _Rows()
    _supports(rows, problem, layout, units)
    _continuity(rows, problem, layout)
    _waypoints(rows, problem, layout, units)
    _period(rows, problem, layout, units)
    row, column, data = zip(*rows.entries, strict=True) if rows.entries else ((), (), ())
    shape = (len(rows.labels), layout.count)
    return LinearRows(
        matrix=sparse.csr_array((np.array(data, dtype=float), (row, column)), shape=shape),
        lower=np.array(rows.lower),
        upper=np.array(rows.upper),
        labels=tuple(rows.labels),
    )


def _supports(rows: _Rows, problem: PlanProblem, layout: Layout, units: dict[str, float]) -> None:
    unit = units["cop"]
    for phase, places in zip(problem.schedule, layout.phases, strict=True):
        if phase.support is None:
            continue
        for a, low, high in zip(*half_planes(phase.support), strict=True):
            if problem.plane and abs(a[0]) < np.finfo(float).eps:
                continue  # a side along the slice bounds nothing in it
            for x, y in places.controls["cop"]:
                terms = {int(x): a[0]} if problem.plane else {int(x): a[0], int(y): a[1]}
                rows.add(f"{phase.name}: cop", terms, low / unit, high / unit)


def _continuity(rows: _Rows, problem: PlanProblem, layout: Layout) -> None:
    """Make the force continuous from stance to stance; and the CoP, unless feet must jump."""
    schedule = problem.schedule
    for k in range(1, len(schedule)):
        before, after = schedule[k - 1], schedule[k]
        if before.support is None or after.support is None:
            continue
        kept = ["force"]
        if overlap(before.support, after.support):
            kept += ["cop", "moment"]
        for name in kept:
            left, right = (layout.phases[j].controls[name] for j in (k - 1, k))
            for c in moving(problem, name, left.shape[1]):
                if name == "moment" and problem.limits_of(k).torsion == 0.0:
                    continue
                terms = {int(right[0, c]): 1.0, int(left[-1, c]): -1.0}
                rows.add(f"{after.name}: {name} at its start", terms, 0.0, 0.0)


def _waypoints(rows: _Rows, problem: PlanProblem, layout: Layout, units: dict[str, float]) -> None:
    for where, k, state in problem.waypoints:
        last = layout.phases[k].states
        for name, values in state.values(problem.mass).items():
            for c in moving(problem, name):
                value = values[c]
                if value is not None:
                    aim = value / units[name]
                    rows.add(f"{where}: {name}", {int(last[name][-1, c]): 1.0}, aim, aim)


def _period(rows: _Rows, problem: PlanProblem, layout: Layout, units: dict[str, float]) -> None:
    if problem.periodic is None:
        return
    stride = (*problem.periodic, 0.0)
    first, last = layout.phases[0], layout.phases[-1]
    pairs = {name: (first.states[name][0], last.states[name][-1]) for name in STATE}
    for name in carried_on(problem):
        pairs[name] = (first.controls[name][0], last.controls[name][-1])
    for name, (start, end) in pairs.items():
        for c in moving(problem, name, len(start)):
            if start[c] == end[c]:
                continue
            shift = stride[c] / units[name] if name in ("com", "cop") else 0.0
            rows.add(f"period: {name}", {int(end[c]): 1.0, int(start[c]): -1.0}, shift, shift)


def carried_on(problem: PlanProblem) -> tuple[str, ...]:
    """Return the controls that go on from the end of a period to the next one's start."""
    begin, end = problem.schedule[0].support, problem.schedule[-1].support
    if problem.periodic is None or begin is None or end is None:
        return ()
    dx, dy = problem.periodic
    if not overlap(begin, tuple((x - dx, y - dy) for x, y in end)):
        return ("force",)
    twisted = min(problem.limits_of(k).torsion for k in (0, len(problem.schedule) - 1)) > 0.0
    return ("force", "cop", "moment") if twisted else ("force", "cop")
