"""What a solver says, before anyone believes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.qp.problem import QP
from wbc.qp.solution import Status
from wbc.validate import Array


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A solver's own words, in the sign convention of :class:`wbc.qp.solution.Solution`."""

    x: Array  # (n,)
    y: Array  # (me,)
    z: Array  # (mi,)
    z_box: Array  # (n,)
    claim: Status
    iterations: int = 0
    message: str = ""

    @classmethod
    def nothing(cls, qp: QP, claim: Status, message: str) -> Answer:
        """Return the answer of a solver that gave no point: NaN everywhere."""
        x, y, z = (np.full(size, np.nan) for size in (qp.g.size, qp.b.size, qp.u.size))
        return cls(x, y, z, x.copy(), claim, 0, message)
