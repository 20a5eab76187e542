"""Linear algebra of symmetric matrices against plain matrix products."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.spatial import FROBENIUS_WEIGHTS, commutator_matrix, congruence, skew, vech, vech_inverse
from wbc.validate import finite_array, finite_number

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


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_bad_entries_are_named(bad: float) -> None:
    with pytest.raises(InvalidInputError, match=r"measured: NaN or infinite at \(1,\)"):
        finite_array("measured", [0.0, bad, 1.0], (3,))


def test_infinities_that_cancel_are_found() -> None:
    with pytest.raises(InvalidInputError, match="NaN or infinite"):
        finite_array("measured", [np.inf, -np.inf], (2,))


def test_wrong_shape_and_words_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"expected shape \(3,\), got \(2,\)"):
        finite_array("target", [1, 2], (3,))
    with pytest.raises(InvalidInputError, match="expected numbers"):
        finite_array("target", ["a", "b", "c"], (3,))
    with pytest.raises(InvalidInputError, match="greater than 0"):
        finite_number("dt", 0.0, above=0.0)
    with pytest.raises(InvalidInputError, match="expected a number"):
        finite_number("dt", "fast")
