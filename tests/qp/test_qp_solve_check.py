"""The status follows the evidence, whatever the solver claims."""

from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

from wbc.qp import QP, ProxQP, Status, make_backend
from wbc.qp.solution import RawSolution
from wbc.qp.solve_check import SolveCheck

# min 1/2 |x|^2 - 2 x0 with x0 <= 1: x = (1, 0), z_box = (1, 0).
FEASIBLE = QP.build(np.eye(2), [-2.0, 0.0], upper=[1.0, 9.0])
INFEASIBLE = QP.build(np.eye(2), [-2.0, 0.0], A=[[1.0, 0.0]], b=[3.0], upper=[1.0, 9.0])
EXACT = RawSolution(
    np.array([1.0, 0.0]), np.zeros(0), np.zeros(0), np.array([1.0, 0.0]), Status.SOLVED
)


def judge(qp: QP, answer: RawSolution):
    return SolveCheck("fake", 1e-8, perf_counter()).judge(qp, answer)


@pytest.mark.parametrize("claim", list(Status))
def test_an_optimal_answer_is_solved_whatever_is_claimed(claim):
    solution = judge(FEASIBLE, replace(EXACT, claim=claim))
    assert solution.status is Status.SOLVED
    assert solution.solved
    assert solution.conflict is None


WRONG = {
    "outside": replace(EXACT, x=np.array([2.0, 0.0])),
    "not optimal": replace(EXACT, x=np.array([0.5, 0.0])),
    "wrong multiplier": replace(EXACT, z_box=np.array([1.0, 1e-3])),
    "wrong side": replace(EXACT, x=np.array([0.0, 0.0]), z_box=np.array([2.0, 0.0])),
    "nan": replace(EXACT, x=np.array([np.nan, 0.0])),
    "nothing": RawSolution.none(FEASIBLE, Status.SOLVED, ""),
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize(
    ("claim", "status"),
    [
        (Status.SOLVED, Status.CONTRADICTED),
        (Status.INFEASIBLE, Status.CONTRADICTED),
        (Status.ITERATION_LIMIT, Status.ITERATION_LIMIT),
        (Status.FAILED, Status.FAILED),
    ],
)
def test_a_wrong_answer_to_a_feasible_qp(case, claim, status):
    solution = judge(FEASIBLE, replace(WRONG[case], claim=claim))
    assert solution.status is status
    assert not solution.solved
    assert solution.conflict is None
    assert status.value in solution.describe()


@pytest.mark.parametrize("claim", list(Status))
def test_infeasible_whatever_is_claimed(claim):
    answer = replace(EXACT, y=np.zeros(1), claim=claim)
    solution = judge(INFEASIBLE, answer)
    assert solution.status is Status.INFEASIBLE
    assert {row.label for row in solution.conflict.rows} == {"equality 0", "x0"}
    assert "these cannot all hold" in solution.describe()


def test_status_reads_as_its_name():
    assert Status("solved") is Status.SOLVED
    assert f"{Status.ITERATION_LIMIT}" == "iteration_limit"


def test_rounding_in_the_right_hand_side_is_not_infeasibility() -> None:
    """A tick on two feet whose contacts ask for 1e-14 m/s of rounding, recorded from a run.

    ProxQP's own test called it infeasible at a tolerance of 1e-14: that test is never asked.
    """
    with np.load(Path(__file__).parent / "false_infeasible.npz") as recorded:
        P = recorded["P"]
        qp = QP.build(**{**recorded, "P": (P + P.T) / 2})  # it was recorded with rounding
    for warm in (True, False):
        solution = ProxQP(warm=warm).solve(qp)
        assert solution.solved, solution.describe()


def test_multipliers_without_end_are_no_numbers_to_reckon_with():
    """DAQP leaves infinite multipliers behind on infeasible QPs; times zeros they would be NaN."""
    backend = make_backend("daqp")
    said = {"lam": np.array([np.inf, 0.0, -np.inf]), "iterations": 3}
    backend._call = lambda *_, **__: (np.array([1.0, 0.0]), 0.0, -1, said)
    solution = backend.solve(INFEASIBLE)
    assert solution.status is Status.INFEASIBLE
    assert solution.conflict is not None
    assert not np.isinf(np.concatenate((solution.y, solution.z_box))).any()
