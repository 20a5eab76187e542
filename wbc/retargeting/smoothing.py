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

from itertools import pairwise

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from wbc.constraints.collision import SelfCollision
from wbc.errors import SolverError
from wbc.gait.legs import SIDES
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.tasks import Task
from wbc.validate import Array

# By a leg's length and per rad: of contacts, of limits, and of margins that would be broken.
EXACT, LIMITED, APART = 1e4, 200.0, 200.0
PRESSED = 3.0  # by a leg's length: of where the momentum's rate puts the CoP
# Of speeds by their limits, and of what is beyond this part of them.
UNHURRIED, HURRIED, FASTEST = 0.05, 3.0, 0.9
SPAN = 3  # frames that are coupled
# What a task of weight 1 passes: it is cut off at this frequency, and others at that times the
# third root of their weights.
CUTOFF = 5.0  # Hz
NEAR, KEPT = 8e-3, 2e-3  # m: bodies so near to their margin are looked at, and kept so far off
INSIDE = 2e-3  # rad: from the limits
DAMPED = 1.0  # weight of displacements (Levenberg and Marquardt): rows are of first order only
LARGEST = 0.3  # rad or m: of one frame in one round
THIRD = np.array((-1.0, 3.0, -3.0, 1.0))


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
    """

    violation: float

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
        self.violation = np.inf

    def improved(self, q: Array) -> Array:
        """Return configurations (n, nq) after one round."""
        robot, dt = self.tasks.robot, self.tasks.targets.dt
        count, nv = len(q), robot.nv
        v = velocities(robot, q, dt)
        blocks = np.zeros((count, SPAN + 1, nv, nv))  # (k, m): of d_k and d_(k+m)
        self.violation = 0.0
        slope, maps = np.zeros((count, nv)), np.empty((count - 1, 6, nv))
        for k in range(count):
            snapshot = robot.snapshot(q[k], v[min(k, count - 2)])
            self.tasks.aim(k)
            J, e = self._rows(snapshot, k)
            blocks[k, 0] += J.T @ J
            slope[k] += J.T @ e
            if k < count - 1:
                maps[k] = snapshot.centroidal_map
        self._momentum(maps, v, blocks, slope)
        self._jerk(v, blocks, slope)
        self._speed(v, blocks, slope)
        every = np.arange(nv)
        blocks[:, 0, every, every] += DAMPED**2
        step = _solved(blocks, slope)
        np.clip(step, -LARGEST, LARGEST, out=step)
        return np.array([robot.integrate(one, d, 1.0) for one, d in zip(q, step, strict=True)])

    def _rows(self, snapshot: Snapshot, k: int) -> tuple[Array, Array]:
        """Return weighted rows (m, nv) and errors (m,) of one frame."""
        tasks, down = self.tasks, self.tasks.targets.down[k]
        rows, errors = list[Array](), list[Array]()

        def add(task: Task, weight: Array) -> None:
            found = task.residual(snapshot)
            rows.append(weight[:, None] * found.jacobian)
            errors.append(weight * found.error)

        for task in tasks.lasting:
            add(task, task.weight)
        if tasks.ellipsoids is not None:
            add(tasks.inertia, tasks.inertia.weight)
        for n, side in enumerate(SIDES):
            add(tasks.feet[side], self._exact if down[n] else tasks.foot_weight)
            if down[n]:
                self._violated(np.abs(errors[-1] / self._exact))
        joints = snapshot.joint_positions
        over = np.maximum(joints - self.upper, 0.0) + np.minimum(joints - self.lower, 0.0)
        out = np.flatnonzero(over)
        if out.size:
            J = np.zeros((out.size, snapshot.robot.nv))
            J[np.arange(out.size), BASE_NV + out] = LIMITED
            rows.append(J)
            errors.append(LIMITED * over[out])
            self._violated(np.abs(over[out]) - INSIDE)
        if self.collision is not None:
            found = self.collision.distances(snapshot)
            near = np.flatnonzero(found.clearance < NEAR)
            if near.size:
                w = APART / self.leg
                rows.append(w * found.jacobian[near])
                errors.append(w * np.minimum(found.clearance[near] - KEPT, 0.0))
                self._violated(-found.clearance[near])
        return np.concatenate(rows), np.concatenate(errors)

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


def _add(blocks: Array, slope: Array, parts: tuple[Array, ...], off: Array) -> None:
    """Add rows (m, r, nv) on as many frames in a row, whose errors are ``off`` (m, r)."""
    count = len(off)
    for i, A in enumerate(parts):
        slope[i : count + i] += np.einsum("kij,ki->kj", A, off)
        for j in range(i, len(parts)):
            blocks[i : count + i, j - i] += np.swapaxes(A, 1, 2) @ parts[j]


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
