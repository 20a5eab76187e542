"""Which body of an MJCF document is the robot's root, where the world holds others too.

Scenes hold tables, balls and doors; the makers' own files of G1, H1 and R1 hold bodies far above
the ground, whose joints take the place of motors that a model does not have.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from wbc.errors import ModelError, listed

NUMBERS = {"hinge": 1, "slide": 1, "ball": 4, "free": 7}  # of a joint, in a key frame
ENDS = ("joint1", "joint2", "body1", "body2", "site1", "site2")


def robot_alone(root: ET.Element, path: Path) -> tuple[str, ...]:
    """Take all bodies but the robot's out of a plain document, and return a note if there were any.

    The robot is the only one with a free joint and further joints; if none is, the only one with
    joints.

    Raises
    ------
    ModelError
        No body, or several that may be the robot.
    """
    world, bodies = root.find("worldbody"), root.findall("worldbody/body")
    if world is None or not bodies:
        raise ModelError(f"{path}: the world holds no bodies, expected the robot's root")
    if len(bodies) == 1:
        return ()
    kinds = {body: [_kind(joint) for joint in _joints(body)] for body in bodies}
    floating = [body for body in bodies if "free" in kinds[body] and len(kinds[body]) > 1]
    found = floating or [body for body in bodies if kinds[body]]
    if len(found) != 1:
        names = ", ".join(repr(body.get("name", "?")) for body in found or bodies)
        raise ModelError(
            f"{path}: the world holds {len(bodies)} bodies, and {names} may be the robot's root;"
            " remove the others"
        )
    others = [body for body in bodies if body is not found[0]]
    _shorten_keys(root, bodies, found[0])
    gone = {element.get("name", "") for body in others for element in body.iter()}
    for section in root.findall("equality"):
        for constraint in list(section):
            if any(constraint.get(end) in gone for end in ENDS):
                section.remove(constraint)
    for body in others:
        world.remove(body)
    named = listed([body.get("name", "?") for body in others])
    root_name = found[0].get("name", "?")
    return (f"bodies beside the robot, whose root is {root_name}, left out: {named}",)


def _joints(body: ET.Element) -> list[ET.Element]:
    return [element for element in body.iter() if element.tag in ("joint", "freejoint")]


def _kind(joint: ET.Element) -> str:
    return "free" if joint.tag == "freejoint" else joint.get("type", "hinge")


def _shorten_keys(root: ET.Element, bodies: list[ET.Element], robot: ET.Element) -> None:
    """Cut the robot's own coordinates out of all key frames; they stand in the bodies' order."""
    counts = [sum(NUMBERS.get(_kind(joint), 0) for joint in _joints(body)) for body in bodies]
    at = bodies.index(robot)
    first, last = sum(counts[:at]), sum(counts[: at + 1])
    for key in root.findall("keyframe/key"):
        values = key.get("qpos", "").split()
        if len(values) == sum(counts):
            key.set("qpos", " ".join(values[first:last]))
