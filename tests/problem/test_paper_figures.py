"""The paper's experiments as the shipped problems run them, judged by code of their own.

Fig. 6: the end must be a bound-constrained optimum, and as good as what a general optimiser finds
from the same start. Fig. 7: the CoM arrives, over the soles, and the feet stay.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from wbc.problem import load_problem
from wbc.robot import Robot

PROBLEMS = Path(__file__).parents[2] / "problems"
FIG6 = {
    "astronaut_expand": [0.33, 0.33, 0.33],
    "fig6b_hoap2": [0.005, 0.005, 0.33],
    "fig6c_hoap2": [0.33, 0.33, 0.005],
    "fig6a_g1": [10.5, 10.5, 10.5],
    "fig6b_g1": [0.15, 0.15, 10.5],
    "fig6c_g1": [10.5, 10.5, 0.15],
}
FIG7 = [f"fig7_{way}_{robot}" for way in ("backward", "forward", "downward") for robot in
        ("hoap2", "g1")]  # fmt: skip
ACTIVE = 1e-6  # rad: how close to a limit counts as at it


def base_diagonal(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Diagonal of the CRB inertia in base axes, from Pinocchio alone."""
    data = robot.model.createData()
    pin.ccrba(robot.model, data, q, np.zeros(robot.nv))
    R = data.oMi[1].rotation
    return np.diag(R.T @ data.Ig.inertia @ R)


def numeric_gradient(robot: Robot, q: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Gradient by the joints of half the squared Frobenius error, by central differences."""

    def cost(joints: np.ndarray) -> float:
        error = base_diagonal(robot, np.concatenate((q[:7], joints))) - target
        return 0.5 * float(error @ error)

    h = 1e-6
    steps = h * np.eye(robot.nv - 6)
    return np.array([(cost(q[7:] + s) - cost(q[7:] - s)) / (2 * h) for s in steps])


def projected(robot: Robot, q: np.ndarray, gradient: np.ndarray) -> float:
    """Norm of the gradient without what pushes against an active limit."""
    joints, limits = q[7:], robot.limits
    blocked = (joints > limits.upper - ACTIVE) & (gradient < 0)
    blocked |= (joints < limits.lower + ACTIVE) & (gradient > 0)
    return float(np.linalg.norm(np.where(blocked, 0.0, gradient)))


@pytest.mark.parametrize("name", FIG6)
def test_fig6_ends_at_a_bound_constrained_optimum(name: str) -> None:
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    target = np.array(FIG6[name])
    result = problem.run()
    assert result.status == "converged", result.reason
    robot, start = problem.parts.robot, problem.parts.start
    q = result.q
    first = projected(robot, start, numeric_gradient(robot, start, target))
    last = projected(robot, q, numeric_gradient(robot, q, target))
    assert last < 1e-4 * first
    error = np.linalg.norm(base_diagonal(robot, q) - target)
    assert error <= 1.05 * scipy_error(robot, start, target)
    assert (q[7:] <= robot.limits.upper + 1e-6).all()
    assert (q[7:] >= robot.limits.lower - 1e-6).all()


def scipy_error(robot: Robot, start: np.ndarray, target: np.ndarray) -> float:
    """Return the error L-BFGS-B ends with from the same start, with exact gradients."""
    scale = float(np.sum((base_diagonal(robot, start) - target) ** 2))

    def cost(joints: np.ndarray) -> tuple[float, np.ndarray]:
        here = robot.snapshot(np.concatenate((start[:7], joints)))
        error = np.diag(here.inertia_in("base")) - target
        gradient = here.base_inertia_jacobian[[0, 3, 5], 6:].T @ error
        return 0.5 * float(error @ error) / scale, gradient / scale

    bounds = list(zip(robot.limits.lower, robot.limits.upper, strict=True))
    options = {"maxiter": 5000, "maxfun": 20000, "ftol": 1e-15, "gtol": 1e-10}
    found = minimize(cost, start[7:], jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return float(np.sqrt(2.0 * found.fun * scale))


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
