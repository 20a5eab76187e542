"""Quadratic programs: what they are, who solves them, and whether the answer can be believed.

Knows nothing of robots. A :class:`QP` goes to a :class:`Backend`; what comes back is a
:class:`Solution` whose status rests on residuals and certificates recomputed here.
"""

from wbc.qp.backend import Backend, SolverNotInstalledError, installed_solvers, make_backend
from wbc.qp.conflict import find_conflict
from wbc.qp.kkt import KktResiduals, duality_gap, kkt_residuals
from wbc.qp.problem import QP, Labels, check_qp
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Conflict, ConflictRow, Solution, Status

__all__ = [
    "QP",
    "Backend",
    "Conflict",
    "ConflictRow",
    "KktResiduals",
    "Labels",
    "ProxQP",
    "Solution",
    "SolverNotInstalledError",
    "Status",
    "check_qp",
    "duality_gap",
    "find_conflict",
    "installed_solvers",
    "kkt_residuals",
    "make_backend",
]
