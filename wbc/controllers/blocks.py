"""Tasks and contacts as the core reads them: blocks of rows, and the numbers of each.

What a task is about is planned once; its numbers (targets, weights, gains) are written again when
an attribute of the task was set, and where only its target was, those that move with it. Tasks that
do not describe their rows (one's own, inertia in a frame's axes) are asked in each tick, and the
core does with their answers what it does with its own (:class:`AskedPart`); those about forces give
rows on the unknowns (:class:`ForcePart`).
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
        self.task, self.own = task, task.__dict__  # which is quicker to read
        self.held, self.level, self._scale = held, level, scale
        self.kept = None if kept is None else list(kept)
        self.torque = torque
        self.rows = described(task, torque)
        self.changes: object = None  # of the task, when its numbers were written
        self._remakes: object = None
        self.planned_as = task.name, task.priority
        self._places: list[_Place] = []
        self._rereads = kept is None and all(rows.moving for rows in self.rows or ())
        # The task's attributes that move, where they go, and what they were when they were written.
        self._moving: list[list[Any]] = []
        self._law: VelocityLaw | AccelerationLaw | None = None
        self._factor = scale  # on the weights, with the law's own
        self._second, self._singular = self.second, self.singular

    @property
    def singular(self) -> bool:
        """Whether others look into its rows: see :mod:`wbc.controllers.singular`."""
        return not self.torque and bool(self.task.singular_threshold)

    @property
    def second(self) -> bool:
        """Whether the curvature that its rows leave out is in the cost."""
        return not self.torque and isinstance(self.task, InertiaTask) and self.task.second_order

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
        ends = (0, *accumulate(sizes))
        header, weight, *rest = (memory[begin:end] for begin, end in pairwise(ends))
        self._places.append(_Place(header, weight, rest))
        for name, where in zip(rows.moving, rest, strict=False):
            if name and self._rereads:
                self._moving.append([name, where.reshape(self.own[name].shape), None])

    def write(self, dt: float) -> bool:
        """Write the numbers of a task that was changed; False if it is another one now."""
        own = self.own
        remakes, changes = own["_remakes"], own["_changes"]
        if remakes is self._remakes and self._rereads:  # only the target was set
            for moving in self._moving:
                name, where, written = moving
                now = own[name]
                if now is not written:  # arrays are replaced, never changed
                    where[...] = moving[2] = now
            self.changes = changes
            return True
        task, planned = self.task, self.rows
        for moving in self._moving:
            moving[2] = own[moving[0]]
        found = described(task, self.torque)
        if found is None or planned is None or len(found) != len(planned):
            return False
        if self.second != self._second or self.singular != self._singular:
            return False
        for k, now in enumerate(found):
            about = planned[k][:3], planned[k].other
            if (now[:3], now.other) != about or not self._places[k].write(now, self.kept):
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
        for now, place in zip(found, self._places, strict=True):
            if law is not self._law:
                place.header[:] = _header(law, now, dt)
            own = task.weight[offset : offset + len(now.entries)]
            place.weight[:] = self._factor * (own if self.kept is None else own[self.kept])
            offset += len(now.entries)
        self._law = law


class Asked(NamedTuple):
    """What a task in Python answers at one snapshot."""

    task: Task
    residual: Residual | None = None  # of a task about motion
    # (k,) its second derivative at zero acceleration of v; None at the velocity level.
    drift: Array | None = None
    rows: Rows | None = None  # of a task about forces, in place of both: rows on the unknowns


class AskedPart(Part):
    """One task or contact that is asked in Python, and where its answers go.

    Parameters
    ----------
    nv:
        How many entries the velocity has.
    curved:
        Whether its residual has a curvature, which goes into the cost.
    """

    def __init__(self, part: Part, nv: int, curved: bool) -> None:
        task = part.task
        self._curved = curved and not (part.held or part.torque)
        super().__init__(task, part.kept, part.held, part.torque, part.level, part._scale)
        chosen = list(range(len(task.rows))) if self.kept is None else self.kept
        k, none = len(chosen), np.zeros(len(task.rows))
        self._chosen, self._shape = slice(None) if self.kept is None else self.kept, (k, nv)
        numbers = [np.zeros(size) for size in (k * nv, k, nv, *([nv * nv] if self._curved else []))]
        frame = task.frame if isinstance(task, Contact) else None  # at which its forces act
        entries = tuple(range(len(task.rows)))
        self.rows = (NativeRows(Kind.ASKED, frame, entries, none, none, tuple(numbers)),)

    @property
    def second(self) -> bool:
        """Whether there is a curvature behind its rows."""
        return self._curved

    def write(self, dt: float) -> bool:
        """Write law and weights of a task that was changed; all else is written in each tick."""
        self.changes = self.task._changes
        self._write_law(self.rows or (), dt)
        return self.singular == self._singular

    def fill(self, asked: Asked) -> bool:
        """Write the answer of a tick; False: it is of another kind than was planned."""
        residual, (place,), chosen = asked.residual, self._places, self._chosen
        if residual is None:
            return False
        if residual.curvature is not None and not (self._curved or self.held or self.torque):
            return False
        bias, drift, matrix, error, bound, *curvature = place.rest
        matrix.reshape(self._shape)[:] = residual.jacobian[chosen]
        error[:], bias[:] = residual.error[chosen], residual.bias[chosen]
        if asked.drift is not None:
            drift[:] = asked.drift[chosen]
        elif place.header[lib.HALF_GAIN] and not self.held:
            left_out = residual.curvature_bound
            bound[:] = left_out() if callable(left_out) else left_out
            bound *= self._factor**2
        if curvature:
            curvature[0][:] = 0.0 if residual.curvature is None else residual.curvature.ravel()
            curvature[0][:] *= self._factor**2
        return True


class ForcePart(Part):
    """One task about forces, and where its rows go: matrix and target, by n unknowns."""

    def __init__(self, part: Part, n: int) -> None:
        super().__init__(part.task, None, False, part.torque, part.level, part._scale)
        k = len(part.task.rows)
        none, numbers = np.zeros(k), (np.zeros(k * n), np.zeros(k))
        self.rows = (NativeRows(Kind.GIVEN, None, tuple(range(k)), none, none, numbers),)

    def write(self, dt: float) -> bool:
        """Take note of a change: all is written in each tick."""
        self.changes = self.task._changes
        return True

    def fill(self, asked: Asked) -> bool:
        """Write the rows of a tick; False: there are none."""
        rows, (place,) = asked.rows, self._places
        if rows is None:
            return False
        place.weight[:] = self._scale * rows.weight
        place.rest[2][:], place.rest[3][:] = rows.matrix.ravel(), rows.target
        return True


class CoreBlocks(NamedTuple):
    """What parts are to the core."""

    frames: list[str]  # that they are about; the first is the base
    moving: int  # how many of them have Jacobians, the first
    entries: list[int]  # entries of what their kinds know, one block behind the other
    blocks: list[dict[str, int]]  # fields of each ``wbc_block`` of source/core.h
    number: Array  # numbers of all, which parts write
    moments: int  # how many rows are moments about a centre of pressure

    @classmethod
    def of(cls, parts: Sequence[Part]) -> CoreBlocks:
        """Return the blocks of all parts, which get to know where their numbers go."""
        frames, moving = frames_of(BASE, (rows for part in parts for rows in part.rows or ()))
        entries, blocks = list[int](), list[dict[str, int]]()
        begins: list[tuple[Part, int]] = []
        size, moments, counts = 0, 0, [0, 0]  # the last: rows of costs, of contacts
        for part in parts:
            for rows in part.rows or ():
                kept = part.chosen(rows)
                places = {"rows": len(kept), "first": counts[part.held], "index": len(entries)}
                levels = {"held": part.held, "level": part.level, "second": part.second}
                if rows.kind == Kind.COP:
                    levels["other"] = moments
                    moments += len(kept)
                blocks.append(rows.block(frames, number=size, **places, **levels))
                entries += [rows.entries[i] for i in kept]
                begins.append((part, size))
                size += part.size(rows)
                counts[part.held] += len(kept)
        number = np.zeros(size)
        for part, begin in begins:
            part.place(number[begin:])
        return cls(frames, moving, entries, blocks, number, moments)

    @property
    def held(self) -> int:
        """How many rows are met exactly."""
        return sum(block["rows"] for block in self.blocks if block["held"])

    @property
    def mechanics(self) -> int:
        """How many rows are of loops and gears, which may give way, too."""
        kinds = Kind.LOOP, Kind.GEAR
        return sum(block["rows"] for block in self.blocks if block["kind"] in kinds)

    @property
    def costs(self) -> int:
        """How many rows are costs."""
        return sum(block["rows"] for block in self.blocks if not block["held"])

    @property
    def of_forces(self) -> bool:
        """Whether costs are about forces, too."""
        return any(block["kind"] in (Kind.GIVEN, Kind.COP) for block in self.blocks)

    @property
    def largest(self) -> int:
        """How many rows the largest block has."""
        return max((block["rows"] for block in self.blocks), default=0)

    @property
    def counts(self) -> dict[str, int]:
        """The fields of ``wbc_plan`` that count them."""
        sizes = {"blocks": len(self.blocks), "frames": self.moving}
        return {**sizes, "costs": self.costs, "held": self.held}


def described(task: Task, torque: bool) -> Sequence[NativeRows] | None:
    """Return what a task says of its rows; None: it is asked for them."""
    own, kind = task.__dict__, type(task)
    known = "native" in vars(kind)
    if isinstance(task, ForceTask):  # of a kind derived from one, too, if it says nothing else
        known |= type(task).expression is ForceTask.expression
    if not known or "residual" in own or "drift" in own:
        return None
    rows = task.native()
    if rows is not None and len(rows) > 1 and task.lm_damping and not torque:
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
