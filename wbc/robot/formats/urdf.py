"""Read a URDF: check it by name, complete it, and hand it to Pinocchio.

The XML is examined here first because the parser below Pinocchio prints its findings on the
terminal, names no joint in its exception, and drops a whole inertia when one number is wrong.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.formats.couplings import Coupling
from wbc.robot.formats.description import (
    Description,
    check_joint_count,
    confirm,
    pinocchio_reads,
    refuse_reserved,
)
from wbc.robot.formats.mesh_files import missing_notes, resolve_meshes
from wbc.robot.formats.urdf_check import confirm_by_mujoco
from wbc.robot.formats.urdf_exporters import (
    LIMITS,
    MOVING,
    complete_materials,
    complete_root,
    confirm_shapes,
    drop_empty_limits,
    drop_repeated,
    foreign_joints_hint,
    refuse_macros,
)
from wbc.robot.formats.urdf_floating import (
    check_floating,
    drop_world_shapes,
    float_by_one_joint,
    parent_of,
)
from wbc.robot.formats.urdf_shapes import UrdfGeometry
from wbc.robot.formats.urdf_words import unknown_words, unread_physics
from wbc.robot.formats.xml import LARGEST, LARGEST_GEAR, numbers
from wbc.robot.limits import UNLIMITED
from wbc.robot.notes import noted

KNOWN = MOVING | {"fixed", "floating"}
SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
LONGEST_CHAIN = 1000  # links
WORLD = "world"
MOST_TURNED = 1.01 * math.tau  # rad, of an origin; files round a whole turn


def read_urdf(root: ET.Element, path: Path, package_dirs: tuple[Path, ...]) -> Description:
    """Return the description of a URDF document, changing ``root`` on the way.

    The root link floats, unless a ``floating`` joint from a massless root link (usually called
    ``world``) says so already.

    Raises ModelError: the document is not one tree of links joined by revolute, continuous,
    prismatic and fixed joints, or a number in it is wrong.
    """
    refuse_macros(root, path)
    head_notes = complete_root(root, path) + unknown_words(root) + unread_physics(root)
    world_notes = _add_world(root)
    base = _checked_root(root, path)
    world_notes += float_by_one_joint(root, base, path)
    joints = root.findall("joint")
    floats = any(joint.get("type") == "floating" for joint in joints)
    notes = head_notes + world_notes + drop_empty_limits(joints)
    notes += drop_world_shapes(root, base) if floats else ()
    notes += _softer_limits(joints) + drop_repeated(root) + complete_materials(root)
    notes += (hint,) if (hint := foreign_joints_hint(root)) else ()
    shapeless = list[tuple[str, str, str]]()
    for link in root.findall("link"):
        where = f"{path}: link {link.get('name')!r}"
        _check_inertial(link, where)
        shapeless += _check_shapes(link, where)
    for joint in joints:
        _check_joint(joint, f"{path}: joint {joint.get('name')!r}")
    notes += _far_turns(root)
    coupled = dict(_coupled_joints(joints, path))
    missing = resolve_meshes(root, path, package_dirs)
    notes += missing_notes(missing)
    unknown = [f"{what} as {tag} of link {link!r}" for tag, what, link in shapeless]
    notes += noted(f"{len(unknown)} shapes that URDF does not know left out: {{}}", unknown, 3)
    missing_shapes = [
        f"{what} of link {link!r}" for tag, what, link in shapeless if tag == "collision"
    ]
    text = ET.tostring(root, encoding="unicode")
    with pinocchio_reads(path, "Pinocchio cannot read this URDF"):
        root_joint = () if floats else (pin.JointModelFreeFlyer(),)
        model = pin.buildModelFromXML(text, *root_joint)
    confirm_shapes(root, text, model, path)
    moving = [joint.get("name", "") for joint in joints if joint.get("type") in MOVING]
    confirm(model, _carried_masses(root, joints), moving, path)
    confirm_by_mujoco(root, model, path)
    return Description(
        name=root.get("name", path.stem),
        path=path,
        model=model,
        geometry=UrdfGeometry(text, path, (*missing["collision"], *missing_shapes)),
        coupled=coupled,
        bolted=None if floats else f"the root link is called {base!r}" if base == WORLD else "",
        notes=notes,
    )


def _add_world(root: ET.Element) -> tuple[str, ...]:
    """Add the link ``world``, which Drake's files leave out; return a note of it."""
    parents = {parent_of(joint) for joint in root.findall("joint")}
    if WORLD not in parents or any(link.get("name") == WORLD for link in root.findall("link")):
        return ()
    ET.SubElement(root, "link", {"name": WORLD})
    return (f"the link {WORLD!r} is not in the file, and taken for the world",)


