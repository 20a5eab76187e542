"""First-order propagation of a recording's noise to CoM, momentum, its rate, inertia and soles.

Noise displaces the base by a world vector and about its own axes, and the joints, about the smooth
trajectory: xi(t). Velocity and acceleration follow by differentiation; the derivatives of the
centroidal dynamics map all three to the momentum and its rate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from wbc.motion.noise import FilteredNoise
from wbc.motion.smoothing import SmoothMotion
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import centroidal_derivatives
from wbc.rotations import rotations_from
from wbc.spatial import skews
from wbc.validate import Array

NODE_RATE = 25.0  # Hz, of frames with covariances, which are interpolated between
NODE_GROWTH = 0.1  # largest relative change of the filtered noise between nodes, near the ends
NODES_PER_BATCH = 250
FRAMES_PER_BATCH = 500
# Rows of a covariance: CoM [m], momentum, its rate, inertia xx xy xz yy yz zz, sole by sole x y.
COM, MOMENTUM, RATE, INERTIA = slice(0, 3), slice(3, 9), slice(9, 15), slice(15, 21)
SOLES = 21


def covariances(
    robot: Robot, moving: SmoothMotion, noise: FilteredNoise
) -> Iterator[tuple[slice, Array]]:
    """Yield frames and, of each, the covariance (r, r) of CoM, momentum, rate, inertia and soles.

    r = 21 + 2 f with f feet of the robot: CoM [m], momentum and its rate [kg m/s, kg m^2/s, N,
    N m], centroidal inertia xx xy xz yy yz zz [kg m^2], x and y of each sole frame [m], in world
    axes. With a planted foot all positions are relative to it.
    """
    nodes = _nodes(moving.time, noise.covariances)
    parts = [nodes[k : k + NODES_PER_BATCH] for k in range(0, len(nodes), NODES_PER_BATCH)]
    at_nodes = np.concatenate([_covariances(robot, moving, noise, part) for part in parts])
    for first in range(0, len(moving.time), FRAMES_PER_BATCH):
        frames = np.arange(first, min(first + FRAMES_PER_BATCH, len(moving.time)))
        right = np.clip(np.searchsorted(nodes, frames), 1, max(1, len(nodes) - 1))
        left = nodes[right - 1]
        weight = ((frames - left) / (nodes[right] - left))[:, None, None]
        between = (1.0 - weight) * at_nodes[right - 1] + weight * at_nodes[right]
        yield slice(first, first + len(frames)), between


def _nodes(time: Array, filtered: Array) -> NDArray[np.intp]:
    """Return frames, first and last among them, between which covariances change little."""
    elapsed = (time - time[0]) * NODE_RATE
    energy = np.log(np.diagonal(filtered, axis1=1, axis2=2))
    growth = np.abs(np.diff(energy, axis=0)).max(axis=1) / NODE_GROWTH
    passed = np.floor(elapsed + np.concatenate(([0.0], np.cumsum(growth))) + 1e-9)
    starts = np.flatnonzero(np.diff(passed)) + 1
    return np.unique(np.concatenate(([0], starts, [len(passed) - 1])))


def _covariances(
    robot: Robot, moving: SmoothMotion, noise: FilteredNoise, frames: NDArray[np.intp]
) -> Array:
    """Return covariances (m, r, r) in some frames."""
    # Each (m, r, nv), by xi, xi', xi''; and the base by joints with a planted foot.
    jacobians, base_by_joints = _jacobians(robot, moving, frames)
    recorded = noise.recorded
    if noise.root is not None:  # channels are correlated
        stacked = np.stack([one @ noise.root for one in jacobians], axis=1)  # (m, 3, r, k)
    elif base_by_joints is None:
        deviations = np.concatenate((recorded.position, recorded.rotation, recorded.joints))
        stacked = np.stack(jacobians, axis=1) * deviations  # (m, 3 p, r, channels)
    else:
        own: list[Array] = [one[:, :, 6:] for one in jacobians]
        base: list[Array] = [one[:, :, :6] @ base_by_joints for one in jacobians]
        twice = noise.covariances.shape[1] > len(jacobians)
        processes = own + base if twice else [a + b for a, b in zip(own, base, strict=True)]
        stacked = np.stack(processes, axis=1) * recorded.joints
    # Of filtered noise L L' these are L times independent ones.
    mixed = np.einsum("mij,mirc->mrjc", _roots(noise.covariances[frames]), stacked)
    mixed = mixed.reshape(len(frames), stacked.shape[2], -1)
    found = np.asarray(mixed @ np.swapaxes(mixed, 1, 2))
    if noise.constant is not None:
        constant = jacobians[0] @ noise.constant
        found = found + constant @ np.swapaxes(constant, 1, 2)
    return found


def _roots(matrices: Array) -> Array:
    """Return L with L L' = S for positive semidefinite S (m, k, k), scaled first."""
    size = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))[:, :, None]
    values, vectors = np.linalg.eigh(matrices / (size * np.swapaxes(size, 1, 2)))
    return np.asarray(size * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _jacobians(
    robot: Robot, moving: SmoothMotion, frames: NDArray[np.intp]
) -> tuple[list[Array], Array | None]:
    """Return the Jacobians (m, r, nv) of all rows by xi, xi' and xi''.

    And that of the base by the joints (m, 6, nv-6) while a planted sole does not move, else None.

    With the base's world position displaced by e and its rotation R exp(f), in base axes::

        dv = R'e' + v x f            da = R'e'' - w x R'e' + v x f' + a x f
        dw = f' + w x f              dw' = f'' + w x f' + w' x f
    """
    q, v, a = moving.q[frames], moving.v[frames], moving.acceleration[frames]
    by_q, by_v, by_a, *planted = _state_jacobians(robot, moving, frames)
    to_base = np.swapaxes(rotations_from(q[:, 3:BASE_NQ]), 1, 2)
    linear, angular = skews(v[:, :3]), skews(v[:, 3:6])
    rotation = slice(3, 6)
    to_v, to_a, to_a_rate = np.zeros((3, len(frames), 6, 6))
    to_v[:, :3, rotation], to_v[:, rotation, rotation] = linear, angular
    to_a[:, :3, rotation], to_a[:, rotation, rotation] = skews(a[:, :3]), skews(a[:, 3:6])
    to_a_rate[:, :3, :3], to_a_rate[:, :3, rotation] = -angular @ to_base, linear
    to_a_rate[:, rotation, rotation] = angular
    base_v, base_a = by_v[:, :, :6].copy(), by_a[:, :, :6].copy()
    for one in (by_q, by_v, by_a):
        one[:, :, :3] = one[:, :, :3] @ to_base
    by_q[:, :, :6] += base_v @ to_v + base_a @ to_a
    by_v[:, :, :6] += base_a @ to_a_rate
    for base in planted:
        base[:, :3] = np.swapaxes(to_base, 1, 2) @ base[:, :3]
    return [by_q, by_v, by_a], planted[0] if planted else None


def _state_jacobians(
    robot: Robot, moving: SmoothMotion, frames: NDArray[np.intp]
) -> tuple[Array, ...]:
    """Return the Jacobians (m, r, nv) of all rows by q (in the tangent space), v and its rate.

    And the base's by the joints (m, 6, nv-6), in base axes, if a planted sole does not move.
    """
    found = centroidal_derivatives(
        robot, moving.q[frames], moving.v[frames], moving.acceleration[frames]
    )
    by_q, by_v, by_a = np.zeros((3, len(frames), SOLES + 2 * len(robot.feet), robot.nv))
    by_q[:, COM], by_q[:, INERTIA] = found.com, found.inertia
    by_q[:, MOMENTUM], by_v[:, MOMENTUM] = found.momentum_by_q, found.centroidal_map
    by_q[:, RATE], by_v[:, RATE] = found.rate_by_q, found.rate_by_v
    by_a[:, RATE] = found.centroidal_map
    by_q[:, SOLES:] = found.soles[:, :, :2].reshape(len(frames), -1, robot.nv)
    if moving.planted is None:
        return by_q, by_v, by_a
    J = found.soles[np.arange(len(frames)), moving.planted[frames]]
    return by_q, by_v, by_a, -np.asarray(np.linalg.solve(J[:, :, :6], J[:, :, 6:]), float)
