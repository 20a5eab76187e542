"""Projection of a motion onto its hard constraints, all frames at once, by smooth displacements.

Where a motion was solved, its tasks pull at limits, margins and feet, and weights settle for a
compromise. Here displacements d of all frames minimise

    sum_k |w h_k(d)|^2 + |mu (D^3 d)_k/dt^3|^2 + lambda^2 |d_k|^2

and, by the tasks' weights, their change of CoM and momentum; h are the constraint violations: feet
on the ground, limits, margins (by the shapes of the robot's files), speeds and accelerations of
joints. Feasible constraints are met to rounding in a few Levenberg-Marquardt iterations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import SelfCollision
from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.retargeting.footsteps import FootPaths, Footprint, yaw_pitch_rotations
from wbc.retargeting.normal_equations import NormalEquations, pad_rows
from wbc.retargeting.trajectory_problem import (
    TrajectoryProblem,
    rotate_angular_part,
    step_within_limits,
)
from wbc.robot import Robot
from wbc.robot.series import StateSeries, sole_series
from wbc.rotations import headings
from wbc.validate import Array

# Iterations at most, and in all where the violation is already below NEARLY_FEASIBLE [m or rad] and
# the damping below the last.
MAX_ITERATIONS, MAX_ITERATIONS_NEARLY, NEARLY_FEASIBLE, STUCK_DAMPING = 14, 40, 5e-3, 1e3
WEIGHT = 2e3  # of feet, limits and margins, by a leg's length or per rad
EXCESS_FACTOR, JERK_FACTOR = 10.0, 10.0  # on the weights of the trajectory problem
# Levenberg-Marquardt weight of displacements, and its factors after a better and a worse step.
INITIAL_DAMPING, DAMPING_DECREASE, DAMPING_INCREASE = 3.0, 0.4, 4.0
MAX_ACTIVE_SETS = 3  # of joints at their limits, tried in one iteration
LIMIT_OFFSET = 1e-3  # rad: so far inside limits joints are held
# m: a violated margin is restored to the first; with less clearance than the second pairs get rows.
TARGET_CLEARANCE, ACTIVE_CLEARANCE = 2e-4, 3e-4
GROUND_TOLERANCE = 1e-3  # m: depth of a sole in the air below the ground
FOOT_TOLERANCE = 2e-4  # m or rad
RATIO_VIOLATION = 0.1  # m or rad: counts as much as joints at twice their speed or acceleration
# Stopping early: motions with such a cost after so many iterations have never become feasible.
EARLY_STOP_ITERATION, EARLY_STOP_COST = 6, 1e5
# m or rad: footprints that moved by less are unchanged; by more than the second are noted.
UNCHANGED, NOTED = 1e-6, 5e-3


class Projection(NamedTuple):
    """Configurations (n, nq), and their constraint violations."""

    q: Array
    # largest violations [m or rad]
    feet: float
    limits: float
    margins: float
    # largest speed and acceleration by the joints' own
    speed_ratio: float
    acceleration_ratio: float

    @property
    def violation(self) -> float:
        """Sum of all violations beyond tolerances [m or rad]."""
        excess = max(self.speed_ratio, self.acceleration_ratio, 1.0) - 1.0
        feet = max(self.feet - FOOT_TOLERANCE, 0.0)
        return feet + self.limits + self.margins + RATIO_VIOLATION * excess

    @property
    def feasible(self) -> bool:
        """Whether all constraints are satisfied."""
        return self.violation <= 0.0


def project_onto_constraints(
    problem: TrajectoryProblem, q: Array, *, stop_early: bool = False
) -> Projection:
    """Return the nearest feasible configurations to some (n, nq), or the least infeasible found.

    With ``stop_early`` only a feasible result is of interest: hopeless motions are given up.
    """
    now = best = _LinearizedConstraints(problem, q)
    damping = DAMPING_DECREASE * INITIAL_DAMPING
    for number in range(MAX_ITERATIONS_NEARLY):
        if now.found.feasible:
            return now.found
        stuck = best.found.violation > NEARLY_FEASIBLE or damping > STUCK_DAMPING
        if number >= MAX_ITERATIONS and stuck:
            break
        if stop_early and number >= EARLY_STOP_ITERATION and best.cost > EARLY_STOP_COST:
            break
        now = _LinearizedConstraints(problem, best.step(damping))
        if now.cost < best.cost:
            best, damping = now, DAMPING_DECREASE * damping
        else:
            damping *= DAMPING_INCREASE
    return now.found if now.found.feasible else best.found


class _LinearizedConstraints:
    """First-order rows of the constraints about configurations (n, nq)."""

    def __init__(self, problem: TrajectoryProblem, q: Array) -> None:
        self.problem, tasks = problem, problem.tasks
        states = problem.states(q)
        v = states.v[:-1]
        limits = tasks.robot.limits
        joints = limits.joint_positions(q)
        past = limits.past(joints)
        self.normal = NormalEquations(len(q), tasks.robot.nv)
        self.feet, self.margins, self.cost = 0.0, 0.0, 0.0
        self._add_feet(states)
        self._add_margins(q, states)
        self._add_ground(states)
        self.cost += problem.add_actuator_cost(v, self.normal, EXCESS_FACTOR)
        problem.add_jerk(0.0 * v, self.normal, JERK_FACTOR)
        # CoM and momentum change as little as possible, so that a balanced motion stays balanced.
        self._add(
            tasks.com.weight[:, None] * states.part("com_jacobian", 3, -1), np.zeros((len(q), 3))
        )
        problem.add_momentum(states, self.normal, unchanged=True)
        self.joints = joints
        self.lower = np.minimum(limits.lower + LIMIT_OFFSET, limits.upper)
        self.upper = np.maximum(limits.upper - LIMIT_OFFSET, limits.lower)
        self.cost += float(np.square(WEIGHT * np.maximum(past, 0.0)).sum())
        self.found = Projection(
            q, self.feet, max(float(past.max()), 0.0), self.margins, *problem.actuator_ratios(v)
        )

    def _add_feet(self, states: StateSeries) -> None:
        """Add the feet on the ground: level at its height, and without sliding.

        They stand where they are, which may be a little aside of their targets. The displacement
        from the footprint is what must not change: a foot that rolls over an edge keeps it.
        """
        w = WEIGHT / self.problem.leg
        for side in SIDES:
            path = self.problem.tasks.targets.feet.paths[side]
            e, J = self.problem.footprint_error(states, side)
            down = path.down[:, None]
            weight = np.array((w, WEIGHT, WEIGHT))  # of height, roll, pitch
            if side in self.problem.tasks.targets.feet.line_feet:
                e, J = rotate_angular_part(yaw_pitch_rotations(path.heading), e, J)
                e[:, 3], J[:, 3] = 0.0, 0.0
            errors = np.where(down, weight * e[:, 2:5], 0.0)
            self._add(np.where(down[..., None], weight[:, None] * J[:, 2:5], 0.0), errors)
            self.feet = max(self.feet, float(np.abs(errors / weight).max()))
            both = (path.down[1:] & path.down[:-1])[:, None]
            horizontal, weight = [0, 1, 5], np.array((w, w, WEIGHT))  # x, y, yaw
            slide = np.where(both, weight * np.diff(e[:, horizontal], axis=0), 0.0)
            rows = weight[:, None] * J[:, horizontal]
            before, after = (np.where(both[..., None], one, 0.0) for one in (rows[:-1], rows[1:]))
            self.normal.add(-before, after, errors=slide)
            self.cost += float(np.square(slide).sum())
            for first, end in runs(path.down):
                displacement = e[first:end, horizontal]
                self.feet = max(self.feet, float(np.ptp(displacement, axis=0).max()))

    def _add_margins(self, q: Array, states: StateSeries) -> None:
        """Add bodies near each other: those too near separate, others come no nearer."""
        collision = self.problem.collision
        if collision is None:
            return
        frames, _, clearance, J = near_pairs(collision, q, states, ACTIVE_CLEARANCE)
        if not frames.size:
            return
        self.margins = max(float(-clearance.min()), 0.0)
        errors = np.where(clearance < 0.0, clearance - TARGET_CLEARANCE, 0.0)
        w = WEIGHT / self.problem.leg
        self._add(*pad_rows(frames, w * J, w * errors, len(q)))

    def _add_ground(self, states: StateSeries) -> None:
        """Lift soles in the air that are in the ground, and keep the others out of it."""
        w = WEIGHT / self.problem.leg
        for rows, height in self.problem.lowest_corners(states, ACTIVE_CLEARANCE):
            errors = np.where(height < 0.0, height - TARGET_CLEARANCE, 0.0)
            self._add(w * rows[:, None], w * errors[:, None])
            self.margins = max(self.margins, float(-height.min()) - GROUND_TOLERANCE)

    def _add(self, rows: Array, errors: Array) -> None:
        self.normal.add(rows, errors=errors)
        self.cost += float(np.square(errors).sum())

    def step(self, damping: float) -> Array:
        """Return configurations (n, nq) after a step with such a weight of displacements.

        Joints that would pass a limit are held there; the active set only grows.
        """
        step, _ = step_within_limits(
            self.normal, self.joints, self.lower, self.upper, WEIGHT, damping,
            np.zeros(self.joints.shape, dtype=bool), MAX_ACTIVE_SETS,
        )  # fmt: skip
        return self.problem.apply_step(self.found.q, step)


def near_pairs(
    collision: SelfCollision, q: Array, states: StateSeries, limit: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Return pairs as :meth:`~wbc.SelfCollision.near` does, by the shapes of the robot's files.

    The fitted shapes contain these and are fast to measure: only pairs that they find too near are
    measured again. A pair that is not too near by its raw shapes has a clearance of 0.
    """
    frames, pairs, clearance, J = collision.near(q, states, limit)
    near = np.flatnonzero(clearance < 0.0)
    if near.size:
        numbers = np.split(pairs[near], np.flatnonzero(np.diff(frames[near])) + 1)
        found = np.concatenate(
            [
                collision.model.raw.violations(q[k], own.tolist(), collision.margins)
                for k, own in zip(np.unique(frames[near]), numbers, strict=True)
            ]
        )
        clearance[near] = -found[:, 0]
        has_normal = found[:, 1:4].any(axis=1)
        near, found = near[has_normal], found[has_normal]
        both = np.column_stack((frames[near], pairs[near]))
        rows_within = collision.model.native.rows_within
        J[near] = rows_within(states.array, states.tree, both, found)
    return frames, pairs, clearance, J


