"""Slowing down as gently as contacts and margins allow, where they ask for more than the bound.

With :class:`~wbc.constraints.Limits` of bounded braking a velocity in the box need not exist: a
foot is put down while its leg moves, or the nearest points of two bodies jump. Then the QP has no
solution, and joints must brake harder. Which ones, and how much harder, is what

    minimise  sum over joints ((v_j - v_now_j) / (a_max_j dt))^2

says, subject to the rows of the QP and to the box in which joints may stop at once: Gauss's
principle of least constraint, with joints weighed by what they can do. The box is opened so far
that this velocity is inside, with a little room, and the QP is solved again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wbc.constraints.limits import Limits
from wbc.qp.problem import QP
from wbc.qp.solution import Solution
from wbc.robot import Snapshot
from wbc.validate import Array

# Part of ``a_max dt`` by which the box is opened further than it must be: solvers need some room.
ROOM = 0.1
# Least weight of an unknown, next to the slowest joint's: of the base and of slacks, too.
LIGHT = 1e-4

Box = tuple[Array, Array]


def opened(
    qp: QP, limits: Limits, snapshot: Snapshot, dt: float, solve: Callable[[QP], Solution]
) -> QP | None:
    """Return a QP that has no solution with its box opened as far as it must be.

    All the way, if there is no solution even so; None if it is open already. Takes one more QP.
    """
    lower, upper = widest = limits.stopping_box(snapshot, dt)
    nv = lower.size
    if (qp.lower[:nv] <= lower).all() and (qp.upper[:nv] >= upper).all():
        return None
    change = np.full(nv, np.inf)
    change[6:] = limits.acceleration * dt
    found = solve(_gentlest(_with_box(qp, widest), snapshot.v, change))
    if not found.solved:
        return _with_box(qp, widest)
    v, room = found.x[:nv], ROOM * change
    down = np.where(v < qp.lower[:nv], np.maximum(v - room, lower), qp.lower[:nv])
    up = np.where(v > qp.upper[:nv], np.minimum(v + room, upper), qp.upper[:nv])
    return _with_box(qp, (down, up))


def _gentlest(qp: QP, v: Array, change: Array) -> QP:
    """Return the QP of the least change from ``v``, measured in ``change`` (nv,), (nv,)."""
    weight, now = np.full(qp.g.size, LIGHT), np.zeros(qp.g.size)
    weight[: v.size] = np.maximum(np.square(change.min() / change), LIGHT)
    now[: v.size] = v
    return replace(qp, P=np.diag(weight), g=-weight * now)


def _with_box(qp: QP, box: Box) -> QP:
    """Return ``qp`` with other bounds on the velocity; slacks, behind it, keep theirs."""
    lower, upper = box
    nv = lower.size
    return replace(
        qp,
        lower=np.concatenate((lower, qp.lower[nv:])),
        upper=np.concatenate((upper, qp.upper[nv:])),
    )
