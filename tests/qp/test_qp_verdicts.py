"""From residuals to verdicts: sums and thresholds against loops over rows, and by hand."""

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.conflict import REACH, conflict_of, find_conflict
from wbc.qp.kkt import COST_DOUBT, acceptable, doubtful_cost, kkt_residuals
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
