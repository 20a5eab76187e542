"""From residuals to verdicts: sums and thresholds against loops over rows, and by hand."""

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.conflict import REACH, _essential, _is_certificate, _named, _polished, _UnitRows
from wbc.qp.kkt import (
    DOUBT,
    MOST,
    KktResiduals,
    PerThread,
    _within,
    acceptable,
    doubtful_cost,
    is_accurate,
    kkt_residuals,
)
from wbc.qp.problem import Labels

NONE = np.zeros(0)


def some_point(rng: np.random.Generator, qp: QP) -> tuple[np.ndarray, ...]:
    sizes = (qp.g.size, qp.b.size, qp.u.size, qp.g.size)
    return tuple(rng.normal(size=size) for size in sizes)


@pytest.mark.parametrize("seed", range(5))
def test_the_cost_in_doubt_is_the_sum_over_bounds_and_the_gradient_left(
    solvable, seed: int
) -> None:
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


def test_rows_are_met_relative_to_their_own_largest_term() -> None:
    """1e-3 of 1 + 50: a value of 20 may miss its ends by 0.051, each row by its own."""
    rows, x = np.array([[5.0, -3.0], [0.0, 0.1]]), np.array([10.0, 10.0])  # 50 - 30 = 20, and 1
    wide = np.array([-9.0, -9.0]), np.array([99.0, 99.0])
    for k, value, room in ((0, 20.0, 0.051), (1, 1.0, 0.002)):
        for share, met in ((0.99, True), (1.01, False)):
            lower, upper = wide[0].copy(), wide[1].copy()
            lower[k] = value + share * room
            assert _within(rows, x, lower, wide[1], 1e-3) is met
            upper[k] = value - share * room
            assert _within(rows, x, wide[0], upper, 1e-3) is met
    assert _within(np.zeros((0, 2)), x, NONE, NONE, 1e-3)


@pytest.mark.parametrize("which", range(3))
def test_each_residual_counts_and_numbers_that_are_none_do_not(which: int) -> None:
    for value, accurate in ((1e-8, True), (1.01e-8, False), (np.nan, False), (np.inf, False)):
        residuals = [0.0, 0.0, 0.0, 99.0]
        residuals[which] = value
        assert is_accurate(residuals, 1e-8) is accurate


@pytest.mark.parametrize("part", ["primal", "dual", "complementarity"])
def test_residuals_are_relative_to_the_terms_that_they_are_made_of(part: str) -> None:
    """min x^2/2 - 1000 x, x <= 1000: with terms of 1000, 1001 times eps passes."""
    qp = QP.build(np.eye(1), [-1000.0], upper=[1000.0])
    x, z_box = np.array([1000.0]), np.zeros(1)
    for factor, good in ((0.99, True), (1.02, False)):
        residuals = KktResiduals(0.0, 0.0, 0.0)._replace(**{part: factor * 1001e-8})
        assert acceptable(residuals, 1e-8, qp, x, NONE, NONE, z_box) is good


def test_a_cost_in_doubt_by_more_than_a_ten_thousandth_is_not_accepted() -> None:
    """min x^2/2 - 1000 x: the gradient that is left times x, beside 1 + |x'Px| + |g'x|."""
    qp = QP.build(np.eye(1), [-1000.0])
    x, large = np.array([1000.0]), 1.0 + 2e6
    for share, good in ((0.99, True), (1.01, False)):
        left = share * DOUBT * large / 1000.0
        near = x + left
        residuals = kkt_residuals(qp, near, NONE, NONE, np.zeros(1))
        eps = 1.1 * left / 1001.0
        assert acceptable(residuals, eps, qp, near, NONE, NONE, np.zeros(1)) is good
    assert DOUBT == 1e-4


def test_memory_of_a_thread_is_let_go_when_it_is_too_much() -> None:
    kept = PerThread()
    for k in range(MOST):
        assert kept.keep((k,), k) == k
    assert len(kept.kept) == MOST
    kept.keep((MOST,), "new")
    assert kept.kept == {(MOST,): "new"}


# ---------------------------------------------------------------------- certificates


def contradiction(scale: float = 1.0, n: int = 1, lean: float = 0.0) -> tuple[QP, _UnitRows]:
    """x >= 1 (written as scale x >= scale) and x <= 0; with ``lean``, the rows are not parallel."""
    C = np.zeros((2, n))
    C[:, 0] = scale, 1.0
    if lean:
        C[1, 1] = lean
    qp = QP.build(np.eye(n), np.zeros(n), C=C, l=[scale, -np.inf], u=[np.inf, 0.0])
    return qp, _UnitRows.of(qp)


def largest_tolerance(qp: QP, rows: _UnitRows, violation: np.ndarray, size: float) -> float:
    box = -violation @ rows.matrix
    low, high = 0.0, 10.0
    if not _is_certificate(qp, rows, violation, box, size, 0.0):
        return -1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        good = _is_certificate(qp, rows, violation, box, size, middle)
        low, high = (middle, high) if good else (low, middle)
    return low


