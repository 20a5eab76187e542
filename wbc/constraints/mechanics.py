"""The robot's own mechanical constraints, met exactly: gears, closed loops, and a bolted base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.constraints.contact import Contact
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot
from wbc.robot.formats.couplings import Loop
from wbc.robot.names import BASE
from wbc.tasks.core_task import CoreTask
from wbc.tasks.frame import TURNS
from wbc.tasks.point import AXES
from wbc.tasks.task import Task
from wbc.validate import read_only


class Mechanics(CoreTask):
    """A constraint of the robot's mechanics; controllers add them (:func:`mechanics_of`)."""

    def __init__(self, robot: Robot, name: str, rows: Sequence[str]) -> None:
        super().__init__(robot, name, rows, gain=1.0)

    @property
    def nonlinear(self) -> bool:
        """Whether its error is nonlinear in q."""
        return False


class Gear(Mechanics):
    """One joint at a polynomial of its driver's position, as the robot's file says (one row)."""

    _kind = "gear"

    def __init__(self, robot: Robot, joint: str) -> None:
        self._coupling = coupling = robot.couplings[joint]
        self._ends = [robot.joint_index(joint) - 6, robot.joint_index(coupling.driver) - 6]
        super().__init__(robot, f"gear of {joint}", ("gear",))

    @property
    def nonlinear(self) -> bool:
        """Whether its error is nonlinear in q."""
        return not self._coupling.is_linear

    def native(self) -> tuple[NativeRows, ...]:
        """Return the one row."""
        coupling, still = self._coupling, self._zeros()
        numbers = np.array((*self._ends, coupling.offset, coupling.ratio, *coupling.curved))
        return (NativeRows(Kind.GEAR, None, (0,), still, still, (numbers,)),)


class ClosedLoop(Mechanics):
    """Two frames of the robot that are one: their origins (three rows), or their axes too (six).

    The error is where the first frame is as seen from the second, see
    :func:`wbc.robot.loops.gap_of`; forces along the rows act on the first frame.
    """

    loop: Loop

    _kind = "loop"

    def __init__(self, robot: Robot, name: str) -> None:
        self.loop = loop = robot.loops[name]
        super().__init__(robot, f"loop {name}", AXES if loop.kind == "point" else AXES + TURNS)

    @property
    def nonlinear(self) -> bool:
        """True."""
        return True

    def native(self) -> tuple[NativeRows, ...]:
        """Return its rows, six or the first three."""
        index, still = tuple(range(len(self.rows))), self._zeros()
        frame, other = self.loop.frames
        return (NativeRows(Kind.LOOP, frame, index, still, still, (), other=other),)


class BoltedBase(Mechanics):
    """A fixed base that does not move, wherever it is (six rows)."""

    _kind = "bolted"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, "bolted base", AXES + TURNS)
        self._jacobian = read_only(np.eye(6, robot.nv))

    def native(self) -> tuple[NativeRows, ...]:
        """Return the six rows."""
        still = self._zeros()
        numbers = self._jacobian.ravel(), still
        return (NativeRows(Kind.LINEAR, None, tuple(range(6)), still, still, numbers),)


def mechanics_of(robot: Robot, contacts: Sequence[Task]) -> tuple[Task, ...]:
    """Return ``contacts`` behind gears, loops and, if they do not hold it, a fixed base."""
    given = [contact for contact in contacts if not isinstance(contact, Mechanics)]
    bolted = () if any(map(holds_bolted, given)) or not robot.fixed_base else (BoltedBase(robot),)
    gears = (Gear(robot, joint) for joint in robot.couplings)
    return (*bolted, *gears, *(ClosedLoop(robot, name) for name in robot.loops), *given)


def holds_bolted(contact: Task) -> bool:
    """Return whether a contact, such as that of ``support``, is the bolts of a fixed base."""
    return isinstance(contact, Contact) and contact.frame == BASE and contact.robot.fixed_base
