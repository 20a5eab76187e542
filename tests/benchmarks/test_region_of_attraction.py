"""Regions of attraction: the grid, symmetry, and what theory says."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.region_of_attraction import Region, lean_grid, region_of_attraction, rest_error
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.solid import SolidRmp

Array = NDArray[np.float64]
M, G, Z, TORQUE = 35.0, 9.81, 0.7, 20.0
RADII = np.full(3, 0.3)
REST = np.array((0.0, 0.0, np.pi / 2, 0.0, Z, 0.0, 0.0, 0.0, 1.0, *RADII))
REACH = TORQUE / (M * G)
LIMIT = float(np.arcsin(REACH / Z))


@pytest.fixture(scope="module")
def law() -> PointStabiliser:
    return PointStabiliser(SolidRmp(M, G), LawBounds(wheel_torque=TORQUE), Z, RADII)


@pytest.fixture(scope="module")
def square(law: PointStabiliser) -> Region:
    leans = np.linspace(-1.3, 1.3, 11) * LIMIT
    return region_of_attraction(law, REST, lean_grid(REST, leans, leans), duration=14.0)


def test_a_lean_is_that_of_the_leg_and_nothing_else() -> None:
    model = SolidRmp(M, G)
    starts = lean_grid(REST, [0.3, 0.0, -0.2], [0.0, 0.4])
    for start, (x, y) in zip(
        starts, [(a, b) for a in (0.3, 0, -0.2) for b in (0, 0.4)], strict=True
    ):
        c, rate = model.com(start[:12], start[12:])
        lean = np.hypot(x, y)
        np.testing.assert_allclose(np.hypot(c[0], c[1]), Z * np.sin(lean), atol=1e-12)
        np.testing.assert_allclose(c[2], Z * np.cos(lean), atol=1e-12)
        np.testing.assert_allclose(c[0] * y - c[1] * x, 0.0, atol=1e-12)
        assert c[0] * x + c[1] * y >= 0.0
        np.testing.assert_array_equal(start[4:12], REST[4:])
        np.testing.assert_array_equal(rate, 0.0)


def test_distance_from_rest_is_the_largest_of_its_parts() -> None:
    state = np.concatenate((REST, np.zeros(11)))
    assert rest_error(state[None], REST)[0] == 0.0
    moved = np.tile(state, (4, 1))
    moved[0, 2] += 0.3
    moved[1, 5:9] = (0.0, np.sin(0.1), 0.0, np.cos(0.1))
    moved[2, 4] += 0.07
    moved[3, 12 + 7] = -0.4
    # The second one to second order in its angle of 0.2 rad.
    np.testing.assert_allclose(rest_error(moved, REST), (0.3, 0.2, 0.1, 0.4), rtol=2e-3)
    # One orientation, two quaternions.
    twin = state.copy()
    twin[5:9] *= -1.0
    assert rest_error(twin[None], REST)[0] == 0.0


@pytest.mark.slow
def test_what_is_attracted_is_what_the_torque_can_turn_back(square: Region) -> None:
    place = Z * np.column_stack(
        (np.cos(square.starts[:, 2]) * np.cos(square.starts[:, 3]), np.sin(square.starts[:, 3]))
    )
    far = np.abs(place).max(axis=1) / REACH
    # One motor for each axis: inside the square all, outside the circle around it none. Between
    # them the axes of the masses decide, which turn.
    assert square.attracted[far < 0.98].all()
    assert not square.attracted[np.linalg.norm(place, axis=1) > 1.02 * np.sqrt(2.0) * REACH].any()
    assert not square.attracted[(far > 1.02) & (np.abs(place).min(axis=1) < 1e-9)].any()


@pytest.mark.slow
def test_the_region_is_its_own_mirror_image(square: Region) -> None:
    grid = square.attracted.reshape(11, 11)
    np.testing.assert_array_equal(grid, grid[::-1])
    np.testing.assert_array_equal(grid, grid[:, ::-1])
    np.testing.assert_array_equal(grid, grid.T)
    assert 0.3 < square.attracted.mean() < 0.8
