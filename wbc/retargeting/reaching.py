"""How near a motion came to what was wanted, task by task, and what is hard and was not kept."""

from __future__ import annotations

import numpy as np

from wbc.gait.legs import SIDES
from wbc.motion.ground import sole_corners
from wbc.retargeting.body_map import BodyMap
from wbc.retargeting.ground_forces import stretches
from wbc.retargeting.mending import too_near
from wbc.retargeting.prepared import Prepared
from wbc.retargeting.result import Reached, Retargeted, correlations, slides
from wbc.retargeting.smoothing import able_accelerations
from wbc.retargeting.targets import Targets
from wbc.rmp.axes import told_apart, track
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries, sole_series, state_series
from wbc.tracking.unbalanced import Unbalanced
from wbc.validate import Array

ALIKE, NEAR = 0.95, 10.0  # correlations and degrees, of which who is farther off is told
SUNK = 5e-3  # m: in the ground, that is told
GAP = 0.2  # part of the largest second moment: nearer ones have axes that mean little


def reached(
    robot: Robot, body: BodyMap, targets: Targets, q: Array, whole: CentroidalSeries, height: float,
) -> tuple[Reached, ...]:  # fmt: skip
    """Return how near each task came, largest errors with their times.

    Parameters
    ----------
    height:
        Of the CoM with straight legs [m], by which momenta are told.
    """
    parts = {
        (side, name): (frame, axis, targets.arms[side][:, n])
        for side, arm in body.arms.items()
        for n, (name, frame, axis) in enumerate(
            (
                ("upper arm", arm.upper_arm, arm.upper_axis),
                ("forearm", arm.forearm, arm.forearm_axis),
            )
        )
    }
    soles = {side: robot.feet[side].frame for side in SIDES}
    frames = [*targets.rotation, *(frame for frame, _, _ in parts.values()), *soles.values()]
    states = state_series(robot, q, frames=frames)
    turns = {
        frame: _degrees(0.5 * (np.einsum("nij,nij->n", R, states.rotation(frame)) - 1.0))
        for frame, R in targets.rotation.items()
    }
    arms = {
        name: _degrees(np.einsum("ni,ni->n", states.rotation(frame) @ axis, way))
        for name, (frame, axis, way) in parts.items()
    }
    feet = dict[str, Array]()
    for side, path in targets.feet.paths.items():
        off = 1e3 * np.linalg.norm(states.position(soles[side]) - path.place, axis=1)
        feet[side] = np.where(path.down, np.nan, off)
    names = {body.pelvis: "pelvis", body.trunk: "trunk", body.head: "head"}
    unit = robot.mass * height * np.sqrt(robot.gravity * height)
    k_off = np.linalg.norm(whole.momentum[:, 3:] - targets.angular_momentum, axis=1)
    com_off = 1e3 * np.linalg.norm(whole.com - targets.com, axis=1)
    axes = axes_off(whole.inertia, targets.inertia).T
    every = [
        ("CoM", com_off, "mm"),
        ("angular momentum", k_off / unit, "m h sqrt(g h)"),
        *((names[frame], v, "deg") for frame, v in turns.items()),
        *((f"{side} {name}", v, "deg") for (side, name), v in arms.items()),
        *((f"{side} foot in the air", v, "mm") for side, v in feet.items()),
        *((f"principal axis {n}", v, "deg") for n, v in enumerate(axes, 1)),
    ]
    known = [one for one in every if np.isfinite(one[1]).any()]
    return tuple(_reached(str(name), v, targets.time, unit) for name, v, unit in known)


