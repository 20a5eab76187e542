"""A walk by a schedule of commands, and by footsteps that were given."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from wbc.constraints import Contact
from wbc.controllers import Controller
from wbc.errors import InvalidInputError
from wbc.gait.command import Velocity
from wbc.gait.prescribed_steps import Landing
from wbc.gait.walker import Walker
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.tasks import Task
from wbc.validate import Array, finite_number

# A foot that landed farther from the height of its footstep is told [m].
TOLD = 0.01
# Wrenches (6,) on the soles now, by frame.
Forces = Callable[[], Mapping[str, Array]]


class TimedCommand(NamedTuple):
    """A velocity, and from when on it is wanted [s]."""

    at: float
    velocity: Velocity


class CommandedWalk:
    """Leads a simulation by a walker and a schedule; see :class:`wbc.run.supervisor.Supervisor`.

    Parameters
    ----------
    walker:
        Footsteps that it was told to follow are made from the start on.
    commands:
        In order of time; before the first the robot stands, or makes its footsteps.
    forces:
        What the soles feel; None, or nothing felt: feet land when they should.
    move_world:
        Called before each tick with the time [s], for instance to move obstacles.

    Raises
    ------
    InvalidInputError
        Commands that are not in order of time.
    """

    def __init__(
        self,
        walker: Walker,
        commands: Sequence[TimedCommand],
        forces: Forces | None = None,
        move_world: Callable[[float], None] | None = None,
    ) -> None:
        check_order(commands)
        self.walker = walker
        self.complaint: str | None = None
        self.controller: Controller = walker.controller
        self._beyond: tuple[str, ...] = ()
        self._given, self._tick = len(walker.coming), -1
        self._coming, self._forces, self._move_world = list(commands), forces, move_world
        self.standing = self._standing()

    @property
    def tasks(self) -> tuple[Task, ...]:
        """Those whose errors mean something all the time."""
        return self.walker.lasting_tasks

    @property
    def notes(self) -> Sequence[str]:
        """What legs lack, which commands were beyond them, how far feet landed from footsteps."""
        told = (*self.walker.notes, *self._beyond)
        if not self._given:
            return told
        return (*told, landings_in_words(self.walker.landings, self._given))

    def update(self, tick: int, snapshot: Snapshot) -> Controller:
        """Give the commands that are due; return the controller, its goals set.

        Where ticks were left out since the last call, the gait goes on by their time, too.
        """
        dt = self.walker.dt
        time, passed = tick * dt, max(tick - self._tick, 1)
        self._tick = tick
        self.move_to(time)
        while self._coming and time >= self._coming[0].at - 1e-9:
            command = self._coming.pop(0)
            reason = self.walker.command(*command.velocity).reason
            if reason:
                self._beyond = (*self._beyond, f"command at {command.at:g} s: {reason}")
        self.walker.dt = passed * dt
        try:
            self.walker.prepare(snapshot, (self._forces() or None) if self._forces else None)
        finally:
            self.walker.dt = dt
        if self.controller.contacts != self.standing.contacts:
            self.standing = self._standing()
        return self.controller

    def stop(self) -> None:
        """Come to rest: commands that are not given yet are forgotten."""
        self._coming.clear()
        self.walker.command(0.0)

    def move_to(self, time: float) -> None:
        """Set obstacles to where they are at ``time`` [s]."""
        if self._move_world is not None:
            self._move_world(time)

    def _standing(self) -> PhaseSupport:
        made = self.controller
        contacts = [one for one in made.contacts if isinstance(one, Contact)]
        return PhaseSupport.on("", contacts, made.constraints, made.limits, made.slacks.is_hard)


def landings_in_words(landings: Sequence[Landing], count: int) -> str:
    """Return how many of ``count`` footsteps were made, and how well."""
    made = f"footsteps: {len(landings)} of {count} made"
    if not landings:
        return made
    worst = max(range(len(landings)), key=lambda k: landings[k].distance)
    way, turn = landings[worst].distance, max(one.turn for one in landings)
    uneven = max(range(len(landings)), key=lambda k: abs(landings[k].height))
    rise = landings[uneven].height
    told = f"; footstep {uneven + 1} at {1e3 * rise:+.0f} mm from its z" if abs(rise) > TOLD else ""
    return (
        f"{made}; feet landed within {1e3 * way:.1f} mm (footstep {worst + 1}) and"
        f" {math.degrees(turn):.1f} degrees of them, as measured{told}"
    )


def check_order(commands: Sequence[TimedCommand]) -> None:
    """Refuse commands that are not in order of time.

    Raises
    ------
    InvalidInputError
        The message names both times.
    """
    last = -1.0
    for command in commands:
        at = finite_number("walking command, at", command.at, least=0.0)
        if at <= last:
            raise InvalidInputError(
                f"walking command at {at:g} s comes after the one at {last:g} s; order them by time"
            )
        last = at
