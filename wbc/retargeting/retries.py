"""Retries of a motion, slower or with lower weights, until all hard constraints are satisfied."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from wbc.retargeting.constraint_projection import project_onto_constraints
from wbc.retargeting.gauss_newton import CONVERGED_COST, FEASIBLE, MAX_RATIO, solve
from wbc.retargeting.initial_guess import Progress
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.tasks import RetargetWeights
from wbc.retargeting.trajectory_problem import Linearization, TrajectoryProblem
from wbc.validate import Array

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


@dataclass(frozen=True, eq=False)
class MotionAttempt:
    """The result of one attempt.

    Attributes
    ----------
    q:
        Configurations (n, nq).
    problem, scale:
        What was solved, with the targets.
    reductions:
        How many times the weights of CoM and momentum were lowered.
    """

    q: Array
    problem: TrajectoryProblem
    scale: MotionScale
    reductions: int

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
    if best.speed_ratio <= MAX_RATIO:
        found = project_onto_constraints(problem, best.q, stop_early=True)
        if found.feasible:
            return MotionAttempt(found.q, problem, scale, 0)
    reductions, least = 0, (math.inf, math.inf)
    warm_start: Array | None = None
    if MUCH_TOO_FAST < best.speed_ratio < MAX_OVERSPEED:
        scale, warm_start = _stretched(scale, best, 1)
    for number in range(ATTEMPTS):
        problem, axes = build_problem(scale, weights)
        best = solve(problem, axes, iterations, balance, progress, warm_start)
        last, too_fast = number == ATTEMPTS - 1, MAX_RATIO < best.speed_ratio < MAX_OVERSPEED
        found, cost = project_onto_constraints(problem, best.q, stop_early=not last), 0.0
        if found.feasible and too_fast:
            # Slowing down single joints may have changed the motion too much.
            cost = problem.linearize(found.q).cost
            too_fast = cost > MAX_COST_GROWTH * max(best.cost, CONVERGED_COST)
        attempt = MotionAttempt(found.q, problem, scale, reductions)
        if found.feasible and not too_fast:
            return attempt
        if (found.violation, cost) < least:
            least, nearest = (found.violation, cost), attempt
        if too_fast and (found.feasible or number == 0):
            scale, warm_start = _stretched(scale, best, number + 1)
            continue
        warm_start = None
        reductions += 1
        weights = replace(
            weights,
            com=WEIGHT_FACTOR * weights.com,
            momentum=WEIGHT_FACTOR**2 * weights.momentum,
        )
        if max(found.speed_ratio, found.acceleration_ratio) > 1.0:
            scale = replace(scale, time=TIME_FACTOR * scale.time)
    return nearest


def _stretched(
    scale: MotionScale, best: Linearization, attempt: int
) -> tuple[MotionScale, Array | None]:
    """Return the scale of a motion that is slow enough, and its warm start."""
    stretch = min(best.speed_ratio, MAX_STRETCH) * (1.0 + attempt * EXTRA_STRETCH)
    warm_start = best.q if best.violation < FEASIBLE else None
    return replace(scale, time=scale.time * stretch), warm_start
