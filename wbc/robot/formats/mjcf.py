"""Read MJCF (MuJoCo's XML) through Pinocchio, refusing what Pinocchio would silently misread."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.robot.formats.description import (
    Coupling,
    Description,
    State,
    check_joint_count,
    confirm,
    pinocchio_reads,
)
from wbc.robot.formats.mesh_files import refuse_huge_meshes
from wbc.robot.formats.mjcf_actuators import bound_efforts
from wbc.robot.formats.mjcf_document import plain_document
from wbc.robot.formats.mjcf_scene import robot_alone
from wbc.robot.formats.xml import LARGEST, LARGEST_GEAR, numbers, refuse_non_finite

UNREAD = {"attach", "replicate", "composite", "flexcomp"}
MISREAD = ("settotalmass", "boundmass", "boundinertia", "inertiagrouprange")
NUMBERED = {"joint", "geom", "site", "inertial"}
COUNTS = {
    **dict.fromkeys(("pos", "euler", "zaxis", "axis", "diaginertia"), 3),
    **dict.fromkeys(("quat", "axisangle", "rgba"), 4),
    **dict.fromkeys(("xyaxes", "fullinertia", "fromto"), 6),
    **dict.fromkeys(("range", "actuatorfrcrange"), 2),
    **dict.fromkeys(("mass", "density", "armature", "ref", "damping", "frictionloss"), 1),
}
DIRECTIONS = {"quat", "zaxis", "axis", "xyaxes", "fromto"}
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "plane": 3}
UNNAMED = "?"
QPOS0 = "qpos0"  # the key frame Pinocchio adds by itself: the zero posture


@dataclass(frozen=True)
class MjcfGeometry:
    """Shapes of a plain MJCF document (see :mod:`wbc.robot.formats.mjcf_document`)."""

    text: str  # the document, without shapes whose mesh file is missing
    path: Path  # the file it was made of
    lost: tuple[str, ...]  # those of these shapes that collide

    def load(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> pin.GeometryModel:
        """See :class:`wbc.robot.formats.description.GeometrySource`."""
        root = ET.fromstring(self.text)
        if links is not None:  # Pinocchio reads all meshes that it finds, which takes seconds
            for body in root.findall("worldbody//body"):
                if body.get("name") not in (None, *links):
                    _remove(body, body.findall("geom"))
        used = {geom.get("mesh") for geom in root.iter("geom")}
        refuse_huge_meshes(file for name, file in _mesh_files(root).items() if name in used)
        text = ET.tostring(root, encoding="unicode")
        with _file_of(text, self.path, "shapes cannot be loaded") as file:
            shapes = pin.buildGeomFromMJCF(model, file, kind)
        # A new model: what `geometryObjects` hands out are references into a vector, which removing
        # an entry would move under them.
        kept = pin.GeometryModel()
        for shape in shapes.geometryObjects:
            link = model.frames[shape.parentFrame].name
            scenery = shape.parentJoint == 0
            if not scenery and (links is None or link in links):
                kept.addGeometryObject(shape.copy())
        return kept


def read_mjcf(root: ET.Element, path: Path) -> Description:
    """Return the description of one robot; a free joint is given to it if the file has none.

    Raises
    ------
    ModelError
        ``<replicate>`` and the like, several trees, closed loops, inertias from meshes, numbers not
        finite, what Pinocchio itself refuses, or masses and joints other than the file says.
    """
    root = plain_document(root, path)
    notes = robot_alone(root, path)
    _check_structure(root, path)
    refuse_non_finite(root, path)
    _check_numbers(root, path)
    coupled = dict(_coupled_joints(root, path))
    joints = root.findall("worldbody//joint")
    check_joint_count(len(joints), path)
    _keep_slides(root)
    base = _take_base_pose(root)
    text = ET.tostring(root, encoding="unicode")
    with _file_of(text, path, "Pinocchio cannot read this MJCF") as file:
        model = pin.buildModelFromMJCFAndRootJoint(file, pin.JointModelFreeFlyer())
    names = [j.get("name", "") for j in joints if j.get("type", "hinge") in ("hinge", "slide")]
    confirm(model, _carried_masses(root, path), [name for name in names if name], path)
    bound_efforts(model, root, path)
    missing, lost = _leave_out_missing_meshes(root)
    if missing:
        some = listed(missing, 3)
        notes += (f"{len(missing)} shapes left out, as their meshes were not found: {some}",)
    return Description(
        name=root.get("model", path.stem),
        path=path,
        model=model,
        geometry=MjcfGeometry(ET.tostring(root, encoding="unicode"), path, lost),
        coupled=coupled,
        states=dict(_key_frames(model)),
        base=base,
        bolted=None if _floats(root) else "the root has no free joint",
        notes=notes,
    )


def _take_base_pose(root: ET.Element) -> tuple[float, ...]:
    """Take the pose of the root body out of a plain document; return it as a free-flyer's q.

    Pinocchio would drop it where the root has no free joint, and where it has one, and is turned,
    place the joint beside the origin, so that q were not the base's pose.
    """
    body = root.findall("worldbody/body")[0]
    x, y, z = (float(word) for word in body.attrib.pop("pos", "0 0 0").split())
    w, *axis = (float(word) for word in body.attrib.pop("quat", "1 0 0 0").split())
    size = math.hypot(w, *axis)
    return (x, y, z, *(part / size for part in (*axis, w)))


@contextmanager
def _file_of(text: str, path: Path, failure: str) -> Iterator[str]:
    """Give a document a file for as long as Pinocchio reads it; errors name ``path``."""
    with TemporaryDirectory(prefix="wbc-") as folder:
        file = Path(folder) / "plain.xml"
        file.write_text(text, encoding="utf-8")
        with pinocchio_reads(path, failure, copy=str(file)):
            yield str(file)


def _check_numbers(root: ET.Element, path: Path) -> None:
    """Refuse attributes with too few numbers: Pinocchio would read uninitialised memory."""
    for body in root.findall("worldbody//body"):
        for element in (body, *(child for child in body if child.tag in NUMBERED)):
            where = f"{path}: body {body.get('name', '?')!r}"
            for key, count in COUNTS.items():
                if key in element.attrib:
                    values = numbers(element, key, count, where, LARGEST)
                    if key in DIRECTIONS and not any(values):
                        raise ModelError(f"{where}: <{element.tag} {key}> is all 0")
            if element.tag == "geom":
                _check_size(element, where)


def _check_size(geom: ET.Element, where: str) -> None:
    kind = geom.get("type", "sphere")
    least = 1 if "fromto" in geom.attrib else SIZES.get(kind, 0)
    count = len(geom.get("size", "").split())
    values = numbers(geom, "size", count, where, LARGEST) if count else []
    if count < least or any(value < 0.0 for value in values):
        raise ModelError(f"{where}: <geom size> of a {kind} needs {least} numbers, none negative")


def _carried_masses(root: ET.Element, path: Path) -> dict[str, float]:
    """Return what each moving joint carries up to the next ones [kg]; ``""`` is the root.

    NaN where shapes' volumes give it, and nothing for joints without a name.
    """
    from_shapes = _compiler(root).get("inertiafromgeom", "auto") == "true"
    carried = dict[str, float]()
    bodies = [("", body) for body in root.findall("worldbody/body")]
    roots = len(bodies)
    for k, (joint, body) in enumerate(bodies):  # the list grows on the way
        joints = [*body.findall("joint"), *body.findall("freejoint")]
        free = [j for j in joints if j.tag == "freejoint" or j.get("type") == "free"]
        own = [j.get("name") for j in joints if k >= roots or j not in free]
        name = (own[0] or UNNAMED) if own else joint
        mass = _mass(body, from_shapes, f"{path}: body {body.get('name', '?')!r}")
        carried[name] = carried.get(name, 0.0) + mass
        bodies += [(name, child) for child in body.findall("body")]
    if UNNAMED in carried:  # several may be added up there
        del carried[UNNAMED]
        carried[""] = math.nan  # so that the sum is not compared
    return carried


def _mass(body: ET.Element, from_shapes: bool, where: str) -> float:
    inertial = body.find("inertial")
    if inertial is not None and not from_shapes:
        return numbers(inertial, "mass", 1, where)[0]
    geoms = body.findall("geom")
    return math.fsum(
        numbers(geom, "mass", 1, where)[0] if "mass" in geom.attrib else math.nan for geom in geoms
    )


def _compiler(root: ET.Element) -> Mapping[str, str]:
    """Return the settings of a plain document, which has one ``<compiler>`` at most."""
    compiler = root.find("compiler")
    return {} if compiler is None else compiler.attrib


def _floats(root: ET.Element) -> bool:
    joints = root.findall("worldbody/body/*")
    return any(j.tag == "freejoint" or (j.tag, j.get("type")) == ("joint", "free") for j in joints)


def _check_structure(root: ET.Element, path: Path) -> None:
    for element in root.iter():
        if element.tag in UNREAD:
            raise ModelError(
                f"{path}: <{element.tag}> is not supported (Pinocchio leaves it out); give the"
                " robot's own file, or let MuJoCo save the compiled model to one file"
            )
    _check_compiler(root, path)
    from_shapes = _compiler(root).get("inertiafromgeom") == "true"
    for body in root.findall("worldbody//body"):
        drawn = any("mesh" in geom.attrib for geom in body.findall("geom"))
        if drawn and (from_shapes or body.find("inertial") is None):
            raise ModelError(
                f"{path}: body {body.get('name', '?')!r} takes its inertia from a mesh, for which"
                " Pinocchio puts 1 kg and 1 kg m^2; give the body an <inertial>"
            )


def _check_compiler(root: ET.Element, path: Path) -> None:
    """Refuse settings that change masses or limits in MuJoCo and that Pinocchio passes over."""
    compiler = _compiler(root)
    for name in MISREAD:
        if name in compiler:
            raise ModelError(
                f"{path}: <compiler {name}=...> is not read by Pinocchio, masses would be"
                " wrong; let MuJoCo save the compiled model to one file"
            )
    loose = compiler.get("autolimits") == "false"
    for joint in root.iter("joint"):
        limited = joint.get("limited", "false" if loose else "auto")
        if limited == "false" and "range" in joint.attrib:
            raise ModelError(
                f"{path}: joint {joint.get('name', '?')!r} has a range that is switched"
                " off, which Pinocchio would enforce; remove the range"
            )


def _keep_slides(root: ET.Element) -> None:
    """Write the ranges of sliding joints as Pinocchio, which takes them as degrees, reads them."""
    if _compiler(root).get("angle") == "radian":
        return
    for joint in root.findall("worldbody//joint"):
        if joint.get("type") == "slide" and "range" in joint.attrib:
            lengths = (float(word) for word in joint.attrib["range"].split())
            joint.set("range", " ".join(repr(math.degrees(length)) for length in lengths))


def _coupled_joints(root: ET.Element, path: Path) -> Iterator[tuple[str, Coupling]]:
    zeroed = {joint.get("name") for joint in root.iter("joint") if float(joint.get("ref", 0)) == 0}
    for constraint in root.findall("equality/*"):
        if constraint.tag != "joint":
            raise ModelError(
                f"{path}: equality constraint <{constraint.tag}"
                f" name={constraint.get('name', '')!r}>: closed loops are not supported;"
                " remove it and describe an open tree"
            )
        if constraint.get("active") == "false":
            continue
        joint, driver = constraint.get("joint1", "?"), constraint.get("joint2", "a constant")
        where = f"{path}: equality constraint of joint {joint!r}"
        count = len(constraint.get("polycoef", "").split())
        powers = numbers(constraint, "polycoef", count, where, LARGEST_GEAR) if count else []
        offset, ratio, *curved = (*powers, *(0.0, 1.0, 0.0, 0.0, 0.0)[len(powers) :])
        if any(curved) or not {joint, driver} <= zeroed:
            driver = f"a polynomial of {driver}"
        yield joint, Coupling(driver, ratio, offset)


def _mesh_files(root: ET.Element) -> dict[str, Path]:
    """Return the mesh files of a plain document by the names that shapes call them."""
    folder = Path(_compiler(root).get("meshdir", ""))
    files = [(mesh, mesh.get("file")) for mesh in root.findall("asset/mesh")]
    return {
        mesh.get("name", Path(file).stem): folder / file for mesh, file in files if file is not None
    }


def _leave_out_missing_meshes(root: ET.Element) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Remove shapes whose mesh file is missing, for which Pinocchio would read none at all.

    Return them in words, and those that collide.
    """
    missing = {name: file for name, file in _mesh_files(root).items() if not file.is_file()}
    shapes = dict[str, bool]()
    for body in root.findall("worldbody//body"):
        gone = [geom for geom in body.findall("geom") if geom.get("mesh") in missing]
        for geom in gone:
            name = f"{missing[geom.get('mesh', '')].name} of body {body.get('name', '?')!r}"
            drawn = geom.get("contype") == geom.get("conaffinity") == "0"
            shapes[name] = shapes.get(name, False) or not drawn
        _remove(body, gone)
    return tuple(shapes), tuple(name for name, collides in shapes.items() if collides)


def _remove(parent: ET.Element, children: Iterable[ET.Element]) -> None:
    for child in children:
        parent.remove(child)


def _key_frames(model: pin.Model) -> Iterator[tuple[str, State]]:
    for entry in model.referenceConfigurations:
        name, q = entry.key(), entry.data()
        if name == QPOS0:
            continue
        layout = zip(model.names, model.idx_qs, model.nqs, strict=True)
        yield name, {joint: tuple(q[at : at + size].tolist()) for joint, at, size in layout if size}
