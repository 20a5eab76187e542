"""A human as a robot: a URDF of the body, for all functions that take a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.human.body import (
    ANKLE_HEIGHT,
    HINGE_NAMES,
    LIMIT,
    SEGMENTS,
    SIDES,
    SOLE_WIDTH,
    HumanBody,
    Mass,
    foot_ends,
    masses,
    origin_maps,
)
from wbc.human.kinematics import Poses
from wbc.kinds import check_kind
from wbc.robot import Robot
from wbc.robot.feet import FootSpec
from wbc.robot.limits import BASE_NQ
from wbc.robot.notes import without_warnings
from wbc.rotations import same_sign
from wbc.validate import Array

NAME = "human"
# Radii of capsules to draw, by the stature.
_RADII = {"thigh": 0.045, "shank": 0.03, "upper_arm": 0.027, "forearm": 0.022, "hand": 0.02}


@dataclass(frozen=True, eq=False)
class FittedSole:
    """The ground below a flat foot, in the foot's axes."""

    height: float  # of the foot's origin, the ankle, above the ground [m]
    # Rotation (3, 3) from the axes of the ground, z up and x forwards, to those of the foot.
    rotation: Array


def human_robot(
    body: HumanBody, soles: Mapping[str, FittedSole] | None = None, name: str = NAME
) -> Robot:
    """Return a human as a robot with 40 velocities.

    Hinges have the names and directions of ``wbc.human.body``; segments are links. Joints have no
    efforts and are not limited.

    Parameters
    ----------
    soles:
        By side (``left``, ``right``); by default those of usual proportions.

    Raises
    ------
    InvalidInputError
        ``body`` is no :class:`HumanBody`.
    """
    check_kind("human_robot, body", body, HumanBody)
    feet = {side: FootSpec(f"{side}_sole_link", _sole_polygon(body), 0.0) for side in SIDES}
    with without_warnings():
        return Robot.load(_urdf(body, soles or {}, name), feet=feet, base="floating", name=name)


def _sole_polygon(body: HumanBody) -> list[list[float]]:
    """Return the corners of a sole [m] about the point of the ground below the ankle."""
    heel, toe = foot_ends(body)
    half = 0.5 * SOLE_WIDTH * float(toe[0] - heel[0])
    back, front = float(heel[0]), float(toe[0])
    ball = back + 0.75 * (front - back)  # toes and heel are narrower
    right = [[back, -0.6 * half], [ball, -half], [front, -0.5 * half]]
    return right + [[x, -y] for x, y in reversed(right)]


def configurations(robot: Robot, poses: Poses) -> Array:
    """Return configurations (n, nq) of a human's robot from postures (n)."""
    q = np.empty((len(poses), robot.nq))
    q[:, :3] = poses.position
    q[:, 3:BASE_NQ] = same_sign(Rotation.from_matrix(poses.rotation).as_quat())
    q[:, BASE_NQ:] = poses.angles[:, hinge_order(robot)]
    return q


def hinge_order(robot: Robot) -> list[int]:
    """Return the index of the body's hinge for each joint of a human's robot."""
    return [HINGE_NAMES.index(name) for name in robot.joint_names]


def _urdf(body: HumanBody, soles: Mapping[str, FittedSole], name: str) -> str:
    root = ET.Element("robot", name=name)
    offsets, found = origin_maps() @ body.dimensions, masses(body)
    for k, segment in enumerate(SEGMENTS):
        link = ET.SubElement(root, "link", name=segment.name)
        _inertial(link, found[segment.name])
        _shape(link, segment.name, body, found[segment.name])
        if segment.parent < 0:
            continue
        parent, place = SEGMENTS[segment.parent].name, offsets[k]
        for number, hinge in enumerate(segment.hinges, 1):
            last = number == len(segment.hinges)
            child = segment.name if last else f"{hinge.name}_link"
            if not last:
                ET.SubElement(root, "link", name=child)
            _joint(root, hinge.name, "revolute", parent, child, place, hinge.axis)
            parent, place = child, np.zeros(3)
    usual_sole = FittedSole(ANKLE_HEIGHT * body.scale, np.eye(3))
    for side in SIDES:
        sole = soles.get(side, usual_sole)
        under = f"{side}_sole_link"
        ET.SubElement(root, "link", name=under)
        up = sole.rotation[:, 2]
        rpy = Rotation.from_matrix(sole.rotation).as_euler("xyz")
        _joint(root, f"{side}_sole", "fixed", f"{side}_foot", under, -sole.height * up, None, rpy)
    return ET.tostring(root, encoding="unicode")


def _joint(
    root: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    place: Array,
    axis: tuple[float, float, float] | None,
    rpy: Array | None = None,
) -> None:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "origin", xyz=_text(place), rpy=_text(np.zeros(3) if rpy is None else rpy))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    if axis is not None:
        ET.SubElement(joint, "axis", xyz=_text(np.array(axis)))
        bounds = {"lower": str(-LIMIT), "upper": str(LIMIT), "effort": "0", "velocity": "0"}
        ET.SubElement(joint, "limit", bounds)


def _inertial(link: ET.Element, mass: Mass) -> None:
    part = ET.SubElement(link, "inertial")
    ET.SubElement(part, "origin", xyz=_text(mass.centre))
    ET.SubElement(part, "mass", value=repr(float(mass.mass)))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = mass.inertia.tolist()
    entries = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    ET.SubElement(part, "inertia", {key: repr(value) for key, value in entries.items()})


def _shape(link: ET.Element, name: str, body: HumanBody, mass: Mass) -> None:
    """Add a box, sphere or capsule to draw; its size has no other use."""
    kind = name.partition("_")[2] if name.startswith(("left_", "right_")) else name
    heel, toe = foot_ends(body)
    boxes = {
        "pelvis": (0.11, 0.17, 0.11),
        "trunk": (0.12, 0.19, 0.26),
        "foot": (float(toe[0] - heel[0]) / body.stature, 0.05, 0.035),
    }
    at = mass.centre
    if kind in _RADII:
        length = 0.11 * body.stature if kind == "hand" else body.size(kind)
        radius = _RADII[kind] * body.stature
        at = np.array((0.0, 0.0, -0.5 * length))
        cylinder = max(length - radius, 0.2 * radius)
        shape, sizes = "capsule", {"radius": repr(radius), "length": repr(cylinder)}
    elif kind == "head":
        shape, sizes = "sphere", {"radius": repr(0.06 * body.stature)}
    else:
        shape, sizes = "box", {"size": _text(body.stature * np.array(boxes[kind]))}
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_text(at))
    ET.SubElement(ET.SubElement(visual, "geometry"), shape, sizes)


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
