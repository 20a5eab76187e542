"""What "best" means: the cost that the controller's rows descend, at a posture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wbc.robot import Snapshot
from wbc.tasks import Task
from wbc.validate import Array


def posture_cost(tasks: Sequence[Task], snapshot: Snapshot) -> float:
    """Return the sum over tasks of gain * 1/2 |weight * error|^2.

    A tick asks for 1/2 |weight * (J v + gain/dt * error)|^2, whose gradient at v = 0 is 1/dt times
    that of this sum: the controller rests exactly where this cost cannot be lowered by a small
    motion. With one task the gain is a common factor and says nothing.
    """
    total = 0.0
    for task in tasks:
        weighted = task.weight * task.residual(snapshot).error
        total += 0.5 * task.gain * float(weighted @ weighted)
    return total


def posture_errors(tasks: Sequence[Task], snapshot: Snapshot) -> Mapping[str, Array]:
    """Return what each task reports as its error, by name."""
    return {task.name: task.deviation(snapshot, task.residual(snapshot)) for task in tasks}
