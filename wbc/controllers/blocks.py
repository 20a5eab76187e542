"""Tasks and contacts as the core reads them: blocks of rows, and the numbers of each.

The structure of a task's rows is planned once; its numbers (targets, weights, gains) are written
again when an attribute of the task was set, and only the target's if nothing else was. Tasks that
do not describe their rows (a user's own, inertia in a frame's axes) are evaluated in Python in each
tick, and the core treats their residuals like its own (:class:`PythonPart`); those about forces
give rows on the unknowns (:class:`ForcePart`).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from wbc.constraints.contact import Contact
from wbc.laws import AccelerationLaw, Residual, Rows, VelocityLaw
from wbc.native import lib
from wbc.native.rows import Kind, NativeRows, frames_of
from wbc.robot.names import BASE
from wbc.tasks.force_task import ForceTask
from wbc.tasks.inertia import InertiaTask
from wbc.tasks.task import Task
from wbc.validate import Array

_HEADER = lib.WEIGHTS  # numbers of a law


class _BlockViews(NamedTuple):
    """Views on the numbers of a block in the core's memory."""

    header: Array  # of the law
    weight: Array
    rest: list[Array]  # bias, drift, and the numbers of the kind

    def write(self, now: NativeRows, selected: list[int] | None) -> bool:
        """Write bias, drift and the numbers of the kind; False if they have another size."""
        if len(now.numbers) + 2 != len(self.rest):
            return False
        for k, values in enumerate((now.bias, now.drift, *now.numbers)):
            own = values if selected is None or k > 1 else values[selected]
            if own.size != self.rest[k].size:
                return False
            self.rest[k][:] = own
        return True


class Part:
    """One task or contact, and views on its numbers in the core.

    ``selected``: indices of the rows of a contact that are in the QP; None for all.
    ``held``: whether its rows are met exactly.
    ``torque``: whether the task follows its second-order law.
    ``level``: of the costs, the most important is 0.
    ``scale``: factor on the weights: of a contact that may give way.
    """

    def __init__(
        self,
        task: Task,
        selected: Sequence[int] | None,
        held: bool,
        torque: bool,
        level: int = 0,
        scale: float = 1.0,
    ) -> None:
        self.task, self.own = task, task.__dict__  # quicker to read than attributes
        self.held, self.level, self._scale = held, level, scale
        self.selected = None if selected is None else list(selected)
        self.torque = torque
        self.rows = native_rows_of(task, torque)
        self.changes: object = None  # of the task, when its numbers were written
        self._remakes: object = None
        self.planned_as = planned_as(task)
        self._views: list[_BlockViews] = []
        self._only_target_moves = selected is None and all(rows.moving for rows in self.rows or ())
        # Attributes of the task that hold its target: name, view, and the array last written.
        self._moving: list[list[Any]] = []
        self._law: VelocityLaw | AccelerationLaw | None = None
        self._factor = scale  # on the weights, with the law's own
        self._second_order, self._singular = self.second_order, self.singular

    @property
    def singular(self) -> bool:
        """Whether its rows are filtered near singularities: :mod:`wbc.controllers.singular`."""
        return not self.torque and bool(self.task.singular_threshold)

    @property
    def second_order(self) -> bool:
        """Whether the cost includes the residual's curvature."""
        return not self.torque and isinstance(self.task, InertiaTask) and self.task.second_order

    def selected_rows(self, rows: NativeRows) -> list[int]:
        """Return the indices of a block's rows that are in the QP."""
        return list(range(len(rows.entries))) if self.selected is None else self.selected

    def size(self, rows: NativeRows) -> int:
        """Return how many numbers a block has."""
        return _HEADER + 3 * len(self.selected_rows(rows)) + sum(map(np.size, rows.numbers))

    def bind(self, memory: Array) -> None:
        """Make the views on the numbers of the next block, which begin ``memory``."""
        rows = (self.rows or ())[len(self._views)]
        k = len(self.selected_rows(rows))
        sizes = (_HEADER, k, k, k, *map(np.size, rows.numbers))
        ends = (0, *accumulate(sizes))
        header, weight, *rest = (memory[begin:end] for begin, end in pairwise(ends))
        self._views.append(_BlockViews(header, weight, rest))
        for name, where in zip(rows.moving, rest, strict=False):
            if name and self._only_target_moves:
                self._moving.append([name, where.reshape(self.own[name].shape), None])

    def write(self, dt: float) -> bool:
        """Write the numbers of a changed task; False if its structure differs from the plan's."""
        own = self.own
        remakes, changes = own["_remakes"], own["_changes"]
        if remakes is self._remakes and self._only_target_moves:  # only the target was set
            for moving in self._moving:
                name, where, written = moving
                now = own[name]
                if now is not written:  # arrays are replaced, never changed
                    where[...] = moving[2] = now
            self.changes = changes
            return True
        task, planned = self.task, self.rows
        if planned_as(task) != self.planned_as:
            return False
        for moving in self._moving:
            moving[2] = own[moving[0]]
        found = native_rows_of(task, self.torque)
        if found is None or planned is None or len(found) != len(planned):
            return False
        if self.second_order != self._second_order or self.singular != self._singular:
            return False
        for k, now in enumerate(found):
            about = planned[k][:3], planned[k].other
            if (now[:3], now.other) != about or not self._views[k].write(now, self.selected):
                return False
        self._write_law(found, dt)
        self._remakes, self.changes = remakes, changes
        return True

    def _write_law(self, found: Sequence[NativeRows], dt: float) -> None:
        """Write the numbers of the law, and weights."""
        task, offset = self.task, 0
        law = task.acceleration_law if self.torque else task.law
        if isinstance(law, VelocityLaw) and not self.held:
            self._factor = self._scale * law.factor(dt)
        for now, views in zip(found, self._views, strict=True):
            if law is not self._law:
                views.header[:] = _header(law, now, dt)
            own = task.weight[offset : offset + len(now.entries)]
            views.weight[:] = self._factor * (own if self.selected is None else own[self.selected])
            offset += len(now.entries)
        self._law = law