def _checked_root(root: ET.Element, path: Path) -> str:
    """Return the name of the root of the one tree into which joints join all links."""
    links = [link.get("name", "") for link in root.findall("link")]
    joints = root.findall("joint")
    if not links:
        is_srdf = root.find("group") is not None or root.find("group_state") is not None
        hint = ": an SRDF? load the URDF, with srdf=" if is_srdf else "; a robot needs at least one"
        raise ModelError(f"{path}: no <link>{hint}")
    _refuse_repeated(links, "link", path)
    _refuse_repeated([joint.get("name", "") for joint in joints], "joint", path)
    known, parents = set(links), dict[str, str]()
    for joint in joints:
        parent, child = _ends(joint, known, path)
        if child in parents:
            raise ModelError(
                f"{path}: link {child!r} hangs on both {parents[child]!r} and {parent!r};"
                " closed loops are not supported: describe an open tree"
            )
        parents[child] = parent
    roots = [link for link in root.findall("link") if link.get("name") not in parents]
    if len(roots) != 1:
        named = ", ".join(repr(link.get("name")) for link in roots) or "the joints form a loop"
        also = "; ".join(filter(None, (named, foreign_joints_hint(root))))
        raise ModelError(f"{path}: expected one root link, found {len(roots)} ({also})")
    check_floating(joints, roots[0], path)
    _check_depth(parents, path)
    moving = [joint.get("name", "") for joint in joints if joint.get("type") in MOVING]
    check_joint_count(len(moving), path)
    refuse_reserved(moving, path)
    return roots[0].get("name", "")


def _check_depth(parents: Mapping[str, str], path: Path) -> None:
    """Refuse chains so long that the recursive parser below Pinocchio would crash."""
    children: dict[str, list[str]] = {}
    for child, parent in parents.items():
        children.setdefault(parent, []).append(child)
    level, depth = [parent for parent in children if parent not in parents], 0
    while level:
        level, depth = [child for link in level for child in children.get(link, [])], depth + 1
        if depth > LONGEST_CHAIN:
            raise ModelError(f"{path}: a chain of more than {LONGEST_CHAIN} links")


def _refuse_repeated(names: list[str], kind: str, path: Path) -> None:
    for name, count in Counter(names).items():
        if not name or count > 1:
            what = f"{count} {kind}s are called {name!r}" if name else f"a {kind} has no name"
            raise ModelError(f"{path}: {what}; give each its own name")


def _ends(joint: ET.Element, links: Collection[str], path: Path) -> tuple[str, str]:
    ends = []
    for tag in ("parent", "child"):
        if len(joint.findall(tag)) > 1:
            raise ModelError(
                f"{path}: joint {joint.get('name')!r}: <{tag}> is given twice; leave one"
            )
        element = joint.find(tag)
        link = "" if element is None else element.get("link", "")
        if link not in links:
            raise ModelError(f"{path}: joint {joint.get('name')!r}: no {tag} link {link!r}")
        ends.append(link)
    return ends[0], ends[1]


