"""What the ground has to do for a motion, whether feet can, and the joints' torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.retargeting.balanced import SupportedFrames, clipped
from wbc.rmp.ground import centre_of_pressure, in_contact
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries, state_series
from wbc.tracking.unbalanced import Unbalanced
from wbc.validate import Array

# Edges of a friction cone's pyramid, inside the cone.
EDGES = np.array([(np.cos(a), np.sin(a)) for a in np.pi * (np.arange(4) + 0.5) / 2.0])
SPREAD = 1e-3  # of corner forces, by what the wrench counts: picks even ones
# So little is rounding, or what a hand would not notice: m, 1, part of the torque.
TOLERANCES = {"CoP outside the feet": 1e-3, "friction above the cone": 5e-3,
              "torque above the limit": 1e-2, "force without a foot": 2e-2,
              "sole slides": 1e-3, "joint limit passed": 1e-9, "margin broken": 1e-6,
              "speed above the limit": 1e-6, "acceleration above the motor's": 1e-6}  # fmt: skip


@dataclass(frozen=True, eq=False)
class GroundForces:
    """What the ground does, n frames.

    Attributes
    ----------
    wrenches:
        Of both feet at their sole frames, force then moment, world axes (n, 2, 6) [N, N m]: the
        most even ones within friction cones at the corners that touch.
    torque:
        Of the joints (n, nv - 6) [N m or N].
    cop:
        That the motion asks for (n, 2) [m]; NaN where it asks for no push.
    unbalanced:
        What cannot be.
    """

    wrenches: Array
    torque: Array
    cop: Array
    unbalanced: tuple[Unbalanced, ...]


def ground_forces(
    robot: Robot,
    q: Array,
    v: Array,
    acceleration: Array,
    whole: CentroidalSeries,
    time: Array,
    stands: Sequence[SupportedFrames],
    friction: float,
) -> GroundForces:
    """Return what the ground has to do for a motion.

    Parameters
    ----------
    stands:
        What frames stand on; all others are in the air.
    friction:
        Coefficient.
    """
    count, weight = len(q), robot.weight
    force = whole.momentum_rate[:, :3] + [0.0, 0.0, weight]
    moment = whole.momentum_rate[:, 3:] + np.cross(whole.com, force)  # about the origin
    pushed = in_contact(force, robot.mass)
    cop = np.full((count, 2), np.nan)
    cop[pushed] = centre_of_pressure(
        whole.com[pushed], force[pushed], whole.momentum_rate[pushed, 3:]
    )[:, :2]
    wrenches, torque = np.zeros((count, 2, 6)), np.empty((count, robot.nv - BASE_NV))
    # NaN where there is no CoP, or no foot.
    outside = np.linalg.norm(cop - clipped(cop, stands, edge=True), axis=1)
    lacking, standing = np.zeros(count), np.zeros(count, dtype=int)
    for one in stands:
        frames = one.frames
        standing[frames] = sum(n + 1 for n, _ in one.feet)
        for n, wrench in _shares(one, force[frames], moment[frames], friction):
            wrenches[frames, n] = wrench
        level = np.hypot(*force[frames, :2].T)
        lacking[frames] = level / np.maximum(force[frames, 2], 1e-3 * weight) - friction
    soles = [robot.feet[side].frame for side in SIDES]
    states = state_series(robot, q, v, soles)
    for n, sole in enumerate(soles):  # moments at the soles
        wrenches[:, n, 3:] -= np.cross(states.position(sole), wrenches[:, n, :3])
    for k in range(count):
        motion = states.state(k).motion(v[k])
        load = motion.part("mass_matrix", robot.nv, -1) @ acceleration[k] + motion.part("bias", -1)
        torque[k] = load[BASE_NV:]
    for n, sole in enumerate(soles):
        carried = np.swapaxes(states.jacobian(sole)[..., BASE_NV:], 1, 2) @ wrenches[:, n, :, None]
        torque -= carried[..., 0]
    names = np.array(["in the air", "left", "right", "both feet"])[standing]
    alone = np.where(standing > 0, 0.0, np.linalg.norm(force, axis=1) / weight)
    over = np.abs(torque) / robot.limits.effort - 1.0
    found = [
        *stretches("CoP outside the feet", outside, time, names),
        *stretches("friction above the cone", lacking, time, names),
        *stretches("force without a foot", alone, time, names),
    ]
    for joint, column in zip(robot.joint_names, over.T, strict=True):
        found += stretches("torque above the limit", column, time, np.full(count, joint))
    return GroundForces(wrenches, torque, cop, tuple(found))


def _shares(
    stand: SupportedFrames, force: Array, moment: Array, friction: float
) -> list[tuple[int, Array]]:
    """Return the wrenches (m, 6) of feet that make forces and moments (m, 3), about the origin."""
    ways = np.column_stack((friction * EDGES, np.ones(len(EDGES))))  # (4, 3)
    points = [_distinct(corners) for _, corners in stand.feet]
    at = np.repeat(np.concatenate(points), len(ways), axis=0)  # (e, 3)
    along = np.tile(ways, (len(at) // len(ways), 1))
    middle = at.mean(axis=0)  # about which moments count
    G = np.vstack((along.T, np.cross(at - middle, along).T))
    A = np.vstack((G, SPREAD * np.eye(len(at))))
    size = np.linalg.norm(force, axis=1)[:, None] + 1.0
    wanted = np.hstack((force, moment - np.cross(middle, force))) / size
    # Where no force pulls anyway, all frames at once: the same least squares by G' (G G' + s^2)^-1.
    edges = np.linalg.solve(G @ G.T + SPREAD**2 * np.eye(len(G)), wanted.T).T @ G
    none = np.zeros(len(at))
    for k in np.flatnonzero((edges < 0.0).any(axis=1)).tolist():
        edges[k] = nnls(A, np.concatenate((wanted[k], none)))[0]
    edges *= size
    wrench = np.hstack((along, np.cross(at, along)))  # of each edge
    owner = np.repeat([n for n, _ in stand.feet], [len(ways) * len(p) for p in points])
    return [(n, edges[:, owner == n] @ wrench[owner == n]) for n, _ in stand.feet]


def _distinct(corners: Array) -> Array:
    """Return corners (k, 3) without those that repeat the one before."""
    return corners[np.concatenate(([True], (np.diff(corners, axis=0) != 0.0).any(axis=1)))]


def stretches(what: str, by: Array, time: Array, where: Array) -> list[Unbalanced]:
    """Return the stretches in which a number is above its tolerance."""
    found = []
    for first, end in runs(by > TOLERANCES[what]):
        worst = first + int(np.argmax(by[first:end]))
        span = float(time[first]), float(time[end - 1]), float(time[worst])
        found.append(Unbalanced(what, float(by[worst]), *span, str(where[worst])))
    return found