def planned_as(task: Task) -> tuple[str, int, bool]:
    """Return what a plan is made for: name, level, and whether forces have a friction cone."""
    return task.name, task.priority, getattr(task, "friction", None) is not None


class TaskEvaluation(NamedTuple):
    """A task evaluated in Python at one snapshot."""

    task: Task
    residual: Residual | None = None  # of a motion task
    # (k,) its second derivative at zero acceleration of v; None at the velocity level.
    drift: Array | None = None
    rows: Rows | None = None  # of a force task, in views of both: rows on the unknowns


class PythonPart(Part):
    """One task or contact that Python evaluates, and views on its numbers in the core.

    ``nv``: number of velocities.
    ``curved``: whether its residual has a curvature, which goes into the cost.
    """

    def __init__(self, part: Part, nv: int, curved: bool) -> None:
        task = part.task
        self._has_curvature = curved and not (part.held or part.torque)
        super().__init__(task, part.selected, part.held, part.torque, part.level, part._scale)
        k = len(task.rows if self.selected is None else self.selected)
        none = np.zeros(len(task.rows))
        self._index, self._shape = slice(None) if self.selected is None else self.selected, (k, nv)
        sizes = (k * nv, k, nv, *([nv * nv] if self._has_curvature else []))
        numbers = [np.zeros(size) for size in sizes]
        entries = tuple(range(len(task.rows)))
        self.rows = (NativeRows(Kind.ASKED, self._frame, entries, none, none, tuple(numbers)),)

    @property
    def second_order(self) -> bool:
        """Whether the cost includes the residual's curvature."""
        return self._has_curvature

    @property
    def _frame(self) -> str | None:
        """Frame at which a contact's forces act."""
        return self.task.frame if isinstance(self.task, Contact) else None

    def write(self, dt: float) -> bool:
        """Write law and weights of a changed task; :meth:`fill` writes the rest in each tick."""
        (rows,) = self.rows or ()
        planned = self._singular, rows.frame, self.planned_as
        if (self.singular, self._frame, planned_as(self.task)) != planned:
            return False
        self.changes = self.task._changes
        self._write_law((rows,), dt)
        return True

    def fill(self, evaluation: TaskEvaluation) -> bool:
        """Write a tick's residual; False: its curvature was not planned, or it has none."""
        residual, (views,), index = evaluation.residual, self._views, self._index
        if residual is None:
            return False
        if residual.curvature is not None and not (self._has_curvature or self.held or self.torque):
            return False
        bias, drift, matrix, error, bound, *curvature = views.rest
        matrix.reshape(self._shape)[:] = residual.jacobian[index]
        error[:], bias[:] = residual.error[index], residual.bias[index]
        if evaluation.drift is not None:
            drift[:] = evaluation.drift[index]
        elif views.header[lib.HALF_GAIN] and not self.held:
            curvature_bound = residual.curvature_bound
            bound[:] = curvature_bound() if callable(curvature_bound) else curvature_bound
            bound *= self._factor**2
        if curvature:
            curvature[0][:] = 0.0 if residual.curvature is None else residual.curvature.ravel()
            curvature[0][:] *= self._factor**2
        return True


