"""The whole motion at once: all frames' rows and the jerk of all joints as one least squares.

A tick sees one frame, so what it does jitters where contacts, limits and margins come and go, and
angular momentum that it takes now it has to give back later. Here displacements of all frames,
x = (d_0, ..., d_n-1) in the robot's tangent space, minimise

    sum_k |W (e_k + J_k d_k)|^2                                    tasks; contacts weigh most
        + |w u_k|^2 + |w' (u_k+1 - u_k)/dt|^2                      momentum and its rate
        + |mu ((v_k+2 - 2 v_k+1 + v_k)/dt^2 + (D^3 d)_k/dt^3)|^2   jerk,

by the very rows of the tasks (Gauss-Newton), u_k = A_k (v_k + (d_k+1 - d_k)/dt) + (dA_k/dq d_k) v_k
- h_k. The rate of momentum is the ground's force: a CoM that is followed to a millimetre but
trembles at 10 Hz puts the CoP outside the feet. Only neighbours within three frames are coupled, so
the normal equations are banded: linear in the number of frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.constraints.collision import SelfCollision
from wbc.gait.legs import SIDES
from wbc.retargeting.normal_equations import NormalEquations, padded
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.postures import STANDING
from wbc.robot.series import StateSeries, state_series, velocities
from wbc.spatial import COLUMNS, ROWS, skews, twist_products
from wbc.validate import Array

# By a leg's length and per rad: of contacts, of limits, and of margins that would be broken.
EXACT, LIMITED, APART = 1e4, 200.0, 200.0
PRESSED = 3.0  # by a leg's length: of where the momentum's rate puts the CoP
# Of speeds by their limits, and of what is beyond this part of them.
UNHURRIED, HURRIED, FASTEST = 0.3, 10.0, 0.9
# Likewise of accelerations by what motors give: arms hang on them as well.
UNFORCED, FORCED, STRONGEST = 0.2, 5.0, 0.8
NEARLY = 0.97  # part of both, where only what is beyond counts
FIRST, SECOND, THIRD = (-1.0, 1.0), (1.0, -2.0, 1.0), (-1.0, 3.0, -3.0, 1.0)
# What a task of weight 1 passes: it is cut off at this frequency, and others at that times the
# third root of their weights.
CUTOFF = 5.0  # Hz
NEAR, KEPT = 8e-3, 2e-3  # m: bodies so near to their margin are looked at, and kept so far off
INSIDE = 2e-3  # rad: from the limits
ACTIVE_SETS = 2  # of joints at their limits, that are tried in a round
DAMPED = 3.0  # weight of displacements (Levenberg and Marquardt): rows are of first order only
LARGEST = 0.3  # rad or m: of one frame in one round


class Round(NamedTuple):
    """What is known of configurations, and the rows about them to first order.

    Attributes
    ----------
    q, joints:
        (n, nq), (n, nv - 6).
    normal:
        The least squares of the next step.
    violation:
        How far feet on the ground, limits and margins are off at most [m or rad].
    speed, force:
        Of the fastest joint, by its limit; and the largest acceleration by what its motor can.
    cost:
        Sum of squares of tasks and momentum by frame.
    """

    q: Array
    joints: Array
    normal: NormalEquations
    violation: float
    speed: float
    force: float
    cost: float

    @property
    def haste(self) -> float:
        """Of speeds and accelerations what is largest, by what joints and motors can."""
        return max(self.speed, self.force)


class WholeMotion:
    """The least-squares problem of a motion.

    Parameters
    ----------
    tasks:
        With the targets.
    collision:
        Margins between bodies that are kept.

    Attributes
    ----------
    leg:
        Length of the legs [m].
    damping:
        Weight of displacements.
    """

    damping: float

    def __init__(self, tasks: FrameTasks, collision: SelfCollision | None) -> None:
        self.tasks, self.collision, self.leg = tasks, collision, tasks.legs.length
        limits = tasks.robot.limits
        self.lower, self.upper = limits.lower + INSIDE, limits.upper - INSIDE
        w = EXACT * np.array([1.0 / self.leg] * 3 + [1.0] * 3)
        self._exact = w
        arms = [task.frame for pair in tasks.arms.values() for task in pair]
        soles = [tasks.robot.feet[side].frame for side in SIDES]
        self._frames = (*tasks.turns, *arms, *soles)
        self.damping = DAMPED
        self.able = able_accelerations(tasks.robot)
        joints = len(tasks.targets.time), tasks.robot.nv - BASE_NV
        self._held = np.zeros(joints, dtype=bool)  # at their limits

    def states(self, q: Array) -> StateSeries:
        """Return what is known of configurations (n, nq), which move from each to the next."""
        robot = self.tasks.robot
        v = velocities(robot, q, self.tasks.targets.dt)
        return state_series(robot, q, np.vstack((v, v[-1:])), self._frames, True)

    def looked_at(self, q: Array, states: StateSeries | None = None) -> Round:
        """Return what is known of configurations (n, nq); ``states``: theirs, if they are known."""
        states = self.states(q) if states is None else states
        v = states.v[:-1]
        joints = self.tasks.robot.limits.joint_positions(q)
        past = float(np.maximum(self.lower - joints, joints - self.upper).max()) - INSIDE
        tasks, (feet, off, cost) = self._rows(states), self._contacts(states)
        near, broken = self._near(q, states)
        cost += sum(float(np.square(e).sum()) for _, e in tasks)
        w = APART / self.leg
        low = [(w * J[:, None], w * z[:, None]) for J, z in self.lowest(states, 0.0)]
        rows = [*tasks, *feet, *near, *low]
        A, e = (np.concatenate(part, axis=1) for part in zip(*rows, strict=True))
        normal = NormalEquations(*A.shape[::2])
        normal.add(A, off=e)
        self._posture(joints, normal)
        cost += self.momentum(states, normal)
        self.jerk(v, normal)
        self.motors(v, normal)
        violation = max(0.0, past, off, broken)
        speed, force = self.haste(v)
        return Round(q, joints, normal, violation, speed, force, cost / len(q))

    def stepped(self, known: Round) -> Array:
        """Return configurations (n, nq) after a step, as damped as it is now."""
        return self.further(known.q, self._within_limits(known.joints, known.normal))

    def further(self, q: Array, step: Array) -> Array:
        """Return configurations (n, nq) after displacements (n, nv), none of them too large."""
        np.clip(step, -LARGEST, LARGEST, out=step)
        robot = self.tasks.robot
        return np.array([robot.integrate(one, d, 1.0) for one, d in zip(q, step, strict=True)])

    def haste(self, v: Array) -> tuple[float, float]:
        """Return the largest speed and acceleration by what joints can, of velocities (n, nv)."""
        speeds, rates = v[:, BASE_NV:], np.diff(v[:, BASE_NV:], axis=0) / self.tasks.targets.dt
        fastest = np.abs(speeds) / self.tasks.robot.limits.velocity
        return float(fastest.max()), float((np.abs(rates) / self.able).max())

    def _near(self, q: Array, states: StateSeries) -> tuple[list[tuple[Array, Array]], float]:
        """Return weighted rows and errors of bodies near each other; zeros fill them up.

        And by how much a margin is broken at most [m].
        """
        if self.collision is None:
            return [], 0.0
        frames, _, clearance, J = self.collision.near(q, states, NEAR)
        if not frames.size:
            return [], 0.0
        off, w = np.minimum(clearance - KEPT, 0.0), APART / self.leg
        return [padded(frames, w * J, w * off, len(q))], -float(clearance.min())

    def _rows(self, states: StateSeries) -> list[tuple[Array, Array]]:
        """Return weighted rows (n, r, nv) and errors (n, r) of the tasks, frame by frame."""
        tasks, targets = self.tasks, self.tasks.targets
        found = list[tuple[Array, Array]]()

        def add(weight: Array, jacobian: Array, error: Array) -> None:
            found.append((weight[..., None] * jacobian, weight * error))

        add(tasks.com.weight, states.part("com_jacobian", 3, -1), states.com - targets.com)
        for frame, task in tasks.turns.items():
            # With the error e of a rotation in world axes Jlog(e) e = e: the plain Jacobian does.
            e = _rotation_vectors(states.rotation(frame), targets.rotation[frame])
            add(task.weight, states.jacobian(frame)[:, 3:], e)
        for side, pair in tasks.arms.items():
            for n, arm in enumerate(pair):
                way = states.rotation(arm.frame) @ arm.axis
                J = -skews(way) @ states.jacobian(arm.frame)[:, 3:]
                add(arm.weight, J, way - targets.arms[side][:, n])
        if tasks.ellipsoids is not None:
            w = tasks.inertia.weight[:, None] * tasks.inertia.selection
            off = states.inertia[:, ROWS, COLUMNS] - tasks.ellipsoids[:, ROWS, COLUMNS]
            found.append((w @ states.part("inertia_jacobian", 6, -1), off @ w.T))
        return found

    def displaced(self, states: StateSeries, side: str) -> tuple[Array, Array]:
        """Return how far a foot is from its footprint (n, 6), and that one's Jacobian (n, 6, nv).

        At the footprint's origin, wherever a foot that rolls has its sole: so it is the same for
        all that move with the footprint.
        """
        path, frame = self.tasks.targets.feet.paths[side], self.tasks.robot.feet[side].frame
        turn = states.rotation(frame) @ np.swapaxes(self.tasks.rotations[side], 1, 2)
        arm = (turn @ (path.place - path.origin)[..., None])[..., 0]
        off = states.position(frame) - arm - path.origin
        e = np.hstack((off, Rotation.from_matrix(turn).as_rotvec()))
        J = states.jacobian(frame).copy()
        J[:, :3] += skews(arm) @ J[:, 3:]
        return e, J

    def _contacts(self, states: StateSeries) -> tuple[list[tuple[Array, Array]], float, float]:
        """Return weighted rows and errors of the feet, those in the air for their tasks.

        And how far those on the ground are off at most [m or rad], and the squares of the others.
        """
        tasks, found, off, cost = self.tasks, list[tuple[Array, Array]](), 0.0, 0.0
        for side in SIDES:
            path, frame = tasks.targets.feet.paths[side], tasks.robot.feet[side].frame
            turn = _rotation_vectors(states.rotation(frame), tasks.rotations[side])
            e, J = np.hstack((states.position(frame) - path.place, turn)), states.jacobian(frame)
            exact, held = self._exact, np.ones(6, dtype=bool)
            if side in tasks.targets.feet.lines:  # rolled as the leg is, gently to level
                e, J = seen_from(tasks.rotations[side], e, J)
                held[3] = False
                exact = np.where(held, exact, tasks.foot_weight)
            off = max(off, float(np.abs(e[path.down][:, held]).max(initial=0.0)))
            cost += float(np.square(tasks.foot_weight * e[~path.down]).sum())
            weight = np.where(path.down[:, None], exact, tasks.foot_weight)
            found.append((weight[..., None] * J, weight * e))
        return found, off, cost

    def lowest(self, states: StateSeries, limit: float) -> Iterator[tuple[Array, Array]]:
        """Yield rows (n, nv) and heights (n,) [m] of the lowest corner of either end of each sole.

        Where soles are in the air and lower than ``limit`` [m]; zeros elsewhere.
        """
        robot = self.tasks.robot
        for side in SIDES:
            foot, path = robot.feet[side], self.tasks.targets.feet.paths[side]
            R, J = states.rotation(foot.frame), states.jacobian(foot.frame)
            ahead = foot.polygon[:, 0] >= np.mean(foot.polygon[:, 0])
            for end in (ahead, ~ahead):
                arms = R[:, :, :2] @ foot.polygon[end].T  # (n, 3, k)
                corner = arms[:, 2].argmin(axis=1)[:, None, None]
                x, y, z = np.take_along_axis(arms, corner, axis=2)[..., 0].T
                z = z + states.position(foot.frame)[:, 2]
                seen = ~path.down & (z < limit)
                if seen.any():
                    rows = J[:, 2] + y[:, None] * J[:, 3] - x[:, None] * J[:, 4]
                    yield np.where(seen[:, None], rows, 0.0), np.where(seen, z, 0.0)

    def _posture(self, joints: Array, normal: NormalEquations) -> None:
        """Add the posture."""
        wanted = self.tasks.robot.limits.joint_positions(self.tasks.posture.target)
        w = self.tasks.posture.weight
        normal.add_differences((1.0,), w**2, w**2 * (joints - wanted), BASE_NV)

    def _within_limits(self, joints: Array, normal: NormalEquations) -> Array:
        """Return displacements (n, nv) that lead past no limit, nearly.

        Joints that would be past one are held there by rows of high weight, and let go again where
        they are pulled inside; the first that are tried are those of the round before.
        """
        room = np.where(joints - self.lower > self.upper - joints, self.upper, self.lower)
        room = np.where(np.isfinite(room), room, joints)
        for _ in range(ACTIVE_SETS):
            held, pull = np.full_like(normal.slope, self.damping**2), np.zeros_like(normal.slope)
            held[:, BASE_NV:] += LIMITED**2 * self._held
            pull[:, BASE_NV:] = LIMITED**2 * self._held * (joints - room)
            step = normal.solved(held, pull)
            goal = joints + step[:, BASE_NV:]
            out = (goal > self.upper) | (goal < self.lower)
            if np.array_equal(out, self._held):
                break
            self._held = out
        return step

    def momentum(
        self, states: StateSeries, normal: NormalEquations, *, stays: bool = False
    ) -> float:
        """Add the rows of the momentum between frames, and of its rate; or that both ``stay``.

        Returns
        -------
        float
            Their sum of squares.
        """
        tasks, targets = self.tasks, self.tasks.targets
        dt, robot, k = targets.dt, tasks.robot, targets.angular_momentum
        A, v = states.part("centroidal_map", 6, -1)[:-1], states.v[:-1]
        wanted = np.hstack((robot.mass * np.diff(targets.com, axis=0) / dt, 0.5 * (k[:-1] + k[1:])))
        off = (A @ v[..., None])[..., 0] - wanted
        if stays:
            off[:] = 0.0
        # v changes by (d_k+1 - d_k)/dt + v x (d_k + d_k+1)/2, which of joints is nothing.
        half = 0.5 * A[:, :, :BASE_NV] @ twist_products(v[:, :BASE_NV])
        first, second = states.momentum_jacobian[:-1] - A / dt, A / dt
        first[:, :, :BASE_NV] += half
        second[:, :, :BASE_NV] += half
        w = tasks.momentum
        turning = w * off[:, 3:]
        normal.add(w[:, None] * first[:, 3:], w[:, None] * second[:, 3:], off=turning)
        # By how far the CoP is moved, in legs' lengths.
        height = float(np.mean(targets.com[:, 2]))
        w = PRESSED / (robot.weight * self.leg) * np.array([height] * 3 + [1.0] * 3)
        first, second = (w[:, None] * J / dt for J in (first, second))
        pressing = w * np.diff(off, axis=0) / dt
        normal.add(-first[:-1], first[1:] - second[:-1], second[1:], off=pressing)
        return float(np.square(turning).sum() + np.square(pressing).sum())

    def jerk(self, v: Array, normal: NormalEquations, times: float = 1.0) -> None:
        """Add the jerk of all coordinates; lengths of the base by the legs'."""
        dt, nv = self.tasks.targets.dt, v.shape[1]
        mu = np.full(nv, (2.0 * np.pi * CUTOFF) ** -3.0)
        mu[:3] /= self.leg
        mu *= times
        normal.add_differences(THIRD, mu**2 / dt**6, mu**2 / dt**5 * np.diff(v, 2, axis=0))

    def motors(self, v: Array, normal: NormalEquations, hard: float | None = None) -> float:
        """Add speeds and accelerations of joints by what they can; firmly what is beyond a part.

        Parameters
        ----------
        v:
            From each configuration to the next (n - 1, nv).
        hard:
            How many times as firmly, what is beyond nearly all of it, and nothing else.

        Returns
        -------
        float
            Their sum of squares.
        """
        dt, fastest = self.tasks.targets.dt, self.tasks.robot.limits.velocity
        speeds, rates, cost = v[:, BASE_NV:], np.diff(v[:, BASE_NV:], axis=0) / dt, 0.0
        if hard is None:
            weights = (UNHURRIED, HURRIED, FASTEST), (UNFORCED, FORCED, STRONGEST)
        else:
            weights = (0.0, hard * HURRIED, NEARLY), (0.0, hard * FORCED, NEARLY)
        for ways, part, unit, (inside, outside, most) in (
            (FIRST, speeds / fastest, dt * fastest, weights[0]),
            (SECOND, rates / self.able, dt**2 * self.able, weights[1]),
        ):
            beyond = np.abs(part) > most
            square = np.where(beyond, outside, inside) ** 2
            off = np.where(beyond, part - np.sign(part) * most, part)
            normal.add_differences(ways, square / unit**2, square * off / unit, BASE_NV)
            cost += float((square * off**2).sum())
        return cost


