"""Ramps of contact forces: the bound on a normal force grows from zero, or shrinks to it.

Otherwise a new contact may take the whole load in one tick, and a dropped one loses it at once:
torques jump. So for a while the normal force is bounded, from 0 up to the robot's weight or from
its present value down to 0, linearly in time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from wbc.constraints.contact import Contact
from wbc.tasks.task import Task

NEGLIGIBLE = 1e-6  # of a full load: less is a solver's residue


class Ramp(NamedTuple):
    """The bound on one contact's normal force, over ``ticks`` from ``start`` to ``end`` [N]."""

    start: float
    end: float
    ticks: int
    done: int = 0

    @property
    def most(self) -> float:
        """The bound now [N]."""
        return self.start + (self.end - self.start) * self.done / self.ticks

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.done >= self.ticks


class ForceRamps:
    """The ramps that run in a controller.

    ``full``: where a new contact's bound ends, before there is none [N].
    """

    def __init__(self, full: float) -> None:
        self._full = full
        self._coming: dict[str, Ramp] = {}
        self._going: dict[str, Ramp] = {}

    @property
    def running(self) -> tuple[Mapping[str, Ramp], Mapping[str, Ramp]]:
        """The ramps of new contacts, and of those being released; may be assigned."""
        return self._coming, self._going

    @running.setter
    def running(self, ramps: tuple[Mapping[str, Ramp], Mapping[str, Ramp]]) -> None:
        self._coming, self._going = dict(ramps[0]), dict(ramps[1])

    @property
    def most(self) -> Mapping[str, float]:
        """The bound of each ramping contact [N]."""
        if not self._coming and not self._going:
            return {}
        return {name: ramp.most for name, ramp in (self._coming | self._going).items()}

    def change(
        self,
        held: Sequence[Task],
        wanted: Sequence[Task],
        normal_forces: Mapping[str, float],
        ticks: int,
    ) -> tuple[Task, ...]:
        """Start the ramps of a change of contacts; return the contacts of the next tick.

        ``held``, ``wanted``: contacts until now and from now on; one of the same name stays,
        wherever its anchor is.
        ``normal_forces``: of the last tick [N], by contact; those that have none are taken and
        dropped at once.
        """
        if ticks < 1:
            self._coming, self._going = {}, {}
            return tuple(wanted)
        after = {task.name for task in wanted}
        loads = {task.name: normal_forces.get(task.name, 0.0) for task in held}
        going = {
            name: Ramp(load, 0.0, ticks)
            for name, load in loads.items()
            if name not in after and load > NEGLIGIBLE * self._full
        }
        bearing = [
            task.name for task in wanted if isinstance(task, Contact) and task.friction is not None
        ]
        coming = dict(self._coming)
        for name in bearing:
            if name in self._going:  # it is set again while being released
                coming[name] = Ramp(self._going[name].most, self._full, ticks)
            elif name not in loads:
                coming[name] = Ramp(0.0, self._full, ticks)
        self._coming = {name: ramp for name, ramp in coming.items() if name in bearing}
        self._going = {name: self._going.get(name, ramp) for name, ramp in going.items()}
        return (*wanted, *(task for task in held if task.name in going))

    def advance(self) -> frozenset[str]:
        """Advance all ramps by a tick; return the contacts that are unloaded now."""
        if not self._coming and not self._going:
            return frozenset()
        coming = {name: ramp._replace(done=ramp.done + 1) for name, ramp in self._coming.items()}
        going = {name: ramp._replace(done=ramp.done + 1) for name, ramp in self._going.items()}
        self._coming = {name: ramp for name, ramp in coming.items() if not ramp.over}
        self._going = {name: ramp for name, ramp in going.items() if not ramp.over}
        return frozenset(going.keys() - self._going.keys())
