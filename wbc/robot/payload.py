"""Bodies that a robot carries: a tool in the hand, a crate, a backpack.

A payload is rigid with a frame. It weighs and turns with what carries it: in the mass matrix, the
CoM and the CRB inertia, in the native core, in both control levels, in the plant, in analyses and
in pictures. It touches nothing: it has no collision shape.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot.formats.description import ContactRules, GeometrySource
from wbc.robot.formats.triangles import Surfaces
from wbc.robot.names import frame_table, looked_up
from wbc.validate import Array, finite_array, finite_number, read_only, real_array, set_fields

ROUNDING = 1e-9  # of the largest moment: tolerance of symmetry and triangle inequality
DRAWN_DENSITY = 1000.0  # kg/m^3 (water): of the ball that is drawn for a payload without an inertia
THINNEST = 5e-3  # m: semi-axes below are drawn like this, or a rod could not be seen
COLOUR = (0.90, 0.62, 0.0, 1.0)
# With semi-axes a, b, c a solid ellipsoid has Ixx = m (b^2 + c^2) / 5 and so on.
_SOLID = 5.0


@dataclass(frozen=True, eq=False)
class Payload:
    """A rigid body fixed to a frame of a robot.

    Attributes
    ----------
    frame:
        A link or frame of the robot, which carries it.
    mass:
        [kg], above 0.
    com:
        Its centre of mass (3,) [m], in the frame's axes from its origin.
    inertia:
        Its moments of inertia (3, 3) about that point, in the frame's axes [kg m^2]; or the
        diagonal (3,). Zero, the default, is a point.
    name:
        Of the frame at its centre of mass, in the carrying frame's axes; set by the robot.
    """

    frame: str
    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike = (0.0, 0.0, 0.0)
    name: str = ""

    def __post_init__(self) -> None:
        mass = finite_number("payload, mass", self.mass, above=0.0)
        com = read_only(finite_array("payload, com", self.com, (3,)))
        set_fields(self, mass=mass, com=com, inertia=read_only(_checked(self.inertia)))

    def __repr__(self) -> str:
        return f"Payload({self.frame!r}, {self.mass:g} kg)"

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.frame, self.mass, self.com, self.inertia, self.name)

    def attached(self, model: pin.Model) -> tuple[pin.Model, Payload]:
        """Return a model that carries it, and itself with the name of its frame there.

        Raises
        ------
        UnknownNameError
            No such frame.
        """
        carrying, taken = model.copy(), {str(frame.name) for frame in model.frames}
        index = looked_up("frame", self.frame, frame_table(model))
        carrier = carrying.frames[index]
        name = f"{self.frame}_payload"
        while name in taken:
            name += "_too"
        there = carrier.placement * pin.SE3(np.eye(3), np.asarray(self.com))
        body = pin.Inertia(self.mass, np.zeros(3), np.asarray(self.inertia))
        frame = pin.Frame(name, carrier.parentJoint, index, there, pin.FrameType.OP_FRAME, body)
        carrying.addFrame(frame, True)
        return carrying, Payload(self.frame, self.mass, self.com, self.inertia, name)

    def shape(self) -> tuple[Array, Array]:
        """Return the semi-axes (3,) [m] of a solid ellipsoid of its mass and inertia, and its axes.

        The axes (3, 3) are columns in the frame's. A point is a ball of water.
        """
        moments, axes = np.linalg.eigh(np.asarray(self.inertia))
        if moments[2] <= 0.0:
            radius = (0.75 * self.mass / (np.pi * DRAWN_DENSITY)) ** (1.0 / 3.0)
            return np.full(3, radius), np.eye(3)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        squares = _SOLID * (0.5 * moments.sum() - moments) / self.mass
        return np.maximum(np.sqrt(np.maximum(squares, 0.0)), THINNEST), axes


def _checked(inertia: ArrayLike) -> Array:
    """Return moments of inertia (3, 3) that a rigid body can have."""
    what = "payload, inertia"
    if real_array(what, inertia).ndim == 1:
        found = np.diag(finite_array(what, inertia, (3,)))
    else:
        found = finite_array(what, inertia, (3, 3))
    size = float(np.abs(found).max())
    if np.abs(found - found.T).max() > ROUNDING * size:
        raise InvalidInputError(f"{what}: is not symmetric")
    moments = np.linalg.eigvalsh(found)
    if moments[0] < -ROUNDING * size or moments[:2].sum() - moments[2] < -ROUNDING * size:
        told = ", ".join(f"{moment:.4g}" for moment in moments)
        raise InvalidInputError(
            f"{what}: no rigid body has principal moments {told} kg m^2: none is negative, nor"
            " larger than the sum of the two others; they count about the payload's own CoM"
        )
    return 0.5 * (found + found.T)


@dataclass(frozen=True, eq=False)
class CarryingGeometry:
    """The shapes of a robot and, for drawing, of its payloads."""

    own: GeometrySource
    payloads: tuple[Payload, ...]

    @property
    def missing_shapes(self) -> tuple[str, ...]:
        """See :class:`~wbc.robot.formats.description.GeometrySource`."""
        return self.own.missing_shapes

    @property
    def rules(self) -> ContactRules:
        """See :class:`~wbc.robot.formats.description.GeometrySource`."""
        return self.own.rules

    def content(self) -> Iterable[bytes]:
        """See :class:`~wbc.robot.formats.description.GeometrySource`; payloads touch nothing."""
        return self.own.content()

    def surfaces(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> Surfaces:
        """See :class:`~wbc.robot.formats.description.GeometrySource`."""
        found = self.own.surfaces(model, kind, links)
        if kind != pin.GeometryType.VISUAL:
            return found
        if not found.shapes.ngeoms:  # drawn by its collision shapes
            found = self.own.surfaces(model, pin.GeometryType.COLLISION, links)
        for payload in self.payloads:
            if links is None or payload.frame in links:
                found.shapes.addGeometryObject(_drawable(model, payload))
        return found


def _drawable(model: pin.Model, payload: Payload) -> Any:
    index = frame_table(model)[payload.name]
    frame = model.frames[index]
    radii, axes = payload.shape()
    pose = frame.placement * pin.SE3(axes, np.zeros(3))
    shape = pin.GeometryObject(
        payload.name, frame.parentJoint, index, pose, coal.Ellipsoid(*radii.tolist())
    )
    shape.meshColor = np.array(COLOUR)
    return shape
