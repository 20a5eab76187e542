"""Targets and weights that a user changes while the controller runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wbc.controllers import Controller
from wbc.errors import WbcError
from wbc.tasks import PoseTask, Task
from wbc.validate import Array
from wbc.view.live.messages import Release, SetTarget, TaskRequest


class TargetControls:
    """The user's targets and weights, applied before each tick over the program's.

    ``refusal``: why the last request was refused, or empty.
    """

    def __init__(self) -> None:
        self.refusal = ""
        self._targets = dict[str, tuple[Array, ...]]()
        self._factors = dict[str, float]()
        # By task what was there before, and what was put there instead.
        self._before = dict[str, tuple[tuple[Array, ...], tuple[Array, ...]]]()
        self._weights = dict[str, tuple[Array, Array]]()

    def __bool__(self) -> bool:
        """Whether any task is steered."""
        return bool(self._targets or self._factors)

    def receive(self, request: TaskRequest, controller: Controller) -> None:
        """Store a request; if the task refuses it, it is dropped and :attr:`refusal` set."""
        self.refusal = ""
        if isinstance(request, Release):
            self._release(controller)
        elif isinstance(request, SetTarget):
            self._targets[request.task] = request.target
        else:
            self._factors[request.task] = request.factor
        self.apply(controller)

    def apply(self, controller: Controller) -> None:
        """Set the user's targets and weights of the controller's tasks."""
        for name, task in self._steered(controller, self._targets):
            now = target_of(task)
            before, put = self._before.get(name, (now, ()))
            if not _same(now, put):  # the program has set it since
                before = now
            try:
                task.set_target(*self._targets[name])
            except WbcError as error:
                self.refusal = str(error)
                del self._targets[name]
                continue
            self._before[name] = before, target_of(task)
        for name, task in self._steered(controller, self._factors):
            before_weight, put_weight = self._weights.get(name, (task.weight, None))
            if task.weight is not put_weight:
                before_weight = task.weight
            task.weight = np.multiply(self._factors[name], before_weight)
            self._weights[name] = before_weight, task.weight

    def _steered(self, controller: Controller, wanted: dict[str, Any]) -> Iterator[tuple[str, Any]]:
        if wanted:
            yield from [(task.name, task) for task in controller.tasks if task.name in wanted]

    def _release(self, controller: Controller) -> None:
        """Restore the earlier target or weight, unless the program has set it since."""
        for name, task in self._steered(controller, self._before):
            before, put = self._before[name]
            if _same(target_of(task), put):
                task.set_target(*before)
        for name, task in self._steered(controller, self._weights):
            before_weight, put_weight = self._weights[name]
            if task.weight is put_weight:
                task.weight = before_weight
        for kept in (self._targets, self._factors, self._before, self._weights):
            kept.clear()


def target_of(task: Task) -> tuple[Array, ...]:
    """Return a task's target, as the objects that it holds."""
    return (task.position, task.rotation) if isinstance(task, PoseTask) else (task.target,)


def _same(a: tuple[Array, ...], b: tuple[Array, ...]) -> bool:
    return len(a) == len(b) and all(x is y for x, y in zip(a, b, strict=True))
