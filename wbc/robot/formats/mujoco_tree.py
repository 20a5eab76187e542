"""The kinematic tree of a compiled MuJoCo model as Pinocchio's: same q, same frames, same masses.

A joint's coordinate is MuJoCo's ``qpos``, which is ``ref`` where the file draws the robot: joints
are placed so that q means the same. A body with several joints is a chain of them whose inner
links weigh nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.robot.formats.mujoco_part import RobotPart
from wbc.rotations import exp_rotation
from wbc.validate import Array

ROOT, MOUNT = "root_joint", "mount"
_AXES = {
    ("hinge", 0): pin.JointModelRX,
    ("hinge", 1): pin.JointModelRY,
    ("hinge", 2): pin.JointModelRZ,
    ("slide", 0): pin.JointModelPX,
    ("slide", 1): pin.JointModelPY,
    ("slide", 2): pin.JointModelPZ,
}


def pose_of(position: Array, quaternion: Array) -> pin.SE3:
    """Return a pose from MuJoCo's position and quaternion (w, x, y, z)."""
    w, x, y, z = (float(part) for part in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position))


def base_of(part: RobotPart) -> pin.SE3:
    """Return where the file puts the floating base, or the root that is fixed."""
    if is_mounted(part):
        return pin.SE3.Identity()
    root = part.roots[0]
    return pose_of(part.model.body_pos[root], part.model.body_quat[root])


def is_mounted(part: RobotPart) -> bool:
    """Whether the roots move themselves, so that a fixed body is put above them."""
    moved = {int(part.model.jnt_bodyid[joint]) for joint in part.joints}
    return len(part.roots) > 1 or bool(moved & {*part.roots})


def build_tree(part: RobotPart) -> pin.Model:
    """Return the robot's part of a compiled model, with a free-flyer at its root.

    Joint limits, friction and motors are left out (see
    :mod:`wbc.robot.formats.mujoco_drives`), the geometry too.
    """
    tree, model, names = pin.Model(), part.model, part.names
    gravity = np.array(model.opt.gravity)
    if int(model.opt.disableflags) & int(part.mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        gravity[:] = 0.0
    tree.gravity = pin.Motion(gravity, np.zeros(3))
    root = tree.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), ROOT)
    at: dict[int, tuple[int, int, pin.SE3]] = {}  # body to joint, frame, and its pose in the joint
    mounted = is_mounted(part)
    frame = tree.addJointFrame(root)
    if mounted:
        free = MOUNT if MOUNT not in names.bodies else f"{MOUNT}_of_{names.bodies[part.roots[0]]}"
        frame = _add_frame(tree, free, root, frame, pin.SE3.Identity())
    joints: dict[int, list[int]] = {}
    for joint in part.joints:
        joints.setdefault(int(model.jnt_bodyid[joint]), []).append(joint)
    for body in part.bodies:
        if body in part.roots:
            carrier, above, pose = root, frame, pin.SE3.Identity()
            if mounted:
                pose = pose_of(model.body_pos[body], model.body_quat[body])
        else:
            carrier, above, pose = at[int(model.body_parentid[body])]
            pose = pose * pose_of(model.body_pos[body], model.body_quat[body])
        own = joints.get(body, [])
        for joint in own:
            carrier, above, pose = _add_joint(part, tree, joint, carrier, above, pose)
            if joint != own[-1]:
                inner = f"{names.bodies[body]}:{names.joints[joint]}"
                above = _add_frame(tree, inner, carrier, above, pose)
        above = _add_frame(tree, names.bodies[body], carrier, above, pose)
        tree.appendBodyToJoint(carrier, _inertia(model, body), pose)
        at[body] = carrier, above, pose
    for site in range(model.nsite):
        found = at.get(int(model.site_bodyid[site]))
        if found is not None and names.sites[site]:
            carrier, above, pose = found
            pose = pose * pose_of(model.site_pos[site], model.site_quat[site])
            kind = pin.FrameType.OP_FRAME
            tree.addFrame(pin.Frame(names.sites[site], carrier, above, pose, kind), False)
    return tree


def _add_frame(tree: pin.Model, name: str, joint: int, above: int, pose: pin.SE3) -> int:
    return int(tree.addFrame(pin.Frame(name, joint, above, pose, pin.FrameType.BODY), False))


def _add_joint(
    part: RobotPart, tree: pin.Model, joint: int, carrier: int, above: int, pose: pin.SE3
) -> tuple[int, int, pin.SE3]:
    """Add a joint of a body that is at ``pose`` in ``carrier``, below the frame ``above``.

    Return what carries the body then: joint, frame, and its pose in the joint.
    """
    model, kind = part.model, part.kind_of(joint)
    ref = float(model.qpos0[part.start_of(joint)])
    axis, anchor = np.array(model.jnt_axis[joint]), np.array(model.jnt_pos[joint])
    if kind == "slide":
        moved, anchor = pin.SE3(np.eye(3), -ref * axis), np.zeros(3)
    else:
        turned = exp_rotation(-ref * axis) if kind == "hinge" else np.eye(3)
        moved = pin.SE3(turned, np.zeros(3))
    there = pin.SE3(np.eye(3), anchor)
    placed, name = pose * there * moved, part.names.joints[joint]
    index = tree.addJoint(carrier, _joint_model(kind, axis), placed, name)
    return index, int(tree.addJointFrame(index, above)), there.inverse()


def _joint_model(kind: str, axis: Array) -> Any:
    if kind == "ball":
        return pin.JointModelSpherical()
    k = int(np.abs(axis).argmax())
    if np.array_equal(axis, np.eye(3)[k]):
        return _AXES[kind, k]()
    turns = kind == "hinge"
    return (pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned)(axis)


def _inertia(model: Any, body: int) -> pin.Inertia:
    """Return a body's inertia in its frame, from mass, centre and principal moments."""
    principal = pose_of(model.body_ipos[body], model.body_iquat[body])
    R, moments = principal.rotation, np.array(model.body_inertia[body])
    spread = R @ np.diag(moments) @ R.T
    return pin.Inertia(
        float(model.body_mass[body]), principal.translation, 0.5 * (spread + spread.T)
    )


def key_frames(part: RobotPart) -> Mapping[str, Any]:
    """Return the key frames by name: joint to its coordinates in q."""
    model = part.model
    states, data = {}, part.mujoco.MjData(model)
    for key, name in enumerate(part.names.keys):
        q = np.array(model.key_qpos[key])
        state: dict[str, tuple[float, ...]] = {}
        if part.floats:
            start = part.start_of(part.root_joint)
            part.mujoco.mju_normalize4(q[start + 3 : start + 7])  # of nothing, as it was drawn
            w, x, y, z = q[start + 3 : start + 7].tolist()
            state[ROOT] = (*q[start : start + 3].tolist(), x, y, z, w)
        if part.floating_joints:  # six joints, which place the root together
            data.qpos[:] = q
            part.mujoco.mj_kinematics(model, data)
            w, x, y, z = data.xquat[part.roots[0]].tolist()
            state[ROOT] = (*data.xpos[part.roots[0]].tolist(), x, y, z, w)
        for joint in part.joints:
            if part.kind_of(joint) != "ball":
                state[part.names.joints[joint]] = (float(q[part.start_of(joint)]),)
        states[name] = state
    return states
