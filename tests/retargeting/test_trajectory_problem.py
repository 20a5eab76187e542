"""The gradient of a whole motion's least squares, by finite differences."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import trajectory_problem
from wbc.retargeting.normal_equations import NormalEquations
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
