"""Frames that are held where they are: the robot's support.

A contact gives equality rows ``J v = -gain/dt * error``: the frame must not move, and what little
it has drifted from its anchor is taken back. The anchor is given once, by the caller.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot, Snapshot
from wbc.robot.names import BASE
from wbc.rotations import check_rotation, log_rotation
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.tasks.task import Residual
from wbc.validate import Array, finite_array, finite_number, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

SUPPORTS = ("floating", "left", "right", "double")


class Contact:
    """A frame held in position and orientation (six rows: x y z rx ry rz).

    Parameters
    ----------
    frame:
        The held frame, for instance ``"left_sole"``.
    position, rotation:
        Its anchor in the world: (3,) [m] and (3, 3).
    gain:
        Fraction of the drift from the anchor that is taken back in one tick, in [0, 1].
    """

    rows: tuple[str, ...] = AXES + TURNS

    def __init__(
        self,
        robot: Robot,
        frame: str,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        gain: float = 0.5,
    ) -> None:
        robot.frame_id(frame)
        what = f"contact {frame!r}"
        self.robot = robot
        self.frame = frame
        self.position = read_only(finite_array(f"{what}, position", position, (3,)))
        self.rotation = read_only(finite_array(f"{what}, rotation", rotation, (3, 3)))
        check_rotation(f"{what}, rotation", self.rotation)
        self.gain = finite_number(f"{what}, gain", gain, least=0.0)
        if self.gain > 1.0:
            raise InvalidInputError(f"{what}, gain: {gain:g} is above 1")
        self.labels = tuple(f"{frame} {row}" for row in self.rows)
        self.weight = read_only(np.ones(len(self.rows)))

    @classmethod
    def hold(cls, snapshot: Snapshot, frame: str, *, gain: float = 0.5) -> Contact:
        """Return a contact that holds ``frame`` where it is in ``snapshot``."""
        position, rotation = snapshot.position(frame), snapshot.rotation(frame)
        return cls(snapshot.robot, frame, position, rotation, gain=gain)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.frame!r})"

    @property
    def name(self) -> str:
        """The held frame's."""
        return self.frame

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the drift from the anchor, [m] above [rad], and the frame's Jacobian; world axes.

        The derivative of a rotation vector e is Jlog(e) w, not w. But Jlog(e) e = e, so holding
        ``Jlog w = -k e`` and ``w = -k e`` is the same, and the plain Jacobian costs nothing.
        """
        R = snapshot.rotation(self.frame)
        error = np.empty(6)
        error[:3] = snapshot.position(self.frame) - self.position
        error[3:] = R @ log_rotation(self.rotation.T @ R)
        return Residual(error, snapshot.jacobian(self.frame), _NOTHING)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the frame's acceleration (k,) at zero acceleration of v, world axes."""
        return snapshot.drift(self.frame)[: len(self.rows)]

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor, [m] above [rad], as an expression of the posture."""
        return posture.pose_error(self.frame, self.position, self.rotation)

    def slip(self, snapshot: Snapshot) -> float:
        """Return how far the frame's origin is from its anchor [m]."""
        return float(np.linalg.norm(snapshot.position(self.frame) - self.position))


class PointContact(Contact):
    """A point held in position and free to turn (three rows: x y z)."""

    rows = AXES

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the drift from the anchor [m]."""
        error = snapshot.position(self.frame) - self.position
        return Residual(error, snapshot.jacobian(self.frame)[:3], _NOTHING[:3])

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor [m]."""
        return posture.position(self.frame) - self.position


_NOTHING = read_only(np.zeros(6))


def support(snapshot: Snapshot, mode: str | Sequence[str]) -> tuple[Contact, ...]:
    """Return the contacts of a support mode, anchored at ``snapshot`` (paper 5.2).

    Those of a robot whose base is fixed begin with its base, whatever the mode.

    Parameters
    ----------
    mode:
        ``"floating"``, ``"left"``, ``"right"``, ``"double"``, or a list of frames to hold.

    Raises
    ------
    UnknownNameError
        A mode, foot or frame that does not exist.
    """
    frames = list(mode)
    if isinstance(mode, str):
        frames = [snapshot.robot.foot(foot).frame for foot in _feet_of(mode)]
    return base_contact(snapshot) + tuple(Contact.hold(snapshot, frame) for frame in frames)


def base_contact(snapshot: Snapshot) -> tuple[Contact, ...]:
    """Return the contact that holds the base where it is; none if the robot's base floats."""
    return (Contact.hold(snapshot, BASE),) if snapshot.robot.fixed_base else ()


def _feet_of(mode: str) -> tuple[str, ...]:
    if mode not in SUPPORTS:
        raise UnknownNameError("support mode", mode, SUPPORTS)
    return {"floating": (), "double": ("left", "right")}.get(mode, (mode,))
