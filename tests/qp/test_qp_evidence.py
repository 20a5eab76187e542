"""The status follows the evidence, whatever the solver claims."""

from collections import Counter
from time import perf_counter

import numpy as np
import pytest
from scipy.optimize import linprog

from tests.qp.conftest import recorded
from wbc.qp import QP, ProxQP, Status, make_backend
from wbc.qp.kkt import SolveCheck
from wbc.qp.solution import RawSolution

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
    solution = judge(FEASIBLE, EXACT._replace(claim=claim))
    assert solution.status is Status.SOLVED
    assert solution.solved
    assert solution.conflict is None


WRONG = {
    "outside": EXACT._replace(x=np.array([2.0, 0.0])),
    "not optimal": EXACT._replace(x=np.array([0.5, 0.0])),
    "wrong multiplier": EXACT._replace(z_box=np.array([1.0, 1e-3])),
    "wrong side": EXACT._replace(x=np.array([0.0, 0.0]), z_box=np.array([2.0, 0.0])),
    "nan": EXACT._replace(x=np.array([np.nan, 0.0])),
    "nothing": RawSolution.none(FEASIBLE, Status.SOLVED, ""),
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.parametrize(
    ("claim", "status"),
    [
        (Status.SOLVED, Status.FAILED),
        (Status.INFEASIBLE, Status.FAILED),
        (Status.ITERATION_LIMIT, Status.ITERATION_LIMIT),
        (Status.FAILED, Status.FAILED),
    ],
)
def test_a_wrong_answer_to_a_feasible_qp(case, claim, status):
    solution = judge(FEASIBLE, WRONG[case]._replace(claim=claim))
    told = judge(FEASIBLE, WRONG[case]._replace(claim=claim, message="gave up")).message
    assert solution.status is status
    assert not solution.solved
    assert solution.conflict is None
    assert status.value in solution.describe()
    unfounded = claim in (Status.SOLVED, Status.INFEASIBLE)
    assert solution.message.endswith("no evidence") == unfounded
    assert told.endswith("no evidence, and said 'gave up'" if unfounded else "gave up")


@pytest.mark.parametrize("claim", list(Status))
def test_infeasible_whatever_is_claimed(claim):
    answer = EXACT._replace(y=np.zeros(1), claim=claim)
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
    qp = recorded("false_infeasible")
    for warm in (True, False):
        solution = ProxQP(warm=warm).solve(qp)
        assert solution.solved, solution.describe()


SOLVERS = ("proxqp", "active_set", "clarabel", "piqp", "daqp")


def wild(rng: np.random.Generator) -> QP:
    """A small tick with weights and scales of many decades, loose bounds, and rows that repeat."""
    n, me, mi = 8, int(rng.integers(0, 5)), int(rng.integers(0, 6))
    J = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-4, 4, size=(n, 1))
    A = rng.normal(size=(me, n)) * 10.0 ** rng.uniform(-7, 3, size=(me, 1))
    if me > 2:
        A[-1] = rng.normal() * A[0] + rng.choice([0.0, 1e-9, 1e-6]) * rng.normal(size=n)
    C = rng.normal(size=(mi, n)) * 10.0 ** rng.uniform(-7, 3, size=(mi, 1))
    point = rng.normal(size=n) * 10.0 ** rng.uniform(-3, 3)
    room = 10.0 ** rng.uniform(-6, 9, size=n)
    off = rng.choice([0.0, 1e-9, 1e-7, 1e-5, 1e-2], size=me) * rng.normal(size=me)
    slack = rng.choice([0.0, 1e-8, 1.0], size=mi)
    free = rng.uniform(size=n) < 0.3
    return QP.build(
        J.T @ J + 1e-6 * np.eye(n), J.T @ rng.normal(size=n), A=A, b=A @ point + off,
        C=C, l=np.full(mi, -np.inf), u=C @ point - rng.choice([0.0, 0.0, 1e-7, 1e-3]) + slack,
        lower=np.where(free, -np.inf, point - room), upper=np.where(free, np.inf, point + room),
    )  # fmt: skip


def linear_program_meets(qp: QP) -> bool:
    """Whether HiGHS finds a point that meets each row to 1e-7 of its own units and end."""
    above = np.isfinite(qp.u)
    found = linprog(
        np.zeros(qp.g.size), A_ub=qp.C[above], b_ub=qp.u[above], A_eq=qp.A, b_eq=qp.b,
        bounds=np.column_stack((qp.lower, qp.upper)),
    )  # fmt: skip
    if found.x is None or np.abs(found.x).max() > 1e5:
        return False
    x = np.clip(found.x, qp.lower, qp.upper)
    missed = np.concatenate((np.abs(qp.A @ x - qp.b), qp.C[above] @ x - qp.u[above]))
    ends = np.concatenate((qp.b, qp.u[above]))
    return bool((missed <= 1e-7 * (1.0 + np.abs(ends))).all())


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_verdict_against_what_a_linear_program_finds(solver: str) -> None:
    """Of 150 wild QPs: none that has a solution is called infeasible, none "contradicted"."""
    rng = np.random.default_rng(24)
    seen = Counter[Status]()
    for _ in range(150):
        qp = wild(rng)
        solution = make_backend(solver).solve(qp)
        seen[solution.status] += 1
        assert solution.status is not Status.CONTRADICTED
        if solution.status is Status.INFEASIBLE:
            assert not linear_program_meets(qp), solution.describe()
    assert seen[Status.SOLVED] > 40
    assert seen[Status.INFEASIBLE] > 5
