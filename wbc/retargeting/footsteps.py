"""Foot paths of a robot: where its feet stand and roll, and how they swing.

A human's foot lands on its heel, stands flat, and rolls over its ball. A robot's is one plate: it
stands level where the human's stood flattest, and rolls as much as the human's over its rear and
front edges, which do not move meanwhile. In swing it follows the human's foot from edge to edge.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from wbc.constraints.sole_contacts import rolls
from wbc.gait.footsteps import SIGN
from wbc.gait.legs import SIDES, hip_and_ankle
from wbc.minimum_jerk import minimum_jerk
from wbc.motion.dropouts import runs
from wbc.retargeting.cop_correction import SupportedFrames, supports
from wbc.retargeting.robot_setup import RobotSetup
from wbc.retargeting.source import HumanFrames
from wbc.robot import Robot
from wbc.robot.postures import STANDING
from wbc.validate import Array, Bools

# Least distance between the soles by the legs' length, and the largest angle [rad] from straight
# across of the lines along which it is measured.
SOLE_DISTANCE, MAX_LINE_ANGLE = 0.08, 1.3
NOTED_SLIDING = 0.08  # of a level foot in a contact, by the legs' length
CLEARANCE = 0.01  # m, of the corners of a human's foot in swing
MIN_LIFT = 0.1  # of the lifting curve; a foot lower than this must not demand an infinite lift
# rad: stance pitches below the first are 0, those beyond grow smoothly over the second; the third
# is the largest pitch, toes down and up.
FLAT_PITCH, PITCH_TRANSITION, MAX_PITCH = 0.06, 0.1, (0.6, 0.3)
LEVEL_PITCH = 2e-3  # rad: with less tilt a foot stands on all of its sole
EDGE_WIDTH = 1e-3  # m: corners this near to the front or rear form its edge; at least two do


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where a foot stands from frame ``first`` to before ``end``."""

    foot: str
    first: int
    end: int
    pose: Array  # x, y [m] and heading [rad] of the sole frame when it is level


class FootPath(NamedTuple):
    """The path of one foot."""

    place: Array  # of the sole frame (n, 3) [m]
    # (n,) [rad]; a positive pitch has the toes up
    heading: Array
    pitch: Array
    down: Bools  # whether it touches the ground (n,)
    # of the sole that touch the ground, or would (n, k, 3) [m]; the last may be repeated
    corners: Array
    shift: Array  # from the human's scaled path (n, 2) [m]
    origin: Array  # of the footprint that it stands on, or its own place in the air (n, 3) [m]

    @property
    def rotation(self) -> Array:
        """Of the sole frame (n, 3, 3)."""
        return yaw_pitch_rotations(self.heading, self.pitch)

    def displaced(self, span: slice, shift: Array, yaw: float) -> FootPath:
        """Return the path with its footprint in some frames shifted (2,) [m] and rotated [rad]."""
        R, origin = yaw_pitch_rotations(np.array([yaw]))[0], self.origin[span]
        new = {name: getattr(self, name).copy() for name in ("place", "heading", "corners")}
        target = [*shift, 0.0] + origin
        new["place"][span] = (new["place"][span] - origin) @ R.T + target
        new["corners"][span] = (new["corners"][span] - origin[:, None]) @ R.T + target[:, None]
        new["heading"][span] += yaw
        new["origin"] = self.origin.copy()
        new["origin"][span] = target
        return self._replace(**new)


@dataclass(frozen=True, eq=False)
class FootPaths:
    """Paths of both feet, by side, and their footprints."""

    paths: Mapping[str, FootPath]
    prints: tuple[Footprint, ...]
    widening: float  # outward shift of each foot [m]
    notes: tuple[str, ...]  # of feet that slide on the ground
    # sides of feet that stand along the middle of their length only: their legs have no joint to
    # roll them, so they tilt sideways as the legs do (LineContact)
    line_feet: frozenset[str]

    @property
    def down(self) -> Bools:
        """Which feet touch the ground (n, 2), left and right."""
        return np.column_stack([self.paths[side].down for side in SIDES])

    @cached_property
    def supports(self) -> tuple[SupportedFrames, ...]:
        """Of all frames but those in flight."""
        return supports({side: self.paths[side].corners for side in SIDES}, self.down)


