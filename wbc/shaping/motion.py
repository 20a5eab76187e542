"""The motion from the current posture to the best one, by the QP controller.

A posture task follows the shortest path in configuration space, with contacts and limits; then the
problem's own tasks take over and settle. A candidate is reached if the motion keeps every
constraint and ends at its cost.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wbc.controllers.closed_loop import LoopTick, closed_loop, ticks_of
from wbc.controllers.controller import Controller
from wbc.minimum_jerk import PEAK, minimum_jerk
from wbc.robot import Snapshot
from wbc.robot.names import BASE
from wbc.shaping.evaluation import Tolerances, kept_constraints, violations
from wbc.shaping.outcome import Attempt, Candidate, ConstraintMargins, ShapingMotion, ShapingOutcome
from wbc.shaping.problem import ShapingProblem, posture_cost
from wbc.tasks import ComTask, PoseTask, PostureTask, Task
from wbc.validate import Array, read_only

MakeController = Callable[[Sequence[Task]], Controller]
# Called after every tick with the attempt's number, which is the index of its candidate in the
# outcome, and the tick; on the way there its errors are those of the guiding tasks. True ends the
# motion there, and no other is tried.
Watch = Callable[[int, LoopTick], bool | None]

HOLD_TIME = 0.5  # s that the guiding tasks hold the end of their path
SETTLING_TIME = 4.0  # s at most, after the path
REST_TICKS = 10
MOST_FAILURES = 10  # ticks in a row without solution
AT_REST = 1e-5  # rad/s or m/s
# For motions, in which contacts are held by feedback and limits by a braking rule.
MOTION_TOLERANCES = Tolerances(contact=1e-3, limit=1e-6, support=1e-3, clearance=1e-4)
ARRIVED, INTERRUPTED = "arrived", "interrupted"
NEGLIGIBLE = 1e-9  # of the cost at the start: a smaller cost counts as zero
HORIZONTAL = ("x", "y")
COM_WEIGHT = 30.0  # 1/(m/s); the joints' and the base's weight is 1
COM_WEIGHT_FACTOR = 1000.0  # factor by which the CoM's squared weight exceeds the tasks' afterwards
LEANING_MARGIN = 0.01  # m: a CoM nearer to the support's edge leans on it
USED_SPEED = 0.5  # of the velocity limits, at the path's peak speed
SHORTEST, LONGEST = 2.0, 20.0  # s


class GuidingTasks:
    """Tasks that lead along the shortest path from one configuration to another.

    The problem's own tasks are not among them: they would pull to minima beside the path, with
    arbitrary weights.

    ``tasks``: posture; base, if no contact determines it and it must move; CoM, if it must stay
    over the support (convex, so that the straight line stays inside).
    ``lasting``: tasks that remain when the problem's tasks take over: if the best posture leans on
    the edge of the support, the CoM is held, because the tasks alone would tip the robot over it.
    ``duration``: of the path [s], at a fraction of the joints' speed limits.
    """

    def __init__(self, problem: ShapingProblem, start: Array, candidate: Candidate) -> None:
        robot = problem.robot
        self._robot, self._start = robot, start
        self._displacement = robot.difference(start, candidate.q)
        self._posture = PostureTask(robot, start, name="guide: posture")
        self._base: PoseTask | None = None
        self._com: ComTask | None = None
        here, there = robot.snapshot(start), robot.snapshot(candidate.q)
        self._com_start, self._com_displacement = here.com, there.com - here.com
        if problem.anchor is None and np.abs(self._displacement[:6]).max() > 0.0:
            position, rotation = here.position(BASE), here.rotation(BASE)
            self._base = PoseTask(robot, BASE, position, rotation, name="guide: base")
        if problem.supports:
            self._com = ComTask(
                robot, here.com, axes=HORIZONTAL, name="guide: com", weight=COM_WEIGHT
            )
        tasks = (self._posture, self._base, self._com)
        self.tasks: tuple[Task, ...] = tuple(task for task in tasks if task is not None)
        self.lasting: tuple[Task, ...] = ()
        if candidate.kept.support is not None and candidate.kept.support < LEANING_MARGIN:
            held = ComTask(
                robot,
                there.com,
                axes=HORIZONTAL,
                name="guide: com",
                weight=float(np.sqrt(COM_WEIGHT_FACTOR * _stiffness(problem.tasks, there))),
                priority=problem.tasks[0].priority,
            )
            self.lasting = (held,)
        speed = USED_SPEED * problem.limits.speed
        slowest = float((np.abs(self._displacement[6:]) / speed).max(initial=0.0))
        self.duration = min(max(PEAK * slowest, SHORTEST), LONGEST)

    def move_to(self, time: float) -> None:
        """Set the targets to those of a time [s]."""
        along = minimum_jerk(min(time / self.duration, 1.0))
        q = self._robot.integrate(self._start, self._displacement, along)
        self._posture.set_target(q)
        if self._base is not None:
            here = self._robot.snapshot(q)
            self._base.set_target(here.position(BASE), here.rotation(BASE))
        if self._com is not None:
            self._com.set_target(self._com_start + along * self._com_displacement)


def _stiffness(tasks: Sequence[Task], snapshot: Snapshot) -> float:
    """Return the largest curvature of the tasks' cost, or 1 if that is 0."""
    nv = snapshot.robot.nv
    total = np.zeros((nv, nv))
    for task in tasks:
        weighted = task.weight[:, None] * task.residual(snapshot).jacobian
        total += weighted.T @ weighted
    largest = float(np.linalg.eigvalsh(total)[-1])
    return largest if largest > 0.0 else 1.0


