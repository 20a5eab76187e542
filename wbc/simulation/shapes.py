"""Collision geometry: soles as balls at their corners, and the links' own shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.errors import ModelError
from wbc.gait.walls import Hand
from wbc.robot import Foot, Robot
from wbc.robot.collision import Body, Capsule, Hull, chosen_pairs, fitted_bodies
from wbc.validate import Array

# Soles are balls at the corners of their polygons, tangent to the sole: all corners touch the plane
# at once, whereas MuJoCo gives at most four points to a box or prism, and each has one force, as in
# controllers. For steps there are capsules along the polygon's sides, so that a step's edge below a
# sole makes contact; a step's corner inside of a sole does not. The radius is small, as a tipping
# foot rolls on it.
SOLE_RADIUS = 5e-3  # m
LEAST_RADIUS = 1e-6  # m, of files' points and lines: MuJoCo takes none of 0
# Bits of contype and conaffinity: of the robot with ground and steps; self-collision is by pairs.
PLANE, STEP = 1, 2
SELF_FRICTION = 0.5

Labels = dict[str, tuple[str, str]]


@dataclass(frozen=True)
class ShapeOptions:
    """Which shapes of a robot collide with what."""

    links: bool = True  # whether the links' collision shapes collide with the ground
    steps: bool = False  # whether there are steps, and soles need sides
    # Whether links collide with each other, in the pairs of
    # :func:`wbc.robot.collision.select_pairs`.
    self_collision: bool = False
    hands: tuple[Hand, ...] = ()  # balls that collide with the ground, its steps and walls


def add_shapes(
    mujoco: Any, spec: Any, bodies: Sequence[Any], robot: Robot, options: ShapeOptions
) -> tuple[Labels, tuple[str, ...]]:
    """Add soles and other shapes; return foot and link by geom, and notes.

    Raises ModelError: self-collision of links without shapes.
    """
    labels, notes = Labels(), list[str]()
    for foot in robot.feet.values():
        labels |= _add_sole(mujoco, bodies, robot, foot, options.steps)
    if not robot.feet:
        notes.append("the robot has no feet: no soles touch the ground")
    link_shapes, pairs = tuple[Body, ...](), tuple[tuple[int, int], ...]()
    if options.links or options.self_collision:
        try:
            link_shapes = fitted_bodies(robot, "hull")
        except ModelError as error:
            if options.self_collision:
                raise
            notes.append(f"only soles touch the ground: {error}")
    shapes = link_shapes
    if options.self_collision:
        selection = chosen_pairs(robot, "hull")
        shapes, pairs = selection.bodies, selection.pairs
    feet = {int(robot.frame(foot.frame).parentJoint) for foot in robot.feet.values()}
    paired = {k for pair in pairs for k in pair}
    for k, body in enumerate(shapes):
        # A foot's own shapes end at its sole, to rounding; finer shapes, which come after the
        # links' own, are for pairs only.
        on_ground = options.links and body.joint not in feet and k < len(link_shapes)
        if on_ground or k in paired:
            labels[_shape_name(k)] = ("", body.link)
            geom = _add_shape(mujoco, spec, bodies[body.joint], body, _shape_name(k))
            _set_collision_mask(geom, PLANE | STEP if on_ground else 0)
    for hand in options.hands:
        frame, name = robot.frame(hand.frame), f"hand {hand.frame}"
        ball = bodies[int(frame.parentJoint)].add_geom(name=name, pos=frame.placement.translation)
        ball.type, ball.size = mujoco.mjtGeom.mjGEOM_SPHERE, [hand.radius, 0, 0]
        labels[name] = ("", hand.frame)
        _set_collision_mask(ball, PLANE | STEP)
    for a, b in pairs:
        pair = spec.add_pair(name=f"{_shape_name(a)}, {_shape_name(b)}")
        pair.geomname1, pair.geomname2, pair.condim = _shape_name(a), _shape_name(b), 3
        pair.friction = [SELF_FRICTION, SELF_FRICTION, 0.0, 0.0, 0.0]
    return labels, tuple(notes)


def _shape_name(index: int) -> str:
    return f"shape {index}"


def _add_sole(mujoco: Any, bodies: Sequence[Any], robot: Robot, foot: Foot, steps: bool) -> Labels:
    sole = robot.frame(foot.frame)
    place, parent, names = sole.placement, bodies[int(sole.parentJoint)], list[str]()
    corners = np.column_stack([foot.polygon, np.full(len(foot.polygon), SOLE_RADIUS)])
    corners = corners @ np.array(place.rotation).T + place.translation
    for k, corner in enumerate(corners):
        names.append(f"{foot.name} sole {k}")
        ball = parent.add_geom(name=names[-1], pos=corner)
        ball.type, ball.size = mujoco.mjtGeom.mjGEOM_SPHERE, [SOLE_RADIUS, 0, 0]
        _set_collision_mask(ball, PLANE)
        if steps:
            names.append(f"{foot.name} sole side {k}")
            rod = parent.add_geom(name=names[-1])
            _make_rod(mujoco, rod, corners[k - 1], corner, SOLE_RADIUS)
            _set_collision_mask(rod, STEP)
    return dict.fromkeys(names, (foot.name, foot.link))


def _make_rod(mujoco: Any, geom: Any, start: Array, end: Array, radius: float) -> None:
    """Make a geom a capsule around a segment."""
    axis, quaternion = end - start, np.empty(4)
    length = float(np.linalg.norm(axis))
    geom.pos = 0.5 * (start + end)
    if length < 1e-9:
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0]
        return
    mujoco.mju_quatZ2Vec(quaternion, axis / length)
    geom.type, geom.size = mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, 0.5 * length, 0]
    geom.quat = quaternion


def _add_shape(mujoco: Any, spec: Any, parent: Any, body: Body, name: str) -> Any:
    geom = parent.add_geom(name=name)
    match body.shape:
        case Capsule(ends=ends, radius=radius):
            _make_rod(mujoco, geom, ends[0], ends[1], max(radius, LEAST_RADIUS))
        case Hull(vertices=vertices):
            mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
    return geom


def _set_collision_mask(geom: Any, what: int) -> None:
    geom.contype, geom.conaffinity, geom.mass = 0, what, 0.0
