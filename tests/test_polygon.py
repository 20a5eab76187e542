"""Insets of polygons against the distance from the edge, nearest points against SciPy."""

import numpy as np
import pytest
from scipy.optimize import minimize

from wbc.errors import InvalidInputError
from wbc.polygon import convex_hull, inset, nearest_point, polygon_margin


@pytest.mark.parametrize("seed", range(5))
def test_an_inset_is_what_lies_that_far_inside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon = convex_hull(rng.normal(size=(12, 2)))
    inner = inset(polygon, 0.1)
    np.testing.assert_allclose(polygon_margin(polygon, inner), 0.1, atol=1e-9)
    points = rng.uniform(-2.0, 2.0, (2000, 2))
    inside = polygon_margin(inner, points) > 0.0
    np.testing.assert_array_equal(inside, polygon_margin(polygon, points) > 0.1)
    assert inside.any()


def test_short_edges_vanish_and_no_inset_is_none() -> None:
    square = np.array(((0.0, 0.0), (1.0, 0.0), (1.0, 0.99), (0.99, 1.0), (0.0, 1.0)))
    expected = [(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75)]
    np.testing.assert_allclose(sorted(inset(square, 0.25).tolist()), sorted(expected), atol=1e-12)
    np.testing.assert_array_equal(inset(square, 0.0), square)
    with pytest.raises(InvalidInputError, match=r"nothing of it is 0\.6 m inside"):
        inset(square, 0.6)


@pytest.mark.parametrize("count", [1, 2, 3, 8])
@pytest.mark.parametrize("seed", range(3))
def test_the_nearest_point_is_the_nearest_mixture_of_corners(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon, point = convex_hull(rng.normal(size=(count, 2))), 2.0 * rng.normal(size=2)
    k = len(polygon)
    mixed = minimize(
        lambda shares: float(np.square(shares @ polygon - point).sum()),
        np.full(k, 1.0 / k),
        bounds=[(0.0, 1.0)] * k,
        constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1.0},
        options={"ftol": 1e-14},
    )
    np.testing.assert_allclose(nearest_point(polygon, point), mixed.x @ polygon, atol=1e-5)
    inside = polygon.mean(axis=0)
    np.testing.assert_allclose(nearest_point(polygon, inside), inside, atol=1e-12)
