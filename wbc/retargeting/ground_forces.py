"""Inverse dynamics of a motion: ground forces, whether feet can bear them, joint torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.retargeting.cop_correction import SupportedFrames, project_onto_supports
from wbc.rmp.ground import centre_of_pressure, in_contact
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries, state_series
from wbc.tracking.deviation import Unbalanced
from wbc.validate import Array

# Horizontal directions of the edges of a pyramid inside the friction cone.
PYRAMID_EDGES = np.array([(np.cos(a), np.sin(a)) for a in np.pi * (np.arange(4) + 0.5) / 2.0])
REGULARIZATION = 1e-3  # of corner forces, by the wrench's error: selects even ones
# m, or relative: less is rounding, or negligible.
TOLERANCES = {"CoP outside the feet": 1e-3, "friction above the cone": 5e-3,
              "torque above the limit": 1e-2, "force without a foot": 2e-2,
              "sole slides": 1e-3, "joint limit passed": 1e-9, "margin broken": 1e-6,
              "speed above the limit": 1e-6, "acceleration above the motor's": 1e-6}  # fmt: skip


@dataclass(frozen=True, eq=False)
class GroundForces:
    """Ground forces of n frames, and joint torques."""

    # of both feet at their sole frames, force then moment, world axes (n, 2, 6) [N, N m]: the most
    # even ones inside the friction cones at the corners that touch
    wrenches: Array
    torque: Array  # of the joints (n, nv - 6) [N m or N]
    cop: Array  # that the motion requires (n, 2) [m]; NaN where it requires no contact force
    # where the feet cannot give these forces, or the joints these torques
    unbalanced: tuple[Unbalanced, ...]


def ground_forces(
    robot: Robot,
    q: Array,
    v: Array,
    acceleration: Array,
    whole: CentroidalSeries,
    time: Array,
    supports: Sequence[SupportedFrames],
    friction: float,
) -> GroundForces:
    """Return the ground forces and joint torques of a motion.

    ``supports``: of the frames that have one; all others are in flight.
    ``friction``: coefficient.
    """
    count, weight = len(q), robot.weight
    force = whole.momentum_rate[:, :3] + [0.0, 0.0, weight]
    moment = whole.momentum_rate[:, 3:] + np.cross(whole.com, force)  # about the origin
    pushed = in_contact(force, weight)
    cop = np.full((count, 2), np.nan)
    cop[pushed] = centre_of_pressure(
        whole.com[pushed], force[pushed], whole.momentum_rate[pushed, 3:]
    )[:, :2]
    wrenches, torque = np.zeros((count, 2, 6)), np.empty((count, robot.nv - BASE_NV))
    # NaN where there is no CoP, or no foot.
    outside = np.linalg.norm(cop - project_onto_supports(cop, supports, margin=False), axis=1)
    friction_excess, standing = np.zeros(count), np.zeros(count, dtype=int)
    for one in supports:
        frames = one.frames
        standing[frames] = sum(n + 1 for n, _ in one.feet)
        for n, wrench in _foot_wrenches(one, force[frames], moment[frames], friction):
            wrenches[frames, n] = wrench
        horizontal = np.hypot(*force[frames, :2].T)
        ratio = horizontal / np.maximum(force[frames, 2], 1e-3 * weight)
        friction_excess[frames] = ratio - friction
    soles = [robot.feet[side].frame for side in SIDES]
    states = state_series(robot, q, v, soles)
    for k in range(count):
        motion = states.state(k).motion(v[k])
        load = motion.part("mass_matrix", robot.nv, -1) @ acceleration[k] + motion.part("bias", -1)
        torque[k] = load[BASE_NV:]
    for n, sole in enumerate(soles):
        wrenches[:, n, 3:] -= np.cross(states.position(sole), wrenches[:, n, :3])  # at the sole
        carried = np.swapaxes(states.jacobian(sole)[..., BASE_NV:], 1, 2) @ wrenches[:, n, :, None]
        torque -= carried[..., 0]
    names = np.array(["in the air", "left", "right", "both feet"])[standing]
    unsupported = np.where(standing > 0, 0.0, np.linalg.norm(force, axis=1) / weight)
    torque_excess = np.abs(torque) / robot.limits.effort - 1.0
    found = [
        *intervals_above("CoP outside the feet", outside, time, names),
        *intervals_above("friction above the cone", friction_excess, time, names),
        *intervals_above("force without a foot", unsupported, time, names),
    ]
    for joint, column in zip(robot.joint_names, torque_excess.T, strict=True):
        found += intervals_above("torque above the limit", column, time, np.full(count, joint))
    return GroundForces(wrenches, torque, cop, tuple(found))


def _foot_wrenches(
    stand: SupportedFrames, force: Array, moment: Array, friction: float
) -> list[tuple[int, Array]]:
    """Return feet's wrenches (m, 6) that sum up to force and moment (m, 3) about the origin."""
    directions = np.column_stack((friction * PYRAMID_EDGES, np.ones(len(PYRAMID_EDGES))))  # (4, 3)
    points = [_distinct(corners) for _, corners in stand.feet]
    at = np.repeat(np.concatenate(points), len(directions), axis=0)  # (e, 3)
    along = np.tile(directions, (len(at) // len(directions), 1))
    middle = at.mean(axis=0)  # moments are taken about it
    G = np.vstack((along.T, np.cross(at - middle, along).T))
    A = np.vstack((G, REGULARIZATION * np.eye(len(at))))
    size = np.linalg.norm(force, axis=1)[:, None] + 1.0
    wanted = np.hstack((force, moment - np.cross(middle, force))) / size
    # Frames whose unconstrained solution has no pulling force need no NNLS: G' (G G' + s^2)^-1.
    edges = np.linalg.solve(G @ G.T + REGULARIZATION**2 * np.eye(len(G)), wanted.T).T @ G
    none = np.zeros(len(at))
    for k in np.flatnonzero((edges < 0.0).any(axis=1)).tolist():
        edges[k] = nnls(A, np.concatenate((wanted[k], none)))[0]
    edges *= size
    wrench = np.hstack((along, np.cross(at, along)))  # of each edge
    owner = np.repeat([n for n, _ in stand.feet], [len(directions) * len(p) for p in points])
    return [(n, edges[:, owner == n] @ wrench[owner == n]) for n, _ in stand.feet]


def _distinct(corners: Array) -> Array:
    """Return corners (k, 3) without repeated neighbours."""
    return corners[np.concatenate(([True], (np.diff(corners, axis=0) != 0.0).any(axis=1)))]


def intervals_above(what: str, excess: Array, time: Array, where: Array) -> list[Unbalanced]:
    """Return the intervals in which an excess (n,) is above its tolerance."""
    found = []
    for first, end in runs(excess > TOLERANCES[what]):
        worst = first + int(np.argmax(excess[first:end]))
        span = float(time[first]), float(time[end - 1]), float(time[worst])
        found.append(Unbalanced(what, float(excess[worst]), *span, str(where[worst])))
    return found
