"""Gauss-Newton on the least squares of a whole motion, with Levenberg-Marquardt damping."""

from __future__ import annotations

import numpy as np

from wbc.retargeting.initial_guess import Progress, first_configuration, interpolate, solve_frames
from wbc.retargeting.targets import balance_com
from wbc.retargeting.trajectory_problem import Linearization, TrajectoryProblem
from wbc.validate import Array

# A step is rejected if the constraint violation [m or rad] exceeds FEASIBLE and has grown by this
# factor, or if the cost rises between two nearly feasible iterates. Then the damping is multiplied,
# and iterations end above the maximum.
MAX_VIOLATION_GROWTH, FEASIBLE = 2.0, 0.02
DAMPING_AFTER_REJECTION, MAX_DAMPING_AFTER_REJECTION = 4.0, 100.0
# Converged: the relative decrease of the cost is below the first, or its value per frame below the
# second.
CONVERGED_DECREASE, CONVERGED_COST = 0.05, 0.4
BLOCKED_LEGS = 0.2  # m or rad, of violation of an initial guess whose legs block each other
MIN_ITERATIONS = 2
# Accepted steps lower the damping, so that light tasks such as arms converge as well. If joints
# still exceed their speeds or accelerations after so many iterations, it is raised again.
ITERATIONS_BEFORE_DAMPING = 6
DAMPING_DECREASE, MIN_DAMPING, DAMPING_INCREASE, MAX_DAMPING = 0.5, 1.0, 1.5, 15.0
MAX_RATIO = 1.02  # of speeds and accelerations to their limits: less excess is not slowed down


def solve(
    problem: TrajectoryProblem, axes: Array, iterations: int, balance: bool,
    progress: Progress | None, warm_start: Array | None,
) -> Linearization:  # fmt: skip
    """Minimise the least squares of a motion; return the last accepted iterate.

    Constraints are weighted, so tasks may leave them slightly violated.

    Parameters
    ----------
    axes:
        The human's principal axes as columns (n, 3, 3).
    warm_start:
        Configurations (m, nq) of the same motion at another speed; None: frame-by-frame inverse
        kinematics.
    """
    tasks, collision = problem.tasks, problem.collision
    robot = tasks.robot
    constraints = [] if collision is None else [collision]
    if warm_start is None:
        start = first_configuration(tasks, constraints)
        q = solve_frames(tasks, start, constraints, progress)
    else:
        frames = np.linspace(0.0, len(warm_start) - 1.0, len(tasks.targets.time))
        q = interpolate(robot, warm_start, frames)
    states = problem.states(q)
    tasks.set_inertia_targets(states.inertia, axes)
    best = problem.linearize(q, states)
    if warm_start is None and best.violation > BLOCKED_LEGS:
        unconstrained = problem.linearize(solve_frames(tasks, start, (), progress))
        best = min(best, unconstrained, key=lambda one: one.violation)
    for number in range(1, iterations + 1):
        q = problem.step(best)
        states = problem.states(q)
        if balance:
            k = states.part("momentum", 6)[:, 3:]
            tasks.targets = balance_com(tasks.targets, robot, k, states.com)
        before, now = best, problem.linearize(q, states)
        feasible, too_fast = now.violation < FEASIBLE, now.actuator_ratio > MAX_RATIO
        cost_rises = feasible and before.violation < FEASIBLE and now.cost > before.cost
        if before.actuator_ratio > MAX_RATIO and now.actuator_ratio < before.actuator_ratio:
            cost_rises = False  # slower joints are worth a higher cost
        if cost_rises or now.violation > max(MAX_VIOLATION_GROWTH * before.violation, FEASIBLE):
            problem.damping *= DAMPING_AFTER_REJECTION
            if problem.damping > MAX_DAMPING_AFTER_REJECTION:
                break
            continue
        best = now
        if not feasible:
            continue
        smallest_decrease = 1.0 - CONVERGED_DECREASE
        settled = before.violation < FEASIBLE and now.cost > smallest_decrease * before.cost
        redamped = number >= ITERATIONS_BEFORE_DAMPING
        if too_fast and redamped and now.actuator_ratio > smallest_decrease * before.actuator_ratio:
            too_fast = not settled  # joints get no slower
        if number >= MIN_ITERATIONS and not too_fast and (settled or now.cost < CONVERGED_COST):
            break
        if not redamped or now.actuator_ratio <= MAX_RATIO:
            problem.damping = max(DAMPING_DECREASE * problem.damping, MIN_DAMPING)
        else:  # joints that are too fast oscillate
            problem.damping = min(DAMPING_INCREASE * problem.damping, MAX_DAMPING)
    return best