class _Rollout(NamedTuple):
    """States tick by tick, whether they end at rest, and why they ended early, if they did."""

    states: list[Snapshot]
    at_rest: bool
    fault: str


@dataclass(frozen=True, eq=False)
class PostureReach:
    """Runs the controller towards candidates; see :meth:`~.shaping.GlobalShaping.reach`."""

    problem: ShapingProblem
    q_start: Array
    tolerance: float
    dt: float
    longest: float | None
    rest_speed: float | None
    make_controller: MakeController
    watch: Watch | None

    def best(self, outcome: ShapingOutcome, attempts: int) -> ShapingMotion:
        """Try candidates, the best first, until one is reached."""
        tried: list[Attempt] = []
        motions: list[ShapingMotion] = []
        for number, candidate in enumerate((outcome.best, *outcome.candidates[1:attempts])):
            motion, reason = self.motion(candidate, number)
            tried.append(Attempt(number, float(motion.cost[-1]), reason))
            motions.append(motion)
            if motion.arrived or reason == INTERRUPTED:
                break
        # Prefer one that arrived, then one that keeps the constraints, then the least cost.
        chosen = min(motions, key=lambda m: (not m.arrived, bool(m.kept.broken), m.cost[-1]))
        return replace(chosen, attempts=tuple(tried))

    def motion(self, candidate: Candidate, number: int) -> tuple[ShapingMotion, str]:
        """Return the motion towards a candidate, and why it does not count, or ``"arrived"``."""
        states, at_rest, fault = self._rollout(candidate, number)
        problem = self.problem
        costs = np.array([posture_cost(problem.tasks, state, problem.dt) for state in states])
        kept, broken = worst_violations(self.problem, states, self.dt)
        allowed = (1.0 + self.tolerance) * candidate.cost + NEGLIGIBLE * float(costs[0])
        reason = fault or broken or ARRIVED
        if reason == ARRIVED and costs[-1] > allowed:
            how = "came to rest" if at_rest else "was still moving when the time was over,"
            reason = f"{how} at cost {costs[-1]:.4g} instead of {candidate.cost:.4g}"
        v = np.array([state.v for state in states[1:]] + [np.zeros(self.problem.robot.nv)])
        motion = ShapingMotion(
            time=read_only(self.dt * np.arange(len(states))),
            q=read_only(np.array([state.q for state in states])),
            v=read_only(v),
            cost=read_only(costs),
            candidate=candidate,
            kept=kept,
            arrived=reason == ARRIVED,
            at_rest=at_rest,
            attempts=(),
        )
        return motion, reason

    def _rollout(self, candidate: Candidate, number: int) -> _Rollout:
        guide = GuidingTasks(self.problem, self.q_start, candidate)
        guided = self.make_controller(guide.tasks)
        settling = self.make_controller((*self.problem.tasks, *guide.lasting))
        longest = guide.duration + SETTLING_TIME if self.longest is None else self.longest

        def is_guided(time: float) -> bool:
            return time < guide.duration + HOLD_TIME

        def update(tick: int, _: Snapshot) -> Controller:
            if not is_guided(tick * self.dt):
                return settling
            guide.move_to(tick * self.dt)
            return guided

        states: list[Snapshot] = []
        still = unsolved = 0
        fault = ""
        ticks = max(1, ticks_of(longest, self.dt))
        for now in closed_loop(guided, self.q_start, ticks, update):
            states.append(now.snapshot)
            if self.watch is not None and self.watch(number, now):
                fault = INTERRUPTED
                break
            slow = self.rest_speed is not None and now.speed < self.rest_speed
            still = still + 1 if slow and now.tick.ok and not is_guided(now.time) else 0
            # Without a solution the controller's policy is to stand still; the next tick may work.
            unsolved = 0 if now.tick.ok else unsolved + 1
            if now.gave_up or unsolved >= MOST_FAILURES:
                fault = f"at {now.time:.2f} s: {now.tick.report()}"
                break
            if still >= REST_TICKS:
                break
        states.append(self.problem.robot.snapshot(now.q, now.tick.velocity))
        return _Rollout(states, still >= REST_TICKS, fault)


def worst_violations(
    problem: ShapingProblem, states: Sequence[Snapshot], dt: float
) -> tuple[ConstraintMargins, str]:
    """Return the worst value of every constraint over a motion, and the first violation, if any.

    Violations of the current posture may not grow on the way, nor remain at the end.
    """
    beginning = kept_constraints(problem, states[0], MOTION_TOLERANCES)
    excused = MOTION_TOLERANCES.excused_by(violations(problem, states[0]))
    every = [beginning, *(kept_constraints(problem, state, excused) for state in states[1:])]
    faults = [(k, kept.broken[0]) for k, kept in enumerate(every[1:], 1) if kept.broken]
    faults += [
        (len(states) - 1, b)
        for b in kept_constraints(problem, states[-1], MOTION_TOLERANCES).broken
    ]
    first = f"at {faults[0][0] * dt:.2f} s: {faults[0][1]}" if faults else ""
    supports = [kept.support for kept in every if kept.support is not None]
    clearances = [kept.clearance for kept in every if kept.clearance is not None]
    worst = ConstraintMargins(
        contact=max(kept.contact for kept in every),
        limit=min(kept.limit for kept in every),
        support=min(supports, default=None),
        clearance=min(clearances, default=None),
        broken=(first,) if first else (),
    )
    return worst, first
