"""What a search found, judged by Pinocchio instead of by the expressions it was found with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from wbc.controllers.shaping.keeping import Tolerances, kept_constraints
from wbc.controllers.shaping.merit import posture_cost, posture_errors
from wbc.controllers.shaping.nlp import BuiltNlp, Local, Start
from wbc.controllers.shaping.outcome import Candidate, Rejected
from wbc.robot import Robot
from wbc.validate import Array, read_only

# Of what IPOPT found: no more than rounding.
FOUND = Tolerances(contact=1e-6, limit=1e-7, support=1e-7, clearance=1e-6)
SAME_POSTURE = 1e-2  # rad or m, the largest difference of any joint or of the base


def judged(built: BuiltNlp, number: int, start: Start, local: Local) -> Candidate | Rejected:
    """Return the candidate that a search from start ``number`` led to, or why it is none.

    IPOPT's own opinion does not decide: a posture that keeps the constraints is a posture.
    """
    problem = built.unknowns.problem
    if not np.isfinite(local.x).all():
        reason = f"IPOPT: {local.status}, the answer is not finite"
        return Rejected(number, reason, reason)
    snapshot = problem.robot.snapshot(built.configuration(start, local.x))
    kept = kept_constraints(problem, snapshot, FOUND)
    if kept.broken:
        reason = f"IPOPT: {local.status}; {', '.join(kept.broken)}"
        return Rejected(number, reason, f"IPOPT: {local.status}; a constraint is broken")
    return Candidate(
        q=read_only(snapshot.q),
        cost=posture_cost(problem.tasks, snapshot),
        errors=posture_errors(problem.tasks, snapshot),
        kept=kept,
        status=local.status,
        optimal=local.optimal,
        iterations=local.iterations,
        starts=(number,),
    )


def merged(robot: Robot, candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the candidates best first, each posture once; who led to the same one is noted."""
    ordered = sorted(candidates, key=lambda c: (c.cost, c.starts))
    distinct: list[Candidate] = []
    # All known joints in one array: of thousands of postures, one by one takes minutes.
    joints = np.empty((len(ordered), robot.nq - 7))
    for candidate in ordered:
        apart = np.abs(joints[: len(distinct)] - candidate.q[7:]).max(axis=1, initial=0.0)
        # An angle differs by no less than its sine and cosine do.
        for k in np.flatnonzero(apart < SAME_POSTURE):
            if same_posture(robot, distinct[k].q, candidate.q):
                starts = tuple(sorted(distinct[k].starts + candidate.starts))
                distinct[k] = replace(distinct[k], starts=starts)
                break
        else:
            joints[len(distinct)] = candidate.q[7:]
            distinct.append(candidate)
    return tuple(distinct)


def same_posture(robot: Robot, one: Array, other: Array) -> bool:
    """Return True if two configurations (nq,) differ by no more than a tolerance."""
    return float(np.abs(robot.difference(one, other)).max()) < SAME_POSTURE
