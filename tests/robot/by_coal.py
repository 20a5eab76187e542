"""Bodies at random places, and their distances by coal alone."""

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, HalfSpace, Hull


def corners(rng, count: int = 30) -> np.ndarray:
    points = rng.normal(size=(count, 3))
    return points[ConvexHull(points).vertices]


def bodies_on(robot: Robot, rng) -> list[Body]:
    """One body on each of a dozen joints, of all shapes, at random places."""
    bodies = []
    for k, joint in enumerate(np.linspace(1, robot.model.njoints - 1, 12).astype(int).tolist()):
        place = 0.1 * rng.normal(size=3)
        shape = [
            Capsule.sphere(place, 0.05),
            Capsule.of(place, place + 0.1 * rng.normal(size=3), 0.04),
            Hull.box(0.05 + 0.1 * rng.random(3), place),
            Hull(place + 0.05 * corners(rng), 0.01),
        ][k % 4]
        bodies.append(Body(f"body{k}", f"body{k}", joint, shape))
    return bodies


def all_pairs(bodies) -> list[tuple[int, int]]:
    """Of bodies on different joints, in order."""
    n = len(bodies)
    return [(a, b) for a in range(n) for b in range(a + 1, n) if bodies[a].joint != bodies[b].joint]


def model_on(robot: Robot, rng) -> CollisionModel:
    """Return all pairs of a dozen bodies at random places."""
    bodies = bodies_on(robot, rng)
    return CollisionModel(robot, bodies, all_pairs(bodies))


def oracle(shape) -> tuple[coal.CollisionGeometry, np.ndarray, np.ndarray, float]:
    """coal's shape, its rotation and origin in the joint's frame, and a radius to take off."""
    if isinstance(shape, HalfSpace):
        return coal.Halfspace(shape.normal, shape.offset), np.eye(3), np.zeros(3), 0.0
    if isinstance(shape, Capsule):
        axis = shape.ends[1] - shape.ends[0]
        length = np.linalg.norm(axis)
        if length == 0.0:
            return coal.Sphere(shape.radius), np.eye(3), shape.ends[0], 0.0
        x = np.linalg.svd(axis[None])[2][1]
        z = axis / length
        R = np.column_stack((x, np.cross(z, x), z))
        return coal.Capsule(shape.radius, length), R, shape.ends.mean(axis=0), 0.0
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for vertex in shape.vertices:
        points.append(vertex)
    for face in ConvexHull(shape.vertices).simplices.tolist():
        faces.append(coal.Triangle(*face))
    return coal.Convex(points, faces), np.eye(3), np.zeros(3), shape.radius


def distances(robot: Robot, bodies, pairs, q) -> np.ndarray:
    """Distances of the pairs by coal alone, the joints placed by a fresh ``pin.Data``."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    shapes = [oracle(body.shape) for body in bodies]
    request = coal.DistanceRequest()
    request.gjk_tolerance = request.epa_tolerance = 1e-9
    found = []
    for pair in np.asarray(pairs).reshape(-1, 2).tolist():
        arguments, radius = [], 0.0
        for k in pair:
            geometry, R, p, rounding = shapes[k]
            pose = data.oMi[bodies[k].joint]
            arguments += [geometry, coal.Transform3s(pose.rotation @ R, pose.act(p))]
            radius += rounding
        found.append(coal.distance(*arguments, request, coal.DistanceResult()) - radius)
    return np.array(found)


def of_model(model: CollisionModel, q) -> np.ndarray:
    return distances(model.robot, model.bodies, model.pairs, q)