def seen_from(R: Array, e: Array, J: Array) -> tuple[Array, Array]:
    """Return errors (n, 6) and Jacobians (n, 6, nv) with their turns in the axes of R (n, 3, 3)."""
    back = np.swapaxes(R, 1, 2)
    e, J = e.copy(), J.copy()
    e[:, 3:], J[:, 3:] = (back @ e[:, 3:, None])[..., 0], back @ J[:, 3:]
    return e, J


def able_accelerations(robot: Robot) -> Array:
    """Return the accelerations (nv - 6,) of single joints that no motor is too weak for.

    A joint that speeds up what hangs on it asks M_ij a_j of every motor i: arms of their elbows,
    too. By the standing posture; infinite where no motor has an effort.
    """
    M = np.abs(robot.snapshot(robot.postures[STANDING]).mass_matrix[BASE_NV:, BASE_NV:])
    return np.asarray((robot.limits.effort[:, None] / np.maximum(M, 1e-12)).min(axis=0))


def _rotation_vectors(actual: Array, wanted: Array) -> Array:
    """Return the rotations (n, 3) [rad], world axes, from wanted to actual (n, 3, 3)."""
    return np.asarray(Rotation.from_matrix(actual @ np.swapaxes(wanted, 1, 2)).as_rotvec())