def _carried_masses(root: ET.Element, joints: list[ET.Element]) -> dict[str, float]:
    """Return what each moving joint carries up to the next ones [kg]; ``""`` is the root."""
    above = {child.get("link", ""): joint for joint in joints for child in joint.findall("child")}
    carried = dict[str, list[float]]()
    for link in root.findall("link"):
        joint = above.get(link.get("name", ""))
        while joint is not None and joint.get("type") == "fixed":
            joint = above.get(parent_of(joint) or "")
        moved = joint is not None and joint.get("type") in MOVING
        name = joint.get("name", "") if joint is not None and moved else ""
        masses = (float(mass.get("value", 0)) for mass in link.findall("inertial/mass"))
        carried.setdefault(name, []).extend(masses)
    return {name: math.fsum(masses) for name, masses in carried.items()}


def _check_inertial(link: ET.Element, where: str) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    for element, tag in ((link, "inertial"), (inertial, "mass"), (inertial, "inertia")):
        if len(element.findall(tag)) > 1:
            raise ModelError(f"{where}: <{tag}> is given twice; leave one")
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise ModelError(f"{where}: <inertial> needs <mass> and <inertia>; add the missing one")
    value = numbers(mass, "value", 1, where, LARGEST)[0]
    if value < 0.0:
        raise ModelError(f"{where}: negative mass {value:g} kg; correct it")
    for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        numbers(inertia, key, 1, where, LARGEST)
    _check_origin(inertial, where)


def _check_shapes(link: ET.Element, where: str) -> Iterator[tuple[str, str, str]]:
    """Refuse shapes with wrong numbers; remove those without a solid that is known.

    The parser would print a message for both and skip them. Yield purpose, kind and link of the
    removed ones.
    """
    for shape in (*link.findall("collision"), *link.findall("visual")):
        _check_origin(shape, where)
        solids = shape.findall("geometry/*")
        if not solids or solids[0].tag not in SIZES:  # the parser reads the first one
            link.remove(shape)
            found = f"<{solids[0].tag}>" if solids else "nothing"
            yield shape.tag, found, link.get("name", "")
            continue
        for solid in solids:
            for key, count in SIZES.get(solid.tag, {}).items():
                if solid.tag == "mesh" and key not in solid.attrib:
                    continue
                values = numbers(solid, key, count, where, LARGEST)
                if solid.tag != "mesh" and min(values) < 0.0:
                    raise ModelError(f"{where}: <{solid.tag} {key}> is negative; correct it")


def _check_joint(joint: ET.Element, where: str) -> None:
    kind = joint.get("type")
    if kind not in KNOWN:
        raise ModelError(
            f"{where}: type {kind!r} is not supported; use revolute, continuous, prismatic or"
            " fixed joints (a planar or spherical joint is a chain of these)"
        )
    _check_origin(joint, where)
    if kind not in MOVING:
        return
    if kind == "continuous" and joint.find("mimic") is not None:
        _make_revolute(joint)
    axis = joint.find("axis")
    if axis is not None and not any(numbers(axis, "xyz", 3, where)):
        raise ModelError(f"{where}: its axis is 0 0 0; give a direction")
    _complete_limit(joint, where)
    dynamics = joint.find("dynamics")
    for key in ("damping", "friction"):
        if dynamics is not None and key in dynamics.attrib:
            value = numbers(dynamics, key, 1, where, LARGEST)[0]
            if value < 0.0:
                raise ModelError(f"{where}: negative {key} {value:g}; correct it")


def _make_revolute(joint: ET.Element) -> None:
    """Turn a continuous mimic joint into a revolute one without limits.

    Its coordinate is an angle then, as its driver's, instead of Pinocchio's (cos, sin).
    """
    joint.set("type", "revolute")
    for limit in joint.findall("limit"):
        for key in ("lower", "upper"):
            limit.attrib.pop(key, None)


