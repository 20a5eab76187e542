"""Find the mesh files a URDF names, so that a missing one is a note and not a failure."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path


def resolve_meshes(root: ET.Element, path: Path, package_dirs: tuple[Path, ...]) -> tuple[str, ...]:
    """Make every mesh name in the URDF absolute, and leave out shapes whose file is missing.

    Returns
    -------
    notes : tuple of str
        One for collision and one for visual shapes, if any was left out.
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
                if found is None:
                    names.append(f"{name} of link {link.get('name')!r}")
                    link.remove(shape)
                else:
                    mesh.set("filename", str(found))
    return tuple(
        f"{len(names)} {tag} meshes not found and left out: {', '.join(names[:3])}"
        + (", ..." if len(names) > 3 else "")
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