class ForcePart(Part):
    """One force task, and views on its rows in the core: matrix and target, by n unknowns."""

    def __init__(self, part: Part, n: int) -> None:
        super().__init__(part.task, None, False, part.torque, part.level, part._scale)
        k = len(part.task.rows)
        none, numbers = np.zeros(k), (np.zeros(k * n), np.zeros(k))
        self.rows = (NativeRows(Kind.GIVEN, None, tuple(range(k)), none, none, numbers),)

    def write(self, dt: float) -> bool:
        """Note the change: :meth:`fill` writes everything in each tick."""
        self.changes = self.task._changes
        return True

    def fill(self, evaluation: TaskEvaluation) -> bool:
        """Write a tick's rows; False: it has none."""
        rows, (views,) = evaluation.rows, self._views
        if rows is None:
            return False
        views.weight[:] = self._scale * rows.weight
        views.rest[2][:], views.rest[3][:] = rows.matrix.ravel(), rows.target
        return True


class CoreBlocks(NamedTuple):
    """The parts as the core's blocks of rows."""

    frames: list[str]  # used by the rows; the first is the base
    moving: int  # the first so many of them need Jacobians
    entries: list[int]  # selected entries of each block's kind, block by block
    blocks: list[dict[str, int]]  # fields of each ``wbc_block`` of source/core.h
    number: Array  # numbers of all blocks, which parts write
    moments: int  # number of rows that are moments about a centre of pressure

    @classmethod
    def of(cls, parts: Sequence[Part]) -> CoreBlocks:
        """Return the blocks of all parts, and bind the parts to their numbers."""
        frames, moving = frames_of(BASE, (rows for part in parts for rows in part.rows or ()))
        entries, blocks = list[int](), list[dict[str, int]]()
        begins: list[tuple[Part, int]] = []
        size, moments, counts = 0, 0, [0, 0]  # the last: rows of costs, of contacts
        for part in parts:
            for rows in part.rows or ():
                selected = part.selected_rows(rows)
                places = {"rows": len(selected), "first": counts[part.held], "index": len(entries)}
                levels = {"held": part.held, "level": part.level, "second": part.second_order}
                if rows.kind == Kind.COP:
                    levels["other"] = moments
                    moments += len(selected)
                blocks.append(rows.block(frames, number=size, **places, **levels))
                entries += [rows.entries[i] for i in selected]
                begins.append((part, size))
                size += part.size(rows)
                counts[part.held] += len(selected)
        number = np.zeros(size)
        for part, begin in begins:
            part.bind(number[begin:])
        return cls(frames, moving, entries, blocks, number, moments)

    @property
    def held(self) -> int:
        """Number of rows that are met exactly."""
        return sum(block["rows"] for block in self.blocks if block["held"])

    @property
    def costs(self) -> int:
        """Number of rows of costs."""
        return sum(block["rows"] for block in self.blocks if not block["held"])

    @property
    def of_forces(self) -> bool:
        """Whether some costs are on forces."""
        return any(block["kind"] in (Kind.GIVEN, Kind.COP) for block in self.blocks)

    @property
    def largest(self) -> int:
        """Number of rows of the largest block."""
        return max((block["rows"] for block in self.blocks), default=0)

    @property
    def counts(self) -> dict[str, int]:
        """Fields of ``wbc_plan``."""
        sizes = {"blocks": len(self.blocks), "frames": self.moving}
        return {**sizes, "costs": self.costs, "held": self.held}


def native_rows_of(task: Task, torque: bool) -> Sequence[NativeRows] | None:
    """Return a task's description of its rows; None: Python evaluates it."""
    own, kind = task.__dict__, type(task)
    known = "native" in vars(kind)
    if isinstance(task, ForceTask):  # subclasses too, unless they override expression()
        known |= type(task).expression is ForceTask.expression
    if not known or "residual" in own or "drift" in own:
        return None
    rows = task.native()
    if rows is not None and len(rows) > 1 and task.lm_damping and not torque:
        return None  # lm_damping needs the error of the whole task, not of each block
    return rows


def _header(
    law: VelocityLaw | AccelerationLaw, rows: NativeRows, dt: float
) -> tuple[float, float, float]:
    """Return the numbers of a law; see source/core.h."""
    if isinstance(law, AccelerationLaw):
        return law.kp, law.velocity_gain, 0.0
    gain = law.fraction(dt)
    half = 0.5 * gain if law.curvature_damping and rows.curved else 0.0
    return gain / dt, half, law.lm_damping
