"""Disturbed simulations for walks and motions: noise, delay, and wrong masses by a seed."""

from functools import cache

import numpy as np

import wbc
from wbc.simulation import Devices, Imu, ModelMismatch, Plant, SensedPlant, Sensors, Terrain
from wbc.validate import Array

DT = 0.002  # s
DELAY = 0.002  # s, of what is measured
ARMATURE = 0.003  # kg m^2, as in the problem files
NOISE = {
    "position_noise": 1e-3,
    "velocity_noise": 0.05,
    "base_rotation_noise": 1e-3,
    "base_rate_noise": 0.05,
    "delay": DELAY,
}


@cache
def robot_named(name: str) -> wbc.Robot:
    return wbc.Robot.load(name, armature=ARMATURE)


def mass_of(seed: int) -> float:
    """Return the factor on the real masses, wrong by up to 10 %."""
    return float(np.random.default_rng((seed, 20261122)).uniform(0.9, 1.1))


def plant_of(
    robot: wbc.Robot, seed: int, terrain: Terrain, q: Array, *, delay: float = DELAY
) -> Plant:
    """Return the simulation of a robot, begun at ``q``."""
    sensors = Sensors(**NOISE | {"delay": delay}, seed=seed)
    wrong = ModelMismatch(mass=mass_of(seed))
    plant = Plant(robot, dt=DT, terrain=terrain, sensors=sensors, mismatch=wrong)
    plant.reset(q)
    return plant


def sensed_plant_of(robot: wbc.Robot, seed: int, terrain: Terrain, q: Array) -> SensedPlant:
    """Return the simulation of a robot that measures only with its devices."""
    frame = "imu_in_pelvis" if "imu_in_pelvis" in robot.frame_names else "base"
    devices = Devices(imus=(Imu(frame=frame),), seed=seed)
    wrong = ModelMismatch(mass=mass_of(seed))
    plant = SensedPlant(robot, dt=DT, terrain=terrain, devices=devices, mismatch=wrong)
    plant.reset(q)
    return plant
