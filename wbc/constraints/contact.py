"""Contacts: tasks that are met exactly, such as soles held on the ground.

A contact is a task whose rows become equality rows ``J v = -gain/dt * error`` of the QP instead of
a cost. The anchor is given once, by the caller. Any other task may be held the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import ArrayAttribute
from wbc.constraints.friction import FrictionCone
from wbc.errors import InvalidInputError, shown
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot, check_snapshot
from wbc.robot.names import BASE
from wbc.rotations import check_rotation
from wbc.tasks.core_task import CoreTask
from wbc.tasks.frame import TURNS
from wbc.tasks.keywords import LawKeywords, spell_out
from wbc.tasks.point import AXES
from wbc.tasks.task import Task
from wbc.validate import Array, Index, finite_array, read_only, real_array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

DEFAULT_FRICTION = FrictionCone()
UPWARDS = (0.0, 0.0, 1.0)
LEAST_NORMAL = 1e-9  # a vector that is shorter has no direction


class Contact(CoreTask):
    """A frame held in position and orientation (six rows: x y z rx ry rz).

    Its rows are met exactly: the frame must not move, and what little it has drifted from its
    anchor is taken back, [m] above [rad] in world axes.

    Parameters
    ----------
    frame:
        The held frame, for instance ``"left_sole"``; also the contact's name.
    position, rotation:
        Its anchor in the world: (3,) [m] and (3, 3).
    gain:
        Fraction of the drift from the anchor that is taken back in one tick, in [0, 1]. At the
        torque level ``kp`` and ``kd`` do that, 100/s^2 and critical unless given.
    friction:
        What it bears, for the torque level: forces at its corners inside this cone. None for a
        contact that also pulls and twists: a grip, a bolt. Assign another one at any time.
    corners:
        (k, 2) or (k, 3) points in the frame's axes at which forces act [m], the frame's z axis
        being the normal; by default those of the sole that the frame is.

    Attributes
    ----------
    friction:
        The :class:`~wbc.constraints.friction.FrictionCone`, or None.
    corners:
        (k, 3) in the frame's axes [m], or None if the frame is no sole and none were given. Fixed.
    """

    frame: str
    friction: FrictionCone | None
    corners: Array | None
    position: ArrayAttribute  # the anchor, (3,) [m], read-only
    rotation: ArrayAttribute  # (3, 3), read-only

    ROWS: tuple[str, ...] = AXES + TURNS
    # 1/s^2, critically damped. At 400 the ankles of a robot without rotor inertia chatter: ground
    # that gives way a little is a delay.
    STIFFNESS = 100.0
    _kind = "contact"
    _may_rest = True

    def __init__(
        self,
        robot: Robot,
        frame: str,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        friction: FrictionCone | None = DEFAULT_FRICTION,
        corners: ArrayLike | None = None,
        **law: Unpack[LawKeywords],
    ) -> None:
        check_robot(type(self).__name__, robot)
        robot.frame_id(frame)
        law.setdefault("kp", self.STIFFNESS)
        super().__init__(robot, frame, self.ROWS, **law)
        self.frame = frame
        self.friction = None if frame == BASE and friction is DEFAULT_FRICTION else friction
        self.corners = self._corners(corners)
        self.position, self.rotation = position, rotation

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "position":
            value = self._target(value, (3,), name)
        elif name == "rotation":
            value = self._target(value, (3, 3), name)
            check_rotation(f"{self}, {name}", value)
        elif name == "friction" and not isinstance(value, FrictionCone | None):
            raise InvalidInputError(
                f"{self}, friction: expected FrictionCone(0.6), or None, got {shown(value)}"
            )
        elif name == "friction" and value is not None and self.frame == BASE:
            raise InvalidInputError(
                f"{self}, friction: what holds the base also pulls, and has no friction; leave it"
                " out"
            )
        elif name == "corners" and name in self.__dict__:  # forces at them are unknowns of a QP
            raise InvalidInputError(
                f"{self}, corners: cannot be assigned; make another contact with corners=..., and"
                " hand it to set_contacts()"
            )
        super()._set_attribute(name, value)

    @classmethod
    @spell_out
    def hold(
        cls,
        snapshot: Snapshot,
        frame: str,
        *,
        friction: FrictionCone | None = DEFAULT_FRICTION,
        corners: ArrayLike | None = None,
        **law: Unpack[LawKeywords],
    ) -> Self:
        """Return a contact that holds ``frame`` where it is in ``snapshot``."""
        return cls(*cls._hold_arguments(snapshot, frame), friction=friction, corners=corners, **law)

    @classmethod
    def _hold_arguments(cls, snapshot: Snapshot, frame: str) -> tuple[Robot, str, Array, Array]:
        """Return robot, frame, and the anchor where it is in ``snapshot``."""
        check_snapshot(f"{cls.__name__}.hold", snapshot)
        return snapshot.robot, frame, *snapshot.placement(frame)

    def move_to(self, snapshot: Snapshot) -> None:
        """Hold the frame where it is in ``snapshot`` from now on."""
        check_snapshot(f"{self}, move_to", snapshot)
        position, rotation = snapshot.placement(self.frame)  # read-only, and right: not checked
        self.__dict__.update(position=position, rotation=rotation)
        self._remade()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.frame!r})"

    def native(self) -> tuple[NativeRows, ...]:
        """Return its rows, six or the first three."""
        index, numbers = tuple(range(len(self.rows))), (self.position, self.rotation.ravel())
        still = self._zeros()
        return (NativeRows(Kind.CONTACT, self.frame, index, still, still, numbers),)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor, [m] above [rad], as an expression of the posture."""
        return posture.pose_error(self.frame, self.position, self.rotation)

    def slip(self, snapshot: Snapshot) -> float:
        """Return how far the frame's origin is from its anchor [m]."""
        check_snapshot(f"{self}, slip", snapshot)
        return float(np.linalg.norm(snapshot.position(self.frame) - self.position))

    def _corners(self, given: ArrayLike | None) -> Array | None:
        if given is None:
            feet = self.robot.feet.values()
            given = next((foot.polygon for foot in feet if foot.frame == self.frame), None)
            if given is None:
                return None
        points = real_array(f"{self}, corners", given)
        if points.ndim != 2 or not len(points) or points.shape[1] not in (2, 3):
            raise InvalidInputError(
                f"{self}, corners: expected (k, 2) or (k, 3) points, got shape {points.shape}"
            )
        corners = np.zeros((len(points), 3))
        corners[:, : points.shape[1]] = finite_array(f"{self}, corners", points, points.shape)
        return read_only(corners)


