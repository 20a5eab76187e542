"""Residuals by hand and by plain loops over the definitions; the status follows this evidence."""

import itertools
import math
from collections import Counter
from time import perf_counter

import numpy as np
import pytest
from scipy.optimize import linprog

from tests.qp.conftest import recorded
from wbc.qp import QP, KktResiduals, ProxQP, Status, make_backend
from wbc.qp.conflict import REACH, conflict_of, find_conflict
from wbc.qp.kkt import COST_DOUBT, SolveCheck, _within, acceptable, doubtful_cost, kkt_residuals
from wbc.qp.problem import Labels
from wbc.qp.solution import RawSolution

NONE = np.zeros(0)

# min 1/2 x^2 - 2 x with x <= 1: x = 1, and the bound holds back the slope 1 - 2 = -1.
CAPPED = QP.build([[1.0]], [-2.0], upper=[1.0])
# min 1/2 |x|^2 with x0 + x1 = 2: x = (1, 1), y = -1.
SPLIT = QP.build(np.eye(2), np.zeros(2), A=[[1.0, 1.0]], b=[2.0])
# min 1/2 |x|^2 with 3 <= x0 + x1 <= 4: x = (1.5, 1.5), z = -1.5, at the lower end.
PUSHED = QP.build(np.eye(2), np.zeros(2), C=[[1.0, 1.0]], l=[3.0], u=[4.0])


def loop_residuals(qp, x, y, z, z_box):
    """The definitions, one scalar at a time."""
    primal, clash = 0.0, 0.0
    for row, value in zip(qp.A, qp.b, strict=True):
        primal = max(primal, abs(sum(row * x) - value))
    intervals = [(sum(c * x), lo, up, m) for c, lo, up, m in zip(qp.C, qp.l, qp.u, z, strict=True)]
    intervals += list(zip(x, qp.lower, qp.upper, z_box, strict=True))
    for value, low, high, multiplier in intervals:
        primal = max(primal, value - high, low - value)
        pointed = abs(high - value) if multiplier > 0 else abs(value - low)
        clash = max(clash, min(abs(multiplier), pointed))
    dual = 0.0
    for j in range(len(x)):
        slope = sum(qp.P[j] * x) + qp.g[j] + sum(qp.A[:, j] * y) + sum(qp.C[:, j] * z) + z_box[j]
        dual = max(dual, abs(slope))
    return primal, dual, clash


@pytest.mark.parametrize(
    ("qp", "x", "y", "z", "z_box"),
    [
        (CAPPED, [1.0], [], [], [1.0]),
        (SPLIT, [1.0, 1.0], [-1.0], [], [0.0, 0.0]),
        (PUSHED, [1.5, 1.5], [], [-1.5], [0.0, 0.0]),
    ],
)
def test_zero_at_the_optimum(qp, x, y, z, z_box):
    point = [np.array(part, dtype=float) for part in (x, y, z, z_box)]
    # The numbers are small and exact in binary: nothing is rounded.
    assert kkt_residuals(qp, *point) == KktResiduals(0.0, 0.0, 0.0)


def test_each_residual_alone():
    outside = kkt_residuals(CAPPED, np.array([1.5]), NONE, NONE, np.array([0.5]))
    assert outside == KktResiduals(primal=0.5, dual=0.0, complementarity=0.5)
    sloped = kkt_residuals(CAPPED, np.array([1.0]), NONE, NONE, np.array([0.75]))
    assert sloped == KktResiduals(primal=0.0, dual=0.25, complementarity=0.0)
    inside = kkt_residuals(CAPPED, np.array([0.5]), NONE, NONE, np.array([1.5]))
    assert inside == KktResiduals(primal=0.0, dual=0.0, complementarity=0.5)
    missed = kkt_residuals(SPLIT, np.array([1.0, 0.75]), np.array([-1.0]), NONE, np.zeros(2))
    assert missed == KktResiduals(primal=0.25, dual=0.25, complementarity=0.0)


@pytest.mark.parametrize("part", range(4))
def test_nan_is_never_hidden(solvable, part):
    qp = solvable(np.random.default_rng(1))
    point = [np.zeros(8), np.zeros(2), np.zeros(4), np.zeros(8)]
    point[part][-1] = np.nan
    residuals = kkt_residuals(qp, *point)
    assert math.isnan(residuals.dual)
    assert not acceptable(residuals, 1e-3, qp, *point)
    if part == 0:
        assert math.isnan(residuals.primal)


