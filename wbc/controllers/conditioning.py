"""Rank and condition of a tick's cost: how well its tasks determine the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, null_space

from wbc.qp.problem import QP
from wbc.validate import Array

# Only directions whose curvature exceeds the damping this many times count as determined.
DETERMINED = 10.0


class Conditioning(NamedTuple):
    """How well the tasks determine the motion in the null space of the contacts.

    For single tasks see :attr:`wbc.controllers.tick.Tick.singular`.

    Attributes
    ----------
    free:
        Dimension of the contacts' null space (at the torque level without what no contact forces
        can bring about); with several priorities the tick has the QP of the last level, and it is
        the null space of contacts and the levels above.
    rank:
        Number of these directions that the tasks determine; the damping decides the others. If it
        is less than the tasks' rows, tasks are singular or linearly dependent. Directions that
        tasks damp themselves (``lm_damping``, and points that are not yet at their targets) count
        as determined.
    condition:
        Largest over least curvature of the cost along the directions determined; 1 if none is.
        Directions are scaled by the joints' weights, like the damping.
    """

    free: int
    rank: int
    condition: float


def conditioning(qp: QP, damping: float, weights: Array) -> Conditioning:
    """Return how well conditioned a QP's cost is; takes a millisecond.

    Parameters
    ----------
    damping, weights:
        The controller's damping and joint weights (nv,), which are part of the cost.
    """
    nv, A = weights.size, qp.A
    if A[:, nv:].any():  # of rows that forces meet at any motion none remain
        A = null_space(A[:, nv:].T).T @ A
    free = null_space(A[:, :nv]) if len(A) else np.eye(nv)
    size = (free.T * weights) @ free
    curvatures = eigh(free.T @ qp.P[:nv, :nv] @ free, size, eigvals_only=True) - damping
    determined = curvatures[curvatures > DETERMINED * damping]
    condition = float(determined[-1] / determined[0]) if determined.size else 1.0
    return Conditioning(free.shape[1], determined.size, condition)
