"""What a linear prediction leaves out is bounded, closely, against coal at the place reached."""

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from wbc.robot.collision import Body, Capsule, CollisionModel, HalfSpace, Hull


def solid(shape) -> tuple[coal.CollisionGeometry, float]:
    """coal's polytope of a shape's core, thickened where it is a segment, and what to take off."""
    core = shape.core
    if isinstance(shape, Capsule):
        # A spindle of 1e-6 m round the segment stands for it.
        core = np.concatenate([core + 1e-6 * step for step in np.vstack((np.eye(3), -np.eye(3)))])
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in core:
        points.append(corner)
    for face in ConvexHull(core).simplices.tolist():
        faces.append(coal.Triangle(*face))
    return coal.Convex(points, faces), shape.radius


def distances(robot, bodies, pairs, q) -> np.ndarray:
    """Distances by coal's polytopes alone, the joints placed by a fresh ``pin.Data``."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-9
    found = []
    for pair in pairs:
        arguments, radius = [], 0.0
        for k in pair:
            geometry, rounding = solid(bodies[k].shape)
            pose = data.oMi[bodies[k].joint]
            arguments += [geometry, coal.Transform3s(pose.rotation, pose.translation)]
            radius += rounding
        found.append(coal.distance(*arguments, request, coal.DistanceResult()) - radius)
    return np.array(found)


def corners(rng) -> np.ndarray:
    points = rng.normal(size=(25, 3))
    return points[ConvexHull(points).vertices]


def bodies_on(robot, rng) -> list[Body]:
    bodies = []
    for k, joint in enumerate(np.linspace(1, robot.model.njoints - 1, 9).astype(int).tolist()):
        place = 0.1 * rng.normal(size=3)
        shape = [
            Capsule.of(place, place + 0.2 * rng.normal(size=3), 0.02),
            Hull.box(0.02 + 0.1 * rng.random(3), place),
            Hull(place + 0.05 * corners(rng), 0.01),
        ][k % 3]
        bodies.append(Body(f"body{k}", f"body{k}", joint, shape))
    return bodies


def every(bodies) -> list[tuple[int, int]]:
    n = len(bodies)
    return [(a, b) for a in range(n) for b in range(a + 1, n) if bodies[a].joint != bodies[b].joint]


@pytest.mark.parametrize("name", ["hoap2_like", "mixed_joints"])
@pytest.mark.parametrize("size", [1e-3, 1e-2, 1e-1])
def test_no_distance_ends_below_the_bound(name, size, robot_named, random_snapshot, rng) -> None:
    robot = robot_named(name)
    bodies = bodies_on(robot, rng)
    model = CollisionModel(robot, bodies, every(bodies))
    doubted = np.full(len(model.pairs), -1.0)
    for _ in range(6):
        here = random_snapshot(robot, rng)
        found = model.nearest(here)
        step = size * rng.normal(size=robot.nv)
        there = distances(robot, bodies, model.pairs.tolist(), robot.integrate(here.q, step, 1.0))
        left = found.distance + model.rows(here, found) @ step - there
        # Both iterations stop at 1e-7 m, EPA ten times later; a spindle is 1e-6 m thick.
        assert (left <= model.sharp_bend(found, step, doubted) + 5e-6).all()
        assert (model.sharp_bend(found, step, doubted) <= model.bend(found.pairs, step)).all()


def test_only_what_is_parallel_keeps_a_first_order(robot_named, random_snapshot, rng) -> None:
    """At small angles the bound from the corners is a small part of the other for most pairs."""
    robot = robot_named("hoap2_like")
    bodies = bodies_on(robot, rng)
    model = CollisionModel(robot, bodies, every(bodies))
    found = model.nearest(random_snapshot(robot, rng))
    step = 1e-4 * rng.normal(size=robot.nv)
    coarse = model.bend(found.pairs, step)
    sharp = model.sharp_bend(found, step, np.full(len(coarse), -1.0))
    assert np.median(sharp / coarse) < 0.05
    # Where there is room for it, the coarse bound is left as it is.
    np.testing.assert_array_equal(model.sharp_bend(found, step, coarse), coarse)


def test_plates_face_to_face_may_lose_what_their_edges_do(robot_named) -> None:
    """Two parallel plates: the edge comes nearer by its lever times the angle, to first order."""
    robot = robot_named("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    R, p = here.joint_placements
    joint = 7
    plates = [(0, np.zeros(3)), (joint, np.array([0.0, 0.0, 0.05]))]
    bodies = []
    for k, offset in plates:
        # Both plates lie flat around the joint's origin, one 4 cm above the other.
        box = Hull.box([0.2, 0.2, 0.01], offset).vertices + p[joint]
        bodies.append(Body(f"plate{k}", f"plate{k}", k, Hull((box - p[k]) @ R[k])))
    model = CollisionModel(robot, bodies, [(1, 0)])
    found = model.nearest(here)
    assert found.distance[0] == pytest.approx(0.04, abs=1e-6)
    step = np.zeros(robot.nv)
    step[3] = 0.01  # the base, and the upper plate with it, about an axis in the plates' plane
    bound = model.sharp_bend(found, step, np.array([-1.0]))[0]
    there = robot.integrate(here.q, step, 1.0)
    left = (found.distance + model.rows(here, found) @ step)[0]
    left -= distances(robot, bodies, [(1, 0)], there)[0]
    assert left > 0.0
    # No more than from edge to edge, and at least what was lost.
    assert left <= bound <= 0.01 * 0.2 * np.sqrt(2.0) + 1e-4


def test_obstacles_count_where_they_were_put_and_planes_not_at_all(robot_named, rng) -> None:
    robot = robot_named("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    ball = Body("hand", "hand", robot.model.njoints - 1, Capsule.sphere(np.zeros(3), 0.03))
    box, wall = Hull.box([0.1, 0.2, 0.3]), HalfSpace.of([0.0, 0.0, 1.0], -1.0)
    around = [Body("box", "box", 0, box), Body("wall", "wall", 0, wall)]
    model = CollisionModel(robot, [ball, *around], [(0, 1), (0, 2)])
    turn, shift = pin.exp3(rng.normal(size=3)), np.array([0.3, 0.2, 0.1])
    model.place(1, turn, shift)
    found = model.nearest(here)
    step = 1e-2 * rng.normal(size=robot.nv)
    sharp = model.sharp_bend(found, step, np.full(2, -1.0))
    moved = Body("box", "box", 0, Hull(box.vertices @ turn.T + shift))
    same = CollisionModel(robot, [ball, moved], [(0, 1)])
    there = same.sharp_bend(same.nearest(here), step, np.full(1, -1.0))
    np.testing.assert_allclose(sharp[0], there[0], rtol=0, atol=1e-6)
    assert np.isfinite(sharp).all()
