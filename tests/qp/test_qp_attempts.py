"""How many attempts an answer took, and whose it is: all ways through ProxQP, each scripted."""

import numpy as np
import pytest

from wbc.qp import QP, core
from wbc.qp.active_set import NO_RESIDUALS, ActiveSet
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.proxqp import BOUNDED_WARM_ITERATIONS, COOLDOWN, WARM_ITERATIONS, ProxQP
from wbc.qp.proxqp_workspace import Workspace
from wbc.qp.solution import RawSolution, Solution, Status

# What is answered by ProxQP warm (None: it is not warm), from nothing, and by the active-set
# method; then the attempts that are told, and the solver. "near" is settled by a step of an
# active-set method.
WAYS = [
    ((None, "right", ""), (1, "proxqp")),
    (("right", "", ""), (1, "proxqp")),
    ((None, "wrong", "right"), (2, "active_set")),
    ((None, "near", "right"), (2, "active_set")),
    (("wrong", "", "right"), (2, "active_set")),
    (("near", "", "wrong"), (3, "proxqp")),
    ((None, "near", "wrong"), (3, "proxqp")),
    ((None, "wrong", "wrong"), (3, "proxqp")),
    (("wrong", "", "wrong"), (3, "proxqp")),
]


def script(qp: QP, monkeypatch, warm, cold, active) -> Solution:
    """Have solvers answer as scripted; return the true solution."""
    true = ActiveSet(1e-10).solve(qp)
    right = RawSolution(true.x, true.y, true.z, true.z_box, Status.SOLVED, 3, "")
    wrong = RawSolution.none(qp, Status.FAILED, "nothing")
    near = right._replace(x=right.x + 1e-6, y=right.y + 1e-6)
    answers = {"right": right, "near": near, "wrong": wrong}
    none = Solution(*wrong[:4], Status.FAILED, NO_RESIDUALS, 0, 0.0, "active_set")
    if warm is not None:
        monkeypatch.setattr(Workspace, "solve_warm", lambda *_: answers[warm])
    if cold:
        monkeypatch.setattr(Workspace, "solve_cold", lambda *_: answers[cold])
    exact = true if active == "right" else none
    monkeypatch.setattr(ActiveSet, "solve", lambda *_, **__: exact)
    return true


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize(("answers", "told"), WAYS)
def test_attempts_are_counted_and_the_solver_named(
    answers, told, quick, solvable, monkeypatch
) -> None:
    """``quick``: what the active-set method says stands, and nothing is settled afterwards."""
    qp = solvable(np.random.default_rng(5), me=2, mi=3)
    backend, warm = ProxQP(), answers[0]
    if warm is not None:
        assert backend.solve(qp).attempts == 1
    true = script(qp, monkeypatch, *answers)
    found = backend.solve(qp, quick=quick)
    if quick and told[0] == 3:
        assert (found.attempts, found.solver, found.solved) == (2, "active_set", False)
        return
    assert (found.attempts, found.solver) == told
    assert found.solved == ({"right", "near"} & set(answers) != set())
    if found.solved:
        np.testing.assert_allclose(found.x, true.x, atol=1e-8)


@pytest.mark.parametrize(
    ("active", "told"), [("right", (1, "active_set")), ("wrong", (1, "proxqp"))]
)
def test_what_will_not_come_again_is_asked_of_the_active_set_method_first(
    active, told, solvable, monkeypatch
) -> None:
    qp = solvable(np.random.default_rng(5), me=2, mi=3)
    script(qp, monkeypatch, None, "right", active)
    found = ProxQP().solve(qp, workspace=None)
    assert found.solved and (found.attempts, found.solver) == told


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
    """Not at all in a hurry."""
    qp, looked = solvable(np.random.default_rng(5), me=2, mi=3), list[int]()
    backend = ProxQP()
    if warm:
        backend.solve(qp)
    nothing = RawSolution.none(qp, Status.ITERATION_LIMIT, "nothing")
    for name in ("solve_warm", "solve_cold"):
        monkeypatch.setattr(Workspace, name, lambda *_: nothing)
    monkeypatch.setattr(
        "wbc.qp.active_set.solve_in_core",
        lambda qp, *_: core.CoreAnswer(-1, *nothing[:4], NO_RESIDUALS, -100),
    )
    monkeypatch.setattr("wbc.qp.active_set.find_conflict", lambda *_, **__: looked.append(1))
    monkeypatch.setattr("wbc.qp.kkt.find_conflict", lambda *_, **__: looked.append(1))
    assert backend.solve(qp, quick=True).attempts and not looked
    for times in (1, 2, 3):
        found = backend.solve(qp)
        assert not found.solved and found.conflict is None and len(looked) == times


@pytest.mark.parametrize("most", [4, 8, 1000])
def test_warm_solves_are_given_up_sooner_than_cold_ones(most: int) -> None:
    backend = ProxQP(max_iterations=most)
    qp = QP.build(np.eye(3), np.ones(3), upper=np.ones(3))
    assert backend.solve(qp).solver == "proxqp"
    (kept,) = backend._workspaces.values()
    assert kept.native.settings.max_iter == min(WARM_ITERATIONS, most)


