"""Tracking errors of a retargeted motion by task, and its constraint violations."""

from __future__ import annotations

import numpy as np

from wbc.gait.legs import SIDES
from wbc.motion.ground import sole_corners
from wbc.retargeting.constraint_projection import near_pairs
from wbc.retargeting.ground_forces import intervals_above
from wbc.retargeting.result import Reached, Retargeted, correlations, slides
from wbc.retargeting.robot_setup import RobotSetup
from wbc.retargeting.targets import Targets
from wbc.retargeting.trajectory_problem import max_accelerations
from wbc.rmp.axes import are_distinct, track
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries, sole_series, state_series
from wbc.tracking.deviation import Unbalanced
from wbc.validate import Array

MIN_CORRELATION, MAX_AXIS_ERROR = 0.95, 10.0  # 1, deg; a motion beyond is noted
MIN_COM_MOTION = 5e-3  # of the CoM's height: a motion by less correlates by chance
MIN_MOMENTUM = 1e-4  # the same of angular momentum, by m h sqrt(g h): 4e-4 while a human stands
MAX_LIMB_ERROR = 60.0  # deg: an arm that is told to be elsewhere; of human walks up to 30
MAX_PENETRATION = 5e-3  # m, of soles below the ground; more is noted
MIN_GAP = 0.2  # between second moments, by the largest: axes of closer ones are ill-defined


def tracking_errors(
    robot: Robot, setup: RobotSetup, targets: Targets, q: Array, whole: CentroidalSeries
) -> tuple[Reached, ...]:
    """Return each task's rms error, and its largest with its time.

    The unit of momenta is by the height of the CoM with straight legs.
    """
    body, height = setup.body, setup.standing.com_height
    parts = {
        (side, name): (frame, axis, targets.arms[side][:, n])
        for side, arm in body.arms.items()
        for n, (name, frame, axis) in enumerate(arm.segments)
    }
    soles = {side: robot.feet[side].frame for side in SIDES}
    frames = [*targets.rotation, *(frame for frame, _, _ in parts.values()), *soles.values()]
    states = state_series(robot, q, frames=frames)
    rotations = {
        frame: _degrees(0.5 * (np.einsum("nij,nij->n", R, states.rotation(frame)) - 1.0))
        for frame, R in targets.rotation.items()
    }
    arms = {
        name: _degrees(np.einsum("ni,ni->n", states.rotation(frame) @ axis, direction))
        for name, (frame, axis, direction) in parts.items()
    }
    feet = dict[str, Array]()
    for side, path in targets.feet.paths.items():
        error = 1e3 * np.linalg.norm(states.position(soles[side]) - path.place, axis=1)
        feet[side] = np.where(path.down, np.nan, error)
    names = {body.pelvis: "pelvis", body.trunk: "trunk", body.head: "head"}
    unit = robot.mass * height * np.sqrt(robot.gravity * height)
    k_error = np.linalg.norm(whole.momentum[:, 3:] - targets.angular_momentum, axis=1)
    com_error = 1e3 * np.linalg.norm(whole.com - targets.com, axis=1)
    axes = principal_axis_errors(whole.inertia, targets.inertia).T
    every = [
        ("CoM", com_error, "mm"),
        ("angular momentum", k_error / unit, "m h sqrt(g h)"),
        *((names[frame], v, "deg") for frame, v in rotations.items()),
        *((f"{side} {name}", v, "deg") for (side, name), v in arms.items()),
        *((f"{side} foot in the air", v, "mm") for side, v in feet.items()),
        *((f"principal axis {n}", v, "deg") for n, v in enumerate(axes, 1)),
    ]
    known = [one for one in every if np.isfinite(one[1]).any()]
    return tuple(_reached(str(name), v, targets.time, unit) for name, v, unit in known)


