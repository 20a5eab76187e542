"""The plan of a controller: unknowns, priority levels and row names, shared by all ticks.

A :class:`LevelPlan` is made once for each set of tasks and contacts; a tick only fills in numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from wbc.constraints.contact import Contact, ContactRows, PointContact
from wbc.constraints.independent_rows import independent_rows
from wbc.constraints.limits import BASE_ROWS
from wbc.constraints.mechanics import Mechanics
from wbc.controllers.blocks import planned_as
from wbc.controllers.slack import Slacks
from wbc.qp.problem import Labels
from wbc.robot import Robot
from wbc.tasks.task import Task
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Decision:
    """The unknowns x (n,) of a tick: the velocity v+ at its end, then what a level adds.

    The velocity level has v+ alone; a torque level has contact forces behind it. Rows may have nv
    columns or n: those on v+ are written once for both levels.
    """

    names: tuple[str, ...]  # (n,), a bound is named after its unknown
    nv: int  # how many of them are v+
    damping: Array  # (n,) weights of 1/2 x^2 in the cost; they make the optimum unique

    @classmethod
    def velocity(cls, robot: Robot, damping: Array) -> Decision:
        """Return the unknowns of the velocity level."""
        return cls(BASE_ROWS + robot.joint_names, robot.nv, damping)

    def extended(self, names: Sequence[str], damping: Array) -> Decision:
        """Return these unknowns and further ones (m,) behind them."""
        every = self.names + tuple(names)
        return Decision(every, self.nv, np.concatenate((self.damping, damping)))

    @cached_property
    def size(self) -> int:
        """How many unknowns there are, n."""
        return len(self.names)


@dataclass(frozen=True, eq=False)
class LevelPlan:
    """The levels of a controller."""

    decision: Decision
    motion: tuple[Task, ...]  # the tasks about motion
    held: ContactRows  # the contacts that are met exactly
    soft: tuple[Task, ...]  # those that may give way: costs of the first level, behind the tasks
    # Indices of each level's costs among the tasks, the soft contacts, then the tasks about
    # forces.
    levels: tuple[tuple[int, ...], ...]
    labels: tuple[Labels, ...]  # of each level's QP; those of inequality rows come with the rows
    workspace: tuple[object, ...]  # names the set of contacts: solvers keep a warm start for each

    @classmethod
    def of(
        cls,
        decision: Decision,
        tasks: Sequence[Task],
        contacts: Sequence[Task],
        slacks: Slacks,
        physics: tuple[str, ...] = (),
        forces: Sequence[Task] = (),
    ) -> LevelPlan:
        """Return the plan; ``physics`` names the equality rows that a level puts before contacts.

        ``forces`` are the tasks about forces.

        A level's QP keeps what the levels above achieve: its equality rows are the first level's,
        then the rows of the tasks above; rows without weight are empty.
        """
        hard, soft = slacks.split(contacts)
        held = independent_rows(hard)
        levels = _levels(tasks, soft, forces)
        equality = physics + held.labels
        labels = [Labels(equality, (), decision.names)]
        costs = (*tasks, *soft, *forces)
        above: tuple[int, ...] = ()
        for level in levels[:-1]:
            above += level
            achieved = tuple(
                f"{costs[k].name} {row}" for k in sorted(above) for row in costs[k].rows
            )
            labels.append(Labels(equality + achieved, (), decision.names))
        workspace = tuple(contact.name for contact in contacts), held.labels
        return cls(decision, tuple(tasks), held, soft, levels, tuple(labels), workspace)


def _levels(
    tasks: Sequence[Task], soft: Sequence[Task], forces: Sequence[Task]
) -> tuple[tuple[int, ...], ...]:
    """Return the indices of each level, the most important first.

    Soft contacts, which stand between tasks and forces, are of that.
    """
    begin, end = len(tasks), len(tasks) + len(soft)
    costs = [*enumerate(tasks), *enumerate(forces, end)]
    first, *lower = (
        tuple(k for k, task in costs if task.priority == priority)
        for priority in sorted({task.priority for _, task in costs})
    )
    return (*first, *range(begin, end)), *lower


MOST_KNOWN = 8  # sets of contacts; a walk has four, in both orders while forces ramp
Key = tuple[object, ...]


class KnownPlans:
    """What a controller planned for its last sets of contacts, as its attributes.

    Making a plan takes a millisecond, in a loop of two; coming back to it, a twentieth.

    A plan reads where its contacts are anchored in each tick, so that it serves the same objects
    elsewhere. Not so those on one link, or along a line: which rows they have depends on that.
    """

    def __init__(self) -> None:
        self._known: dict[Key, tuple[Sequence[Task], Mapping[str, Any]]] = {}

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), ()  # a copy plans anew: its contacts may be others

    def find(
        self, contacts: Sequence[Task], leaving: Mapping[str, float]
    ) -> Mapping[str, Any] | None:
        """Return the attributes for these contacts, those ``leaving`` with slack among them."""
        key = _key(contacts, leaving)
        found = self._known.pop(key, None)
        if found is None:
            return None
        self._known[key] = found  # the last to be forgotten
        return found[1]

    def keep(
        self, contacts: Sequence[Task], leaving: Mapping[str, float], planned: Mapping[str, Any]
    ) -> None:
        """Remember a plan, and forget the one that was not used for longest."""
        own = _own(contacts)
        if not all(type(one) in (Contact, PointContact) for one in own):
            return
        links = {one.robot.frame(one.frame).parentJoint for one in own}  # type: ignore[attr-defined]
        if len(links) < len(own):
            return
        key = _key(contacts, leaving)
        self._known.pop(key, None)
        while len(self._known) >= MOST_KNOWN:
            del self._known[next(iter(self._known))]
        self._known[key] = own, planned  # contacts are kept, as their ids are in the key


def _own(contacts: Sequence[Task]) -> list[Task]:
    return [one for one in contacts if not isinstance(one, Mechanics)]


def _key(contacts: Sequence[Task], leaving: Mapping[str, float]) -> Key:
    return *((id(one), planned_as(one)) for one in _own(contacts)), *leaving.items()
