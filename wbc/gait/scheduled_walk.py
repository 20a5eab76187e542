"""A supervisor that walks by a schedule of commands, or on prescribed footsteps."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from wbc.constraints import Contact
from wbc.controllers import Controller
from wbc.errors import InvalidInputError
from wbc.gait.command import Velocity
from wbc.gait.dcm import in_plane
from wbc.gait.prescribed_steps import Landing
from wbc.gait.walker import Walker
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.run.supervisor import BEFORE_START
from wbc.tasks import Task
from wbc.validate import Array, finite_number

# Smallest height error of a landing that the notes report [m].
MAX_HEIGHT_ERROR = 0.01
# Returns the measured wrenches (6,) on the soles, by frame.
Forces = Callable[[], Mapping[str, Array]]


class TimedCommand(NamedTuple):
    """A velocity, and its time [s]."""

    at: float
    velocity: Velocity


class ScheduledWalk:
    """Supervises a run by a walker and a schedule; see :class:`wbc.run.supervisor.Supervisor`.

    ``walker``: prescribed footsteps that it has begin with the first tick.
    ``commands``: in order of time; before the first the robot stands, or makes its footsteps.
    ``forces``: on the soles; None, or an empty result: feet land at the planned time.
    ``move_world``: called before each tick with the time [s], to move obstacles and targets.

    Raises InvalidInputError: commands that are not in order of time.
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
        self._clipped: tuple[str, ...] = ()
        self._steps, walker.coming = walker.coming, ()
        self._step_count, self._tick = len(self._steps), BEFORE_START
        self._pending, self._forces, self._move_world = list(commands), forces, move_world
        # Where the CoM and the commanded velocities are, from the first command on [m].
        self._com, self._commanded, self._moves = 0j, 0j, False
        self.standing = self._support()

    @property
    def tasks(self) -> tuple[Task, ...]:
        """Those whose errors are meaningful in all phases."""
        return self.walker.lasting_tasks

    @property
    def notes(self) -> Sequence[str]:
        """What limits the legs, what was clipped, how near commands and footsteps were met."""
        notes = (*self.walker.notes, *self._clipped)
        if self._moves:
            notes = (*notes, describe_way(self._com - self._commanded, self.walker))
        if not self._step_count:
            return notes
        return (*notes, describe_landings(self.walker.landings, self._step_count))

    def update(self, tick: int, snapshot: Snapshot) -> Controller:
        """Give the commands that are due; return the controller with its targets set.

        Ticks that were skipped since the last call advance the gait, too.
        """
        dt = self.walker.dt
        time, ticks = tick * dt, max(tick - self._tick, 1)
        self._tick = tick
        self.move_to(max(time, 0.0))
        if self._steps and tick >= 0:
            self.walker.coming, self._steps = self.walker.coming or self._steps, ()
        while self._pending and time >= self._pending[0].at - 1e-9:
            command = self._pending.pop(0)
            reason = self.walker.command(*command.velocity).reason
            if reason:
                self._clipped = (*self._clipped, f"command at {command.at:g} s: {reason}")
        if not self._moves:
            self._commanded = in_plane(snapshot.com)
            self._moves = not self.walker.wanted.at_rest
        self.walker.__dict__["dt"] = ticks * dt  # fixed but for ticks that were missed
        try:
            self.walker.prepare(snapshot, (self._forces() or None) if self._forces else None)
        finally:
            self.walker.__dict__["dt"] = dt
        vx, vy, _ = self.walker.velocity
        self._commanded += complex(vx, vy) * cmath.rect(ticks * dt, self.walker.heading)
        self._com = in_plane(snapshot.com)
        if self.controller.contacts != self.standing.contacts:
            self.standing = self._support()
        return self.controller

    def stop(self) -> None:
        """Stop walking, and drop the pending commands."""
        self._pending.clear()
        self._steps = ()
        self.walker.command(0.0)

    def move_to(self, time: float) -> None:
        """Set obstacles and moving targets to where they are at ``time`` [s]."""
        if self._move_world is not None:
            self._move_world(time)

    def _support(self) -> PhaseSupport:
        controller = self.controller
        contacts = [one for one in controller.contacts if isinstance(one, Contact)]
        return PhaseSupport.on(
            "", contacts, controller.constraints, controller.limits, controller.slacks.is_hard
        )


def describe_way(ahead: complex, walker: Walker) -> str:
    """Return a note on how far the CoM is from where the commanded velocities lead [m]."""
    off = ahead * cmath.rect(1.0, -walker.heading)
    along = f"{abs(off.real):.2f} m {'ahead of' if off.real > 0.0 else 'behind'}"
    side = f"{abs(off.imag):.2f} m to the {'left' if off.imag > 0.0 else 'right'}"
    return f"commands: after {walker.steps} steps {along} and {side} of where their speeds lead"


def describe_landings(landings: Sequence[Landing], count: int) -> str:
    """Return a note on how many of ``count`` footsteps were made, and on their errors."""
    count_text = f"footsteps: {len(landings)} of {count} made"
    if not landings:
        return count_text
    worst = max(range(len(landings)), key=lambda k: landings[k].distance)
    distance, turn = landings[worst].distance, max(one.turn for one in landings)
    highest = max(range(len(landings)), key=lambda k: abs(landings[k].height))
    rise = landings[highest].height
    height_note = (
        f"; footstep {highest + 1} at {1e3 * rise:+.0f} mm from its z"
        if abs(rise) > MAX_HEIGHT_ERROR
        else ""
    )
    return (
        f"{count_text}; feet landed within {1e3 * distance:.1f} mm (footstep {worst + 1}) and"
        f" {math.degrees(turn):.1f} degrees of them, as measured{height_note}"
    )


def check_order(commands: Sequence[TimedCommand]) -> None:
    """Refuse commands that are not in order of time.

    Raises InvalidInputError: the message names both times.
    """
    last = -1.0
    for command in commands:
        at = finite_number("walking command, at", command.at, least=0.0)
        if at <= last:
            raise InvalidInputError(
                f"walking command at {at:g} s comes after the one at {last:g} s; order them by time"
            )
        last = at
