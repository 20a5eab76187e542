"""Equimomental ellipsoid against point sets and solids whose second moments are known exactly."""

from itertools import product

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.ellipsoid import (
    Ellipsoid,
    equimomental,
    equimomental_at_density,
    reaction_mass_radii,
    second_moment,
)
from wbc.validate import Array

# Rounding of a handful of operations on 3x3 matrices, relative to their size.
EXACT = 1e-12


def inertia_of_points(points: Array, masses: Array) -> Array:
    """Sum m (|x|^2 1 - x x^T), one point after the other."""
    total = np.zeros((3, 3))
    for point, mass in zip(points, masses, strict=True):
        total += mass * (point @ point * np.eye(3) - np.outer(point, point))
    return total


def random_rotation(rng: np.random.Generator) -> Array:
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(turn * np.sign(np.linalg.det(turn)))


def affine_body(rng: np.random.Generator, count: int = 40) -> tuple[Array, float, Array]:
    """Return (points, mass of each, A): a cloud whose mean square is A A^T exactly.

    The eight corners (+-1, +-1, +-1) have the mean square 1 along each axis and none across; so
    do rotated copies of them. The cloud is their image under A.
    """
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    cloud = np.concatenate([corners @ random_rotation(rng).T for _ in range(count // 8)])
    A = rng.normal(size=(3, 3))
    return cloud @ A.T, float(rng.uniform(0.1, 3.0)), A


@pytest.mark.parametrize("seed", range(20))
def test_ellipsoid_of_an_affine_point_cloud(seed: int) -> None:
    """Five times the mean square of a uniform ellipsoid is its shape matrix sum a_k^2 e_k e_k^T."""
    rng = np.random.default_rng(seed)
    points, each, A = affine_body(rng)
    mass = each * len(points)
    inertia = inertia_of_points(points, np.full(len(points), each))
    size = np.linalg.norm(A @ A.T)

    np.testing.assert_allclose(
        second_moment(inertia), mass * A @ A.T, rtol=0, atol=EXACT * mass * size
    )
    found = equimomental(inertia, mass)
    shape = (found.axes * found.semi_axes**2) @ found.axes.T
    np.testing.assert_allclose(shape, 5.0 * A @ A.T, rtol=0, atol=10 * EXACT * size)
    # The semi-axes are sqrt(5) times the singular values of A; the smallest may lose digits.
    singular = np.linalg.svd(A, compute_uv=False)
    np.testing.assert_allclose(
        found.semi_axes**2, 5.0 * singular**2, rtol=0, atol=10 * EXACT * singular[0] ** 2
    )
    assert found.mass == pytest.approx(mass, rel=EXACT)
    assert np.linalg.det(found.axes) == pytest.approx(1.0, abs=EXACT)
    for k in range(2):
        assert found.axes[np.abs(found.axes[:, k]).argmax(), k] > 0


@pytest.mark.parametrize("seed", range(20))
def test_round_trips(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, each, _ = affine_body(rng)
    inertia = inertia_of_points(points, np.full(len(points), each))
    size = np.abs(inertia).max()
    ellipsoid = equimomental(inertia, each * len(points))
    for again in (ellipsoid, equimomental_at_density(inertia, 1000.0)):
        np.testing.assert_allclose(again.inertia(), inertia, rtol=0, atol=EXACT * size)
        np.testing.assert_allclose(
            again.principal_moments, np.linalg.eigvalsh(inertia), rtol=0, atol=EXACT * size
        )
    twin = equimomental(ellipsoid.inertia(), ellipsoid.mass)
    np.testing.assert_allclose(twin.semi_axes, ellipsoid.semi_axes, rtol=1e-10)
    np.testing.assert_allclose(twin.axes, ellipsoid.axes, rtol=0, atol=1e-10)


def test_direction_of_axes_does_not_hang_on_rounding() -> None:
    """Two components of an axis that are equal but for rounding: the first one is positive."""
    turn = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)
    inertia = turn @ np.diag([1.0, 1.5, 2.0]) @ turn.T
    rng = np.random.default_rng(0)
    for _ in range(50):
        noise = rng.uniform(-1e-14, 1e-14, size=(3, 3))
        axes = equimomental(inertia + noise + noise.T, 1.0).axes
        np.testing.assert_allclose(axes[:, 0], turn[:, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("principal", "mean_square"),
    [
        # Solid box 2a x 2b x 2c: M/3 (b^2 + c^2), ...; mean square a^2/3 along x.
        (np.array([0.5**2 + 0.2**2, 0.9**2 + 0.2**2, 0.9**2 + 0.5**2]) / 3,
         np.array([0.9, 0.5, 0.2]) ** 2 / 3),
        # Solid cylinder of radius r, height h: M (3 r^2 + h^2)/12 across, M r^2/2 along.
        (np.array([0.3**2 / 2, *[(3 * 0.3**2 + 1.7**2) / 12] * 2]),
         np.array([1.7**2 / 12, 0.3**2 / 4, 0.3**2 / 4])),
        # Thin disc of radius r across z.
        (np.array([0.25, 0.25, 0.5]) * 0.4**2, np.array([0.4**2 / 4, 0.4**2 / 4, 0.0])),
        # Thin rod of length l.
        (np.array([0.0, 1.0, 1.0]) * 1.2**2 / 12, np.array([1.2**2 / 12, 0.0, 0.0])),
        # Solid ball.
        (np.full(3, 0.4) * 0.7**2, np.full(3, 0.7**2 / 5)),
        # A point.
        (np.zeros(3), np.zeros(3)),
    ],
    ids=["box", "cylinder", "disc", "rod", "ball", "point"],
)  # fmt: skip
def test_solids(principal: Array, mean_square: Array) -> None:
    """Moments per mass from a table; extents along the axes longest first by integration."""
    mass = 2.5
    found = equimomental(np.diag(mass * principal), mass)
    # A semi-axis of zero is the root of a rounding error.
    np.testing.assert_allclose(found.semi_axes, np.sqrt(5 * mean_square), rtol=EXACT, atol=1e-7)
    np.testing.assert_allclose(
        np.sort(found.principal_moments), np.sort(mass * principal), rtol=0, atol=1e-14
    )


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        (np.diag([1.0, 1.0, 2.5]), r"1, 1, 2.5 .* exceeds the sum of the others by 0.5"),
        (np.diag([-1.0, 1.0, 1.0]), r"exceeds the sum of the others by 1 "),
        (np.diag([1.0, 1.0, 2.0 + 1e-7]), r"by 1e-07"),
        (np.eye(3) + np.diag([0.25, 0.0], 1), r"mirrored entries differ by 0.25"),
        (np.diag([1.0, np.nan, 1.0]), r"NaN or infinite at \(1, 1\)"),
        (np.eye(2), r"expected shape \(3, 3\), got \(2, 2\)"),
        ("round", r"expected numbers"),
    ],
)
def test_impossible_inertias_are_refused(inertia: Array, message: str) -> None:
    for call in (
        lambda: second_moment(inertia),
        lambda: equimomental(inertia, 1.0),
        lambda: equimomental_at_density(inertia, 1000.0),
        lambda: reaction_mass_radii(inertia, 1.0),
    ):
        with pytest.raises(InvalidInputError, match=message):
            call()


def test_rounding_is_no_reason_to_refuse() -> None:
    """A flat body as a file with nine digits gives it."""
    found = equimomental(np.diag([0.333333333, 0.333333333, 0.6666666665]), 1.0)
    assert 0.0 <= found.semi_axes[2] < 1e-4
    rough = np.eye(3)
    rough[0, 1] = 1e-10
    np.testing.assert_array_equal(second_moment(rough), second_moment(rough).T)


@pytest.mark.parametrize("principal", [[1.0, 1.0, 2.0], [0.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
def test_a_flat_body_has_no_ellipsoid_of_given_density(principal: list[float]) -> None:
    with pytest.raises(InvalidInputError, match="flat body"):
        equimomental_at_density(np.diag(principal), 1000.0)


def test_an_ellipsoid_checks_its_own_numbers() -> None:
    good = Ellipsoid(np.array([3.0, 2.0, 1.0]), np.eye(3), 1.0)
    assert not good.semi_axes.flags.writeable and not good.axes.flags.writeable
    for semi_axes, axes, mass, message in (
        ([1.0, 1.0, -1.0], np.eye(3), 1.0, "negative"),
        ([1.0, 1.0, 1.0], np.diag([1.0, 1.0, -1.0]), 1.0, "not a rotation"),
        ([1.0, 1.0, 1.0], 2 * np.eye(3), 1.0, "not a rotation"),
        ([1.0, 1.0, 1.0], np.eye(3), 0.0, "mass"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            Ellipsoid(np.array(semi_axes), axes, mass)
