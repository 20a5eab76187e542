"""QPs solved in the native core, equalities eliminated, against the same in Python."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from tests.needs import needs_core, needs_direct_daqp
from wbc.errors import InvalidInputError
from wbc.native import VARIABLE, Core, build
from wbc.qp.daqp import Daqp
from wbc.qp.kkt import kkt_residuals
from wbc.qp.native_daqp import NativeDaqp, native_daqp
from wbc.qp.problem import QP
from wbc.qp.solution import Status

pytestmark = [needs_core, needs_direct_daqp]


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


def in_python(qp: QP, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setenv(VARIABLE, "off")
        return Daqp().solve(qp)


def test_the_same_answer_as_in_python(monkeypatch) -> None:
    rng, active, native = np.random.default_rng(0), 0, native_daqp(1e-8, 1000)
    for _ in range(150):
        qp = random_qp(rng)
        ours, theirs = native.solve(qp, "daqp"), in_python(qp, monkeypatch)
        assert theirs.solved
        assert ours is not None
        # Curvature 1e-3 beside 1e2: an error of 1e-10 in the gradient moves x by 1e-7.
        scale = max(1.0, np.abs(theirs.x).max())
        np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-7 * scale)
        again = kkt_residuals(qp, ours.x, ours.y, ours.z, ours.z_box)
        for field in ("primal", "dual", "complementarity"):
            found = getattr(ours.residuals, field)
            assert found <= 1e-8
            assert found == pytest.approx(getattr(again, field), abs=1e-11)
        active += np.count_nonzero(ours.z) + np.count_nonzero(ours.z_box)
    assert active > 500


def test_unknowns_that_no_equality_has(monkeypatch) -> None:
    """As arms, where feet are held: wherever they stand among the others."""
    rng, native, n = np.random.default_rng(5), native_daqp(1e-8, 1000), 30
    for _ in range(40):
        A, C, J = (rng.normal(size=(rows, n)) for rows in (8, 5, n))
        A[:, rng.permutation(n)[: int(rng.integers(1, 20))]] = 0.0
        x, g, room = rng.normal(size=n), 10.0 * rng.normal(size=n), rng.exponential(size=n)
        rows = {"A": A, "b": A @ x, "C": C, "l": C @ x - 1.0, "u": C @ x + 1.0}
        qp = QP.build(J.T @ J + np.eye(n), g, **rows, lower=x - room, upper=x + room)
        ours, theirs = native.solve(qp, "daqp"), in_python(qp, monkeypatch)
        assert theirs.solved
        np.testing.assert_allclose(ours.x, theirs.x, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_the_same_bits_without_wide_vectors(tmp_path, monkeypatch) -> None:
    """As on a machine that has none; where this one has none either, nothing is compared."""
    monkeypatch.setattr(build, "FLAGS", (*build.FLAGS, "-DWBC_NARROW"))
    build._compile(build.find_compiler(), tmp_path / "narrow.so")
    rng, narrow = np.random.default_rng(2), NativeDaqp(Core(tmp_path / "narrow.so"), 1e-8, 1000)
    wide = native_daqp(1e-8, 1000)
    for _ in range(100):
        qp = random_qp(rng)
        ours, theirs = wide.solve(qp, "daqp"), narrow.solve(qp, "daqp")
        for field in ("x", "y", "z", "z_box"):
            np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
        assert ours.residuals == theirs.residuals


def test_what_has_no_small_residuals_is_left_to_python(monkeypatch) -> None:
    qp = random_qp(np.random.default_rng(1))
    n = qp.g.size
    native = native_daqp(1e-8, 1000)
    contradictory = qp._replace(lower=np.full(n, 1.0), upper=np.full(n, 1.0))
    assert native.solve(contradictory, "daqp") is None
    assert Daqp().solve(contradictory).status is Status.INFEASIBLE
    twice = np.concatenate((qp.A, qp.A[:1]))
    labels = replace(qp.labels, equality=(*qp.labels.equality, "again"))
    dependent = qp._replace(A=twice, b=np.append(qp.b, qp.b[:1]), labels=labels)
    assert native.solve(dependent, "daqp") is None
    assert Daqp().solve(dependent).status is in_python(dependent, monkeypatch).status
    whole = QP.build(np.eye(2), np.ones(2), A=np.eye(2), b=np.ones(2))
    assert native.solve(whole, "daqp") is None  # nothing is left to decide
    assert Daqp().solve(whole).solved


@pytest.mark.parametrize("field", ["P", "g", "A", "b", "C", "l", "lower", "upper"])
def test_what_is_no_qp_is_refused_as_ever(field: str) -> None:
    qp = random_qp(np.random.default_rng(2))
    assert qp.b.size and qp.u.size
    bad = getattr(qp, field).copy()
    bad.reshape(-1)[0] = np.nan
    wrong = [qp._replace(**{field: bad})]
    if field != "P":
        wrong.append(qp._replace(**{field: getattr(qp, field)[:-1]}))
    if field in ("l", "lower"):
        bad = bad.copy()
        bad[0] = np.inf
        wrong.append(qp._replace(**{field: bad}))
    for one in wrong:
        with pytest.raises(InvalidInputError, match=field):
            Daqp().solve(one)


def test_arrays_of_any_layout_are_read_as_they_are() -> None:
    qp = random_qp(np.random.default_rng(3))
    expected = Daqp().solve(qp)
    turned = qp._replace(P=np.asfortranarray(qp.P), C=np.asfortranarray(qp.C))
    np.testing.assert_array_equal(Daqp().solve(turned).x, expected.x)


def test_another_answer_is_asked_for() -> None:
    class Other(Daqp):
        """Answers what it likes."""

        def answer(self, qp):
            raise RuntimeError("asked")

    with pytest.raises(RuntimeError, match="asked"):
        Other().solve(random_qp(np.random.default_rng(4)))


def test_without_the_core_there_is_none(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "off")
    assert native_daqp(1e-8, 1000) is None


def test_what_is_not_solved_is_not_asked_again_in_a_hurry(monkeypatch) -> None:
    """The exit flag of the reduced QP stands; patiently Python is asked."""
    qp = QP.build(np.eye(3), np.ones(3), C=[[1.0, 0, 0], [-1.0, 0, 0]], u=[-1.0, -1.0])
    asked = []
    monkeypatch.setattr("wbc.qp.daqp.daqp_memory", lambda *args: asked.append(args))
    backend = Daqp()
    solution = backend.solve(qp, quick=True)
    assert solution.status is Status.FAILED and not asked
    assert solution.conflict is None and "in a hurry" in solution.message
    assert np.isnan(solution.x).all() and np.isinf(solution.residuals.primal)
    with pytest.raises(AttributeError):  # what was asked gave nothing here
        backend.solve(qp)
    assert asked


def test_equality_rows_that_contradict_each_other_need_no_solver_in_a_hurry(monkeypatch) -> None:
    """Two anchors for one foot: known once they are eliminated; rows twice are asked for."""
    rows, asked = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [2.0, 3.0, 0, 0]], []
    qp = QP.build(np.eye(4), np.ones(4), A=rows, b=[1.0, 1.0, 5.1])
    monkeypatch.setattr("wbc.qp.daqp.daqp_memory", lambda *args: asked.append(args))
    assert Daqp().solve(qp, quick=True).status is Status.FAILED and not asked
    monkeypatch.undo()
    assert Daqp().solve(qp).status is Status.INFEASIBLE
    twice = Daqp().solve(qp._replace(b=np.array([1.0, 1.0, 5.0])), quick=True)
    np.testing.assert_allclose(twice.x, [1.0, 1.0, -1.0, -1.0], atol=1e-8)


def test_a_backend_can_be_copied_once_it_has_solved() -> None:
    """It keeps the core's solver, which where it is copied to may be another one."""
    qp, backend = random_qp(np.random.default_rng(6)), Daqp()
    solution = backend.solve(qp)
    again = pickle.loads(pickle.dumps(backend)).solve(qp)
    np.testing.assert_array_equal(again.x, solution.x)
