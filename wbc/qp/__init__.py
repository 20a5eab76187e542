"""Quadratic programs, their solvers, and the check of every solution.

A :class:`Backend` solves a :class:`QP` and returns a :class:`Solution`, whose status is verified by
residuals and certificates that are recomputed here.
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