def yaw_pitch_rotations(heading: Array, pitch: Array | None = None) -> Array:
    """Return rotations (n, 3, 3) of headings and pitches (n,) [rad], toes up positive; None: 0."""
    pitch = np.zeros_like(heading) if pitch is None else pitch
    c, s, cp, sp = np.cos(heading), np.sin(heading), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(c)
    rows = [[c * cp, -s, -c * sp], [s * cp, c, -s * sp], [sp, zero, cp]]
    return np.moveaxis(np.array(rows), 2, 0)


def foot_paths(source: HumanFrames, setup: RobotSetup, scaling: Array) -> FootPaths:
    """Return the paths of a robot's feet.

    ``scaling``: matrix (3, 3) from a human's positions to the robot's.
    """
    robot, legs = setup.robot, setup.legs
    arms = {side: _sole_from_ankle(robot, side) for side in SIDES}
    flat = {side: _flatness(source, side) for side in SIDES}
    prints, notes, dt = [], list[str](), float(source.series.time[1] - source.series.time[0])
    for side in SIDES:
        place, heading = source.soles[side]
        level = place @ scaling.T + yaw_pitch_rotations(heading) @ arms[side]
        for first, end in runs(source.down[side]):
            weight = flat[side][first:end]
            x, y = np.average(level[first:end, :2], axis=0, weights=weight)
            pose = np.array((x, y, np.average(heading[first:end], weights=weight)))
            prints.append(Footprint(side, first, end, pose))
            flatter = weight > 0.3 * weight.max()
            sliding = np.linalg.norm(level[first:end, :2] - pose[:2], axis=1)[flatter].max()
            if sliding > NOTED_SLIDING * legs.length:
                span = f"{first * dt:.2f} to {(end - 1) * dt:.2f} s of the human's time"
                notes.append(
                    f"the {side} foot slides {1e3 * sliding:.0f} mm along the ground, {span}: it"
                    " stands in between"
                )
    soles = {side: robot.feet[side].polygon for side in SIDES}
    widening = _required_widening(prints, soles, SOLE_DISTANCE * legs.length, setup.least_width)
    posture = robot.snapshot(robot.postures[STANDING])
    line_feet = frozenset(side for side in SIDES if not rolls(posture, side))
    if line_feet:  # such soles are level where the feet are as wide apart as the hips
        width = [float((a.pose[:2] - b.pose[:2]) @ across) for a, b, across in _neighbours(prints)]
        if width:
            widening = max(widening, 0.5 * (legs.width - float(np.median(width))))
    prints = [replace(one, pose=_shifted_outward(one.pose, one.foot, widening)) for one in prints]
    paths = {}
    for side in SIDES:
        own = [one for one in prints if one.foot == side]
        paths[side] = _path(source, robot, side, scaling, arms[side], own, widening)
    return FootPaths(paths, tuple(prints), widening, tuple(notes), line_feet)


def _pitches(source: HumanFrames, side: str) -> tuple[Array, Array]:
    """Return a robot's pitch for a human's, in swing and in stance (n,) [rad].

    In stance a nearly flat foot is flat; two derivatives vanish where it begins to pitch.
    """
    pitch = source.roll * np.arcsin(np.clip(source.sole_rotation[side][:, 2, 0], -1.0, 1.0))
    most = np.where(pitch < 0.0, *MAX_PITCH)
    beyond = np.maximum(np.abs(pitch) - FLAT_PITCH, 0.0)
    stance = np.sign(pitch) * beyond**3 / (beyond**2 + PITCH_TRANSITION**2)
    return most * np.tanh(pitch / most), most * np.tanh(stance / most)


