"""Mesh files of a URDF: finding them, and reading Collada, OBJ and binary STL files.

The first two are read here because coal (with Assimp) ignores the up axis of a Collada file, and
numbers the corners of a node's later sub-meshes from the first vertex of all; STL files because
coal would build a BVH over each, which is rarely needed. Other formats are read by coal.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from wbc.errors import ModelError, listed
from wbc.robot.formats.collada import Collada
from wbc.robot.formats.triangles import Triangles, fan, merged
from wbc.robot.formats.xml import LFS

# Of a mesh file. 400,000 triangles (the most of any robot at hand: 351,394) take 1.6 s of CPU time
# to read, 2 to draw and 4.4 to fit a shape to; a million took 44.
MOST_BYTES, MOST_TRIANGLES = 32 << 20, 400_000
_STL_HEADER = 84  # bytes of a binary STL file
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def resolve_meshes(
    root: ET.Element, path: Path, package_dirs: tuple[Path, ...]
) -> dict[str, list[str]]:
    """Make every mesh name in the URDF absolute, and leave out shapes whose file is missing.

    Files that are not found by name are searched in the folder that the URDF gives MuJoCo
    (``<mujoco><compiler meshdir="..."/></mujoco>``), by file name only, as MuJoCo does.

    Returns
    -------
    missing : dict of str to list of str
        What was left out of ``collision`` and ``visual`` shapes.
    """
    folders = (*package_dirs, *path.resolve().parents, *_ros_folders())
    missing: dict[str, list[str]] = {"collision": [], "visual": []}
    compiler = root.find("mujoco/compiler")
    meshes = None if compiler is None else compiler.get("meshdir")
    for link in root.findall("link"):
        for tag, names in missing.items():
            for shape in link.findall(tag):
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                name = mesh.get("filename", "")
                found = find_mesh(name, path, folders)
                if found is None and meshes is not None:
                    found = find_mesh(f"{meshes}/{name.rpartition('/')[2]}", path, folders)
                if found is None or is_lfs_pointer(found):
                    why = " (a Git LFS pointer: git lfs pull)" if found else ""
                    named = name or "one without a filename"
                    names.append(f"{named}{why} of link {link.get('name')!r}")
                    link.remove(shape)
                else:
                    mesh.set("filename", str(found))
    return missing


def _ros_folders() -> list[Path]:
    """Return the folders of packages that ROS and ROS 2 name in the environment."""
    variables = ("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")
    return [
        Path(folder, inside)
        for variable, inside in variables
        for folder in os.environ.get(variable, "").split(os.pathsep)
        if folder
    ]


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
    package's name (a checkout is often renamed); others are paths, relative to the URDF's folder
    or, as exporters write some, to the package's, above it. What is not there as it is written is
    read as a URI, ``%20`` for a space.
    """
    scheme, separator, rest = name.partition("://")
    if separator and scheme != "file":
        inside = rest.lstrip("/")
        without_package = inside.partition("/")[2] or inside
        candidates = [folder / inside for folder in folders]
        candidates += [folder / without_package for folder in folders]
    else:
        here, inside = path.resolve().parent, rest if separator else name
        candidates = [here / inside, here.parent / inside]
    found = next((file.resolve() for file in candidates if file.is_file()), None)
    decoded = unquote(name)
    return found if found or decoded == name else find_mesh(decoded, path, folders)


def is_lfs_pointer(path: Path) -> bool:
    """Return whether a file is a Git LFS pointer instead of the data."""
    with path.open("rb") as file:
        return file.read(len(LFS)) == LFS


def refuse_huge_meshes(files: Iterable[Path]) -> None:
    """Check the size of mesh files before they are read.

    Raises ModelError: a file is larger than :data:`MOST_BYTES`, or a binary STL with more than
    :data:`MOST_TRIANGLES`.
    """
    for path in files:
        if not path.is_file():
            continue
        size = path.stat().st_size
        if size > MOST_BYTES:
            raise _too_large(path, f"{size >> 20} MB, larger than {MOST_BYTES >> 20} MB")
        if path.suffix.lower() == ".stl" and size > _STL_TRIANGLE.itemsize * MOST_TRIANGLES:
            _refuse_triangles(path, _binary_stl_count(path) or 0)


def _binary_stl_count(path: Path) -> int | None:
    """Return the number of triangles in a binary STL file's header; None for text files.

    Bytes may follow the triangles, as some exporters write them.
    """
    with path.open("rb") as file:
        count = int.from_bytes(file.read(_STL_HEADER)[80:], "little")
    size = _STL_HEADER + _STL_TRIANGLE.itemsize * count
    return count if path.stat().st_size >= size else None


def _refuse_triangles(path: Path, count: int) -> None:
    if count > MOST_TRIANGLES:
        raise _too_large(path, f"{count} triangles, more than {MOST_TRIANGLES}")


def _too_large(path: Path, what: str) -> ModelError:
    return ModelError(
        f"{path}: {what}; export the mesh with fewer triangles, some thousand show any link"
    )


def is_read_here(path: Path) -> bool:
    """Return whether :func:`read_mesh` knows a file."""
    suffix = path.suffix.lower()
    return suffix in _READERS and (suffix != ".stl" or _binary_stl_count(path) is not None)


def read_mesh(path: Path) -> Triangles:
    """Return the triangles of a Collada, OBJ or binary STL file.

    A Collada file's are in metres with z up, the others' as they are.

    Raises ModelError: the file uses what is not supported, is damaged, or has more than
    :data:`MOST_TRIANGLES`.
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
    faces = fan(np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64))
    return merged([Triangles(np.array(vertices).reshape(-1, 3), faces)])


def _read_stl(path: Path) -> Triangles:
    """Read a binary STL file, merging equal corners into one vertex.

    Degenerate triangles are left out. Vertices are in the order of their first use.
    """
    count = _binary_stl_count(path) or 0
    found = np.frombuffer(path.read_bytes(), _STL_TRIANGLE, count, _STL_HEADER)["corners"]
    points = np.ascontiguousarray(found).reshape(-1, 3) + np.float32(0.0)  # -0 is 0
    rows = points.view(np.dtype((np.void, points.itemsize * 3))).ravel()
    _, first, numbers = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    faces = place[numbers].reshape(-1, 3)
    a, b, c = faces.T
    kept = faces[(a != b) & (b != c) & (c != a)]
    return merged([Triangles(points[first[order]].astype(float), kept)])


_READERS: dict[str, Callable[[Path], Triangles]] = {
    ".dae": lambda path: Collada(path).triangles(),
    ".obj": _read_obj,
    ".stl": _read_stl,
}
