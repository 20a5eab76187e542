"""Contacts: tasks that are met exactly, such as soles held on the ground.

A contact is a task whose rows become equality rows ``J v = -gain/dt * error`` of the QP instead of
a cost. The anchor is given once, by the caller. Any other task may be held the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import UnknownNameError
from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.robot.names import BASE
from wbc.rotations import check_rotation, log_rotation
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.tasks.task import LawKeywords, Task
from wbc.validate import Array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

SUPPORTS = ("floating", "left", "right", "double")


class Contact(Task):
    """A frame held in position and orientation (six rows: x y z rx ry rz).

    Its rows are met exactly: the frame must not move, and what little it has drifted from its
    anchor is taken back.

    Parameters
    ----------
    frame:
        The held frame, for instance ``"left_sole"``; also the contact's name.
    position, rotation:
        Its anchor in the world: (3,) [m] and (3, 3).
    gain:
        Fraction of the drift from the anchor that is taken back in one tick, in [0, 1].
    """

    ROWS: tuple[str, ...] = AXES + TURNS
    _kind = "contact"
    _may_rest = True

    def __init__(
        self,
        robot: Robot,
        frame: str,
        position: ArrayLike,
        rotation: ArrayLike,
        **law: Unpack[LawKeywords],
    ) -> None:
        robot.frame_id(frame)
        super().__init__(robot, frame, self.ROWS, **law)
        self.frame = frame
        self.position = self._target(position, (3,), "position")
        self.rotation = self._target(rotation, (3, 3), "rotation")
        check_rotation(f"contact {frame!r}, rotation", self.rotation)
        self._still = self._zeros()

    @classmethod
    def hold(cls, snapshot: Snapshot, frame: str, **law: Unpack[LawKeywords]) -> Contact:
        """Return a contact that holds ``frame`` where it is in ``snapshot``."""
        position, rotation = snapshot.position(frame), snapshot.rotation(frame)
        return cls(snapshot.robot, frame, position, rotation, **law)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.frame!r})"

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the drift from the anchor, [m] above [rad], and the frame's Jacobian; world axes.

        The derivative of a rotation vector e is Jlog(e) w, not w. But Jlog(e) e = e, so holding
        ``Jlog w = -k e`` and ``w = -k e`` is the same, and the plain Jacobian costs nothing.
        """
        R = snapshot.rotation(self.frame)
        error = np.empty(6)
        error[:3] = snapshot.position(self.frame) - self.position
        error[3:] = R @ log_rotation(self.rotation.T @ R)
        return Residual(error, snapshot.jacobian(self.frame), self._still)

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

    ROWS = AXES

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the drift from the anchor [m]."""
        error = snapshot.position(self.frame) - self.position
        return Residual(error, snapshot.jacobian(self.frame)[:3], self._still)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor [m]."""
        return posture.position(self.frame) - self.position


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
