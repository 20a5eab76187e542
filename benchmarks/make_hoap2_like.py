"""Generator of ``hoap2_like.urdf``, a small humanoid of the class of Fujitsu's HOAP-2.

Only the figures of the class are kept (25 joints, 7.1 kg, 0.50 m, the lengths of the leg, the size
of the sole, the joint ranges); shapes and masses are plain primitives chosen here.  A link's
inertia is that of its primitives taken as homogeneous solids, so what is drawn, what collides and
what moves are one and the same.  Write the URDF of the package with::

    python benchmarks/make_hoap2_like.py

Conventions: metres, kilograms, degrees in the tables (radians in the URDF).  In the zero posture
the robot stands straight, its arms hang, and every link frame has x forward, y left and z up.
A positive pitch turns about +y, a positive roll about +x and a positive yaw about +z, on both
sides.  Hence a limb flexes *forwards* by a negative shoulder, elbow or hip pitch, and the waist,
whose child is the pelvis because the floating base is the torso, bows forwards by a negative pitch.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vec3 = tuple[float, float, float]
URDF = Path(__file__).parents[1] / "wbc/robot/models/hoap2_like.urdf"

THIGH, SHANK, ANKLE_HEIGHT = 0.100, 0.100, 0.040  # hip-knee, knee-ankle, ankle-ground
HIP_SPACING = 0.078  # between the centres of the two hips
SOLE_LENGTH, SOLE_WIDTH, SOLE_FORWARD = 0.094, 0.062, 0.005  # last: sole's centre from the ankle
UPPER_ARM, FOREARM, HAND = 0.095, 0.080, 0.045  # shoulder-elbow, elbow-wrist, wrist-palm
VELOCITY_LIMIT, EFFORT_LIMIT = 5.0, 9.0  # rad/s, N m
AXES = {"roll": "1 0 0", "pitch": "0 1 0", "yaw": "0 0 1"}
COLOURS = {"shell": "0.88 0.88 0.90 1", "servo": "0.25 0.27 0.32 1", "visor": "0.10 0.35 0.65 1"}


class Box(NamedTuple):
    """Box centred on the origin; edges along x, y, z [m]."""

    x: float
    y: float
    z: float

    def moments(self) -> Array:
        """Principal moments of inertia about the centre, per unit mass [m^2]."""
        x2, y2, z2 = self.x**2, self.y**2, self.z**2
        return np.array([y2 + z2, z2 + x2, x2 + y2]) / 12


class Cylinder(NamedTuple):
    """Cylinder centred on the origin, axis along z [m]."""

    radius: float
    length: float

    def moments(self) -> Array:
        """Principal moments of inertia about the centre, per unit mass [m^2]."""
        across = self.radius**2 / 4 + self.length**2 / 12
        return np.array([across, across, self.radius**2 / 2])


class Sphere(NamedTuple):
    """Sphere centred on the origin [m]."""

    radius: float

    def moments(self) -> Array:
        """Principal moments of inertia about the centre, per unit mass [m^2]."""
        return np.full(3, 0.4 * self.radius**2)


class Part(NamedTuple):
    """A homogeneous solid placed in its link's frame."""

    solid: Box | Cylinder | Sphere
    mass: float  # kg
    xyz: Vec3 = (0.0, 0.0, 0.0)  # centre, m
    rpy: Vec3 = (0.0, 0.0, 0.0)  # orientation, degrees, Rz(yaw) Ry(pitch) Rx(roll)
    colour: str = "shell"

    def mirrored(self) -> "Part":
        """Return the image in the x-z plane."""
        (x, y, z), (r, p, w) = self.xyz, self.rpy
        return self._replace(xyz=(x, -y, z), rpy=(-r, p, -w))


class Joint(NamedTuple):
    """The revolute joint that carries a link; its frame is the link's."""

    name: str
    parent: str
    axis: Literal["roll", "pitch", "yaw"]
    xyz: Vec3  # in the parent's frame, m
    lower: float  # degrees
    upper: float

    def mirrored(self) -> "Joint":
        """Return the image in the x-z plane; it reverses the turns about x and z."""
        (x, y, z), turn = self.xyz, (self.lower, self.upper)
        lower, upper = turn if self.axis == "pitch" else (-turn[1], -turn[0])
        name, parent = other_side(self.name), other_side(self.parent)
        return Joint(name, parent, self.axis, (x, -y, z), lower, upper)


