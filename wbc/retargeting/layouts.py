"""Files of a retargeted motion: wbc's own layout, and those that policy training reads.

``wbc`` (``.npz``)
    Everything; ``time`` and ``q`` make it a recorded motion, for ``wbc analyze``.
``tracking`` (``.npz``)
    What mjlab's ``csv_to_npz`` and BeyondMimic write: ``fps``, ``joint_pos``, ``joint_vel``,
    ``body_pos_w``, ``body_quat_w`` (w x y z), ``body_lin_vel_w``, ``body_ang_vel_w``; bodies are
    the base and the link behind each joint, in the order of the joints. ``joint_names`` and
    ``body_names`` say which; MuJoCo and PhysX number bodies each in their own way.
``unitree`` (``.csv``)
    Root x y z, quaternion x y z w, joint angles: one row a frame, no header, as in Unitree's
    retargeted LAFAN1 dataset (there 30 frames a second).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.files import write_arrays, write_text
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.series import state_series
from wbc.rotations import quaternion_from, same_sign
from wbc.validate import Array

OWN_ARRAYS = ("time", "q", "v", "acceleration", "contacts", "wrenches", "torque", "cop")
ENDINGS = {"wbc": ".npz", "tracking": ".npz", "unitree": ".csv"}


def check_layout(path: str | Path, layout: str) -> None:
    """Refuse a layout that does not exist, and a file with another extension."""
    if layout not in ENDINGS:
        raise UnknownNameError("layout of a motion", layout, ENDINGS)
    if Path(path).suffix.lower() != ENDINGS[layout]:
        others = ", ".join(f"{name}: {end}" for name, end in ENDINGS.items() if name != layout)
        raise InvalidInputError(
            f"{path}: the layout {layout!r} is written as {ENDINGS[layout]} ({others})"
        )


def save(motion: Any, path: str | Path, layout: str) -> None:
    """Write a :class:`wbc.Retargeted`; for errors see :meth:`wbc.Retargeted.save`."""
    check_layout(path, layout)
    writers = {"wbc": _save_own, "tracking": _save_tracking, "unitree": _save_unitree}
    writers[layout](motion, path)


def _save_own(motion: Any, path: str | Path) -> None:
    summary = {
        "format": "wbc retargeted motion 1",
        "robot": motion.robot.name,
        "source": motion.source,
        "scale": {name: float(value) for name, value in vars(motion.scale).items()},
        "reached": [vars(one) for one in motion.reached],
        "unbalanced": [vars(one) for one in motion.unbalanced],
        "broken": [vars(one) for one in motion.broken],
        "notes": list(motion.notes),
    }
    names, targets = motion.robot.joint_names, motion.targets
    arrays = {
        "summary": np.array(json.dumps(summary, indent=2, allow_nan=False)),
        "joint_names": np.array(names, dtype=str),
        "feet": np.array(["left", "right"], dtype=str),
        **{name: getattr(motion, name) for name in OWN_ARRAYS},
        **{name: getattr(motion.whole, name) for name in ("com", "momentum", "inertia")},
        "human_com": targets.human_com,
        "human_angular_momentum": targets.angular_momentum,
        "human_inertia": targets.inertia,
    }
    write_arrays(path, arrays)


def _save_tracking(motion: Any, path: str | Path) -> None:
    names, place, quaternion, velocity, omega = bodies(motion.robot, motion.q, motion.v)
    arrays = {
        "fps": np.array([motion.rate]),
        "joint_pos": _angles(motion),
        "joint_vel": motion.v[:, BASE_NV:],
        "body_pos_w": place,
        "body_quat_w": quaternion,
        "body_lin_vel_w": velocity,
        "body_ang_vel_w": omega,
    }
    texts = {
        "joint_names": np.array(motion.robot.joint_names, dtype=str),
        "body_names": np.array(names, dtype=str),
    }
    write_arrays(path, {name: one.astype(np.float32) for name, one in arrays.items()} | texts)


def _save_unitree(motion: Any, path: str | Path) -> None:
    rows = np.hstack((motion.q[:, :BASE_NQ], _angles(motion)))
    write_text(path, "".join(",".join(f"{v:.6f}" for v in row) + "\n" for row in rows.tolist()))


def _angles(motion: Any) -> Array:
    """Return the joints' positions (n, nv - 6) [rad or m]."""
    return np.asarray(motion.robot.limits.joint_positions(motion.q))


def bodies(robot: Robot, q: Array, v: Array) -> tuple[tuple[str, ...], Array, Array, Array, Array]:
    """Return names, poses and velocities of the base and of the links behind the joints.

    Returns
    -------
    tuple
        Names (b,), positions of the links' origins (n, b, 3) [m], quaternions w x y z (n, b, 4),
        velocities of the origins and angular velocities (n, b, 3), world axes.
    """
    model = robot.model
    names = list[str]()
    for joint in range(1, model.njoints):
        own = [f for f in model.frames if f.parentJoint == joint and "BODY" in str(f.type)]
        at = [f for f in own if f.placement.isIdentity(1e-9)] or own
        names.append(str(at[0].name if at else model.names[joint]))
    states = state_series(robot, q, v, names)
    place = np.stack([states.position(name) for name in names], axis=1)
    quaternion = np.stack(
        [same_sign(np.array([quaternion_from(R) for R in states.rotation(f)])) for f in names],
        axis=1,
    )
    twist = np.stack([(states.jacobian(name) @ v[..., None])[..., 0] for name in names], axis=1)
    return tuple(names), place, quaternion[..., [3, 0, 1, 2]], twist[..., :3], twist[..., 3:]
