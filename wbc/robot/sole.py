"""The sole of a rigid body: the convex hull of its lowest points."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from wbc.polygon import centroid, convex_hull, polygon_area, thinned
from wbc.robot.formats.description import GeometrySource
from wbc.robot.formats.triangles import BOX_CORNERS, Triangles
from wbc.validate import Array

PlacedShape = tuple[pin.SE3, object]  # a shape in the axes of its joint
FLAT = 3e-3  # m: points no higher than this above the lowest belong to the sole
# Shares of a body's bounding rectangle seen from above: if the level sole is smaller than the
# first, a larger tilted face is searched; if the sole is smaller than the second, a note says so.
FULL_SHARE, SMALL_SHARE = 0.5, 0.25
LEAST_UPWARD = np.cos(np.deg2rad(30.0))  # of the normal of such a face
LYING = 0.5  # of the vertical's part along a cylinder's axis, which then touches along a line
FACE_SEARCHES = 2  # repetitions: the lowest points of round shapes depend on the face
LEVEL_BALLS = 1e-6  # m: lowest points of balls within it are in one plane, on a line, or one
COPLANAR = np.cos(np.deg2rad(1.0))  # facets of a hull that are one face
ALMOST_VERTICAL = np.cos(np.deg2rad(5.0))  # of an axis that is taken to be vertical
_RIM = np.linspace(0.0, 2 * np.pi, 16, endpoint=False)
_DISC = np.stack([np.cos(_RIM), np.sin(_RIM), np.zeros_like(_RIM)], axis=1)  # (16, 3)


def extreme_points(shape: object, up: Array) -> Array:
    """Return points (k, 3) of a ``coal`` shape or a mesh, in its frame, its lowest ones among them.

    ``up`` (3,) is the unit vector upwards in that frame. Shapes that end nowhere or are unknown
    give no points.
    """
    match shape:
        case coal.Box():
            return BOX_CORNERS * np.asarray(shape.halfSide, dtype=np.float64)
        case coal.Sphere():
            return -float(shape.radius) * up[None]
        case coal.Ellipsoid():
            radii = np.asarray(shape.radii, dtype=np.float64)
            return -(radii**2 * up / np.linalg.norm(radii * up))[None]
        case coal.Capsule():
            return _ends(shape.halfLength) - float(shape.radius) * up
        case coal.Cylinder():
            rim = float(shape.radius) * _DISC @ _turn_to(up)
            if abs(up[2]) < LYING:
                rim = rim[:1]  # its neighbours are higher, by little if it is thin
            return np.concatenate([rim + end for end in _ends(shape.halfLength)])
        case coal.Cone():
            apex, base = _ends(shape.halfLength)
            rim = float(shape.radius) * _DISC @ _turn_to(up)
            return np.concatenate([rim + base, apex[None]])
        case Triangles():
            return shape.vertices
        case coal.ConvexBase():
            return np.array(shape.points())
        case coal.BVHModelBase():
            return np.array(shape.vertices())
    return np.empty((0, 3))


def _ends(half_length: float) -> Array:
    return np.array([[0.0, 0.0, half_length], [0.0, 0.0, -half_length]])


def _turn_to(up: Array) -> Array:
    """Return the rotation about z after which the first rim point is the lowest."""
    angle = np.arctan2(-up[1], -up[0])
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


# Number of directions across an axis, and relative tolerance of a wheel's radius in them.
PROFILE_DIRECTIONS, ROUNDNESS = 12, 0.03


def lowest_point(model: pin.Model, data: pin.Data, geometry: GeometrySource, joint: int) -> float:
    """Return how high the lowest point of a joint's body is [m]; infinite if it has no shape.

    ``data`` holds the places of joints.
    """
    pose = data.oMi[joint]
    points = _points(body_shapes(model, geometry, joint), pose.rotation[2])
    if not len(points):
        return np.inf
    return float((points @ pose.rotation[2]).min()) + float(pose.translation[2])


def _points(shapes: list[PlacedShape], up: Array) -> Array:
    """Return points (k, 3) of shapes, those lowest along ``up`` (3,) among them, joint's frame."""
    found = [np.empty((0, 3))]
    for place, shape in shapes:
        R = place.rotation
        found.append(extreme_points(shape, R.T @ up) @ R.T + place.translation)
    return np.concatenate(found)


def is_round_about(model: pin.Model, geometry: GeometrySource, joint: int, axis: Array) -> bool:
    """Return whether a joint's body is round about an axis (3,) through its origin, as a wheel."""
    shapes = body_shapes(model, geometry, joint)
    across = np.linalg.svd(axis[None])[2][1:]  # (2, 3)
    angles = np.linspace(0.0, 2.0 * np.pi, PROFILE_DIRECTIONS, endpoint=False) + 0.1
    reach = []
    for direction in np.column_stack((np.cos(angles), np.sin(angles))) @ across:
        points = _points(shapes, direction)
        reach.append(-float((points @ direction).min(initial=0.0)))
    return min(reach) > (1.0 - ROUNDNESS) * max(reach) > 0.0


def body_shapes(model: pin.Model, geometry: GeometrySource, joint: int) -> list[PlacedShape]:
    """Return the collision shapes on one joint's body, or those to draw of one without.

    Their placements in the joint's frame, and what they are.
    """
    links = [
        str(frame.name)
        for frame in model.frames
        if frame.type == pin.FrameType.BODY and frame.parentJoint == joint
    ]
    for kind in (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL):
        shapes, meshes = geometry.surfaces(model, kind, links)
        if shapes.ngeoms:
            break
    return [
        (shape.placement, meshes.get(str(shape.name), shape.geometry))
        for shape in shapes.geometryObjects
    ]