class Reduced:
    """A QP without equalities as a tick has it, judged by its KKT conditions."""

    def __init__(self, qp: QP) -> None:
        self.qp, self.iterations, self.x, self.asked = qp, 0, None, 0

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        x, z = np.frombuffer(x), np.frombuffer(z) / scale
        rows, box = np.split(z, [self.qp.u.size])
        point = x, np.zeros(0), rows, box
        if not acceptable(kkt_residuals(self.qp, *point), 1e-8, self.qp, *point):
            return False
        self.x, self.iterations = x, iterations
        return True

    def solve(self) -> bool:
        self.asked += 1
        found = ActiveSet().solve(self.qp, quick=True)
        self.x, self.iterations = found.x, found.iterations
        return found.solved


@pytest.fixture
def reduced(solvable):
    return Reduced(solvable(np.random.default_rng(5), me=0, mi=3))


def test_a_tick_is_solved_from_the_last_one(reduced, monkeypatch) -> None:
    """From nothing the active-set method looks whether there is a solution at all."""
    backend, bounded = ProxQP(), False
    assert backend.solve_reduced(reduced, "a", bounded) == ("proxqp", 2) and reduced.asked == 1
    expected = reduced.x.copy()
    assert backend.solve_reduced(reduced, "a", bounded) == ("proxqp", 1) and reduced.asked == 1
    np.testing.assert_allclose(reduced.x, expected, atol=1e-7)
    assert backend.solve_reduced(reduced, "b", bounded) == ("proxqp", 2)  # another name
    cold = ProxQP(warm=False)
    for _ in range(2):
        assert cold.solve_reduced(reduced, "a", bounded) == ("proxqp_cold", 2)


def test_a_tick_without_a_solution_is_not_asked_of_proxqp(reduced, monkeypatch) -> None:
    monkeypatch.setattr(Workspace, "create", lambda *_, **__: pytest.fail("asked"))
    qp = reduced.qp
    none = Reduced(qp._replace(C=np.repeat(qp.C[:1], 3, axis=0), l=np.array([-1.0, -1.0, 5.0]),
                   u=np.array([0.0, 9.0, 6.0])))  # fmt: skip
    assert ProxQP().solve_reduced(none, "a", True) is None


@pytest.mark.parametrize(("hard", "solver"), [(-1, "active_set"), (1000, "proxqp")])
@pytest.mark.parametrize("bounded", [False, True])
def test_what_was_hard_for_the_active_set_method_is_not_asked_of_both(
    hard: int, solver: str, bounded: bool, reduced, monkeypatch
) -> None:
    monkeypatch.setattr("wbc.qp.proxqp.BOUNDED_HARD" if bounded else "wbc.qp.proxqp.HARD", hard)
    backend = ProxQP()
    found = backend.solve_reduced(reduced, "a", bounded)
    assert found is not None and found.solver == solver
    assert len(backend._workspaces) == (solver == "proxqp")


@pytest.mark.parametrize(
    ("bounded", "least"), [(False, WARM_ITERATIONS), (True, BOUNDED_WARM_ITERATIONS)]
)
def test_warm_ticks_are_given_up_sooner_where_they_are_relaxed(bounded, least, reduced) -> None:
    backend = ProxQP()
    assert backend.solve_reduced(reduced, "a", bounded).solver == "proxqp"
    (kept,) = backend._workspaces.values()
    assert kept.native.settings.max_iter == least


def test_what_is_far_from_the_last_qp_is_no_warm_start_where_ticks_are_relaxed(reduced) -> None:
    """From there ProxQP was rejected after up to 9 ms; the active-set method answers first."""
    qp, backend = reduced.qp, ProxQP()
    near, far = Reduced(qp._replace(g=1.001 * qp.g)), Reduced(qp._replace(g=-2.0 * qp.g))
    assert backend.solve_reduced(reduced, "a", True) == ("proxqp", 2)
    assert backend.solve_reduced(near, "a", True) == ("proxqp", 1)
    assert backend.solve_reduced(far, "a", True) == ("proxqp", 2) and far.asked == 1
    patient, far = ProxQP(), Reduced(far.qp)
    patient.solve_reduced(reduced, "a", False)
    assert patient.solve_reduced(far, "a", False) in (("proxqp", 1), ("active_set", 2))


def test_ticks_that_stall_are_the_active_set_methods_for_a_while(reduced, monkeypatch) -> None:
    """A hundred of that name; of others none; then ProxQP is asked again."""
    backend = ProxQP(max_iterations=1)
    assert backend.solve_reduced(reduced, "a", False).solver == "active_set"
    made: list[int] = []
    honest = Workspace.create
    monkeypatch.setattr(Workspace, "create", lambda *a, **k: made.append(1) or honest(*a, **k))
    for _ in range(COOLDOWN):
        assert backend.solve_reduced(reduced, "a", False) == ("active_set", 1)
    assert not made
    backend.solve_reduced(reduced, "b", False)
    backend.solve_reduced(reduced, "a", False)
    assert len(made) == 2