class Link(NamedTuple):
    """A rigid body, and the joint to its parent (none for the floating base)."""

    name: str
    joint: Joint | None
    parts: tuple[Part, ...]

    def mirrored(self) -> "Link":
        """Return the image in the x-z plane, named for the other side."""
        joint = self.joint and self.joint.mirrored()
        return Link(other_side(self.name), joint, tuple(part.mirrored() for part in self.parts))


class Frame(NamedTuple):
    """A massless frame fixed to a link."""

    name: str
    parent: str
    xyz: Vec3  # in the parent's frame, m

    def mirrored(self) -> "Frame":
        """Return the image in the x-z plane, named for the other side."""
        x, y, z = self.xyz
        return Frame(other_side(self.name), other_side(self.parent), (x, -y, z))


ALONG_Y, ALONG_X = (90.0, 0.0, 0.0), (0.0, 90.0, 0.0)  # turn a cylinder's axis from z

TRUNK = (
    Link("torso", None, (  # origin: in the middle of the chest, above the waist
        Part(Box(0.075, 0.120, 0.097), 2.05, (0.010, 0.0, 0.0035)),
        Part(Box(0.034, 0.096, 0.090), 0.85, (-0.043, 0.0, 0.004), colour="servo"),  # backpack
        Part(Box(0.031, 0.060, 0.030), 0.20, (0.0, 0.0, -0.050), colour="servo"),  # abdomen
    )),
    Link("pelvis", Joint("waist_pitch", "torso", "pitch", (0.0, 0.0, -0.065), -90, 1), (
        Part(Cylinder(0.014, 0.072), 0.12, rpy=ALONG_Y, colour="servo"),
        Part(Box(0.076, 0.110, 0.018), 0.33, (0.0, 0.0, -0.012)),
    )),
    Link("neck", Joint("head_yaw", "torso", "yaw", (0.0, 0.0, 0.052), -60, 60), (
        Part(Cylinder(0.013, 0.040), 0.05, (0.0, 0.0, 0.015), colour="servo"),
    )),
    Link("head", Joint("head_pitch", "neck", "pitch", (0.0, 0.0, 0.030), -15, 60), (
        Part(Sphere(0.036), 0.25, (0.0, 0.0, 0.022)),
        Part(Cylinder(0.012, 0.080), 0.04, (0.0, 0.0, 0.022), ALONG_Y, "servo"),  # ears
        Part(Box(0.014, 0.046, 0.016), 0.02, (0.031, 0.0, 0.024), colour="visor"),
    )),
)  # fmt: skip

# Where several axes meet in one point (hip, shoulder, ankle) the servos in between are small bodies
# of their own.  Neighbours overlap around their joint, as real ones do around a shaft; a link
# clears the next but one over the whole range of the two joints.
LEFT_LEG = (
    Link("left_hip_yaw_link", Joint(
        "left_hip_yaw", "pelvis", "yaw", (0.0, HIP_SPACING / 2, -0.055), -31, 91), (
        Part(Cylinder(0.018, 0.010), 0.09, (0.0, 0.0, 0.033), colour="servo"),
    )),
    Link("left_hip_roll_link", Joint(
        "left_hip_roll", "left_hip_yaw_link", "roll", (0.0, 0.0, 0.0), -21, 31), (
        Part(Box(0.036, 0.026, 0.053), 0.10, (0.0, 0.0, 0.0045), colour="servo"),
    )),
    Link("left_thigh", Joint(
        "left_hip_pitch", "left_hip_roll_link", "pitch", (0.0, 0.0, 0.0), -82, 71), (
        Part(Cylinder(0.018, 0.046), 0.09, rpy=ALONG_Y, colour="servo"),
        Part(Box(0.048, 0.044, 0.070), 0.295, (0.001, 0.0, -0.055)),
    )),
    Link("left_shank", Joint(
        "left_knee_pitch", "left_thigh", "pitch", (0.0, 0.0, -THIGH), -1, 130), (
        Part(Cylinder(0.017, 0.048), 0.09, rpy=ALONG_Y, colour="servo"),
        Part(Box(0.042, 0.042, 0.072), 0.15, (0.002, 0.0, -0.048)),
        Part(Cylinder(0.011, 0.044), 0.03, (0.0, 0.0, -SHANK), ALONG_Y, "servo"),
    )),
    Link("left_ankle_link", Joint(
        "left_ankle_pitch", "left_shank", "pitch", (0.0, 0.0, -SHANK), -61, 61), (
        Part(Box(0.030, 0.026, 0.042), 0.09, colour="servo"),
    )),
    Link("left_foot", Joint(
        "left_ankle_roll", "left_ankle_link", "roll", (0.0, 0.0, 0.0), -25, 25), (
        Part(Box(0.040, 0.020, 0.012), 0.03, (0.0, 0.0, -0.024), colour="servo"),
        Part(Box(SOLE_LENGTH, SOLE_WIDTH, 0.012), 0.12, (SOLE_FORWARD, 0.0, 0.006 - ANKLE_HEIGHT)),
    )),
)  # fmt: skip