@pytest.mark.parametrize(("me", "mi"), [(0, 0), (2, 0), (0, 4), (3, 5)])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("pull", [1.0, 0.0])
def test_against_the_loop(solvable, seed, me, mi, pull):
    """``pull`` 0: no bound or row is said to be active."""
    rng = np.random.default_rng(seed)
    qp = solvable(rng, me=me, mi=mi)
    point = [rng.normal(size=size) for size in (8, me, mi, 8)]
    point[2:] = [pull * part for part in point[2:]]
    r = kkt_residuals(qp, *point)
    # Sums of tens of terms up to 1e4: another order of summation moves them by 1e-12.
    np.testing.assert_allclose(
        (r.primal, r.dual, r.complementarity), loop_residuals(qp, *point), rtol=1e-10
    )


def test_a_row_with_large_numbers_does_not_excuse_a_small_one():
    # 1e4 x = 3e4 and 1e-4 x = 1e-4 contradict each other; the second is missed by 2e-4.
    qp = QP.build([[1.0]], [0.0], A=[[1e4], [1e-4]], b=[3e4, 1e-4])
    x, y = np.array([3.0]), np.array([-3e-4, 0.0])
    residuals = kkt_residuals(qp, x, y, NONE, np.zeros(1))
    assert residuals.primal == pytest.approx(2e-4)
    assert not acceptable(residuals, 1e-8, qp, x, y, NONE, np.zeros(1))


def test_an_inequality_is_measured_by_its_own_terms_too():
    """x1 <= 1 exceeded by 1e-3 is no rounding beside x0 = 1e6; x0 <= 1e6 exceeded by it is."""
    x = np.array([1e6, 1.0])
    for row, end, good in (([0.0, 1.0], 1.0, False), ([1.0, 0.0], 1e6, True)):
        qp = QP.build(np.eye(2), -x, C=[row], l=[-np.inf], u=[end - 1e-3])
        point = x, NONE, np.zeros(1), np.zeros(2)
        residuals = kkt_residuals(qp, *point)
        assert residuals.primal == pytest.approx(1e-3, rel=1e-6)
        assert acceptable(residuals, 1e-8, qp, *point) == good


def test_diverging_multipliers_excuse_nothing() -> None:
    """min 1/2 (x - 1)^2 with a row x >= 1.98 and the bound x <= 2: the optimum is 1.98, not 1.99.

    ProxQP ends at its iteration limit with multipliers of 1e8 and more that cancel; relative to
    them every residual is small.
    """
    qp = QP.build(np.eye(1), [-1.0], C=np.eye(1), l=[1.98], u=[np.inf], upper=[2.0])
    for x, pushed, good in ((1.99, 1e9, False), (1.98, 0.0, True)):
        point = np.array([x]), NONE, np.array([1.0 - x - pushed]), np.array([pushed])
        residuals = kkt_residuals(qp, *point)
        assert residuals.dual < 1e-6
        assert acceptable(residuals, 1e-9, qp, *point) == good


EXCESS = 2.0**-40  # small beside what is allowed, and exact in binary: nothing is rounded below


def _alone(g: float = 0.0, upper: float = math.inf) -> QP:
    return QP.build([[0.0]], [g], upper=[upper])


@pytest.mark.parametrize("more", [0.0, EXCESS])
def test_half_of_one_and_the_largest_term_is_allowed_and_no_more(more: float) -> None:
    """By hand, at eps = 1/2: each residual alone is what it may be at most, then 2^-40 beyond."""

    def accepted(qp: QP, x: float, z_box: float) -> bool:
        point = np.array([x]), NONE, NONE, np.array([z_box])
        residuals = kkt_residuals(qp, *point)
        assert sum(abs(one) > 0.0 for one in residuals[:3]) == 1
        return acceptable(residuals, 0.5, qp, *point)

    assert accepted(_alone(upper=1.0), 3.0 + 2.0 * more, 0.0) == (not more)  # 2 = (1 + 3) / 2
    assert accepted(_alone(1.0 + 2.0 * more), 0.0, 0.0) == (not more)  # slope 1 = (1 + 1) / 2
    m = 1.0 + 4.0 * more  # at a bound that is m away
    assert accepted(_alone(-m, m), 0.0, m) == (not more)


def test_rows_are_within_their_ends_to_their_own_largest_term(rng) -> None:
    """Whole numbers and eps = 1/4; each end is put exactly as far off as may be, then beyond."""
    for _ in range(50):
        rows, x = rng.integers(-9, 10, (3, 4)).astype(float), rng.integers(-9, 10, 4).astype(float)
        values = [sum(a * b for a, b in zip(row, x, strict=True)) for row in rows]
        allowed = [
            0.25 * (1 + max(abs(a * b) for a, b in zip(row, x, strict=True))) for row in rows
        ]
        endless = np.full(3, np.inf)
        for k, sign in itertools.product(range(3), (-1.0, 1.0)):
            for more in (0.0, EXCESS):
                end = sign * endless
                end[k] = values[k] - sign * (allowed[k] + more)
                ends = (-endless, end) if sign > 0.0 else (end, endless)
                assert _within(rows, x, *ends, 0.25) == (not more)


