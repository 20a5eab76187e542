"""The plan of a controller: unknowns, priority levels and row names, shared by all ticks.

A :class:`LevelPlan` is made once for each set of tasks and contacts; a tick only fills in numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wbc.constraints.contact import ContactRows
from wbc.constraints.independent_rows import independent_rows
from wbc.constraints.limits import BASE_ROWS
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
