"""The least-squares problem of a whole motion: all frames' rows and the jerk of all joints.

A tick sees one frame: it jitters where contacts, limits and margins become active, and angular
momentum that it takes up now has to be given back later. Here the displacements of all frames,
x = (d_0, ..., d_n-1) in the robot's tangent space, minimise

    sum_k |W (e_k + J_k d_k)|^2                                    tasks; contacts weigh most
        + |w u_k|^2 + |w' (u_k+1 - u_k)/dt|^2                      momentum and its rate
        + |mu ((v_k+2 - 2 v_k+1 + v_k)/dt^2 + (D^3 d)_k/dt^3)|^2   jerk,

a Gauss-Newton step on the tasks' own rows, with u_k = A_k (v_k + (d_k+1 - d_k)/dt) +
(dA_k/dq d_k) v_k - s h_k, and the factor s on the human's angular momentum that fits the present
motion best (:func:`wbc.retargeting.scaling.momentum_scale`). The rate of momentum is the ground's
force: a CoM that is followed to a millimetre but trembles at 10 Hz puts the CoP outside the feet.
Only frames at most three apart are coupled, so the normal equations are banded: linear in the
number of frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from wbc.constraints.collision import SelfCollision
from wbc.gait.legs import SIDES
from wbc.retargeting.normal_equations import NormalEquations, pad_rows
from wbc.retargeting.scaling import momentum_scale
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.postures import STANDING
from wbc.robot.series import StateSeries, state_series, velocities
from wbc.rotations import rotation_vectors
from wbc.spatial import COLUMNS, ROWS, skews, twist_products
from wbc.validate import Array, Bools

# By a leg's length, or per rad.
CONTACT_WEIGHT, LIMIT_WEIGHT, MARGIN_WEIGHT = 1e4, 200.0, 200.0
COP_WEIGHT = 3.0  # by a leg's length
# Weights of the ratios of speeds to their limits and of accelerations to the motors' below a
# threshold, of their excess above it, and the threshold; another one where only the excess counts.
SPEED_COST, ACCELERATION_COST = (0.3, 10.0, 0.9), (0.2, 5.0, 0.8)
CONSTRAINT_THRESHOLD = 0.97
FIRST_DIFFERENCE, SECOND_DIFFERENCE = (-1.0, 1.0), (1.0, -2.0, 1.0)
THIRD_DIFFERENCE = (-1.0, 3.0, -3.0, 1.0)
# Hz: the jerk cuts a task of weight 1 off at this frequency, others at that times the third root of
# their weights.
CUTOFF = 5.0
# m: pairs of bodies with less clearance than the first get rows, and keep the second.
ACTIVE_CLEARANCE, TARGET_CLEARANCE = 8e-3, 2e-3
LIMIT_OFFSET = 2e-3  # rad
# Active sets of joints at their limits, tried in one iteration, and the excess [rad] that waits for
# the next one.
MAX_ACTIVE_SETS, MAX_EXCESS = 3, 0.02
INITIAL_DAMPING = 3.0  # Levenberg-Marquardt weight of displacements: rows are of first order only
MAX_STEP = 0.3  # rad or m, of one frame in one iteration


class Linearization(NamedTuple):
    """Least squares about configurations, to first order."""

    # (n, nq), (n, nv - 6)
    q: Array
    joints: Array
    normal: NormalEquations  # the normal equations of the next step
    violation: float  # largest violation of feet on the ground, limits and margins [m or rad]
    # largest speed by its limit, and acceleration by what the motor can
    speed_ratio: float
    acceleration_ratio: float
    cost: float  # sum of squares of tasks and momentum, per frame

    @property
    def actuator_ratio(self) -> float:
        """The larger of the ratios of speeds and accelerations."""
        return max(self.speed_ratio, self.acceleration_ratio)


class TrajectoryProblem:
    """The least-squares problem of a motion.

    ``tasks``: with the targets.
    ``collision``: margins between bodies that are kept.

    ``leg``: length of the legs [m].
    ``damping``: Levenberg-Marquardt weight of displacements.
    ``max_accelerations``: see :func:`max_accelerations`.
    """

    def __init__(self, tasks: FrameTasks, collision: SelfCollision | None) -> None:
        self.tasks, self.collision, self.leg = tasks, collision, tasks.legs.length
        limits = tasks.robot.limits
        self.lower, self.upper = limits.lower + LIMIT_OFFSET, limits.upper - LIMIT_OFFSET
        self._contact_weight = CONTACT_WEIGHT * np.array([1.0 / self.leg] * 3 + [1.0] * 3)
        arms = [task.frame for pair in tasks.arms.values() for task in pair]
        soles = [tasks.robot.feet[side].frame for side in SIDES]
        self._frames = (*tasks.orientations, *arms, *soles)
        self.damping = INITIAL_DAMPING
        self.max_accelerations = max_accelerations(tasks.robot)
        joints = len(tasks.targets.time), tasks.robot.nv - BASE_NV
        self._at_limit = np.zeros(joints, dtype=bool)

    def states(self, q: Array) -> StateSeries:
        """Return kinematics and dynamics at configurations (n, nq), with forward differences."""
        robot = self.tasks.robot
        v = velocities(robot, q, self.tasks.targets.dt)
        return state_series(robot, q, np.vstack((v, v[-1:])), self._frames, True)

    def linearize(self, q: Array, states: StateSeries | None = None) -> Linearization:
        """Linearize about configurations (n, nq); ``states``: theirs, if they are known."""
        states = self.states(q) if states is None else states
        v = states.v[:-1]
        joints = self.tasks.robot.limits.joint_positions(q)
        past = float(np.maximum(self.lower - joints, joints - self.upper).max()) - LIMIT_OFFSET
        tasks, (feet, foot_error, cost) = self._task_rows(states), self._foot_rows(states)
        margins, broken = self._margin_rows(q, states)
        cost += sum(float(np.square(e).sum()) for _, e in tasks)
        w = MARGIN_WEIGHT / self.leg
        ground = [(w * J[:, None], w * z[:, None]) for J, z in self.lowest_corners(states, 0.0)]
        rows = [*tasks, *feet, *margins, *ground]
        A, e = (np.concatenate(part, axis=1) for part in zip(*rows, strict=True))
        normal = NormalEquations(*A.shape[::2])
        normal.add(A, errors=e)
        self._add_posture(joints, normal)
        cost += self.add_momentum(states, normal)
        self.add_jerk(v, normal)
        self.add_actuator_cost(v, normal)
        violation = max(0.0, past, foot_error, broken)
        return Linearization(q, joints, normal, violation, *self.actuator_ratios(v), cost / len(q))

    def step(self, known: Linearization) -> Array:
        """Return configurations (n, nq) after a step with the present damping."""
        step, self._at_limit = step_within_limits(
            known.normal, known.joints, self.lower, self.upper, LIMIT_WEIGHT, self.damping,
            self._at_limit, MAX_ACTIVE_SETS, MAX_EXCESS,
        )  # fmt: skip
        return self.apply_step(known.q, step)

    def apply_step(self, q: Array, step: Array) -> Array:
        """Return configurations (n, nq) after displacements (n, nv), which are clipped in place."""
        np.clip(step, -MAX_STEP, MAX_STEP, out=step)
        return self.tasks.robot.integrate_all(q, step)

    def actuator_ratios(self, v: Array) -> tuple[float, float]:
        """Return the largest speed and acceleration by the joints' own, of velocities (n, nv)."""
        speeds, rates = v[:, BASE_NV:], np.diff(v[:, BASE_NV:], axis=0) / self.tasks.targets.dt
        ratios = np.abs(speeds) / self.tasks.robot.limits.velocity
        return float(ratios.max()), float((np.abs(rates) / self.max_accelerations).max())

    def _margin_rows(
        self, q: Array, states: StateSeries
    ) -> tuple[list[tuple[Array, Array]], float]:
        """Return weighted rows and errors of bodies near each other, padded with zeros.

        And by how much a margin is broken at most [m].
        """
        if self.collision is None:
            return [], 0.0
        frames, _, clearance, J = self.collision.near(q, states, ACTIVE_CLEARANCE)
        if not frames.size:
            return [], 0.0
        errors, w = np.minimum(clearance - TARGET_CLEARANCE, 0.0), MARGIN_WEIGHT / self.leg
        return [pad_rows(frames, w * J, w * errors, len(q))], -float(clearance.min())

    def _task_rows(self, states: StateSeries) -> list[tuple[Array, Array]]:
        """Return weighted rows (n, r, nv) and errors (n, r) of the tasks, frame by frame."""
        tasks, targets = self.tasks, self.tasks.targets
        found = list[tuple[Array, Array]]()

        def add(weight: Array, jacobian: Array, error: Array) -> None:
            found.append((weight[..., None] * jacobian, weight * error))

        add(tasks.com.weight, states.part("com_jacobian", 3, -1), states.com - targets.com)
        for frame, task in tasks.orientations.items():
            # With the error e of a rotation in world axes Jlog(e) e = e: the plain Jacobian does.
            e = _rotation_errors(states.rotation(frame), targets.rotation[frame])
            add(task.weight, states.jacobian(frame)[:, 3:], e)
        for side, pair in tasks.arms.items():
            for n, arm in enumerate(pair):
                direction = states.rotation(arm.frame) @ arm.axis
                J = -skews(direction) @ states.jacobian(arm.frame)[:, 3:]
                add(arm.weight, J, direction - targets.arms[side][:, n])
        if tasks.inertia_targets is not None:
            w = tasks.inertia.weight[:, None] * tasks.inertia.selection
            e = states.inertia[:, ROWS, COLUMNS] - tasks.inertia_targets[:, ROWS, COLUMNS]
            found.append((w @ states.part("inertia_jacobian", 6, -1), e @ w.T))
        return found

    def footprint_error(self, states: StateSeries, side: str) -> tuple[Array, Array]:
        """Return a foot's displacement from its footprint (n, 6), and its Jacobian (n, 6, nv).

        Taken at the footprint's origin, wherever a foot that rolls has its sole, so that a foot
        that moves with its footprint has the same displacement in all frames.
        """
        path, frame = self.tasks.targets.feet.paths[side], self.tasks.robot.feet[side].frame
        R = states.rotation(frame) @ np.swapaxes(self.tasks.rotations[side], 1, 2)
        arm = (R @ (path.place - path.origin)[..., None])[..., 0]
        displacement = states.position(frame) - arm - path.origin
        e = np.hstack((displacement, rotation_vectors(R)))
        J = states.jacobian(frame).copy()
        J[:, :3] += skews(arm) @ J[:, 3:]
        return e, J

    def _foot_rows(self, states: StateSeries) -> tuple[list[tuple[Array, Array]], float, float]:
        """Return weighted rows and errors of the feet: contacts, and tasks of those in the air.

        And the largest error of feet on the ground [m or rad], and the squares of the others'.
        """
        tasks, found, largest, cost = self.tasks, list[tuple[Array, Array]](), 0.0, 0.0
        for side in SIDES:
            path, frame = tasks.targets.feet.paths[side], tasks.robot.feet[side].frame
            turn = _rotation_errors(states.rotation(frame), tasks.rotations[side])
            e, J = np.hstack((states.position(frame) - path.place, turn)), states.jacobian(frame)
            contact_weight, constrained = self._contact_weight, np.ones(6, dtype=bool)
            if side in tasks.targets.feet.line_feet:  # the leg cannot roll its sole: roll is a task
                e, J = rotate_angular_part(tasks.rotations[side], e, J)
                constrained[3] = False
                contact_weight = np.where(constrained, contact_weight, tasks.foot_weight)
            errors = np.abs(e[path.down][:, constrained])
            largest = max(largest, float(errors.max(initial=0.0)))
            cost += float(np.square(tasks.foot_weight * e[~path.down]).sum())
            weight = np.where(path.down[:, None], contact_weight, tasks.foot_weight)
            found.append((weight[..., None] * J, weight * e))
        return found, largest, cost

    def lowest_corners(self, states: StateSeries, limit: float) -> Iterator[tuple[Array, Array]]:
        """Yield rows (n, nv) and heights (n,) [m] of the lowest corner of either end of each sole.

        Where soles are in the air and lower than ``limit`` [m]; zeros elsewhere.
        """
        robot = self.tasks.robot
        for side in SIDES:
            foot, path = robot.feet[side], self.tasks.targets.feet.paths[side]
            R, J = states.rotation(foot.frame), states.jacobian(foot.frame)
            front = foot.polygon[:, 0] >= np.mean(foot.polygon[:, 0])
            for end in (front, ~front):
                arms = R[:, :, :2] @ foot.polygon[end].T  # (n, 3, k)
                corner = arms[:, 2].argmin(axis=1)[:, None, None]
                x, y, z = np.take_along_axis(arms, corner, axis=2)[..., 0].T
                z = z + states.position(foot.frame)[:, 2]
                active = ~path.down & (z < limit)
                if active.any():
                    rows = J[:, 2] + y[:, None] * J[:, 3] - x[:, None] * J[:, 4]
                    yield np.where(active[:, None], rows, 0.0), np.where(active, z, 0.0)

    def _add_posture(self, joints: Array, normal: NormalEquations) -> None:
        wanted = self.tasks.robot.limits.joint_positions(self.tasks.posture.target)
        w = self.tasks.posture.weight
        normal.add_differences((1.0,), w**2, w**2 * (joints - wanted), BASE_NV)

    def add_momentum(
        self, states: StateSeries, normal: NormalEquations, *, unchanged: bool = False
    ) -> float:
        """Add rows of the momentum between frames, and of its rate; or that both stay unchanged.

        Returns
        -------
        float
            Their sum of squares.
        """
        tasks, targets = self.tasks, self.tasks.targets
        dt, robot, k = targets.dt, tasks.robot, targets.angular_momentum
        A, v = states.part("centroidal_map", 6, -1)[:-1], states.v[:-1]
        own, human = (A @ v[..., None])[..., 0], 0.5 * (k[:-1] + k[1:])
        human = momentum_scale(own[:, 3:], human, tasks.momentum) * human
        errors = own - np.hstack((robot.mass * np.diff(targets.com, axis=0) / dt, human))
        if unchanged:
            errors[:] = 0.0
        # v changes by (d_k+1 - d_k)/dt + v x (d_k + d_k+1)/2, whose second part joints do not have.
        half = 0.5 * A[:, :, :BASE_NV] @ twist_products(v[:, :BASE_NV])
        first, second = states.momentum_jacobian[:-1] - A / dt, A / dt
        first[:, :, :BASE_NV] += half
        second[:, :, :BASE_NV] += half
        w = tasks.momentum
        angular = w * errors[:, 3:]
        normal.add(w[:, None] * first[:, 3:], w[:, None] * second[:, 3:], errors=angular)
        # The rate in displacements of the CoP, by the legs' length.
        height = float(np.mean(targets.com[:, 2]))
        w = COP_WEIGHT / (robot.weight * self.leg) * np.array([height] * 3 + [1.0] * 3)
        first, second = (w[:, None] * J / dt for J in (first, second))
        rate = w * np.diff(errors, axis=0) / dt
        normal.add(-first[:-1], first[1:] - second[:-1], second[1:], errors=rate)
        return float(np.square(angular).sum() + np.square(rate).sum())

    def add_jerk(self, v: Array, normal: NormalEquations, factor: float = 1.0) -> None:
        """Add the jerk of all coordinates; lengths of the base by the legs'."""
        dt, nv = self.tasks.targets.dt, v.shape[1]
        mu = np.full(nv, (2.0 * np.pi * CUTOFF) ** -3.0)
        mu[:3] /= self.leg
        mu *= factor
        normal.add_differences(
            THIRD_DIFFERENCE, mu**2 / dt**6, mu**2 / dt**5 * np.diff(v, 2, axis=0)
        )

    def add_actuator_cost(
        self, v: Array, normal: NormalEquations, excess_factor: float | None = None
    ) -> float:
        """Add speeds and accelerations of joints by their limits; excess weighs more.

        ``v``: from each configuration to the next (n - 1, nv); ``excess_factor``: on the weights of
        the excess over nearly all of a limit, with nothing else added.

        Returns
        -------
        float
            Their sum of squares.
        """
        dt, max_speeds = self.tasks.targets.dt, self.tasks.robot.limits.velocity
        speeds, rates, cost = v[:, BASE_NV:], np.diff(v[:, BASE_NV:], axis=0) / dt, 0.0
        accelerations = self.max_accelerations
        for difference, ratio, unit, weights in (
            (FIRST_DIFFERENCE, speeds / max_speeds, dt * max_speeds, SPEED_COST),
            (SECOND_DIFFERENCE, rates / accelerations, dt**2 * accelerations, ACCELERATION_COST),
        ):
            below, above, threshold = weights
            if excess_factor is not None:
                below, above, threshold = 0.0, excess_factor * above, CONSTRAINT_THRESHOLD
            beyond = np.abs(ratio) > threshold
            square = np.where(beyond, above, below) ** 2
            errors = np.where(beyond, ratio - np.sign(ratio) * threshold, ratio)
            normal.add_differences(difference, square / unit**2, square * errors / unit, BASE_NV)
            cost += float((square * errors**2).sum())
        return cost


