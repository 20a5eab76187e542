"""A whole motion's least squares: its gradient, its band of rows, and retries."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import crouching, stepping, trajectory_problem
from wbc.retargeting import pipeline, retries
from wbc.retargeting.constraint_projection import Projection
from wbc.retargeting.normal_equations import SPAN, NormalEquations
from wbc.robot import Robot
from wbc.validate import Array


def test_momentum_gradient_is_that_of_its_squares(
    step: wbc.Retargeted, rng: np.random.Generator
) -> None:
    """By configurations and velocities of all frames, with a base that rotates at 1 rad/s.

    Central differences at 1e-6; of a base's displacement terms of order (v dt)^2/12 are left out.
    """
    problem = trajectory_problem(step, collision=False)
    turned = np.zeros((len(step.q), step.robot.nv))
    turned[:, 3:6] = np.sin(np.arange(len(step.q)) * step.targets.dt)[:, None]
    q = problem.apply_step(step.q, 0.3 * turned)
    normal = NormalEquations(*turned.shape)
    problem.add_momentum(problem.states(q), normal)

    def cost(d: Array) -> float:
        return problem.add_momentum(
            problem.states(problem.apply_step(q, d)), NormalEquations(*d.shape)
        )

    for _ in range(3):
        d = 1e-6 * rng.standard_normal(turned.shape)
        change = 0.5 * (cost(d) - cost(-d))
        assert 2.0 * float((normal.gradient * d).sum()) == pytest.approx(change, rel=1e-3)


def test_a_band_is_the_dense_least_squares(rng: np.random.Generator) -> None:
    count, nv, rows = 7, 4, 3
    normal, dense, errors = NormalEquations(count, nv), [], []

    def row(frames: dict[int, np.ndarray], off: float) -> None:
        one = np.zeros((count, nv))
        for k, part in frames.items():
            one[k] += part
        dense.append(one.ravel())
        errors.append(off)

    A, e = rng.normal(size=(count, rows, nv)), rng.normal(size=(count, rows))
    normal.add(A, errors=e)
    B, f = rng.normal(size=(count - 1, rows, nv)), rng.normal(size=(count - 1, rows))
    normal.add(-B, B, errors=f)
    after = rng.normal(size=(count - 1, rows, nv))
    normal.add(-B, after, errors=2.0 * f)
    g = rng.normal(size=(count - 2, rows))
    normal.add(B[:-1], -B[:-1] - B[1:], B[1:], errors=g)
    coefficients = (-1.0, 3.0, -3.0, 1.0)
    square, gradient = rng.uniform(1, 2, nv - 1), rng.normal(size=nv - 1)
    normal.add_differences(coefficients, square, np.tile(gradient, (count - SPAN, 1)), 1)
    for k in range(count):
        for r in range(rows):
            row({k: A[k, r]}, e[k, r])
            if k < count - 1:
                row({k: -B[k, r], k + 1: B[k, r]}, f[k, r])
                row({k: -B[k, r], k + 1: after[k, r]}, 2.0 * f[k, r])
            if k < count - 2:
                row({k: B[k, r], k + 1: -B[k, r] - B[k + 1, r], k + 2: B[k + 1, r]}, g[k, r])
        for c in range(1, nv) if k < count - SPAN else ():
            w = np.sqrt(square[c - 1])
            unit = np.eye(nv)[c]
            row({k + m: w * way * unit for m, way in enumerate(coefficients)}, gradient[c - 1] / w)
    more, pull = rng.uniform(size=(count, nv)), rng.normal(size=(count, nv))
    found = normal.solve(more, pull)
    M = np.array(dense)
    H = M.T @ M + np.diag(more.ravel())
    wanted = np.linalg.solve(H, -(M.T @ np.array(errors) + pull.ravel()))
    np.testing.assert_allclose(found.ravel(), wanted, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(normal.solve(more, pull), found)  # it may be asked again


def long_axis_error(found: wbc.Retargeted) -> float:
    """Return the largest angle of the ellipsoid's long axis from the human's [deg]."""
    return next(one.largest for one in found.reached if one.task == "principal axis 1")


@pytest.mark.slow
def test_first_attempt_with_higher_weights_follows_more_closely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    human, robot = stepping(), Robot.load("hoap2_like")
    higher = wbc.retarget(human, robot)
    monkeypatch.setattr(retries, "FIRST_ATTEMPT", dict.fromkeys(retries.FIRST_ATTEMPT, 1.0))
    plain = wbc.retarget(human, robot)
    off = [
        np.square(one.whole.momentum[:, 3:] - one.targets.angular_momentum).sum()
        for one in (higher, plain)
    ]
    assert long_axis_error(higher) < long_axis_error(plain) and off[0] < 1.05 * off[1]
    assert not higher.broken


def test_infeasible_attempts_return_the_least_infeasible(
    hoap2: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lower weights may be worse: the last attempt of a Unitree H1's kick slid by 36 mm."""
    feet, made = [0.03, 0.04, 0.002, 0.05, 0.01, 0.02, 0.04], list[Projection]()

    def project(problem: object, q: np.ndarray, *, stop_early: bool = False) -> Projection:
        made.append(Projection(q + len(made), feet[len(made)], 0.0, 0.0, 0.5, 0.5))
        return made[-1]

    monkeypatch.setattr(retries, "project_onto_constraints", project)
    monkeypatch.setattr(pipeline, "evaluate", lambda *given: given)
    q = wbc.retarget(crouching(2.0), hoap2, rounds=1)[5]
    assert len(made) == 7 and np.array_equal(q, made[2].q)
