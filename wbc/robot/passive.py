"""Passive joint forces: springs, gravity compensation, nonlinear damping.

Linear damping and dry friction are the robot's ``damping`` and ``friction`` and not in here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from wbc.robot.limits import BASE_NV, JointLimits
from wbc.validate import Array, read_only

# Rotations (njoints, 3, 3) and origins (njoints, 3) of joints, and their twists (6, nv) at the
# world's origin.
JointPlacements = tuple[Array, Array, Array]


class Spring(NamedTuple):
    """A spring on one joint that rests at ``rest`` [rad or m].

    With x = q - rest it gives -(k x + k1 x^2 + k2 x^3), as MuJoCo's ``stiffness="k k1 k2"``.
    """

    stiffness: float  # [N m/rad or N/m]
    curved: tuple[float, float]  # k1 [N m/rad^2], k2 [N m/rad^3]
    rest: float


class GravityCompensation(NamedTuple):
    """An upward force on a body that takes its weight, or a part of it, off the joints."""

    frame: str  # the body's
    point: tuple[float, float, float]  # where it acts, in that frame [m]
    mass: float  # what it lifts [kg]


@dataclass(frozen=True, eq=False)
class PassiveForces:
    """The passive forces of a description."""

    springs: Mapping[str, Spring] = field(default_factory=dict)  # by joint
    lifts: tuple[GravityCompensation, ...] = ()  # gravity compensation of bodies
    # by joint b1 [N m s^2/rad^2] and b2 [N m s^3/rad^3] of -(b1 v |v| + b2 v^3), beside the linear
    # damping
    curved_damping: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.springs or self.lifts or self.curved_damping)

    def of(self, model: pin.Model, limits: JointLimits) -> PassiveForces:
        """Return those of the joints that ``model`` has: what is locked needs no spring."""
        names = set(limits.names)
        frames = model.frames
        lifts = tuple(x for x in self.lifts if frames[_frame_of(model, x)].parentJoint > 0)
        return PassiveForces(
            {joint: spring for joint, spring in self.springs.items() if joint in names},
            lifts,
            {joint: curve for joint, curve in self.curved_damping.items() if joint in names},
        )

    def forces(
        self,
        model: pin.Model,
        limits: JointLimits,
        q: Array,
        v: Array,
        placed: JointPlacements | None,
    ) -> Array:
        """Return the generalised forces (nv,) [N, N m] at ``q`` (nq,) and ``v`` (nv,).

        They stand on the side of the torques: M a + bias = S' tau + J' f + forces - friction.
        ``placed`` is where the joints are at q, and has to be given where there are lifts.
        """
        found = np.zeros(model.nv)
        positions = limits.joint_positions(q)
        for joint, spring in self.springs.items():
            k = limits.names.index(joint)
            x = positions[k] - spring.rest
            k1, k2 = spring.curved
            found[BASE_NV + k] -= x * (spring.stiffness + x * (k1 + x * k2))
        for joint, (b1, b2) in self.curved_damping.items():
            k = BASE_NV + limits.names.index(joint)
            found[k] -= v[k] * (b1 * abs(v[k]) + b2 * v[k] * v[k])
        if placed is not None:
            found += self._compensation(model, placed)
        return read_only(found)

    def _compensation(self, model: pin.Model, placed: JointPlacements) -> Array:
        rotations, origins, twists = placed
        gravity, found = np.array(model.gravity.linear), np.zeros(model.nv)
        for lift in self.lifts:
            frame = model.frames[_frame_of(model, lift)]
            joint, force = frame.parentJoint, -lift.mass * gravity
            point = rotations[joint] @ frame.placement.act(np.array(lift.point)) + origins[joint]
            pull = np.concatenate((force, np.cross(point, force))) @ twists
            for above in list(model.supports[joint])[1:]:
                moved = slice(model.idx_vs[above], model.idx_vs[above] + model.nvs[above])
                found[moved] += pull[moved]
        return found


NO_FORCES = PassiveForces()


def _frame_of(model: pin.Model, lift: GravityCompensation) -> int:
    return int(model.getFrameId(lift.frame, pin.FrameType.BODY))
