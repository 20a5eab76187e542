"""What is hard, of all frames at once, by displacements that are small and smooth.

Where a motion was solved with its tasks, these pull at limits, margins and feet: weights make of
that a compromise. Here nothing pulls: displacements d of all frames minimise

    sum_k |w h_k(d)|^2 + |mu (D^3 d)_k/dt^3|^2 + lambda^2 |d_k|^2

and, by what tasks weigh, what they change of CoM and momentum; h are the feet on the ground, what
passes a limit, a margin (by the shapes of the robot's files), a speed or an acceleration of a
joint. What can be kept is met to rounding in a few rounds (Levenberg and Marquardt's).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import SelfCollision
from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.retargeting.footsteps import FootPaths, Footprint, pitched
from wbc.retargeting.normal_equations import NormalEquations, padded
from wbc.retargeting.smoothing import WholeMotion, seen_from
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import StateSeries, sole_series
from wbc.rotations import headings
from wbc.validate import Array

ROUNDS = 14
# By a leg's length and per rad: of feet, limits and margins; times what whole motions weigh
# speeds and accelerations beyond theirs; times their jerk.
FIRM, FIRMER, SMOOTH = 2e3, 10.0, 10.0
BEGUN, LESS, MORE = 3.0, 0.4, 4.0  # weight of displacements, and how it changes
INSIDE = 1e-3  # rad: so far inside limits joints are held
CLEAR, GRAZING = 2e-4, 3e-4  # m: margins that were broken are kept so well, and nearer ones kept
SUNK = 1e-3  # m: so deep in the ground a sole in the air may be
EXACT = 2e-4  # m or rad: so near to where they stand feet are
HASTY = 0.1  # m or rad: as bad as joints that would have to be twice as fast or strong
# Who is so far off (``_Problem.cost``) after so many rounds was never seen to get there.
FEW, HOPELESS = 6, 1e5
SAME, TOLD = 1e-6, 5e-3  # m or rad: footprints that moved so far are others, and that is told


class Mended(NamedTuple):
    """Configurations (n, nq), and what they still lack of what is hard.

    Attributes
    ----------
    feet, limits, margins:
        At most [m or rad].
    speed, force:
        Largest by what joints can.
    """

    q: Array
    feet: float
    limits: float
    margins: float
    speed: float
    force: float

    @property
    def lack(self) -> float:
        """How much of what is hard is not kept [m or rad]; 0: nothing."""
        hasty = max(self.speed, self.force, 1.0) - 1.0
        return max(self.feet - EXACT, 0.0) + self.limits + self.margins + HASTY * hasty

    @property
    def kept(self) -> bool:
        """Whether all that is hard is kept."""
        return self.lack <= 0.0


def mended(motion: WholeMotion, q: Array, *, patient: bool = True) -> Mended:
    """Return configurations near to some (n, nq) that keep what is hard, or come nearest to it.

    Who is not patient wants those only that keep it: what is hopeless is given up early.
    """
    now = best = _Problem(motion, q)
    weight = LESS * BEGUN
    for number in range(ROUNDS):
        if now.found.kept:
            return now.found
        if not patient and number >= FEW and best.cost > HOPELESS:
            break
        now = _Problem(motion, best.further(weight))
        if now.cost < best.cost:
            best, weight = now, LESS * weight
        else:
            weight *= MORE
    return now.found if now.found.kept else best.found


class _Problem:
    """First-order rows of what is hard about configurations (n, nq)."""

    def __init__(self, motion: WholeMotion, q: Array) -> None:
        self.motion, tasks = motion, motion.tasks
        states = motion.states(q)
        v = states.v[:-1]
        limits = tasks.robot.limits
        joints = limits.joint_positions(q)
        past = limits.past(joints)
        self.normal = NormalEquations(len(q), tasks.robot.nv)
        self.feet, self.margins, self.cost = 0.0, 0.0, 0.0
        self._feet(states)
        self._near(q, states)
        self._ground(states)
        self.cost += motion.motors(v, self.normal, FIRMER)
        motion.jerk(0.0 * v, self.normal, SMOOTH)
        # What is balanced stays so as far as it can.
        self._add(
            tasks.com.weight[:, None] * states.part("com_jacobian", 3, -1), np.zeros((len(q), 3))
        )
        motion.momentum(states, self.normal, stays=True)
        # Joints near to their limits stay inside; those that were solved there are let go again.
        self.joints = joints
        self.lower = np.minimum(limits.lower + INSIDE, limits.upper)
        self.upper = np.maximum(limits.upper - INSIDE, limits.lower)
        self.cost += float(np.square(FIRM * np.maximum(past, 0.0)).sum())
        self.found = Mended(
            q, self.feet, max(float(past.max()), 0.0), self.margins, *motion.haste(v)
        )

    def _feet(self, states: StateSeries) -> None:
        """Add the feet on the ground: level there, and nowhere to go while they stand.

        Where they stand is where they are: a step may be set a little aside. What must not change
        is the displacement from the footprint, which a foot that rolls over an edge keeps.
        """
        w = FIRM / self.motion.leg
        for side in SIDES:
            path = self.motion.tasks.targets.feet.paths[side]
            e, J = self.motion.displaced(states, side)
            on = path.down[:, None]
            upright = np.array((w, FIRM, FIRM))
            if side in self.motion.tasks.targets.feet.lines:
                e, J = seen_from(pitched(path.heading, 0.0 * path.heading), e, J)
                e[:, 3], J[:, 3] = 0.0, 0.0
            off = np.where(on, upright * e[:, 2:5], 0.0)
            self._add(np.where(on[..., None], upright[:, None] * J[:, 2:5], 0.0), off)
            stays = (path.down[1:] & path.down[:-1])[:, None]
            level, weight = [0, 1, 5], np.array((w, w, FIRM))
            slide = np.where(stays, weight * np.diff(e[:, level], axis=0), 0.0)
            rows = weight[:, None] * J[:, level]
            before, after = (np.where(stays[..., None], one, 0.0) for one in (rows[:-1], rows[1:]))
            self.normal.add(-before, after, off=slide)
            self.cost += float(np.square(slide).sum())
            self.feet = max(self.feet, float(np.abs(off / upright).max()))
            for first, end in runs(path.down):
                way = e[first:end, level]
                self.feet = max(self.feet, float(np.ptp(way, axis=0).max()))

    def _near(self, q: Array, states: StateSeries) -> None:
        """Add bodies near each other: those too near part, and none comes nearer."""
        collision = self.motion.collision
        if collision is None:
            return
        frames, _, clearance, J = too_near(collision, q, states, GRAZING)
        if not frames.size:
            return
        self.margins = max(float(-clearance.min()), 0.0)
        off = np.where(clearance < 0.0, clearance - CLEAR, 0.0)
        w = FIRM / self.motion.leg
        self._add(*padded(frames, w * J, w * off, len(q)))

    def _ground(self, states: StateSeries) -> None:
        """Add soles in the air that are in the ground, and let none get there."""
        w = FIRM / self.motion.leg
        for rows, height in self.motion.lowest(states, GRAZING):
            off = np.where(height < 0.0, height - CLEAR, 0.0)
            self._add(w * rows[:, None], w * off[:, None])
            self.margins = max(self.margins, float(-height.min()) - SUNK)

    def _add(self, rows: Array, off: Array) -> None:
        self.normal.add(rows, off=off)
        self.cost += float(np.square(off).sum())

    def further(self, weight: float) -> Array:
        """Return configurations (n, nq) further on, displacements weighing so much."""
        joints, held = self.joints, np.zeros(self.joints.shape, dtype=bool)
        more, pull = np.full(self.normal.slope.shape, weight**2), np.zeros(self.normal.slope.shape)
        for _ in range(3):
            room = np.where(joints - self.lower > self.upper - joints, self.upper, self.lower)
            room = np.where(np.isfinite(room), room, joints)
            more[:, BASE_NV:] = weight**2 + FIRM**2 * held
            pull[:, BASE_NV:] = FIRM**2 * held * (joints - room)
            step = self.normal.solved(more, pull)
            goal = joints + step[:, BASE_NV:]
            out: NDArray[np.bool_] = held | (goal > self.upper) | (goal < self.lower)
            if np.array_equal(out, held):
                break
            held = out
        return self.motion.further(self.found.q, step)


def too_near(
    collision: SelfCollision, q: Array, states: StateSeries, limit: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Return pairs as :meth:`~wbc.SelfCollision.near` does, by the shapes of the robot's files.

    Fitted ones contain them and are measured in no time: only what is too near by them is looked
    at. Of a pair that is not too near by its raw shapes the clearance is 0.
    """
    frames, pairs, clearance, J = collision.near(q, states, limit)
    seen = np.flatnonzero(clearance < 0.0)
    if seen.size:
        numbers = np.split(pairs[seen], np.flatnonzero(np.diff(frames[seen])) + 1)
        found = np.concatenate(
            [
                collision.model.raw.too_near(q[k], own.tolist(), collision.margins)
                for k, own in zip(np.unique(frames[seen]), numbers, strict=True)
            ]
        )
        clearance[seen] = -found[:, 0]
        told = found[:, 1:4].any(axis=1)
        seen, found = seen[told], found[told]
        both = np.column_stack((frames[seen], pairs[seen]))
        J[seen] = collision.model.rows_of(states, both, found)
    return frames, pairs, clearance, J


