"""The shapes of a compiled MuJoCo model: visual and collision shapes, and excluded pairs."""

from __future__ import annotations

import pickle
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.formats.description import NO_RULES, ContactRules
from wbc.robot.formats.mujoco_part import Names, RobotPart
from wbc.robot.formats.mujoco_tree import pose_of
from wbc.robot.formats.triangles import Surfaces, Triangles
from wbc.robot.notes import noted
from wbc.validate import Array

SHOWN_GROUPS = 3  # geoms of groups 0, 1 and 2 are drawn; those above are for contacts only
UNUSED = ("geom_adhesion", "geom_surfacevel")  # of contacts in newer MuJoCo
_DEFAULT_COLOUR = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's colour of what is given none


@dataclass(frozen=True, eq=False)
class GeomShape:
    """One shape on a link."""

    name: str
    link: str
    kind: str  # sphere, capsule, ellipsoid, cylinder, box or mesh
    size: tuple[float, ...]  # (3,) as MuJoCo has it: radii and half lengths [m]
    position: Array  # (3,) in the link's frame [m]
    quaternion: Array  # (4,) w, x, y, z
    colour: Array  # (4,) red, green, blue, alpha
    mesh: int  # which of the meshes, or -1
    collides: bool
    drawn: bool


@dataclass(frozen=True, eq=False)
class MujocoGeometry:
    """The shapes of a compiled model's robot, with the vertices of their meshes."""

    shapes: tuple[GeomShape, ...]
    meshes: tuple[Triangles, ...]
    missing_shapes: tuple[str, ...]
    rules: ContactRules = NO_RULES

    def content(self) -> Iterator[bytes]:
        """See :class:`wbc.robot.formats.description.GeometrySource`."""
        yield pickle.dumps((self.shapes, self.meshes))

    def surfaces(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> Surfaces:
        """See :class:`wbc.robot.formats.description.GeometrySource`."""
        found, meshes = pin.GeometryModel(), dict[str, Triangles]()
        colliding = kind == pin.GeometryType.COLLISION
        for shape in self.shapes:
            wanted = shape.collides if colliding else shape.drawn
            if not wanted or not (links is None or shape.link in links):
                continue
            index = int(model.getFrameId(shape.link, pin.FrameType.BODY))
            frame = model.frames[index]
            placed = frame.placement * pose_of(shape.position, shape.quaternion)
            one = pin.GeometryObject(
                shape.name, frame.parentJoint, index, placed, self._solid(shape)
            )
            one.meshColor = np.array(shape.colour)
            found.addGeometryObject(one)
            if shape.kind == "mesh":
                meshes[shape.name] = self.meshes[shape.mesh]
        return Surfaces(found, meshes)

    def _solid(self, shape: GeomShape) -> Any:
        x, y, z = shape.size
        match shape.kind:
            case "sphere":
                return coal.Sphere(x)
            case "capsule":
                return coal.Capsule(x, 2.0 * y)
            case "cylinder":
                return coal.Cylinder(x, 2.0 * y)
            case "ellipsoid":
                return coal.Ellipsoid(x, y, z)
            case "box":
                return coal.Box(2.0 * x, 2.0 * y, 2.0 * z)
        return coal.Box(1.0, 1.0, 1.0)  # of a mesh, see Surfaces


def read_shapes(
    part: RobotPart, missing_shapes: tuple[str, ...]
) -> tuple[MujocoGeometry, tuple[str, ...]]:
    """Return the shapes of the robot's part, and notes of what is left out.

    ``missing_shapes``: shapes that collide and were not found, in words.
    """
    types, model, names = part.mujoco.mjtGeom, part.model, part.names
    kinds = {
        int(getattr(types, f"mjGEOM_{name.upper()}")): name
        for name in ("sphere", "capsule", "cylinder", "ellipsoid", "box", "mesh", "sdf")
    }
    mine = {*part.bodies}
    rules = _rules(model, mine, names)
    used: dict[int, int] = {}
    shapes, unknown, scenery = list[GeomShape](), list[str](), list[str]()
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        kind = kinds.get(int(model.geom_type[geom]))
        touches = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        if body == 0 and touches and not _is_level_plane(model, geom, int(types.mjGEOM_PLANE)):
            scenery.append(names.geoms[geom])
        if body not in mine:
            continue
        if kind is None:
            what = types(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
            unknown.append(f"{what} of body {names.bodies[body]!r}")
            continue
        mesh = int(model.geom_dataid[geom]) if kind in ("mesh", "sdf") else -1
        place = used.setdefault(mesh, len(used)) if mesh >= 0 else -1
        name = names.geoms[geom]
        shapes.append(
            GeomShape(
                name=name,
                link=names.bodies[body],
                kind="mesh" if kind == "sdf" else kind,
                size=tuple(model.geom_size[geom].tolist()),
                position=np.array(model.geom_pos[geom]),
                quaternion=np.array(model.geom_quat[geom]),
                colour=_colour(model, geom),
                mesh=place,
                collides=touches or any(name in pair for pair in rules.watched),
                drawn=not touches or model.geom_group[geom] < SHOWN_GROUPS,
            )
        )
    meshes = tuple(_triangles(model, mesh) for mesh in used)
    notes = noted("shapes left out, as only the ground has such: {}", unknown, 3)
    notes += noted("shapes of the world, which are no part of the robot, left out: {}", scenery, 3)
    unlike = [
        names.geoms[geom]
        for geom in range(model.ngeom)
        if int(model.geom_bodyid[geom]) in {0, *mine}
        and any(np.any(getattr(model, field)[geom]) for field in UNUSED if hasattr(model, field))
    ]
    notes += noted("adhesion and moving surfaces (surfacevel) are not used: {}", unlike)
    return MujocoGeometry(tuple(shapes), meshes, missing_shapes, rules), notes


def _is_level_plane(model: Any, geom: int, plane: int) -> bool:
    """Return whether a shape of the world is the ground as it is everywhere here."""
    _, x, y, _ = model.geom_quat[geom].tolist()  # its normal is (.., .., 1 - 2 (x^2 + y^2))
    return int(model.geom_type[geom]) == plane and x * x + y * y < 1e-9


def _colour(model: Any, geom: int) -> Array:
    own = np.array(model.geom_rgba[geom], dtype=float)
    material = int(model.geom_matid[geom])
    if material >= 0 and np.allclose(own, _DEFAULT_COLOUR):
        return np.array(model.mat_rgba[material], dtype=float)
    return own


def _triangles(model: Any, mesh: int) -> Triangles:
    """Return a mesh in the axes that geoms place: MuJoCo centres meshes on their inertia."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
    return Triangles(vertices, np.array(model.mesh_face[face : face + faces], dtype=np.int64))


def _rules(model: Any, mine: set[int], names: Names) -> ContactRules:
    """Return what ``<contact>`` says of the robot's own bodies and shapes."""
    excluded, watched, paired = set[frozenset[str]](), set[frozenset[str]](), set[str]()
    for signature in np.atleast_1d(model.exclude_signature).tolist():
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        if {first, second} <= mine:
            excluded.add(frozenset((names.bodies[first], names.bodies[second])))
    for pair in range(model.npair):
        geoms = int(model.pair_geom1[pair]), int(model.pair_geom2[pair])
        if {int(model.geom_bodyid[geom]) for geom in geoms} <= mine:
            watched.add(frozenset(names.geoms[geom] for geom in geoms))
            paired |= {
                names.geoms[geom]
                for geom in geoms
                if not (model.geom_contype[geom] or model.geom_conaffinity[geom])
            }
    return ContactRules(frozenset(excluded), frozenset(watched), frozenset(paired))
