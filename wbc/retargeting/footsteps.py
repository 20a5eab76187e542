"""Where a robot's feet stand and roll, and how they swing from one place to the next.

A human's foot lands on its heel, stands flat, and rolls over its ball. A robot's is one plate: it
is held level where the human's stood flattest, and rolls over its rear and front edges, which do
not move meanwhile, by as much as the human's. In the air it follows the human's foot, and begins
and ends on these edges.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.gait.ability import rolls
from wbc.gait.footsteps import SIGN
from wbc.gait.legs import SIDES, Legs, leg_joints
from wbc.minimum_jerk import minimum_jerk
from wbc.motion.dropouts import runs
from wbc.retargeting.cop_correction import SupportedFrames, supports
from wbc.retargeting.source import HumanFrames
from wbc.robot import Robot
from wbc.robot.postures import STANDING
from wbc.validate import Array

# Soles come no nearer to each other than this part of the legs' length, along lines that are turned
# by so much [rad] from straight across at most.
BESIDE, STEEP = 0.08, 1.3
DRAWN = 0.08  # part of the legs' length: what a level foot moves more in a contact is told
CLEARANCE = 0.01  # m, of a human's foot: so high its corners pass over the ground
LOW = 0.1  # part of that at which a foot counts as lifted
# rad: pitches below the first are those of a foot that is flat, and little more until the second;
# none is larger than the third, toes down and up.
FLAT, EASED, STEEPEST = 0.06, 0.1, (0.6, 0.3)
LEVEL = 2e-3  # rad: a foot that is tilted by less stands on all of its sole
EDGE = 1e-3  # m: corners so near to the front or rear are those of its edge; two are, at least
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Footprint:
    """Where a foot stands from frame ``first`` to before ``end``.

    Attributes
    ----------
    pose:
        x, y [m] and heading [rad] of the sole frame when it is level.
    """

    foot: str
    first: int
    end: int
    pose: Array


class FootPath(NamedTuple):
    """The way of one foot.

    Attributes
    ----------
    place:
        Of the sole frame (n, 3) [m].
    heading, pitch:
        (n,) [rad]; a positive pitch has the toes up.
    down:
        Whether it touches the ground (n,).
    corners:
        Of the sole that touch the ground, or would (n, k, 3) [m]; fewer ones are repeated.
    shift:
        How far it is set from the human's scaled way (n, 2) [m].
    origin:
        Of the footprint that it stands on, or its own place in the air (n, 3) [m].
    """

    place: Array
    heading: Array
    pitch: Array
    down: Bools
    corners: Array
    shift: Array
    origin: Array

    @property
    def rotation(self) -> Array:
        """Of the sole frame (n, 3, 3)."""
        return pitched(self.heading, self.pitch)

    def set_aside(self, span: slice, move: Array, turn: float) -> FootPath:
        """Return the way with its footprint in some frames moved (2,) [m] and turned [rad]."""
        R, origin = pitched(np.array([turn]), np.zeros(1))[0], self.origin[span]
        new = {name: getattr(self, name).copy() for name in ("place", "heading", "corners")}
        way = [*move, 0.0] + origin
        new["place"][span] = (new["place"][span] - origin) @ R.T + way
        new["corners"][span] = (new["corners"][span] - origin[:, None]) @ R.T + way[:, None]
        new["heading"][span] += turn
        moved = self.origin.copy()
        moved[span] = way
        return self._replace(origin=moved, **new)


@dataclass(frozen=True, eq=False)
class FootPaths:
    """Ways of both feet, by side, and where they stand.

    Attributes
    ----------
    wider:
        By how much each foot was set outwards [m].
    notes:
        Of feet that are drawn along the ground.
    lines:
        Feet that stand along the middle of their length only: their legs have no joint to roll
        them, so that they tilt sideways as the legs do (:class:`~wbc.LineContact`).
    """

    paths: Mapping[str, FootPath]
    prints: tuple[Footprint, ...]
    wider: float
    notes: tuple[str, ...]
    lines: frozenset[str]

    @property
    def down(self) -> Bools:
        """Which feet touch the ground (n, 2), left and right."""
        return np.column_stack([self.paths[side].down for side in SIDES])

    @cached_property
    def supports(self) -> tuple[SupportedFrames, ...]:
        """What frames stand on."""
        return supports({side: self.paths[side].corners for side in SIDES}, self.down)


def pitched(heading: Array, pitch: Array) -> Array:
    """Return rotations (n, 3, 3) with these headings and pitches (n,), toes up positive [rad]."""
    c, s, cp, sp = np.cos(heading), np.sin(heading), np.cos(pitch), np.sin(pitch)
    zero = np.zeros_like(c)
    rows = [[c * cp, -s, -c * sp], [s * cp, c, -s * sp], [sp, zero, cp]]
    return np.moveaxis(np.array([[*row] for row in rows]), 2, 0)


def foot_paths(source: HumanFrames, robot: Robot, legs: Legs, spread: Array) -> FootPaths:
    """Return the ways of a robot's feet.

    Parameters
    ----------
    spread:
        (3, 3), which takes a human's places to the robot's size.
    """
    arms = {side: _from_under_ankle(robot, side) for side in SIDES}
    flat = {side: _flatness(source, side) for side in SIDES}
    prints, notes, dt = [], list[str](), float(source.series.time[1] - source.series.time[0])
    for side in SIDES:
        place, heading = source.soles[side]
        level = place @ spread.T + pitched(heading, np.zeros_like(heading)) @ arms[side]
        for first, end in runs(source.down[side]):
            pose = _print(level, heading, flat[side], first, end)
            prints.append(Footprint(side, first, end, pose))
            flatter = flat[side][first:end] > 0.3 * flat[side][first:end].max()
            off = np.linalg.norm(level[first:end, :2] - pose[:2], axis=1)[flatter].max()
            if off > DRAWN * legs.length:
                span = f"{first * dt:.2f} to {(end - 1) * dt:.2f} s of the human's time"
                notes.append(
                    f"the {side} foot is drawn {1e3 * off:.0f} mm along the ground, {span}: it"
                    " stands in between"
                )
    soles = {side: robot.feet[side].polygon for side in SIDES}
    wider = _outwards(prints, soles, BESIDE * legs.length)
    posture = robot.snapshot(robot.postures[STANDING])
    lines = frozenset(side for side in SIDES if not rolls(posture, side))
    if lines:  # legs that stand as they are made to hold such soles level
        apart = [float((a.pose[:2] - b.pose[:2]) @ across) for a, b, across in _neighbours(prints)]
        wider = max(wider, 0.5 * (legs.width - float(np.median(apart)))) if apart else wider
    prints = [replace(one, pose=_moved_out(one.pose, one.foot, wider)) for one in prints]
    paths = {}
    for side in SIDES:
        own = sorted((one for one in prints if one.foot == side), key=lambda one: one.first)
        paths[side] = _path(source, robot, side, spread, arms[side], own, wider)
    return FootPaths(paths, tuple(prints), wider, tuple(notes), lines)


def _pitches(source: HumanFrames, side: str) -> tuple[Array, Array]:
    """Return a robot's pitch for a human's, in the air and on the ground (n,) [rad].

    On the ground a foot that is nearly flat is flat; two derivatives vanish where it no longer is.
    """
    pitch = source.roll * np.arcsin(np.clip(source.sole_rotation[side][:, 2, 0], -1.0, 1.0))
    most = np.where(pitch < 0.0, *STEEPEST)
    beyond = np.maximum(np.abs(pitch) - FLAT, 0.0)
    eased = np.sign(pitch) * beyond**3 / (beyond**2 + EASED**2)
    return most * np.tanh(pitch / most), most * np.tanh(eased / most)


def _from_under_ankle(robot: Robot, side: str) -> Array:
    """Return the sole frame's place (3,) from the ground under the ankle, in its axes [m]."""
    snapshot = robot.snapshot(robot.postures[STANDING])
    ankle = str(robot.model.names[leg_joints(robot, side)[-1]])
    place, R = snapshot.placement(robot.feet[side].frame)
    arm = R.T @ (place - snapshot.position(ankle))
    return np.array((arm[0], arm[1], 0.0))


