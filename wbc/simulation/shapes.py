"""What of a robot meets the ground: soles as balls at their corners, and the links' own shapes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.errors import ModelError
from wbc.robot import Foot, Robot
from wbc.robot.collision import Body, Capsule, Hull, robot_bodies
from wbc.validate import Array

# Soles are balls at the corners of their polygons, lowest at the sole: all corners touch the plane
# at once, where MuJoCo gives four points at most to a box or prism, and each is one force as
# controllers think of it. Where there are steps, rods along the polygon's sides meet these, so that
# a step's edge is felt where it passes below a sole; a step's corner inside of a sole is not. The
# radius rolls a tipping foot by so much only.
SOLE_RADIUS = 5e-3  # m
# Bits of contype and conaffinity: the robot meets the ground and the steps, and not itself.
PLANE, STEP = 1, 2

Labels = dict[str, tuple[str, str]]


def add_shapes(
    mujoco: Any, spec: Any, bodies: Sequence[Any], robot: Robot, shapes: bool, steps: bool
) -> tuple[Labels, tuple[str, ...]]:
    """Add soles and other shapes; return foot and link by geom, and notes.

    Parameters
    ----------
    shapes:
        Whether to add what is no sole.
    steps:
        Whether there are steps.
    """
    labels, notes = Labels(), list[str]()
    for foot in robot.feet.values():
        labels |= _add_sole(mujoco, bodies, robot, foot, steps)
    if not robot.feet:
        notes.append("the robot has no feet: no soles touch the ground")
    found = tuple[Body, ...]()
    if shapes:
        try:
            found = robot_bodies(robot, fit="hull")
        except ModelError as error:
            notes.append(f"only soles touch the ground: {error}")
    feet = {_joint_of(robot, foot.frame) for foot in robot.feet.values()}
    for body in found:
        if body.joint not in feet:  # its shapes end where the sole begins, give or take a digit
            labels[f"shape {body.name}"] = ("", body.link)
            geom = _add_shape(mujoco, spec, bodies[body.joint], body)
            _let_touch(geom, PLANE | STEP)
    return labels, tuple(notes)


def _joint_of(robot: Robot, frame: str) -> int:
    return int(robot.model.frames[robot.frame_id(frame)].parentJoint)


def _add_sole(mujoco: Any, bodies: Sequence[Any], robot: Robot, foot: Foot, steps: bool) -> Labels:
    """Add the balls and rods of a sole."""
    place = robot.model.frames[robot.frame_id(foot.frame)].placement
    parent, names = bodies[_joint_of(robot, foot.frame)], list[str]()
    corners = np.column_stack([foot.polygon, np.full(len(foot.polygon), SOLE_RADIUS)])
    corners = corners @ np.array(place.rotation).T + place.translation
    for k, corner in enumerate(corners):
        names.append(f"{foot.name} sole {k}")
        ball = parent.add_geom(name=names[-1], pos=corner)
        ball.type, ball.size = mujoco.mjtGeom.mjGEOM_SPHERE, [SOLE_RADIUS, 0, 0]
        _let_touch(ball, PLANE)
        if steps:
            names.append(f"{foot.name} sole side {k}")
            rod = parent.add_geom(name=names[-1])
            _make_rod(mujoco, rod, corners[k - 1], corner, SOLE_RADIUS)
            _let_touch(rod, STEP)
    return dict.fromkeys(names, (foot.name, foot.link))


def _make_rod(mujoco: Any, geom: Any, start: Array, end: Array, radius: float) -> None:
    """Make a geom all points within ``radius`` of a segment."""
    axis, quaternion = end - start, np.empty(4)
    length = float(np.linalg.norm(axis))
    geom.pos = 0.5 * (start + end)
    if length < 1e-9:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0]
        return
    mujoco.mju_quatZ2Vec(quaternion, axis / length)
    geom.type, geom.size = mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, 0.5 * length, 0]
    geom.quat = quaternion


def _add_shape(mujoco: Any, spec: Any, parent: Any, body: Body) -> Any:
    geom = parent.add_geom(name=f"shape {body.name}")
    match body.shape:
        case Capsule(ends=ends, radius=radius):
            _make_rod(mujoco, geom, ends[0], ends[1], radius)
        case Hull(vertices=vertices):
            mesh = spec.add_mesh(name=f"shape {body.name}", uservert=vertices.ravel().tolist())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
    return geom


def _let_touch(geom: Any, what: int) -> None:
    geom.contype, geom.conaffinity, geom.mass = 0, what, 0.0
