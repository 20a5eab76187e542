"""Read MJCF, or what MuJoCo made of it: the robot is made from the compiled model."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.robot.formats.description import Coupling, Description, check_joint_count
from wbc.robot.formats.mjcf_compile import compile_mjcf
from wbc.robot.formats.mujoco_check import confirm_against
from wbc.robot.formats.mujoco_drives import drive_notes, passive_forces, set_joints
from wbc.robot.formats.mujoco_part import Names, RobotPart, robot_part
from wbc.robot.formats.mujoco_shapes import read_shapes
from wbc.robot.formats.mujoco_tree import base_of, build_tree, is_mounted, key_frames
from wbc.robot.formats.xml import LARGEST, LARGEST_GEAR
from wbc.robot.passive import PassiveForces

STANDARD_GRAVITY = (0.0, 0.0, -9.81)


def read_mjcf(source: Any, path: Path, root: ET.Element | None = None) -> Description:
    """Return the description of one robot; a free joint is given to it if the file has none.

    Parameters
    ----------
    source, path, root:
        See :func:`wbc.robot.formats.mjcf_compile.compile_mjcf`.

    Raises
    ------
    MissingPackageError
        MuJoCo is not installed.
    ModelError
        What MuJoCo refuses, several trees, closed loops, numbers beyond any robot's, or a robot
        that is not the compiled model's in frames, masses, ranges or mass matrix.
    """
    compiled = compile_mjcf(source, path, root)
    mujoco, model = compiled.mujoco, compiled.model
    names = Names(mujoco, model)
    part = robot_part(mujoco, model, names, path)
    check_joint_count(len(part.joints), path)
    _check_sizes(model, part, names, path)
    tree = build_tree(mujoco, model, part, names)
    set_joints(mujoco, model, part, names, tree)
    base = base_of(model, part)
    confirm_against(mujoco, model, part, names, tree, path)
    geometry, shape_notes = read_shapes(mujoco, model, part, names, compiled.lost)
    x, y, z, w = pin.Quaternion(base.rotation).coeffs()
    passive = passive_forces(mujoco, model, part, names)
    return Description(
        name=compiled.name,
        path=path,
        model=tree,
        geometry=geometry,
        coupled=dict(_couplings(mujoco, model, part, names, path)),
        states=key_frames(mujoco, model, part, names),
        base=(*base.translation.tolist(), float(x), float(y), float(z), float(w)),
        bolted=None if part.floats or part.loose else "the root has no free joint",
        mounted=is_mounted(model, part),
        notes=part.notes
        + compiled.notes
        + shape_notes
        + drive_notes(mujoco, model, part, names)
        + _other_notes(names, part, model, tree, passive),
        passive=passive,
    )


def _check_sizes(model: Any, part: RobotPart, names: Names, path: Path) -> None:
    """Refuse lengths, masses and inertias whose products overflow."""
    bodies, joints = list(part.bodies), list(part.joints)
    for what, values, owners in (
        ("pos", model.body_pos, bodies),
        ("inertial pos", model.body_ipos, bodies),
        ("mass", model.body_mass, bodies),
        ("inertia", model.body_inertia, bodies),
        ("joint pos", model.jnt_pos, joints),
    ):
        for k in owners:
            if not np.all(np.abs(values[k]) <= LARGEST):  # NaN is not
                body = names.bodies[k if owners is bodies else int(model.jnt_bodyid[k])]
                raise ModelError(f"{path}: body {body!r}: its {what} is larger than {LARGEST:g}")


def _other_notes(
    names: Names, part: RobotPart, model: Any, tree: pin.Model, passive: PassiveForces
) -> tuple[str, ...]:
    notes = []
    if passive.springs:
        notes.append(f"springs act on {listed(list(passive.springs))} (robot.passive_forces)")
    if passive.lifts:
        lifted = listed([lift.frame for lift in passive.lifts])
        notes.append(f"gravity is compensated on {lifted} (robot.passive_forces)")
        by_motors = [names.joints[joint] for joint in part.joints if model.jnt_actgravcomp[joint]]
        if by_motors:
            notes.append(
                f"what the motors of {listed(by_motors)} give for that does not count against"
                " their effort limits"
            )
    gravity = tuple(tree.gravity.linear.tolist())
    if gravity != STANDARD_GRAVITY:
        said = " ".join(f"{part:g}" for part in gravity)
        notes.append(f"gravity is the file's: {said} m/s^2")
    bodies = {names.bodies[body] for body in part.bodies}
    shared = [
        names.sites[site]
        for site in range(model.nsite)
        if int(model.site_bodyid[site]) in part.bodies and names.sites[site] in bodies
    ]
    if shared:
        notes.append(f"sites that share a body's name; it means the body: {', '.join(shared)}")
    return tuple(notes)


def _couplings(
    mujoco: Any, model: Any, part: RobotPart, names: Names, path: Path
) -> Iterator[tuple[str, Coupling]]:
    """Yield the joints that follow others; other constraints are refused while they act.

    MuJoCo's polynomial is of joint values measured from ``ref``, ours is not.
    """
    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY):
        return
    mine = {*part.joints}
    for number in range(model.neq):
        if not model.eq_active0[number]:
            continue
        kind = mujoco.mjtEq(int(model.eq_type[number]))
        if kind != mujoco.mjtEq.mjEQ_JOINT:
            if _touches(mujoco, model, part, number):
                ties = kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
                what = "closed loops" if ties else "constraints of tendons and soft bodies"
                raise ModelError(
                    f"{path}: equality constraint <{kind.name[5:].lower()}"
                    f" name={names.equalities[number]!r}>: {what} are not supported;"
                    ' remove it and describe an open tree, or give it active="false"'
                )
            continue
        joint, driver = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if joint not in mine or not (driver < 0 or driver in mine):
            continue
        name = names.joints[joint]
        powers = model.eq_data[number][:5].tolist()
        if not np.all(np.abs(powers) <= LARGEST_GEAR):
            raise ModelError(
                f"{path}: equality constraint of joint {name!r}: <joint polycoef> is larger than"
                f" {LARGEST_GEAR:g}"
            )
        offset, ratio, *curved = powers
        offset += float(model.qpos0[model.jnt_qposadr[joint]])
        if driver < 0:
            yield name, Coupling("a constant", ratio, offset)
            continue
        followed = names.joints[driver]
        offset -= ratio * float(model.qpos0[model.jnt_qposadr[driver]])
        yield (
            name,
            Coupling(f"a polynomial of {followed}" if any(curved) else followed, ratio, offset),
        )


def _touches(mujoco: Any, model: Any, part: RobotPart, number: int) -> bool:
    """Return whether a constraint ties a body (or tendon) of the robot, and nothing beside it.

    One end may be on the world.
    """
    kinds = mujoco.mjtObj
    ends = {int(model.eq_obj1id[number]), int(model.eq_obj2id[number])}
    kind = int(model.eq_objtype[number])
    if kind == kinds.mjOBJ_SITE:
        ends = {int(model.site_bodyid[site]) for site in ends}
    elif kind != kinds.mjOBJ_BODY:
        return True
    known = {0, *part.bodies}
    return ends <= known and ends != {0}
