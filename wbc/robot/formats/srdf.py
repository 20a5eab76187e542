"""Read an SRDF: named postures, pairs of links that never meet, joints without motors."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.robot.formats.description import State
from wbc.robot.formats.urdf_exporters import refuse_macros
from wbc.robot.formats.urdf_words import ROTORS, SIMILARITY
from wbc.robot.formats.xml import read_xml
from wbc.robot.limits import BASE_NQ
from wbc.robot.notes import noted

COLLISIONS = ("disable_collisions", "disable_default_collisions", "enable_collisions")
READ_ELEMENTS = ("group_state", "passive_joint", *COLLISIONS)
UNIT_TOLERANCE = 1e-2  # of cos^2 + sin^2, which files round


@dataclass(frozen=True)
class Semantics:
    """The content of one SRDF."""

    states: Mapping[str, State]  # configurations by name; groups' states of one name are one
    disabled: frozenset[frozenset[str]]  # pairs of links that are not checked for collisions
    passive: tuple[str, ...]  # joints without motors
    overwritten: tuple[str, ...]  # contradictions between groups, in words
    unread: tuple[str, ...]  # probably misspelt or unsupported elements, in words

    def notes(self, model: pin.Model) -> tuple[str, ...]:
        """Return which parts are not used with a robot, in words.

        ``model`` has all joints of the description, none locked.
        """
        notes = self.overwritten + self.unread
        joints = {str(name) for name in model.names}
        for name, state in self.states.items():
            unknown = [
                one for one, values in state.items() if one not in joints and len(values) < BASE_NQ
            ]
            notes += noted(f"SRDF, state {name!r}: the robot has no joint {{}}", unknown)
        frames = {str(frame.name) for frame in model.frames}
        links = sorted({link for pair in self.disabled for link in pair} - frames)
        notes += noted("SRDF, disable_collisions: the robot has no link {}", links)
        lacking = [name for name in self.passive if name not in joints]
        notes += noted("SRDF, passive_joint: the robot has no joint {}", lacking)
        return notes + noted(
            "SRDF, passive_joint: torques are asked of {} all the same; what has no motor can be"
            " locked, or named in unactuated=[...]",
            [name for name in self.passive if name in joints],
        )


def read_srdf(path: Path, model: pin.Model | None = None) -> Semantics:
    """Return what an SRDF says.

    ``model``: the robot, to tell of which joints a value may be (cos, sin); None: of any. And which
    links there are.

    Raises ModelError: not a readable SRDF, a value that is no configuration of its joint, or a pair
    of links of which one is missing.
    """
    root = read_xml(path)
    if root.tag != "robot":
        raise ModelError(f"{path}: the root element is <{root.tag}>; an SRDF begins with <robot>")
    if root.find("link") is not None:
        raise ModelError(f"{path}: an SRDF has no <link>; is it the URDF itself?")
    refuse_macros(root, path)
    states = dict[str, dict[str, tuple[float, ...]]]()
    contradicted = dict[str, list[str]]()
    for group in root.findall("group_state"):
        if not (name := group.get("name")):
            raise ModelError(f"{path}: <group_state> without name; give it one, such as standing")
        state = states.setdefault(name, {})
        for joint, values in _joint_values(group, path, _sizes(model)):
            if state.get(joint, values) != values:
                contradicted.setdefault(name, []).append(joint)
            state[joint] = values
    overwritten = tuple(
        f"SRDF, state {name!r}: groups give different values of {listed(joints)}; the last counts"
        for name, joints in contradicted.items()
    )
    passive = tuple(joint.get("name", "?") for joint in root.findall("passive_joint"))
    disabled = frozenset(_disabled(root, path, model))
    return Semantics(states, disabled, passive, overwritten, _unread(root))


def _unread(root: ET.Element) -> tuple[str, ...]:
    """Return notes of misspelt elements, and of a base that is not to float.

    SRDFs hold elements of many other programs, which are passed over.
    """
    told = list[str]()
    for element in root:
        inner = [one.tag for one in element.iter() if one is not element]
        told += [f"<{tag}> inside <{element.tag}>" for tag in inner if tag in READ_ELEMENTS]
        near = get_close_matches(str(element.tag).lower(), READ_ELEMENTS, n=1, cutoff=SIMILARITY)
        if near and element.tag not in READ_ELEMENTS:
            told.append(f"<{element.tag}> (is {near[0]!r} meant?)")
        if element.tag == "group_state":
            others = [str(one.tag) for one in element if one.tag != "joint"]
            told += [f"<{tag}> in state {element.get('name')!r}" for tag in others]
        if element.tag == "virtual_joint" and element.get("type") not in (None, "floating"):
            told.append(f"<virtual_joint> of type {element.get('type')!r} (base='fixed' bolts it)")
    rotors = [str(joint.get("name")) for joint in root.iterfind("rotor_params/joint")]
    return noted("SRDF, not read: {}", told) + noted(f"SRDF, not read: {ROTORS}, of {{}}", rotors)


def _disabled(root: ET.Element, path: Path, model: pin.Model | None) -> set[frozenset[str]]:
    """Return the pairs of links whose collisions are disabled, singly or by default."""
    bodies = () if model is None else model.frames
    links = [str(frame.name) for frame in bodies if frame.type == pin.FrameType.BODY]
    found = set(_pairs(root, "disable_collisions", path))
    for element in root.findall("disable_default_collisions"):
        if (one := element.get("link")) is None:
            raise ModelError(f"{path}: <disable_default_collisions> without link")
        found |= {frozenset((one, other)) for other in links if other != one}
    return found - set(_pairs(root, "enable_collisions", path))


def _pairs(root: ET.Element, tag: str, path: Path) -> Iterator[frozenset[str]]:
    for element in root.findall(tag):
        links = element.get("link1"), element.get("link2")
        if None in links:
            raise ModelError(f"{path}: <{tag}> without link1 or link2")
        yield frozenset(str(link) for link in links)


def _sizes(model: pin.Model | None) -> Mapping[str, int]:
    """Return how many numbers q holds of each joint: 2, (cos, sin), of continuous ones."""
    if model is None:
        return {}
    return {str(name): int(nq) for name, nq in zip(model.names, model.nqs, strict=True)}


def _joint_values(
    group: ET.Element, path: Path, sizes: Mapping[str, int]
) -> Iterator[tuple[str, tuple[float, ...]]]:
    for joint in group.findall("joint"):
        text, name = joint.get("value", ""), joint.get("name", "?")
        where = f"{path}: state {group.get('name')!r}, joint {name!r}: {text!r}"
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError as error:
            raise ModelError(f"{where} is not made of numbers") from error
        norm = sum(value * value for value in values)  # infinite where it overflows
        wrong = len(values) not in (1, 2, BASE_NQ) or not math.isfinite(norm)
        if wrong or (len(values) == BASE_NQ and math.hypot(*values[3:]) < 1e-3):
            raise ModelError(
                f"{where} is neither one number nor (cos, sin), nor a base's configuration"
                " (x, y, z, quaternion x, y, z, w)"
            )
        if len(values) == 2 == sizes.get(name) and abs(math.hypot(*values) - 1.0) > UNIT_TOLERANCE:
            raise ModelError(f"{where} is no (cos, sin): its squares sum to {norm:.3g}, not 1")
        if len(values) == 2 and sizes.get(name) == 1:
            raise ModelError(
                f"{where}: two values (cos, sin) are of a continuous joint only; give one"
            )
        yield name, values
