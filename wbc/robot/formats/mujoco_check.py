"""Comparison of a robot with its compiled MuJoCo model at three postures, when loading."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.formats.mujoco_part import RobotPart
from wbc.robot.formats.mujoco_tree import ROOT, base_of
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

# Of lengths, masses and the mass matrix, relative to the robot's; rounding leaves 1e-14.
AGREEMENT = 1e-9
SEED = 0


def compare_with_mujoco(part: RobotPart, tree: pin.Model) -> None:
    """Compare frames, masses, ranges and mass matrices with MuJoCo's own.

    The postures are the one that the file draws, the one of zeros, and a random one.

    Raises ModelError: they disagree: the message names the frame, joint or body.
    """
    if any(part.kind_of(joint) == "ball" for joint in part.joints):
        return  # refused by its name later
    _compare_masses(part, tree)
    compare_ranges(part, tree)
    compare_motion(part, tree, base_of(part))


def compare_motion(part: RobotPart, tree: pin.Model, base: pin.SE3) -> None:
    """Compare frames and mass matrices at three postures.

    ``base``: where the tree's base is, unless it floats in both.

    Raises ModelError: see :func:`compare_with_mujoco`.
    """
    mujoco, model = part.mujoco, part.model
    data, ours = mujoco.MjData(model), tree.createData()
    for q in _postures(part):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        _make_mass_matrix(mujoco, model, data)
        here = configuration(part, tree, q, base)
        pin.framesForwardKinematics(tree, ours, here)
        _compare_frames(part, tree, data, ours)
        _compare_inertia(part, tree, data, ours, here)


def _make_mass_matrix(mujoco: Any, model: Any, data: Any) -> None:
    if hasattr(mujoco, "mj_tendon"):  # whose rotors are in the mass matrix of newer MuJoCo
        mujoco.mj_tendon(model, data)
    (mujoco.mj_makeM if hasattr(mujoco, "mj_makeM") else mujoco.mj_crb)(model, data)


def _postures(part: RobotPart) -> Iterator[Array]:
    """Yield three configurations (nq,) of MuJoCo's."""
    drawn = np.array(part.model.qpos0)
    rng = np.random.default_rng(SEED)
    addresses = [part.start_of(joint) for joint in part.joints]
    for values in (drawn[addresses], np.zeros(len(addresses)), rng.uniform(-1, 1, len(addresses))):
        q = drawn.copy()
        q[addresses] = values
        yield q
        if part.floats:  # turned at the second and third
            start = part.start_of(part.root_joint)
            quaternion = rng.standard_normal(4)
            drawn[start : start + 3] += rng.uniform(-1, 1, 3)
            drawn[start + 3 : start + 7] = quaternion / np.linalg.norm(quaternion)


def configuration(part: RobotPart, tree: pin.Model, q: Array, base: pin.SE3) -> Array:
    """Return MuJoCo's configuration as the tree's (nq,)."""
    here = pin.neutral(tree)
    if part.floats:
        start = part.start_of(part.root_joint)
        here[:3] = q[start : start + 3]
        here[3:7] = q[start + 4], q[start + 5], q[start + 6], q[start + 3]
    else:
        here[:3], here[3:7] = base.translation, pin.Quaternion(base.rotation).coeffs()
    for joint in part.joints:
        index = tree.getJointId(part.names.joints[joint])
        value, at = float(q[part.start_of(joint)]), int(tree.idx_qs[index])
        here[at] = value
        if tree.nqs[index] == 2:
            here[at : at + 2] = np.cos(value), np.sin(value)
    return here


def _compare_masses(part: RobotPart, tree: pin.Model) -> None:
    model = part.model
    below = np.array(model.body_mass)  # body_subtreemass is stale once a mass was changed
    for body in range(model.nbody - 1, 0, -1):
        below[model.body_parentid[body]] += below[body]
    total = float(sum(below[root] for root in part.roots))
    read = float(pin.computeTotalMass(tree))
    if not abs(read - total) <= AGREEMENT * abs(total):
        raise _disagreement(part.path, "mass", f"{read:g} kg", f"{total:g} kg")
    data = tree.createData()
    pin.computeSubtreeMasses(tree, data)
    for joint in part.joints:
        name, carried = part.names.joints[joint], float(below[int(model.jnt_bodyid[joint])])
        found = float(data.mass[tree.getJointId(name)])
        if not abs(found - carried) <= AGREEMENT * abs(total):
            what = f"what joint {name!r} carries"
            raise _disagreement(part.path, what, f"{found:g} kg", f"{carried:g} kg")