def step_within_limits(
    normal: NormalEquations, joints: Array, lower: Array, upper: Array, weight: float,
    damping: float, held: Bools, tries: int, max_excess: float = 0.0,
) -> tuple[Array, Bools]:  # fmt: skip
    """Return displacements (n, nv) that violate limits by little, and the joints held at one.

    An active-set method: joints (n, nv - 6) that would pass a limit are ``held`` at the nearer one
    by rows of high ``weight``. With a ``max_excess`` [rad] above 0, they are let go where they are
    pulled inside, and a step is taken in which others pass limits by less.
    """
    nearest = np.where(joints - lower > upper - joints, upper, lower)
    nearest = np.where(np.isfinite(nearest), nearest, joints)
    diagonal = np.full_like(normal.gradient, damping**2)
    gradient = np.zeros_like(normal.gradient)
    for _ in range(tries):
        diagonal[:, BASE_NV:] = damping**2 + weight**2 * held
        gradient[:, BASE_NV:] = weight**2 * held * (joints - nearest)
        step = normal.solve(diagonal, gradient)
        goal = joints + step[:, BASE_NV:]
        excess = np.where(held, 0.0, np.maximum(goal - upper, lower - goal))
        held = (goal > upper) | (goal < lower) if max_excess > 0.0 else held | (excess > 0.0)
        if excess.max() <= max_excess:
            break
    return step, held


def rotate_angular_part(R: Array, e: Array, J: Array) -> tuple[Array, Array]:
    """Return errors (n, 6), Jacobians (n, 6, nv) with angular parts in the axes of R (n, 3, 3)."""
    back = np.swapaxes(R, 1, 2)
    e, J = e.copy(), J.copy()
    e[:, 3:], J[:, 3:] = (back @ e[:, 3:, None])[..., 0], back @ J[:, 3:]
    return e, J


def max_accelerations(robot: Robot) -> Array:
    """Return the accelerations (nv - 6,) of single joints that every motor can bear.

    A joint that accelerates its load takes M_ij a_j of every motor i: arms take it of their elbows.
    By the standing posture; infinite where no motor has an effort.
    """
    M = np.abs(robot.snapshot(robot.postures[STANDING]).mass_matrix[BASE_NV:, BASE_NV:])
    return np.asarray((robot.limits.effort[:, None] / np.maximum(M, 1e-12)).min(axis=0))


def _rotation_errors(actual: Array, wanted: Array) -> Array:
    """Return the rotations (n, 3) [rad], world axes, from wanted to actual (n, 3, 3)."""
    return rotation_vectors(actual @ np.swapaxes(wanted, 1, 2))
