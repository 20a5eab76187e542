"""What exporters and scripts leave in URDFs, and what the parser below Pinocchio loses of them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.robot.formats.description import pinocchio_reads

MOVING = {"revolute", "continuous", "prismatic"}
LIMITS = ("lower", "upper", "effort", "velocity")
MACRO = re.compile(r"\$\{|\$\((arg|find|eval|env|optenv|dirname|anon)\b")  # ${x}, $(arg x)
SHAPES = {pin.GeometryType.COLLISION: "collision", pin.GeometryType.VISUAL: "visual"}


def refuse_macros(root: ET.Element, path: Path) -> None:
    """Refuse what xacro has not expanded: a part of the robot would be missing."""
    for element in root.iter():
        space, _, tag = str(element.tag).rpartition("}")
        left = [f"{key}={text!r}" for key, text in element.attrib.items() if MACRO.search(text)]
        if "xacro" in space:
            left = [f"<xacro:{tag}>"]
        if left:
            raise ModelError(
                f"{path}: {left[0]} is left of a xacro file; expand that first:"
                f" xacro {path.stem}.xacro > {path.name}"
            )


def name_materials(root: ET.Element) -> None:
    """Give materials without a name one: the parser drops all shapes of a link that has such."""
    for k, material in enumerate(root.iter("material")):
        if not material.get("name"):
            material.set("name", f"nameless material {k}")


def unset_limits(joints: list[ET.Element]) -> tuple[str, ...]:
    """Take away limits of which all four are 0, as exporters write where nothing was entered."""
    found = []
    for joint in joints:
        limit = joint.find("limit")
        if joint.get("type") not in MOVING or limit is None or not {*LIMITS} <= {*limit.attrib}:
            continue
        if all(_is_zero(limit.attrib[key]) for key in LIMITS):
            joint.remove(limit)
            found.append(joint.get("name", ""))
    if not found:
        return ()
    return (
        f"limits of {listed(found)} are all 0 (position, effort, speed), as exporters write where"
        " nothing was entered: taken as none",
    )


def _is_zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False


def confirm_shapes(root: ET.Element, text: str, model: pin.Model, path: Path) -> None:
    """Compare how many shapes each link has with what the parser reads, meshes left out.

    Raises
    ------
    ModelError
        Some were lost.
    """
    plain = ET.fromstring(text)
    for tag in SHAPES.values():
        for shape in plain.iter(tag):
            geometry = shape.find("geometry")
            if geometry is not None and geometry.find("mesh") is not None:
                geometry[:] = [ET.Element("sphere", radius="1")]
    text = ET.tostring(plain, encoding="unicode")
    for kind, tag in SHAPES.items():
        with pinocchio_reads(path, "shapes cannot be read"):
            read = pin.buildGeomFromUrdfString(model, text, kind)
        found = Counter(str(model.frames[one.parentFrame].name) for one in read.geometryObjects)
        for link in root.findall("link"):
            name, count = link.get("name", ""), len(link.findall(tag))
            if found[name] != count:
                raise ModelError(
                    f"{path}: link {name!r} has {count} {tag} shapes, but {found[name]} were read;"
                    " self-collision would not see the others"
                )
