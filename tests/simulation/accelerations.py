"""Velocities, forces, accelerations and inertia between MuJoCo's coordinates and the robot's."""

import mujoco
import numpy as np

from wbc.rotations import rotation_from
from wbc.simulation import Plant
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


def mass_and_bias(plant: Plant, q: Array, v: Array) -> tuple[Array, Array]:
    """Return MuJoCo's mass matrix and bias at its present state (q, v), in the robot's terms."""
    M, columns = np.zeros((plant.model.nv, plant.model.nv)), np.eye(plant.model.nv)
    for k, column in enumerate(columns):
        mujoco.mj_mulM(plant.model, plant.data, M[k], column)
    # inverse dynamics of the acceleration that is zero in the robot's terms
    qacc = acceleration_to_mujoco(plant.states, q, v, np.zeros(plant.robot.nv))
    T = velocity_map(plant.states, q)
    return T.T @ M @ T, T.T @ (M @ qacc + plant.data.qfrc_bias)
