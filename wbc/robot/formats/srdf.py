"""Read the named postures (``group_state``) of an SRDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

from wbc.errors import ModelError
from wbc.robot.formats.description import State
from wbc.robot.formats.xml import read_xml
from wbc.robot.limits import BASE_NQ


def read_states(srdf: Path) -> dict[str, State]:
    """Return the ``group_state`` entries of an SRDF: state name to joint to its coordinates.

    Raises
    ------
    ModelError
        Not a readable SRDF, or a value that is not made of numbers.
    """
    root = read_xml(srdf)
    if root.tag != "robot":
        raise ModelError(f"{srdf}: the root element is <{root.tag}>; an SRDF begins with <robot>")
    return {
        group.get("name", "?"): dict(_joint_values(group, srdf))
        for group in root.findall("group_state")
    }


def _joint_values(group: ET.Element, srdf: Path) -> Iterable[tuple[str, tuple[float, ...]]]:
    for joint in group.findall("joint"):
        text = joint.get("value", "")
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError as error:
            raise ModelError(
                f"{srdf}: state {group.get('name')!r}, joint {joint.get('name')!r}: {text!r} is"
                " not made of numbers"
            ) from error
        norm = sum(value * value for value in values)  # infinite where it overflows
        wrong = len(values) not in (1, 2, BASE_NQ) or not math.isfinite(norm)
        if wrong or (len(values) == BASE_NQ and math.hypot(*values[3:]) < 1e-3):
            raise ModelError(
                f"{srdf}: state {group.get('name')!r}, joint {joint.get('name')!r}: {text!r} is"
                " not a configuration (x, y, z, quaternion x, y, z, w for the base)"
            )
        yield joint.get("name", "?"), values
