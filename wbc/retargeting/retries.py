"""A motion by damped Gauss-Newton, and retries until all hard constraints are satisfied."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wbc.retargeting.constraint_projection import project_onto_constraints
from wbc.retargeting.initial_guess import Progress, first_configuration, interpolate, solve_frames
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.targets import balance_com
from wbc.retargeting.tasks import RetargetWeights
from wbc.retargeting.trajectory_problem import Linearization, TrajectoryProblem
from wbc.validate import Array

# A step is rejected if the constraint violation [m or rad] exceeds FEASIBLE and has grown by this
# factor, or if the cost rises between two nearly feasible iterates. Then the damping is multiplied,
# and iterations end above the maximum.
MAX_VIOLATION_GROWTH, FEASIBLE = 2.0, 0.02
DAMPING_AFTER_REJECTION, MAX_DAMPING_AFTER_REJECTION = 4.0, 100.0
# Iterations diverge that end infeasible, with a violation larger by this factor than the least one:
# that one is the result, since the last can hardly be projected onto the constraints.
MAX_DIVERGENCE = 1.25
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
MAX_ITERATIONS = 14  # of Gauss-Newton
# Where constraints cannot be satisfied, the next attempt lowers the weight of the CoM by the first
# factor (the momentum's by its square). It takes the second times as long where joints are too slow
# or too weak.
ATTEMPTS, WEIGHT_FACTOR, TIME_FACTOR = 6, 0.5, 1.2
# Speeds above the limit by less than MAX_OVERSPEED stretch the time by that ratio, at most
# MAX_STRETCH at once, and by this part more with each attempt.
MAX_OVERSPEED, EXTRA_STRETCH, MAX_STRETCH = 4.0, 0.03, 1.5
# A first attempt above this is stretched: lower weights make no motion so much slower.
MUCH_TOO_FAST = 1.25
MAX_COST_GROWTH = 1.5  # by the projection; above it a motion that is too fast is stretched instead
# Factors on weights of the first attempt: many robots can follow these more closely.
FIRST_ATTEMPT = {"com": 1.15, "momentum": 1.75, "lean": 30.0}

# From a scale and weights to the least squares of a motion, and the human's principal axes.
ProblemBuilder = Callable[[MotionScale, RetargetWeights], tuple[TrajectoryProblem, Array]]


def solve(
    problem: TrajectoryProblem, axes: Array, iterations: int, balance: bool,
    progress: Progress | None, warm_start: Array | None,
) -> Linearization:  # fmt: skip
    """Minimise the least squares of a motion; return the last accepted iterate.

    If they diverge, it is that with the least violation. Constraints are weighted, so tasks may
    leave them slightly violated.

    ``axes``: the human's principal axes as columns (n, 3, 3).
    ``warm_start``: configurations (m, nq) of the same motion, perhaps at another speed; None:
    frame-by-frame inverse kinematics.
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
    least = best
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
        best, least = now, min(least, now, key=lambda one: one.violation)
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
    return least if best.violation > max(MAX_DIVERGENCE * least.violation, FEASIBLE) else best


@dataclass(frozen=True, eq=False)
class MotionAttempt:
    """The result of one attempt."""

    q: Array  # configurations (n, nq)
    # what was solved, with the targets
    problem: TrajectoryProblem
    scale: MotionScale
    reductions: int  # how many times the weights of CoM and momentum were lowered

    def notes(self, time_scale: float) -> list[str]:
        """Return what was given up; ``time_scale``: the scale of time that was asked for."""
        found = list[str]()
        if self.scale.time != time_scale:
            found.append(
                f"{self.scale.time / time_scale:.2f} times as slow as asked for: joints of"
                f" {self.problem.tasks.robot.name} are no faster, or no stronger"
            )
        if self.reductions > 0:
            com, momentum = WEIGHT_FACTOR**self.reductions, WEIGHT_FACTOR ** (2 * self.reductions)
            found.append(
                f"the weights of CoM and momentum are multiplied by {com:g} and {momentum:g}:"
                " limits and margins allow no more"
            )
        return found


def solve_with_retries(
    build_problem: ProblemBuilder, scale: MotionScale, weights: RetargetWeights, iterations: int,
    balance: bool, progress: Progress | None,
) -> MotionAttempt:  # fmt: skip
    """Return the first attempt that satisfies all constraints, or the least infeasible one."""
    higher = {name: factor * getattr(weights, name) for name, factor in FIRST_ATTEMPT.items()}
    problem, axes = build_problem(scale, replace(weights, **higher))
    best = solve(problem, axes, iterations, balance, progress, None)
    if best.speed_ratio <= MUCH_TOO_FAST:
        found = project_onto_constraints(problem, best.q, stop_early=True)
        slow = best.speed_ratio <= MAX_RATIO
        if found.feasible and (slow or _cost_growth(problem, best, found.q) <= MAX_COST_GROWTH):
            return MotionAttempt(found.q, problem, scale, 0)
    reductions, least = 0, (math.inf, math.inf)
    warm_start = _warm_start(best)
    if MUCH_TOO_FAST < best.speed_ratio < MAX_OVERSPEED:
        scale, warm_start = _stretched(scale, best, 1)
    for number in range(ATTEMPTS):
        problem, axes = build_problem(scale, weights)
        best = solve(problem, axes, iterations, balance, progress, warm_start)
        last, too_fast = number == ATTEMPTS - 1, MAX_RATIO < best.speed_ratio < MAX_OVERSPEED
        found, growth = project_onto_constraints(problem, best.q, stop_early=not last), 0.0
        if found.feasible and too_fast:
            growth = _cost_growth(problem, best, found.q)
            too_fast = growth > MAX_COST_GROWTH
        attempt = MotionAttempt(found.q, problem, scale, reductions)
        if found.feasible and not too_fast:
            return attempt
        if (found.violation, growth) < least:
            least, nearest = (found.violation, growth), attempt
        if too_fast and (found.feasible or number == 0):
            scale, warm_start = _stretched(scale, best, number + 1)
            continue
        warm_start = None
        reductions += 1
        weights = replace(
            weights, com=WEIGHT_FACTOR * weights.com, momentum=WEIGHT_FACTOR**2 * weights.momentum
        )
        if max(found.speed_ratio, found.acceleration_ratio) > 1.0:
            scale = replace(scale, time=TIME_FACTOR * scale.time)
    return nearest


def _cost_growth(problem: TrajectoryProblem, best: Linearization, q: Array) -> float:
    """Return the cost after a projection by that before: slowing joints down changes the motion."""
    return problem.linearize(q).cost / max(best.cost, CONVERGED_COST)


def _stretched(
    scale: MotionScale, best: Linearization, attempt: int
) -> tuple[MotionScale, Array | None]:
    """Return the scale of a motion that is slow enough, and its warm start."""
    stretch = min(best.speed_ratio, MAX_STRETCH) * (1.0 + attempt * EXTRA_STRETCH)
    return replace(scale, time=scale.time * stretch), _warm_start(best)


def _warm_start(best: Linearization) -> Array | None:
    """Return the configurations (n, nq) of an attempt that the next one may begin with."""
    return best.q if best.violation < FEASIBLE else None