def _check_origin(element: ET.Element, where: str) -> None:
    origin = element.find("origin")
    if origin is None:
        return
    for key, count in (("xyz", 3), ("rpy", 3), ("quat_xyzw", 4)):
        given = key in origin.attrib and numbers(origin, key, count, where, LARGEST)
        if given and key == "quat_xyzw" and not any(given):
            raise ModelError(f"{where}: <origin quat_xyzw> is 0: no rotation; give x y z w")
    if {"rpy", "quat_xyzw"} <= {*origin.attrib}:
        raise ModelError(f"{where}: <origin> has both 'rpy' and 'quat_xyzw'; leave one")


def _far_turns(root: ET.Element) -> tuple[str, ...]:
    """Return a note of what is turned by more than a turn, as by angles in degrees."""
    placed = [
        (part, origin)
        for part in (*root.findall("link"), *root.findall("joint"))
        for one in (part, *part)
        if one.tag in ("joint", "inertial", "collision", "visual")
        for origin in one.findall("origin[@rpy]")
    ]
    far = [
        f"{part.tag} {part.get('name')!r}"
        for part, origin in placed
        if max(abs(float(angle)) for angle in origin.get("rpy", "").split()) > MOST_TURNED
    ]
    return noted("<origin rpy> is in radians, and more than a turn: in degrees? {}", far)


def _softer_limits(joints: list[ET.Element]) -> tuple[str, ...]:
    """Return a note of limits within the limits, at which ROS's controllers hold a joint back."""
    softer = list[str]()
    for joint in joints:
        safety, limit = joint.find("safety_controller"), joint.find("limit")
        if safety is None or limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        try:
            soft = [float(safety.get(f"soft_{end}_limit", 0)) for end in ("lower", "upper")]
            hard = [float(limit.get(end, 0)) for end in ("lower", "upper")]
        except ValueError:  # refused later where it matters
            continue
        if any(soft) and (soft[0] > hard[0] or soft[1] < hard[1]):
            softer.append(f"{joint.get('name')} at {soft[0]:g} and {soft[1]:g}")
    return noted("not used: soft limits of safety controllers, of {}; Limits(margin=...)", softer)


INFINITE = ("inf", "+inf", "infinity", "+infinity"), ("-inf", "-infinity")


def _complete_limit(joint: ET.Element, where: str) -> None:
    """Check a moving joint's limits, and write the missing ones as the parser accepts them."""
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit")
    if joint.get("type") != "continuous" and not {"lower", "upper"} & set(limit.attrib):
        limit.set("lower", str(-UNLIMITED))
        limit.set("upper", str(UNLIMITED))
    for key in set(LIMITS) & set(limit.attrib):  # as ROS's parser reads infinity, too
        unlimited = -UNLIMITED if key == "lower" else UNLIMITED
        if limit.get(key, "").strip().lower() in INFINITE[key == "lower"]:
            limit.set(key, str(unlimited))
    given = {key: numbers(limit, key, 1, where)[0] for key in limit.attrib if key in LIMITS}
    if given.get("lower", 0.0) > given.get("upper", 0.0):
        both = {"lower", "upper"} <= set(given)
        remedy = "swap them" if both else "the one left out is 0: give both"
        raise ModelError(
            f"{where}: lower limit {given.get('lower', 0.0):g} is above the upper limit"
            f" {given.get('upper', 0.0):g}; {remedy}"
        )
    for key in ("effort", "velocity"):
        if given.get(key, 0.0) < 0.0:
            raise ModelError(f"{where}: negative {key} limit {given[key]:g}; correct it")
        limit.attrib.setdefault(key, "0")


def _coupled_joints(joints: list[ET.Element], path: Path) -> Iterator[tuple[str, Coupling]]:
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") in MOVING:
            where = f"{path}: joint {joint.get('name')!r}"
            if not mimic.get("joint"):
                raise ModelError(f"{where}: <mimic> has no 'joint' to follow; add it")
            ratio, offset = (
                numbers(mimic, key, 1, where, LARGEST_GEAR)[0] if key in mimic.attrib else default
                for key, default in (("multiplier", 1.0), ("offset", 0.0))
            )
            yield joint.get("name", ""), Coupling(mimic.get("joint", ""), ratio, offset)
            joint.remove(mimic)
