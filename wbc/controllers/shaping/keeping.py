"""How well a posture keeps the constraints, measured by Pinocchio, and what counts as kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.constraints import ComSupport
from wbc.constraints.clearance import SKIN
from wbc.controllers.shaping.outcome import Kept
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.robot import Snapshot

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
    """

    contact: float
    limit: float
    support: float
    clearance: float

    def excusing(self, kept: Kept) -> Tolerances:
        """Return tolerances beyond what ``kept`` breaks already."""
        return Tolerances(
            self.contact + kept.contact,
            self.limit + max(-kept.limit, 0.0),
            self.support + max(-(kept.support or 0.0), 0.0),
            self.clearance + max(-(kept.clearance or 0.0), 0.0),
        )


def kept_constraints(problem: ShapingProblem, snapshot: Snapshot, allowed: Tolerances) -> Kept:
    """Return how well a posture keeps the constraints, and which it breaks beyond tolerances."""
    off = {c.frame: float(np.abs(c.residual(snapshot).error).max()) for c in problem.contacts}
    broken = [
        f"{frame} is {gap:.2g} off its anchor"
        for frame, gap in off.items()
        if not gap <= allowed.contact
    ]
    joints = problem.robot.limits.joint_positions(snapshot.q)
    room = np.minimum(joints - problem.limits.lower, problem.limits.upper - joints)
    broken += [
        f"joint {problem.robot.joint_names[k]} is {-room[k]:.2g} beyond its limit"
        for k in np.flatnonzero(~(room >= -allowed.limit))
    ]
    rooms: dict[bool, list[float]] = {True: [], False: []}
    for one in problem.constraints:
        balance = isinstance(one, ComSupport)
        lost = allowed.support if balance else allowed.clearance
        found = one.gaps(snapshot)
        left = found.room + SKIN  # of the margin itself
        rooms[balance].append(float(left.min(initial=np.inf)))
        lacking = [k for k in np.argsort(left)[:TOLD] if not left[k] >= -lost]
        labels = one.labels(found)
        broken += [f"{labels[k]} lacks {-left[k]:.2g} m of {one.name!r}" for k in lacking]
    return Kept(
        max(off.values(), default=0.0),
        float(room.min(initial=np.inf)),
        min(rooms[True], default=None),
        min(rooms[False], default=None),
        tuple(broken),
    )
