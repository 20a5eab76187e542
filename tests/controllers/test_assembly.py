"""Rows of single unknowns cost the QP less, and say the same."""

import numpy as np
import pytest

from wbc.constraints.rows import Bounds
from wbc.controllers.plan import RECOVERY_FACTOR, Assembled, Decision, assemble
from wbc.laws import Residual, Rows, VelocityLaw
from wbc.qp.problem import Labels
from wbc.robot import Robot
from wbc.tasks import DampingTask, PostureTask

N, NV = 9, 7  # unknowns, those that are velocities


def decision() -> Decision:
    names = tuple(f"x{k}" for k in range(N))
    free = np.full(N - NV, np.inf)
    return Decision(names, NV, 1e-3 * np.arange(1.0, N + 1.0), -free, free)


@pytest.mark.parametrize("others", [0, 2])
@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("columns", [np.array([1, 4, 6]), slice(4, NV)])
def test_rows_of_the_identity_make_the_qp_that_their_matrix_makes(others, curved, columns) -> None:
    rng = np.random.default_rng(others)
    single = Rows(np.eye(NV)[columns], rng.normal(size=3), rng.uniform(0.5, 2.0, 3), damping=0.1)
    if curved:
        square = rng.normal(size=(NV, NV))
        single = single._replace(curvature=square + square.T)
    dense = [
        Rows(rng.normal(size=(2, n)), rng.normal(size=2), np.array([3.0, 0.5]))
        for n in (NV, N)[:others]  # about velocities, then about all
    ]
    box = np.full(NV, -1.0), np.full(NV, 1.0)
    rest = rng.normal(size=N)
    labels = Labels((), (), decision().names)
    made = [
        assemble(decision(), [*dense, one], [], box, None, labels, rest)
        for one in (single, single._replace(columns=columns))
    ]
    # Sums of a few products of numbers near 1, in another order.
    np.testing.assert_allclose(made[1].P, made[0].P, atol=1e-13)
    np.testing.assert_allclose(made[1].g, made[0].g, atol=1e-13)
    assert np.abs(made[1].P - made[1].P.T).max() < 1e-13


@pytest.mark.parametrize("joints", [None, {"*knee*": 0.0}])
def test_tasks_of_single_unknowns_say_which(joints) -> None:
    robot = Robot.load("hoap2_like")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    for task in (PostureTask(robot, q, joints=joints), DampingTask(robot, joints=joints)):
        residual: Residual = task.residual(here)
        assert np.array_equal(np.eye(robot.nv)[residual.columns], residual.jacobian)
        wider = np.zeros(robot.nv + 5)  # there may be unknowns behind the velocity
        wider[residual.columns] = 1.0
        assert wider.sum() == len(residual.error)
        rows = VelocityLaw().rows(residual, task.weight, 0.01)
        assert np.array_equal(np.eye(robot.nv)[rows.columns], rows.matrix)


@pytest.mark.parametrize("behind", [0, N - NV])
def test_inequality_rows_and_a_box_are_put_on_a_qp_that_was_made_before(behind: int, rng) -> None:
    """Oracle: the cost and the rows by their definitions, at random points."""
    n = NV + behind
    names = tuple(f"x{k}" for k in range(n))
    free = np.full(behind, 3.0)
    known = Decision(names, NV, 1e-3 * np.arange(1.0, n + 1.0), -free, free)
    cost = Rows(rng.normal(size=(4, n)), rng.normal(size=4), rng.uniform(0.5, 2.0, 4))
    held = Rows(rng.normal(size=(1, NV)), rng.normal(size=1), np.ones(1))
    wide = np.full(NV, -9.0), np.full(NV, 9.0)
    qp = assemble(known, [cost], [held], wide, None, Labels(("held",), (), names))
    box = rng.uniform(-2.0, -1.0, NV), rng.uniform(1.0, 2.0, NV)
    push = Rows(rng.normal(size=(2, NV)), rng.normal(size=2), np.array([1.0, 3.0]))
    bounds = Bounds(
        ("a", "b"), rng.normal(size=(2, NV)), -np.ones(2), np.array([1.0, np.inf]), push
    )
    heaviest = 7.0
    found = Assembled(qp, heaviest).bounded(bounds, box)
    plain = Assembled(qp, heaviest).bounded(None, box)
    np.testing.assert_array_equal(found.lower, [*box[0], *-free])
    np.testing.assert_array_equal(found.upper, [*box[1], *free])
    np.testing.assert_array_equal((plain.lower, plain.upper), (found.lower, found.upper))
    assert plain.P is qp.P and plain.g is qp.g and plain.labels is qp.labels
    assert found.labels == Labels(("held",), ("a", "b"), names)
    np.testing.assert_array_equal(found.C @ np.eye(n, NV), bounds.matrix)
    np.testing.assert_array_equal((found.l, found.u), (bounds.lower, bounds.upper))

    def squares(x: np.ndarray) -> float:
        own = cost.weight @ (cost.weight * np.square(cost.matrix @ x - cost.target))
        off = push.weight * (push.matrix @ x[:NV] - push.target)
        extra = RECOVERY_FACTOR * heaviest * (off @ off)
        return 0.5 * (own + extra + known.damping @ np.square(x))

    def value(x: np.ndarray) -> float:
        return 0.5 * x @ found.P @ x + found.g @ x

    zero = np.zeros(n)
    for _ in range(5):
        x = rng.normal(size=n)
        assert value(x) == pytest.approx(squares(x) - squares(zero), rel=1e-9)
