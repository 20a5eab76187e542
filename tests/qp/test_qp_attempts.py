"""How many attempts an answer took, and whose it is: all ways through ProxQP, each scripted."""

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.daqp import Daqp
from wbc.qp.native import Workspace
from wbc.qp.proxqp import QUICK_WARM_ITERATIONS, WARM_ITERATIONS, ProxQP
from wbc.qp.solution import RawSolution, Status

# What is answered by ProxQP warm (None: it is not warm), by DAQP and by ProxQP cold; then
# the attempts that are told, and the solver. "near" is settled by a step of an active-set method.
WAYS = [
    ((None, "", "right"), (1, "proxqp")),
    (("right", "", ""), (1, "proxqp")),
    ((None, "right", "wrong"), (2, "daqp")),
    (("wrong", "right", ""), (2, "daqp")),
    ((None, "near", "wrong"), (2, "daqp")),
    (("wrong", "near", "wrong"), (2, "daqp")),
    (("wrong", "wrong", "right"), (3, "proxqp")),
    (("near", "wrong", "right"), (3, "proxqp")),
    ((None, "wrong", "near"), (4, "proxqp")),
    (("wrong", "wrong", "near"), (4, "proxqp")),
    ((None, "wrong", "wrong"), (4, "proxqp")),
    (("wrong", "wrong", "wrong"), (4, "proxqp")),
]


@pytest.mark.parametrize(("answers", "told"), WAYS)
def test_attempts_are_counted_and_the_solver_named(answers, told, solvable, monkeypatch) -> None:
    qp = solvable(np.random.default_rng(5), me=2, mi=3)
    true = Daqp(1e-10).solve(qp)
    right = RawSolution(true.x, true.y, true.z, true.z_box, Status.SOLVED, 3, "")
    scripted = {
        "right": right,
        "near": right._replace(x=right.x + 1e-6, y=right.y + 1e-6),
        "wrong": RawSolution.none(qp, Status.FAILED, "nothing"),
    }
    backend, (warm, active, cold) = ProxQP(), answers
    if warm is not None:
        assert backend.solve(qp).attempts == 1
        monkeypatch.setattr(Workspace, "solve_warm", lambda *_: scripted[warm])
    for name in ("answer", "finer"):
        monkeypatch.setattr(Daqp, name, lambda *_: scripted[active])
    monkeypatch.setattr(Workspace, "solve_cold", lambda *_: scripted[cold])
    found = backend.solve(qp)
    assert (found.attempts, found.solver) == told
    assert found.solved == (set(answers) != {"wrong"} and answers != (None, "wrong", "wrong"))
    if found.solved:
        np.testing.assert_allclose(found.x, true.x, atol=1e-8)


QUICKLY = [
    ((None, "right", "right"), (1, "proxqp")),
    ((None, "right", "wrong"), (1, "daqp")),  # it was asked first
    ((None, "wrong", "right"), (1, "daqp")),  # and says that there is none
    (("right", "wrong", "wrong"), (1, "proxqp")),
    (("wrong", "right", "wrong"), (2, "daqp")),
    (("wrong", "wrong", "right"), (2, "daqp")),
]


@pytest.mark.parametrize(("answers", "told"), QUICKLY)
def test_attempts_in_bounded_time(answers, told, solvable, monkeypatch) -> None:
    qp = solvable(np.random.default_rng(5), me=2, mi=3)
    true = Daqp(1e-10).solve(qp)
    scripted = {"right": RawSolution(true.x, true.y, true.z, true.z_box, Status.SOLVED, 3, ""),
                "wrong": RawSolution.none(qp, Status.FAILED, "nothing")}  # fmt: skip
    backend, (warm, active, cold) = ProxQP(), answers
    if warm is not None:
        backend.solve(qp)
        monkeypatch.setattr(Workspace, "solve_warm", lambda *_: scripted[warm])
    for name in ("answer", "finer"):
        monkeypatch.setattr(Daqp, name, lambda *_: scripted[active])
    monkeypatch.setattr(Workspace, "solve_cold", lambda *_: scripted[cold])
    found = backend.solve(qp, quick=True)
    assert (found.attempts, found.solver) == told
    assert found.solved == ("right" in (warm, active)) and found.conflict is None
    monkeypatch.setattr(Daqp, "solve_natively", lambda *_: None)
    once = backend.solve(qp, workspace=None, quick=True)
    assert (once.attempts, once.solver, once.solved) == (1, "daqp", active == "right")


