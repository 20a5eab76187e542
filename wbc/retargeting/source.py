"""A human's motion as retargeting needs it: CoM and momentum, rotations of segments, feet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.gait.legs import SIDES
from wbc.human import HumanMotion
from wbc.human.contacts import SHORTEST, feet_down
from wbc.motion import RmpSeries, analyze
from wbc.motion.dropouts import runs
from wbc.retargeting.scaling import arm_levers
from wbc.robot.series import sole_series, state_series
from wbc.rotations import headings
from wbc.validate import Array, Bools

ARM_PARTS = "upper_arm", "forearm"
SEGMENTS = "pelvis", "trunk", "head", *(f"{side}_{part}" for side in SIDES for part in ARM_PARTS)
THIGHS = ("left_thigh", "right_thigh")
DROPPED_PERIODS = 0.5  # of the cutoff, at both ends
MIN_FRAMES = 20  # a shorter motion is left whole
# A contact in which a level sole slides, or pivots, faster than this is none.
LEVEL_PITCH, MAX_SLIDING, MAX_PIVOTING = 0.15, 0.25, 2.5  # rad, m/s, rad/s


@dataclass(frozen=True, eq=False)
class HumanFrames:
    """A human's motion at a constant rate, n frames, its own size and time, its ground at z = 0."""

    series: RmpSeries  # CoM, momentum and inertia (RmpSeries), heights as recorded
    rotation: Mapping[str, Array]  # of segments, by name (n, 3, 3)
    heading: Array  # of the pelvis (n,) [rad]
    arms: Mapping[str, Array]  # directions of upper arm and forearm (n, 2, 3), by side
    arm_levers: Mapping[str, Array]  # how far they displace the CoM along these, by side (2,) [m]
    hips: Array  # midpoint of the hips from the CoM (n, 3) [m], world axes
    upright_hips: Array  # the same (3,) [m] of an upright body, in the axes of its pelvis
    # points of the soles under the ankles (n, 3) [m], and headings (n,) [rad], by side
    soles: Mapping[str, tuple[Array, Array]]
    sole_rotation: Mapping[str, Array]  # of the soles, by side (n, 3, 3)
    down: Mapping[str, Bools]  # which feet touch the ground, by side (n,), bool
    roll: float  # part of the soles' pitch that a robot's feet are to have

    def __len__(self) -> int:
        return len(self.series)


def human_frames(
    human: HumanMotion, rate: float, cutoff: float | None, roll: float = 1.0
) -> HumanFrames:
    """Return a human's motion at ``rate`` [Hz], low-passed at ``cutoff`` [Hz].

    Half a period of the cutoff is left out at both ends, unless little would be left.

    Raises InvalidInputError: a human whose CoM is below its feet, as in a handstand.
    """
    series = analyze(
        human.motion,
        rate=rate,
        cutoff=cutoff,
        noise=None,
        feet=None,  # its CoP is not needed
        ground_height=human.ground_height,
    )
    height = float(series.com[:, 2].mean()) - human.ground_height
    if height <= 0.0:
        raise InvalidInputError(
            f"retarget: the human's CoM is {-height:.2f} m below the ground, which is where the"
            " feet are lowest: it stands on no feet; cut the recording, or check which axis is up"
        )
    # Filters extrapolate at the ends of a recording.
    dropped = round(DROPPED_PERIODS / series.cutoff * rate) if series.cutoff else 0
    inner = slice(dropped, len(series) - dropped)
    if len(series) - 2 * dropped < MIN_FRAMES:
        inner = slice(None)
    robot = series.robot
    cut: dict[str, Any] = {name: one[inner] for name, one in series.arrays().items()}
    series = replace(series, **cut)
    places = sole_series(robot, series.q)
    flags = feet_down(robot, places, series.time, human.ground_height)
    states = state_series(robot, series.q, frames=(*SEGMENTS, *THIGHS))
    rotation = {name: states.rotation(name) for name in SEGMENTS}
    hips = np.mean([states.position(name) for name in THIGHS], axis=0)
    facing = headings(rotation["pelvis"])
    soles, sole_rotation, down = {}, {}, {}
    for number, side in enumerate(robot.feet):
        T = places[side]
        position = T[:, :3, 3] - [0.0, 0.0, human.ground_height]
        heading = headings(T[:, :3, :3])
        heading += math.tau * round((facing[0] - heading[0]) / math.tau)  # both feet by one count
        soles[side], sole_rotation[side] = (position, heading), T[:, :3, :3]
        stands = flags[:, number] & ~_slides(position, T[:, :3, :3], series.time)
        down[side] = _without_short_ends(stands, series.time)
    upright = robot.snapshot(robot.postures["neutral"])
    standing = np.mean([upright.position(name) for name in THIGHS], axis=0) - upright.com
    arms = {
        side: -np.stack([rotation[f"{side}_{part}"][:, :, 2] for part in ARM_PARTS], axis=1)
        for side in SIDES
    }
    levers = {
        side: arm_levers(robot, upright, *(f"{side}_{part}" for part in ARM_PARTS))
        for side in SIDES
    }
    return HumanFrames(
        series, rotation, facing, arms, levers, hips - series.com, standing, soles, sole_rotation,
        down, roll,
    )  # fmt: skip


def _slides(position: Array, rotation: Array, time: Array) -> Bools:
    """Return where a sole slides or pivots on the ground (n,), for long enough to be no contact."""
    speed = np.linalg.norm(np.gradient(position[:, :2], time, axis=0), axis=1)
    slides = (np.abs(rotation[:, 2, 0]) < LEVEL_PITCH) & (speed > MAX_SLIDING)
    slides |= np.abs(np.gradient(headings(rotation), time)) > MAX_PIVOTING
    for first, end in runs(slides):
        if time[end - 1] - time[first] < SHORTEST:
            slides[first:end] = False
    return slides


def _without_short_ends(flags: Bools, time: Array) -> Bools:
    """Return contacts without too short phases at the beginning and end of the recording."""
    flags = flags.copy()
    for first, end in (one for value in (True, False) for one in runs(flags == value)):
        if time[end - 1] - time[first] < SHORTEST:
            if first == 0 and end < len(flags):
                flags[:end] = flags[end]
            elif end == len(flags) and first > 0:
                flags[first:] = flags[first - 1]
    return flags
