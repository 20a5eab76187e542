"""Floating roots of a URDF: by a ``floating`` joint, or by six joints in turn."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from wbc.errors import ModelError
from wbc.robot.formats.xml import numbers
from wbc.robot.notes import noted

SIX = ("prismatic",), ("revolute", "continuous")  # kinds of joints, three of each


def check_floating(joints: list[ET.Element], base: ET.Element, path: Path) -> None:
    """Allow a ``floating`` joint only where it is redundant: from a root link without mass."""
    on_base = [joint for joint in joints if parent_of(joint) == base.get("name")]
    for joint in joints:
        if joint.get("type") != "floating":
            continue
        if on_base != [joint] or base.find("inertial") is not None:
            raise ModelError(
                f"{path}: joint {joint.get('name')!r} is floating, but only the root may float;"
                " remove the joint (the root link floats by itself)"
            )
        for origin in joint.findall("origin"):
            joint.remove(origin)  # an offset of the world, which q measures by itself


def drop_world_shapes(root: ET.Element, base: str) -> tuple[str, ...]:
    """Leave out the shapes of the link that a robot floats from; return a note of it."""
    (link,) = (link for link in root.findall("link") if link.get("name") == base)
    shapes = [*link.findall("visual"), *link.findall("collision")]
    for shape in shapes:
        link.remove(shape)
    text = f"shapes of the link {base!r}, which the robot floats from, left out: {len(shapes)}"
    return (text,) if shapes else ()


def float_by_one_joint(root: ET.Element, base: str, path: Path) -> tuple[str, ...]:
    """Write six joints in turn that let a robot float as a single one; return a note of it.

    Three slide and three turn, about different axes, without a motor (an effort) and with nothing
    on the links between.
    """
    links = {link.get("name", ""): link for link in root.findall("link")}
    chain, between, link = list[ET.Element](), list[ET.Element](), base
    while len(chain) < 6:
        below = [joint for joint in root.findall("joint") if parent_of(joint) == link]
        bare = links[link].find("inertial") is None and (link == base or not len(links[link]))
        if len(below) != 1 or not bare or _is_driven(below[0]):
            return ()
        between.append(links[link])
        chain += below
        link = next(child.get("link", "") for child in below[0].iter("child"))
    for kinds in SIX:
        axes = [_axis(joint, path) for joint in chain if joint.get("type") in kinds]
        if len(axes) != 3 or np.linalg.matrix_rank(axes) < 3:
            return ()
    turned = {origin.get("rpy", "0") for joint in chain[1:] for origin in joint.iter("origin")}
    if {word.rstrip("0") for rpy in turned for word in rpy.split()} - {"", "0."}:
        return ()  # of whose axes that does not tell
    for element in (*between[1:], *chain[1:]):
        root.remove(element)
    chain[0].set("type", "floating")
    chain[0][:] = [ET.Element("parent", link=base), ET.Element("child", link=link)]
    names = [joint.get("name", "") for joint in chain]
    return noted("joints of the root that are its floating base: {}", names, len(names))


def _is_driven(joint: ET.Element) -> bool:
    """Return whether a motor may drive a joint, or it follows another one."""
    efforts = {limit.get("effort", "0").strip() for limit in joint.findall("limit")}
    return joint.find("mimic") is not None or bool(efforts - {"0", "0.0"})


def _axis(joint: ET.Element, path: Path) -> list[float]:
    axis = joint.find("axis")
    if axis is None:
        return [1.0, 0.0, 0.0]
    return numbers(axis, "xyz", 3, f"{path}: joint {joint.get('name')!r}")


def parent_of(joint: ET.Element) -> str | None:
    """Return the name of the link that a joint is on."""
    parent = joint.find("parent")
    return None if parent is None else parent.get("link")
