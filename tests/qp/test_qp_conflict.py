"""Which rows contradict each other; feasibility itself is checked with scipy's linear programs."""

from collections import Counter

import numpy as np
import pytest
from conflict_judge import can_hold, conflict_error

from tests.needs import needs_bench
from tests.qp.conftest import recorded
from tests.qp.random_qps import (
    contradicting,
    equalities_alone,
    feasible,
    overdetermined,
    without_unknowns_left,
)
from wbc.qp import QP, Labels, ProxQP, Status, core, find_conflict, installed_solvers, make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.conflict import conflict_by_simplex, conflict_of
from wbc.qp.solution import Conflict, ConflictRow

KINDS = {
    "rows and bounds": contradicting,
    "no unknown left": without_unknowns_left,
    "equalities alone": equalities_alone,
}


def without(qp: QP, label: str) -> QP:
    """Return ``qp`` without its row or bounds of that name."""
    names = qp.labels
    eq = [k for k, name in enumerate(names.equality) if name != label]
    ineq = [k for k, name in enumerate(names.inequality) if name != label]
    box = np.array([name == label for name in names.variables])
    left = [tuple(names.equality[k] for k in eq), tuple(names.inequality[k] for k in ineq)]
    return qp._replace(
        A=qp.A[eq], b=qp.b[eq], C=qp.C[ineq], l=qp.l[ineq], u=qp.u[ineq],
        lower=np.where(box, -np.inf, qp.lower), upper=np.where(box, np.inf, qp.upper),
        labels=Labels(*left, names.variables),
    )  # fmt: skip


def make(n=4, **parts) -> QP:
    defaults = {"A": np.zeros((0, n)), "b": [], "C": np.zeros((0, n)), "l": [], "u": []}
    parts = defaults | parts
    return QP.build(np.eye(n), np.zeros(n), **parts)


