"""The core's active-set method against Clarabel, PIQP and DAQP, and its verdicts against HiGHS."""

import pickle
import subprocess
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cffi import FFI
from conflict_judge import conflict_error
from scipy.optimize import linprog

from tests.needs import needs_bench, needs_compiler
from wbc.native import sources
from wbc.qp import core as in_core
from wbc.qp import make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.kkt import kkt_residuals
from wbc.qp.problem import QP
from wbc.qp.solution import Status


def random_qp(rng: np.random.Generator) -> QP:
    """Rows and bounds that hold back, some of them one-sided or none."""
    n = int(rng.integers(2, 40))
    k, m = int(rng.integers(0, n)), int(rng.integers(0, 30))
    J, A, C = rng.normal(size=(n, n)), rng.normal(size=(k, n)), rng.normal(size=(m, n))
    x = rng.normal(size=n)
    room = rng.exponential(size=(4, max(n, m)))
    room[rng.random(room.shape) < 0.3] = np.inf
    lower, upper = x - room[0, :n], x + room[1, :n]
    low, high = C @ x - room[2, :m], C @ x + room[3, :m]
    g = 10.0 * rng.normal(size=n)
    rows = {"A": A, "b": A @ x, "C": C, "l": low, "u": high}
    return QP.build(J.T @ J + 1e-3 * np.eye(n), g, **rows, lower=lower, upper=upper)


@needs_bench
@pytest.mark.parametrize("other", ["daqp", "piqp", "clarabel"])
def test_the_answer_is_that_of_other_solvers(other: str) -> None:
    rng, active, compared = np.random.default_rng(0), 0, 0
    for _ in range(150):
        qp = random_qp(rng)
        ours, theirs = ActiveSet().solve(qp), make_backend(other).solve(qp)
        assert ours.solved and ours.solver == "active_set"
        again = kkt_residuals(qp, ours.x, ours.y, ours.z, ours.z_box)
        for field in ("primal", "dual", "complementarity"):
            found = getattr(ours.residuals, field)
            assert found <= 1e-8
            assert found == pytest.approx(getattr(again, field), abs=1e-11)
        active += np.count_nonzero(ours.z) + np.count_nonzero(ours.z_box)
        if not theirs.solved:
            continue
        compared += 1
        # Curvature 1e-3 beside 1e2: residuals of 1e-8 leave 1e-5 in the point.
        scale = max(1.0, np.abs(theirs.x).max())
        np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-5 * scale)
    assert active > 500 and compared > 140


@pytest.mark.slow
@needs_compiler
def test_the_same_bits_without_wide_vectors(tmp_path, monkeypatch) -> None:
    """As on a machine that has none; where this one has none either, nothing is compared."""
    flags = [*sources.FLAGS, "-DWBC_NARROW", "-fPIC", "-shared", "-o", tmp_path / "narrow.so"]
    subprocess.run(["cc", *flags, *sources.SOURCE.glob("*.c"), "-lm"], check=True)
    ffi = FFI()
    ffi.cdef(sources.declarations())
    narrow = {
        "ffi": ffi,
        "lib": ffi.dlopen(str(tmp_path / "narrow.so")),
        "doubles": partial(ffi.from_buffer, ffi.typeof("double[]")),
        "integers": partial(ffi.from_buffer, ffi.typeof("int64_t[]")),
    }
    rng, qps = np.random.default_rng(2), []
    for _ in range(100):
        qps.append(random_qp(rng))
    wide = [ActiveSet().solve(qp) for qp in qps]
    for name, value in narrow.items():
        monkeypatch.setattr(in_core, name, value)
    for qp, ours in zip(qps, wide, strict=True):
        theirs = ActiveSet().solve(qp)
        for field in ("x", "y", "z", "z_box"):
            np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
        assert ours.residuals == theirs.residuals


def test_rows_twice_and_nothing_left_to_decide_are_no_trouble() -> None:
    qp = random_qp(np.random.default_rng(1))
    n = qp.g.size
    contradictory = qp._replace(lower=np.full(n, 1.0), upper=np.full(n, 1.0))
    found = ActiveSet().solve(contradictory)
    assert found.status is Status.INFEASIBLE and not conflict_error(contradictory, found.conflict)
    twice = np.concatenate((qp.A, qp.A[:1]))
    labels = replace(qp.labels, equality=(*qp.labels.equality, "again"))
    dependent = qp._replace(A=twice, b=np.append(qp.b, qp.b[:1]), labels=labels)
    np.testing.assert_allclose(ActiveSet().solve(dependent).x, ActiveSet().solve(qp).x, atol=1e-9)
    whole = QP.build(np.eye(2), np.ones(2), A=np.eye(2), b=np.ones(2))
    np.testing.assert_allclose(ActiveSet().solve(whole).x, 1.0)
    point = ActiveSet().solve(whole._replace(lower=np.full(2, 2.0)))
    assert point.status is Status.INFEASIBLE and len(point.conflict.rows) == 2


