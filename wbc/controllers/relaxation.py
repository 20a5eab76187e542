"""The relaxed QP of the torque level, for ticks whose rows cannot all hold.

At the velocity level v = 0 is always feasible; a robot with finite torques on slippery ground
cannot promise that. Dynamics, friction cones and torque bounds always have a solution (no force,
any torque), so they stay hard. Everything else is relaxed, in this order, by squared slack costs:

1. lower ends of normal forces (dropped: a contact that should be loaded may be unloaded);
2. contacts, joint limits and margins, each weighed like the heaviest task; those between bodies ten
   times as heavy as the joint rates that violate them as much. A body inside a margin may not go
   deeper; moving it out is left to later ticks, whose rows can all hold.

All levels are weighed in one QP, without priorities. What was relaxed, and by how much, is reported
by name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wbc.constraints.mechanics import Mechanics, holds_bolted
from wbc.constraints.rows import Bounds, stack, take
from wbc.controllers.plan import LevelPlan
from wbc.controllers.slack import SlackQP
from wbc.laws import stacked
from wbc.qp.problem import QP, Labels
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

# Costs of squared slack [1/(m/s)^2] of contacts, and of limits and margins, by the heaviest task
# row. A limit's slack means a joint approaching it too fast to brake, not one beyond it: at a
# hundred times a contact's cost, feet were kicked off the ground.
CONTACT, LIMIT = 1.0, 1.0
# Of margins between bodies, by the rate of the joints that move them on a lever: at the tasks' cost
# bodies were pushed up to 23 cm into each other; regardless of the lever (short in hands) up to 4.
BODY_MARGIN = 100.0
# m: shorter levers count as this; with 0.01 three of 1,000 random QPs were not solved.
LEAST_LEVER = 0.03
# Squared weight of the heaviest row if all tasks are switched off.
IDLE = 1e-6
# A velocity missed by less [m/s or rad/s] is what solvers and these costs leave.
NEGLIGIBLE = 1e-5


class Physical(NamedTuple):
    """The rows that stay hard in a relaxed QP."""

    equalities: int  # the first so many equality rows are the dynamics'; the contacts' follow
    rows: int  # the first so many inequality rows are torque bounds and friction cones
    normal_forces: slice  # of these, the ranges of normal forces, whose lower ends are dropped


def relaxed_qp(
    plan: LevelPlan, qp: QP, physical: Physical, margins: Sequence[Bounds], unit: float
) -> SlackQP:
    """Return the QP in which only physics is hard.

    ``qp``: with the costs of all levels, equalities and box of the first, and only physics' rows.
    ``margins``: rows of each constraint, with cutting planes where there are some.
    ``unit``: square of the heaviest row's weight.
    """
    n, nv = plan.decision.size, plan.decision.nv
    unit = max(unit, IDLE)
    hard = np.zeros(qp.b.size, dtype=bool)
    hard[: physical.equalities] = True
    begin = physical.equalities
    for contact, kept in zip(plan.held.contacts, plan.held.row_selections, strict=True):
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
    return SlackQP(made, weights)


def relaxed_amounts(
    plan: LevelPlan, qp: QP, physical: Physical, relaxed: SlackQP, x: Array
) -> dict[str, float]:
    """Return by how much a relaxed QP's solution violates contact rows, limits and margins."""
    begin = physical.equalities
    missed = qp.A[begin:] @ x[: qp.g.size] - qp.b[begin:]
    found = dict(zip(plan.held.labels, missed.tolist(), strict=True)) | relaxed.slack_of(x)
    return {name: by for name, by in found.items() if abs(by) > NEGLIGIBLE}


def _cost(margin: Bounds) -> float | Array:
    """Return the cost of a margin's slack, scalar or (m,), by the heaviest task row."""
    measured = margin.distances
    if measured is None or measured.found is None:
        return LIMIT
    joints = margin.matrix[:, BASE_NV:]
    levers = np.einsum("ij,ij->i", joints, joints)  # squared
    cost: Array = BODY_MARGIN / np.maximum(levers, LEAST_LEVER**2)
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
