"""From the current posture to the best one, by the QP controller: the answer as a motion.

A posture task is led along the shortest way in configuration space while contacts and limits hold;
then the problem's own tasks take over and settle. A candidate is reached if the motion keeps every
constraint and ends at its cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wbc.controllers.closed_loop import Controller, closed_loop
from wbc.controllers.kinematic import KinematicController
from wbc.controllers.shaping.evaluation import Tolerances, kept_constraints, violations
from wbc.controllers.shaping.lead import Lead
from wbc.controllers.shaping.motion import Attempt, Motion, Watch
from wbc.controllers.shaping.outcome import Candidate, Kept, ShapingOutcome
from wbc.controllers.shaping.problem import ShapingProblem, posture_cost
from wbc.robot import Snapshot
from wbc.tasks import Task
from wbc.validate import Array, read_only

MakeController = Callable[[Sequence[Task]], Controller]

LINGERING = 0.5  # s for which the lead is kept at its end
SETTLING = 4.0  # s at most, after the lead has arrived
REST_TICKS = 10
GIVE_UP = 10  # ticks in a row without solution
AT_REST = 1e-5  # rad/s or m/s
# In motion contacts are held by feedback and limits by a braking rule, so a little more is allowed.
MOVING = Tolerances(contact=1e-3, limit=1e-6, support=1e-3, clearance=1e-4)
ARRIVED = "arrived"
NEGLIGIBLE = 1e-9  # of the cost at the start: a target that is met to this is met


@dataclass(frozen=True)
class Terms:
    """How candidates are tried; see :meth:`~.shaping.GlobalShaping.reach`."""

    tolerance: float
    attempts: int
    dt: float
    longest: float | None
    rest_speed: float | None


def reach_best(
    problem: ShapingProblem,
    q_start: Array,
    outcome: ShapingOutcome,
    terms: Terms,
    make_controller: MakeController | None,
    watch: Watch | None,
) -> Motion:
    """Try candidates, the best first; see :meth:`~.shaping.GlobalShaping.reach`."""
    best = outcome.best
    way = Way(problem, q_start, terms, make_controller or _default(problem, terms.dt), watch)
    tried: list[Attempt] = []
    motions: list[Motion] = []
    for number, candidate in enumerate((best, *outcome.candidates[1 : terms.attempts])):
        motion, reason = way.to(candidate, number)
        tried.append(Attempt(number, float(motion.cost[-1]), reason))
        motions.append(motion)
        if motion.arrived:
            break
    # Arrived, or else the one that keeps the constraints and came to the least cost.
    chosen = min(motions, key=lambda m: (not m.arrived, bool(m.kept.broken), m.cost[-1]))
    return replace(chosen, attempts=tuple(tried))


def _default(problem: ShapingProblem, dt: float) -> MakeController:
    def make(tasks: Sequence[Task]) -> KinematicController:
        return KinematicController(
            problem.robot,
            tasks,
            contacts=problem.contacts,
            limits=problem.limits,
            constraints=problem.constraints,
            dt=dt,
        )

    return make


class Course(NamedTuple):
    """States tick by tick, whether they end at rest, and what ended them early, or nothing."""

    states: list[Snapshot]
    at_rest: bool
    fault: str


@dataclass(frozen=True, eq=False)
class Way:
    """What all attempts have in common."""

    problem: ShapingProblem
    q_start: Array
    terms: Terms
    make_controller: MakeController
    watch: Watch | None

    def to(self, candidate: Candidate, number: int) -> tuple[Motion, str]:
        """Return the motion towards a candidate, and why it does not count, or ``"arrived"``."""
        states, at_rest, fault = self._run(candidate, number)
        costs = np.array([posture_cost(self.problem.tasks, state) for state in states])
        kept, broken = worst_kept(self.problem, states, self.terms.dt)
        allowed = (1.0 + self.terms.tolerance) * candidate.cost + NEGLIGIBLE * float(costs[0])
        reason = fault or broken or ARRIVED
        if reason == ARRIVED and costs[-1] > allowed:
            how = "came to rest" if at_rest else "was still moving when the time was over,"
            reason = f"{how} at cost {costs[-1]:.4g} instead of {candidate.cost:.4g}"
        v = np.array([state.v for state in states[1:]] + [np.zeros(self.problem.robot.nv)])
        motion = Motion(
            time=read_only(self.terms.dt * np.arange(len(states))),
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

    def _run(self, candidate: Candidate, number: int) -> Course:
        tasks, dt = self.problem.tasks, self.terms.dt
        lead = Lead(self.problem, self.q_start, candidate)
        leading = self.make_controller(lead.tasks)
        settling = self.make_controller((*tasks, *lead.lasting))
        longest = lead.duration + SETTLING if self.terms.longest is None else self.terms.longest

        def leads(time: float) -> bool:
            return time < lead.duration + LINGERING

        def update(tick: int, _: Snapshot) -> Controller:
            if not leads(tick * dt):
                return settling
            lead.move_to(tick * dt)
            return leading

        states: list[Snapshot] = []
        still = unsolved = 0
        fault = ""
        ticks = max(1, math.ceil(longest / dt - 1e-9))
        for now in closed_loop(leading, self.q_start, ticks, update):
            states.append(now.snapshot)
            if self.watch is not None:
                self.watch(number, now)
            slow = not leads(now.time) and now.tick.ok and self._slow(now.tick.velocity)
            still = still + 1 if slow else 0
            # By its policy the controller stands still without solution; the next may have one.
            unsolved = 0 if now.tick.ok else unsolved + 1
            if now.gave_up or unsolved >= GIVE_UP:
                fault = f"at {now.time:.2f} s: {now.tick.report()}"
                break
            if still >= REST_TICKS:
                break
        states.append(self.problem.robot.snapshot(now.q, now.tick.velocity))
        return Course(states, still >= REST_TICKS, fault)

    def _slow(self, v: Array) -> bool:
        speed = self.terms.rest_speed
        return speed is not None and float(np.abs(v).max()) < speed


def worst_kept(problem: ShapingProblem, states: Sequence[Snapshot], dt: float) -> tuple[Kept, str]:
    """Return the worst of every constraint over a motion, and what was broken first, or nothing.

    What the current posture breaks already may not become worse on the way, nor be broken at the
    end.
    """
    beginning = kept_constraints(problem, states[0], MOVING)
    excused = MOVING.excusing(violations(problem, states[0]))
    every = [beginning, *(kept_constraints(problem, state, excused) for state in states[1:])]
    faults = [(k, kept.broken[0]) for k, kept in enumerate(every[1:], 1) if kept.broken]
    faults += [(len(states) - 1, b) for b in kept_constraints(problem, states[-1], MOVING).broken]
    first = f"at {faults[0][0] * dt:.2f} s: {faults[0][1]}" if faults else ""
    supports = [kept.support for kept in every if kept.support is not None]
    apart = [kept.clearance for kept in every if kept.clearance is not None]
    worst = Kept(
        contact=max(kept.contact for kept in every),
        limit=min(kept.limit for kept in every),
        support=min(supports, default=None),
        clearance=min(apart, default=None),
        broken=(first,) if first else (),
    )
    return worst, first
