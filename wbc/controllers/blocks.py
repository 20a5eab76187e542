"""Tasks and contacts as the core reads them: blocks of rows, and the numbers of each.

What a task is about is planned once; its numbers (targets, weights, gains) are written again when
an attribute of the task was set, and where only its target was, those that move with it. Tasks that
do not describe their rows (one's own, those about forces, inertia in a frame's axes) work them out
in Python in each tick, and the core takes them as they are: see :class:`PythonPart`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import is_, itemgetter
from typing import Any, NamedTuple

import numpy as np

from wbc.laws import AccelerationLaw, Residual, Rows, VelocityLaw
from wbc.native import lib
from wbc.native.rows import Kind, NativeRows
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task
from wbc.validate import Array

_HEADER = lib.WEIGHTS  # numbers of a law
# Attributes by which a target moves, which most targets of every tick leave at rest.
_OF_MOTION = frozenset(("_bias", "_drift", "target_rate", "target_acceleration"))


class _Place(NamedTuple):
    """Where the numbers of a block go."""

    header: Array
    weight: Array
    rest: list[Array]

    def write(self, now: NativeRows, kept: list[int] | None) -> bool:
        """Write bias, drift and the numbers of the kind; False if they have another size."""
        if len(now.numbers) + 2 != len(self.rest):
            return False
        for k, values in enumerate((now.bias, now.drift, *now.numbers)):
            own = values if kept is None or k > 1 else values[kept]
            if own.size != self.rest[k].size:
                return False
            self.rest[k][:] = own
        return True


class Part:
    """One task or contact, and where its numbers go.

    Parameters
    ----------
    kept:
        The rows of a contact that the QP gets; None for all.
    held:
        Whether its rows are met exactly.
    torque:
        Whether the task follows its second-order law.
    level:
        Of the costs, the most important is 0.
    scale:
        Factor on the weights: of a contact that may give way.
    """

    def __init__(
        self,
        task: Task,
        kept: Sequence[int] | None,
        held: bool,
        torque: bool,
        level: int = 0,
        scale: float = 1.0,
    ) -> None:
        self.task = task
        self.held, self.level, self._scale = held, level, scale
        self.kept = None if kept is None else list(kept)
        self.torque = torque
        self.rows = described(task, torque)
        self.changes = self.assigned = -1  # of the task, when its numbers were written
        self._places: list[_Place] = []
        self._rereads = kept is None and all(rows.moving for rows in self.rows or ())
        # Attributes of the task, and where they go: what it aims at; how that moves.
        self._goals: list[tuple[str, Array]] = []
        self._motions: list[tuple[str, Array]] = []
        self._motion_of = _reader(())  # what reads the latter
        self._motion: tuple[object, ...] = ()  # what they were when they were written
        self._law: VelocityLaw | AccelerationLaw | None = None
        self._second, self._singular = self.second, self.singular

    @property
    def singular(self) -> bool:
        """Whether others look into its rows: see :mod:`wbc.controllers.singular`."""
        return not self.torque and self.task.singular_threshold > 0.0

    @property
    def second(self) -> bool:
        """Whether the curvature that its rows leave out is in the cost."""
        return not self.torque and bool(getattr(self.task, "second_order", False))

    def chosen(self, rows: NativeRows) -> list[int]:
        """Return the rows of a block that are kept."""
        return list(range(len(rows.entries))) if self.kept is None else self.kept

    def size(self, rows: NativeRows) -> int:
        """Return how many numbers a block has."""
        return _HEADER + 3 * len(self.chosen(rows)) + sum(map(np.size, rows.numbers))

    def place(self, memory: Array) -> None:
        """Remember where the numbers of the next block go."""
        rows = (self.rows or ())[len(self._places)]
        k = len(self.chosen(rows))
        sizes = (_HEADER, k, k, k, *map(np.size, rows.numbers))
        ends = np.cumsum(sizes).tolist()
        header, weight, *rest = (
            memory[end - size : end] for end, size in zip(ends, sizes, strict=True)
        )
        self._places.append(_Place(header, weight, rest))
        for name, where in zip(rows.moving, rest, strict=False):
            if name and self._rereads:
                kind = self._motions if name in _OF_MOTION else self._goals
                kind.append((name, where.reshape(getattr(self.task, name).shape)))
        self._motion_of = _reader([name for name, _ in self._motions])

    def write(self, dt: float) -> bool:
        """Write the numbers of a task that was changed; False if it is another one now."""
        task, planned, own = self.task, self.rows, self.task.__dict__
        changes, self.assigned = task._changes, task._assigned
        motion = self._motion_of(own)
        if changes == self.changes and self._rereads:  # only the target was set
            for name, where in self._goals:
                where[...] = own[name]
            if not all(map(is_, motion, self._motion)):  # arrays are replaced, never changed
                self._motion = motion
                for name, where in self._motions:
                    where[...] = own[name]
            return True
        self._motion = motion
        found = described(task, self.torque)
        if found is None or planned is None or len(found) != len(planned):
            return False
        if self.second != self._second or self.singular != self._singular:
            return False
        for k, now in enumerate(found):
            if now[:3] != planned[k][:3] or not self._places[k].write(now, self.kept):
                return False
        self._write_law(found, dt)
        self.changes = changes
        return True

    def _write_law(self, found: Sequence[NativeRows], dt: float) -> None:
        """Write the numbers of the law, and weights."""
        task, offset = self.task, 0
        law = task.acceleration_law if self.torque else task.law
        for now, place in zip(found, self._places, strict=True):
            if law is not self._law:
                place.header[:] = _header(law, now, dt)
            own = task.weight[offset : offset + len(now.entries)]
            place.weight[:] = self._scale * (own if self.kept is None else own[self.kept])
            offset += len(now.entries)
        self._law = law


class PythonRows(NamedTuple):
    """The rows of a task at one snapshot, worked out in Python.

    Attributes
    ----------
    residual:
        Of a task about motion; None: of one about forces, whose error the tick decides.
    """

    task: Task
    rows: Rows
    residual: Residual | None


class PythonPart(Part):
    """One task or contact whose rows are worked out in Python, and where they go.

    Parameters
    ----------
    n, nv:
        How many unknowns there are, and how many of them are the velocity's.
    unit:
        Newtons per unit of a force unknown.
    curved:
        Whether its residual has a curvature, which goes into the cost.
    """

    def __init__(
        self,
        part: Part,
        n: int,
        nv: int,
        unit: float,
        curved: bool,
    ) -> None:
        task = part.task
        self._curved = curved and not part.held
        super().__init__(task, part.kept, part.held, part.torque, part.level, part._scale)
        chosen = list(range(len(task.rows))) if self.kept is None else self.kept
        k, none = len(chosen), np.zeros(len(task.rows))
        self._shape = k, n
        sizes = (k * n, k, k, nv, *([nv * nv] if self._curved else []))
        numbers = tuple(np.zeros(size) for size in sizes)
        frame = getattr(task, "frame", None) if part.held else None
        entries = tuple(range(len(task.rows)))
        self.rows = (NativeRows(Kind.GIVEN, frame, entries, none, none, numbers),)
        self._decided = unit if isinstance(task, ForceTask) else 0.0

    @property
    def second(self) -> bool:
        """Whether there is a curvature behind its rows."""
        return self._curved

    def write(self, dt: float) -> bool:
        """Take note of a change: all is written in each tick."""
        self.changes, self.assigned = self.task._changes, self.task._assigned
        return self.singular == self._singular

    def fill(self, given: PythonRows) -> bool:
        """Write the rows of a tick; False: they have a curvature that was not there before."""
        rows, residual, (k, n), (place,) = given.rows, given.residual, self._shape, self._places
        if rows.curvature is not None and not self._curved and not self.held:
            return False
        matrix, target, told, damping, *curvature = place.rest[2:]
        matrix = matrix.reshape(k, n)
        chosen = slice(None) if self.kept is None else self.kept
        width = rows.matrix.shape[-1]
        matrix[:, :width], matrix[:, width:] = rows.matrix[chosen], 0.0
        target[:] = rows.target[chosen]
        place.weight[:] = self._scale * rows.weight[chosen]
        damping[:] = rows.damping
        told[:] = 0.0 if residual is None else residual.error[chosen]
        if curvature:
            curvature[0][:] = 0.0 if rows.curvature is None else rows.curvature.ravel()
        place.header[0] = self._decided if self.torque else rows.rate
        place.rest[0][:] = 0.0 if rows.bias is None else rows.bias[chosen]
        return True


def _reader(names: Sequence[str]) -> Callable[[Mapping[str, Any]], tuple[Any, ...]]:
    """Return what reads several attributes, as a tuple."""
    if len(names) < 2:
        return lambda attributes: tuple(attributes[name] for name in names)
    return itemgetter(*names)


def described(task: Task, torque: bool) -> Sequence[NativeRows] | None:
    """Return what a task says of its rows, if its law is one that the core knows."""
    kind = task.__dict__, vars(type(task))
    if "native" not in kind[1] or "residual" in kind[0] or "drift" in kind[0]:
        return None
    if torque:
        return task.native() if type(task.acceleration_law) is AccelerationLaw else None
    law = task.law
    if type(law) is not VelocityLaw:
        return None
    rows = task.native()
    if rows is not None and len(rows) > 1 and law.lm_damping > 0.0:
        return None  # by the error of the whole task, which is in several blocks
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
