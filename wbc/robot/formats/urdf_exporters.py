"""Repairs of URDFs of exporters and scripts, where Pinocchio's parser would lose data."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.robot.formats.description import pinocchio_reads
from wbc.robot.notes import noted

MOVING = {"revolute", "continuous", "prismatic"}
LIMITS = ("lower", "upper", "effort", "velocity")
MACRO = re.compile(r"\$\{|\$\((arg|find|eval|env|optenv|dirname|anon)\b")  # ${x}, $(arg x)
GREY, BRIGHTEST = "0.5 0.5 0.5 1", 255.0
VERSIONS = ("1.0", "1.1", "1.2")
UNIQUE = ("origin", "axis", "limit", "dynamics", "mimic")  # in a joint
PARTS = ("inertial", "collision", "visual")  # of a link
DYNAMICS = {"damping", "friction"}
LEAST_TURN = 6.0  # rad: ranges of -3.14 to 3.14 say that a joint is continuous
UNREAD = ("safety_controller", "calibration")  # not used here
SHAPES = {pin.GeometryType.COLLISION: "collision", pin.GeometryType.VISUAL: "visual"}


def refuse_macros(root: ET.Element, path: Path) -> None:
    """Refuse unexpanded xacro: a part of the robot would be missing."""
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


def complete_root(root: ET.Element, path: Path) -> tuple[str, ...]:
    """Write name and version as the parser accepts them; return a note of a missing name."""
    version = root.get("version", "1.0")
    if version not in VERSIONS:
        raise ModelError(f"{path}: URDF {version!r} is not known; {' to '.join(VERSIONS[::2])} are")
    if version == "1.0":
        root.set("version", "1.1")  # before it the parser drops capsules, and prints
    if root.get("name"):
        return ()
    root.set("name", path.stem)
    return (f"the file gives the robot no name: it is called {path.stem!r}",)


def foreign_joints_hint(root: ET.Element) -> str:
    """Return joints of kinds that URDF does not have, and what to do, in words; empty if none."""
    others = [
        one for one in root if str(one.tag).rpartition("}")[2] == "joint" and one.tag != "joint"
    ]
    named = [f"joint {one.get('name')!r}" for one in others]
    named += [f"loop {one.get('name')!r}" for one in root.findall("loop_joint")]
    if not named:
        return ""
    return f"not read, as URDF does not know them: {listed(named)}; loops=... closes loops"


def drop_repeated(root: ET.Element) -> tuple[str, ...]:
    """Drop repetitions of unique elements, and unused empty elements that stop the parser.

    Parsers read the first one of several, and refuse a whole file for some empty ones. Return a
    note of what was dropped.
    """
    found = []
    for joint in root.findall("joint"):
        what = f"joint {joint.get('name')!r}"
        empty = [one for one in joint.findall("dynamics") if not DYNAMICS & {*one.attrib}]
        _drop(joint, [one for one in joint if one.tag in UNREAD or one in empty])
        for tag in UNIQUE:
            found += [f"<{tag}> of {what}" for _ in _drop(joint, joint.findall(tag)[1:])]
    for link in root.findall("link"):
        what = f"link {link.get('name')!r}"
        for part in (one for tag in PARTS for one in link.findall(tag)):
            for tag in ("origin", "geometry"):
                found += [f"<{tag}> of {what}" for _ in _drop(part, part.findall(tag)[1:])]
            for geometry in part.findall("geometry")[:1]:
                more = [one for one in list(geometry)[1:] if not str(one.tag).startswith("{")]
                _drop(geometry, more)
                found += [f"<{one.tag}> as {part.tag} of {what}" for one in more]
    return noted("given twice, of which the first counts: {}", found)


def _drop(element: ET.Element, parts: list[ET.Element]) -> list[ET.Element]:
    for part in parts:
        element.remove(part)
    return parts


def complete_materials(root: ET.Element) -> tuple[str, ...]:
    """Name nameless materials, and make those with unreadable colours grey.

    The parser drops all shapes of a link, or the whole file, for them. Colours up to 255 are
    divided by it, the alpha beside them if it is above 1, too. Return a note of the grey ones.
    """
    grey, known = list[str](), set[str]()
    for k, material in enumerate(root.iter("material")):
        if not material.get("name"):
            material.set("name", f"nameless material {k}")
        for colour in material.findall("color"):
            found = _colour(colour.get("rgba", ""))
            colour.set("rgba", found or GREY)
            grey += [] if found else [material.get("name", "")]
    for material in root.findall("material"):  # what links name
        name = material.get("name", "")
        if name in known:
            root.remove(material)
        elif not len(material):
            ET.SubElement(material, "color", {"rgba": GREY})
        known.add(name)
    return noted("grey, since their colours cannot be read: {}", grey)


def _colour(text: str) -> str | None:
    """Return red, green, blue and alpha as the parser reads them, in [0, 1], or None."""
    try:
        parts = [float(part) for part in text.split()]
    except ValueError:
        return None
    if len(parts) != len(GREY.split()) or not all(0.0 <= part <= BRIGHTEST for part in parts):
        return None
    *rgb, alpha = parts
    if max(rgb) > 1.0:
        rgb = [part / BRIGHTEST for part in rgb]
    return " ".join(map(str, (*rgb, alpha / BRIGHTEST if alpha > 1.0 else alpha)))


def drop_empty_limits(joints: list[ET.Element]) -> tuple[str, ...]:
    """Remove limits whose four numbers are 0, as exporters write by default.

    Return notes of these, of joints without a range, of ranges that bound no joint, and of speed
    limits of 0.
    """
    unset, free, still, endless = list[str](), list[str](), list[str](), list[str]()
    for joint in joints:
        limit, name = joint.find("limit"), joint.get("name", "")
        given = {} if limit is None else limit.attrib
        zero = [key for key in LIMITS if key in given and _is_zero(given[key])]
        if joint.get("type") not in MOVING:
            continue
        if limit is not None and len(zero) == len(LIMITS):
            joint.remove(limit)
            unset.append(name)
        elif joint.get("type") != "continuous" and not {"lower", "upper"} & set(given):
            free.append(name)
        elif "velocity" in zero:
            still.append(name)
        if joint.get("type") == "continuous" and _is_within_a_turn(given):
            endless.append(name)
    zero_limits = (
        "limits of {} are all 0 (position, effort, speed), as exporters write where nothing was"
        " entered: taken as none"
    )
    return (
        noted(zero_limits, unset)
        + noted("{} have no range in the file: taken as without limits", free)
        + noted("ranges of continuous joints, which URDF gives none, are not used: {}", endless)
        + noted("speed limits of 0 are taken as none: {}", still)
    )


def _is_within_a_turn(limit: Mapping[str, str]) -> bool:
    """Return whether a limit's range is smaller than a turn, which means no limit."""
    try:
        low, high = (float(limit[key]) for key in ("lower", "upper"))
    except (KeyError, ValueError):
        return False
    return 0.0 < high - low < LEAST_TURN


def _is_zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False


def confirm_shapes(root: ET.Element, text: str, model: pin.Model, path: Path) -> None:
    """Compare how many shapes each link has with what the parser reads, meshes left out."""
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
