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

from collections.abc import Iterator, Sequence

import numpy as np

from wbc.constraints.mechanics import BoltedBase, Gear
from wbc.constraints.rows import Bounds, stack, take
from wbc.controllers.plan import IDLE, Physics, Plan, assemble
from wbc.controllers.slack import GivingQP
from wbc.laws import Rows
from wbc.qp.problem import Labels
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
# A velocity missed by less [m/s or rad/s] is what solvers and these costs leave.
NEGLIGIBLE = 1e-5


def relaxed_qp(
    plan: Plan,
    rows: Sequence[Rows],
    contacts: Sequence[Rows],
    box: tuple[Array, Array],
    margins: Sequence[Bounds],
    physics: Physics,
) -> GivingQP:
    """Return the QP in which only physics is hard.

    Parameters
    ----------
    rows:
        Of all tasks and soft contacts.
    contacts:
        Of those that are met exactly while the tick can.
    box:
        Bounds (nv,), (nv,) on the velocity.
    margins:
        Rows of each constraint, with cutting planes where there are some.
    physics:
        What stays hard, but for its slack.
    """
    hard, decision, n = physics.bounds, plan.decision, plan.decision.size
    heaviest = max(float(np.square(row.weight).max(initial=0.0)) for row in rows)
    unit = max(heaviest, IDLE)
    costs, held = list(rows), list(physics.equalities)
    for contact, row in zip(plan.held.contacts, contacts, strict=True):
        if isinstance(contact, Gear | BoltedBase):
            held.append(row)
        else:
            costs.append(row._replace(weight=np.sqrt(CONTACT * unit) * np.ones(len(row.target))))
    parts = [] if hard is None else [hard]
    parts += [_soft(part, _cost(part) * unit) for part in margins if part.lower.size]
    limits = _as_rows(box, decision.names, n)
    if limits is not None:
        parts.append(_soft(limits, LIMIT * unit))
    free = np.full(decision.nv, np.inf)
    physical = sum(len(row.target) for row in held)
    labels = Labels(plan.labels[0].equality[:physical], (), decision.names)
    bounds, weights = stack(parts) if parts else None, None
    if bounds is not None:
        bounds, weights = bounds._replace(slack=None), bounds.slack
    qp = assemble(decision, costs, held, (-free, free), bounds, labels, physics.rest)
    return GivingQP(qp, weights)


def given_way(
    plan: Plan, contacts: Sequence[Rows], relaxed: GivingQP, x: Array
) -> dict[str, float]:
    """Return what a relaxed QP's solution misses, by the name of contact row, limit or margin."""
    missed = dict(_contacts_missed(plan, contacts, x)) | relaxed.given(x)
    return {name: by for name, by in missed.items() if abs(by) > NEGLIGIBLE}


def _contacts_missed(plan: Plan, contacts: Sequence[Rows], x: Array) -> Iterator[tuple[str, float]]:
    labels = iter(plan.held.labels)
    for row in contacts:
        values = row.matrix @ x[: row.matrix.shape[1]] - row.target
        yield from ((name, value) for value, name in zip(values.tolist(), labels, strict=False))


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
