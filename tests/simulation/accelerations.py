"""Velocities, forces and accelerations between MuJoCo's coordinates and the robot's."""

import numpy as np

from wbc.rotations import rotation_from
from wbc.simulation.states import StateMap
from wbc.validate import Array


def velocity_map(states: StateMap, q: Array) -> Array:
    """Return T (MuJoCo's nv, nv) with ``qvel = T v``; ``T.T`` takes forces back."""
    zero = np.zeros(states.robot.nv)
    return np.stack([states.to_mujoco(q, zero + row)[1] for row in np.eye(zero.size)], axis=1)


def acceleration_to_mujoco(states: StateMap, q: Array, v: Array, a: Array) -> Array:
    """Return ``qacc`` of an acceleration (nv,), the rate of ``v``, whose base turns meanwhile."""
    qacc = velocity_map(states, q) @ a
    qacc[:3] += rotation_from(q[3:7]) @ np.cross(v[3:6], v[:3])
    return qacc


def acceleration_from_mujoco(states: StateMap, q: Array, v: Array, qacc: Array) -> Array:
    """Return the rate (nv,) of ``v`` from ``qacc``: the inverse."""
    a = np.linalg.pinv(velocity_map(states, q)) @ qacc
    a[:3] -= np.cross(v[3:6], v[:3])
    return a
