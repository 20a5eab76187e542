"""Competing tasks: at rest off their targets, where gains act as weights.

The QP weighs the rate that each task demands, gain times error: at rest the gradients
weight^2 gain J' error cancel, and a task of smaller gain loses more than its weight says.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np

from wbc.robot import Snapshot
from wbc.tasks.task import Task
from wbc.tasks.validation import residual_of
from wbc.validate import Array

MOVING_SHARE = 0.05  # of the demanded rate: a faster task is still moving to its target
RELEVANT_SHARE = 0.02  # of a level's largest weighted error: smaller errors are ignored
LEAST_GAIN_RATIO = 1.25  # between the gains of two tasks that are reported
LEAST_ERROR = 1e-6  # weighted errors below this are ignored


def competing_tasks(
    tasks: Iterable[Task], snapshot: Snapshot, velocity: Array, dt: float
) -> dict[str, float]:
    """Return the gains, by name, of the tasks of one level that compete at different gains.

    ``tasks``: about motion.
    ``velocity``: (nv,) commanded at the snapshot.
    """
    by_level = groupby(sorted(tasks, key=lambda one: one.priority), lambda one: one.priority)
    for _, level in by_level:
        off = {}
        for task in level:
            found, gain = residual_of(task, snapshot), task.law.fraction(dt)
            size = float(np.linalg.norm(task.weight * found.error))
            moves = float(np.linalg.norm(task.weight * found.rate(velocity))) * dt
            off[task] = size, gain, moves < MOVING_SHARE * gain * size
        most = max(size for size, *_ in off.values())
        off = {
            task: one
            for task, one in off.items()
            if one[0] > max(RELEVANT_SHARE * most, LEAST_ERROR)
        }
        if not all(rests for *_, rests in off.values()):
            continue
        gains = {task.name: gain for task, (_, gain, _) in off.items() if not task.law.weighs_error}
        if gains and max(gains.values()) > LEAST_GAIN_RATIO * min(gains.values()):
            return gains
    return {}
