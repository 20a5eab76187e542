"""How well the tasks of a tick determine the motion: rank and condition of its cost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, null_space

from wbc.qp.problem import QP
from wbc.validate import Array

# A direction whose curvature is not this many times the damping is left to the damping.
DETERMINED = 10.0


class Conditioning(NamedTuple):
    """What the tasks decide of the motions that contacts leave.

    What becomes of a single task is told by :attr:`wbc.controllers.tick.Tick.singular`.

    Attributes
    ----------
    free:
        Directions of motion that the contacts leave; with several priorities the tick has the QP
        of the last level, and of the motions that contacts and the levels above leave.
    rank:
        Of these, how many the tasks determine; the others are left to the damping. Fewer than
        the tasks have rows means that tasks are singular or repeat each other. What tasks damp of
        themselves (``lm_damping``, and points that are not yet at their targets) counts as
        determined.
    condition:
        Largest over least curvature of the cost along the directions determined; 1 if none is.
        Directions are measured by the joints' weights, like the damping.
    """

    free: int
    rank: int
    condition: float


def conditioning(qp: QP, damping: float, weights: Array) -> Conditioning:
    """Return how well conditioned a QP's cost is; takes a millisecond.

    Parameters
    ----------
    damping, weights:
        The controller's, and its weights (nv,) of the joints, which are part of the cost.
    """
    nv = weights.size  # behind v there may be slacks, which are no motions
    free = null_space(qp.A[:, :nv]) if qp.b.size else np.eye(nv)
    size = (free.T * weights) @ free
    curvatures = eigh(free.T @ qp.P[:nv, :nv] @ free, size, eigvals_only=True) - damping
    determined = curvatures[curvatures > DETERMINED * damping]
    condition = float(determined[-1] / determined[0]) if determined.size else 1.0
    return Conditioning(free.shape[1], determined.size, condition)
