"""Tasks whose formulas are in the core, used in ticks and by :meth:`Task.residual`.

Such a task describes its rows (:meth:`CoreTask.native`); ``native/source/rows.c`` computes errors,
Jacobians and drifts.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.laws import Residual
from wbc.native import doubles, ffi, lib, pointer
from wbc.native.rows import NativeRows, frames_of
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import frame_places, joint_starts
from wbc.robot.model import check_sizes
from wbc.robot.names import BASE
from wbc.tasks.task import Task
from wbc.validate import Array

_LAW = np.zeros(lib.WEIGHTS)  # the numbers of a law, which rows do not depend on


def check_frame(
    task: Task, name: str, value: object, *, other: str | None = None, same: str = ""
) -> None:
    """Refuse a frame that is none of the robot's, or that is the attribute ``other`` as well.

    ``same``: what is wrong then.
    """
    if not isinstance(value, str):  # None would be rows of no frame
        raise InvalidInputError(f"{task}, {name}: expected its name, got {shown(value)}")
    own = task.__dict__
    if "robot" not in own:  # one's own kinds may set it before that
        return
    index = task.robot.frame_id(value)
    if other in own and task.robot.frame_id(own[other]) == index:
        raise InvalidInputError(f"{task}: {value!r} {same}")


class CoreTask(Task):
    """A task of a kind that the core knows, see :class:`wbc.native.rows.Kind`.

    A subclass may override :meth:`residual` and :meth:`drift`; Python then evaluates it in each
    tick.
    """

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "frame" and name in self._declared:
            check_frame(self, name, value)
        super()._set_attribute(name, value)

    @abstractmethod
    def native(self) -> tuple[NativeRows, ...]:
        """Return a description of its rows, and their numbers."""

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the error and its first derivative, as in a tick."""
        found = self._evaluate(snapshot)
        return Residual(found.error, found.jacobian, found.bias, curvature_bound=found.bound)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the error's second derivative at v' = 0, the target's motion in it."""
        return self._evaluate(snapshot, drifts=True).drift

    def _evaluate(self, snapshot: Snapshot, drifts: bool = False) -> _Evaluation:
        check_sizes(self, self.robot, snapshot)
        robot, described = snapshot.robot, self.native()
        plans = robot.native.plans
        about = tuple((rows.kind, rows.frame, rows.other, rows.entries) for rows in described)
        plan = plans.get(about)
        if plan is None:
            plan = plans[about] = _Plan(robot, described)
        return plan.evaluate(snapshot, described, self.weight, drifts)


class _Evaluation(NamedTuple):
    """The rows of a task, evaluated by the core."""

    jacobian: Array  # (k, nv)
    error: Array  # (k,)
    bias: Array  # (k,)
    drift: Array  # (k,)
    bound: float  # on the curvature that the cost's Hessian leaves out


class _Plan:
    """One thread's memory for evaluating tasks of one structure."""

    def __init__(self, robot: Robot, described: Sequence[NativeRows]) -> None:
        frames, moving = frames_of(BASE, described)
        blocks, size, first = list[dict[str, int]](), 0, 0
        for rows in described:
            k = len(rows.entries)
            places = {"held": 1, "rows": k, "first": first, "index": first, "number": size}
            blocks.append(rows.block(frames, **places))
            size, first = size + lib.WEIGHTS + 3 * k + sum(map(np.size, rows.numbers)), first + k
        tree = robot.native.tree
        joint, placement = frame_places(robot.model, [robot.frame_id(name) for name in frames])
        entries = [entry for rows in described for entry in rows.entries]
        self._numbers, self._shape = np.empty(size), (first, tree.nv)
        arrays = {
            "number": self._numbers,
            "index": np.array(entries, dtype=np.int64),
            "frame_joint": joint,
            "frame_placement": placement,
            "start": joint_starts(robot.limits),
            "scratch": np.empty(moving * (tree.frame_size + 6)),
        }
        block, counts = ffi.new("wbc_block[]", blocks), {"blocks": len(blocks), "held": first}
        fields = {name: pointer(array) for name, array in arrays.items()}
        at = {"tree": tree.struct, "block": block, "frames": moving}
        self._struct = ffi.new("wbc_plan *", {**at, **counts, **fields})
        self._alive = tree, block, arrays  # which the struct points at

    def evaluate(
        self, snapshot: Snapshot, described: Sequence[NativeRows], weight: Array, drifts: bool
    ) -> _Evaluation:
        """Return all that rows of these numbers are at a snapshot; drifts if they are asked for."""
        numbers, first = list[Array](), 0
        for rows in described:
            end = first + len(rows.entries)
            numbers += (_LAW, weight[first:end], rows.bias, rows.drift, *rows.numbers)
            first = end
        np.concatenate(numbers, axis=None, out=self._numbers)
        (k, nv), state = self._shape, snapshot.native_state.array
        motion = doubles(snapshot.native_motion.array) if drifts else ffi.NULL
        out = np.empty(k * (nv + 3) + 1)
        there = map(doubles, (snapshot.q, snapshot.v, out))
        lib.wbc_rows(self._struct, doubles(state), motion, *there)
        error, bias, drift = out[k * nv : -1].reshape(3, k)
        bound = out.item(-1) if all(rows.curved for rows in described) else 0.0
        return _Evaluation(out[: k * nv].reshape(k, nv), error, bias, drift, bound)