def find_sole(
    model: pin.Model, geometry: GeometrySource, frame: pin.Frame, R: Array
) -> tuple[pin.SE3, Array, float] | None:
    """Return the placement and polygon (k, 2) of the sole below the body of ``frame``, or None.

    The sole is the convex hull of the body's lowest points; its placement is in the body's joint.
    With it comes its area in parts of the rectangle round the body.
    Where these are an edge, a corner or a strip of a larger flat face of the body's hull, as of a
    foot that is not drawn level, it is that face, if it points down within 30 degrees.
    ``R`` (3, 3) takes the frame's axes to the world's in a posture with the sole about level.
    """
    joint = frame.parentJoint
    axes = frame.placement.rotation @ _level_axes(R)  # in the joint's frame
    shapes = body_shapes(model, geometry, joint)
    points = _points(shapes, axes[:, 2])
    if not len(points):
        return None
    lowest, polygon = _flat_part(points, axes)
    if polygon_area(polygon) < FULL_SHARE * _footprint(points, axes):
        face = _tilted_face(points, axes)
        for _ in range(FACE_SEARCHES):  # the lowest points of round shapes depend on the face
            if face is not None:
                face = _tilted_face(_points(shapes, face[:, 2]), axes)
        if face is not None:
            seen = _points(shapes, face[:, 2])  # those of a lying cylinder are no face, but a line
            height, larger = _flat_part(seen, face)
            touching = points[points @ axes[:, 2] <= lowest + FLAT] @ face[:, 2] <= height + FLAT
            if touching.all() and polygon_area(larger) > 2.0 * polygon_area(polygon):
                lowest, polygon, axes, points = height, larger, face, seen
    whole = _footprint(points, axes)
    share = polygon_area(polygon) / whole if whole > 0.0 else 1.0
    return *centred_on_sole(pin.SE3(axes, np.zeros(3)), polygon, lowest), share


def _flat_part(points: Array, axes: Array) -> tuple[float, Array]:
    """Return how high the lowest points (k, 3) are along the third axis, and their hull."""
    local = points @ axes
    lowest = float(local[:, 2].min())
    return lowest, thinned(_without_rounding(convex_hull(local[local[:, 2] <= lowest + FLAT, :2])))


def _without_rounding(hull: Array) -> Array:
    """Return a hull (k, 2) as the segment or the point that it is but for rounding."""
    about = hull - hull.mean(axis=0)
    along, across = (about @ np.linalg.svd(about)[2].T).T
    if np.ptp(along) < LEVEL_BALLS:
        return hull[:1]
    return hull[sorted((along.argmin(), along.argmax()))] if np.ptp(across) < LEVEL_BALLS else hull


def _tilted_face(points: Array, axes: Array) -> Array | None:
    """Return the axes (3, 3) of the largest face of the points' hull that looks down, or None.

    Its normal is the third axis, upwards; the first is as near to that of ``axes`` as it can be.
    """
    from scipy.spatial import ConvexHull, QhullError  # only here: SciPy takes a while to load

    middle = points.mean(axis=0)
    spread, plane = np.linalg.svd(points - middle, full_matrices=False)[1:]
    if len(points) > 2 and spread[2] < LEVEL_BALLS and spread[1] > LEVEL_BALLS:  # balls in a plane
        up = plane[2] * np.sign(plane[2] @ axes[:, 2])
        return _axes_of(up, axes[:, 0]) if up @ axes[:, 2] > LEAST_UPWARD else None
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # a few points only
        return None
    corners = hull.points[hull.simplices]  # (facets, 3, 3)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = 0.5 * np.linalg.norm(sides, axis=1)
    normals = hull.equations[:, :3]  # outwards
    down = -normals @ axes[:, 2] > LEAST_UPWARD
    if not down.any():
        return None
    normals, sizes = normals[down], sizes[down]
    faces = (normals @ normals.T > COPLANAR) @ sizes  # with what is coplanar
    return _axes_of(-normals[int(np.argmax(faces))], axes[:, 0])


def _axes_of(up: Array, ahead: Array) -> Array:
    """Return axes (3, 3) of which the third is ``up``, the first as near ``ahead`` as can be."""
    forward = ahead - up * (up @ ahead)
    forward /= np.linalg.norm(forward)
    return np.stack([forward, np.cross(up, forward), up], axis=1)


def _footprint(points: Array, axes: Array) -> float:
    """Return the area [m^2] of the rectangle round points (k, 3), along the third axis."""
    return float(np.prod(np.ptp((points @ axes)[:, :2], axis=0)))


def _level_axes(R: Array) -> Array:
    """Return the sole's axes (3, 3) as columns in a link whose rotation to the world is R.

    They are up and forwards in the world, or the link's own axes if these are nearly so: a
    reference posture is level to about a degree only, a drawn foot exactly.
    """
    up = _snap_to_axis(R[2])
    return _axes_of(up, _snap_to_axis(R[0] - up * (up @ R[0])))


def _snap_to_axis(direction: Array) -> Array:
    direction = direction / float(np.linalg.norm(direction))
    along = np.abs(direction) >= ALMOST_VERTICAL  # one axis at most
    return np.where(along, np.sign(direction), 0.0) if along.any() else direction


def centred_on_sole(plane: pin.SE3, polygon: Array, height: float) -> tuple[pin.SE3, Array]:
    """Return a plane's placement moved to the centroid of a polygon on it, and the polygon there.

    ``height`` is that of the polygon over the plane [m].
    """
    middle = centroid(polygon)
    return plane * pin.SE3(np.eye(3), np.append(middle, height)), polygon - middle
