"""The robot in the world, as CasADi expressions and as Functions of the configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import casadi as ca

from wbc.robot.limits import BASE_NQ
from wbc.robot.model import Robot
from wbc.robot.names import BASE, WORLD
from wbc.robot.symbolic.chain import LocalRobot, configuration_angles, configuration_turns
from wbc.robot.symbolic.placement import Placement, from_quaternion, rotation_log
from wbc.spatial import COLUMNS, ROWS
from wbc.validate import Array

Expression: TypeAlias = ca.SX


@dataclass(frozen=True, eq=False)
class SymbolicPosture:
    """What a :class:`~wbc.robot.model.Snapshot` at rest tells, as expressions.

    Expressions take NumPy arrays and operators, ``@`` included; a vector is a column (k, 1).

    Attributes
    ----------
    local:
        The robot as seen from its base.
    base:
        Where the base is in the world.
    joints:
        Joint positions (nv-6, 1) [rad or m].
    free_rotations:
        Rotations (3, 3) that are unknowns of tasks, by the tasks' names; see
        :meth:`wbc.tasks.Task.free_rotation`.
    """

    local: LocalRobot
    base: Placement
    joints: ca.SX
    free_rotations: Mapping[str, ca.SX] = field(default_factory=dict)

    @property
    def com(self) -> ca.SX:
        """CoM (3, 1) [m], world axes."""
        return self.base.position + ca.mtimes(self.base.rotation, self.local.com)

    def inertia_in(self, frame: str = WORLD) -> ca.SX:
        """Centroidal inertia (3, 3) [kg m^2] in axes of ``world``, ``base`` or a named frame.

        In axes of the robot it is an expression of the joints alone, structurally.
        """
        if frame == BASE:
            return self.local.inertia
        R = self.base.rotation.T if frame == WORLD else self.local.frame(frame).rotation
        return ca.mtimes(ca.mtimes(R.T, self.local.inertia), R)

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

    def inertia_error(self, selection: Array, target: Array | ca.SX, frame: str = WORLD) -> ca.SX:
        """Return selection (k, 6) times vech of the centroidal inertia minus ``target`` (3, 3)."""
        return ca.mtimes(ca.DM(selection), vech_symbolic(self.inertia_in(frame) - target))


def vech_symbolic(S: ca.SX) -> ca.SX:
    """Return the (6, 1) vector (xx, xy, xz, yy, yz, zz) of a symmetric (3, 3) matrix."""
    return ca.vertcat(*(S[int(i), int(j)] for i, j in zip(ROWS, COLUMNS, strict=True)))


def posture_functions(
    robot: Robot, frames: Iterable[str] = (), axes: str = WORLD
) -> Mapping[str, ca.Function]:
    """Return CasADi Functions of the configuration q (nq).

    Parameters
    ----------
    frames:
        Frames to give placements of.
    axes:
        Whose axes the inertia is in: ``"world"``, ``"base"`` or a frame.

    Returns
    -------
    ``com``: q -> (3,) [m]. ``inertia``: q -> (6,) entries xx xy xz yy yz zz about the CoM [kg m^2].
    For each frame, by its name: q -> position (3,), rotation (3, 3).

    Raises
    ------
    UnknownNameError
        No such frame.
    """
    q = ca.SX.sym("q", robot.nq)
    local = LocalRobot(robot, configuration_turns(robot, q))
    base = Placement(from_quaternion(q[3:BASE_NQ]), q[:3])
    here = SymbolicPosture(local, base, configuration_angles(robot, q))
    functions = {
        "com": ca.Function("com", [q], [here.com], ["q"], ["com"]),
        "inertia": ca.Function(
            "inertia", [q], [vech_symbolic(here.inertia_in(axes))], ["q"], ["inertia"]
        ),
    }
    for k, frame in enumerate(frames):
        outputs = [here.position(frame), here.rotation(frame)]
        functions[frame] = ca.Function(f"frame_{k}", [q], outputs, ["q"], ["position", "rotation"])
    return functions