def test_a_missed_equality_is_no_clash_of_multipliers() -> None:
    """It has no side on which it is not active: x = (2, 1) misses 0 = x_1 - 1.5 by a half."""
    qp = QP.build(np.eye(2), [-3.0, -1.0], A=[[1.0, 0.0]], b=[1.5], upper=[2.0, 9.0])
    found = kkt_residuals(qp, np.array([2.0, 1.0]), np.zeros(1), np.zeros(0), np.array([1.0, 0.0]))
    assert tuple(found[:3]) == (0.5, 0.0, 0.0)


def some_point(rng: np.random.Generator, qp: QP) -> tuple[np.ndarray, ...]:
    sizes = (qp.g.size, qp.b.size, qp.u.size, qp.g.size)
    return tuple(rng.normal(size=size) for size in sizes)


@pytest.mark.parametrize("seed", range(5))
def test_the_cost_in_doubt_is_the_sum_over_bounds_and_the_gradient_left(solvable, seed) -> None:
    """Multiplier times distance to the end it points at, where it is larger than that distance."""
    rng = np.random.default_rng(seed)
    qp = solvable(rng)
    x, y, z, z_box = some_point(rng, qp)
    z[0] = z_box[0] = 0.0
    total = 0.0
    values = np.concatenate((x, qp.C @ x))
    ends = np.concatenate((qp.lower, qp.l)), np.concatenate((qp.upper, qp.u))
    for k, multiplier in enumerate(np.concatenate((z_box, z))):
        gap = abs(ends[1][k] - values[k] if multiplier > 0.0 else values[k] - ends[0][k])
        if abs(multiplier) > gap:
            total += abs(multiplier) * gap
    left = qp.P @ x + qp.g + qp.A.T @ y + qp.C.T @ z + z_box
    total += sum(abs(a) * abs(b) for a, b in zip(left, x, strict=True))
    assert doubtful_cost(qp, x, y, z, z_box) == pytest.approx(total, rel=1e-10)


def test_a_cost_in_doubt_by_more_than_a_ten_thousandth_is_not_accepted() -> None:
    """min x^2/2 - 1000 x: the gradient that is left times x, beside 1 + |x'Px| + |g'x|."""
    qp = QP.build(np.eye(1), [-1000.0])
    x, large = np.array([1000.0]), 1.0 + 2e6
    for share, good in ((0.99, True), (1.01, False)):
        left = share * COST_DOUBT * large / 1000.0
        near = x + left
        residuals = kkt_residuals(qp, near, NONE, NONE, np.zeros(1))
        eps = 1.1 * left / 1001.0
        assert acceptable(residuals, eps, qp, near, NONE, NONE, np.zeros(1)) is good
    assert COST_DOUBT == 1e-4


# ---------------------------------------------------------------------- certificates


NONE_OF_THE_BOX = np.zeros(2)


def contradiction(scale: float = 1.0, lean: float = 0.0) -> QP:
    """x >= 1 (written as scale x >= scale) and x <= 0; with ``lean``, the rows are not parallel."""
    C = np.array([[scale, 0.0], [1.0, lean]])
    return QP.build(np.eye(2), np.zeros(2), C=C, l=[scale, -np.inf], u=[np.inf, 0.0])


def largest_tolerance(qp: QP, y=NONE, z=NONE, z_box=NONE_OF_THE_BOX) -> float:
    """Return the largest tolerance at which the multipliers prove something; -1: at none."""
    parts = [np.asarray(part, dtype=float) for part in (y, z, z_box)]
    low, high = 0.0, 10.0
    if conflict_of(qp, *parts, 0.0) is None:
        return -1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        good = conflict_of(qp, *parts, middle) is not None
        low, high = (middle, high) if good else (low, middle)
    return low


@pytest.mark.parametrize("scale", [1.0, 10.0, 0.1])
def test_a_certificate_holds_with_every_end_relaxed(scale: float) -> None:
    """By hand, rows of unit length: sum -1; ends give way by t (1 + 1) / 2 and t / 2."""
    found = largest_tolerance(contradiction(scale), z=[-1.0 / scale, 1.0])
    assert found == pytest.approx(1.0 / (0.5 * 2.0 + 0.5 * 1.0), rel=1e-9)


