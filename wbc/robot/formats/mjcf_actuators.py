"""Largest torque of the joints by the actuators of an MJCF document, which Pinocchio leaves out."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pinocchio as pin

from wbc.robot.formats.xml import LARGEST, numbers

ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper")


def bound_efforts(model: pin.Model, root: ET.Element, path: Path) -> None:
    """Lower the effort limits of ``model`` to what the motors of a plain document can give.

    A joint that an actuator without a range drives keeps what it has.

    Raises
    ------
    ModelError
        Ranges or gears that are not finite numbers.
    """
    compiler = root.find("compiler")
    auto = compiler is None or compiler.get("autolimits", "true") == "true"
    efforts = dict[str, float]()
    for actuator in root.findall("actuator/*"):
        joint = actuator.get("joint", "")
        single = model.existJointName(joint) and model.nvs[model.getJointId(joint)] == 1
        if actuator.tag in ACTUATORS and single:
            effort = _effort(actuator, auto, f"{path}: <{actuator.tag}> of joint {joint!r}")
            efforts[joint] = efforts.get(joint, 0.0) + effort
    for joint, effort in efforts.items():
        at = int(model.idx_vs[model.getJointId(joint)])
        if 0.0 < effort < model.upperEffortLimit[at]:
            model.upperEffortLimit[at], model.lowerEffortLimit[at] = effort, -effort


def _effort(actuator: ET.Element, auto: bool, where: str) -> float:
    """Return the torque [N m] or force [N] that it can give both ways; infinite if not limited."""
    gear = abs(_first(actuator, "gear", 1.0, where))
    force = _range(actuator, "force", auto, where)
    if _of_torque(actuator):
        gain = abs(_first(actuator, "gainprm", 1.0, where)) if actuator.tag == "general" else 1.0
        force = min(force, gain * _range(actuator, "ctrl", auto, where) if gain else 0.0)
    return gear * force if gear else 0.0


def _of_torque(actuator: ET.Element) -> bool:
    """Whether the force is in proportion to the control, and to nothing else."""
    plain = {"biastype": "none", "gaintype": "fixed", "dyntype": "none"}
    is_plain = all(actuator.get(key, value) == value for key, value in plain.items())
    return actuator.tag == "motor" or (actuator.tag == "general" and is_plain)


def _first(actuator: ET.Element, key: str, default: float, where: str) -> float:
    values = actuator.get(key, "").split()
    return numbers(actuator, key, len(values), where, LARGEST)[0] if values else default


def _range(actuator: ET.Element, of: str, auto: bool, where: str) -> float:
    """Return the smaller end of a range, which bounds both ways; infinite if it is not limited."""
    given = f"{of}range" in actuator.attrib
    limited = actuator.get(f"{of}limited", "auto")
    if not given or limited == "false" or (limited == "auto" and not auto):
        return math.inf
    return min(abs(end) for end in numbers(actuator, f"{of}range", 2, where, LARGEST))


def merged_defaults(default: ET.Element, inherited: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes that actuators of a class have: all kinds of actuator share them."""
    found = dict(inherited)
    for child in default:
        if child.tag in ACTUATORS:
            found |= child.attrib
    return found
