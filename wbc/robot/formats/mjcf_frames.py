"""Placements of an MJCF: rotations as quaternions, and the parts of ``<frame>`` in their place."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.formats.xml import LARGEST, numbers
from wbc.rotations import exp_rotation, rotation_from
from wbc.validate import Array

ROTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
PLACED = ("body", "geom", "site", "frame")
TURNED = ("body", "geom", "site", "inertial")
# What has no place in the robot, or none that is read.
PASSED_OVER = ("camera", "light", "plugin")


class MjcfAngles:
    """How the document writes rotations: ``<compiler angle= eulerseq=>``."""

    def __init__(self, compiler: ET.Element | None, where: str) -> None:
        settings = {} if compiler is None else compiler.attrib
        self._unit = 1.0 if settings.get("angle", "degree") == "radian" else math.pi / 180.0
        self._sequence = settings.get("eulerseq", "xyz")
        if len(self._sequence) != 3 or set(self._sequence.lower()) - set("xyz"):
            raise ModelError(f"{where}: <compiler eulerseq={self._sequence!r}> is not three axes")

    def rotation(self, element: ET.Element, where: str) -> Array:
        """Return the rotation (3, 3) that an element's attributes say.

        Raises
        ------
        ModelError
            Not the numbers that it needs, or no direction.
        """
        if "euler" in element.attrib:
            R = np.eye(3)
            for axis, angle in zip(
                self._sequence, self._read(element, "euler", 3, where), strict=True
            ):
                turn = exp_rotation(self._unit * angle * np.eye(3)["xyz".index(axis.lower())])
                R = R @ turn if axis.islower() else turn @ R  # upper case: about fixed axes
            return R
        if "axisangle" in element.attrib:
            values = self._read(element, "axisangle", 4, where)
            return exp_rotation(self._unit * values[3] * _unit(values[:3], where))
        if "xyaxes" in element.attrib:
            values = self._read(element, "xyaxes", 6, where)
            x = _unit(values[:3], where)
            y = _unit(values[3:] - (x @ values[3:]) * x, where)
            return np.column_stack((x, y, np.cross(x, y)))
        if "zaxis" in element.attrib:
            z = _unit(self._read(element, "zaxis", 3, where), where)
            return np.array(pin.Quaternion.FromTwoVectors(np.array((0.0, 0.0, 1.0)), z).matrix())
        if "quat" in element.attrib:
            w, *xyz = _unit(self._read(element, "quat", 4, where), where)
            return rotation_from(np.array((*xyz, w)))
        return np.eye(3)

    @staticmethod
    def _read(element: ET.Element, key: str, count: int, where: str) -> Array:
        return np.array(numbers(element, key, count, where, LARGEST))


def flatten_frames(parent: ET.Element, angles: MjcfAngles, where: str) -> None:
    """Put what frames hold, below ``parent``, in their place.

    Raises
    ------
    ModelError
        A joint or an inertia in a frame, or numbers that are none.
    """
    k = 0
    while k < len(parent):
        child = parent[k]
        if child.tag != "frame":
            if child.tag == "body":
                flatten_frames(child, angles, where)
            k += 1
            continue
        parent.remove(child)
        placed = [_placed(inner, child, angles, where) for inner in child]
        for at, inner in enumerate(one for one in placed if one is not None):
            parent.insert(k + at, inner)  # frames among them have their turn next


def write_quaternions(root: ET.Element, angles: MjcfAngles, where: str) -> None:
    """Write every rotation below ``root`` as a quaternion.

    Pinocchio 4.1 misreads ``axisangle``, and sequences of Euler angles with capitals.
    """
    for element in root.iter():
        if element.tag in TURNED and any(key in element.attrib for key in ROTATIONS[1:]):
            here = f"{where}: <{element.tag} name={element.get('name', '')!r}>"
            _set_rotation(element, angles.rotation(element, here))


def _set_rotation(element: ET.Element, R: Array) -> None:
    for key in ROTATIONS:
        element.attrib.pop(key, None)
    x, y, z, w = pin.Quaternion(R).coeffs()
    element.set("quat", _text(np.array((w, x, y, z))))


def _placed(
    element: ET.Element, frame: ET.Element, angles: MjcfAngles, where: str
) -> ET.Element | None:
    """Return an element of a frame as one of the frame's parent; None if it is passed over."""
    if element.tag in PASSED_OVER:
        return None
    if element.tag not in PLACED:
        raise ModelError(
            f"{where}: <{element.tag}> in a <frame> is not supported; put it in a <body>"
        )
    R, p = angles.rotation(frame, f"{where}: <frame>"), _position(frame, "pos", f"{where}: <frame>")
    here = f"{where}: <{element.tag} name={element.get('name', '')!r}>"
    if "fromto" in element.attrib:
        ends = np.array(numbers(element, "fromto", 6, here, LARGEST)).reshape(2, 3)
        element.set("fromto", _text((ends @ R.T + p).ravel()))
        return element
    rotation, position = R @ angles.rotation(element, here), _position(element, "pos", here)
    _set_rotation(element, rotation)
    element.set("pos", _text(R @ position + p))
    return element


def _position(element: ET.Element, key: str, where: str) -> Array:
    if key not in element.attrib:
        return np.zeros(3)
    return np.array(numbers(element, key, 3, where, LARGEST))


def _unit(vector: Array, where: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length < 1e-12:
        raise ModelError(f"{where}: a rotation needs a direction that is not 0")
    return vector / length


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