def resettled(feet: FootPaths, robot: Robot, q: Array) -> tuple[FootPaths, list[str]]:
    """Return ways of the feet with footprints where a robot has them (n, nq), and notes."""
    soles, prints, notes = sole_series(robot, q), list[Footprint](), list[str]()
    paths = dict(feet.paths)
    for one in feet.prints:
        path, T = paths[one.foot], soles[one.foot][one.first : one.end]
        span = slice(one.first, one.end)
        turns = T[:, :3, :3] @ np.swapaxes(path.rotation[span], 1, 2)
        arm = (turns @ (path.place - path.origin)[span][..., None])[..., 0]
        turn = float(np.mean(headings(turns)))
        move = np.mean(T[:, :2, 3] - arm[:, :2] - path.origin[span, :2], axis=0)
        far = float(np.linalg.norm(move))
        if max(far, abs(turn)) < SAME:
            prints.append(one)
            continue
        prints.append(replace(one, pose=one.pose + [*move, turn]))
        paths[one.foot] = path.set_aside(span, move, turn)
        if far > TOLD or abs(turn) > TOLD:
            notes.append(
                f"the {one.foot} foot stands {1e3 * far:.0f} mm and {np.degrees(turn):.1f} degrees"
                f" aside from frame {one.first} to {one.end - 1}: the robot reaches no nearer"
            )
    for side in sorted(feet.lines):
        tilt = float(np.abs(np.arcsin(soles[side][paths[side].down, 2, 1])).max(initial=0.0))
        notes.append(
            f"the {side} leg cannot roll its sole: that stands along its length only, and is tilted"
            f" aside by up to {np.degrees(tilt):.1f} degrees"
        )
    return replace(feet, paths=paths, prints=tuple(prints)), notes
