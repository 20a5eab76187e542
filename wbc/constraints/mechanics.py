"""What a robot's own mechanics hold, met exactly: gears of mimic joints, and a bolted base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.constraints.contact import Contact
from wbc.laws import Residual
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.robot.names import BASE
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.tasks.task import Task
from wbc.validate import Array, read_only


class Gear(Task):
    """One joint at ``ratio * driver + offset``, as the robot's file says (one row).

    Controllers hold the gears of their robot by themselves; see :func:`mechanics_of`.
    """

    _kind = "gear"

    def __init__(self, robot: Robot, joint: str) -> None:
        super().__init__(robot, f"gear of {joint}", ("gear",), gain=1.0)
        coupling = robot.couplings[joint]
        self._ends = [robot.joint_index(joint) - 6, robot.joint_index(coupling.driver) - 6]
        self._signs = np.array([1.0, -coupling.ratio])
        self._offset = coupling.offset
        jacobian = np.zeros((1, robot.nv))
        jacobian[0, [6 + k for k in self._ends]] = self._signs
        self._jacobian = read_only(jacobian)
        self._still = self._zeros()

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the gear's error [rad or m]."""
        positions = snapshot.robot.limits.joint_positions(snapshot.q)[self._ends]
        return Residual(
            np.array([self._signs @ positions - self._offset]), self._jacobian, self._still
        )

    def native(self) -> tuple[NativeRows, ...]:
        """Return the one row, linear in the joints."""
        numbers = self._jacobian.ravel(), np.array((self._offset,))
        return (NativeRows(Kind.LINEAR, None, (0,), self._still, self._still, numbers),)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return zero: the row is linear in the joints."""
        return self._still


class BoltedBase(Task):
    """A fixed base that does not move, wherever it is (six rows)."""

    _kind = "bolted"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, "bolted base", AXES + TURNS, gain=1.0)
        self._jacobian = read_only(np.eye(6, robot.nv))
        self._still = self._zeros()

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return no error, and the base's own six columns."""
        return Residual(self._still, self._jacobian, self._still)

    def native(self) -> tuple[NativeRows, ...]:
        """Return the six rows."""
        numbers = self._jacobian.ravel(), self._still
        still = self._still
        return (NativeRows(Kind.LINEAR, None, tuple(range(6)), still, still, numbers),)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return zero."""
        return self._still


def mechanics_of(robot: Robot, contacts: Sequence[Task]) -> tuple[Task, ...]:
    """Return ``contacts`` behind what holds mimic joints and, if they do not, a fixed base."""
    given = [contact for contact in contacts if not isinstance(contact, Gear | BoltedBase)]
    held = any(isinstance(one, Contact) and one.frame == BASE for one in given)
    bolted = (BoltedBase(robot),) if robot.fixed_base and not held else ()
    return (*bolted, *(Gear(robot, joint) for joint in robot.couplings), *given)
