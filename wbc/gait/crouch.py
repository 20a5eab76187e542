"""The nominal posture of a walk, where the robot starts on straight legs."""

from __future__ import annotations

import logging

import numpy as np

from wbc.gait.legs import SIDES, STRETCH, Legs, bent_backwards, knee_bends, knee_of
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array

MAX_ITERATIONS = 100
TOLERANCE = 1e-3  # m and rad
DAMPING = 1e-6  # of the damped least-squares steps, squared
# Hip's height by the leg's length from which on knees past straight count as straight.
STRAIGHT_RATIO = 0.95
MAX_STEP = 0.2  # rad or m, per iteration


def walking_posture(start: Snapshot, height: float, legs: Legs | None = None) -> Array:
    """Return the posture task's target (nq,) for a CoM at ``height`` over the soles [m].

    It is the start, unless its knees are straight as in the standing posture of most files: drawn
    to straight knees a robot stays above its gait's height and walks faster than commanded. Then it
    is a posture nearby with bent knees, and with feet, trunk and the CoM's ground projection where
    they were, found by damped least squares. ``legs``: the robot's, if already known.
    """
    robot = start.robot
    legs = Legs.of(robot) if legs is None else legs
    straight = legs.hip_height > STRETCH * legs.length or (
        legs.hip_height > STRAIGHT_RATIO * legs.length and bent_backwards(start)
    )
    knees = [robot.model.idx_vs[knee_of(robot, side)] - BASE_NV for side in SIDES]
    standing = robot.limits.joint_positions(robot.postures[STANDING])
    differs = np.abs(start.joint_positions - standing)[knees].max() > TOLERANCE
    if differs or not straight:
        return start.q
    bends = knee_bends(robot, legs.hip_height - (legs.com_height - height))
    q = start.q.copy()
    for knee, angle in bends.items():
        robot.limits.set_joint(q, knee, angle)
    ground = np.mean([start.position(robot.feet[side].frame)[2] for side in SIDES])
    goal = np.array([*start.com[:2], ground + height])
    for _ in range(MAX_ITERATIONS):
        error, J = _posture_error(start, robot.snapshot(q), goal)
        if robot.loops:
            loop_error, rows = robot.closure.errors(q)
            error, J = np.concatenate((error, loop_error)), np.concatenate((J, rows))
        if np.abs(error).max() < TOLERANCE:
            return q
        step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(len(J)), error)
        step *= -min(1.0, MAX_STEP / float(np.abs(step).max()))
        q = robot.limits.clamped(robot.integrate(q, step, 1.0))
    logging.getLogger(__name__).warning(
        "walker: %s stands on straight legs, and no posture with bent knees and the CoM at %.3g m"
        " was found; give Walker(..., posture=...)",
        robot.name,
        height,
    )
    return start.q


def _posture_error(start: Snapshot, now: Snapshot, goal: Array) -> tuple[Array, Array]:
    """Return the errors (k,) of feet, trunk and CoM, and their Jacobian (k, nv)."""
    frames = [start.robot.feet[side].frame for side in SIDES]
    error, rows = [now.com - goal], [now.com_jacobian]
    for frame in (*frames, BASE):
        R, J = start.rotation(frame), now.jacobian(frame)
        D = now.rotation(frame) @ R.T
        turn = 0.5 * np.array((D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]))
        if frame != BASE:
            error.append(now.position(frame) - start.position(frame))
            rows.append(J[:3])
        error.append(turn)
        rows.append(J[3:])
    return np.concatenate(error), np.concatenate(rows)