@pytest.mark.parametrize("scale", [1.0, 10.0, 0.1])
def test_a_certificate_holds_with_every_end_relaxed_in_its_own_units(scale: float) -> None:
    """By hand: sum -1/2, |s|^2 = 1/2; ends may move by t (1 / scale + 1) / 2 and t / 2."""
    qp, rows = contradiction(scale)
    found = largest_tolerance(qp, rows, np.array([-0.5, 0.5]), 0.5)
    expected = (0.5 - 0.5 * 0.5) / (0.5 * (1.0 / scale + 1.0) + 0.5 * 1.0)
    assert found == pytest.approx(expected, rel=1e-9)


def test_bounds_take_part_in_a_certificate_with_their_own_ends() -> None:
    """x + y >= 3 within x, y <= 1: sum -3 s + 2 s with s = 1 / sqrt(2), by hand."""
    qp = QP.build(np.eye(2), np.zeros(2), C=np.ones((1, 2)), l=[3.0], upper=[1.0, 1.0])
    rows = _UnitRows.of(qp)
    s = 1.0 / np.sqrt(2.0)  # in a row of unit length
    found = largest_tolerance(qp, rows, np.array([-s]), 1.0)
    weight = s * s  # of each bound
    total = -s * 3.0 * s + 2 * weight * 1.0
    own = s * (s + 3.0 * s) + 2 * weight * 2.0
    assert found == pytest.approx((-total - 0.5 * s * s) / own, rel=1e-9)


def test_what_unbounded_unknowns_could_make_good_is_no_certificate() -> None:
    """Rows that lean by 1e-8 meet at x = 1e8, beyond reach; by 1e-5 at 1e5, which is within it."""
    for lean, proves in ((1e-8, True), (1e-5, False)):
        qp, rows = contradiction(n=2, lean=lean)
        violation = np.array([-0.5, 0.5])
        assert (largest_tolerance(qp, rows, violation, 0.5) >= 0.0) is proves
        # The leak counts by the reach and by the size of the point.
    edge = (0.5 - 0.25) / (0.5 * REACH * 1.5)
    for lean, proves in ((0.99 * edge, True), (1.01 * edge, False)):
        qp, rows = contradiction(n=2, lean=lean)
        assert (largest_tolerance(qp, rows, np.array([-0.5, 0.5]), 0.5) >= 0.0) is proves


def test_rows_of_a_conflict_are_named_by_their_weight_and_in_their_units() -> None:
    """Without weight: left out. A row of length 4 is missed by 4 times."""
    labels = Labels(("e",), ("a", "b", "c"), ("x", "y"))
    qp = QP.build(np.eye(2), np.zeros(2), A=[[0.0, 4.0]], b=[1.0],
                  C=[[2.0, 0.0], [0.0, 1.0], [1.0, 0.0]], u=[1.0, 1.0, 1.0], labels=labels,
                  lower=[-1.0, -1.0], upper=[1.0, 1.0])  # fmt: skip
    rows = _UnitRows.of(qp)
    violation, box = np.array([-0.5, 1.0, 0.0, 1.1e-3]), np.array([-0.7, 0.0])
    found = _named(qp, rows, violation, box).rows
    assert [row.label for row in found] == ["a", "x", "e", "c"]
    assert [row.side for row in found] == ["upper limit", "lower bound", "equality", "upper limit"]
    assert [row.violation for row in found] == pytest.approx([2.0, 0.0, 2.0, 1.1e-3])
    assert [row.multiplier for row in found] == pytest.approx([0.5, -0.7, -0.125, 1.1e-3])
    edge = _named(qp, rows, np.array([0.0, -1.0, 0.0, 1.0]), np.zeros(2)).rows
    assert [row.side for row in edge] == ["lower limit", "upper limit"]


@pytest.mark.parametrize("seed", range(6))
def test_a_rough_least_violation_becomes_exact(solvable, seed: int) -> None:
    """Contradicting equalities: least squares over them, found from a point nearby; by SciPy."""
    from scipy.optimize import lsq_linear

    rng = np.random.default_rng(seed)
    A = rng.normal(size=(7, 5))
    b = rng.normal(size=7)
    qp = QP.build(np.eye(5), np.zeros(5), A=A, b=b, lower=[-0.2] * 5, upper=[0.3] * 5)
    rows = _UnitRows.of(qp)
    lengths = np.linalg.norm(A, axis=1)
    best = lsq_linear(A / lengths[:, None], b / lengths, (qp.lower, qp.upper), tol=1e-13).x
    best = np.where(best < -0.2 + 1e-6, -0.2, np.where(best > 0.3 - 1e-6, 0.3, best))
    assert ((best == -0.2) | (best == 0.3)).any()
    inside = (best > -0.2) & (best < 0.3)
    rough = best + 1e-6 * inside * rng.normal(size=5)
    found = _polished(qp, rows, rough)
    pull = rows.violation(found) @ rows.matrix
    np.testing.assert_allclose(pull[inside], 0.0, atol=1e-13)
    np.testing.assert_allclose(found, best, atol=1e-6)


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
    rows = _UnitRows.of(qp)
    violation = 0.5 * np.array([1.0, -1.0, 0.0 if bound else -lean])
    weights = np.concatenate(_essential(qp, rows, violation, -violation @ rows.matrix, 1.0))
    assert np.flatnonzero(weights).tolist() == [0, 1, *([4 if bound else 2] if needed else [])]
