"""Comparison of Pinocchio's and MuJoCo's reading of a URDF, if MuJoCo can read it."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.extras import installed, quietly
from wbc.robot.formats.mujoco_check import compare_motion, compare_ranges
from wbc.robot.formats.mujoco_part import Names, RobotPart

TEST_ROBOT = """<robot name="tried"><link name="base"/><link name="l"><inertial>
<origin xyz=".3 .2 .1" rpy=".1 .2 .3"/><mass value="2"/><inertia ixx=".02" ixy=".001" ixz="-.002"
iyy=".03" iyz=".003" izz=".025"/></inertial></link><joint name="j" type="continuous">
<parent link="base"/><child link="l"/><axis xyz="0 0 1"/></joint></robot>"""
SETTINGS = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}


def confirm_by_mujoco(root: ET.Element, tree: pin.Model, path: Path) -> None:
    """Compare frames, ranges and mass matrices of both parsers' models.

    MuJoCo cannot read all that Pinocchio can: moving links without mass, impossible inertias, and
    quaternions. Such files are not compared.

    Raises ModelError: they disagree: the message names the frame or joint.
    """
    if not installed("mujoco") or root.find(".//origin[@quat_xyzw]") is not None:
        return
    import mujoco

    with quietly(mujoco), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not _reads_turned_inertias():
            return
        try:
            model = mujoco.MjModel.from_xml_string(_without_shapes(root))
        except (ValueError, RuntimeError, mujoco.FatalError):
            return
    names, bodies = Names(mujoco, model), tuple(range(1, model.nbody))
    part = RobotPart(mujoco, model, names, path, (), bodies, tuple(range(model.njnt)))
    known = {str(frame.name) for frame in tree.frames if frame.type == pin.FrameType.BODY}
    single = all(part.kind_of(joint) in ("hinge", "slide") for joint in part.joints)
    if not single or not known >= {names.bodies[body] for body in bodies}:
        return
    compare_ranges(part, tree)
    compare_motion(part, tree, pin.SE3.Identity())


@cache
def _reads_turned_inertias() -> bool:
    """Return whether MuJoCo reads inertias in rotated axes correctly; version 3.3.1 does not.

    Tested with one link on a joint along z, by rotating its inertia and the parallel-axis theorem.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(TEST_ROBOT)
    moments = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.025]])
    R, com, mass = pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.3, 0.2, 0.1]), 2.0
    about = R @ moments @ R.T + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return bool(abs(model.dof_M0[0] - about[2, 2]) < 1e-9)


def _without_shapes(root: ET.Element) -> str:
    """Return the document with links, inertias and joints only: no file is looked for."""
    plain = ET.Element("robot", {"name": root.get("name", "robot")})
    ET.SubElement(ET.SubElement(plain, "mujoco"), "compiler", SETTINGS)
    for link in root.findall("link"):
        kept = ET.SubElement(plain, "link", {"name": link.get("name", "")})
        kept.extend(link.findall("inertial"))
    for joint in root.findall("joint"):
        kept = ET.SubElement(plain, "joint", joint.attrib)
        kept.extend(
            part for part in joint if part.tag in ("parent", "child", "origin", "axis", "limit")
        )
    return ET.tostring(plain, encoding="unicode")
