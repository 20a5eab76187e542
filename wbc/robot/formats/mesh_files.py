"""Mesh files that a URDF names: where they are, and what Collada and OBJ files hold.

These two are read here, because coal (with Assimp) ignores the up axis of a Collada file, and
numbers the corners of a node's second and later sub-meshes from the first vertex of all.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.errors import ModelError, listed
from wbc.robot.formats.xml import LFS, read_xml
from wbc.rotations import exp_rotation
from wbc.validate import Array

Index = NDArray[np.int64]
# From the file's axes to z up.
_UP = {
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "Z_UP": np.eye(3),
}
# MeshLab writes Y_UP whatever the axes are (TIAGo, Borinot: their URDFs mean z).
_UP_UNKNOWN = ("MeshLab", "VCGLib")
# Of a mesh file. 400,000 triangles (the most of any robot at hand: 351,394) take 1.6 s of CPU time
# to read, 2 to draw and 4.4 to fit a shape to; a million took 44.
MOST_BYTES, MOST_TRIANGLES = 32 << 20, 400_000
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes of a binary STL file
_DEEPEST = 100  # nodes inside each other
_LINES = {"lines", "linestrips"}


def resolve_meshes(
    root: ET.Element, path: Path, package_dirs: tuple[Path, ...]
) -> dict[str, list[str]]:
    """Make every mesh name in the URDF absolute, and leave out shapes whose file is missing.

    Returns
    -------
    missing : dict of str to list of str
        What was left out of ``collision`` and ``visual`` shapes.
    """
    folders = (*package_dirs, *path.resolve().parents, *_ros_folders())
    missing: dict[str, list[str]] = {"collision": [], "visual": []}
    for link in root.findall("link"):
        for tag, names in missing.items():
            for shape in link.findall(tag):
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                name = mesh.get("filename", "")
                found = find_mesh(name, path, folders)
                if found is None or is_lfs_pointer(found):
                    why = " (a Git LFS pointer: git lfs pull)" if found else ""
                    names.append(f"{name}{why} of link {link.get('name')!r}")
                    link.remove(shape)
                else:
                    mesh.set("filename", str(found))
    return missing


def missing_notes(missing: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return a note for each kind of mesh (visual, collision) of which some are missing."""
    return tuple(
        f"{len(names)} {tag} meshes not found and left out: {listed(names, 3)}"
        + ("; package_dirs=[...]: folders of packages" if "://" in "".join(names) else "")
        for tag, names in missing.items()
        if names
    )


def find_mesh(name: str, path: Path, folders: tuple[Path, ...]) -> Path | None:
    """Return the file a mesh name means, or None.

    ``package://`` and ``model://`` names are looked up in ``folders``, with and without the
    package's name (a checkout is often renamed); others are paths, relative to the URDF's folder.
    """
    scheme, separator, rest = name.partition("://")
    if separator and scheme != "file":
        inside = rest.lstrip("/")
        without_package = inside.partition("/")[2] or inside
        candidates = [folder / inside for folder in folders]
        candidates += [folder / without_package for folder in folders]
    else:
        candidates = [path.parent / (rest if separator else name)]
    return next((file.resolve() for file in candidates if file.is_file()), None)


def _ros_folders() -> tuple[Path, ...]:
    entries = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return tuple(Path(entry) for entry in entries if entry)


class Triangles(NamedTuple):
    """Vertices (k, 3) [m] and triangles (m, 3) of their indices."""

    vertices: Array
    faces: Index


def is_lfs_pointer(path: Path) -> bool:
    """Return whether a file is not what it is named after, but says where Git LFS keeps that."""
    with path.open("rb") as file:
        return file.read(len(LFS)) == LFS


def refuse_huge_meshes(files: Iterable[Path]) -> None:
    """Look at the size of mesh files before anything reads them.

    Raises
    ------
    ModelError
        A file is larger than :data:`MOST_BYTES`, or a binary STL with more than
        :data:`MOST_TRIANGLES`.
    """
    for path in files:
        if not path.is_file():
            continue
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise _too_much(path, f"{size >> 20} MB, larger than {MOST_BYTES >> 20} MB")
        if path.suffix.lower() == ".stl" and size > _STL_TRIANGLE * MOST_TRIANGLES:
            with path.open("rb") as file:
                count = int.from_bytes(file.read(_STL_HEADER)[80:], "little")
            if size == _STL_HEADER + _STL_TRIANGLE * count:  # else text, with a tenth for its bytes
                _refuse_triangles(path, count)


