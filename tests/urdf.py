"""Toy robots as URDF, part by part; a robot is loaded from its text as from its file."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

GEARED = {
    "c": '<mimic joint="b" multiplier="-2" offset="0.1"/>',
    "d": '<mimic joint="c" multiplier="0.5"/>',
}


Moments = float | tuple[float, float, float]  # about all axes, or about x, y, z [kg m^2]


def inertial(mass: float = 1, moment: Moments = 0.01, at: str = "0 0 0") -> str:
    """A body with these moments of inertia, its CoM at a place [m]."""
    ixx, iyy, izz = moment if isinstance(moment, tuple) else (moment,) * 3
    return (
        f'<inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="{ixx}" ixy="0"'
        f' ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial>'
    )


def link(
    name: str, inside: str = "", mass: float = 1, moment: Moments = 0.01, at: str = "0 0 0"
) -> str:
    return f'<link name="{name}">{inertial(mass, moment, at)}{inside}</link>'


def limit(reach: float | str = 1, effort: float = 10, velocity: float = 3) -> str:
    """The same limit either way."""
    return f'<limit lower="-{reach}" upper="{reach}" effort="{effort}" velocity="{velocity}"/>'


def joint(
    name: str,
    parent: str,
    child: str,
    inside: str = "",
    *,
    kind: str = "revolute",
    at: str = "0 0 0",
    axis: str = "0 1 0",
    limit: str = limit(),
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}{inside}</joint>'
    )


def collision(shape: str, at: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """A shape such as ``box size="1 1 1"``, where it is and how it is turned."""
    return f'<collision><origin xyz="{at}" rpy="{rpy}"/><geometry><{shape}/></geometry></collision>'


def robot(name: str, *parts: str) -> str:
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def geared_arm(
    joints: str = "abcd", *, at: str = "0 0 0.1", limits: str = limit(2, 9, 2), **own: str
) -> str:
    """A bolted arm: c follows b at -2 b + 0.1, d follows c at 0.5 c, so at -b + 0.05.

    ``own`` are limits of one joint by its name.
    """
    parts, parent = [link("world", mass=2, moment=0.02, at=at)], "world"
    for name in joints:
        parts.append(link(f"link_{name}", mass=2, moment=0.02, at=at))
        gear, ends = GEARED.get(name, ""), own.get(name, limits)
        parts.append(joint(name, parent, f"link_{name}", gear, at="0 0 0.2", limit=ends))
        parent = f"link_{name}"
    return robot("arm", *parts)


def arm_of_one_joint(limits: str) -> str:
    """On a root link that no name tells to be bolted."""
    links = link("arm_link0", moment=0.1), link("upper", moment=0.1)
    return robot("arm", *links, joint("j", "arm_link0", "upper", limit=limits))


def stone(mass: float = 2, moment: float = 1) -> str:
    """A robot of one body."""
    return robot("stone", link("stone", mass=mass, moment=moment))


def on_both_legs(text: str, pattern: str, by: str) -> str:
    """Return a URDF in which a pattern is replaced; it is there once for each leg."""
    text, count = re.subn(pattern, by, text, flags=re.DOTALL)
    assert count == 2
    return text


def drawn_along(text: str, shifts: dict[str, float]) -> str:
    """Return a URDF of the same mechanism, its joints drawn elsewhere along their axes [m]."""
    root = ET.fromstring(text)
    joints = root.findall("joint")
    for name, shift in shifts.items():
        (moved,) = (one for one in joints if one.get("name") == name)
        child = moved.find("child").attrib["link"]
        along = shift * _numbers(moved.find("axis"), "xyz")
        R = pin.rpy.rpyToMatrix(*_numbers(moved.find("origin"), "rpy"))
        _move(moved, R @ along)
        carried = [one for one in joints if one.find("parent").get("link") == child]
        for part in (*carried, *root.find(f"link[@name='{child}']")):
            _move(part, -along)
    return ET.tostring(root, encoding="unicode")


def _numbers(element: ET.Element, key: str) -> np.ndarray:
    return np.array(element.get(key, "0 0 0").split(), dtype=float)


def _move(part: ET.Element, way: np.ndarray) -> None:
    """Move the origin of a joint, body or shape."""
    origin = ET.SubElement(part, "origin") if part.find("origin") is None else part.find("origin")
    origin.set("xyz", " ".join(map(repr, (_numbers(origin, "xyz") + way).tolist())))
