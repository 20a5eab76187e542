"""The triangles that are left of two surfaces are as near as all: coal measures both."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from wbc.robot.collision.nearest_triangles import Clusters, nearest_triangles
from wbc.robot.formats.triangles import Triangles, as_bvh
from wbc.robot.geometry import ellipsoid


def apart(meshes: list[Triangles], places: list[pin.SE3]) -> float:
    placed = [coal.Transform3s(place.rotation, place.translation) for place in places]
    one, other = (as_bvh(*mesh) for mesh in meshes)
    request = coal.DistanceRequest()
    found = coal.distance(one, placed[0], other, placed[1], request, coal.DistanceResult())
    return max(float(found), 0.0)


@pytest.mark.parametrize(("gap", "count"), [(0.3, 0), (1e-2, 20), (1e-4, 0), (-0.2, 20)])
def test_what_is_left_is_as_near_as_all(gap: float, count: int, rng) -> None:
    """To the bit; bumpy surfaces, some with triangles as long as they are, anyhow turned."""
    for _ in range(3):
        meshes = []
        for _ in range(2):
            surface = ellipsoid(rng.uniform(0.1, 0.3, 3))
            bumps = 1.0 + 0.05 * rng.standard_normal((len(surface.vertices), 1))
            long = rng.integers(len(surface.vertices), size=(count, 3))
            faces = np.concatenate((surface.faces, long)).astype(np.int64)
            meshes.append(Triangles(surface.vertices * bumps, faces))
        places = [pin.SE3.Random(), pin.SE3.Random()]
        direction = places[1].translation - places[0].translation
        direction /= np.linalg.norm(direction)
        places[1].translation = places[0].translation + direction * 2.0
        places[1].translation -= direction * (apart(meshes, places) - gap)
        first, second, most = nearest_triangles(*map(Clusters, meshes), *places)
        exact = apart(meshes, places)
        assert apart([first, second], places) == exact <= most + 1e-12
        if not count:
            assert len(first.faces) + len(second.faces) < 0.4 * sum(len(m.faces) for m in meshes)
