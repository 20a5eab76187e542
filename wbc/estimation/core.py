"""The core's estimator: robot, sensors and settings, and its memory."""

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
from wbc.robot.mounted_frames import Mount, mounted_places
from wbc.validate import Array

MAX_SPEED_RATIO = 3.0  # of a plausible joint speed by its limit
MAX_WAITING = 50_000  # messages of the standing time
BUFFER_FACTOR = 4  # of the messages buffered at the beginning, by those of the standing time
# Settings of the same name in the core.
CORE_SETTINGS = (
    *("encoder_delay", "standing_time", "settle", "still", "slides", "sliding", "apart", "lost"),
    *("timeout", "load", "estimated_load"),
)


class EstimatorMemory(NamedTuple):
    """The state of an estimator between two messages."""

    filter: tuple[Array, Counts]
    observer: Array
    numbers: Array
    counts: Counts


class EstimatorCore:
    """The core's estimator (``source/estimator.c``).

    ``filter``, ``observer``: its parts, each with its own memory.
    ``given``: arrays that the core reads, by their names there.
    ``made``: arrays that the core writes.
    ``counts``, ``event``, ``detail``: those of them that are read from Python; see
    ``source/core.h``.
    ``out``: number of values of an estimate.
    """

    def __init__(
        self, robot: Robot, imus: Sequence[ImuMount], settings: EstimatorSettings, dt: float
    ) -> None:
        s, feet = settings, list(robot.feet.values())
        if len(imus) > lib.MOST_IMUS:
            raise InvalidInputError(
                f"estimator, imus: {len(imus)} of them; at most {lib.MOST_IMUS} are supported"
            )
        if s.standing_time > MAX_WAITING * dt:
            raise InvalidInputError(
                f"estimator, standing_time: {s.standing_time:g} s are more than {MAX_WAITING}"
                f" messages {dt:g} s apart"
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
            "fastest": MAX_SPEED_RATIO * robot.limits.velocity,
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
                "waiting": 2 + BUFFER_FACTOR * (1 + math.ceil(s.standing_time / dt)),
                "weight": robot.weight,
                "encoder_variance": s.encoder_deviation**2,
                "floor": [s.place_floor**2, s.turn_floor**2],
                "bias_variances": [s.gyroscope_bias**2, s.accelerometer_bias**2],
                **{name: getattr(s, name) for name in CORE_SETTINGS},
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
        """Restart, standing at the base's pose of ``q`` (nq,), if given."""
        self.given["start"][:] = 0.0 if q is None else q[:BASE_NQ]
        lib.wbc_estimator_reset(self.struct)

    def memory(self) -> EstimatorMemory:
        """Return the whole state, for :meth:`restore`."""
        parts = self.filter.memory(), self.observer.memory()
        return EstimatorMemory(*parts, self._numbers.copy(), self.counts.copy())

    def restore(self, memory: EstimatorMemory) -> None:
        """Restore a state of :meth:`memory`."""
        self.filter.restore(memory.filter)
        self.observer.restore(memory.observer)
        self._numbers[:], self.counts[:] = memory.numbers, memory.counts
