"""The whole motion at once: all frames' rows and the jerk of all joints as one least squares.

A tick sees one frame, so what it does jitters where contacts, limits and margins come and go, and
angular momentum that it takes now it has to give back later. Here displacements of all frames,
x = (d_0, ..., d_n-1) in the robot's tangent space, minimise

    sum_k |W (e_k + J_k d_k)|^2                                    tasks; contacts weigh most
        + |w u_k|^2 + |w' (u_k+1 - u_k)/dt|^2                      momentum and its rate
        + |mu ((v_k+2 - 2 v_k+1 + v_k)/dt^2 + (D^3 d)_k/dt^3)|^2   jerk,

by the very rows of the tasks (Gauss-Newton), u_k = A_k (v_k + (d_k+1 - d_k)/dt) - h_k. The rate of
momentum is the ground's force: a CoM that is followed to a millimetre but trembles at 10 Hz puts
the CoP outside the feet. Only neighbours within three frames are coupled, so the normal equations
are banded: linear in the number of frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded
from scipy.spatial.transform import Rotation

from wbc.constraints.collision import SelfCollision
from wbc.errors import SolverError
from wbc.gait.legs import SIDES
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.postures import STANDING
from wbc.spatial import COLUMNS, ROWS, skews, vech
from wbc.validate import Array

# By a leg's length and per rad: of contacts, of limits, and of margins that would be broken.
EXACT, LIMITED, APART = 1e4, 200.0, 200.0
PRESSED = 3.0  # by a leg's length: of where the momentum's rate puts the CoP
# Of speeds by their limits, and of what is beyond this part of them.
UNHURRIED, HURRIED, FASTEST = 0.3, 10.0, 0.9
# Likewise of accelerations by what motors give: arms hang on them as well.
UNFORCED, FORCED, STRONGEST = 0.2, 5.0, 0.8
SECOND = (1.0, -2.0, 1.0)
SPAN = 3  # frames that are coupled
# What a task of weight 1 passes: it is cut off at this frequency, and others at that times the
# third root of their weights.
CUTOFF = 5.0  # Hz
NEAR, KEPT = 8e-3, 2e-3  # m: bodies so near to their margin are looked at, and kept so far off
INSIDE = 2e-3  # rad: from the limits
ACTIVE_SETS = 4  # of joints at their limits, that are tried in a round
DAMPED = 1.0  # weight of displacements (Levenberg and Marquardt): rows are of first order only
LARGEST = 0.3  # rad or m: of one frame in one round
THIRD = np.array((-1.0, 3.0, -3.0, 1.0))


class _Gathered(NamedTuple):
    """What rows are made of, of n frames and f frames of the robot; world axes."""

    place: Array  # (n, f, 3)
    rotation: Array  # (n, f, 3, 3)
    jacobian: Array  # (n, f, 6, nv)
    com: Array  # (n, 3)
    com_jacobian: Array  # (n, 3, nv)
    inertia: Array  # vech (n, 6)
    inertia_jacobian: Array  # (n, 6, nv)
    maps: Array  # centroidal (n, 6, nv)
    joints: Array  # (n, nv - 6)
    near: list[tuple[int, Array, Array]]  # of pairs of bodies: frame, weighted rows, errors


class WholeMotion:
    """The least-squares problem of a motion.

    Parameters
    ----------
    tasks:
        With the targets.
    collision:
        Margins between bodies that are kept.
    leg:
        Length of the legs [m].

    Attributes
    ----------
    violation:
        How far feet on the ground, limits and margins were off at most before the last round
        [m or rad].
    speed:
        Of the fastest joint then, by its limit.
    moved:
        How far the last round moved anything [m or rad].
    damping:
        Weight of displacements.
    """

    violation: float
    speed: float
    moved: float
    damping: float

    def __init__(
        self,
        tasks: FrameTasks,
        collision: SelfCollision | None,
        leg: float,
    ) -> None:
        self.tasks, self.collision, self.leg = tasks, collision, leg
        limits = tasks.robot.limits
        self.lower, self.upper = limits.lower + INSIDE, limits.upper - INSIDE
        w = EXACT * np.array([1.0 / leg] * 3 + [1.0] * 3)
        self._exact = w
        arms = [task.frame for pair in tasks.arms.values() for task in pair]
        soles = [tasks.robot.feet[side].frame for side in SIDES]
        self._frames = (*tasks.turns, *arms, *soles)
        self.violation = self.speed = self.moved = np.inf
        self.damping = DAMPED
        self.able = able_accelerations(tasks.robot)

    def improved(self, q: Array) -> Array:
        """Return configurations (n, nq) after one round."""
        robot, dt = self.tasks.robot, self.tasks.targets.dt
        count, nv = len(q), robot.nv
        v = velocities(robot, q, dt)
        blocks = np.zeros((count, SPAN + 1, nv, nv))  # (k, m): of d_k and d_(k+m)
        slope = np.zeros((count, nv))
        self.violation = 0.0
        self.speed = float((np.abs(v[:, BASE_NV:]) / robot.limits.velocity).max())
        found = self._gathered(q, v)
        for J, e in self._rows(found):
            _add(blocks, slope, (J,), e)
        self._posture(found.joints, blocks, slope)
        for k, J, e in found.near:
            blocks[k, 0] += J.T @ J
            slope[k] += J.T @ e
        self._momentum(found.maps[:-1], v, blocks, slope)
        self._jerk(v, blocks, slope)
        self._speed(v, blocks, slope)
        self._effort(v, blocks, slope)
        every = np.arange(nv)
        blocks[:, 0, every, every] += self.damping**2
        step = self._within_limits(found.joints, blocks, slope)
        np.clip(step, -LARGEST, LARGEST, out=step)
        self.moved = float(np.abs(step).max())
        return np.array([robot.integrate(one, d, 1.0) for one, d in zip(q, step, strict=True)])

    def judge(self, q: Array) -> None:
        """Set what configurations (n, nq) violate."""
        self.violation = 0.0
        found = self._gathered(q, velocities(self.tasks.robot, q, self.tasks.targets.dt))
        for _ in self._rows(found):
            pass
        self._violated(np.maximum(self.lower - found.joints, found.joints - self.upper) - INSIDE)

    def _gathered(self, q: Array, v: Array) -> _Gathered:
        """Return what rows are made of, of all frames."""
        robot, count, nv = self.tasks.robot, len(q), self.tasks.robot.nv
        frames = self._frames
        found = _Gathered(
            place=np.empty((count, len(frames), 3)),
            rotation=np.empty((count, len(frames), 3, 3)),
            jacobian=np.empty((count, len(frames), 6, nv)),
            com=np.empty((count, 3)),
            com_jacobian=np.empty((count, 3, nv)),
            inertia=np.empty((count, 6)),
            inertia_jacobian=np.empty((count, 6, nv)),
            maps=np.empty((count, 6, nv)),
            joints=np.empty((count, nv - BASE_NV)),
            near=[],
        )
        for k in range(count):
            snapshot = robot.snapshot(q[k], v[min(k, count - 2)])
            for n, frame in enumerate(frames):
                found.place[k, n], found.rotation[k, n] = snapshot.placement(frame)
                found.jacobian[k, n] = snapshot.jacobian(frame)
            found.com[k], found.com_jacobian[k] = snapshot.com, snapshot.com_jacobian
            found.maps[k], found.joints[k] = snapshot.centroidal_map, snapshot.joint_positions
            found.inertia[k] = vech(snapshot.inertia)
            found.inertia_jacobian[k] = snapshot.inertia_jacobian
            if self.collision is None:
                continue
            pairs = self.collision.distances(snapshot)
            near = np.flatnonzero(pairs.clearance < NEAR)
            if near.size:
                w = APART / self.leg
                e = w * np.minimum(pairs.clearance[near] - KEPT, 0.0)
                found.near.append((k, w * pairs.jacobian[near], e))
                self._violated(-pairs.clearance[near])
        return found

    def _rows(self, found: _Gathered) -> Iterator[tuple[Array, Array]]:
        """Yield weighted rows (n, r, nv) and errors (n, r) of the tasks, frame by frame."""
        tasks, targets = self.tasks, self.tasks.targets
        w = tasks.com.weight
        yield w[:, None] * found.com_jacobian, w * (found.com - targets.com)
        number = 0
        for frame, task in tasks.turns.items():
            # With the error e of a rotation in world axes Jlog(e) e = e: the plain Jacobian does.
            e = _rotation_vectors(found.rotation[:, number], targets.rotation[frame])
            yield task.weight[:, None] * found.jacobian[:, number, 3:], task.weight * e
            number += 1
        for side, pair in tasks.arms.items():
            for n, arm in enumerate(pair):
                way = found.rotation[:, number] @ arm.axis
                J = -skews(way) @ found.jacobian[:, number, 3:]
                yield arm.weight[:, None] * J, arm.weight * (way - targets.arms[side][:, n])
                number += 1
        for side in SIDES:
            path = targets.feet.paths[side]
            turn = _rotation_vectors(found.rotation[:, number], path.rotation)
            e = np.hstack((found.place[:, number] - path.place, turn))
            if path.down.any():
                self._violated(np.abs(e[path.down]))
            weight = np.where(path.down[:, None], self._exact, tasks.foot_weight)
            yield weight[..., None] * found.jacobian[:, number], weight * e
            number += 1
        if tasks.ellipsoids is not None:
            w = tasks.inertia.weight[:, None] * tasks.inertia.selection
            wanted = tasks.ellipsoids[:, ROWS, COLUMNS]
            yield w @ found.inertia_jacobian, (found.inertia - wanted) @ w.T

    def _posture(self, joints: Array, blocks: Array, slope: Array) -> None:
        """Add the posture."""
        wanted = self.tasks.robot.limits.joint_positions(self.tasks.posture.target)
        columns = BASE_NV + np.arange(joints.shape[1])
        w = self.tasks.posture.weight
        slope[:, columns] += w**2 * (joints - wanted)
        blocks[:, 0, columns, columns] += w**2

    def _within_limits(self, joints: Array, blocks: Array, slope: Array) -> Array:
        """Return displacements (n, nv) that lead past no limit, nearly.

        Joints that would be past one are held there by rows of high weight, and let go again where
        they are pulled inside.
        """
        columns = BASE_NV + np.arange(joints.shape[1])
        past = np.maximum(self.lower - joints, joints - self.upper)
        self._violated(past - INSIDE)
        held = np.zeros(joints.shape, dtype=bool)
        for _ in range(ACTIVE_SETS):
            room = np.where(joints + 0.0 > 0.5 * (self.lower + self.upper), self.upper, self.lower)
            room = np.where(np.isfinite(room), room, joints)
            own, pull = blocks.copy(), slope.copy()
            own[:, 0, columns, columns] += LIMITED**2 * held
            pull[:, columns] += LIMITED**2 * held * (joints - room)
            step = _solved(own, pull)
            goal = joints + step[:, columns]
            out = (goal > self.upper) | (goal < self.lower)
            if np.array_equal(out, held):
                break
            held = out
        return step

    def _violated(self, by: Array) -> None:
        self.violation = max(self.violation, float(by.max()))

    def _momentum(self, maps: Array, v: Array, blocks: Array, slope: Array) -> None:
        """Add the rows of the momentum between frames, and of its rate."""
        tasks, targets = self.tasks, self.tasks.targets
        dt, robot, k = targets.dt, tasks.robot, targets.angular_momentum
        wanted = np.hstack((robot.mass * np.diff(targets.com, axis=0) / dt, 0.5 * (k[:-1] + k[1:])))
        off = np.einsum("kij,kj->ki", maps, v) - wanted
        w = np.concatenate((np.zeros(3), tasks.momentum.weight))
        A = w[:, None] * maps / dt
        _add(blocks, slope, (-A, A), w * off)
        # By how far the CoP is moved, in legs' lengths.
        height = float(np.mean(targets.com[:, 2]))
        w = PRESSED / (robot.weight * self.leg) * np.array([height] * 3 + [1.0] * 3)
        A = w[:, None] * maps / dt**2
        _add(blocks, slope, (A[:-1], -A[:-1] - A[1:], A[1:]), w * np.diff(off, axis=0) / dt)

    def _jerk(self, v: Array, blocks: Array, slope: Array) -> None:
        """Add the jerk of all coordinates; lengths of the base by the legs'."""
        dt, nv = self.tasks.targets.dt, v.shape[1]
        mu = np.full(nv, (2.0 * np.pi * CUTOFF) ** -3.0)
        mu[:3] /= self.leg
        jerk = mu**2 * np.diff(v, 2, axis=0) / dt**2
        last = len(slope) - SPAN
        both = np.arange(nv)
        for i in range(SPAN + 1):
            slope[i : last + i] += THIRD[i] / dt**3 * jerk
            for j in range(i, SPAN + 1):
                own = mu**2 * THIRD[i] * THIRD[j] / dt**6
                blocks[i : last + i, j - i, both, both] += own

    def _speed(self, v: Array, blocks: Array, slope: Array) -> None:
        """Add the speeds of joints by their limits, and firmly what is beyond a part of them."""
        dt, fastest = self.tasks.targets.dt, self.tasks.robot.limits.velocity
        joints = np.arange(BASE_NV, v.shape[1])
        part = v[:, BASE_NV:] / fastest
        beyond = np.abs(part) > FASTEST
        w = np.where(beyond, HURRIED, UNHURRIED)
        off = np.where(beyond, part - np.sign(part) * FASTEST, part)
        by = 1.0 / (dt * fastest)
        slope[:-1, joints] -= w**2 * off * by
        slope[1:, joints] += w**2 * off * by
        square = w**2 * by**2
        blocks[:-1, 0, joints, joints] += square
        blocks[1:, 0, joints, joints] += square
        blocks[:-1, 1, joints, joints] -= square

    def _effort(self, v: Array, blocks: Array, slope: Array) -> None:
        """Add accelerations of joints by what their motors can, and firmly what is beyond."""
        dt = self.tasks.targets.dt
        part = np.diff(v[:, BASE_NV:], axis=0) / dt / self.able
        beyond = np.abs(part) > STRONGEST
        w = np.where(beyond, FORCED, UNFORCED)
        off = np.where(beyond, part - np.sign(part) * STRONGEST, part)
        by = 1.0 / (dt**2 * self.able)
        joints, count = np.arange(BASE_NV, v.shape[1]), len(off)
        for i in range(3):
            slope[i : count + i, joints] += w**2 * off * SECOND[i] * by
            for j in range(i, 3):
                square = w**2 * SECOND[i] * SECOND[j] * by**2
                blocks[i : count + i, j - i, joints, joints] += square


