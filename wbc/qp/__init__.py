"""Quadratic programs, their solvers, and the check of every solution.

A :class:`QP` goes to a :class:`Backend`; what comes back is a :class:`Solution` whose status rests
on residuals and certificates recomputed here.
"""

from wbc.qp.backend import Backend, SolverNotInstalledError, installed_solvers, make_backend
from wbc.qp.conflict import find_conflict
from wbc.qp.kkt import kkt_residuals
from wbc.qp.problem import QP, Labels, check_qp
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Conflict, ConflictRow, KktResiduals, Solution, Status

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
    "find_conflict",
    "installed_solvers",
    "kkt_residuals",
    "make_backend",
]
