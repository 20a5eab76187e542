"""How well a posture keeps the constraints, measured by Pinocchio, and what counts as kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.controllers.shaping.outcome import Kept
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.robot import Snapshot


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
        Of the CoM outside the support polygon [m].
    clearance:
        Of capsules nearer than asked for [m].
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
    support = None
    if problem.support is not None:
        normals, reach = problem.support[:, :2], problem.support[:, 2]
        support = float((reach - normals @ snapshot.com[:2]).min())
        if not support >= -allowed.support:
            broken.append(f"the CoM is {-support:.2g} m outside the support polygon")
    apart = [pair.excess(snapshot) for pair in problem.capsules]
    broken += [
        f"{pair.name} is {-excess:.2g} m too near"
        for pair, excess in zip(problem.capsules, apart, strict=True)
        if not excess >= -allowed.clearance
    ]
    return Kept(
        max(off.values(), default=0.0),
        float(room.min(initial=np.inf)),
        support,
        min(apart, default=None),
        tuple(broken),
    )