UNIT = np.eye(4)
# Name: a QP with exactly one conflict and rows that have nothing to do with it; the labels in it.
CASES = {
    "two equalities": (
        make(A=np.array([UNIT[0], UNIT[1], 2 * UNIT[0]]), b=[1.0, 5.0, 3.0]),
        {"equality 0", "equality 2"}),
    "equality against a bound": (
        make(A=np.array([UNIT[0], UNIT[1]]), b=[1.0, 5.0], upper=[9.0, 4.0, 1.0, 1.0]),
        {"equality 1", "x1"}),
    "equality against a lower bound": (
        make(A=np.array([UNIT[2]]), b=[-5.0], lower=[-1.0, -1.0, -1.0, -1.0]),
        {"equality 0", "x2"}),
    "inequality against bounds": (
        make(C=np.array([[1, 1, 0, 0], [0, 0, 1, 0]]), l=[3.0, 0.0], u=[9, 9], upper=[1, 1, 1, 1]),
        {"inequality 0", "x0", "x1"}),
    "two inequalities": (
        make(C=np.array([[1, 1, 0, 0], [-1, -1, 0, 0], [0, 0, 1, 1]]), u=[0.0, -2.0, 7.0],
             l=[-9.0] * 3),
        {"inequality 0", "inequality 1"}),
    "equality against an inequality": (
        make(A=np.array([[1, 1, 1, 0]]), b=[10.0], C=np.array([[1, 1, 1, 0], UNIT[3]]), l=[0, 0],
             u=[4, 4]),
        {"equality 0", "inequality 0"}),
    "zero row": (make(A=np.array([UNIT[0], np.zeros(4)]), b=[1.0, 1.0]), {"equality 1"}),
    "lengths of 1e-4 and 1e4": (
        make(A=np.array([1e-4 * UNIT[0], UNIT[1], 1e4 * UNIT[0]]), b=[1e-4, 0.0, 3e4]),
        {"equality 0", "equality 2"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_conflict_is_named_exactly(case):
    qp, labels = CASES[case]
    assert not can_hold(qp)
    conflict = find_conflict(qp)
    assert {row.label for row in conflict.rows} == labels
    for label in labels:
        assert can_hold(without(qp, label)), "the test's own conflict is not the only one"
        assert find_conflict(without(qp, label)) is None


@pytest.mark.parametrize("case", CASES)
def test_the_last_resort_names_it_too(case):
    """Which is asked where the core's active set lost its way among 80 rows of a wild tick."""
    qp, labels = CASES[case]
    conflict = conflict_by_simplex(qp)
    assert {row.label for row in conflict.rows} == labels
    assert all(conflict_by_simplex(without(qp, label)) is None for label in labels)


@pytest.mark.parametrize("name", [n for n in installed_solvers() if n != "osqp"])
@pytest.mark.parametrize("case", CASES)
def test_every_backend_reports_it(name, case):
    qp, labels = CASES[case]
    solution = make_backend(name).solve(qp)
    assert solution.status is Status.INFEASIBLE, solution.describe()
    assert {row.label for row in solution.conflict.rows} == labels


def certificate(qp: QP, conflict: Conflict) -> tuple[float, float]:
    """Return (largest entry of the weighted sum of rows, by how much the bounds separate)."""
    names = qp.labels
    total, separation = np.zeros(qp.g.size), 0.0
    for row in conflict.rows:
        if row.side == "equality":
            k = names.equality.index(row.label)
            vector, bound = qp.A[k], qp.b[k]
        elif row.side.endswith("limit"):
            k = names.inequality.index(row.label)
            vector, bound = qp.C[k], (qp.u if row.side == "upper limit" else qp.l)[k]
            assert (row.multiplier > 0) == (row.side == "upper limit")
        else:
            k = names.variables.index(row.label)
            vector = np.eye(qp.g.size)[k]
            bound = (qp.upper if row.side == "upper bound" else qp.lower)[k]
            assert (row.multiplier > 0) == (row.side == "upper bound")
        total += row.multiplier * vector
        separation -= row.multiplier * bound
    return float(np.abs(total).max()), float(separation)


def test_violation_and_order():
    # The compromise for x0 = 1 and 2 x0 = 3: rows of unit length ask for 1 and 1.5, it takes 1.25.
    conflict = find_conflict(CASES["two equalities"][0])
    by_name = {row.label: row for row in conflict.rows}
    # ProxQP finds the active rows, least squares the numbers: rounding only.
    assert by_name["equality 0"].violation == pytest.approx(0.25, rel=1e-9)
    assert by_name["equality 2"].violation == pytest.approx(0.5, rel=1e-9)
    # A third row that agrees with the second adds nothing to it.
    qp = make(A=np.array([UNIT[0], UNIT[0], UNIT[0]]), b=[1.0, 3.0, 3.0])
    rows = find_conflict(qp).rows
    assert len(rows) == 2 and "equality 0" in {row.label for row in rows}
    assert [row.violation for row in rows] == pytest.approx([1.0, 1.0], rel=1e-9)


@pytest.mark.parametrize("gap", [1.0, 2.0**-20])
def test_crossed_limits_need_no_solver(gap):
    qp = make()._replace(lower=np.array([0.0, 1.0 + gap, 0.0, 0.0]), upper=np.ones(4))
    (row,) = find_conflict(qp).rows
    assert (row.label, row.violation) == ("x1", gap)
    assert "crossed" in row.describe()


def test_a_point_that_meets_all_rows_saves_the_search(solvable, monkeypatch) -> None:
    """Within the bounds, at least; one that does not is no help, nor is one that is none."""
    qp = solvable(np.random.default_rng(3))
    point, searched = ActiveSet().solve(qp).x, list[int]()
    honest = core.solve_in_core
    monkeypatch.setattr(
        "wbc.qp.conflict.solve_in_core", lambda *given: searched.append(1) or honest(*given)
    )
    assert find_conflict(qp, guess=point) is None and not searched
    partly = np.append(np.nan, point[1:])
    for guess in (point + 1.0, partly, np.full(point.size, np.nan), 1e200 * np.sign(point), None):
        assert find_conflict(qp, guess=guess) is None and searched
        searched.clear()


def test_a_conflict_is_named_where_divide_and_conquer_does_not_converge(monkeypatch) -> None:
    """LAPACK's gesdd gave up on one of 5,600 wild ticks, of plain numbers; its gesvd did not."""

    def gave_up(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", gave_up)
    qp, labels = CASES["inequality against bounds"]
    assert {row.label for row in find_conflict(qp).rows} == labels


def test_rows_are_told_from_bounds() -> None:
    for side in ("upper limit", "lower limit", "crossed limits"):
        assert Conflict(
            (ConflictRow("a", 0.0, 1.0), ConflictRow("b", 0.0, 1.0, side))
        ).has_inequalities
    for side in ("equality", "upper bound", "lower bound"):
        assert not Conflict((ConflictRow("b", 0.0, 1.0, side),)).has_inequalities


@pytest.mark.parametrize("seed", range(60))
def test_random_against_linear_programming(seed):
    """Random rows and boxes, about half of them infeasible: the verdict is that of HiGHS."""
    rng = np.random.default_rng(seed)
    n, me, mi = int(rng.integers(2, 12)), int(rng.integers(0, 5)), int(rng.integers(0, 8))
    width = rng.uniform(0.05, 2.0)
    lower, upper = -width * rng.uniform(size=n), width * rng.uniform(size=n)
    free = rng.uniform(size=n) < 0.15
    lower[free], upper[free] = -np.inf, np.inf
    middle = rng.normal(size=mi)
    qp = QP.build(
        np.eye(n), np.zeros(n), A=rng.normal(size=(me, n)), b=0.5 * rng.normal(size=me),
        C=rng.normal(size=(mi, n)), l=middle - rng.exponential(size=mi),
        u=middle + rng.exponential(size=mi), lower=lower, upper=upper,
    )  # fmt: skip
    conflict = find_conflict(qp)
    assert (conflict is None) == can_hold(qp)
    solution = ProxQP().solve(qp)
    assert solution.status is (Status.SOLVED if conflict is None else Status.INFEASIBLE)
    if conflict is not None:
        sum_of_rows, separation = certificate(qp, conflict)
        assert sum_of_rows < 1e-10 * max(abs(row.multiplier) for row in conflict.rows)
        assert conflict_error(qp, conflict) == []
        assert separation > 0.0


def test_a_contradiction_below_the_accuracy_promised_is_none(ticks):
    (qp,) = ticks(seed=5, count=1, mi=10)
    A, b = np.array(qp.A), np.array(qp.b)
    A[5] = A[4]
    b[5] = b[4] + 1e-9
    solution = ProxQP().solve(qp._replace(A=A, b=b))
    assert solution.solved, solution.describe()


@pytest.mark.parametrize("scale", [1e-8, 1e-6, 1.0, 1e6])
def test_a_conflict_does_not_hang_on_the_units_of_a_row(scale: float) -> None:
    """x0 = 3 against x0 <= 1, by a row in units so large that 2e-8 of them are missed."""
    qp = QP.build(np.eye(2), [-2.0, 0.0], A=[[scale, 0.0]], b=[3.0 * scale], upper=[1.0, 9.0])
    assert {row.label for row in find_conflict(qp).rows} == {"equality 0", "x0"}


@pytest.mark.parametrize("far", [0.0, 1e3])
def test_steep_rows_may_contradict_each_other_by_the_tolerance_only(far: float) -> None:
    """1000 x = 0 and 1000 x = 1000 d, each missed by d / 2 in rows of unit length: up to 1e-7 / 2.

    Whatever other rows ask for; 5 % about it for the accuracy of the certificate.
    """
    for share, holds in ((0.95, True), (1.05, False)):
        d = 1e-7 * share
        qp = QP.build(np.eye(2), np.zeros(2), A=[[1e3, 0.0], [1e3, 0.0], [0.0, 1.0]],
                      b=[0.0, 1e3 * d, far])  # fmt: skip
        assert (find_conflict(qp) is None) is holds


@pytest.mark.parametrize("rows", ["equalities", "inequalities"])
@pytest.mark.parametrize(
    ("steep", "c", "most", "tolerance"),
    [(1.0, 3.0, 50.0, 1e-7), (1e-2, 0.0, 50.0, 1e-7), (4.0, -8.0, 9.0, 1e-6)],
)
def test_how_small_a_conflict_is_proved(rows, steep, c, most, tolerance) -> None:
    """steep x <= steep c and steep x >= steep (c + d), within -most <= x <= most; by hand.

    Rows of unit length miss each other by d. Half of that must be left when each end gives way by
    ``tolerance`` of 1 + |end|; of inequalities the core may prove nothing below 2e-7 of that, and
    what misses equalities by less than 1e-8 in their own units solves them.
    """
    core = 1e-8 / steep if rows == "equalities" else 2e-7 * (1.0 + abs(c))
    least = tolerance * (1.0 + abs(c))
    for d, proved in ((0.9 * least, False), (1.1 * max(core, least), True)):
        ends, steeps = np.array([c, c + d]) * steep, np.full((2, 1), steep)
        box = {"lower": [-most], "upper": [most]}
        if rows == "equalities":
            qp = QP.build([[1.0]], [0.0], A=steeps, b=ends, **box)
        else:
            qp = QP.build(
                [[1.0]], [0.0], C=steeps, l=[-np.inf, ends[1]], u=[ends[0], np.inf], **box
            )
        found = find_conflict(qp, tolerance)
        assert (found is not None) is proved
        if found is not None:
            weights = [row.multiplier for row in found.rows]
            assert sorted(np.abs(weights)) == pytest.approx([0.5 * d / steep] * 2, rel=1e-2)
            assert min(weights) < 0.0 < max(weights)


@pytest.mark.parametrize("number", ["0", "1"])
def test_conflicts_of_wild_ticks_that_hardly_are_some_are_proved_without_a_needless_row(
    number: str,
) -> None:
    """Torque ticks of a Romeo: all can hold but for 4e-8; weights from 1 down to 1e-13."""
    qp = recorded(f"conflicts {number}")
    found = ActiveSet().solve(qp)
    assert found.conflict is not None, found.describe()
    assert conflict_error(qp, found.conflict) == []


def test_rows_that_only_repair_what_is_lost_beyond_reach_are_not_blamed() -> None:
    """x <= 0 and x + 1e-5 u >= 1000 hold at u >= 1e8 alone; the other two rows bound u by 0."""
    rows = np.array([[1, 0, 0, 0], [1, 1e-5, 0, 0], [0, 0, 1, 0], [0, 1e-2, 1, 0]])
    qp = make(C=rows, l=[-np.inf, 1000.0, 0.0, -np.inf], u=[0.0, np.inf, np.inf, 0.0])
    conflict = find_conflict(qp)
    assert conflict is not None
    assert {row.label for row in conflict.rows} == {"inequality 0", "inequality 1"}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("gap", "count"),
    [
        (1.0, 5),
        (1e-5, 5),
        *(pytest.param(10.0**k, 40, marks=pytest.mark.slow) for k in (0, -2, -4, -5, -6)),
    ],
)
def test_every_conflict_named_is_one_and_needs_each_of_its_rows(kind, gap, count) -> None:
    """Of gaps that are plain nearly all are proved; below, what is proved is true."""
    rng, seen = np.random.default_rng(31), Counter[Status]()
    for _ in range(count):
        qp = KINDS[kind](rng, gap)
        for backend in (ActiveSet(), ProxQP()):
            found = backend.solve(qp)
            seen[found.status] += 1
            assert (found.conflict is not None) == (found.status is Status.INFEASIBLE)
            if found.conflict is not None:
                assert conflict_error(qp, found.conflict) == [], found.conflict.describe()
    if gap >= 1e-2:
        assert seen[Status.INFEASIBLE] >= 2 * count - 2 and not seen[Status.SOLVED]


@pytest.mark.parametrize("seed", range(12))
def test_of_a_certificate_of_many_rows_those_are_named_that_need_each_other(seed: int) -> None:
    """Multipliers of an interior-point solver are of all contradictions at once."""
    qp, multipliers = overdetermined(np.random.default_rng(seed))
    found = conflict_of(qp, *multipliers)
    assert found is not None and len(found.rows) <= qp.g.size + 1
    assert conflict_error(qp, found) == [], found.describe()


@needs_bench
@pytest.mark.parametrize("seed", range(4))
def test_what_is_feasible_is_never_called_infeasible_and_solved_right(seed: int) -> None:
    """Cost by Clarabel, PIQP or DAQP, to 1e-5 of it: they meet tight corners to about 1e-8."""
    rng, seen = np.random.default_rng(seed), Counter[str]()
    for _ in range(40):
        qp = feasible(rng)
        assert find_conflict(qp) is None
        for backend in (ActiveSet(), ProxQP()):
            found = backend.solve(qp)
            assert found.status is not Status.INFEASIBLE, found.describe()
            seen[f"{backend.name} {found.status}"] += 1
        ours = ActiveSet().solve(qp)
        others = (make_backend(name).solve(qp) for name in ("clarabel", "piqp", "daqp"))
        other = next((found for found in others if found.solved), None)
        if not ours.solved or other is None:
            continue
        costs = [0.5 * one.x @ qp.P @ one.x + qp.g @ one.x for one in (ours, other)]
        assert costs[0] == pytest.approx(costs[1], rel=1e-5, abs=1e-5)
        seen["compared"] += 1
    # Singular costs in corners without room are left unsolved now and then, and said to be.
    assert seen["active_set solved"] >= 36 and seen["proxqp solved"] >= 38
    assert seen["compared"] >= 34
