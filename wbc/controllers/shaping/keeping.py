"""How well a posture keeps the constraints, measured by Pinocchio, and what counts as kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from wbc.constraints import ComSupport
from wbc.constraints.clearance import SKIN, Clearance
from wbc.controllers.shaping.outcome import Kept
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.robot import Snapshot
from wbc.validate import Array

TOLD = 3  # pairs that are named: the worst


@dataclass(frozen=True)
class Tolerances:
    """How far beyond a constraint still counts as kept.

    Attributes
    ----------
    contact:
        Distance of a held frame from its anchor [m or rad].
    limit:
        Of a joint beyond its limit [rad or m].
    support:
        Of the CoM outside a support polygon, less its margin [m].
    clearance:
        Of bodies nearer than their margin, and of frames outside their boxes [m].
    excused:
        What is allowed beyond that, by thing.
    """

    contact: float
    limit: float
    support: float
    clearance: float

    excused: Mapping[str, float] = field(default_factory=dict)

    def excusing(self, lacking: Mapping[str, float]) -> Tolerances:
        """Return tolerances with what is broken already, thing by thing: see :func:`shortfalls`.

        A hand that is in a wall at the start is no leave for a foot to go through the floor.
        """
        return replace(self, excused=dict(lacking))

    def of(self, thing: str, allowed: float) -> float:
        """Return how far beyond its constraint a thing may be, given what all such may."""
        return allowed + self.excused.get(thing, 0.0)


def shortfalls(problem: ShapingProblem, snapshot: Snapshot) -> dict[str, float]:
    """Return by how much each frame, joint and pair of bodies breaks its constraint."""
    found = _off(problem, snapshot)
    room = _joint_room(problem, snapshot)
    names = problem.robot.joint_names
    found |= {names[k]: float(-room[k]) for k in np.flatnonzero(room < 0.0)}
    for one in problem.constraints:
        gaps = one.gaps(snapshot)
        left, labels = gaps.room + SKIN, one.labels(gaps)
        found |= {_thing(one, labels[k]): float(-left[k]) for k in np.flatnonzero(left < 0.0)}
    return found


def kept_constraints(problem: ShapingProblem, snapshot: Snapshot, allowed: Tolerances) -> Kept:
    """Return how well a posture keeps the constraints, and which it breaks beyond tolerances."""
    off = _off(problem, snapshot)
    broken = [
        f"{frame} is {gap:.2g} off its anchor"
        for frame, gap in off.items()
        if not gap <= allowed.of(frame, allowed.contact)
    ]
    room = _joint_room(problem, snapshot)
    names = problem.robot.joint_names
    broken += [
        f"joint {names[k]} is {-room[k]:.2g} beyond its limit"
        for k in np.flatnonzero(~(room >= -allowed.limit))
        if not room[k] >= -allowed.of(names[k], allowed.limit)
    ]
    rooms: dict[bool, list[float]] = {True: [], False: []}
    for one in problem.constraints:
        balance = isinstance(one, ComSupport)
        lost = allowed.support if balance else allowed.clearance
        found = one.gaps(snapshot)
        left = found.room + SKIN  # of the margin itself
        rooms[balance].append(float(left.min(initial=np.inf)))
        labels = one.labels(found)
        lacking = [
            k
            for k in np.argsort(left)
            if not left[k] >= -lost and not left[k] >= -allowed.of(_thing(one, labels[k]), lost)
        ]
        broken += [f"{labels[k]} lacks {-left[k]:.2g} m of {one.name!r}" for k in lacking[:TOLD]]
    return Kept(
        max(off.values(), default=0.0),
        float(room.min(initial=np.inf)),
        min(rooms[True], default=None),
        min(rooms[False], default=None),
        tuple(broken),
    )


def _off(problem: ShapingProblem, snapshot: Snapshot) -> dict[str, float]:
    """Return how far each held frame is from its anchor [m or rad]."""
    return {c.frame: float(np.abs(c.residual(snapshot).error).max()) for c in problem.contacts}


def _joint_room(problem: ShapingProblem, snapshot: Snapshot) -> Array:
    """Return how far each joint is inside its limits (nv-6,) [rad or m]."""
    joints = problem.robot.limits.joint_positions(snapshot.q)
    return np.minimum(joints - problem.limits.lower, problem.limits.upper - joints)


def _thing(constraint: Clearance, label: str) -> str:
    return f"{constraint.name}: {label}"
