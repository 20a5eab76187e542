"""Unknown elements and attributes of a URDF, such as misspelt ones.

Parsers ignore these silently, and with them a limit, an inertia or a placement.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from difflib import get_close_matches

from wbc.robot.notes import noted

# Elements for other programs, not checked. ``name`` is allowed everywhere.
OTHER_PROGRAMS = {"transmission", "gazebo", "sensor", "mujoco", "ros2_control", "material"}
# Attributes and children of elements.
KNOWN = {
    "robot": ("version", "link joint loop_joint"),
    "link": ("", "inertial collision visual"),
    "joint": (
        "type dont_collapse",  # of Isaac's importer, which leaves such joints in
        "parent child origin axis limit mimic dynamics safety_controller calibration",
    ),
    "inertial": ("", "origin mass inertia"),
    "collision": ("", "origin geometry verbose"),
    "visual": ("", "origin geometry"),
    "geometry": ("", "box sphere cylinder capsule mesh"),
    "box": ("size", ""),
    "sphere": ("radius", ""),
    "cylinder": ("radius length", ""),
    "capsule": ("radius length", ""),
    "mesh": ("filename scale", ""),
    "origin": ("xyz rpy quat_xyzw", ""),
    "mass": ("value", ""),
    "inertia": ("ixx ixy ixz iyy iyz izz", ""),
    "parent": ("link", ""),
    "child": ("link", ""),
    "axis": ("xyz", ""),
    "limit": ("lower upper effort velocity", ""),
    "mimic": ("joint multiplier offset", ""),
    "dynamics": ("damping friction", ""),
}
# Physics in elements for other programs (Drake, Gazebo), which moves the robot.
ROTORS = "rotors' inertia (armature=... takes it, times the gear ratio squared)"
PHYSICS = {
    "rotor_inertia": ROTORS,
    "springStiffness": "springs",
    "turnGravityOff": "that gravity does not act",
}
NOTHING = {"", "0", "0.0", "false"}
SIMILARITY = 0.8  # of words that are suggested


def unknown_words(root: ET.Element) -> tuple[str, ...]:
    """Return a note of unknown elements and attributes, with suggestions.

    Elements with a namespace, such as Drake's, and those for other programs are ignored; unknown
    shapes are reported where shapes are read.
    """
    first, more = dict[str, str](), dict[str, int]()
    for what, hint, owner in _unknown_in(root, "the robot"):
        more[what] = more.get(what, -1) + 1
        first.setdefault(what, f"{what} of {owner}{hint}")
    told = [
        f"{words} and {k} more" if (k := more[what]) else words for what, words in first.items()
    ]
    return noted("not read, as URDF does not know it: {}", told)


def unread_physics(root: ET.Element) -> tuple[str, ...]:
    """Return notes of :data:`PHYSICS` that is not read."""
    found = dict[str, list[str]]()
    for part in root:
        joint = part.find("joint")  # of a transmission
        owner = part.get("reference", (part if joint is None else joint).get("name", "?"))
        for element in part.iter():
            words = PHYSICS.get(str(element.tag).rpartition("}")[2])
            if words and element.get("value", element.text or "").strip().lower() not in NOTHING:
                found.setdefault(words, []).append(owner)
    told = (noted(f"not read: {words}, of {{}}", owners) for words, owners in found.items())
    return tuple(note for notes in told for note in notes)


def _unknown_in(element: ET.Element, owner: str) -> Iterator[tuple[str, str, str]]:
    """Yield unknown words in an element, each with a suggestion and its owner."""
    attributes, children = (words.split() for words in KNOWN[element.tag])
    for key in element.attrib:
        if not _is_foreign(key) and key not in (*attributes, "name"):
            yield f"{key!r} in <{element.tag}>", _hint(key, attributes), owner
    for child in element:
        tag = str(child.tag)
        if tag in children:
            below = f"{tag} {child.get('name')!r}" if tag in ("link", "joint") else owner
            if tag in KNOWN:
                yield from _unknown_in(child, below)
        elif not (_is_foreign(tag) or tag in OTHER_PROGRAMS or element.tag == "geometry"):
            within = "" if element.tag in ("robot", "link", "joint") else f" in <{element.tag}>"
            yield f"<{tag}>{within}", _hint(tag, children), owner


def _is_foreign(word: str) -> bool:
    return "}" in word or ":" in word or not word.isidentifier()


def _hint(word: str, known: list[str]) -> str:
    """Return a suggestion; empty if no word is similar."""
    near = get_close_matches(word.lower(), sorted(known), n=1, cutoff=SIMILARITY)
    return f" (is {near[0]!r} meant?)" if near else ""
