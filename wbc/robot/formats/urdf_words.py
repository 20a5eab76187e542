"""What stands in a URDF that URDF does not know, such as misspelt elements and attributes.

Its parsers pass over these without a word, and with them over a limit, an inertia or a place.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from difflib import get_close_matches
from typing import NamedTuple

from wbc.errors import listed


class _Words(NamedTuple):
    """What may stand in an element."""

    attributes: frozenset[str]
    children: frozenset[str]


def _words(attributes: str, children: str = "") -> _Words:
    return _Words(frozenset(attributes.split()), frozenset(children.split()))


# What is for others, as the reference says, and not looked into. A name may be anywhere.
FOR_OTHERS = {"transmission", "gazebo", "sensor", "mujoco", "ros2_control", "material"}
KNOWN = {
    "robot": _words("version", "link joint loop_joint"),
    "link": _words("", "inertial collision visual"),
    "joint": _words(
        "type dont_collapse",  # of Isaac's importer, which leaves such joints in
        "parent child origin axis limit mimic dynamics safety_controller calibration",
    ),
    "inertial": _words("", "origin mass inertia"),
    "collision": _words("", "origin geometry verbose"),
    "visual": _words("", "origin geometry"),
    "geometry": _words("", "box sphere cylinder capsule mesh"),
    "box": _words("size"),
    "sphere": _words("radius"),
    "cylinder": _words("radius length"),
    "capsule": _words("radius length"),
    "mesh": _words("filename scale"),
    "origin": _words("xyz rpy quat_xyzw"),
    "mass": _words("value"),
    "inertia": _words("ixx ixy ixz iyy iyz izz"),
    "parent": _words("link"),
    "child": _words("link"),
    "axis": _words("xyz"),
    "limit": _words("lower upper effort velocity"),
    "mimic": _words("joint multiplier offset"),
    "dynamics": _words("damping friction"),
}
ALIKE = 0.8  # of words that may be meant


def unknown_words(root: ET.Element) -> tuple[str, ...]:
    """Return a note of elements and attributes that URDF does not know, with those meant.

    What has a namespace of its own, such as Drake's, and what is left for others is passed over;
    shapes that are not known are told where shapes are read.
    """
    first, more = dict[str, str](), dict[str, int]()
    for what, hint, owner in _found(root, "the robot"):
        more[what] = more.get(what, -1) + 1
        first.setdefault(what, f"{what} of {owner}{hint}")
    if not first:
        return ()
    told = [
        f"{words} and {k} more" if (k := more[what]) else words for what, words in first.items()
    ]
    return (f"not read, as URDF does not know it: {listed(told)}",)


def _found(element: ET.Element, owner: str) -> Iterator[tuple[str, str, str]]:
    """Yield what is not known in an element, a hint at what is meant, and what it is of."""
    known = KNOWN[element.tag]
    for key in element.attrib:
        if not _is_foreign(key) and key not in known.attributes | {"name"}:
            yield f"{key!r} in <{element.tag}>", _hint(key, known.attributes), owner
    for child in element:
        tag = str(child.tag)
        if tag in known.children:
            below = f"{tag} {child.get('name')!r}" if tag in ("link", "joint") else owner
            if tag in KNOWN:
                yield from _found(child, below)
        elif not (_is_foreign(tag) or tag in FOR_OTHERS or element.tag == "geometry"):
            within = "" if element.tag in ("robot", "link", "joint") else f" in <{element.tag}>"
            yield f"<{tag}>{within}", _hint(tag, known.children), owner


def _is_foreign(word: str) -> bool:
    return "}" in word or ":" in word or not word.isidentifier()


def _hint(word: str, known: frozenset[str]) -> str:
    """Return which word is meant, in words; empty if none is like it."""
    near = get_close_matches(word.lower(), sorted(known), n=1, cutoff=ALIKE)
    return f" (is {near[0]!r} meant?)" if near else ""