def _flatness(source: HumanFrames, side: str) -> Array:
    """Return how much a frame counts for where a foot stands (n,): most when level and slow."""
    tilt = 1.0 - source.sole_rotation[side][:, 2, 2]
    speed = np.linalg.norm(np.gradient(source.soles[side][0], source.series.time, axis=0), axis=1)
    return np.exp(-tilt / 0.01 - (speed / 0.2) ** 2) + 1e-9


def _print(place: Array, heading: Array, weight: Array, first: int, end: int) -> Array:
    span = slice(first, end)
    x, y = np.average(place[span, :2], axis=0, weights=weight[span]).tolist()
    return np.array((x, y, np.average(heading[span], weights=weight[span])))


def _outwards(prints: list[Footprint], soles: Mapping[str, Array], gap: float) -> float:
    """Return by how much feet must be set outwards so that none are too near to each other [m].

    Parameters
    ----------
    soles:
        Their corners (k, 2), by side [m].
    gap:
        Between them, and between their widths where one passes the other [m].
    """
    turn = np.linspace(-STEEP, STEEP, 53)  # of lines across both
    width = max(float(np.ptp(sole[:, 1])) for sole in soles.values())
    wider = 0.0
    for a, b, side in _neighbours(prints):
        yaw = 0.5 * (a.pose[2] + b.pose[2])
        across = pitched(yaw + turn, np.zeros_like(turn))[:, :2, 1]
        left, right = (
            one.pose[:2] + soles[one.foot] @ pitched(one.pose[2:], np.zeros(1))[0, :2, :2].T
            for one in (a, b)
        )
        apart = (left @ across.T).min(axis=0) - (right @ across.T).max(axis=0)
        standing = ((gap - apart) / (2.0 * np.cos(turn))).min()
        passing = 0.5 * (gap + width - (a.pose[:2] - b.pose[:2]) @ side)
        wider = max(wider, float(standing), float(passing))
    return wider


