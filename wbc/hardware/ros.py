"""Readings and estimates as ROS messages, without a dependency on ROS.

The functions return plain dictionaries with the fields of ``sensor_msgs/JointState``,
``sensor_msgs/Imu`` and ``nav_msgs/Odometry``, nested likewise; :func:`fill` writes one into a
message object. ``examples/ros2_node.py`` is a node.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, listed, shown
from wbc.hardware.bus import Reading
from wbc.hardware.robot_controller import configuration
from wbc.robot import Robot
from wbc.validate import Array, finite_array, finite_number

NANO = 1_000_000_000
ROWS = 6  # of a pose's and a twist's covariance: linear, then angular


def stamp(time: float) -> dict[str, int]:
    """Return a time [s] as ``builtin_interfaces/Time``."""
    nanoseconds = round(finite_number("ROS, time", time) * NANO)
    return {"sec": nanoseconds // NANO, "nanosec": nanoseconds % NANO}


def joint_state(robot: Robot, reading: Reading) -> dict[str, Any]:
    """Return a reading as ``sensor_msgs/JointState``."""
    return {
        "header": {"stamp": stamp(reading.time), "frame_id": ""},
        "name": list(robot.joint_names),
        "position": reading.position.tolist(),
        "velocity": reading.velocity.tolist(),
        "effort": reading.torque.tolist(),
    }


def imu(reading: Reading, frame: str = "imu") -> dict[str, Any]:
    """Return a reading as ``sensor_msgs/Imu``; its covariances are unknown (zeros)."""
    return {
        "header": {"stamp": stamp(reading.time), "frame_id": frame},
        "orientation": _named("xyzw", reading.quaternion),
        "orientation_covariance": [0.0] * 9,
        "angular_velocity": _named("xyz", reading.angular_velocity),
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": _named("xyz", reading.specific_force),
        "linear_acceleration_covariance": [0.0] * 9,
    }


def odometry(
    q: Array,
    v: Array,
    time: float,
    *,
    pose_covariance: Array | None = None,
    twist_covariance: Array | None = None,
    frame: str = "odom",
    child: str = "base",
) -> dict[str, Any]:
    """Return a state's base as ``nav_msgs/Odometry``; its twist is in the base's axes, as v[:6].

    ``q``, ``v``: configuration (nq,) and velocity (nv,).
    ``pose_covariance``, ``twist_covariance``: (6, 6), linear first; zeros, which mean unknown, if
    None.

    Raises InvalidInputError: a covariance of another shape.
    """
    return {
        "header": {"stamp": stamp(time), "frame_id": frame},
        "child_frame_id": child,
        "pose": {
            "pose": {"position": _named("xyz", q[:3]), "orientation": _named("xyzw", q[3:7])},
            "covariance": _flat("pose_covariance", pose_covariance),
        },
        "twist": {
            "twist": {"linear": _named("xyz", v[:3]), "angular": _named("xyz", v[3:6])},
            "covariance": _flat("twist_covariance", twist_covariance),
        },
    }


def state_of(robot: Robot, joints: Any, base: Any) -> tuple[Array, Array]:
    """Return configuration (nq,) and velocity (nv,) of a ``JointState`` and an ``Odometry``.

    Both are dictionaries as above, or ROS messages. Joints, and the entries of a vector, may come
    in any order; other joints are ignored.
    """
    names, rows = list(_field(joints, "JointState", "name")), list[Array]()
    places, times = {name: k for k, name in enumerate(names)}, Counter(names)
    for what, wrong in (
        ("no joint", [name for name in robot.joint_names if not times[name]]),
        ("twice", [name for name in robot.joint_names if times[name] > 1]),
    ):
        if wrong:
            raise InvalidInputError(f"JointState: {what} {listed(wrong)} of {robot.name}")
    order = [places[name] for name in robot.joint_names]
    for key in ("position", "velocity"):
        row = _field(joints, "JointState", key)
        if len(row) != len(names):  # ROS allows none
            raise InvalidInputError(f"JointState, {key}: {len(row)} numbers of {len(names)} joints")
        one = [row[k] for k in order]
        rows.append(finite_array(f"JointState, {key}", one, (len(order),)))
    pose, twist = (_field(base, "Odometry", one, one) for one in ("pose", "twist"))
    parts = (pose, "position", "xyz"), (pose, "orientation", "xyzw")
    moving = (twist, "linear", "xyz"), (twist, "angular", "xyz")
    at, rate = ([_read(*part) for part in one] for one in (parts, moving))
    q = configuration(robot, np.concatenate(at), rows[0])
    return q, np.concatenate((*rate, rows[1]))


def _field(message: Any, what: str, *path: str) -> Any:
    """Return a field of a dictionary or message, by the names that lead there."""
    for name in path:
        found = message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)
        if found is None:
            raise InvalidInputError(f"{what}: no {name}, got {shown(message)}")
        message = found
    return message


def _read(fields: Any, name: str, entries: str) -> Array:
    vector = _field(fields, "Odometry", name)
    values = [_field(vector, f"Odometry, {name}", entry) for entry in entries]
    return finite_array(f"Odometry, {name}", values, (len(entries),))


def fill(message: Any, fields: Mapping[str, Any]) -> Any:
    """Write fields into a message object, nested ones into its parts; return it."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def _named(names: str, values: Array) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _flat(what: str, covariance: Array | None) -> list[float]:
    if covariance is None:
        return [0.0] * ROWS**2
    return finite_array(f"odometry, {what}", covariance, (ROWS, ROWS)).ravel().tolist()
