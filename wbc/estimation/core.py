"""What the core estimates by: the robot, its sensors and settings, and memory, in fixed places."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.estimation.contact_filter import ContactFilter, Counts
from wbc.estimation.measurement import ImuMount
from wbc.estimation.momentum_observer import MomentumObserver
from wbc.estimation.settings import EstimatorSettings
from wbc.native import ffi, lib, pointer
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.mounted import Mount, mounted_places
from wbc.validate import Array

JUMP = 3.0  # times what a joint's speed limit allows in one period: a reading is wrong
ROOM = 4  # times the messages of the usual period that are kept while it stands to begin
# Settings that the core has by the same name.
SAME = (
    *("encoder_delay", "standing_time", "settle", "still", "slides", "sliding", "apart", "lost"),
    *("timeout", "load", "estimated_load"),
)


class EstimatorMemory(NamedTuple):
    """All that an estimator knows between two messages."""

    filter: tuple[Array, Counts]
    observer: Array
    numbers: Array
    counts: Counts


class EstimatorCore:
    """An estimator as the core has it (``source/estimator.c``).

    Attributes
    ----------
    filter, observer:
        Its parts, each with memory of its own.
    given:
        Arrays that are only read, by their names there.
    made:
        Arrays that are written.
    counts, event, detail:
        Of those what it is known by from outside; see ``source/core.h``.
    out:
        How many numbers an estimate has.
    """

    def __init__(
        self, robot: Robot, imus: Sequence[ImuMount], settings: EstimatorSettings, dt: float
    ) -> None:
        s, feet = settings, list(robot.feet.values())
        if len(imus) > lib.MOST_IMUS:
            raise InvalidInputError(
                f"estimator, imus: {len(imus)} of them; at most {lib.MOST_IMUS} are supported"
            )
        self.filter = ContactFilter(len(feet), s.noise, np.array(robot.model.gravity.linear))
        self.observer = MomentumObserver(robot, s.bandwidth)
        soles = [Mount(foot.frame, np.zeros(3), np.eye(3)) for foot in feet]
        joints, placements = mounted_places(robot, [*(one.mount for one in imus), *soles])
        tree = robot.native.tree
        self.given: Mapping[str, NDArray[Any]] = {
            "joint": joints,
            "placement": placements,
            "flat": np.array([len(foot.polygon) > 2 for foot in feet], dtype=np.int64),
            "fastest": JUMP * robot.limits.velocity,
            "range": np.array([(one.most_rate, one.most_force) for one in imus]),
            "start": np.zeros(BASE_NQ),
        }
        self.struct = ffi.new(
            "wbc_estimator *",
            {
                "tree": tree.struct,
                "filter": self.filter.struct,
                "momentum": self.observer.struct,
                "imus": len(imus),
                "feet": len(feet),
                "window": s.velocity_window,
                "waiting": 2 + ROOM * (1 + math.ceil(s.standing_time / dt)),
                "weight": robot.weight,
                "encoder_variance": s.encoder_deviation**2,
                "floor": [s.place_floor**2, s.turn_floor**2],
                "bias_variances": [s.gyroscope_bias**2, s.accelerometer_bias**2],
                **{name: getattr(s, name) for name in SAME},
                **{name: pointer(array) for name, array in self.given.items()},
            },
        )
        sizes = ffi.new("int64_t[6]")
        lib.wbc_estimator_sizes(self.struct, sizes)
        numbers, counts, wait, event, out, frames = sizes
        self.out = out + robot.nq
        self.counts: Counts = np.zeros(counts, dtype=np.int64)
        self.event: Counts = np.zeros(event, dtype=np.int64)
        self.detail = np.zeros(event // 2)
        self._numbers = np.zeros(numbers)
        scratch = robot.nq + 18 * robot.nv + 13 * tree.joints + 2 * (robot.nv - BASE_NV)
        self.made: Mapping[str, NDArray[Any]] = {
            "x": self._numbers,
            "counts": self.counts,
            "event": self.event,
            "detail": self.detail,
            "wait": np.zeros(wait),
            "frames": np.zeros(frames),
            "state": np.zeros(tree.frames),
            "scratch": np.zeros(scratch),
        }
        for name, array in self.made.items():
            setattr(self.struct, name, pointer(array))

    def reset(self, q: Array | None) -> None:
        """Forget all, and stand to begin at the base's pose of ``q`` (nq,), if that is given."""
        self.given["start"][:] = 0.0 if q is None else q[:BASE_NQ]
        lib.wbc_estimator_reset(self.struct)

    def memory(self) -> EstimatorMemory:
        """Return all that it knows, for :meth:`restore`."""
        parts = self.filter.memory(), self.observer.memory()
        return EstimatorMemory(*parts, self._numbers.copy(), self.counts.copy())

    def restore(self, memory: EstimatorMemory) -> None:
        """Go back to what :meth:`memory` returned."""
        self.filter.restore(memory.filter)
        self.observer.restore(memory.observer)
        self._numbers[:], self.counts[:] = memory.numbers, memory.counts