def _neighbours(prints: list[Footprint]) -> Iterator[tuple[Footprint, Footprint, Array]]:
    """Yield left and right footprints, at a time or in turn, and the unit vector across (2,)."""
    for a, b in product(prints, prints):
        near = a.first < b.end + 1 and b.first < a.end + 1
        if near and (a.foot, b.foot) == SIDES:
            yaw = 0.5 * (a.pose[2] + b.pose[2])
            yield a, b, np.array((-np.sin(yaw), np.cos(yaw)))


def _moved_out(pose: Array, foot: str, wider: float) -> Array:
    yaw = float(pose[2])
    way = SIGN[foot] * wider * np.array((-np.sin(yaw), np.cos(yaw)))
    return np.array((*(pose[:2] + way), yaw))


def _path(
    source: HumanFrames,
    robot: Robot,
    side: str,
    spread: Array,
    arm: Array,
    prints: list[Footprint],
    wider: float,
) -> FootPath:
    """Return a foot's way over its footprints."""
    under, heading = source.soles[side]
    polygon = robot.feet[side].polygon
    edges = float(polygon[:, 0].min()), float(polygon[:, 0].max())  # rear and front
    free, pitch = _pitches(source, side)
    yaw, swings = heading.copy(), np.ones(len(under), dtype=bool)
    for one in prints:
        swings[one.first : one.end] = False
        yaw[one.first : one.end] = one.pose[2]
    turn = np.column_stack((yaw, pitch))
    _swing(turn, np.column_stack((heading, free)), swings)
    yaw, pitch = turn.T
    R = pitched(yaw, pitch)
    way = under @ spread.T + R @ arm
    way[:, :2] += SIGN[side] * wider * np.column_stack((-np.sin(heading), np.cos(heading)))
    place, origin = way.copy(), way.copy()
    for one in prints:
        span = slice(one.first, one.end)
        place[span] = _rolled(one.pose, R[span], pitch[span], edges)
        origin[span] = *one.pose[:2], 0.0
    _swing(place, way, swings)
    lowest = place[:, 2] + (np.sin(pitch)[:, None] * polygon[:, 0]).min(axis=1)
    for first, end in runs(swings):  # a robot's foot may be longer than a human's, scaled
        u = (np.arange(first, end) - first + 1.0) / (end - first + 1.0)
        rise, sink = (u if first > 0 else 1.0), (1.0 - u if end < len(swings) else 1.0)
        lift = minimum_jerk(np.minimum(2.0 * np.minimum(rise, sink), np.ones(end - first)))
        lack = CLEARANCE * float(spread[2, 2]) - lowest[first:end] / np.maximum(lift, LOW)
        place[first:end, 2] += max(0.0, float(lack.max())) * lift
    corners = place[:, None] + touching(polygon, pitch) @ np.swapaxes(R, 1, 2)
    shift = (place - under @ spread.T - R @ arm)[:, :2]
    return FootPath(place, yaw, pitch, ~swings, corners, shift, origin)


