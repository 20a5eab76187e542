"""The robot in the world, as CasADi expressions and as Functions of the configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca

from wbc.robot.limits import BASE_NQ
from wbc.robot.model import Robot
from wbc.robot.snapshot import BASE, WORLD
from wbc.robot.symbolic.chain import LocalRobot, configuration_turns
from wbc.robot.symbolic.placement import Placement, from_quaternion
from wbc.spatial import COLUMNS, ROWS


@dataclass(frozen=True, eq=False)
class SymbolicPosture:
    """What a :class:`~wbc.robot.snapshot.Snapshot` at rest tells, as expressions.

    Attributes
    ----------
    local:
        The robot as seen from its base.
    base:
        Where the base is in the world.
    """

    local: LocalRobot
    base: Placement

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
    here = SymbolicPosture(local, Placement(from_quaternion(q[3:BASE_NQ]), q[:3]))
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
