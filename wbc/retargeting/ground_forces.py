"""What the ground has to do for a motion, whether feet can, and the joints' torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.polygon import convex_hull, polygon_margin
from wbc.rmp.ground import centre_of_pressure, in_contact
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries
from wbc.validate import Array

# Edges of a friction cone's pyramid, inside the cone.
EDGES = np.array([(np.cos(a), np.sin(a)) for a in np.pi * (np.arange(4) + 0.5) / 2.0])
SPREAD = 1e-3  # of corner forces, by what the wrench counts: picks even ones
# So little is rounding, or what a hand would not notice: m, 1, part of the torque.
TOLERANCES = {"CoP outside the feet": 1e-3, "friction above the cone": 5e-3,
              "torque above the limit": 1e-2, "force without a foot": 2e-2}  # fmt: skip


@dataclass(frozen=True)
class Unbalanced:
    """A stretch of time in which the motion cannot be balanced as it is.

    Attributes
    ----------
    what:
        ``CoP outside the feet`` [m], ``friction above the cone`` (the coefficient that is lacking),
        ``torque above the limit`` (part of it), ``force without a foot`` (part of the weight).
    by:
        How much at worst.
    start, end, worst:
        Times [s].
    where:
        The joint, or the feet that stand.
    """

    what: str
    by: float
    start: float
    end: float
    worst: float
    where: str

    def __str__(self) -> str:
        unit = 1e3 if self.what.startswith("CoP") else 100.0
        size = f"{self.by * unit:.0f} mm" if unit == 1e3 else f"{self.by * unit:.0f} %"
        if self.what.startswith("friction"):
            size = f"{self.by:.2f}"
        span = f"{self.start:.2f} to {self.end:.2f} s, worst at {self.worst:.2f} s"
        return f"{self.what} by {size} ({self.where}; {span})"


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
    down: NDArray[np.bool_],
    corners: Mapping[str, Array],
    friction: float,
) -> GroundForces:
    """Return what the ground has to do for a motion.

    Parameters
    ----------
    down:
        Which feet touch the ground (n, 2), left and right.
    corners:
        Of the soles that touch (n, k, 3), by side [m].
    friction:
        Coefficient.
    """
    count, weight = len(q), robot.weight
    force = whole.momentum_rate[:, :3] + [0.0, 0.0, weight]
    pushed = in_contact(force, robot.mass)
    cop = np.full((count, 2), np.nan)
    cop[pushed] = centre_of_pressure(
        whole.com[pushed], force[pushed], whole.momentum_rate[pushed, 3:]
    )[:, :2]
    wrenches, torque = np.zeros((count, 2, 6)), np.empty((count, robot.nv - BASE_NV))
    outside, lacking = np.zeros(count), np.zeros(count)
    for k in range(count):
        snapshot = robot.snapshot(q[k], v[k])
        stand = [(n, corners[side][k]) for n, side in enumerate(SIDES) if down[k, n]]
        soles = [snapshot.position(robot.feet[side].frame) for side in SIDES]
        if stand:
            moment = whole.momentum_rate[k, 3:] + np.cross(whole.com[k], force[k])
            _spread(stand, force[k], moment, friction, soles, wrenches[k])
            if pushed[k]:
                hull = convex_hull(np.concatenate([points[:, :2] for _, points in stand]))
                outside[k] = -float(polygon_margin(hull, cop[k]))
            level = float(np.hypot(*force[k, :2]))
            lacking[k] = level / max(float(force[k, 2]), 1e-3 * weight) - friction
        load = snapshot.mass_matrix @ acceleration[k] + snapshot.bias
        for n, side in enumerate(SIDES):
            if down[k, n]:
                load -= snapshot.jacobian(robot.feet[side].frame).T @ wrenches[k, n]
        torque[k] = load[BASE_NV:]
    names = np.array(["in the air", "left", "right", "both feet"])[down @ [1, 2]]
    alone = np.where(down.any(axis=1), 0.0, np.linalg.norm(force, axis=1) / weight)
    over = np.abs(torque) / robot.limits.effort - 1.0
    found = [
        *_stretches("CoP outside the feet", outside, time, names),
        *_stretches("friction above the cone", lacking, time, names),
        *_stretches("force without a foot", alone, time, names),
    ]
    for joint, column in zip(robot.joint_names, over.T, strict=True):
        found += _stretches("torque above the limit", column, time, np.full(count, joint))
    return GroundForces(wrenches, torque, cop, tuple(found))


def _spread(
    stand: list[tuple[int, Array]],
    force: Array,
    moment: Array,
    friction: float,
    soles: list[Array],
    wrenches: Array,
) -> None:
    """Set the wrenches (2, 6) of feet that make a force and its moment about the origin."""
    ways = np.column_stack((friction * EDGES, np.ones(len(EDGES))))  # (4, 3)
    points = [_distinct(corners) for _, corners in stand]
    at = np.repeat(np.concatenate(points), len(ways), axis=0)  # (m, 3)
    along = np.tile(ways, (len(at) // len(ways), 1))
    middle = at.mean(axis=0)  # about which moments count
    G = np.vstack((along.T, _crossed(at - middle, along).T))
    wanted = np.concatenate((force, moment - np.cross(middle, force)))
    size = float(np.linalg.norm(force)) + 1.0
    A = np.vstack((G, SPREAD * np.eye(len(at))))
    found, _ = nnls(A, np.concatenate((wanted / size, np.zeros(len(at)))))
    forces = size * found[:, None] * along
    owner = np.repeat([n for n, _ in stand], [len(ways) * len(p) for p in points])
    for n, _ in stand:
        own = owner == n
        wrenches[n, :3] = forces[own].sum(axis=0)
        wrenches[n, 3:] = _crossed(at[own] - soles[n], forces[own]).sum(axis=0)


def _distinct(corners: Array) -> Array:
    """Return corners (k, 3) without those that repeat the one before."""
    return corners[np.concatenate(([True], (np.diff(corners, axis=0) != 0.0).any(axis=1)))]


def _crossed(a: Array, b: Array) -> Array:
    """Return the cross products (m, 3) of rows: NumPy's own takes longer for few."""
    x, y, z = a.T
    u, v, w = b.T
    return np.column_stack((y * w - z * v, z * u - x * w, x * v - y * u))


def _stretches(what: str, by: Array, time: Array, where: Array) -> list[Unbalanced]:
    """Return the stretches in which a number is above its tolerance."""
    found = []
    for first, end in runs(by > TOLERANCES[what]):
        worst = first + int(np.argmax(by[first:end]))
        span = float(time[first]), float(time[end - 1]), float(time[worst])
        found.append(Unbalanced(what, float(by[worst]), *span, str(where[worst])))
    return found