def _swing(values: Array, way: Array, swings: Bools) -> None:
    """Set values (n, k) in swings to ``way``, bent so that they leave and meet the ground smoothly.

    What both differ by there, its rate and its acceleration go over into each other on a quintic.
    """
    off = values - way
    count = len(values)
    for first, end in runs(swings):
        T = end - first + 1.0
        ends = list[tuple[Array, Array] | None]()
        for at, inner in ((first - 1, -1), (end, 1)):
            if not 0 <= at < count:
                ends.append(None)
                continue
            near = [off[min(max(at + inner * m, 0), count - 1)] for m in range(3)]
            if min(at, count - 1 - at) < 2 or swings[[at + inner, at + 2 * inner]].any():
                near = [near[0]] * 3
            rate = inner * (-1.5 * near[0] + 2.0 * near[1] - 0.5 * near[2])
            ends.append((near[0], T * rate))
        known = [one for one in ends if one is not None]
        if not known:
            values[first:end] = way[first:end]
            continue
        still = known[0][0], 0.0 * known[0][1]  # beyond the recording's ends it stays so
        start, goal = (still if one is None else one for one in ends)
        u = ((np.arange(first, end) - first + 1.0) / T)[:, None]
        s = minimum_jerk(u)
        # Hermite's quintics for a rate at one end, with no acceleration at either.
        leave = u - 6.0 * u**3 + 8.0 * u**4 - 3.0 * u**5
        meet = -4.0 * u**3 + 7.0 * u**4 - 3.0 * u**5
        bend = (1.0 - s) * start[0] + s * goal[0] + leave * start[1] + meet * goal[1]
        values[first:end] = way[first:end] + bend


def _rolled(pose: Array, R: Array, pitch: Array, edges: tuple[float, float]) -> Array:
    """Return the places (m, 3) of a sole frame that rolls over an edge of its footprint."""
    x, y, yaw = pose.tolist()
    ahead = np.array((np.cos(yaw), np.sin(yaw), 0.0))
    edge = np.where(pitch < 0.0, edges[1], edges[0])[:, None]
    return np.asarray(np.array((x, y, 0.0)) + edge * (ahead - R[:, :, 0]))


def touching(polygon: Array, pitch: Array) -> Array:
    """Return the corners of a sole that touch level ground at these pitches (n, k, 3), its axes."""
    flat = np.column_stack((polygon, np.zeros(len(polygon))))
    x, ordered = polygon[:, 0], np.sort(polygon[:, 0])
    found = np.tile(flat, (len(pitch), 1, 1))
    for where, own in (
        (pitch < -LEVEL, x >= min(ordered[-2], ordered[-1] - EDGE)),
        (pitch > LEVEL, x <= max(ordered[1], ordered[0] + EDGE)),
    ):
        only = flat[own]
        found[where] = only[np.minimum(np.arange(len(flat)), len(only) - 1)]
    return found