def test_arrays_of_any_layout_are_read_as_they_are() -> None:
    qp = random_qp(np.random.default_rng(3))
    expected = ActiveSet().solve(qp)
    turned = qp._replace(P=np.asfortranarray(qp.P), C=np.asfortranarray(qp.C))
    np.testing.assert_array_equal(ActiveSet().solve(turned).x, expected.x)


@pytest.mark.parametrize("quick", [False, True])
def test_rows_that_contradict_each_other_are_named_also_in_a_hurry(quick: bool) -> None:
    """The proof is what the method ends with: no search, and so no hurry forbids it."""
    qp = QP.build(np.eye(3), np.ones(3), C=[[1.0, 0, 0], [-1.0, 0, 0]], u=[-1.0, -1.0])
    found = ActiveSet().solve(qp, quick=quick)
    assert found.status is Status.INFEASIBLE and found.solver == "active_set"
    assert {row.label for row in found.conflict.rows} == {"inequality 0", "inequality 1"}
    assert np.isnan(found.x).all() and np.isinf(found.residuals.primal)
    assert found.conflict.describe() in found.describe()


def test_equality_rows_that_contradict_each_other_are_named_in_a_hurry() -> None:
    """Two anchors for one foot: known once they are eliminated; rows twice are solved."""
    rows = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [2.0, 3.0, 0, 0]]
    qp = QP.build(np.eye(4), np.ones(4), A=rows, b=[1.0, 1.0, 5.1])
    found = ActiveSet().solve(qp, quick=True)
    assert found.status is Status.INFEASIBLE and len(found.conflict.rows) == 3
    assert not conflict_error(qp, found.conflict)
    twice = ActiveSet().solve(qp._replace(b=np.array([1.0, 1.0, 5.0])), quick=True)
    np.testing.assert_allclose(twice.x, [1.0, 1.0, -1.0, -1.0], atol=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_where_rows_give_out_a_cost_without_curvature_is_minimised(seed: int) -> None:
    """Singular P, a linear cost within rows and bounds: the least cost is that of HiGHS."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 12)), int(rng.integers(0, 9))
    C, inside = rng.normal(size=(m, n)), 0.5 * rng.uniform(-1, 1, size=n)
    u, g = C @ inside + rng.exponential(size=m), rng.normal(size=n)
    box = {"lower": np.full(n, -1.0), "upper": np.full(n, 1.0)}
    found = ActiveSet().solve(QP.build(np.zeros((n, n)), g, C=C, u=u, **box))
    assert found.solved, found.describe()
    best = linprog(g, A_ub=C if m else None, b_ub=u if m else None, bounds=[(-1.0, 1.0)] * n)
    # The gradient is met to 1e-8 n over a box of width 2.
    assert g @ found.x == pytest.approx(best.fun, abs=1e-6)


def test_a_cost_without_end_has_failed_and_is_no_conflict() -> None:
    found = ActiveSet().solve(QP.build(np.diag([1.0, 0.0]), [0.0, -1.0]))
    assert found.status is Status.FAILED and found.conflict is None and found.message


def test_a_cost_of_nothing_is_answered_by_the_rows_alone_and_not_by_what_memory_held() -> None:
    """Leftovers that happened to keep all rows were the answer, after -100 iterations."""
    n = 5
    qp = QP.build(np.zeros((n, n)), np.zeros(n), C=np.eye(n), l=np.full(n, -9.0), u=np.full(n, 9.0))
    for _ in range(20):
        left = [np.zeros(3 * n + 4) for _ in range(20)]  # as large as the memory of an answer
        for one in left:
            one[:n] = 1.0
        del left, one
        found = ActiveSet().solve(qp)
        assert found.solved
        assert found.iterations >= 0
        assert not found.x.any()


def test_a_backend_can_be_copied_once_it_has_solved() -> None:
    qp, backend = random_qp(np.random.default_rng(6)), ActiveSet()
    solution = backend.solve(qp)
    again = pickle.loads(pickle.dumps(backend)).solve(qp)
    np.testing.assert_array_equal(again.x, solution.x)
