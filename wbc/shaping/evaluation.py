"""Evaluation of postures by Pinocchio, independent of the NLP's expressions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from wbc.constraints import ComSupport
from wbc.constraints.margin import SKIN, Margin
from wbc.robot import Robot, Snapshot
from wbc.shaping.nlp import BuiltNlp, LocalOptimum, Start
from wbc.shaping.outcome import Candidate, ConstraintMargins, Rejected
from wbc.shaping.problem import ShapingProblem, posture_cost, posture_errors
from wbc.validate import Array, read_only

SAME_POSTURE = 1e-2  # rad or m, the largest difference of any joint or of the base
NAMED_PAIRS = 3  # of the worst pairs, in messages


@dataclass(frozen=True)
class Tolerances:
    """Tolerances within which a constraint counts as kept."""

    contact: float  # distance of a held frame from its anchor [m or rad]
    limit: float  # of a joint beyond its limit [rad or m]
    support: float  # of the CoM outside a support polygon, less its margin [m]
    clearance: float  # of bodies nearer than their margin, and of frames outside their boxes [m]
    excused: Mapping[str, float] = field(default_factory=dict)  # beyond that, by frame, joint, pair

    def excused_by(self, broken: Mapping[str, float]) -> Tolerances:
        """Return tolerances widened by present violations, one by one: see :func:`violations`.

        Only these are widened: a hand inside a wall at the start does not excuse a foot below the
        floor.
        """
        return replace(self, excused=dict(broken))

    def of(self, what: str, allowed: float) -> float:
        """Return the tolerance of one frame, joint or pair; ``allowed`` is that of its kind."""
        return allowed + self.excused.get(what, 0.0)


# For IPOPT's optima: rounding only.
IPOPT_TOLERANCES = Tolerances(contact=1e-6, limit=1e-7, support=1e-7, clearance=1e-6)


def evaluate(
    built: BuiltNlp, number: int, start: Start, local: LocalOptimum
) -> Candidate | Rejected:
    """Return the candidate found by the search from start ``number``, or its rejection.

    IPOPT's status does not matter: a posture that keeps the constraints is a candidate.
    """
    problem = built.unknowns.problem
    if not np.isfinite(local.x).all():
        reason = f"IPOPT: {local.status}, the answer is not finite"
        return Rejected(number, reason, reason)
    snapshot = problem.robot.snapshot(built.configuration(start, local.x))
    kept = kept_constraints(problem, snapshot, IPOPT_TOLERANCES)
    if kept.broken:
        reason = f"IPOPT: {local.status}; {', '.join(kept.broken)}"
        return Rejected(number, reason, f"IPOPT: {local.status}; a constraint is broken")
    return Candidate(
        q=read_only(snapshot.q),
        cost=posture_cost(problem.tasks, snapshot, problem.dt),
        errors=posture_errors(problem.tasks, snapshot),
        kept=kept,
        status=local.status,
        optimal=local.optimal,
        iterations=local.iterations,
        starts=(number,),
    )


def merge_duplicates(robot: Robot, candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the candidates best first, each posture once with the starts that led to it."""
    ordered = sorted(candidates, key=lambda c: (c.cost, c.starts))
    distinct: list[Candidate] = []
    # All known joints in one array: of thousands of postures, one by one takes minutes.
    joints = np.empty((len(ordered), robot.nq - 7))
    for candidate in ordered:
        apart = np.abs(joints[: len(distinct)] - candidate.q[7:]).max(axis=1, initial=0.0)
        # An angle differs by no less than its sine and cosine do.
        for k in np.flatnonzero(apart < SAME_POSTURE):
            difference = robot.difference(distinct[k].q, candidate.q)
            if float(np.abs(difference).max()) < SAME_POSTURE:
                starts = tuple(sorted(distinct[k].starts + candidate.starts))
                distinct[k] = replace(distinct[k], starts=starts)
                break
        else:
            joints[len(distinct)] = candidate.q[7:]
            distinct.append(candidate)
    return tuple(distinct)


def violations(problem: ShapingProblem, snapshot: Snapshot) -> dict[str, float]:
    """Return by how much each frame, joint and pair of bodies violates its constraint."""
    found = _contact_errors(problem, snapshot)
    inside = _joint_margins(problem, snapshot)
    names = problem.robot.joint_names
    found |= {names[k]: float(-inside[k]) for k in np.flatnonzero(inside < 0.0)}
    for one in problem.constraints:
        measured = one.distances(snapshot)
        left, labels = measured.clearance + SKIN, one.labels(measured)
        found |= {
            _violation_key(one, labels[k]): float(-left[k]) for k in np.flatnonzero(left < 0.0)
        }
    return found


def kept_constraints(
    problem: ShapingProblem, snapshot: Snapshot, allowed: Tolerances
) -> ConstraintMargins:
    """Return how well a posture keeps the constraints, and which it violates beyond tolerances."""
    off = _contact_errors(problem, snapshot)
    broken = [
        f"{frame} is {gap:.2g} off its anchor"
        for frame, gap in off.items()
        if not gap <= allowed.of(frame, allowed.contact)
    ]
    inside = _joint_margins(problem, snapshot)
    names = problem.robot.joint_names
    broken += [
        f"joint {names[k]} is {-inside[k]:.2g} beyond its limit"
        for k in np.flatnonzero(~(inside >= -allowed.limit))
        if not inside[k] >= -allowed.of(names[k], allowed.limit)
    ]
    least: dict[bool, list[float]] = {True: [], False: []}
    for one in problem.constraints:
        balance = isinstance(one, ComSupport)
        tolerance = allowed.support if balance else allowed.clearance
        found = one.distances(snapshot)
        left = found.clearance + SKIN  # of the margin itself
        least[balance].append(float(left.min(initial=np.inf)))
        labels = one.labels(found)
        beyond = [
            k
            for k in np.argsort(left)
            if not left[k] >= -tolerance
            and not left[k] >= -allowed.of(_violation_key(one, labels[k]), tolerance)
        ]
        broken += [
            f"{labels[k]} lacks {-left[k]:.2g} m of {one.name!r}" for k in beyond[:NAMED_PAIRS]
        ]
    return ConstraintMargins(
        max(off.values(), default=0.0),
        float(inside.min(initial=np.inf)),
        min(least[True], default=None),
        min(least[False], default=None),
        tuple(broken),
    )


def _contact_errors(problem: ShapingProblem, snapshot: Snapshot) -> dict[str, float]:
    """Return how far each held frame is from its anchor [m or rad]."""
    return {c.frame: float(np.abs(c.residual(snapshot).error).max()) for c in problem.contacts}


def _joint_margins(problem: ShapingProblem, snapshot: Snapshot) -> Array:
    """Return how far each joint is inside its limits (nv-6,) [rad or m]."""
    joints = problem.robot.limits.joint_positions(snapshot.q)
    return np.minimum(joints - problem.limits.lower, problem.limits.upper - joints)


def _violation_key(constraint: Margin, label: str) -> str:
    return f"{constraint.name}: {label}"
