"""Make an MJCF document plain: one file, each section once, no defaults, one joint for each body.

Pinocchio reads only the first section of a name, no includes, and makes one joint of several axes
of a body that has several joints. MuJoCo's own compiler resolves these in the same way as here.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path

from wbc.errors import ModelError
from wbc.robot.formats.mjcf_actuators import merged_defaults
from wbc.robot.formats.mjcf_frames import MjcfAngles, flatten_frames, write_quaternions
from wbc.robot.formats.xml import MOST_ELEMENTS, read_xml

SECTIONS = ("compiler", "option", "size", "default", "asset", "worldbody", "equality", "keyframe")
ACTUATOR = "actuator"
WITH_DEFAULTS = ("joint", "geom", "site")
TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
MOST_FILES = 100  # included, whatever their size
Attributes = Mapping[str, str]


def plain_document(root: ET.Element, path: Path) -> ET.Element:
    """Return the same robot as a new document in which folders are absolute.

    Raises
    ------
    ModelError
        An included file that is missing, unreadable or included twice; a default class that does
        not exist.
    """
    whole = ET.Element("mujoco", {"model": root.get("model", path.stem)})
    sections = {tag: ET.SubElement(whole, tag) for tag in SECTIONS}
    for element in _included(root, path, {path.resolve()}):
        section = sections.get(element.tag)
        if section is None:
            section = sections[element.tag] = ET.SubElement(whole, element.tag)
        section.attrib.update(element.attrib)
        section.extend(element)
    if sum(1 for _ in whole.iter()) > MOST_ELEMENTS:
        raise ModelError(f"{path}: more than {MOST_ELEMENTS} elements with what it includes")
    _resolve_folders(sections["compiler"], path.parent.resolve())
    classes = dict(_classes(sections["default"], {}))
    _resolve_defaults(sections["worldbody"], "main", classes, path)
    for default in (sections["default"], *sections["default"].iter("default")):
        for child in list(default):
            if child.tag in WITH_DEFAULTS:
                default.remove(child)
    angles = MjcfAngles(sections["compiler"], str(path))
    flatten_frames(sections["worldbody"], angles, str(path))
    write_quaternions(sections["worldbody"], angles, str(path))
    _split_joints(sections["worldbody"])
    for actuator in sections.get(ACTUATOR, ()):
        _write_out(actuator, ACTUATOR, classes, actuator.attrib.pop("class", "main"), path)
    for tag in SECTIONS:
        if not len(sections[tag]) and not sections[tag].attrib:
            whole.remove(sections[tag])
    return whole


def _included(element: ET.Element, path: Path, seen: set[Path]) -> list[ET.Element]:
    """Return the children of an element, those of files in place of their ``<include>``."""
    children = list[ET.Element]()
    for child in element:
        if child.tag == "include":
            file = path.parent / child.get("file", "")
            if file.resolve() in seen or len(seen) > MOST_FILES:
                raise ModelError(f"{path}: {file} is included twice, or too many files are")
            seen.add(file.resolve())
            children += _included(read_xml(file), path, seen)
            continue
        inner = _included(child, path, seen)
        for old in list(child):
            child.remove(old)
        child.extend(inner)
        children.append(child)
    return children


def _resolve_folders(compiler: ET.Element, folder: Path) -> None:
    assets = compiler.attrib.pop("assetdir", ".")
    for key in ("meshdir", "texturedir"):
        compiler.set(key, str(folder / compiler.get(key, assets)))


def _classes(
    default: ET.Element, inherited: Mapping[str, Attributes], name: str = "main"
) -> Iterator[tuple[str, Mapping[str, Attributes]]]:
    """Yield each default class and its attributes by tag, those of the outer classes included."""
    own = {tag: dict(attributes) for tag, attributes in inherited.items()}
    own[ACTUATOR] = merged_defaults(default, own.get(ACTUATOR, {}))
    for child in default:
        if child.tag in WITH_DEFAULTS:
            own[child.tag] = _over(own.get(child.tag, {}), child.attrib)
    yield name, own
    for child in default:
        if child.tag == "default":
            yield from _classes(child, own, child.get("class", ""))


def _over(inherited: Attributes, own: Attributes) -> dict[str, str]:
    """Return attributes with ``own`` ones first; of the ways to give a rotation one counts."""
    replaced = set(TURNS) if any(key in own for key in TURNS) else set[str]()
    return {key: text for key, text in inherited.items() if key not in replaced} | dict(own)


def _resolve_defaults(
    body: ET.Element, outer: str, classes: Mapping[str, Mapping[str, Attributes]], path: Path
) -> None:
    """Write out the attributes of all joints, geoms and sites below a body."""
    outer = body.attrib.pop("childclass", outer)
    for child in body:
        if child.tag in ("body", "frame"):
            _resolve_defaults(child, outer, classes, path)
        if child.tag in WITH_DEFAULTS:
            _write_out(child, child.tag, classes, child.attrib.pop("class", outer), path)


def _write_out(
    element: ET.Element,
    tag: str,
    classes: Mapping[str, Mapping[str, Attributes]],
    name: str,
    path: Path,
) -> None:
    """Write out the attributes of an element of the class ``name``."""
    if name not in classes:
        raise ModelError(f"{path}: <{element.tag}> is of class {name!r}, which has no <default>")
    attributes = _over(classes[name].get(tag, {}), element.attrib)
    if tag != ACTUATOR and "fromto" not in attributes and any(key in attributes for key in TURNS):
        attributes.setdefault("pos", "0 0 0")  # without it Pinocchio drops the rotation
    element.attrib.clear()
    element.attrib.update(attributes)


def _split_joints(parent: ET.Element) -> None:
    """Put all but the last of a body's joints on massless bodies around it, in their order."""
    for k, body in enumerate(list(parent)):
        if body.tag != "body":
            continue
        _split_joints(body)
        joints = body.findall("joint")
        outermost = inner = body
        for joint in joints[:-1]:
            body.remove(joint)
            name = f"{body.get('name', 'body')}:{joint.get('name', len(outermost))}"
            around = ET.Element("body", {"name": name})
            ET.SubElement(around, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")
            around.append(joint)
            if outermost is body:
                outermost = around
            else:
                inner.append(around)
            inner = around
        if outermost is not body:
            for key in ("pos", *TURNS):
                if key in body.attrib:
                    outermost.set(key, body.attrib.pop(key))
            inner.append(body)
            parent.remove(body)
            parent.insert(k, outermost)
