"""The posture that a walk is drawn to, where the robot stands on straight legs."""

from __future__ import annotations

import logging

import numpy as np

from wbc.gait.legs import SIDES, STRETCH, Legs, bent_backwards, knee_bends, knee_of
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array

ROUNDS = 100
CLOSE = 1e-3  # m and rad
DAMPING = 1e-6  # squared, of each step
NEARLY = 0.95  # part of a leg's length: knees that are past straight by no more are not bent so
LONGEST = 0.2  # rad or m, of a step


def walking_posture(start: Snapshot, height: float, legs: Legs | None = None) -> Array:
    """Return the posture (nq,) to draw joints to while the CoM is at ``height`` over the soles [m].

    It is the posture at the start, unless its knees are the standing one's and straight, as in the
    zero posture of most files: drawn to these a robot would not come down to its gait's height, and
    walk faster than it is told to. Then it is one nearby with bent knees, feet, trunk and the CoM's
    ground projection being where they were. ``legs``: the robot's, if they are known.
    """
    robot = start.robot
    legs = Legs.of(robot) if legs is None else legs
    straight = legs.hip_height > STRETCH * legs.length or (
        legs.hip_height > NEARLY * legs.length and bent_backwards(start)
    )
    knees = [robot.model.idx_vs[knee_of(robot, side)] - BASE_NV for side in SIDES]
    standing = robot.limits.joint_positions(robot.postures[STANDING])
    given = np.abs(start.joint_positions - standing)[knees].max() > CLOSE
    if given or not straight:
        return start.q
    bends = knee_bends(robot, legs.hip_height - (legs.com_height - height))
    q = start.q.copy()
    for knee, angle in bends.items():
        robot.limits.set_joint(q, knee, angle)
    ground = np.mean([start.position(robot.feet[side].frame)[2] for side in SIDES])
    goal = np.array([*start.com[:2], ground + height])
    for _ in range(ROUNDS):
        error, J = _missing(start, robot.snapshot(q), goal)
        if robot.loops:
            open_by, rows = robot.closure.errors(q)
            error, J = np.concatenate((error, open_by)), np.concatenate((J, rows))
        if np.abs(error).max() < CLOSE:
            return q
        step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(len(J)), error)
        step *= -min(1.0, LONGEST / float(np.abs(step).max()))
        q = robot.limits.clamped(robot.integrate(q, step, 1.0))
    logging.getLogger(__name__).warning(
        "walker: %s stands on straight legs, and no posture with bent knees and the CoM at %.3g m"
        " was found; give Walker(..., posture=...)",
        robot.name,
        height,
    )
    return start.q


def _missing(start: Snapshot, now: Snapshot, goal: Array) -> tuple[Array, Array]:
    """Return how far feet, trunk and CoM are from where they should be (k,), and the Jacobian."""
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
