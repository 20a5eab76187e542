"""Read MJCF, or MuJoCo's objects: the robot is made from the compiled model."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.formats.description import Description, check_joint_count, refuse_reserved
from wbc.robot.formats.mjcf_compile import compile_mjcf
from wbc.robot.formats.mujoco_check import compare_with_mujoco
from wbc.robot.formats.mujoco_drives import (
    drive_notes,
    passive_forces,
    set_joints,
    unactuated_joints,
)
from wbc.robot.formats.mujoco_equalities import add_loops, couplings, initial_joints
from wbc.robot.formats.mujoco_part import RobotPart, robot_part
from wbc.robot.formats.mujoco_shapes import read_shapes
from wbc.robot.formats.mujoco_tree import base_of, build_tree, is_mounted, key_frames
from wbc.robot.formats.xml import LARGEST
from wbc.robot.notes import noted
from wbc.robot.passive import PassiveForces

# Numbers of a compiled model that nothing else compares; a file's are checked as text.
CHANGEABLE = (
    *("dof_damping", "dof_frictionloss", "jnt_stiffness", "qpos_spring", "qpos0", "key_qpos"),
    *("geom_size", "geom_pos", "geom_quat"),
)
STANDARD_GRAVITY = (0.0, 0.0, -9.81)


def read_mjcf(source: Any, path: Path, root: ET.Element | None = None) -> Description:
    """Return the description of one robot; a free joint is given to it if the file has none.

    ``source``, ``path``, ``root``: see :func:`wbc.robot.formats.mjcf_compile.compile_mjcf`.

    Raises MissingPackageError: MuJoCo is not installed; ModelError: what MuJoCo refuses, several
    trees, numbers beyond any robot's, or a robot that is not the compiled model's in frames,
    masses, ranges or mass matrix.
    """
    compiled = compile_mjcf(source, path, root)
    part = robot_part(compiled.mujoco, compiled.model, path)
    check_joint_count(len(part.joints), path)
    refuse_reserved((part.names.joints[joint] for joint in part.joints), path)
    _check_sizes(part)
    tree = build_tree(part)
    set_joints(part, tree)
    base = base_of(part)
    compare_with_mujoco(part, tree)
    geometry, shape_notes = read_shapes(part, compiled.missing_shapes)
    x, y, z, w = pin.Quaternion(base.rotation).coeffs()
    passive = passive_forces(part)
    coupled, tie_notes = couplings(part)
    held = [name for name, coupling in coupled.items() if coupling.is_constant]
    loops, on_world, loop_notes = add_loops(part, tree, base)
    return Description(
        name=compiled.name,
        path=path,
        model=tree,
        geometry=geometry,
        coupled=coupled,
        states=key_frames(part),
        base=(*base.translation.tolist(), float(x), float(y), float(z), float(w)),
        bolted=None if part.floats or part.floating_joints else "the root has no free joint",
        mounted=is_mounted(part),
        notes=part.notes
        + compiled.notes
        + shape_notes
        + loop_notes
        + tie_notes
        + noted("joints that constraints hold at a value, locked: {}", held)
        + drive_notes(part, bool(loops), coupled)
        + _other_notes(part, tree, passive),
        passive=passive,
        loops=loops,
        on_world=on_world,
        unactuated=unactuated_joints(part),
        drawn=initial_joints(part),
    )


def _check_sizes(part: RobotPart) -> None:
    """Refuse lengths, masses and inertias whose products overflow, and numbers that are none."""
    model, names, path = part.model, part.names, part.path
    changeable = {name: getattr(model, name) for name in CHANGEABLE}
    for name, values in {**changeable, "opt.gravity": model.opt.gravity}.items():
        if not np.isfinite(values).all():
            raise ModelError(f"{path}: {name} of the model is not finite; correct it")
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
                large = f"larger than {LARGEST:g}: correct its units, or the scale of its meshes"
                wrong = large if np.isfinite(values[k]).all() else "not finite"
                raise ModelError(f"{path}: body {body!r}: its {what} is {wrong}")
    for joint in joints:
        name, dof = names.joints[joint], int(model.jnt_dofadr[joint])
        for what, value in (
            ("damping", float(model.dof_damping[dof])),
            ("armature", float(model.dof_armature[dof])),
        ):
            if value < 0.0:  # MuJoCo takes it, and the joint speeds up by itself
                raise ModelError(f"{path}: joint {name!r}: negative {what} {value:g}; correct it")
        # Of an MjModel that was changed.
        low, high = model.jnt_range[joint].tolist()
        if model.jnt_limited[joint] and not low <= high:
            raise ModelError(f"{path}: joint {name!r}: its range is {low:g} to {high:g}")


def _other_notes(part: RobotPart, tree: pin.Model, passive: PassiveForces) -> tuple[str, ...]:
    names, model, lifted = part.names, part.model, [lift.frame for lift in passive.lifts]
    by_motors = [names.joints[joint] for joint in part.joints if model.jnt_actgravcomp[joint]]
    notes = noted("springs act on {} (robot.passive_forces)", passive.springs)
    yielding = getattr(model, "jnt_springyield", np.zeros(model.njnt))  # newer MuJoCo's
    given_way = [name for name in passive.springs if yielding[names.joints.index(name)]]
    notes += noted("springs that give way (springyield) are taken for elastic ones: {}", given_way)
    notes += noted("gravity is compensated on {} (robot.passive_forces)", lifted)
    notes += noted(
        "what the motors of {} give for that does not count against their effort limits",
        by_motors if lifted else (),
    )
    gravity = tuple(tree.gravity.linear.tolist())
    if gravity != STANDARD_GRAVITY:
        said = " ".join(f"{entry:g}" for entry in gravity)
        notes += (f"gravity is the file's: {said} m/s^2",)
    bodies = {names.bodies[body] for body in part.bodies}
    shared = [
        names.sites[site]
        for site in range(model.nsite)
        if int(model.site_bodyid[site]) in part.bodies and names.sites[site] in bodies
    ]
    told = "sites that share a body's name; it means the body: {}"
    return notes + noted(told, shared, len(shared))
