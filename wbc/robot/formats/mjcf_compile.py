"""Compile MJCF with MuJoCo, so that a file means what its own compiler makes of it.

Files needed for pictures only are skipped: textures are not read, and shapes whose mesh is missing
are left out with a note, unless a body's inertia depends on them.
"""

from __future__ import annotations

import copy
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from wbc.errors import ModelError
from wbc.extras import quietly, require
from wbc.robot.formats.mesh_files import is_lfs_pointer, refuse_huge_meshes
from wbc.robot.formats.mjcf_balls import delete_from, without_balls
from wbc.robot.formats.xml import read_xml, refuse_non_finite
from wbc.robot.notes import noted

ENDINGS = (".xml", ".urdf")  # of files that MuJoCo opens
MOST_COPIES = 1000  # of what <replicate> and the like repeat
REPEATING = ("replicate", "composite", "flexcomp")
# Attributes of older files that MuJoCo has removed, by element, and that do not affect robots.
REMOVED_ATTRIBUTES = {"flag": ("sensornoise",), "option": ("apirate",)}


@dataclass(frozen=True, eq=False)
class Compiled:
    """A compiled model, with notes of what was left out."""

    mujoco: Any  # the module
    model: Any  # mujoco.MjModel
    name: str
    notes: tuple[str, ...] = ()
    missing_shapes: tuple[str, ...] = ()  # shapes that collide and were not found, in words


def is_mujoco(source: object, kind: str) -> bool:
    """Return whether something is MuJoCo's ``MjModel`` or ``MjSpec``, without loading MuJoCo."""
    return type(source).__name__ == kind and type(source).__module__.startswith("mujoco")


def compile_mjcf(source: Any, path: Path, root: ET.Element | None = None) -> Compiled:
    """Return the compiled model of a file, of XML text, or of what MuJoCo made already.

    ``source``: the file's path, its text, an ``MjSpec`` (which is not changed) or an ``MjModel``.
    ``path``: what messages call it.
    ``root``: the document, if it was read; its numbers are looked at first.

    Raises MissingPackageError: MuJoCo is not installed; ModelError: MuJoCo refuses it; the message
    says what MuJoCo says.
    """
    require("mujoco", "reading MJCF")
    import mujoco

    if is_mujoco(source, "MjModel"):
        name = bytes(source.names).split(b"\0")[0].decode(errors="replace")
        return Compiled(mujoco, source, _name_or_stem(name, path))
    if root is not None:
        root = copy.deepcopy(root)
        _include(root, (path.parent if isinstance(source, Path) else Path(),), set())
        refuse_non_finite(root, path)
        _refuse_many_copies(root, path)
    with quietly(mujoco), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            older = () if root is None else _drop_removed(root)
            unknown = isinstance(source, Path) and source.suffix not in ENDINGS
            if root is not None and (older or unknown):
                source = _spec_of(mujoco, root, source)
            found = _compiled(mujoco, source, path)
        except (ValueError, RuntimeError, TypeError, MemoryError, mujoco.FatalError) as error:
            said = " ".join(str(error).removeprefix("Error: ").split())
            raise ModelError(f"{path}: MuJoCo refuses this MJCF: {said}") from error
    words = dict.fromkeys(" ".join(str(one.message).split()) for one in told)
    notes = tuple(f"MuJoCo says: {one}" for one in words)
    notes += noted("left out, as MuJoCo knows them no more: {}", older)
    return replace(found, notes=found.notes + notes)


def _include(element: ET.Element, folders: tuple[Path, ...], seen: set[Path]) -> None:
    """Put what files include into a document; MuJoCo tells what is missing or included twice."""
    for child in list(element):
        name = child.get("file", "") if child.tag == "include" else ""
        file = next((place for one in folders if (place := one / name).is_file()), None)
        if child.tag != "include":
            _include(child, folders, seen)
        elif file is not None and file.resolve() not in seen:
            seen.add(file.resolve())
            included = read_xml(file)
            _include(included, (folders[0], file.parent), seen)
            k = list(element).index(child)
            element[k : k + 1] = list(included)


