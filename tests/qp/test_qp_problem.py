"""The check that guards every solver; solvers by name, what to install, what settings they take."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import qpsolvers

from tests.needs import needs_bench
from wbc.errors import InvalidInputError, SolverError, UnknownNameError
from wbc.qp import (
    QP,
    Labels,
    SolverNotInstalledError,
    Status,
    check_qp,
    installed_solvers,
    make_backend,
)
from wbc.qp.active_set import ActiveSet
from wbc.qp.qpsolvers_backend import QpsolversBackend

LABELS = Labels(("foot x",), ("friction", "pair"), ("base", "knee", "hip"))


def valid() -> QP:
    return QP.build(
        np.eye(3), np.ones(3), A=np.ones((1, 3)), b=[0.0], C=np.ones((2, 3)), l=[-np.inf, -1.0],
        u=[1.0, np.inf], lower=[-np.inf, -1.0, -1.0], upper=[np.inf, 1.0, 1.0], labels=LABELS,
    )  # fmt: skip


def test_a_valid_qp_passes_unchanged():
    qp = valid()
    before = {name: np.array(getattr(qp, name)) for name in ("P", "g", "A", "b", "C", "l", "u")}
    check_qp(qp)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(qp, name), value)


@pytest.mark.parametrize(
    ("field", "shape"),
    [("P", (3, 2)), ("A", (1, 2)), ("C", (3, 3)), ("l", (1,)), ("lower", (2,)), ("upper", (4,)),
     ("b", (1, 1))],
)  # fmt: skip
def test_wrong_shape_names_the_field(field, shape):
    with pytest.raises(InvalidInputError, match=rf"QP\.{field}: expected shape"):
        check_qp(valid()._replace(**{field: np.zeros(shape)}))


@pytest.mark.parametrize("field", ["equality", "inequality", "variables"])
def test_wrong_number_of_labels(field):
    labels = replace(LABELS, **{field: ("one", "two", "three", "four")})
    with pytest.raises(InvalidInputError, match=rf"QP\.labels\.{field}"):
        check_qp(valid()._replace(labels=labels))


@pytest.mark.parametrize(
    ("field", "index", "value", "name"),
    [
        ("lower", 1, 2.0, "knee"),
        ("upper", 2, -5.0, "hip"),
        ("lower", 0, np.inf, "base"),
        ("upper", 0, -np.inf, "base"),
        ("lower", 2, np.nan, "hip"),
        ("l", 0, 2.0, "friction"),
        ("u", 1, -2.0, "pair"),
        ("u", 0, np.nan, "friction"),
        ("l", 1, np.inf, "pair"),
    ],
)
def test_impossible_interval_names_the_row(field, index, value, name):
    qp = valid()
    bounds = np.array(getattr(qp, field))
    bounds[index] = value
    with pytest.raises(InvalidInputError, match=name):
        check_qp(qp._replace(**{field: bounds}))


def test_only_what_is_crossed_is_named():
    """Ends that are equal fix an unknown or a row; that is nothing wrong."""
    qp = valid()
    lower, upper = np.array(qp.lower), np.array(qp.upper)
    lower[0] = upper[0] = 0.5
    fixed = qp._replace(lower=lower, upper=upper)
    check_qp(fixed)
    with pytest.raises(InvalidInputError) as caught:
        check_qp(fixed._replace(upper=np.array([0.5, upper[1], lower[2] - 1.0])))
    told, names = str(caught.value), qp.labels.variables
    assert names[2] in told
    assert names[0] not in told


def test_entries_that_overflow_when_squared_are_refused():
    with pytest.raises(InvalidInputError, match=r"QP\.g: .*beyond 1e\+150.*'hip'"):
        check_qp(valid()._replace(g=np.array([0.0, 0.0, 1e160])))


def test_build_fills_in_what_is_left_out():
    qp = QP.build(np.eye(2), [1.0, 2.0], lower=[0.0, 0.0])
    assert qp.A.shape == qp.C.shape == (0, 2)
    assert qp.b.shape == qp.l.shape == qp.u.shape == (0,)
    np.testing.assert_array_equal(qp.upper, [np.inf, np.inf])
    assert qp.labels.variables == ("x0", "x1")


def test_build_refuses_a_cost_that_is_not_convex():
    """A saddle point was ``solved``; OSQP ended in an exception of its own."""
    box = {"lower": [-1.0, -1.0], "upper": [1.0, 1.0]}
    with pytest.raises(InvalidInputError, match=r"QP.P: .*positive semidefinite"):
        QP.build([[1.0, 0.0], [0.0, -1.0]], [0.0, 0.0], **box)
    rows = np.random.default_rng(0).standard_normal((3, 8)) * [[1e4], [1.0], [1e-4]]
    QP.build(rows.T @ rows, np.zeros(8))  # what rounding leaves below zero is none


def test_build_refuses_an_asymmetric_cost():
    with pytest.raises(InvalidInputError, match="symmetric"):
        QP.build([[2.0, 1.0], [0.0, 2.0]], [1.0, 1.0])
    with pytest.raises(InvalidInputError, match="symmetric"):
        QP.build([[1e12, 1.0], [0.0, 2.0]], [1.0, 1.0])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    cost = turn @ np.diag([3.7, 3.7]) @ turn.T
    assert cost[0, 1] != cost[1, 0]  # by 1e-16 of rounding
    QP.build(cost, [1.0, 1.0])


def test_a_qp_of_no_unknowns_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"QP\.g: no entries"):
        QP.build(np.zeros((0, 0)), [])


SMALL = QP.build(np.eye(2), [1.0, -1.0], lower=[0.0, 0.0])


def test_installed_solvers_can_all_be_made():
    assert set(installed_solvers()) >= {"active_set", "proxqp", "proxqp_cold"}
    for name in installed_solvers():
        assert make_backend(name).name == name


def test_unknown_solver_suggests_the_nearest():
    with pytest.raises(UnknownNameError, match=r"did you mean 'proxqp'.*choose from") as caught:
        make_backend("proxpq")
    assert not isinstance(caught.value, SolverNotInstalledError)


@pytest.mark.parametrize(
    ("name", "command"), [("osqp", r"wbc\[bench\]"), ("quadprog", r"qpsolvers\[quadprog\]")]
)
def test_known_but_missing_solver_says_what_to_install(monkeypatch, name, command):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["piqp"])
    with pytest.raises(SolverNotInstalledError, match=rf"pip install '{command}'") as caught:
        make_backend(name)
    assert "installed: active_set, piqp, proxqp, proxqp_cold" in str(caught.value)
    assert isinstance(caught.value, UnknownNameError) and caught.value.name == name
    assert isinstance(caught.value, SolverError) and "piqp" in caught.value.choices


def test_daqp_is_answered_by_a_method_of_its_kind_where_it_is_missing(monkeypatch, caplog) -> None:
    """Files that name it run as they are, and a log says who solves them; others are refused."""
    monkeypatch.setattr(qpsolvers, "available_solvers", ["piqp"])
    backend = make_backend("daqp", max_iterations=50)
    assert isinstance(backend, ActiveSet) and backend.solve(SMALL).solver == "active_set"
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "'daqp' is not installed" in caplog.text and "'active_set'" in caplog.text


@needs_bench
def test_daqp_itself_answers_where_it_is_installed(caplog) -> None:
    solution = make_backend("daqp").solve(SMALL)
    assert solution.solved and solution.solver == "daqp" and not caplog.records


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("proxqp", {"epsilon": 1e-6}),
        ("proxqp", {"eps": np.nan}),
        ("proxqp_cold", {"eps": -1.0}),
        ("active_set", {"always": True}),
        ("active_set", {"max_iterations": 2.7}),  # they were 2
    ],
)
def test_bad_settings_are_refused(name, settings):
    with pytest.raises(InvalidInputError, match=next(iter(settings))):
        make_backend(name, **settings)


def test_settings_reach_the_solver():
    loose, strict = make_backend("proxqp", eps=1e-2), make_backend("proxqp", eps=1e-10)
    qp = QP.build(np.diag([1.0, 1e-3]), [1.0, -1.0], A=[[1.0, 2.0]], b=[3.0], upper=[0.5, 9.0])
    assert strict.solve(qp).residuals.dual <= 1e-10
    assert loose.solve(qp).iterations < strict.solve(qp, workspace="other").iterations


def test_a_setting_the_solver_refuses_is_an_error(monkeypatch):
    def refuse(problem, solver, **settings):
        raise TypeError(f"unexpected keyword {next(iter(settings))!r}")

    monkeypatch.setattr(qpsolvers, "solve_problem", refuse)
    with pytest.raises(SolverError, match="no_such_setting"):
        QpsolversBackend("quadprog", no_such_setting=1.0).solve(SMALL)


@needs_bench
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("osqp", {"max_iterations": 5}),  # every QP had failed
        ("osqp", {"max_iter": -1}),  # OSQPException
        ("piqp", {"max_iterations": 5}),  # left out, in silence
        ("clarabel", {"max_iter": -1}),  # OverflowError
        ("daqp", {"max_iter": 5}),
    ],
)
def test_settings_that_a_solver_does_not_know_are_refused_at_once(name, settings):
    with pytest.raises(SolverError, match=r"refused its settings .*max_iter"):
        make_backend(name, **settings)
    assert make_backend(name, verbose=False).solve(SMALL).solved


@pytest.mark.parametrize("name", installed_solvers())
def test_numbers_of_other_types_are_solved(name):
    """DAQP had failed: it takes doubles only."""
    one = QP.build(np.eye(2), [1.0, 2.0], C=[[1.0, 1.0]], l=[0.5])
    other = one._replace(P=np.eye(2, dtype=np.float32), g=np.array([1, 2]), C=np.array([[1, 1]]))
    found = make_backend(name).solve(other)
    assert found.solved, found.describe()
    np.testing.assert_allclose(found.x, [0.75, -0.25], atol=1e-6)


def test_a_solver_that_raises_has_failed_and_says_why(monkeypatch):
    def refuse(problem, solver, **settings):
        raise ValueError("matrix is not to my taste")

    monkeypatch.setattr(qpsolvers, "solve_problem", refuse)
    solution = QpsolversBackend("piqp").solve(SMALL)
    assert solution.status is Status.FAILED
    assert np.isnan(solution.x).all()
    assert "not to my taste" in solution.describe()


@pytest.mark.parametrize("found", [True, False])
@pytest.mark.parametrize(
    ("extras", "iterations"),
    [({"iterations": np.array([7, 9])}, 7), ({"info": SimpleNamespace(iter=5)}, 5), ({}, 0)],
)
def test_what_a_solver_says_of_its_answer_is_passed_on(
    monkeypatch, found: bool, extras: dict[str, object], iterations: int
) -> None:
    """A point that it does not call a solution is none to us, and is still looked at."""

    def solve(problem, solver, **settings):
        return qpsolvers.Solution(
            problem=problem, found=found, x=np.array([0.0, 1.0]), extras=extras,
            z_box=np.array([-1.0, 0.0]),
        )  # fmt: skip

    monkeypatch.setattr(qpsolvers, "solve_problem", solve)
    raw = QpsolversBackend("piqp").answer(SMALL)
    assert raw.claim is (Status.SOLVED if found else Status.FAILED)
    assert raw.message == ("" if found else "no solution found")
    assert raw.iterations == iterations
    np.testing.assert_array_equal(raw.x, [0.0, 1.0])
    np.testing.assert_array_equal(raw.z_box, [-1.0, 0.0])


@pytest.mark.skipif("osqp" not in installed_solvers(), reason="needs wbc[bench]")
def test_quick_attempts_are_short():
    """Within the cap, on a QP that takes more; what is asked for without hurry is solved."""
    rng, n = np.random.default_rng(3), 8
    J, C = rng.normal(size=(4, n)), rng.normal(size=(6, n))
    P, one = 1e4 * J.T @ J + 1e-6 * np.eye(n), np.ones(n)
    g = rng.normal(size=n) * 10.0
    qp = QP.build(0.5 * (P + P.T), g, C=C, l=-one[:6], u=0.1 * one[:6], lower=-one, upper=one)
    backend, own = make_backend("osqp"), make_backend("osqp", max_iter=25)
    patient, quick = backend.solve(qp), backend.solve(qp, quick=True)
    assert patient.solved and patient.iterations > 800
    assert quick.iterations <= 400 and not quick.solved
    assert own.solve(qp, quick=True).iterations <= 25  # a setting of the user's stands
