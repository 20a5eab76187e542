"""Fits hold every vertex; how far they bulge out is what they say."""

import coal
import numpy as np
import pytest
from scipy.optimize import nnls

from tests import urdf as toy
from wbc.robot import Robot
from wbc.robot.collision import CollisionModel, robot_bodies
from wbc.robot.collision.fitting import Fit, fit_capsule, fit_hull, quick_capsule
from wbc.robot.collision.refine import FinerShapes
from wbc.robot.collision.shapes import Capsule, Hull

FITS = {"capsule": fit_capsule, "hull": fit_hull}


def outside_segment(points, ends) -> np.ndarray:
    """Distance to a segment by halving: the squared distance is convex along it."""
    low, high = np.zeros(len(points)), np.ones(len(points))

    def away(share):
        return np.linalg.norm(points - ends[0] - share[:, None] * (ends[1] - ends[0]), axis=1)

    for _ in range(80):
        first, second = low + (high - low) / 3, high - (high - low) / 3
        nearer = away(first) < away(second)
        low, high = np.where(nearer, low, first), np.where(nearer, second, high)
    return away(0.5 * (low + high))


def outside_hull(point, vertices) -> float:
    """Distance to a hull: least squares over convex combinations (a penalty ties the sum)."""
    tie = 1e4
    A = np.vstack((vertices.T, tie * np.ones(len(vertices))))
    return float(nnls(A, np.append(point, tie))[1])


def outside(points, shape: Capsule | Hull) -> float:
    """How far the farthest point is outside a shape [m]; inside, less than 0."""
    if isinstance(shape, Capsule):
        return float(outside_segment(points, shape.ends).max()) - shape.radius
    return max(outside_hull(point, shape.vertices) for point in points) - shape.radius


CLOUDS = {
    "ball": lambda rng: rng.normal(size=(300, 3)),
    "rod": lambda rng: rng.normal(size=(200, 3)) * [0.02, 0.03, 1.0],
    "plate": lambda rng: rng.uniform(-1, 1, (200, 3)) * [0.5, 0.3, 0.0],
    "line": lambda rng: rng.uniform(-1, 1, (50, 1)) * [[1.0, 2.0, 0.5]],
    "triangle": lambda rng: rng.normal(size=(3, 3)),
    "point": lambda rng: np.ones((4, 3)),
    "far": lambda rng: rng.normal(size=(100, 3)) * 0.1 + [50.0, -20.0, 3.0],
    "twice": lambda rng: np.tile(rng.normal(size=(20, 3)), (2, 1)),
}


@pytest.mark.parametrize("cloud", CLOUDS)
def test_fits_hold_every_point(cloud: str, rng) -> None:
    points = CLOUDS[cloud](rng)
    size = 1 + np.abs(points).max()
    capsule, hull = fit_capsule(points), fit_hull(points)
    assert outside(points, capsule.shape) < 1e-12 * size
    assert 0.0 <= capsule.bulge <= 2 * capsule.shape.radius
    assert outside(points, hull.shape) < 1e-5 * size
    assert len(hull.shape.vertices) <= 134


def test_a_rod_is_fitted_closely(rng) -> None:
    """A capsule's own points: the fit finds it again, within a tenth of its radius."""
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ends = np.array([[0.1, 0.0, 0.2], [0.4, 0.3, -0.5]])
    points = ends[rng.integers(2, size=4000)] + 0.05 * directions
    fit = fit_capsule(points)
    assert fit.shape.radius < 0.055
    assert fit.bulge < 0.005


