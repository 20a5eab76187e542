"""Transcription of a planning problem to a nonlinear programme with named rows; first guess.

The guess is a straight line from start to goal, with parabolas in flight.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.rmp.plan import rows as constraint
from wbc.rmp.plan.layout import (
    Indices,
    PlanLayout,
    fixed_in_plane,
    lay_out,
    moving,
    scale_of,
    units_of,
)
from wbc.rmp.plan.motion import CONTROLS, motion
from wbc.rmp.plan.nlp import Block, Piece, PlanNlp, assemble, piece
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.plan.schedule import STATE
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Transcription:
    """A planning problem as a programme in scaled variables."""

    problem: PlanProblem
    layout: PlanLayout
    nlp: PlanNlp
    scale: Array  # one scaled unit of each variable (n,), SI
    lower: Array  # bounds on variables (n,)
    upper: Array
    row_lower: Array  # bounds on rows (m,)
    row_upper: Array
    labels: tuple[str, ...]  # of rows: "phase: quantity"
    soft: Indices  # rows that a search for conflicts may relax


def transcribe(problem: PlanProblem) -> Transcription:
    """Return the programme of a problem.

    Raises InvalidInputError: limits of neighbouring phases exclude each other where they meet.
    """
    units, layout = units_of(problem), lay_out(problem)
    # Phases with equal values of these share their pieces.
    pieces: dict[tuple[object, ...], tuple[Piece, list[constraint.PlanRow]]] = {}
    blocks, listed = list[Block](), list[tuple[str, constraint.PlanRow]]()
    for k, (phase, places) in enumerate(zip(problem.schedule, layout.phases, strict=True)):
        alike: tuple[object, ...] = (phase.flies, phase.intervals, problem.limits_of(k))
        parts = [(_interval_piece, alike, places.intervals)]
        if not phase.flies:
            parts.append((_knot_piece, alike[2:], places.knots.T))
        for make, key, where in parts:
            if (make, *key) not in pieces:
                pieces[make, *key] = make(problem, k, units)
            made, rows = pieces[make, *key]
            blocks.append(Block(made, where))
            each = [row for row in rows for _ in range(row.value.numel())]
            listed += [(f"{phase.name}: {row.quantity}", row) for row in each] * where.shape[1]
    linear = constraint.linear_rows(problem, layout, units)
    scale = scale_of(problem, layout)
    lower, upper = _bounds(problem, layout)
    return Transcription(
        problem=problem,
        layout=layout,
        nlp=assemble(layout.count, blocks, constraint.matrix_of(linear, layout.count)),
        scale=scale,
        lower=lower / scale,
        upper=upper / scale,
        row_lower=np.array([row.lower for _, row in listed] + [row.lower for row in linear]),
        row_upper=np.array([row.upper for _, row in listed] + [row.upper for row in linear]),
        labels=(*(label for label, _ in listed), *(row.label for row in linear)),
        soft=np.flatnonzero([not row.hard for _, row in listed] + [True] * len(linear)),
    )


def _interval_piece(
    problem: PlanProblem, k: int, units: dict[str, float]
) -> tuple[Piece, list[constraint.PlanRow]]:
    """Return dynamics, cost and limits between knots of an interval of phase k."""
    phase, limits = problem.schedule[k], problem.limits_of(k)
    m = motion(problem, units, phase.flies, phase.intervals)
    kept = {name: moving(problem, name) for name in STATE}
    if phase.flies:
        kept["momentum"] = []
    rows = constraint.dynamics(m, units, kept) + constraint.between_knots(m, units, limits)
    nominal = problem.nominal.values(problem.mass)
    cost = constraint.running_cost(m, problem.weights, nominal, problem.mass)
    return piece("interval", m.z, cost, ca.vertcat(*(row.value for row in rows))), rows


def _knot_piece(
    problem: PlanProblem, k: int, units: dict[str, float]
) -> tuple[Piece, list[constraint.PlanRow]]:
    """Return limits at a knot of the stance k."""
    m = motion(problem, units, flies=False)
    rows = constraint.at_stance_knot(m, units, problem.limits_of(k))
    z = m.z[: 3 * len(STATE) + sum(CONTROLS.values())]
    return piece("knot", z, ca.SX(0), ca.vertcat(*(row.value for row in rows))), rows


def _bounds(problem: PlanProblem, layout: PlanLayout) -> tuple[Array, Array]:
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
                fixed = where[:, fixed_in_plane(name, len(low))]
                lower[fixed] = upper[fixed] = 0.0
        lower[places.inner], upper[places.inner] = -constraint.TURN, constraint.TURN
        if problem.plane:
            fixed = places.inner[:, :, fixed_in_plane("orientation", 3)]
            lower[fixed] = upper[fixed] = 0.0
        if (lower[places.knots] > upper[places.knots]).any():
            raise InvalidInputError(
                f"plan: where phase {phase.name!r} begins or ends, its limits and those of its"
                " neighbour exclude each other (height, radius, rate or momentum)"
            )
    for name, values in problem.start.values(problem.mass).items():
        given = np.isfinite(values)
        places = layout.phases[0].named[name][0][given]
        lower[places] = upper[places] = values[given]
    return lower, upper


# ------------------------------------------------------------------ first guess


def first_guess(t: Transcription) -> Array:
    """Return scaled variables (n,): free components are taken from nominal, goal or start."""
    problem, layout = t.problem, t.layout
    first, last = _guessed_ends(problem)
    middle = [sum(phase.durations) / 2.0 for phase in problem.schedule]
    whole = sum(middle)
    standing = sum(T for T, phase in zip(middle, problem.schedule, strict=True) if not phase.flies)
    w, begun = np.zeros(layout.count), 0.0
    for phase, places, T in zip(problem.schedule, layout.phases, middle, strict=True):
        w[places.duration] = T
        local = np.linspace(0.0, T, phase.intervals + 1)
        part = ((begun + local) / whole)[:, None]
        named = places.named
        for name in STATE:
            w[named[name]] = first[name] + part * (last[name] - first[name])
        w[named["com_velocity"]] = (last["com"] - first["com"]) / whole
        if phase.support is None:
            # On a parabola over the straight line.
            w[named["com"][:, 2]] += problem.gravity / 2.0 * local * (T - local)
            w[named["com_velocity"][:, 2]] += problem.gravity * (T / 2.0 - local)
        else:
            w[named["cop"]] = np.mean(phase.support, axis=0)
            w[named["force"][:, 2]] = problem.mass * problem.gravity * whole / standing
        sigma = w[named["orientation"]]
        w[places.inner] = (sigma[:-1, None] + sigma[1:, None]) / 2.0
        begun += T
    return np.clip(w / t.scale, t.lower, t.upper)


def _guessed_ends(problem: PlanProblem) -> tuple[dict[str, Array], dict[str, Array]]:
    start, goal, nominal = (
        state.values(problem.mass) for state in (problem.start, problem.goal, problem.nominal)
    )
    low, high = problem.limits_of(0).leg_length
    height = (low + high) / 2.0 if np.isfinite(high) else 1.0
    r = np.clip(0.3 * height, *problem.limits_of(0).radius)
    default: dict[str, Array] = {name: np.zeros(3) for name in STATE}
    default |= {"com": np.array((0.0, 0.0, height)), "radii": np.full(3, r)}
    supports = [np.mean(p.support, axis=0) for p in problem.schedule if p.support is not None]
    free = np.full(3, np.nan)

    def filled(name: str, *sources: dict[str, Array]) -> Array:
        """Return the first value given for each component, else the default."""
        value = free
        for source in (*sources, default):
            value = np.where(np.isnan(value), source.get(name, free), value)
        return value

    first = {name: filled(name, start, nominal, goal) for name in STATE}
    last = {name: filled(name, goal, nominal, start) for name in STATE}
    for c in (0, 1):
        if supports and np.isnan(start.get("com", free)[c]):
            first["com"][c] = supports[0][c]
        if problem.periodic is not None:
            last["com"][c] = first["com"][c] + problem.periodic[c]
        elif supports and np.isnan(goal.get("com", free)[c]):
            last["com"][c] = supports[-1][c]
    return first, last
