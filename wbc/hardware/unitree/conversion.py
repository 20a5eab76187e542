"""Conversion of Unitree's messages to readings and commands, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.hardware.bus import Command, Reading
from wbc.hardware.unitree.layout import LAYOUTS, MessageLayout
from wbc.hardware.unitree.profiles import Profile
from wbc.robot import Robot

TICK = 1e-3  # s: resolution of the messages' clock
ENABLED = 1  # motor mode
# Of the remote control: bytes 2 and 3 are its keys; L2 and B together are Unitree's own stop.
KEY_BYTES = (2, 3)
L2, B = (0, 1 << 5), (1, 1 << 1)
GO_HEAD, GO_LOW_LEVEL = (0xFE, 0xEF), 0xFF
WXYZ, XYZW = [3, 0, 1, 2], [1, 2, 3, 0]


class Converter:
    """Converts the messages of one robot; joints are in the order of its model.

    ``profile``: of the robot on the bus; ``robot``: its model.

    Raises InvalidInputError: a joint of the model has no motor.
    """

    def __init__(self, profile: Profile, robot: Robot) -> None:
        self.profile, self.order = profile, profile.order(robot)
        self.state, self.command = LAYOUTS[profile.family]
        self.mode_machine = 0  # from the robot's messages; its commands must repeat it
        self._is_hg = profile.family == "hg"

    # ------------------------------------------------------------------ the controller's end

    def reading(self, data: bytes) -> Reading | None:
        """Return the reading of a LowState's CDR bytes; None if they are damaged."""
        layout = self.state
        if not layout.is_sound(data):
            return None
        tick = int(layout.view(data, "tick")[0])
        if self._is_hg:
            self.mode_machine = int(layout.view(data, "mode_machine")[0])
        keys = layout.view(data, "wireless_remote")[list(KEY_BYTES)]
        quaternion = layout.view(data, "imu_state.quaternion").astype(float)
        return Reading(
            tick,
            tick * TICK,
            self._motors(data, "q"),
            self._motors(data, "dq"),
            self._motors(data, "tau_est"),
            self._motors(data, "temperature"),
            quaternion[XYZW],
            layout.view(data, "imu_state.gyroscope").astype(float),
            layout.view(data, "imu_state.accelerometer").astype(float),
            all(int(keys[at]) & bit for at, bit in (L2, B)),
        )

    def low_command(self, command: Command) -> bytearray:
        """Return the CDR bytes of a LowCmd; motors without a joint stay off.

        The sequence number is in the first spare word, which only ``wbc hardware sim`` reads.
        """
        layout, c = self.command, command
        data, modes = layout.zeros(), np.full(len(self.order), ENABLED * c.enabled)
        motors = {"mode": modes, "q": c.position, "dq": c.velocity, "tau": c.torque}
        self._set_motors(layout, data, {**motors, "kp": c.kp, "kd": c.kd})
        if self._is_hg:
            layout.view(data, "mode_pr")[0] = self.profile.mode_pr
            layout.view(data, "mode_machine")[0] = self.mode_machine
        else:
            layout.view(data, "head")[:] = GO_HEAD
            layout.view(data, "level_flag")[0] = GO_LOW_LEVEL
        layout.view(data, "reserve")[0] = c.sequence & 0xFFFFFFFF
        layout.seal(data)
        return data

    # ------------------------------------------------------------------ the robot's end

    def command_from(self, data: bytes) -> Command | None:
        """Return the command of a LowCmd's CDR bytes; None if they are damaged."""
        layout = self.command
        if not layout.is_sound(data):
            return None
        modes = layout.motor_values(data, "mode")[self.order]
        names = ("q", "dq", "tau", "kp", "kd")
        q, dq, tau, kp, kd = (
            layout.motor_values(data, name)[self.order].astype(float) for name in names
        )
        number = int(layout.view(data, "reserve")[0])
        return Command(number, q, dq, tau, kp, kd, bool((modes == ENABLED).all()))

    def low_state(self, reading: Reading) -> bytearray:
        """Return the CDR bytes of a LowState."""
        layout, r = self.state, reading
        data, quaternion = layout.zeros(), r.quaternion[WXYZ]
        motors = {"q": r.position, "dq": r.velocity, "tau_est": r.torque}
        self._set_motors(layout, data, {**motors, "temperature": r.temperature})
        layout.view(data, "imu_state.quaternion")[:] = quaternion
        layout.view(data, "imu_state.gyroscope")[:] = r.angular_velocity
        layout.view(data, "imu_state.accelerometer")[:] = r.specific_force
        layout.view(data, "imu_state.rpy")[:] = _roll_pitch_yaw(quaternion.tolist())
        layout.view(data, "tick")[0] = round(r.time / TICK) & 0xFFFFFFFF
        if r.stop:
            remote = layout.view(data, "wireless_remote")
            for at, bit in (L2, B):
                remote[KEY_BYTES[at]] |= bit
        layout.seal(data)
        return data

    def _set_motors(
        self, layout: MessageLayout, data: bytearray, given: Mapping[str, NDArray[Any]]
    ) -> None:
        values = np.zeros(layout.count)
        for name, of_joints in given.items():
            values[self.order] = of_joints
            layout.set_motor_values(data, name, values)

    def _motors(self, data: bytes, name: str) -> NDArray[np.float64]:
        return self.state.motor_values(data, name)[self.order].astype(float)


def _roll_pitch_yaw(wxyz: list[float]) -> tuple[float, float, float]:
    w, x, y, z = wxyz
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw
