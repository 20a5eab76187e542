"""The robot as CasADi expressions: what optimisers over configurations differentiate.

The PyPI build of Pinocchio has no CasADi scalar, so the chain is built from the model's own joint
placements, axes and inertias; Pinocchio itself is the tests' oracle. Composite second moments are
summed from the tips to the base (theory, section 2), which leaves far fewer operations than summing
in the world.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.placement import Placement, constant, from_quaternion, rotation_log, turn_about
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.model import Robot
from wbc.robot.names import BASE, COM, WORLD
from wbc.robot.parallel_axis import is_com, moving_frame
from wbc.spatial import COLUMNS, ROWS
from wbc.validate import Array

Expression: TypeAlias = ca.SX
# Of a joint: (cosine, sine) of its angle, or (distance,) along its axis.
Coordinate = tuple[ca.SX, ...]
ROOT = 1  # Pinocchio's index of the free-flyer


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

    ``coordinates``: one entry per actuated joint; see :func:`angle_turns`.

    ``com``: CoM (3, 1) [m].
    ``inertia``: CRB inertia about the CoM (3, 3) [kg m^2].
    """

    def __init__(self, robot: Robot, coordinates: tuple[Coordinate, ...]) -> None:
        self.robot = robot
        model = robot.model
        in_parent = _joint_placements(model, coordinates)
        moments = {joint: _Moments.of(model.inertias[joint]) for joint in (ROOT, *in_parent)}
        for joint in reversed(in_parent):
            moments[model.parents[joint]] += moments[joint].seen_from(in_parent[joint])
        whole = moments[ROOT]
        self.com = whole.first / whole.mass
        second = whole.second - ca.mtimes(whole.first, self.com.T)
        self.inertia = ca.trace(second) * ca.SX.eye(3) - second
        self._joints = {ROOT: Placement.constant(np.eye(3), np.zeros(3))}
        for joint, placement in in_parent.items():  # unread expressions cost nothing later
            self._joints[joint] = self._joints[model.parents[joint]] @ placement
        self._frames: dict[str, Placement] = {}

    def joint(self, index: int) -> Placement:
        """Return where a joint is, by Pinocchio's index; the free-flyer's, 1, is the base."""
        return self._joints[index]

    def frame(self, name: str) -> Placement:
        """Return where a frame of the robot is. Raises UnknownNameError: no such frame."""
        if name not in self._frames:
            frame = self.robot.frame(name)
            inner = Placement.constant(frame.placement.rotation, frame.placement.translation)
            self._frames[name] = self._joints[frame.parentJoint] @ inner
        return self._frames[name]


def angle_turns(robot: Robot, joints: ca.SX) -> tuple[Coordinate, ...]:
    """Return the coordinates at joint positions (nv-6, 1) [rad or m]; all joints are angles."""
    model = robot.model
    slides = [np.any(_axis(model, joint)[:3]) for joint in range(ROOT + 1, model.njoints)]
    return tuple(
        (joints[k],) if prismatic else (ca.cos(joints[k]), ca.sin(joints[k]))
        for k, prismatic in enumerate(slides)
    )


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