def test_bounds_take_part_in_a_certificate_with_their_own_ends() -> None:
    """x + y >= 3 within x, y <= 1: sum -3 + 2, of a row of length sqrt(2) and two bounds."""
    qp = QP.build(np.eye(2), np.zeros(2), C=np.ones((1, 2)), l=[3.0], upper=[1.0, 1.0])
    found = largest_tolerance(qp, z=[-1.0], z_box=[1.0, 1.0])
    ends = np.sqrt(2.0) * (1.0 + 3.0 / np.sqrt(2.0)) + 2 * 2.0
    assert found == pytest.approx(1.0 / (0.5 * ends), rel=1e-9)


@pytest.mark.parametrize(
    ("lean", "proves"), [(1e-10, True), (1e-8, True), (1e-5, False),
                         (0.99 / REACH, True), (1.01 / REACH, False)]
)  # fmt: skip
def test_what_unbounded_unknowns_could_make_good_is_no_certificate(lean, proves) -> None:
    """Rows that lean by 1e-8 meet at y = -1e8, beyond reach; by 1e-5 at -1e5, which is within."""
    assert (largest_tolerance(contradiction(lean=lean), z=[-1.0, 1.0]) >= 0.0) is proves


@pytest.mark.parametrize(
    "z", [[0.0, 0.0], [1.0, -1.0], [-1.0, 0.0], [np.nan, 1.0], [-np.inf, np.inf]]
)
def test_what_are_no_multipliers_prove_nothing(z) -> None:
    """None; those of ends that are not there; one row alone; no numbers."""
    assert conflict_of(contradiction(), NONE, np.array(z), NONE_OF_THE_BOX) is None


def test_rows_of_a_conflict_are_named_by_their_weight_and_in_their_units() -> None:
    """2 x >= 3 against x <= 1 is missed by 1; 4 y = 12 against y <= 1 by 8; not what is light."""
    labels = Labels(("e",), ("a", "b"), ("x", "y"))
    qp = QP.build(np.eye(2), np.zeros(2), A=[[0.0, 4.0]], b=[12.0], C=[[2.0, 0.0], [0.0, 1.0]],
                  l=[3.0, -9.0], u=[9.0, 1.5], upper=[1.0, 1.0], labels=labels)  # fmt: skip
    found = conflict_of(qp, np.zeros(1), np.array([-1.0, 0.0]), np.array([2.0, 0.0])).rows
    assert [(row.label, row.side) for row in found] == [("a", "lower limit"), ("x", "upper bound")]
    assert [row.violation for row in found] == pytest.approx([1.0, 0.0])
    assert [row.multiplier for row in found] == pytest.approx([-0.25, 0.5])
    light = conflict_of(qp, np.array([-1.0]), np.array([-1e-8, 0.0]), np.array([2e-8, 4.0])).rows
    assert [(row.label, row.side) for row in light] == [("e", "equality"), ("y", "upper bound")]
    assert [row.violation for row in light] == pytest.approx([8.0, 0.0])


@pytest.mark.parametrize("size", [1e71, 1e160, 1e300, np.inf])
def test_a_point_beyond_what_can_be_multiplied_is_no_answer(size: float) -> None:
    """Interior-point solvers give such points where they diverge."""
    qp = QP.build(np.eye(2), [1e60, -1.0], C=np.ones((1, 2)), u=[1.0])
    x, z, none = np.array([size, 0.0]), np.zeros(1), np.zeros(2)
    for point, multiplier in ((x, z), (none, x[:1])):
        residuals = kkt_residuals(qp, point, NONE, multiplier, none)
        assert residuals == (np.inf, np.inf, np.inf)
        assert not acceptable(residuals, 1e-8, qp, point, NONE, multiplier, none)


@pytest.mark.parametrize(("lean", "needed"), [(5e-4, True), (5e-10, False)])
@pytest.mark.parametrize("bound", [False, True])
def test_a_light_row_is_named_if_the_others_alone_have_a_solution(lean, needed, bound) -> None:
    """x + lean y <= 0, x >= 1, y >= -100: without the last y = -1 / lean does, if within reach."""
    ends = {"lower": [-np.inf, -100.0]} if bound else {}
    C = [[1.0, lean], [1.0, 0.0], [0.0, 1.0]]
    low = [-np.inf, 1.0, -np.inf if bound else -100.0]
    qp = QP.build(np.eye(2), np.zeros(2), C=C, l=low, u=[0.0, np.inf, np.inf], **ends)
    named = {row.label for row in find_conflict(qp).rows}
    third = "x1" if bound else "inequality 2"
    assert named == {"inequality 0", "inequality 1", *([third] if needed else [])}


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
