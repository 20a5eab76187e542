"""Solutions of QPs, checked and unchecked: a point, its multipliers, the evidence."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from wbc.qp.problem import QP
from wbc.validate import Array


class Status(StrEnum):
    """What the evidence says about an answer; never merely what the solver said.

    ``SOLVED``: our own KKT residuals are small. ``INFEASIBLE``: a certificate that we checked
    says that no point meets every row (see ``Solution.conflict``). ``ITERATION_LIMIT``: the
    solver ran out of iterations. ``CONTRADICTED``: evidence beyond the QP refutes a solution (a
    command outside the robot's limits). ``FAILED``: the solver returned nothing, gave up, or
    claims a result for which we found no evidence.
    """

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration_limit"
    CONTRADICTED = "contradicted"
    FAILED = "failed"


class KktResiduals(NamedTuple):
    """Largest absolute violation of each optimality condition, in the QP's own units.

    ``primal``: of a row or bound. ``dual``: of P x + g + A'y + C'z + z_box = 0.
    ``complementarity``: over rows and bounds, the smaller of |multiplier| and the distance to the
    bound that the multiplier's sign points at. The smaller one, and not the product, because a
    bound may be infinite: there the multiplier itself is what is wrong. NaN anywhere stays NaN.
    """

    primal: float
    dual: float
    complementarity: float


@dataclass(frozen=True, slots=True)
class ConflictRow:
    """One row or bound that takes part in a conflict.

    ``violation`` is how far the nearest compromise misses it, in the row's own units: zero for a
    bound, which the compromise keeps. ``multiplier`` is its weight in the certificate: multiplier
    times row, summed over the conflict, vanishes; signs as in :class:`Solution`. ``side`` is
    ``"equality"``, ``"upper limit"`` or ``"lower limit"`` of an inequality row, ``"upper bound"``
    or ``"lower bound"`` of a variable, ``"crossed limits"`` where lower lies above upper.
    """

    label: str
    violation: float
    multiplier: float
    side: str = "equality"

    def describe(self) -> str:
        """Return the row's name, its side, and by how much it is missed."""
        side = "" if self.side == "equality" else f" ({self.side})"
        missed = f", missed by {self.violation:.3g}" if self.violation else ""
        return f"{self.label!r}{side}{missed}"


@dataclass(frozen=True, slots=True)
class Conflict:
    """Rows and bounds that cannot all hold, the heaviest in the certificate first."""

    rows: tuple[ConflictRow, ...]

    @property
    def has_inequalities(self) -> bool:
        """Whether an inequality row takes part; equalities and bounds of variables are none."""
        return any(
            row.side in ("upper limit", "lower limit", "crossed limits") for row in self.rows
        )

    def describe(self, shown: int = 6) -> str:
        """Return one plain sentence that names the first ``shown`` rows."""
        names = "; ".join(row.describe() for row in self.rows[:shown])
        more = len(self.rows) - shown
        return f"these cannot all hold: {names}" + (f"; and {more} more" if more > 0 else "")


class RawSolution(NamedTuple):
    """A solver's unchecked answer, in the sign convention of :class:`Solution`."""

    x: Array  # (n,)
    y: Array  # (me,)
    z: Array  # (mi,)
    z_box: Array  # (n,)
    claim: Status
    iterations: int = 0
    message: str = ""

    @classmethod
    def none(cls, qp: QP, claim: Status, message: str) -> RawSolution:
        """Return the answer of a solver that gave no point: NaN everywhere."""
        x, y, z = (np.full(size, np.nan) for size in (qp.g.size, qp.b.size, qp.u.size))
        return cls(x, y, z, x.copy(), claim, 0, message)


class Solution(NamedTuple):
    """One answer of a backend. Signs: P x + g + A'y + C'z + z_box = 0.

    A multiplier in ``z`` or ``z_box`` is positive where the upper bound is active, negative where
    the lower one is, zero in between. Use ``x`` only when ``solved``: on any other status it is
    the solver's last point, possibly NaN, and kept as evidence.
    """

    x: Array  # (n,)
    y: Array  # (me,)
    z: Array  # (mi,)
    z_box: Array  # (n,)
    status: Status
    residuals: KktResiduals
    iterations: int
    solve_time: float  # seconds, checks and every attempt included
    # The solver that succeeded: a backend may call another one; "cholesky" with 0 iterations where
    # the optimum of the cost alone keeps all bounds and rows.
    solver: str
    conflict: Conflict | None = None
    attempts: int = 1  # how many times a backend tried before it was satisfied or gave up
    message: str = ""  # what the solver itself said, when it failed

    def __repr__(self) -> str:
        return (
            f"Solution({self.status.value} by {self.solver}, {self.x.size} variables,"
            f" {self.iterations} iterations)"
        )

    @property
    def solved(self) -> bool:
        """Whether ``x`` may be used."""
        return self.status is Status.SOLVED

    def describe(self) -> str:
        """Return one plain sentence: the status, and the evidence for it."""
        r = self.residuals
        text = (
            f"{self.solver}: {self.status.value} after {self.iterations} iterations in attempt "
            f"{self.attempts} (primal residual {r.primal:.1e}, dual {r.dual:.1e}, "
            f"complementarity {r.complementarity:.1e})"
        )
        if self.message:
            text += f"; the solver said {self.message!r}"
        return f"{text}; {self.conflict.describe()}" if self.conflict else text
