"""The bodies of a robot: its description's shapes, meshes and cylinders simplified."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from wbc.errors import ModelError, listed
from wbc.kinds import one_of
from wbc.robot.collision.fitting import Fit, fit_capsule, fit_hull
from wbc.robot.collision.shapes import Body, Capsule, Hull, moved
from wbc.robot.geometry import VERTICES_AROUND, triangulated
from wbc.robot.model import Robot

FITS = ("capsule", "hull")
_RIM = 16  # corners of the prism that stands for a cylinder


def robot_bodies(robot: Robot, fit: str = "capsule") -> tuple[Body, ...]:
    """Return the collision shapes of a robot, each in the frame of the joint that moves it.

    Spheres, capsules and boxes are used as they are. Meshes and other shapes are replaced by shapes
    of kind ``fit`` that contain them.

    Parameters
    ----------
    fit:
        ``"capsule"`` or ``"hull"``.

    Raises
    ------
    ModelError
        A collision shape of the description was not found, or there are none at all.
    UnknownNameError
        No such fit.
    """
    one_of("fit", fit, FITS)
    bodies = []
    for surface in named_surfaces(robot):
        found = simple_shape(surface.geometry, fit, f"{robot.path}: link {surface.link!r}")
        pose = surface.placement
        placed = moved(found.shape, np.array(pose.rotation), np.array(pose.translation))
        bodies.append(Body(surface.name, surface.link, surface.joint, placed, found.bulge))
    return tuple(bodies)


class NamedSurface(NamedTuple):
    """The raw shape of a body."""

    name: str  # of the body, as :func:`robot_bodies` has it
    link: str
    joint: int
    described: str  # its name in the description
    placement: pin.SE3  # in the joint's frame
    geometry: object  # coal's, or triangles


def named_surfaces(robot: Robot) -> list[NamedSurface]:
    """Return the raw shapes of a robot, meshes as triangles.

    Raises ModelError: see :func:`robot_bodies`.
    """
    refuse_missing(robot)
    shapes, meshes = robot.collision_surfaces
    return [
        NamedSurface(
            *(name, link, int(shape.parentJoint), str(shape.name), shape.placement),
            meshes.get(str(shape.name), shape.geometry),
        )
        for name, link, shape in _as_named(robot, shapes)
    ]


def named_shapes(robot: Robot) -> list[tuple[str, str, pin.GeometryObject]]:
    """Return name, link and raw shape of each body, as :func:`robot_bodies` has them.

    Raises ModelError: see :func:`robot_bodies`.
    """
    refuse_missing(robot)
    return _as_named(robot, robot.collision_model)


def _as_named(robot: Robot, shapes: pin.GeometryModel) -> list[tuple[str, str, pin.GeometryObject]]:
    if not shapes.ngeoms:
        raise ModelError(
            f"{robot.path}: no collision shapes; visual ones are not used: give links <collision>"
            " elements, or in MJCF geoms with a contype or conaffinity, or in a <pair>"
        )
    objects = [shape for shape in shapes.geometryObjects if shape.parentJoint > 0]
    links = [str(robot.model.frames[shape.parentFrame].name) for shape in objects]
    several, seen = Counter(links), Counter[str]()
    named = []
    for link, shape in zip(links, objects, strict=True):
        seen[link] += 1
        name = link if several[link] == 1 else f"{link}#{seen[link]}"
        named.append((name, link, shape))
    return named


def simple_shape(geometry: object, fit: str, where: str) -> Fit:
    """Return a coal shape, or triangles, as a body's shape, in its own frame."""
    match geometry:
        case coal.Sphere():
            return Fit(Capsule.sphere(np.zeros(3), geometry.radius), 0.0)
        case coal.Capsule():
            end = np.array([0.0, 0.0, geometry.halfLength])
            return Fit(Capsule.of(-end, end, geometry.radius), 0.0)
        case coal.Box() if min(geometry.halfSide) > 0.0:
            return Fit(Hull.box(2.0 * np.asarray(geometry.halfSide)), 0.0)
        case coal.Cylinder() if fit == "capsule":
            return _round_cylinder(float(geometry.radius), float(geometry.halfLength))
        case coal.Cylinder() if min(geometry.radius, geometry.halfLength) > 0.0:
            return _prism(float(geometry.radius), float(geometry.halfLength))
        case coal.Halfspace() | coal.Plane():
            raise ModelError(f"{where}: a plane moves with the link; give it a shape that ends")
    vertices = triangulated(geometry).vertices
    if not len(vertices):
        raise ModelError(f"{where}: {type(geometry).__name__} is no shape we know; use a mesh")
    pad = 0.0
    if isinstance(geometry, coal.Ellipsoid | coal.Cone | coal.Cylinder):  # this one is flat
        # How far the surface may be outside the triangles.
        pad = 2.0 * float(np.abs(vertices).max()) * (1.0 - np.cos(np.pi / VERTICES_AROUND))
    return (fit_capsule if fit == "capsule" else fit_hull)(vertices, pad)


def _round_cylinder(radius: float, half: float) -> Fit:
    """Return the capsule of least volume around a cylinder along z.

    With its ends at +-h the rim (radius, half) asks for r^2 = radius^2 + (half - h)^2.
    """
    h = np.linspace(0.0, half, 201)
    r = np.hypot(radius, half - h)
    best = int(np.argmin(r * r * (2.0 * h + 4.0 / 3.0 * r)))
    end = np.array([0.0, 0.0, h[best]])
    bulge = max(float(r[best]) - radius, float(h[best] + r[best]) - half)
    return Fit(Capsule.of(-end, end, float(r[best])), bulge)


def _prism(radius: float, half: float) -> Fit:
    """Return the prism around a cylinder along z: its sides touch the cylinder."""
    angles = 2.0 * np.pi * np.arange(_RIM) / _RIM
    outer = radius / np.cos(np.pi / _RIM)
    rim = np.stack((outer * np.cos(angles), outer * np.sin(angles)), axis=1)
    ends = [np.column_stack((rim, np.full(_RIM, z))) for z in (-half, half)]
    return Fit(Hull(np.concatenate(ends)), outer - radius)


def refuse_missing(robot: Robot) -> None:
    """Raise ModelError if collision shapes are missing: parts of the robot would be ignored."""
    missing = robot.geometry.missing_shapes
    if missing:
        raise ModelError(
            f"{robot.path}: collision shapes not found: {listed(missing)}; install the"
            " package that holds the meshes, or name its folder in package_dirs; what is no mesh"
            " has to be described by shapes that the format knows"
        )