def _drop_removed(root: ET.Element) -> tuple[str, ...]:
    """Drop the :data:`REMOVED_ATTRIBUTES` of a document; return them in words."""
    return tuple(
        f"<{tag} {name}>"
        for tag, names in REMOVED_ATTRIBUTES.items()
        for element in root.iter(tag)
        for name in names
        if element.attrib.pop(name, None) is not None
    )


def _spec_of(mujoco: Any, root: ET.Element, source: Any) -> Any:
    """Return the specification of a document that was read from ``source``."""
    folder = source.parent if isinstance(source, Path) else Path()
    for nested in root.iterfind("asset/model"):  # opened before the specification has a folder
        nested.set("file", str(folder.resolve() / nested.get("file", "")))
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    if isinstance(source, Path):
        spec.modelfiledir = str(folder)
    return spec


def _name_or_stem(name: str, path: Path) -> str:
    return path.stem if name in ("", "MuJoCo Model") else name


def _refuse_many_copies(root: ET.Element, path: Path) -> None:
    """Refuse numbers of copies that take memory and minutes."""
    for element in root.iter():
        copies = 1.0
        for word in element.get("count", "").split() if element.tag in REPEATING else ():
            copies *= float(word) if word.strip("+").isdecimal() else 1.0
        if copies > MOST_COPIES:
            raise ModelError(
                f"{path}: <{element.tag} count={element.get('count')!r}>: more than {MOST_COPIES}"
                " copies; is it a robot?"
            )


def _spec(mujoco: Any, source: Any) -> Any:
    """Return a specification that may be changed."""
    if isinstance(source, Path):
        spec = mujoco.MjSpec.from_file(str(source))
    elif isinstance(source, str):
        spec = mujoco.MjSpec.from_string(source)
    else:
        spec = source.copy()
        spec.modelfiledir = source.modelfiledir  # which copies forget in some versions
    # Links that are fixed to others keep their names, and geoms that are only drawn stay.
    for field in ("fusestatic", "discardvisual"):
        if hasattr(spec.compiler, field):
            setattr(spec.compiler, field, False)
    for unread in (*spec.sensors, *spec.skins):  # whose files and objects may be elsewhere
        delete_from(spec, unread)
    for texture in spec.textures:
        _drop_texture_file(mujoco, texture)
    return spec


def _drop_texture_file(mujoco: Any, texture: Any) -> None:
    """Replace a texture's file by a plain colour: robots do not need it."""
    files = [str(texture.file or ""), *(str(file) for file in texture.cubefiles)]
    if not any(files):
        return
    if not texture.name:  # it goes by its file's
        texture.name = Path(next(file for file in files if file)).stem
    texture.file = ""
    for k in range(len(texture.cubefiles)):
        texture.cubefiles[k] = ""
    texture.type = mujoco.mjtTexture.mjTEXTURE_2D
    texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture.width = texture.height = 1


def _compiled(mujoco: Any, source: Any, path: Path) -> Compiled:
    spec = _spec(mujoco, source)
    name = _name_or_stem(str(spec.modelname), path)
    refuse_huge_meshes(file for _, file in _files(spec, spec.meshes) if file is not None)
    try:
        return _with_hinges(mujoco, spec, name)
    except ValueError:
        spec = _spec(mujoco, source)  # what failed to compile cannot be changed
        shapes, missing = _leave_out_missing(mujoco, spec, path)
        elsewhere = _leave_out_pairs(spec)
        if not missing and not elsewhere:
            raise
    told = f"{len(shapes)} shapes left out, as their meshes were not found: {{}}"
    notes = noted(told, shapes, 3)
    notes += noted("contact pairs with what is not in the file left out: {}", elsewhere)
    missing_shapes = tuple(words for words, collides in shapes.items() if collides)
    return _with_hinges(mujoco, spec, name, notes, missing_shapes)


