"""The paper's Fig. 6 and Fig. 7 as the shipped problems run them, checked independently.

Fig. 6: the final error relative to the start's, compared with SciPy's L-BFGS-B from the same start
with exact gradients; the projected gradient, end by start, by central differences of Pinocchio's
inertia; and the ticks. Fig. 7: the CoM's error, and the motion of the feet.

    python benchmarks/paper_figures.py
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from wbc.problem import Problem, load_problem
from wbc.robot import Robot

PROBLEMS = Path(__file__).parents[1] / "problems"
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


def projected_norm(robot: Robot, q: np.ndarray, gradient: np.ndarray) -> float:
    """Norm of the gradient without components that push against an active limit."""
    joints, limits = q[7:], robot.limits
    blocked = (joints > limits.upper - ACTIVE) & (gradient < 0)
    blocked |= (joints < limits.lower + ACTIVE) & (gradient > 0)
    return float(np.linalg.norm(np.where(blocked, 0.0, gradient)))


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


def run_problem(name: str) -> tuple[Problem, Robot, np.ndarray]:
    """Return a problem, its robot and where its run ended."""
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    assert isinstance(problem, Problem)
    result = problem.run()
    print(f"{name:22}", end="")
    if name in FIG6:
        print(f"{len(result.history):7d}", end="")
    else:
        moved = max(slip.max() for slip in result.history.slip.values())
        print(f"{1e3 * moved:9.3f}", end="")
    return problem, problem.parts.robot, result.q


def main() -> None:
    print(f"{'Fig. 6':22}{'ticks':>7}{'error':>8}{'L-BFGS-B':>10}{'gradient':>10}")
    for name, diagonal in FIG6.items():
        problem, robot, q = run_problem(name)
        start, target = problem.parts.start, np.array(diagonal)
        first = float(np.linalg.norm(base_diagonal(robot, start) - target))
        last = float(np.linalg.norm(base_diagonal(robot, q) - target))
        other = scipy_error(robot, start, target)
        sizes = [
            projected_norm(robot, at, numeric_gradient(robot, at, target)) for at in (q, start)
        ]
        print(f"{last / first:8.4f}{other / first:10.4f}{sizes[0] / sizes[1]:10.0e}", flush=True)
    print(f"{'Fig. 7':22}{'feet [mm]':>9}{'CoM [mm]':>10}")
    for name in FIG7:
        problem, robot, q = run_problem(name)
        (offset,) = [spec.target.offset for spec in problem.spec.tasks.values()]
        wanted = robot.snapshot(problem.parts.start).com + np.array(offset)
        reached = pin.centerOfMass(robot.model, robot.model.createData(), q)
        print(f"{1e3 * float(np.linalg.norm(reached - wanted)):10.0e}", flush=True)


if __name__ == "__main__":
    main()
