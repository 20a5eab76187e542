"""From a planning problem to a nonlinear programme, with the name of every row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.rmp.plan import rows as constraint
from wbc.rmp.plan.interval import CONTROLS, STATE, motion
from wbc.rmp.plan.layout import Layout, lay_out, moving, still
from wbc.rmp.plan.linear import linear_rows
from wbc.rmp.plan.nlp import Block, Indices, Nlp, Piece, assemble, piece
from wbc.rmp.plan.problem import PlanProblem
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Transcription:
    """A planning problem as a programme in scaled variables.

    Attributes
    ----------
    scale:
        One scaled unit of each variable (n,), SI.
    lower, upper:
        Bounds on variables (n,), and
    row_lower, row_upper:
        on rows (m,).
    labels:
        Of rows: "phase: quantity".
    soft:
        Rows that a search for contradictions may break.
    """

    problem: PlanProblem
    layout: Layout
    nlp: Nlp
    scale: Array
    lower: Array
    upper: Array
    row_lower: Array
    row_upper: Array
    labels: tuple[str, ...]
    soft: Indices


def units_of(problem: PlanProblem) -> dict[str, float]:
    """Return one scaled unit of each kind of variable, SI."""
    longest = [problem.limits_of(k).leg_length[1] for k in range(len(problem.schedule))]
    length = min(longest)
    return constraint.scales(problem.mass, problem.gravity, length if np.isfinite(length) else 1.0)


def scale_of(problem: PlanProblem, layout: Layout) -> Array:
    """Return one scaled unit of each variable (n,), SI."""
    units, scale = units_of(problem), np.ones(layout.count)
    for places in layout.phases:
        scale[places.duration] = units["time"]
        for name, where in places.named.items():
            scale[where] = units[name]
    return scale


def transcribe(problem: PlanProblem) -> Transcription:
    """Return the programme of a problem.

    Raises
    ------
    InvalidInputError
        Limits of neighbouring phases exclude each other where they meet.
    """
    units, layout = units_of(problem), lay_out(problem)
    pieces: dict[tuple[object, ...], tuple[Piece, list[constraint.Row]]] = {}
    blocks, found = [], []
    for k, phase in enumerate(problem.schedule):
        limits, places = problem.limits_of(k), layout.phases[k]
        key: tuple[object, ...] = (phase.flies, phase.intervals, limits)
        if key not in pieces:
            pieces[key] = _interval_piece(problem, k, units)
        made, rows = pieces[key]
        blocks.append(Block(made, places.intervals))
        found.append(_listed(phase.name, rows, phase.intervals))
        if not phase.flies:
            key = (phase.flies, limits)
            if key not in pieces:
                pieces[key] = _knot_piece(problem, k, units)
            made, rows = pieces[key]
            blocks.append(Block(made, places.knots.T))
            found.append(_listed(phase.name, rows, phase.intervals + 1))
    extra = linear_rows(problem, layout, units)
    nlp = assemble(layout.count, blocks, extra.matrix)
    scale = scale_of(problem, layout)
    lower, upper = _boxes(problem, layout)
    soft = [*(flag for part in found for flag in part[3]), *[True] * len(extra.labels)]
    return Transcription(
        problem=problem,
        layout=layout,
        nlp=nlp,
        scale=scale,
        lower=lower / scale,
        upper=upper / scale,
        row_lower=np.concatenate([*(part[1] for part in found), extra.lower]),
        row_upper=np.concatenate([*(part[2] for part in found), extra.upper]),
        labels=(*(label for part in found for label in part[0]), *extra.labels),
        soft=np.flatnonzero(soft),
    )


def _interval_piece(
    problem: PlanProblem, k: int, units: dict[str, float]
) -> tuple[Piece, list[constraint.Row]]:
    phase, limits = problem.schedule[k], problem.limits_of(k)
    m = motion(
        units,
        (problem.mass, problem.gravity, problem.reference),
        problem.degree,
        phase.flies,
        phase.intervals,
    )
    kept = {name: moving(problem, name) for name in STATE}
    if phase.flies:
        kept["momentum"] = []
    rows = constraint.dynamics(m, units, kept) + constraint.between_knots(m, units, limits)
    cost = constraint.running_cost(m, problem.weights, _nominal(problem), problem.mass)
    return piece("interval", m.z, cost, ca.vertcat(*(row.value for row in rows))), rows


def _knot_piece(
    problem: PlanProblem, k: int, units: dict[str, float]
) -> tuple[Piece, list[constraint.Row]]:
    constants = (problem.mass, problem.gravity, problem.reference)
    m = motion(units, constants, problem.degree, False, 1)
    rows = constraint.at_stance_knot(m, units, problem.limits_of(k))
    z = m.z[: 3 * len(STATE) + sum(CONTROLS.values())]
    return piece("knot", z, ca.SX(0), ca.vertcat(*(row.value for row in rows))), rows


def _nominal(problem: PlanProblem) -> dict[str, Array]:
    given = problem.nominal.values(problem.mass)
    return {
        name: np.array([np.nan if x is None else x for x in values])
        for name, values in given.items()
    }


def _listed(
    phase: str, rows: Sequence[constraint.Row], copies: int
) -> tuple[list[str], Array, Array, list[bool]]:
    """Return labels, bounds and softness of all copies of rows, in the programme's order."""
    labels, lower, upper, soft = [], [], [], []
    for row in rows:
        size = row.value.numel()
        labels += [f"{phase}: {row.quantity}"] * size
        lower += [row.lower] * size
        upper += [row.upper] * size
        soft += [not row.hard] * size
    return labels * copies, np.tile(lower, copies), np.tile(upper, copies), soft * copies


def _boxes(problem: PlanProblem, layout: Layout) -> tuple[Array, Array]:
    """Return the bounds on variables, SI."""
    lower, upper = np.full(layout.count, -np.inf), np.full(layout.count, np.inf)
    for k, (phase, places) in enumerate(zip(problem.schedule, layout.phases, strict=True)):
        box = constraint.boxes(problem.limits_of(k))
        lower[places.duration], upper[places.duration] = phase.durations
        for name, where in places.named.items():
            low, high = box[name]
            lower[where] = np.maximum(lower[where], low)
            upper[where] = np.minimum(upper[where], high)
            if problem.plane:
                fixed = still(name, len(low))
                lower[where[:, fixed]] = upper[where[:, fixed]] = 0.0
        inner = places.inner
        lower[inner], upper[inner] = -constraint.TURN, constraint.TURN
        if problem.plane:
            lower[inner[:, :, (0, 2)]] = upper[inner[:, :, (0, 2)]] = 0.0
        crossed = lower[places.knots] > upper[places.knots]
        if crossed.any():
            raise InvalidInputError(
                f"plan: where phase {phase.name!r} begins or ends, its limits and those of its"
                " neighbour exclude each other (height, radius, rate or momentum)"
            )
    for name, values in problem.start.values(problem.mass).items():
        for place, value in zip(layout.phases[0].states[name][0], values, strict=True):
            if value is not None:
                lower[place] = upper[place] = value
    return lower, upper
