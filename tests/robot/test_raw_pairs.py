"""Margins by raw shapes: against distances of Coal, placed by Pinocchio's own geometry data."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests import urdf as toy
from wbc.constraints import SelfCollision
from wbc.robot import Robot
from wbc.robot.collision import CollisionModel, robot_bodies
from wbc.robot.collision.bodies import named_shapes
from wbc.robot.collision.distances import RawPairs


@pytest.mark.slow
def test_pairs_are_apart_by_their_files(g1: Robot, rng: np.random.Generator) -> None:
    collision = SelfCollision(g1, margin=0.01, pairs=10_000)
    labels, model = collision.model.labels, g1.collision_model
    raw = RawPairs(g1, collision.model.bodies, collision.model.pairs)
    placed = pin.GeometryData(model)
    index = {name: model.getGeometryId(shape.name) for name, _, shape in named_shapes(g1)}
    chosen = [k for k, label in enumerate(labels) if "hip" in label][::3]
    near = 0
    for _ in range(6):
        step = np.concatenate((np.zeros(6), 1.2 * rng.normal(size=g1.nv - 6)))
        q = g1.integrate(g1.postures["standing"], step, 1.0)
        pin.updateGeometryPlacements(g1.model, g1.model.createData(), model, placed, q)
        clearance = collision.distances(g1.snapshot(q)).clearance
        for k in chosen:
            a, b = (index[one.partition("/")[0]] for one in labels[k].split(" vs "))
            shapes = (
                (model.geometryObjects[n].geometry, coal.Transform3s(T.rotation, T.translation))
                for n, T in ((a, placed.oMg[a]), (b, placed.oMg[b]))
            )
            (first, at), (second, there) = shapes
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            distance = coal.distance(first, at, second, there, request, result)
            margin = float(collision.margins[k])
            if abs(distance - margin) > 1e-6:  # rounding of Coal's
                near += distance < margin
                by, *normal = raw.violations(q, [k], collision.margins)[0][:4]
                assert by == pytest.approx(max(margin - distance, 0.0), abs=1e-9)
                if 0.0 < distance < margin:
                    way = result.getNearestPoint1() - result.getNearestPoint2()
                    assert normal == pytest.approx(way / distance, abs=1e-4)
            # Fitted shapes contain raw ones: what they keep, these do.
            if clearance[k] > 0.0:
                assert not raw.violations(q, [k], collision.margins).any(), labels[k]
    assert near > 0


def test_links_may_have_slashes_and_words_of_labels_in_their_names() -> None:
    """As those of a robot that MuJoCo attaches to a scene; a box each, 0.3 m from face to face."""
    names = ("r2/waist", "r2/head vs tail")
    box = toy.collision("box size='0.2 0.2 0.2'")
    links = (toy.link(name, box) for name in names)
    robot = Robot.load(toy.robot("r", *links, toy.joint("j", *names, at="0 0 0.5")), feet={})
    model = CollisionModel(robot, robot_bodies(robot), [(1, 0)])
    found = model.raw.violations(robot.postures["neutral"], [0], np.array([0.4]))
    np.testing.assert_allclose(found[0, :4], (0.1, 0.0, 0.0, 1.0), atol=1e-6)