class PointContact(Contact):
    """A point held in position and free to turn (three rows: x y z).

    Its force acts at the frame's origin.

    Parameters
    ----------
    normal:
        (3,) in the world, out of what is touched: the axis of its friction cone; None: upwards. A
        hand on a wall has a horizontal one. Fixed, as its having a cone is then.

    See :class:`Contact` for the others.

    Attributes
    ----------
    normal:
        (3,), of unit length, read-only.
    """

    normal: Array

    ROWS = AXES

    def __init__(
        self,
        robot: Robot,
        frame: str,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        normal: ArrayLike | None = None,
        friction: FrictionCone | None = DEFAULT_FRICTION,
        corners: ArrayLike | None = None,
        **law: Unpack[LawKeywords],
    ) -> None:
        across = finite_array(
            f"contact {frame!r}, normal", UPWARDS if normal is None else normal, (3,)
        )
        length = float(np.linalg.norm(across))
        if length < LEAST_NORMAL:
            raise InvalidInputError(f"contact {frame!r}, normal: needs some length")
        self.normal, self._has_cone = read_only(across / length), normal is not None
        if self._has_cone and frame == BASE:
            raise InvalidInputError(
                f"contact {frame!r}, normal: what holds the base also pulls, and has none"
            )
        super().__init__(
            robot, frame, position, rotation, friction=friction, corners=corners, **law
        )

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "normal" and name in self.__dict__:  # it is worked into the rows of a QP
            raise InvalidInputError(
                f"{self}, normal: cannot be assigned; make another contact with normal=..., and"
                " hand it to set_contacts()"
            )
        if name == "friction" and value is None and self._has_cone:
            raise InvalidInputError(
                f"{self}, normal: without friction, which is a contact that also pulls, it has no"
                " effect; leave it out, or give a FrictionCone"
            )
        super()._set_attribute(name, value)

    @classmethod
    @spell_out
    def hold(
        cls,
        snapshot: Snapshot,
        frame: str,
        *,
        normal: ArrayLike | None = None,
        friction: FrictionCone | None = DEFAULT_FRICTION,
        corners: ArrayLike | None = None,
        **law: Unpack[LawKeywords],
    ) -> Self:
        """Return a contact that holds ``frame`` where it is in ``snapshot``."""
        placed = cls._hold_arguments(snapshot, frame)
        return cls(*placed, normal=normal, friction=friction, corners=corners, **law)

    def _corners(self, given: ArrayLike | None) -> Array:
        if given is not None:
            raise InvalidInputError(f"{self}, corners: a point has none; use Contact for surfaces")
        return read_only(np.zeros((1, 3)))

    native = Contact.native

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor [m]."""
        return posture.position(self.frame) - self.position


class ContactRows:
    """The rows of contacts in the QP, see :mod:`wbc.constraints.independent_rows`.

    ``contacts``: contacts, or other tasks to be met exactly.
    ``row_selections``: indices of the rows of each, increasing; None for all.

    ``labels``: of the rows, such as ``"left_sole x"``.
    """

    def __init__(self, contacts: Sequence[Task], row_selections: Sequence[Index | None]) -> None:
        self.contacts, self.row_selections = tuple(contacts), tuple(row_selections)
        self.labels = tuple(
            f"{contact.name} {contact.rows[k]}"
            for contact, own in zip(self.contacts, self.row_selections, strict=True)
            for k in (range(len(contact.rows)) if own is None else own)
        )