LEFT_ARM = (
    Link("left_shoulder_pitch_link", Joint(
        "left_shoulder_pitch", "torso", "pitch", (0.0, 0.097, 0.036), -151, 91), (
        Part(Cylinder(0.017, 0.032), 0.10, (0.0, -0.026, 0.0), ALONG_Y, "servo"),
    )),
    Link("left_shoulder_roll_link", Joint(
        "left_shoulder_roll", "left_shoulder_pitch_link", "roll", (0.0, 0.0, 0.0), -2, 96), (
        Part(Cylinder(0.016, 0.030), 0.03, rpy=ALONG_X),
        Part(Box(0.030, 0.030, 0.044), 0.05),
    )),
    Link("left_upper_arm", Joint(
        "left_shoulder_yaw", "left_shoulder_roll_link", "yaw", (0.0, 0.0, 0.0), -91, 91), (
        Part(Box(0.032, 0.032, 0.065), 0.13, (0.0, 0.0, -0.0525)),
        Part(Cylinder(0.013, 0.034), 0.03, (0.0, 0.0, -UPPER_ARM), ALONG_Y, "servo"),
    )),
    Link("left_forearm", Joint(
        "left_elbow_pitch", "left_upper_arm", "pitch", (0.0, 0.0, -UPPER_ARM), -115, 0), (
        Part(Cylinder(0.013, 0.074), 0.12, (0.0, 0.0, -0.043)),
    )),
    # The class has one joint in the hand, which is a wrist pitch here so that it moves the palm.
    Link("left_hand_link", Joint(
        "left_hand", "left_forearm", "pitch", (0.0, 0.0, -FOREARM), -60, 60), (
        Part(Box(0.030, 0.020, 0.045), 0.04, (0.0, 0.0, 0.0225 - HAND), colour="servo"),
        Part(Box(0.012, 0.010, 0.026), 0.01, (0.017, -0.006, -0.020), colour="servo"),  # thumb
    )),
)  # fmt: skip

LEFT_FRAMES = (
    Frame("left_sole", "left_foot", (SOLE_FORWARD, 0.0, -ANKLE_HEIGHT)),
    Frame("left_palm", "left_hand_link", (0.0, 0.0, -HAND)),
)


def other_side(name: str) -> str:
    """Return the name of a left link or joint's image; names of the trunk are their own."""
    return name.replace("left_", "right_")


def links() -> tuple[Link, ...]:
    """Return every moving link, parents first."""
    left = LEFT_LEG + LEFT_ARM
    return TRUNK + left + tuple(link.mirrored() for link in left)


def frames() -> tuple[Frame, ...]:
    """Return every massless frame."""
    return LEFT_FRAMES + tuple(frame.mirrored() for frame in LEFT_FRAMES)


