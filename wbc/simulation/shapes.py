"""What of a robot meets the ground: soles as balls at their corners, and the links' own shapes."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, Hull, robot_bodies

# Soles are balls at the corners of their polygons, lowest at the sole: all corners touch at once,
# where MuJoCo gives four points at most to a box or prism on a plane, and each is one row triple of
# the contact forces that controllers think of. What they miss: the edge of a step that passes
# between corners. The radius rolls a tipping foot by so much only.
SOLE_RADIUS = 5e-3  # m
# Bits of contype and conaffinity: the robot meets the ground, and not itself.
GROUND = 1


def add_shapes(
    mujoco: Any, spec: Any, bodies: list[Any], robot: Robot, shapes: bool
) -> tuple[dict[str, tuple[str, str]], tuple[str, ...]]:
    """Add soles and other shapes; return foot and link by geom, and notes."""
    labels, notes = dict[str, tuple[str, str]](), list[str]()
    feet = set[int]()
    for foot in robot.feet.values():
        frame = robot.model.frames[robot.frame_id(foot.frame)]
        joint, place = int(frame.parentJoint), frame.placement
        feet.add(joint)
        corners = np.column_stack([foot.polygon, np.full(len(foot.polygon), SOLE_RADIUS)])
        for k, corner in enumerate(corners @ np.array(place.rotation).T + place.translation):
            name = f"{foot.name} sole {k}"
            labels[name] = (foot.name, foot.link)
            geom = bodies[joint].add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=corner, size=[SOLE_RADIUS, 0, 0]
            )
            _make_robot(geom)
    if not robot.feet:
        notes.append("the robot has no feet: no soles touch the ground")
    found = tuple[Body, ...]()
    if shapes:
        try:
            found = robot_bodies(robot, fit="hull")
        except ModelError as error:
            notes.append(f"only soles touch the ground: {error}")
    for body in found:
        if body.joint not in feet:  # its shapes end where the sole begins, give or take a digit
            labels[f"shape {body.name}"] = ("", body.link)
            _make_robot(_add_shape(mujoco, spec, bodies[body.joint], body))
    return labels, tuple(notes)


def _add_shape(mujoco: Any, spec: Any, parent: Any, body: Body) -> Any:
    geom = parent.add_geom(name=f"shape {body.name}")
    match body.shape:
        case Capsule(ends=ends, radius=radius):
            axis = ends[1] - ends[0]
            length = float(np.linalg.norm(axis))
            geom.pos = ends.mean(axis=0)
            if length < 1e-9:
                geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0]
            else:
                quaternion = np.empty(4)
                mujoco.mju_quatZ2Vec(quaternion, axis / length)
                geom.type, geom.quat = mujoco.mjtGeom.mjGEOM_CAPSULE, quaternion
                geom.size = [radius, 0.5 * length, 0]
        case Hull(vertices=vertices):
            mesh = spec.add_mesh(name=f"shape {body.name}", uservert=vertices.ravel().tolist())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
    return geom


def _make_robot(geom: Any) -> None:
    geom.contype, geom.conaffinity, geom.mass = 0, GROUND, 0.0
