"""The blocks of a plan: which rows of which parts, and where their numbers are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wbc.controllers.blocks import Part
from wbc.native.rows import Kind, frames_of
from wbc.robot.names import BASE
from wbc.validate import Array


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
        """How many of them are of loops and gears."""
        kinds = Kind.LOOP, Kind.GEAR
        return sum(
            block["rows"] for block in self.blocks if block["held"] and block["kind"] in kinds
        )

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