def broken(
    known: Prepared, targets: Targets, q: Array, v: Array, acceleration: Array
) -> tuple[Unbalanced, ...]:
    """Return what is hard and not kept by a motion (n, nq), (n, nv) of all joints."""
    hands, collision = known.hands, known.collision
    robot, q = hands.robot, q[:, hands.q_kept]
    v, acceleration = v[:, hands.v_kept], acceleration[:, hands.v_kept]
    limits, time = robot.limits, targets.time
    parts = [
        ("sole slides", slides(robot, targets, q), [f"{side} foot" for side in SIDES]),
        ("joint limit passed", limits.past(limits.joint_positions(q)), robot.joint_names),
        (
            "speed above the limit",
            np.abs(v[:, BASE_NV:]) / limits.velocity - 1.0,
            robot.joint_names,
        ),
        (
            "acceleration above the motor's",
            np.abs(acceleration[:, BASE_NV:]) / able_accelerations(robot) - 1.0,
            robot.joint_names,
        ),
    ]
    found = list[Unbalanced]()
    for what, by, names in parts:
        for name, column in zip(names, by.T, strict=True):
            found += stretches(what, column, time, np.full(len(time), name))
    if collision is not None:
        frames, pairs, clearance, _ = too_near(collision, q, state_series(robot, q), 0.0)
        for pair in np.unique(pairs[clearance < 0.0]).tolist():
            by = np.zeros(len(q))
            by[frames[pairs == pair]] = -clearance[pairs == pair]
            name = collision.model.labels[pair]
            found += stretches("margin broken", by, time, np.full(len(time), name))
    return tuple(found)


def sunk(robot: Robot, targets: Targets, q: Array) -> list[str]:
    """Return notes of soles that are in the ground in the air, where they could not be kept out."""
    lowest = sole_corners(robot, sole_series(robot, q))[..., 2].min(axis=2)
    return [
        f"the {foot} sole is up to {1e3 * by.max():.0f} mm under the ground in the air, at"
        f" {targets.time[by.argmax()]:.2f} s"
        for foot, by in zip(robot.feet, -lowest.T, strict=True)
        if by.max() > SUNK
    ]


def unlike(found: Retargeted) -> list[str]:
    """Return a note of what of CoM, angular momentum and long axis is little like the human's."""
    whole, human = found.whole, found.targets.human_com
    both = whole.momentum[:, 3:], found.targets.angular_momentum
    told = [
        f"the CoM correlates by {part:.2f} along {axis} (the human's moves by {1e3 * way:.0f} mm)"
        for axis, part, way in zip("xyz", found.com_correlation, np.ptp(human, axis=0), strict=True)
        if part < ALIKE
    ]
    together = float(correlations(*(one.reshape(-1, 1) for one in both))[0])
    if together < ALIKE:
        told.append(f"the angular momentum by {together:.2f}")
    told += [
        f"the long axis is up to {one.largest:.0f} degrees off, at {one.at:.2f} s"
        for one in found.reached
        if one.task == "principal axis 1" and one.largest > NEAR
    ]
    why = "feet, limits, margins, motors, balance and where trunk and arms are go before"
    return [f"unlike the human: {', '.join(told)}; {why}"] if told else []


def axes_off(mine: Array, theirs: Array) -> Array:
    """Return how far principal axes are from each other (n, 3) [deg], the longest first.

    NaN where one of the two ellipsoids has another axis of nearly the same length.

    Parameters
    ----------
    mine, theirs:
        Inertias (n, 3, 3).
    """
    both = [track(one) for one in (mine, theirs)]
    found = np.full((len(mine), 3), np.nan)
    parts = []
    for one in both:
        order = np.argsort(-one.second_moments.mean(axis=0))
        moments = one.second_moments[:, order]
        parts.append((one.axes[:, :, order], told_apart(moments, GAP)))
    (A, a), (B, b) = parts
    cosines = np.abs(np.einsum("nij,nij->nj", A, B))
    found[a & b] = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))[a & b]
    return found


def _degrees(cosine: Array) -> Array:
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _reached(name: str, errors: Array, time: Array, unit: str) -> Reached:
    worst = int(np.nanargmax(errors))
    return Reached(
        name, float(np.sqrt(np.nanmean(errors**2))), float(errors[worst]), float(time[worst]), unit
    )
