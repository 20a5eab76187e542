"""Linear algebra of symmetric matrices against plain matrix products."""

import numpy as np
import pytest

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
