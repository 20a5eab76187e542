"""Tasks that keep each other from their targets at rest, where their gains act as weights.

The QP of a tick weighs what each task asks for, gain times error: at rest the gradients
weight^2 gain J' error cancel each other, and a task of a smaller gain gives way more than its
weight says.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import numpy as np

from wbc.robot import Snapshot
from wbc.tasks.task import Task
from wbc.tasks.validation import residual_of
from wbc.validate import Array

MOVES = 0.05  # part of what a task asks for, from which on it is still on its way
SHARES = 0.02  # part of the largest weighted error of a level, below which an error is none
UNLIKE = 1.25  # times another's gain
LEAST = 1e-6  # weighted errors that no task is off by


def competing(
    tasks: Iterable[Task], snapshot: Snapshot, velocity: Array, dt: float
) -> dict[str, float]:
    """Return the gains, by task, of those of one level that compete at rest at different gains.

    Parameters
    ----------
    tasks:
        About motion.
    velocity:
        (nv,) commanded at the snapshot.
    """
    by_level = groupby(sorted(tasks, key=lambda one: one.priority), lambda one: one.priority)
    for _, level in by_level:
        off = {}
        for task in level:
            found, gain = residual_of(task, snapshot), task.law.fraction(dt)
            size = float(np.linalg.norm(task.weight * found.error))
            moves = float(np.linalg.norm(task.weight * found.rate(velocity))) * dt
            off[task] = size, gain, moves < MOVES * gain * size
        most = max(size for size, *_ in off.values())
        off = {task: one for task, one in off.items() if one[0] > max(SHARES * most, LEAST)}
        if not all(rests for *_, rests in off.values()):
            continue
        gains = {task.name: gain for task, (_, gain, _) in off.items() if not task.law.weighs_error}
        if gains and max(gains.values()) > UNLIKE * min(gains.values()):
            return gains
    return {}
