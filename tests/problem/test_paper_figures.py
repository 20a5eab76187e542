"""The paper's experiments as the shipped problems run them, judged by code of their own.

Fig. 6: the end must be a bound-constrained optimum, and as good as what a general optimiser finds
from the same start. Fig. 7: the CoM arrives, over the soles, and the feet stay.
"""

import numpy as np
import pinocchio as pin
import pytest
from paper_figures import (
    FIG6,
    FIG7,
    PROBLEMS,
    base_diagonal,
    numeric_gradient,
    projected_norm,
    scipy_error,
)
from scipy.spatial import ConvexHull

from wbc.problem import load_problem


@pytest.mark.parametrize("name", FIG6)
def test_fig6_ends_at_a_bound_constrained_optimum(name: str) -> None:
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    target = np.array(FIG6[name])
    result = problem.run()
    assert result.status == "converged", result.reason
    robot, start = problem.parts.robot, problem.parts.start
    q = result.q
    first = projected_norm(robot, start, numeric_gradient(robot, start, target))
    last = projected_norm(robot, q, numeric_gradient(robot, q, target))
    assert last < 1e-4 * first
    error = np.linalg.norm(base_diagonal(robot, q) - target)
    assert error <= 1.05 * scipy_error(robot, start, target)
    assert (q[7:] <= robot.limits.upper + 1e-6).all()
    assert (q[7:] >= robot.limits.lower - 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", FIG7)
def test_fig7_moves_the_com_over_fixed_feet(name: str) -> None:
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    result = problem.run()
    assert result.status == "converged", result.reason
    robot = problem.parts.robot
    before, after = robot.snapshot(problem.parts.start), robot.snapshot(result.q)
    (offset,) = [spec.target.offset for spec in problem.spec.tasks.values()]
    reached = pin.centerOfMass(robot.model, robot.model.createData(), result.q)
    assert np.linalg.norm(reached - before.com - np.array(offset)) < 1e-4
    corners = np.concatenate(
        [
            before.position(foot.frame)[:2] + foot.polygon @ before.rotation(foot.frame)[:2, :2].T
            for foot in robot.feet.values()
        ]
    )
    inside = ConvexHull(corners).equations
    for com in (reached, *result.history.com):
        assert (inside[:, :2] @ com[:2] + inside[:, 2] < 0).all()
    assert max(slip.max() for slip in result.history.slip.values()) < 5e-5
    for foot in robot.feet.values():
        assert np.linalg.norm(after.position(foot.frame) - before.position(foot.frame)) < 5e-5