def _refuse_triangles(path: Path, count: int) -> None:
    if count > MOST_TRIANGLES:
        raise _too_much(path, f"{count} triangles, more than {MOST_TRIANGLES}")


def _too_much(path: Path, what: str) -> ModelError:
    return ModelError(
        f"{path}: {what}; export the mesh with fewer triangles, some thousand show any link"
    )


def exact_meshes(shapes: pin.GeometryModel) -> None:
    """Replace the meshes of Collada and OBJ files in ``shapes`` by what the files say.

    Raises
    ------
    ModelError
        A file uses what is not supported, or is damaged.
    """
    read: dict[Path, Triangles] = {}
    for shape in shapes.geometryObjects:
        path = Path(shape.meshPath)
        if path.suffix.lower() not in _READERS or not isinstance(shape.geometry, coal.BVHModelBase):
            continue
        if path not in read:
            read[path] = read_mesh(path)
        shape.geometry = as_bvh(read[path].vertices * shape.meshScale, read[path].faces)


def read_mesh(path: Path) -> Triangles:
    """Return the triangles of a Collada or OBJ file, in metres (OBJ: as they are) with z up.

    Raises
    ------
    ModelError
        The file uses what is not supported, is damaged, or has more than :data:`MOST_TRIANGLES`.
    """
    try:
        mesh = _READERS[path.suffix.lower()](path)
    except (ValueError, KeyError, IndexError, StopIteration, OverflowError) as error:
        raise ModelError(f"{path}: damaged mesh: {error!r}; export it again") from error
    if not np.isfinite(mesh.vertices).all():
        raise ModelError(f"{path}: damaged mesh: a vertex is not finite; export it again")
    _refuse_triangles(path, len(mesh.faces))
    if not len(mesh.faces):
        raise ModelError(f"{path}: no triangles; export the mesh with triangles or polygons")
    return mesh


def as_bvh(vertices: Array, faces: Index) -> coal.BVHModelBase:
    """Return vertices (k, 3) [m] and triangles (m, 3) as coal's mesh."""
    bvh = coal.BVHModelOBBRSS()
    bvh.beginModel(len(faces), len(vertices))
    bvh.addVertices(vertices)
    bvh.addTriangles(faces)
    bvh.endModel()
    return bvh


def _fan(corners: Index, counts: Index) -> Index:
    """Return the triangles (m, 3) of polygons of ``counts`` corners each, listed one by one."""
    starts = np.repeat(np.cumsum(counts) - counts, np.maximum(counts - 2, 0))
    inner = np.concatenate([np.arange(1, count - 1) for count in counts.tolist()] or [starts])
    places = np.stack((starts, starts + inner, starts + inner + 1), axis=1)
    return corners[places.astype(np.int64)]


def _joined(parts: list[Triangles]) -> Triangles:
    """Return sub-meshes as one mesh, without vertices that no triangle uses."""
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        return Triangles(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + k for part, k in zip(parts, offsets, strict=True)])
    used, faces = np.unique(faces, return_inverse=True)
    if used[0] < 0 or any(part.faces.max(initial=-1) >= len(part.vertices) for part in parts):
        raise ValueError("a corner without a vertex")
    vertices = np.concatenate([part.vertices for part in parts])
    return Triangles(vertices[used], faces.reshape(-1, 3))


def _read_obj(path: Path) -> Triangles:
    """Return a Wavefront OBJ file; polygons become fans."""
    vertices: list[list[float]] = []
    corners: list[int] = []
    counts: list[int] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "f":
            numbers = [int(word.partition("/")[0]) for word in words]
            corners += [k - 1 if k > 0 else len(vertices) + k for k in numbers]
            counts.append(len(numbers))
    faces = _fan(np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64))
    return _joined([Triangles(np.array(vertices).reshape(-1, 3), faces)])