def violations(
    setup: RobotSetup, targets: Targets, q: Array, v: Array, acceleration: Array
) -> tuple[Unbalanced, ...]:
    """Return the constraint violations of a motion (n, nq), (n, nv) of all joints."""
    fingers, collision = setup.fingers, setup.collision
    robot, q = fingers.robot, q[:, fingers.q_kept]
    speeds, rates = (np.abs(one[:, fingers.v_kept][:, BASE_NV:]) for one in (v, acceleration))
    limits, time, joints = robot.limits, targets.time, robot.joint_names
    parts = [
        ("sole slides", slides(robot, targets, q), [f"{side} foot" for side in SIDES]),
        ("joint limit passed", limits.past(limits.joint_positions(q)), joints),
        ("speed above the limit", speeds / limits.velocity - 1.0, joints),
        ("acceleration above the motor's", rates / max_accelerations(robot) - 1.0, joints),
    ]
    found = list[Unbalanced]()
    for what, excess, names in parts:
        for name, column in zip(names, excess.T, strict=True):
            found += intervals_above(what, column, time, np.full(len(time), name))
    if collision is not None:
        frames, pairs, clearance, _ = near_pairs(collision, q, state_series(robot, q), 0.0)
        for pair in np.unique(pairs[clearance < 0.0]).tolist():
            depth = np.zeros(len(q))
            depth[frames[pairs == pair]] = -clearance[pairs == pair]
            name = collision.model.labels[pair]
            found += intervals_above("margin broken", depth, time, np.full(len(time), name))
    return tuple(found)


def penetration_notes(robot: Robot, targets: Targets, q: Array) -> list[str]:
    """Return notes of swinging soles below the ground, which could not be lifted out of it."""
    lowest = sole_corners(robot, sole_series(robot, q))[..., 2].min(axis=2)
    return [
        f"the swinging {foot} sole is up to {1e3 * depth.max():.0f} mm below the ground, at"
        f" {targets.time[depth.argmax()]:.2f} s"
        for foot, depth in zip(robot.feet, -lowest.T, strict=True)
        if depth.max() > MAX_PENETRATION
    ]


def dissimilarity_notes(found: Retargeted) -> list[str]:
    """Return notes where CoM, momentum, long axis, trunk or arms differ much from the human's."""
    whole, human = found.whole, found.targets.human_com
    height = float(np.mean(human[:, 2]))
    both = whole.momentum[:, 3:], found.targets.angular_momentum
    parts = [
        f"the CoM correlates by {c:.2f} along {axis} (the human's moves by {1e3 * way:.0f} mm)"
        for axis, c, way in zip("xyz", found.com_correlation, np.ptp(human, axis=0), strict=True)
        if c < MIN_CORRELATION and way > MIN_COM_MOTION * height
    ]
    least = MIN_MOMENTUM * found.robot.mass * height * np.sqrt(found.robot.gravity * height)
    c = float(correlations(*(one.reshape(-1, 1) for one in both))[0])
    if c < MIN_CORRELATION and np.abs(both[1]).max() > least:
        parts.append(f"the angular momentum correlates by {c:.2f}")
    parts += [
        f"the long axis is up to {one.largest:.0f} degrees off, at {one.at:.2f} s"
        for one in found.reached
        if one.task == "principal axis 1" and one.largest > MAX_AXIS_ERROR
    ]
    why = "feet, limits, margins, motors, balance, trunk and arms have priority"
    notes = [f"unlike the human: {', '.join(parts)}; {why}"] if parts else []
    limbs = [
        f"the {one.task} is up to {one.largest:.0f} degrees off, at {one.at:.2f} s"
        for one in found.reached
        if one.task.endswith(("arm", "trunk")) and one.largest > MAX_LIMB_ERROR
    ]
    why = "CoM, momentum, limits and margins have priority"
    return notes + ([f"unlike the human: {', '.join(limbs)}; {why}"] if limbs else [])


def principal_axis_errors(actual: Array, wanted: Array) -> Array:
    """Return the angles (n, 3) [deg] between principal axes, the longest axis first.

    NaN where one of the two ellipsoids has another axis of nearly the same length.

    ``actual``, ``wanted``: inertias (n, 3, 3).
    """
    parts = []
    for one in map(track, (actual, wanted)):
        order = np.argsort(-one.second_moments.mean(axis=0))
        moments = one.second_moments[:, order]
        parts.append((one.axes[:, :, order], are_distinct(moments, MIN_GAP)))
    (A, a), (B, b) = parts
    return np.where(a & b, _degrees(np.abs(np.einsum("nij,nij->nj", A, B))), np.nan)


def _degrees(cosine: Array) -> Array:
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _reached(name: str, errors: Array, time: Array, unit: str) -> Reached:
    worst = int(np.nanargmax(errors))
    return Reached(
        name, float(np.sqrt(np.nanmean(errors**2))), float(errors[worst]), float(time[worst]), unit
    )