def compare_ranges(part: RobotPart, tree: pin.Model) -> None:
    """Compare the ranges of the joints that have one.

    Raises ModelError: see :func:`compare_with_mujoco`.
    """
    for joint in part.joints:
        name = part.names.joints[joint]
        index = tree.getJointId(name)
        if tree.nqs[index] != 1 or not part.model.jnt_limited[joint]:
            continue
        q, wanted = int(tree.idx_qs[index]), part.model.jnt_range[joint]
        found = np.array((tree.lowerPositionLimit[q], tree.upperPositionLimit[q]))
        if not np.allclose(found, wanted, rtol=1e-9, atol=1e-12):
            raise _disagreement(part.path, f"the range of joint {name!r}", str(found), str(wanted))


def _compare_frames(part: RobotPart, tree: pin.Model, data: Any, ours: pin.Data) -> None:
    mine, names, model = {*part.bodies}, part.names, part.model
    places = np.array([data.xpos[body] for body in part.bodies])
    size = 1.0 + float(np.abs(places).max())
    wanted = [
        (names.bodies[body], pin.FrameType.BODY, data.xpos[body], data.xmat[body])
        for body in part.bodies
    ]
    wanted += [
        (names.sites[site], pin.FrameType.OP_FRAME, data.site_xpos[site], data.site_xmat[site])
        for site in range(model.nsite)
        if int(model.site_bodyid[site]) in mine and names.sites[site]
    ]
    for name, kind, position, turned in wanted:
        pose = ours.oMf[tree.getFrameId(name, kind)]
        off = float(np.abs(pose.translation - position).max())
        tilt = float(np.abs(pose.rotation - np.reshape(turned, (3, 3))).max())
        if not max(off / size, tilt) <= AGREEMENT:
            found = f"{off:.3g} m, {tilt:.3g} rad off"
            raise _disagreement(part.path, f"frame {name!r}", found, "0")


def _compare_inertia(part: RobotPart, tree: pin.Model, data: Any, ours: pin.Data, q: Array) -> None:
    M, model = pin.crba(tree, ours, q), part.model
    labels = [part.names.joints[joint] for joint in part.joints]
    rates = [int(tree.idx_vs[tree.getJointId(name)]) for name in labels]
    dofs = [int(model.jnt_dofadr[joint]) for joint in part.joints]
    if part.floats:  # MuJoCo's base moves along the world's axes, and turns about its own
        start = int(model.jnt_dofadr[part.root_joint])
        dofs = [*range(start, start + BASE_NV), *dofs]
        rates = [*range(BASE_NV), *rates]
        labels = [ROOT] * BASE_NV + labels
        R = pin.Quaternion(q[3:7]).matrix()
        M[:3] = R @ M[:3]
        M[:, :3] = M[:, :3] @ R.T
    if not dofs:
        return
    wanted, row = np.zeros((len(dofs), len(dofs))), np.zeros(model.nv)
    for k, dof in enumerate(dofs):
        unit = np.zeros(model.nv)
        unit[dof] = 1.0
        part.mujoco.mj_mulM(model, data, row, unit)
        wanted[k] = row[dofs]
        if labels[k] == ROOT:
            wanted[k, k] -= model.dof_armature[dof]  # of no motor; a note says so
    off = np.abs(M[np.ix_(rates, rates)] - wanted)
    if not float(off.max()) <= AGREEMENT * max(1.0, float(np.abs(wanted).max())):
        a, b = np.unravel_index(int(np.argmax(off)), off.shape)
        what = f"the mass matrix at {labels[int(a)]!r}, {labels[int(b)]!r}"
        found = float(M[rates[int(a)], rates[int(b)]])
        raise _disagreement(part.path, what, f"{found:.9g}", f"{wanted[a, b]:.9g}")


def _disagreement(path: Path, what: str, found: str, wanted: str) -> ModelError:
    return ModelError(
        f"{path}: {what}: {found} here, but MuJoCo has {wanted}; the file uses what is not read"
        " here, and is refused"
    )
