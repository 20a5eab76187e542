"""Collada files: the triangles of their scene, in metres with z up."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from wbc.errors import ModelError
from wbc.robot.formats.triangles import Triangles, fan, merged
from wbc.robot.formats.xml import read_xml
from wbc.rotations import exp_rotation
from wbc.validate import Array

# From the file's axes to z up.
_UP = {
    "X_UP": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "Y_UP": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "Z_UP": np.eye(3),
}
# MeshLab writes Y_UP whatever the axes are (TIAGo, Borinot: their URDFs mean z).
_UP_UNKNOWN = ("MeshLab", "VCGLib")
_DEEPEST = 100  # nodes inside each other
_LINES = {"lines", "linestrips"}


class Collada:
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
        """Return the triangles of the scene, in metres with z up."""
        scene = self._named[_child(self._root, "scene/instance_visual_scene").attrib["url"]]
        unit = self._root.find("asset/unit")
        scale = 1.0 if unit is None else float(unit.get("meter", 1.0))
        vertices, faces = merged(list(self._below(scene, np.eye(4), 0)))
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
                    faces = fan(corners, _numbers(_child(part, "vcount")).astype(np.int64))
                case "polygons" | "trifans":
                    faces = fan(corners, np.array([len(one) for one in lists], dtype=np.int64))
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