def _sole_from_ankle(robot: Robot, side: str) -> Array:
    """Return the sole frame's origin (3,) from the ground below the ankle, in its axes [m]."""
    snapshot = robot.snapshot(robot.postures[STANDING])
    _, ankle = hip_and_ankle(snapshot, side)
    place, R = snapshot.placement(robot.feet[side].frame)
    arm = R.T @ (place - ankle)
    return np.array((arm[0], arm[1], 0.0))


def _flatness(source: HumanFrames, side: str) -> Array:
    """Return weights (n,) of frames for the footprint's mean: largest where level and slow."""
    tilt = 1.0 - source.sole_rotation[side][:, 2, 2]
    speed = np.linalg.norm(np.gradient(source.soles[side][0], source.series.time, axis=0), axis=1)
    return np.exp(-tilt / 0.01 - (speed / 0.2) ** 2) + 1e-9


def _required_widening(
    prints: list[Footprint], soles: Mapping[str, Array], gap: float, least_width: float
) -> float:
    """Return the outward shift of each foot that keeps them apart [m].

    ``soles``: their corners (k, 2), by side [m].
    ``gap``: between soles, and between their widths where one foot passes the other [m].
    ``least_width``: of the feet from each other, for thighs and shanks [m].
    """
    angles = np.linspace(-MAX_LINE_ANGLE, MAX_LINE_ANGLE, 53)
    width = max(gap + max(float(np.ptp(sole[:, 1])) for sole in soles.values()), least_width)
    widening = 0.0
    for a, b, side in _neighbours(prints):
        yaw = 0.5 * (a.pose[2] + b.pose[2])
        across = yaw_pitch_rotations(yaw + angles)[:, :2, 1]
        left, right = (
            one.pose[:2] + soles[one.foot] @ yaw_pitch_rotations(one.pose[2:])[0, :2, :2].T
            for one in (a, b)
        )
        apart = (left @ across.T).min(axis=0) - (right @ across.T).max(axis=0)
        standing = ((gap - apart) / (2.0 * np.cos(angles))).min()
        passing = 0.5 * (width - (a.pose[:2] - b.pose[:2]) @ side)
        widening = max(widening, float(standing), float(passing))
    return widening


def _neighbours(prints: list[Footprint]) -> Iterator[tuple[Footprint, Footprint, Array]]:
    """Yield left and right footprints, simultaneous or successive, and the unit vector across."""
    for a, b in product(prints, prints):
        near = a.first < b.end + 1 and b.first < a.end + 1
        if near and (a.foot, b.foot) == SIDES:
            yaw = 0.5 * (a.pose[2] + b.pose[2])
            yield a, b, np.array((-np.sin(yaw), np.cos(yaw)))


def _shifted_outward(pose: Array, foot: str, widening: float) -> Array:
    yaw = float(pose[2])
    shift = SIGN[foot] * widening * np.array((-np.sin(yaw), np.cos(yaw)))
    return np.array((*(pose[:2] + shift), yaw))


def _path(
    source: HumanFrames,
    robot: Robot,
    side: str,
    scaling: Array,
    arm: Array,
    prints: list[Footprint],
    widening: float,
) -> FootPath:
    """Return a foot's path over its footprints."""
    ankle, heading = source.soles[side]
    polygon = robot.feet[side].polygon
    edges = float(polygon[:, 0].min()), float(polygon[:, 0].max())  # rear and front
    swing_pitch, pitch = _pitches(source, side)
    yaw, swings = heading.copy(), np.ones(len(ankle), dtype=bool)
    for one in prints:
        swings[one.first : one.end] = False
        yaw[one.first : one.end] = one.pose[2]
    angles = np.column_stack((yaw, pitch))
    _blend_swings(angles, np.column_stack((heading, swing_pitch)), swings)
    yaw, pitch = angles.T
    R = yaw_pitch_rotations(yaw, pitch)
    path = ankle @ scaling.T + R @ arm
    path[:, :2] += SIGN[side] * widening * np.column_stack((-np.sin(heading), np.cos(heading)))
    place, origin = path.copy(), path.copy()
    for one in prints:
        span = slice(one.first, one.end)
        place[span] = _roll_over_edge(one.pose, R[span], pitch[span], edges)
        origin[span] = *one.pose[:2], 0.0
    _blend_swings(place, path, swings)
    lowest = place[:, 2] + (np.sin(pitch)[:, None] * polygon[:, 0]).min(axis=1)
    for first, end in runs(swings):  # longer feet than the human's need more clearance
        u = (np.arange(first, end) - first + 1.0) / (end - first + 1.0)
        rise, sink = (u if first > 0 else 1.0), (1.0 - u if end < len(swings) else 1.0)
        lift = minimum_jerk(np.minimum(2.0 * np.minimum(rise, sink), np.ones(end - first)))
        height = CLEARANCE * float(scaling[2, 2]) - lowest[first:end] / np.maximum(lift, MIN_LIFT)
        place[first:end, 2] += max(0.0, float(height.max())) * lift
    corners = place[:, None] + contact_corners(polygon, pitch) @ np.swapaxes(R, 1, 2)
    shift = (place - ankle @ scaling.T - R @ arm)[:, :2]
    return FootPath(place, yaw, pitch, ~swings, corners, shift, origin)