def able_accelerations(robot: Robot) -> Array:
    """Return the accelerations (nv - 6,) of single joints that no motor is too weak for.

    A joint that speeds up what hangs on it asks M_ij a_j of every motor i: arms of their elbows,
    too. By the standing posture; infinite where no motor has an effort.
    """
    M = np.abs(robot.snapshot(robot.postures[STANDING]).mass_matrix[BASE_NV:, BASE_NV:])
    return np.asarray((robot.limits.effort[:, None] / np.maximum(M, 1e-12)).min(axis=0))


def _add(blocks: Array, slope: Array, parts: tuple[Array, ...], off: Array) -> None:
    """Add rows (m, r, nv) on as many frames in a row, whose errors are ``off`` (m, r)."""
    count = len(off)
    for i, A in enumerate(parts):
        slope[i : count + i] += np.einsum("kij,ki->kj", A, off)
        for j in range(i, len(parts)):
            blocks[i : count + i, j - i] += np.swapaxes(A, 1, 2) @ parts[j]


def _rotation_vectors(actual: Array, wanted: Array) -> Array:
    """Return the rotations (n, 3) [rad], world axes, from wanted to actual (n, 3, 3)."""
    return np.asarray(Rotation.from_matrix(actual @ np.swapaxes(wanted, 1, 2)).as_rotvec())


def velocities(robot: Robot, q: Array, dt: float) -> Array:
    """Return the velocities from each frame to the next (n - 1, nv)."""
    steps = [robot.difference(a, b) for a, b in pairwise(q)]
    return np.array(steps) / dt


def _solved(blocks: Array, slope: Array) -> Array:
    """Return displacements (n, nv) of banded normal equations."""
    count, _, nv, _ = blocks.shape
    size, width = count * nv, (SPAN + 1) * nv - 1
    band = np.zeros((width + 1, size))  # lower: band[row - column, column]
    i, j = np.indices((nv, nv))
    for m in range(SPAN + 1):
        row = m * nv + i - j  # d_(k+m), i below d_k, j: the transposed block
        use = row >= 0
        for_rows, own_i, own_j = row[use], i[use], j[use]
        columns = nv * np.arange(count - m)[:, None] + own_j
        band[for_rows[None, :], columns] = blocks[: count - m, m][:, own_j, own_i]
    try:
        found = solveh_banded(band, -slope.ravel(), lower=True, overwrite_ab=True)
    except LinAlgError as failure:
        raise SolverError(f"retarget: the motion's least squares failed: {failure}") from failure
    return np.asarray(found.reshape(count, nv))
