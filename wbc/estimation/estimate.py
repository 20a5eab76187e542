"""An estimated state with its uncertainty, and its notes: what the core rejected or did not use."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from wbc.errors import listed
from wbc.estimation.core import EstimatorCore
from wbc.native import lib
from wbc.validate import Array

UNTIL_STILL = "not counted on until it is still"
# Of IMUs and feet, with name and amount.
TEXTS = {
    lib.RATE_BEYOND: "IMU {0!r}: angular velocity beyond its range of {1:g}; not used",
    lib.FORCE_BEYOND: "IMU {0!r}: specific force beyond its range of {1:g}; not used",
    lib.HANGS: "IMU {0!r}: {1:.0f} readings in a row are the same; not used",
    lib.LEFT_OUT: "IMU {0!r}: silent for {1:.0f} ms; left out",
    lib.HELD: "IMU {0!r}: held for {1:.0f} ms",
    lib.GAP: "IMU {0!r}: nothing for {1:.0f} ms, for which one reading stands",
    lib.COUNTED_ANYWAY: "no foot is still: {0} is counted on at {1:.2f} m/s",
    lib.SLIPS: f"{{0}} foot slips at {{1:.2f}} m/s; {UNTIL_STILL}",
    lib.ROLLS: "{0} foot turns by {1:.0f} mrad",
    lib.ROLLS_OVER: f"{{0}} foot turns by {{1:.0f}} mrad; {UNTIL_STILL}",
    lib.OUTSIDE: "{0} foot seen {1:.1f} mm off: an outlier, not used",
    lib.SLIPPED_OFF: f"{{0}} foot slips: seen {{1:.1f}} mm off; {UNTIL_STILL}",
    lib.FEET_APART: "{0} foot slips: feet are {1:.1f} mm nearer or farther; not counted on",
}
IMU_EVENTS = (lib.RATE_BEYOND, lib.FORCE_BEYOND, lib.HANGS, lib.LEFT_OUT, lib.HELD, lib.GAP)
NUMBER = re.compile(r"\b\d+(\.\d+)?")  # not those in names
MAX_KINDS = 5
NO_LOADS = "no contacts, forces or torques: all feet are taken to bear always"
Names = tuple[str, ...]  # in the core's order


@dataclass(frozen=True, eq=False)
class Estimate:
    """A state with its uncertainty, at the time of the last measurement.

    Errors are estimate minus truth, in world axes. Heading (yaw) and position are unobservable by
    IMU, joints and feet: they are relative to the start, and their variance only grows.

    Attributes
    ----------
    time:
        Of the measurement [s].
    q:
        Configuration (nq,): base position [m], quaternion x y z w, joints.
    v:
        Velocity (nv,): base linear and angular in base axes, joints' rates.
    covariance:
        (15, 15) of the primary IMU's rotation [rad], velocity [m/s], position [m], gyroscope bias
        [rad/s] and accelerometer bias [m/s^2]; the biases in its own axes.
    contacts:
        Feet in contact, which are assumed to stand still.
    slipping:
        Feet that bear, but move; they are not used.
    gyroscope_bias, accelerometer_bias:
        (3,) [rad/s], [m/s^2] of the primary IMU, in its axes.
    forces:
        Wrench (6,) on the sole by foot, at its frame's origin in world axes [N, N m], by momentum
        residuals; empty without torques.
    innovation:
        Normalised innovation squared of this update, and its degrees of freedom.
    notes:
        What was rejected, skipped or guessed in this update.
    """

    time: float
    q: Array
    v: Array
    covariance: Array
    contacts: tuple[str, ...]
    slipping: tuple[str, ...]
    gyroscope_bias: Array
    accelerometer_bias: Array
    forces: Mapping[str, Array]
    innovation: tuple[float, int]
    notes: tuple[str, ...]

    @property
    def tilt_deviation(self) -> float:
        """Standard deviation of the tilt from the vertical, both axes together [rad]."""
        return math.sqrt(float(self.covariance[0, 0] + self.covariance[1, 1]))

    @property
    def yaw_deviation(self) -> float:
        """Standard deviation of the heading [rad], relative to that at the start: it grows."""
        return math.sqrt(float(self.covariance[2, 2]))

    @property
    def velocity_deviation(self) -> float:
        """Standard deviation of the linear velocity, all axes together [m/s]."""
        return math.sqrt(float(np.trace(self.covariance[3:6, 3:6])))

    @property
    def position_deviation(self) -> float:
        """Standard deviation of the position [m], relative to that at the start: it grows."""
        return math.sqrt(float(np.trace(self.covariance[6:9, 6:9])))


def notes_of(core: EstimatorCore, imus: Names, joints: Names, feet: Names) -> tuple[str, ...]:
    """Return the notes of the last message."""
    count = int(core.event[0])
    events = core.event[1 : 1 + 2 * count].reshape(count, 2).tolist()
    notes, told = list[str](), zip(events, core.detail[:count].tolist(), strict=True)
    for have_jumped, same in groupby(told, lambda one: one[0][0] == lib.JOINT_JUMPED):
        if have_jumped:
            jumped = [joints[index] for (_, index), _ in same]
            notes.append(f"joint {listed(jumped)}: position jumped; held")
            continue
        for (kind, index), value in same:
            if kind == lib.TAKES_OVER:
                silent, next_ = (imus[k] for k in divmod(index, lib.MOST_IMUS))
                notes.append(f"IMU {silent!r}: silent for {value:.0f} ms; {next_!r} takes over")
            elif kind == lib.NO_LOADS:
                notes.append(NO_LOADS)
            else:
                names = imus if kind in IMU_EVENTS else feet
                notes.append(TEXTS[kind].format(names[index], value))
    return tuple(notes)


def count_notes(told: MutableMapping[str, int], notes: Sequence[str]) -> None:
    """Count an estimate's notes by their kind: without numbers."""
    for note in notes:
        kind = NUMBER.sub("#", note)
        told[kind] = told.get(kind, 0) + 1


def frequent_notes(told: MutableMapping[str, int]) -> tuple[str, ...]:
    """Return the most frequent kinds of notes, and how often they were made, in words."""
    frequent = sorted(told.items(), key=lambda one: -one[1])[:MAX_KINDS]
    often = (("once" if count == 1 else f"{count} times", note) for note, count in frequent)
    return tuple(f"estimate, {count}: {note}" for count, note in often)
