"""How well the tasks of a tick determine the motion: rank and condition of its cost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from wbc.qp.problem import QP

# A direction whose curvature is not this many times the damping is left to the damping.
DETERMINED = 10.0


class Conditioning(NamedTuple):
    """What the tasks decide of the motions that contacts leave.

    Attributes
    ----------
    free:
        Directions of motion that the contacts leave.
    rank:
        Of these, how many the tasks determine; the others are left to the damping. Fewer than
        the tasks have rows means that tasks are singular or repeat each other.
    condition:
        Largest over least curvature of the cost along the directions determined; 1 if none is.
    """

    free: int
    rank: int
    condition: float


def conditioning(qp: QP, damping: float) -> Conditioning:
    """Return how well conditioned a QP's cost is; takes a millisecond.

    Parameters
    ----------
    damping:
        The controller's, which is part of the cost.
    """
    free = null_space(qp.A) if qp.b.size else np.eye(qp.g.size)
    curvatures = np.linalg.eigvalsh(free.T @ qp.P @ free) - damping
    determined = curvatures[curvatures > DETERMINED * damping]
    condition = float(determined[-1] / determined[0]) if determined.size else 1.0
    return Conditioning(free.shape[1], determined.size, condition)