def update_footprints(
    feet: FootPaths, robot: Robot, q: Array, time: Array
) -> tuple[FootPaths, list[str]]:
    """Return foot paths with footprints where a robot has them (n, nq), and notes."""
    soles, prints, notes = sole_series(robot, q), list[Footprint](), list[str]()
    paths = dict(feet.paths)
    for one in feet.prints:
        path, T = paths[one.foot], soles[one.foot][one.first : one.end]
        span = slice(one.first, one.end)
        R = T[:, :3, :3] @ np.swapaxes(path.rotation[span], 1, 2)
        arm = (R @ (path.place - path.origin)[span][..., None])[..., 0]
        yaw = float(np.mean(headings(R)))
        shift = np.mean(T[:, :2, 3] - arm[:, :2] - path.origin[span, :2], axis=0)
        distance = float(np.linalg.norm(shift))
        if max(distance, abs(yaw)) < UNCHANGED:
            prints.append(one)
            continue
        prints.append(replace(one, pose=one.pose + [*shift, yaw]))
        paths[one.foot] = path.displaced(span, shift, yaw)
        if distance > NOTED or abs(yaw) > NOTED:
            notes.append(
                f"the {one.foot} foot stands {1e3 * distance:.0f} mm and {np.degrees(yaw):.1f}"
                f" degrees aside from {time[one.first]:.2f} to {time[one.end - 1]:.2f} s: the robot"
                " reaches no nearer"
            )
    for side in sorted(feet.line_feet):
        tilt = float(np.abs(np.arcsin(soles[side][paths[side].down, 2, 1])).max(initial=0.0))
        notes.append(
            f"the {side} leg cannot roll its sole: that stands along its length only, and is tilted"
            f" aside by up to {np.degrees(tilt):.1f} degrees"
        )
    return replace(feet, paths=paths, prints=tuple(prints)), notes