class _Collada:
    """A Collada document: the meshes of its scene, in metres with z up."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._root = read_xml(path)
        for element in self._root.iter():
            element.tag = element.tag.rpartition("}")[2]
        self._named = {
            "#" + element.attrib["id"]: element
            for element in self._root.iter()
            if "id" in element.attrib
        }

    def triangles(self) -> Triangles:
        scene = self._named[_child(self._root, "scene/instance_visual_scene").attrib["url"]]
        unit = self._root.find("asset/unit")
        scale = 1.0 if unit is None else float(unit.get("meter", 1.0))
        vertices, faces = _joined(list(self._below(scene, np.eye(4), 0)))
        return Triangles(scale * vertices @ self._up().T, faces)

    def _up(self) -> Array:
        tools = self._root.iterfind("asset/contributor/authoring_tool")
        if any(name in (tool.text or "") for tool in tools for name in _UP_UNKNOWN):
            return np.eye(3)
        return _UP[self._root.findtext("asset/up_axis", "Y_UP").strip()]

    def _below(self, node: ET.Element, place: Array, depth: int) -> Iterator[Triangles]:
        """Yield the sub-meshes of a node and of those inside it."""
        if depth > _DEEPEST:
            raise ModelError(f"{self._path}: more than {_DEEPEST} nodes inside each other")
        for child in node:
            place = place @ self._transform(child)
        for child in node:
            match child.tag:
                case "node":
                    yield from self._below(child, place, depth + 1)
                case "instance_node":
                    yield from self._below(self._named[child.attrib["url"]], place, depth + 1)
                case "instance_geometry":
                    for vertices, faces in self._sub_meshes(self._named[child.attrib["url"]]):
                        yield Triangles(vertices @ place[:3, :3].T + place[:3, 3], faces)
                case "instance_controller" | "skew" | "lookat":
                    self._refuse(child)

    def _transform(self, element: ET.Element) -> Array:
        transform = np.eye(4)
        match element.tag:
            case "matrix":
                transform[:] = _numbers(element).reshape(4, 4)
            case "translate":
                transform[:3, 3] = _numbers(element)
            case "scale":
                transform[:3, :3] = np.diag(_numbers(element))
            case "rotate":
                *axis, angle = _numbers(element)
                turn = np.deg2rad(angle) * np.array(axis) / np.linalg.norm(axis)
                transform[:3, :3] = exp_rotation(turn)
        return transform

    def _sub_meshes(self, geometry: ET.Element) -> Iterator[Triangles]:
        mesh = geometry.find("mesh")
        for part in self._refuse(geometry) if mesh is None else mesh:
            if part.tag in ("source", "vertices", "extra", *_LINES):
                continue
            inputs = {one.get("semantic"): one for one in part.findall("input")}
            stride = 1 + max(int(one.get("offset", 0)) for one in part.findall("input"))
            offset = int(inputs["VERTEX"].get("offset", 0))
            lists = [_numbers(p).astype(np.int64)[offset::stride] for p in part.findall("p")]
            corners = np.concatenate(lists) if lists else np.zeros(0, dtype=np.int64)
            match part.tag:
                case "triangles":
                    faces = corners.reshape(-1, 3)
                case "polylist":
                    faces = _fan(corners, _numbers(_child(part, "vcount")).astype(np.int64))
                case "polygons" | "trifans":
                    faces = _fan(corners, np.array([len(one) for one in lists], dtype=np.int64))
                case _:
                    self._refuse(part)
            yield Triangles(self._positions(inputs["VERTEX"]), faces)

    def _positions(self, vertex: ET.Element) -> Array:
        """Return the points (k, 3) that an input of semantic VERTEX means."""
        inputs = self._named[vertex.attrib["source"]].findall("input")
        position = next(one for one in inputs if one.get("semantic") == "POSITION")
        source = self._named[position.attrib["source"]]
        accessor = _child(source, "technique_common/accessor")
        stride, first = int(accessor.get("stride", 1)), int(accessor.get("offset", 0))
        values = _numbers(self._named[accessor.attrib["source"]])
        values = values[first : first + stride * int(accessor.attrib["count"])]
        return values.reshape(-1, stride)[:, :3]

    def _refuse(self, element: ET.Element) -> Iterator[ET.Element]:
        raise ModelError(
            f"{self._path}: <{element.tag}> of Collada is not supported; export plain triangles"
        )


def _child(element: ET.Element, path: str) -> ET.Element:
    child = element.find(path)
    if child is None:
        raise ValueError(f"<{element.tag}> without {path}")
    return child


def _numbers(element: ET.Element) -> Array:
    return np.array((element.text or "").split(), dtype=np.float64)


_READERS: dict[str, Callable[[Path], Triangles]] = {
    ".dae": lambda path: _Collada(path).triangles(),
    ".obj": _read_obj,
}
