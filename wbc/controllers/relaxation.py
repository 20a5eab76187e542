"""What gives way at the torque level when a tick cannot have everything.

At the velocity level rest is always allowed; a robot with finite torques on slippery ground cannot
promise that. Dynamics, friction cones and torque bounds always have a solution (no force, any
torque): they are physics, and stay hard. Everything else gives way, in this order, by squared slack
costs:

1. ranges of normal force (dropped: a foot that must be loaded may not be);
2. contacts, joint limits and margins, each weighed like the heaviest task, those between bodies ten
   times as heavy as the joint rates that miss them by as much. What is inside a margin already may
   not go further; that it is moved back waits for a tick that keeps the rest.

All levels are weighed in one QP: a tick that fights for its limits has no time for priorities. What
gave way, and by how much, is reported by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wbc.constraints.mechanics import Mechanics, holds_bolted
from wbc.constraints.rows import Bounds, stack, take
from wbc.controllers.plan import LevelPlan
from wbc.controllers.slack import GivingQP
from wbc.laws import stacked
from wbc.qp.problem import QP, Labels
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

# Squared cost of a contact's, and of a limit's or margin's velocity missed [1/(m/s)^2], by the
# heaviest row of the tasks. Slack of a limit is a joint that approaches it faster than it can
# brake, not one beyond it: at a hundred times a contact's cost it kicked feet off the ground.
CONTACT, LIMIT = 1.0, 1.0
# Of bodies that come too near, by the rate of joints that carry them on a lever: as cheap as tasks,
# these pushed them up to 23 cm into each other; with no regard to levers, short in hands, up to 4.
BODIES = 100.0
# m: levers count as no shorter; with 0.01 three of 1,000 wild QPs were beyond the solver.
SHORTEST = 0.03
# Squared weight assumed for the heaviest row, for when all tasks are switched off.
IDLE = 1e-6
# A velocity missed by less [m/s or rad/s] is what solvers and these costs leave.
NEGLIGIBLE = 1e-5


class Physical(NamedTuple):
    """What stays hard in a relaxed QP."""

    # How many of the QP's equality rows, the first, are the dynamics'; the contacts' follow.
    equalities: int
    rows: int  # how many of its inequality rows, the first, are torque bounds and friction cones
    # Which of these are the ranges of normal forces, whose lower ends are dropped.
    normal_forces: slice


def relaxed_qp(
    plan: LevelPlan, qp: QP, physical: Physical, margins: Sequence[Bounds], unit: float
) -> GivingQP:
    """Return the QP in which only physics is hard.

    Parameters
    ----------
    qp:
        With the costs of all levels, equalities and box of the first, and only physics' rows.
    margins:
        Rows of each constraint, with cutting planes where there are some.
    unit:
        Square of the heaviest row's weight.
    """
    n, nv = plan.decision.size, plan.decision.nv
    unit = max(unit, IDLE)
    hard = np.zeros(qp.b.size, dtype=bool)
    hard[: physical.equalities] = True
    begin = physical.equalities
    for contact, kept in zip(plan.held.contacts, plan.held.kept, strict=True):
        end = begin + (len(contact.rows) if kept is None else kept.size)
        hard[begin:end] = isinstance(contact, Mechanics) or holds_bolted(contact)
        begin = end
    A, b = qp.A[~hard], qp.b[~hard]
    P, g = qp.P + (CONTACT * unit) * A.T @ A, qp.g - (CONTACT * unit) * b @ A
    lower = qp.l[: physical.rows].copy()
    lower[physical.normal_forces] = -np.inf
    names, count = qp.labels.inequality[: physical.rows], physical.rows
    parts = [Bounds(names, qp.C[:count], lower, qp.u[:count])] if count else []
    parts += [_soft(part, _cost(part) * unit) for part in margins if part.lower.size]
    limits = _as_rows((qp.lower[:nv], qp.upper[:nv]), plan.decision.names, n)
    if limits is not None:
        parts.append(_soft(limits, LIMIT * unit))
    free = np.full(nv, np.inf)
    low, high = np.concatenate((-free, qp.lower[nv:])), np.concatenate((free, qp.upper[nv:]))
    labels = tuple(name for name, one in zip(qp.labels.equality, hard, strict=True) if one)
    if not parts:
        none = np.zeros(0)
        rows, weights = Bounds((), np.zeros((0, n)), none, none), None
    else:
        rows = stack(parts)
        weights = np.full(rows.lower.size, np.inf) if rows.slack is None else rows.slack
    C = stacked([rows.matrix], n)
    made = QP(
        P, g, qp.A[hard], qp.b[hard], C, rows.lower, rows.upper, low, high,
        Labels(labels, rows.labels, plan.decision.names),
    )  # fmt: skip
    return GivingQP(made, weights)


def given_way(
    plan: LevelPlan, qp: QP, physical: Physical, relaxed: GivingQP, x: Array
) -> dict[str, float]:
    """Return what a relaxed QP's solution misses, by the name of contact row, limit or margin."""
    begin = physical.equalities
    missed = qp.A[begin:] @ x[: qp.g.size] - qp.b[begin:]
    found = dict(zip(plan.held.labels, missed.tolist(), strict=True)) | relaxed.given(x)
    return {name: by for name, by in found.items() if abs(by) > NEGLIGIBLE}


def _cost(margin: Bounds) -> float | Array:
    """Return the cost of a margin's slack, by the heaviest row of the tasks: one, or (m,)."""
    measured = margin.distances
    if measured is None or measured.found is None:
        return LIMIT
    joints = margin.matrix[:, BASE_NV:]
    levers = np.einsum("ij,ij->i", joints, joints)  # squared
    cost: Array = BODIES / np.maximum(levers, SHORTEST**2)
    return cost


def _soft(bounds: Bounds, weight: float | Array) -> Bounds:
    own = np.broadcast_to(weight, bounds.lower.shape)
    return bounds._replace(slack=own if bounds.slack is None else np.minimum(own, bounds.slack))


def _as_rows(box: tuple[Array, Array], names: Sequence[str], n: int) -> Bounds | None:
    """Return the finite bounds of a box on v+ as rows (m, n)."""
    lower, upper = box
    finite = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    if not finite.size:
        return None
    matrix = np.zeros((finite.size, n))
    matrix[np.arange(finite.size), finite] = 1.0
    return Bounds(take(names, finite), matrix, lower[finite], upper[finite])