def test_the_bulge_of_a_boxs_capsule_is_known() -> None:
    """A cube of side 2, for which the distance from outside is arithmetic."""
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    fit = fit_capsule(cube)
    axis = fit.shape.ends[1] - fit.shape.ends[0]
    r, length = fit.shape.radius, np.linalg.norm(axis)
    ball = 4 / 3 * np.pi * np.sqrt(3) ** 3
    assert np.pi * r**2 * (length + 4 / 3 * r) < 1.01 * ball
    rays = np.random.default_rng(0).normal(size=(20_000, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    nearest_end = fit.shape.ends[(rays @ axis > 0).astype(int)]
    surface = nearest_end + r * rays
    bulge = np.linalg.norm(np.maximum(np.abs(surface) - 1.0, 0.0), axis=1).max()
    assert fit.bulge == pytest.approx(bulge, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "fit"), [("romeo", "capsule"), ("icub", "hull")])
def test_every_vertex_of_a_robot_is_inside(name: str, fit: str, robot_named) -> None:
    robot: Robot = robot_named(name)
    bodies = robot_bodies(robot, fit)
    assert len(bodies) == robot.collision_model.ngeoms
    rng = np.random.default_rng(0)
    for body, shape in zip(bodies, robot.collision_model.geometryObjects, strict=True):
        vertices = np.array(shape.geometry.vertices())
        placed = vertices @ shape.placement.rotation.T + shape.placement.translation
        few = placed if isinstance(body.shape, Capsule) else rng.choice(placed, size=10)
        assert outside(few, body.shape) < 1e-6, body.name
        assert 0.0 <= body.bulge < 0.2


@pytest.mark.slow
def test_parts_do_not_depend_on_the_last_bits(robot_named, rng, monkeypatch) -> None:
    """Parts that share a corner are as near as each other: rounding must not say which is cut."""
    robot: Robot = robot_named("icub")
    bodies = robot_bodies(robot)
    names = [body.name for body in bodies]
    pair = names.index("r_upper_arm"), names.index("r_forearm")
    apart, found = FinerShapes._part_distance, set()
    for scale in (0.0, *[1e-12] * 4):
        monkeypatch.setattr(
            FinerShapes,
            "_part_distance",
            lambda *args, scale=scale: apart(*args) + scale * rng.uniform(-1.0, 1.0),
        )
        finer = FinerShapes(robot, bodies).pair(pair, 3e-3)
        shapes = [one.shape.core.tobytes() for one in (*finer.first, *finer.second)]
        found.add((len(finer.first), round(finer.distance, 9), *shapes))
    assert len(found) == 1


@pytest.mark.parametrize("fit", FITS)
def test_cylinders_and_boxes(fit: str, hoap2) -> None:
    """Rims of cylinders and corners of boxes, from their sizes in the file."""
    turns, seen = np.linspace(0, 2 * np.pi, 50), set()
    shapes = hoap2.collision_model.geometryObjects
    for body, shape in zip(robot_bodies(hoap2, fit), shapes, strict=True):
        geometry = shape.geometry
        seen.add(type(geometry))
        if isinstance(geometry, coal.Cylinder):
            r, h = geometry.radius, geometry.halfLength
            local = np.array([[r * np.cos(a), r * np.sin(a), z] for a in turns for z in (-h, h)])
        elif isinstance(geometry, coal.Box):
            half = np.asarray(geometry.halfSide)
            local = half * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        else:
            continue
        placed = local @ shape.placement.rotation.T + shape.placement.translation
        assert outside(placed[:20] if fit == "hull" else placed, body.shape) < 1e-6
    assert {coal.Cylinder, coal.Box} <= seen


@pytest.mark.parametrize("fit", FITS)
def test_round_faces_may_have_many_corners(fit: str) -> None:
    """As Centauro's pelvis has; 50 of them are nearly as round, by 0.2 % of the radius."""

    def fitted(count: int) -> Fit:
        angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
        rim = [(0.3 * np.cos(a), 0.3 * np.sin(a), z) for a in angles for z in (0.0, 0.2)]
        return FITS[fit](np.array(rim))

    assert fitted(400).bulge == pytest.approx(fitted(50).bulge, abs=0.01)


FLAT = ("box size='0.2 0.1 0'", "box size='0 0 0.3'", "box size='0 0 0'")
FLAT += ("cylinder radius='0.1' length='0'", "cylinder radius='0' length='0.2'")


@pytest.mark.parametrize("fit", FITS)
@pytest.mark.parametrize("shape", FLAT)
def test_boxes_and_cylinders_may_be_flat(shape: str, fit: str) -> None:
    flat = toy.link("a", toy.collision(shape)), toy.link("b", toy.collision("sphere radius='0.1'"))
    robot = Robot.load(toy.robot("r", *flat, toy.joint("j", "a", "b", at="0 0 1")), feet={})
    bodies = robot_bodies(robot, fit)
    here = robot.snapshot(robot.postures["neutral"])
    (distance,) = CollisionModel(robot, bodies, [(1, 0)]).nearest(here).distance
    raw = robot.collision_model.geometryObjects[0].geometry
    apart = 0.9 - raw.halfSide[2] if isinstance(raw, coal.Box) else 0.9 - raw.halfLength
    assert apart - bodies[0].bulge - 2e-4 < distance < apart + 1e-9


@pytest.mark.parametrize("count", [1, 2, 5, 200])
def test_a_quick_capsule_holds_every_point(count: int, rng) -> None:
    points = rng.normal(size=(count, 3)) * [3.0, 1.0, 0.5]
    capsule = quick_capsule(points)
    assert (outside_segment(points, capsule.ends) <= capsule.radius).all()
    assert capsule.radius > 0.0