@pytest.mark.parametrize("most", [3e-13, 1e-6, 0.3, 0.5, 0.75, 1.0, 1.7, 3.0, 1e5])
def test_costs_below_one_are_scaled_by_a_power_of_two_warm_as_well(most: float, rng) -> None:
    """To a largest curvature in [1, 2); multipliers are those of the QP as it was given."""
    C = rng.normal(size=(2, 4))
    for again in (False, True):
        P = most * np.diag([1.0, 0.5, 0.7, 0.9])
        qp = QP.build(P, most * rng.normal(size=4), C=C, l=np.full(2, 0.5), u=np.ones(2))
        if not again:
            workspace = Workspace.create(qp, 1e-10, 1000)
            found = workspace.solve_cold()
            if most >= 1.0 or most < 1e-12:
                assert workspace.scale == 1.0
            else:
                assert 1.0 <= workspace.scale * most < 2.0 and np.log2(workspace.scale) % 1.0 == 0.0
        else:
            found = workspace.solve_warm(qp)
        if most > 1e-12:
            gradient = P @ found.x + qp.g + C.T @ found.z
            np.testing.assert_allclose(gradient, 0.0, atol=1e-7 * most)


@pytest.mark.parametrize("warm", [False, True])
def test_rows_in_conflict_are_looked_for_once_if_none_are_found(
    warm, solvable, monkeypatch
) -> None:
    """Also where the active-set method, asked first in a pause, says that there are some."""
    qp, looked = solvable(np.random.default_rng(5), me=2, mi=3), list[int]()
    backend = ProxQP()
    if warm:
        backend.solve(qp)
    nothing = RawSolution.none(qp, Status.ITERATION_LIMIT, "nothing")
    for name in ("solve_warm", "solve_cold"):
        monkeypatch.setattr(Workspace, name, lambda *_: nothing)
    claimed = nothing._replace(claim=Status.INFEASIBLE)
    for name in ("answer", "finer"):
        monkeypatch.setattr(Daqp, name, lambda *_: claimed)
    monkeypatch.setattr("wbc.qp.kkt.find_conflict", lambda *_, **__: looked.append(1))
    assert backend.solve(qp, quick=True).attempts and not looked
    for times in (1, 2, 3):
        found = backend.solve(qp)
        assert not found.solved and found.conflict is None and len(looked) == times


@pytest.mark.parametrize(
    ("quick", "least"), [(False, WARM_ITERATIONS), (True, QUICK_WARM_ITERATIONS)]
)
@pytest.mark.parametrize("most", [4, 8, 1000])
def test_warm_solves_are_given_up_sooner_than_cold_ones(most: int, quick: bool, least: int) -> None:
    backend = ProxQP(max_iterations=most)
    qp = QP.build(np.eye(3), np.ones(3), upper=np.ones(3))
    assert backend.solve(qp, quick=quick).solver == "proxqp"
    (kept,) = backend._workspaces.values()
    assert kept.native.settings.max_iter == min(least, most)


@pytest.mark.parametrize(("hard", "solver"), [(-1, "daqp"), (1000, "proxqp")])
def test_what_was_hard_for_the_active_set_method_is_not_asked_of_both(
    hard: int, solver: str, solvable, monkeypatch
) -> None:
    """In a hurry and from nothing; the answer is the active-set method's, and right."""
    monkeypatch.setattr("wbc.qp.proxqp.QUICK_HARD", hard)
    qp, backend = solvable(np.random.default_rng(5), me=2, mi=3), ProxQP()
    found = backend.solve(qp, quick=True)
    assert found.solved and found.solver == solver
    assert len(backend._workspaces) == (solver == "proxqp")


def test_what_is_far_from_the_last_qp_is_no_warm_start_in_a_hurry(solvable, monkeypatch) -> None:
    """From there ProxQP was rejected after up to 9 ms; the active-set method answers first."""
    rng, backend, warm = np.random.default_rng(6), ProxQP(), []
    qp = solvable(rng, me=2, mi=3)
    honest = Workspace.run
    monkeypatch.setattr(Workspace, "run", lambda self, *qps: (warm.append(1), honest(self, *qps)))
    near, far = qp._replace(g=1.1 * qp.g), qp._replace(g=-2.0 * qp.g)
    assert backend.solve(qp, quick=True).solved and not warm
    assert backend.solve(near, quick=True).solved and len(warm) == 1
    assert backend.solve(far, quick=True).solved and len(warm) == 1
    patient = ProxQP()
    assert patient.solve(qp).solved and patient.solve(far).solved and len(warm) == 2
