"""The shapes of a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.robot.formats.description import NO_RULES, ContactRules, pinocchio_reads
from wbc.robot.formats.mesh_files import is_read_here, read_mesh, refuse_huge_meshes
from wbc.robot.formats.triangles import Surfaces, Triangles
from wbc.robot.formats.urdf_exporters import SHAPES
from wbc.validate import Array


@dataclass(frozen=True)
class UrdfGeometry:
    """Shapes of a URDF: its text, in which mesh names are absolute and missing meshes left out.

    ``missing_shapes`` are the collision shapes that were left out.
    """

    text: str
    path: Path
    missing_shapes: tuple[str, ...]
    rules: ContactRules = NO_RULES  # a URDF has none

    def content(self) -> Iterator[bytes]:
        """See :class:`wbc.robot.formats.description.GeometrySource`."""
        yield self.text.encode()
        meshes = ET.fromstring(self.text).iterfind(f".//{SHAPES[pin.GeometryType.COLLISION]}//mesh")
        for file in sorted({mesh.get("filename", "") for mesh in meshes}):
            yield Path(file).read_bytes()

    def surfaces(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> Surfaces:
        """See :class:`wbc.robot.formats.description.GeometrySource`.

        Meshes of formats that are not read here are in the model as Pinocchio reads them.
        """
        root, tag = ET.fromstring(self.text), SHAPES[kind]
        if links is not None:
            for link in root.findall("link"):
                if link.get("name") not in links:
                    for shape in link.findall(tag):
                        link.remove(shape)
        refuse_huge_meshes(Path(m.get("filename", "")) for m in root.iterfind(f".//{tag}//mesh"))
        meshes = _replace_meshes(root, tag)
        with pinocchio_reads(self.path, "shapes cannot be loaded"):
            text = ET.tostring(root, encoding="unicode")
            shapes = pin.buildGeomFromUrdfString(model, text, kind)
        read: dict[Path, Triangles] = {}
        surfaces: dict[str, Triangles] = {}
        for shape in shapes.geometryObjects:
            if shape.name not in meshes:
                continue
            path, scale = meshes[shape.name]
            if path not in read:
                read[path] = read_mesh(path)
            shape.meshPath, shape.meshScale = str(path), scale
            surfaces[shape.name] = Triangles(read[path].vertices * scale, read[path].faces)
        return Surfaces(shapes, surfaces)


def _replace_meshes(root: ET.Element, tag: str) -> dict[str, tuple[Path, Array]]:
    """Replace each mesh that is read here by a box; return their files and scales.

    By the names that Pinocchio gives shapes: link and number.
    """
    taken = {}
    for link in root.findall("link"):
        for k, shape in enumerate(link.findall(tag)):
            geometry = shape.find("geometry")
            if geometry is None or not len(geometry) or geometry[0].tag != "mesh":
                continue
            path = Path(geometry[0].get("filename", ""))
            if not is_read_here(path):
                continue
            scale = np.array(geometry[0].get("scale", "1 1 1").split(), dtype=float)
            taken[f"{link.get('name')}_{k}"] = path, scale
            geometry[0] = ET.Element("box", {"size": "1 1 1"})
    return taken
