"""Ticks without equalities through ProxQP: from the last one, stalled, or without a solution."""

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.active_set import ActiveSet, proximal
from wbc.qp.core import CoreSolution, solve_in_core
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.proxqp import COOLDOWN, ProxQP
from wbc.qp.proxqp_workspace import Workspace


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
    assert backend.solve_reduced(reduced, "a", False) == ("active_set", 3)
    made: list[int] = []
    honest = Workspace.create
    monkeypatch.setattr(Workspace, "create", lambda *a, **k: made.append(1) or honest(*a, **k))
    for _ in range(COOLDOWN):
        assert backend.solve_reduced(reduced, "a", False) == ("active_set", 1)
    assert not made
    backend.solve_reduced(reduced, "b", False)
    backend.solve_reduced(reduced, "a", False)
    assert len(made) == 2


def test_proximal_step_beyond_all_rows_leaves_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    box = {"lower": np.zeros(2), "upper": np.ones(2)}
    qp = QP.build(np.zeros((2, 2)), np.ones(2), C=[[1.0, 1.0]], l=[1.0], u=[2.0], **box)

    def thrown(qp: QP, eps: float, most: int, give: np.ndarray | None) -> CoreSolution:
        found = solve_in_core(qp, eps, most, give)
        far = found.residuals._replace(primal=1e22)
        return found._replace(x=np.full(2, 1e200), residuals=far)

    assert proximal(qp, 1e-8, 100) is not None
    monkeypatch.setattr("wbc.qp.active_set.solve_in_core", thrown)
    assert proximal(qp, 1e-8, 100) is None
