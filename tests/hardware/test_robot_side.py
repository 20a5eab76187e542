"""What a simulated robot measures."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("mujoco")

from wbc.hardware.bus import Command, Reading
from wbc.hardware.robot_side import RobotSettings
from wbc.hardware.setup import simulated_robot
from wbc.hardware.unitree.profiles import profile_named
from wbc.robot import Robot
from wbc.rotations import exp_rotation, rotation_from


class Listener:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.dropped = Counter[str]()
        self.readings = list[Reading]()

    def receive(self) -> Command | None:
        return None

    def send(self, reading: Reading) -> None:
        self.readings.append(reading)

    def close(self) -> None: ...


def test_the_imu_measures_where_it_is(g1: Robot) -> None:
    """Its readings integrate to the motion of its frame, by Pinocchio, of a robot that is thrown.

    Readings at the base, 0.095 m aside, end 5 mm off after 0.2 s.
    """
    listener, profile = Listener(), profile_named("unitree_g1")
    assert profile.mount(g1).frame == "imu_in_pelvis"
    quiet = dict.fromkeys(
        ("velocity_noise", "gyroscope_noise", "accelerometer_noise", "orientation_noise"), 0.0
    )
    settings = RobotSettings(0.001, encoder=1e-12, truth=True, gantry=False, **quiet)
    side = simulated_robot(g1, profile, listener, settings, lifted=0.5)
    side.push(0.0, "pelvis", (400.0, 300.0, 200.0), 0.05)
    for k in range(200):
        side.step(0.001 * k)
    readings, gravity, positions, rotations = listener.readings, (0.0, 0.0, -9.81), [], []
    for one in readings:
        assert one.base_truth is not None
        here = g1.snapshot(np.concatenate((one.base_truth.pose, one.position)))
        positions.append(here.position("imu_in_pelvis"))
        rotations.append(here.rotation("imu_in_pelvis"))
    dt = np.diff([one.time for one in readings])
    velocity = (positions[1] - positions[0]) / dt[0]
    place, R = positions[1], rotations[1]
    for one, step in zip(readings[2:], dt[1:], strict=True):
        R = R @ exp_rotation(step * one.angular_velocity)
        velocity = velocity + step * (rotation_from(one.quaternion) @ one.specific_force + gravity)
        place = place + step * velocity
    np.testing.assert_allclose(place, positions[-1], atol=5e-5)  # Euler's error
    np.testing.assert_allclose(R, rotations[-1], atol=1e-2)