@dataclass(frozen=True, eq=False)
class SymbolicPosture:
    """What a :class:`~wbc.robot.model.Snapshot` at rest tells, as expressions.

    Expressions take NumPy arrays and operators, ``@`` included; a vector is a column (k, 1).
    """

    local: LocalRobot  # the robot as seen from its base
    base: Placement  # where the base is in the world
    joints: ca.SX  # joint positions (nv-6, 1) [rad or m]
    # Rotations (3, 3) that are unknowns of tasks, by the tasks' names; see Task.free_rotation.
    free_rotations: Mapping[str, ca.SX] = field(default_factory=dict)

    @classmethod
    def at(cls, robot: Robot, q: ca.SX) -> SymbolicPosture:
        """Return the posture at a configuration (nq, 1), continuous joints as (cos, sin)."""
        starts, unbounded = robot.limits.starts, robot.limits.unbounded
        angles = [q[start] for start in starts]
        coordinates = list(angle_turns(robot, ca.vertcat(*angles)))
        for k in unbounded:
            cosine, sine = q[starts[k]], q[starts[k] + 1]
            angles[k], coordinates[k] = ca.atan2(sine, cosine), (cosine, sine)
        base = Placement(from_quaternion(q[3:BASE_NQ]), q[:3])
        return cls(LocalRobot(robot, tuple(coordinates)), base, ca.vertcat(*angles))

    @property
    def com(self) -> ca.SX:
        """CoM (3, 1) [m], world axes."""
        return self.base.position + ca.mtimes(self.base.rotation, self.local.com)

    def inertia_in(self, frame: str = WORLD, about: str | ArrayLike = COM) -> ca.SX:
        """CRB inertia (3, 3) [kg m^2] in axes of ``world``, ``base`` or a named frame.

        ``about`` is as in :meth:`wbc.Snapshot.inertia_in`. In axes of the robot, about its CoM or a
        frame, it is an expression of the joints alone, structurally.
        """
        inertia = self.local.inertia
        if not is_com(about):
            arm = self._local_arm(about)
            inertia += self.local.robot.mass * (ca.dot(arm, arm) * ca.SX.eye(3) - arm @ arm.T)
        if frame == BASE:
            return inertia
        R = self.base.rotation.T if frame == WORLD else self.local.frame(frame).rotation
        return ca.mtimes(ca.mtimes(R.T, inertia), R)

    def _local_arm(self, about: str | ArrayLike) -> ca.SX:
        """Return the arm (3, 1) from a point to the CoM, base axes [m]."""
        frame = moving_frame(about)
        if frame is not None:
            return self.local.com - self.local.frame(frame).position
        point = np.zeros(3) if isinstance(about, str) else np.array(about, dtype=float)
        return ca.mtimes(self.base.rotation.T, self.com - point)

    def position(self, frame: str) -> ca.SX:
        """Origin of a frame in the world (3, 1) [m]."""
        inner = self.local.frame(frame).position
        return self.base.position + ca.mtimes(self.base.rotation, inner)

    def rotation(self, frame: str) -> ca.SX:
        """Rotation (3, 3) taking the frame's axes to the world's."""
        return ca.mtimes(self.base.rotation, self.local.frame(frame).rotation)

    def orientation_error(self, frame: str, target: Array) -> ca.SX:
        """Return the rotation vector log(target' R) (3, 1) [rad]."""
        return rotation_log(ca.mtimes(ca.DM(target).T, self.rotation(frame)))

    def pose_error(self, frame: str, position: Array, rotation: Array) -> ca.SX:
        """Return position minus target [m] above log(target' R) [rad] (6, 1)."""
        place = self.position(frame) - position
        return ca.vertcat(place, self.orientation_error(frame, rotation))

    def joint_errors(self, positions: Array) -> ca.SX:
        """Return joints minus ``positions`` (nv-6, 1), the shorter way round if continuous."""
        error = self.joints - positions
        for k in self.local.robot.limits.unbounded:
            error[k] = ca.atan2(ca.sin(error[k]), ca.cos(error[k]))
        return error

    def inertia_error(
        self,
        selection: Array,
        target: Array | ca.SX,
        frame: str = WORLD,
        about: str | ArrayLike = COM,
    ) -> ca.SX:
        """Return selection (k, 6) times vech of the CRB inertia minus ``target`` (3, 3)."""
        return ca.mtimes(ca.DM(selection), vech_symbolic(self.inertia_in(frame, about) - target))


def vech_symbolic(S: ca.SX) -> ca.SX:
    """Return the (6, 1) vector (xx, xy, xz, yy, yz, zz) of a symmetric (3, 3) matrix."""
    return ca.vertcat(*(S[int(i), int(j)] for i, j in zip(ROWS, COLUMNS, strict=True)))
