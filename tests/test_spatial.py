"""Symmetric matrices against plain products, polygons against distances from edges and SciPy."""

import numpy as np
import pytest
from scipy.optimize import minimize

from wbc.errors import InvalidInputError
from wbc.polygon import convex_hull, inset, nearest_point, polygon_margin
from wbc.spatial import FROBENIUS_WEIGHTS, commutator_matrix, congruence, skew, vech, vech_inverse

# Products of a few numbers of order one: rounding is a few 1e-16.
TOLERANCE = 1e-14


@pytest.fixture
def symmetric(rng: np.random.Generator) -> np.ndarray:
    A = rng.normal(size=(3, 3))
    return A + A.T


def test_vech_and_its_inverse(symmetric: np.ndarray) -> None:
    assert (vech_inverse(vech(symmetric)) == symmetric).all()
    assert vech(symmetric).tolist() == symmetric[np.triu_indices(3)].tolist()


def test_frobenius_norm(symmetric: np.ndarray) -> None:
    squared = FROBENIUS_WEIGHTS @ vech(symmetric) ** 2
    assert squared == pytest.approx(np.linalg.norm(symmetric, "fro") ** 2, rel=TOLERANCE)


def test_skew_is_the_cross_product(rng: np.random.Generator) -> None:
    w, x = rng.normal(size=(2, 3))
    np.testing.assert_allclose(skew(w) @ x, np.cross(w, x), atol=TOLERANCE)


def test_congruence(symmetric: np.ndarray, rng: np.random.Generator) -> None:
    R = rng.normal(size=(3, 3))  # any matrix, not only rotations
    expected = vech(R @ symmetric @ R.T)
    np.testing.assert_allclose(congruence(R) @ vech(symmetric), expected, atol=10 * TOLERANCE)


def test_commutator_matrix(symmetric: np.ndarray, rng: np.random.Generator) -> None:
    w = rng.normal(size=3)
    expected = vech(skew(w) @ symmetric - symmetric @ skew(w))
    np.testing.assert_allclose(commutator_matrix(symmetric) @ w, expected, atol=10 * TOLERANCE)


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