def _with_hinges(
    mujoco: Any, spec: Any, name: str, notes: tuple[str, ...] = (), missing: tuple[str, ...] = ()
) -> Compiled:
    """Return a specification, compiled, with hinges for ball joints."""
    model, more = without_balls(mujoco, spec, spec.compile())
    return Compiled(mujoco, model, name, notes + more, missing)


def _files(spec: Any, assets: Any) -> Iterator[tuple[Any, Path | None]]:
    """Yield assets and their files; none for what is given as vertices or held in memory."""
    folder = Path(str(spec.modelfiledir or "."))
    # The folder is the specification's in older MuJoCo, and its compiler's in newer.
    kind = str(getattr(spec, "meshdir", "") or getattr(spec.compiler, "meshdir", ""))
    held = {str(name) for name in dict(spec.assets or {})}
    for asset in assets:
        file = str(asset.file or "")
        strip = bool(getattr(spec, "strippath", False))
        if not file or file in held or Path(file).name in held:
            yield asset, None
            continue
        name = Path(Path(file).name if strip else file)
        places = [folder / kind / name, folder / name, Path(kind) / name, name]
        yield asset, next((place for place in places if place.is_file()), places[0])


def _leave_out_missing(mujoco: Any, spec: Any, path: Path) -> tuple[dict[str, bool], int]:
    """Remove the meshes whose files are missing, and all that uses them.

    Return the shapes in words, and whether they collide; and how many files are missing.
    """
    gone = dict[str, str]()
    for mesh, file in _files(spec, spec.meshes):
        if file is None or (file.is_file() and not is_lfs_pointer(file)):
            continue
        why = " (a Git LFS pointer: git lfs pull)" if file.is_file() else ""
        gone[str(mesh.name) or file.stem] = file.name + why
    shapes = dict[str, bool]()
    for body in spec.bodies:
        for geom in list(body.geoms):
            if str(geom.meshname) not in gone:
                continue
            where = f"{gone[str(geom.meshname)]} of body {str(body.name)!r}"
            if _counts_in_inertia(spec, body, geom):
                raise ModelError(
                    f"{path}: mesh {where} was not found, and the body takes its inertia from it;"
                    " bring the file, or give the body an <inertial>"
                )
            shapes[where] = shapes.get(where, False) or bool(geom.contype or geom.conaffinity)
            delete_from(spec, geom)
    for site in list(spec.sites):
        if str(getattr(site, "meshname", "")) in gone:
            site.type, site.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
    meshes = [one for one in spec.meshes if (str(one.name) or Path(str(one.file)).stem) in gone]
    for mesh in meshes:
        delete_from(spec, mesh)
    return shapes, len(meshes) + _leave_out_ground(spec)


def _leave_out_ground(spec: Any) -> int:
    """Remove height fields whose files are missing; return how many."""
    fields = [field for field, file in _files(spec, spec.hfields) if file and not file.is_file()]
    names = {str(field.name) for field in fields}
    for geom in list(spec.geoms):
        if str(geom.hfieldname) in names:
            delete_from(spec, geom)
    for field in fields:
        delete_from(spec, field)
    return len(fields)


def _leave_out_pairs(spec: Any) -> list[str]:
    """Remove contact pairs with shapes of a scene that includes the file; return these shapes."""
    known = {str(geom.name) for geom in spec.geoms}
    found = dict[str, None]()
    for pair in list(spec.pairs):
        unknown = [name for name in (str(pair.geomname1), str(pair.geomname2)) if name not in known]
        found |= dict.fromkeys(unknown)
        if unknown:
            delete_from(spec, pair)
    return list(found)


def _counts_in_inertia(spec: Any, body: Any, geom: Any) -> bool:
    """Return whether a geom's mass counts in the inertia of its body."""
    low, high = spec.compiler.inertiagrouprange
    counting = (1,) if body.explicitinertial else (1, 2)  # true; auto, where there is no <inertial>
    inferred = int(spec.compiler.inertiafromgeom) in counting and low <= int(geom.group) <= high
    if str(body.name) == "world" or not inferred:
        return False
    mass = float(geom.mass)
    return mass > 0.0 or (mass != mass and float(geom.density) > 0.0)