def rotation(rpy: Vec3) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), URDF's order, of angles in degrees."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in map(math.radians, rpy))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def inertial(parts: tuple[Part, ...]) -> tuple[float, Array, Array]:
    """Return the mass properties of a set of solids, overlaps counted twice.

    Returns
    -------
    mass : float
        Total mass [kg].
    com : (3,) array
        Centre of mass in the link's frame [m].
    inertia : (3, 3) array
        Rotational inertia about the centre of mass, along the link's axes [kg m^2].
    """
    mass = math.fsum(part.mass for part in parts)
    com = sum((part.mass * np.array(part.xyz) for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        turn, arm = rotation(part.rpy), np.array(part.xyz) - com
        inertia += part.mass * turn @ np.diag(part.solid.moments()) @ turn.T
        inertia += part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))  # parallel axes
    return mass, com, inertia


def text(*values: float) -> str:
    """Format numbers for an XML attribute; residues of rounding (and -0) become 0."""
    return " ".join(f"{value if abs(value) > 1e-15 else 0.0:.9g}" for value in values)


def joint_element(name: str, kind: str, parent: str, child: str, xyz: Vec3) -> ET.Element:
    """Return what the URDF elements of all joints share."""
    element = ET.Element("joint", name=name, type=kind)
    ET.SubElement(element, "origin", xyz=text(*xyz), rpy="0 0 0")
    ET.SubElement(element, "parent", link=parent)
    ET.SubElement(element, "child", link=child)
    return element


def revolute_element(joint: Joint, child: str) -> ET.Element:
    """Return the URDF element of a revolute joint."""
    element = joint_element(joint.name, "revolute", joint.parent, child, joint.xyz)
    ET.SubElement(element, "axis", xyz=AXES[joint.axis])
    lower, upper = text(math.radians(joint.lower)), text(math.radians(joint.upper))
    effort, velocity = text(EFFORT_LIMIT), text(VELOCITY_LIMIT)
    ET.SubElement(element, "limit", lower=lower, upper=upper, effort=effort, velocity=velocity)
    return element


def link_element(link: Link) -> ET.Element:
    """Return the URDF element of a link: its inertia, then each shape to draw and to collide."""
    element = ET.Element("link", name=link.name)
    mass, com, inertia = inertial(link.parts)
    body = ET.SubElement(element, "inertial")
    ET.SubElement(body, "origin", xyz=text(*com), rpy="0 0 0")
    ET.SubElement(body, "mass", value=text(mass))
    upper = ((f"i{'xyz'[i]}{'xyz'[j]}", inertia[i, j]) for i in range(3) for j in range(i, 3))
    ET.SubElement(body, "inertia", {name: text(value) for name, value in upper})
    for role in ("visual", "collision"):
        for part in link.parts:
            shape, rpy = ET.SubElement(element, role), map(math.radians, part.rpy)
            ET.SubElement(shape, "origin", xyz=text(*part.xyz), rpy=text(*rpy))
            geometry, solid = ET.SubElement(shape, "geometry"), part.solid
            if isinstance(solid, Box):
                ET.SubElement(geometry, "box", size=text(*solid))
            else:
                sizes = {name: text(value) for name, value in solid._asdict().items()}
                ET.SubElement(geometry, type(solid).__name__.lower(), sizes)
            if role == "visual":
                ET.SubElement(shape, "material", name=part.colour)
    return element


def urdf() -> str:
    """Return the whole URDF document."""
    robot = ET.Element("robot", name="hoap2_like")
    for name, rgba in COLOURS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    for link in links():
        if link.joint is not None:
            robot.append(revolute_element(link.joint, link.name))
        robot.append(link_element(link))
    for name, parent, xyz in frames():
        robot.append(joint_element(f"{name}_fixed", "fixed", parent, name, xyz))
        ET.SubElement(robot, "link", name=name)
    ET.indent(robot)
    for element in robot.iter():
        if len(element) == 1 and not len(element[0]):  # a shape, or a colour, on one line
            element.text = element[0].tail = ""
    note = "Generated by benchmarks/make_hoap2_like.py; change that file, not this one."
    body = ET.tostring(robot, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n<!-- {note} -->\n{body}\n'


def main() -> None:
    """Write the URDF into the package."""
    URDF.write_text(urdf(), encoding="utf-8")


if __name__ == "__main__":
    main()
