"""The robot as seen from its base: placements of frames, CoM and inertia as CasADi expressions.

Nothing here depends on where the base is. Composite second moments are summed from the tips to the
base (theory, section 2), which leaves far fewer operations than summing in the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin

from wbc.robot.limits import BASE_NV
from wbc.robot.model import Robot
from wbc.robot.symbolic.placement import Placement, constant, turn_about
from wbc.validate import Array

ROOT = 1  # Pinocchio's index of the free-flyer
# Of a joint: (cosine, sine) of its angle, or (distance,) along its axis.
Coordinate = tuple[ca.SX, ...]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Mass, first moment (3, 1) and second moment (3, 3) of a composite body, in one frame."""

    mass: float
    first: ca.SX
    second: ca.SX

    @classmethod
    def of(cls, inertia: pin.Inertia) -> _Moments:
        P = np.array(pin.PseudoInertia.FromInertia(inertia).toMatrix())
        return cls(float(P[3, 3]), constant(P[:3, 3]), constant(P[:3, :3]))

    def __add__(self, other: _Moments) -> _Moments:
        first, second = self.first + other.first, self.second + other.second
        return _Moments(self.mass + other.mass, first, second)

    def seen_from(self, place: Placement) -> _Moments:
        """Return the moments in the frame in which this one's frame is at ``place``."""
        R, p = place.rotation, place.position
        turned = ca.mtimes(R, self.first)
        lever = ca.mtimes(turned, p.T)
        second = ca.mtimes(ca.mtimes(R, self.second), R.T) + lever + lever.T
        return _Moments(self.mass, turned + self.mass * p, second + self.mass * ca.mtimes(p, p.T))


class LocalRobot:
    """Quantities in base axes, from the base's origin, as expressions of the joints.

    Parameters
    ----------
    robot:
        Where placements, axes and inertias are from.
    coordinates:
        One entry per actuated joint: see :func:`angle_turns` and :func:`configuration_turns`.

    Attributes
    ----------
    com:
        CoM (3, 1) [m].
    inertia:
        CRB inertia about the CoM (3, 3) [kg m^2].
    """

    def __init__(self, robot: Robot, coordinates: tuple[Coordinate, ...]) -> None:
        self.robot = robot
        in_parent = _joint_placements(robot.model, coordinates)
        whole = _composite(robot.model, in_parent)
        self.com = whole.first / whole.mass
        second = whole.second - ca.mtimes(whole.first, self.com.T)
        self.inertia = ca.trace(second) * ca.SX.eye(3) - second
        self._joints = _chained(robot.model, in_parent)
        self._frames: dict[str, Placement] = {}

    def joint(self, index: int) -> Placement:
        """Return where a joint is, by Pinocchio's index; the free-flyer's, 1, is the base."""
        return self._joints[index]

    def frame(self, name: str) -> Placement:
        """Return where a frame of the robot is.

        Raises
        ------
        UnknownNameError
            No such frame.
        """
        found = self._frames.get(name)
        if found is None:
            frame = self.robot.model.frames[self.robot.frame_id(name)]
            inner = Placement.constant(frame.placement.rotation, frame.placement.translation)
            found = self._joints[frame.parentJoint] @ inner
            self._frames[name] = found
        return found


def angle_turns(robot: Robot, joints: ca.SX) -> tuple[Coordinate, ...]:
    """Return the coordinates at joint positions (nv-6, 1) [rad or m]; all joints are angles."""
    return tuple(
        (joints[k],) if prismatic else (ca.cos(joints[k]), ca.sin(joints[k]))
        for k, prismatic in enumerate(_prismatic(robot.model))
    )


def configuration_angles(robot: Robot, q: ca.SX) -> ca.SX:
    """Return the joint positions (nv-6, 1) [rad or m] of a configuration (nq, 1)."""
    limits = robot.limits
    found = [q[start] for start in limits.starts]
    for k in limits.unbounded:
        found[k] = ca.atan2(q[limits.starts[k] + 1], q[limits.starts[k]])
    return ca.vertcat(*found)


def configuration_turns(robot: Robot, q: ca.SX) -> tuple[Coordinate, ...]:
    """Return the coordinates at a configuration (nq, 1), continuous joints as (cos, sin)."""
    limits = robot.limits
    angles = ca.vertcat(*(q[start] for start in limits.starts))
    found = list(angle_turns(robot, angles))
    for k in limits.unbounded:
        found[k] = (q[limits.starts[k]], q[limits.starts[k] + 1])
    return tuple(found)


def _prismatic(model: pin.Model) -> list[bool]:
    return [bool(np.any(_axis(model, j)[:3])) for j in range(ROOT + 1, model.njoints)]


def _axis(model: pin.Model, joint: int) -> Array:
    """Return a joint's motion subspace (6,) in its own frame, linear first."""
    return np.array(model.joints[joint].createData().S, dtype=float).reshape(6)


def _joint_placements(
    model: pin.Model, coordinates: tuple[Coordinate, ...]
) -> dict[int, Placement]:
    """Return where each joint is in its parent joint's frame."""
    placed = {}
    for joint in range(ROOT + 1, model.njoints):
        fixed = model.jointPlacements[joint]
        outer = Placement.constant(fixed.rotation, fixed.translation)
        coordinate = coordinates[model.idx_vs[joint] - BASE_NV]
        axis = _axis(model, joint)
        if len(coordinate) == 1:
            inner = Placement(ca.SX.eye(3), constant(axis[:3]) * coordinate[0])
        else:
            inner = Placement(turn_about(axis[3:], *coordinate), ca.SX(3, 1))
        placed[joint] = outer @ inner
    return placed


def _chained(model: pin.Model, in_parent: dict[int, Placement]) -> dict[int, Placement]:
    """Return where each joint is in the base; expressions nobody reads cost nothing later."""
    placed = {ROOT: Placement.identity()}
    for joint, placement in in_parent.items():
        placed[joint] = placed[model.parents[joint]] @ placement
    return placed


def _composite(model: pin.Model, in_parent: dict[int, Placement]) -> _Moments:
    """Return the moments of the whole robot in the base's frame."""
    moments = {joint: _Moments.of(model.inertias[joint]) for joint in (ROOT, *in_parent)}
    for joint in reversed(in_parent):
        moments[model.parents[joint]] += moments[joint].seen_from(in_parent[joint])
    return moments[ROOT]