def _blend_swings(values: Array, path: Array, swings: Bools) -> None:
    """Set values (n, k) in swings to ``path``, plus a quintic that joins the stances smoothly.

    The quintic goes from the difference at lift-off, with its rate, to that at touchdown.
    """
    error = values - path
    count = len(values)
    for first, end in runs(swings):
        T = end - first + 1.0
        ends = list[tuple[Array, Array] | None]()
        for at, inner in ((first - 1, -1), (end, 1)):
            if not 0 <= at < count:
                ends.append(None)
                continue
            near = [error[min(max(at + inner * m, 0), count - 1)] for m in range(3)]
            if min(at, count - 1 - at) < 2 or swings[[at + inner, at + 2 * inner]].any():
                near = [near[0]] * 3
            rate = inner * (-1.5 * near[0] + 2.0 * near[1] - 0.5 * near[2])
            ends.append((near[0], T * rate))
        known = [one for one in ends if one is not None]
        if not known:
            values[first:end] = path[first:end]
            continue
        constant = known[0][0], 0.0 * known[0][1]  # beyond the ends of the recording
        start, goal = (constant if one is None else one for one in ends)
        u = ((np.arange(first, end, dtype=float) - first + 1.0) / T)[:, None]
        s = minimum_jerk(u)
        # Quintic Hermite polynomials of a rate at one end, without accelerations.
        leave = u - 6.0 * u**3 + 8.0 * u**4 - 3.0 * u**5
        meet = -4.0 * u**3 + 7.0 * u**4 - 3.0 * u**5
        blend = (1.0 - s) * start[0] + s * goal[0] + leave * start[1] + meet * goal[1]
        values[first:end] = path[first:end] + blend


def _roll_over_edge(pose: Array, R: Array, pitch: Array, edges: tuple[float, float]) -> Array:
    """Return positions (m, 3) of a sole frame that rolls over an edge of its footprint."""
    x, y, yaw = pose.tolist()
    ahead = np.array((np.cos(yaw), np.sin(yaw), 0.0))
    edge = np.where(pitch < 0.0, edges[1], edges[0])[:, None]
    return np.asarray(np.array((x, y, 0.0)) + edge * (ahead - R[:, :, 0]))


def contact_corners(polygon: Array, pitch: Array) -> Array:
    """Return the corners of a sole that touch level ground at pitches (n,), its axes (n, k, 3)."""
    flat = np.column_stack((polygon, np.zeros(len(polygon))))
    x, ordered = polygon[:, 0], np.sort(polygon[:, 0])
    found = np.tile(flat, (len(pitch), 1, 1))
    for where, own in (
        (pitch < -LEVEL_PITCH, x >= min(ordered[-2], ordered[-1] - EDGE_WIDTH)),
        (pitch > LEVEL_PITCH, x <= max(ordered[1], ordered[0] + EDGE_WIDTH)),
    ):
        only = flat[own]
        found[where] = only[np.minimum(np.arange(len(flat)), len(only) - 1)]
    return found
