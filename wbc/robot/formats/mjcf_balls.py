"""Ball joints of an MJCF are replaced by three hinges each, about x, y and z in turn.

Joints have one coordinate each here. For small angles, as of a rod's end, three hinges move like a
ball joint; they are singular where the second one is at 90 degrees. MuJoCo's specification is
changed, so that all later comparisons with MuJoCo use the compiled result.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.robot.notes import noted
from wbc.rotations import rotation_from
from wbc.validate import Array

COPIED = (
    *("pos", "damping", "armature", "frictionloss", "stiffness", "limited", "actgravcomp"),
    "springyield",  # newer MuJoCo's
)
# What a class may give hinges, and no ball heeds.
OF_HINGES = {"ref": 0.0, "springref": 0.0, "springdamper": (0.0, 0.0), "actfrclimited": 0}


def without_balls(mujoco: Any, spec: Any, model: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the compiled model with hinges for balls, and a note; ``model`` if there are none.

    Balls that let the root float, together with three slides, are kept; so are those with further
    joints on their body, which are refused later.

    ``spec``: what ``model`` was compiled from; it is changed.
    """
    balls = [
        (body, joint)
        for body in spec.bodies
        for joint in list(body.joints)[-1:]
        if int(joint.type) == int(mujoco.mjtJoint.mjJNT_BALL) and len(list(body.joints)) < 4
    ]
    if not balls:
        return model, ()
    ids = [int(joint.id) for _, joint in balls]  # which change as joints are added
    kept = [_key_coordinates(mujoco, model, {*ids}, key) for key in range(model.nkey)]
    names, wider = [], []
    for (body, joint), k in zip(balls, ids, strict=True):
        names.append(str(joint.name) or f"{body.name}_joint")
        reach = float(model.jnt_range[k, 1])
        if model.jnt_limited[k] and 0.0 < reach < np.pi:
            wider.append(f"{names[-1]} by {_combined_angle(reach):.3g} rad, not {reach:.3g}")
        for letter, axis in zip("xyz", np.eye(3), strict=True):
            hinge = body.add_joint(name=f"{names[-1]}:{letter}", axis=axis)
            hinge.type = mujoco.mjtJoint.mjJNT_HINGE
            for name in COPIED:
                if hasattr(joint, name):
                    setattr(hinge, name, getattr(joint, name))
            for name, value in OF_HINGES.items():
                setattr(hinge, name, value)
            if any(joint.springdamper):  # from which the compiler made both
                hinge.stiffness = _with_first(joint.stiffness, model.jnt_stiffness[k])
                damping = model.dof_damping[model.jnt_dofadr[k]]
                hinge.damping = _with_first(joint.damping, damping)
            hinge.range = (-joint.range[1], joint.range[1])  # in the file's units
        delete_from(spec, joint)  # last: what it hands out are views of it
    motor_notes = _move_motors(mujoco, spec, names)
    for key, qpos in zip(spec.keys, kept, strict=True):
        key.qpos = qpos
    notes = noted(
        "ball joints are three hinges each, NAME:x, NAME:y and NAME:z in turn, singular where the"
        " second is at 90 degrees: {}",
        names,
    ) + noted(
        "the range of a ball's whole turn is that of each of its hinges here, which turn it by more"
        " together: {}",
        wider,
    )
    return spec.compile(), notes + motor_notes


def _with_first(coefficients: Any, value: float) -> Any:
    """Return coefficients, of which older MuJoCo has only the first, with another first one."""
    if np.ndim(coefficients) == 0:
        return value
    return np.append(value, coefficients[1:])


def _move_motors(mujoco: Any, spec: Any, balls: list[str]) -> tuple[str, ...]:
    """Let motors about one axis of a ball act on that hinge, and delete others; return notes."""
    kinds = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    whole_turns = getattr(mujoco.mjtGain, "mjGAIN_SO3", None)  # <orientation> of newer MuJoCo
    moved, lost = list[str](), list[str]()
    for motor in list(spec.actuators):
        ball, gear = str(motor.target), np.array(motor.gear)
        if int(motor.trntype) not in kinds or ball not in balls:
            continue
        about = np.flatnonzero(gear[:3] * (motor.gaintype != whole_turns))
        (moved if about.size == 1 else lost).append(str(motor.name) or f"one on {ball}")
        if about.size == 1:
            motor.target = f"{ball}:{'xyz'[about[0]]}"
            motor.gear = np.append(gear[about], np.zeros(5))
        else:
            delete_from(spec, motor)
    for key in spec.keys if lost else ():  # their numbers of controls changed; these are not read
        key.ctrl = key.act = np.zeros(0)
    return noted(
        "motors about an axis of a ball joint are those of its hinge about that axis: {}", moved
    ) + noted("motors about several axes of a ball joint are not read: {}", lost)


def _combined_angle(reach: float) -> float:
    """Return the rotation angle [rad] of hinges about x, y and z, each at ``reach``."""
    w = np.cos(0.5 * reach) ** 3 - np.sin(0.5 * reach) ** 3  # of the quaternion, at its least
    return float(2.0 * np.arccos(np.clip(w, 0.0, 1.0)))


def _key_coordinates(mujoco: Any, model: Any, balls: set[int], key: int) -> Array:
    """Return the coordinates of a key frame with three angles for each quaternion of ``balls``."""
    parts, q = [], np.array(model.key_qpos[key])
    sizes = {int(mujoco.mjtJoint.mjJNT_FREE): 7, int(mujoco.mjtJoint.mjJNT_BALL): 4}
    for joint in range(model.njnt):
        at = int(model.jnt_qposadr[joint])
        own = q[at : at + sizes.get(int(model.jnt_type[joint]), 1)]
        parts.append(hinge_angles(own) if joint in balls else own)
    return np.concatenate(parts)


def delete_from(spec: Any, element: Any) -> None:
    """Delete an element of a MuJoCo specification."""
    if hasattr(element, "delete"):  # before MuJoCo 3.4
        element.delete()
    else:
        spec.delete(element)


def hinge_angles(quaternion: Array) -> Array:
    """Return the angles (3,) of hinges about x, y, z in turn for a quaternion w x y z.

    These are a, b, c with R = Rx(a) Ry(b) Rz(c).
    """
    R = rotation_from(quaternion[[1, 2, 3, 0]] / np.linalg.norm(quaternion))
    return np.array(
        (
            np.arctan2(-R[1, 2], R[2, 2]),
            np.arctan2(R[0, 2], np.hypot(R[0, 0], R[0, 1])),
            np.arctan2(-R[0, 1], R[0, 0]),
        )
    )
