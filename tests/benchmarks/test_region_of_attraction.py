"""Regions of attraction: the grids, two ways of measuring, symmetry, and what theory says."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.region_of_attraction import (
    Region,
    lean_grid,
    lean_rate_grid,
    region_by_simulation,
    region_of_attraction,
    rest_error,
)
from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.lqr import Lqr
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


def test_a_lean_rate_moves_the_com_the_way_it_leans() -> None:
    model = SolidRmp(M, G)
    for start, (lean, rate) in zip(
        lean_rate_grid(REST, [0.1, -0.2], [0.5]), [(0.1, 0.5), (-0.2, 0.5)], strict=True
    ):
        c, speed = model.com(start[:12], start[12:])
        np.testing.assert_allclose(c, Z * np.array((np.sin(lean), 0.0, np.cos(lean))), atol=1e-12)
        along = Z * rate * np.array((np.cos(lean), 0.0, -np.sin(lean)))
        np.testing.assert_allclose(speed, along, atol=1e-12)


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
    assert 0.3 < square.share < 0.8


@pytest.mark.slow
def test_settling_and_errors_go_with_the_verdict(square: Region) -> None:
    np.testing.assert_array_equal(np.isfinite(square.settling), square.attracted)
    assert np.all(square.error[square.attracted] <= 0.02)
    centre = len(square.starts) // 2
    assert square.settling[centre] == 0.0
    assert np.nanmax(square.settling) > 1.0


def test_one_run_at_a_time_gives_the_same(law: PointStabiliser) -> None:
    starts = lean_grid(REST, np.array((0.5, 0.9, 1.1)) * LIMIT, [0.0])
    mapped = region_of_attraction(law, REST, starts, duration=12.0)
    single = region_by_simulation(law, REST, starts, duration=12.0)
    np.testing.assert_array_equal(mapped.attracted, (True, True, False))
    np.testing.assert_array_equal(single.attracted, mapped.attracted)
    # Looked at every 0.1 s against every tick: within one look, or one swing through the margin.
    np.testing.assert_allclose(single.settling, mapped.settling, atol=0.11)


@pytest.mark.slow
def test_a_regulator_with_its_usual_weights_catches_less(law: PointStabiliser) -> None:
    starts = lean_grid(REST, np.array((0.2, 0.4, 0.6, 0.8)) * LIMIT, [0.0])
    lqr = Lqr(law.model, REST, bounds=law.bounds)
    # Weights that are soft enough on the masses make it reach as far, and take twice as long.
    ours = region_of_attraction(law, REST, starts, duration=12.0)
    theirs = region_by_simulation(lqr, REST, starts, duration=12.0)
    assert ours.attracted.all()
    assert not theirs.attracted[2:].any()


def test_leaning_and_falling_count_by_their_capture_point(law: PointStabiliser) -> None:
    leans, rates = np.linspace(-0.12, 0.12, 5), np.linspace(-0.6, 0.6, 7)
    region = region_of_attraction(law, REST, lean_rate_grid(REST, leans, rates), duration=14.0)
    lean, rate = -(region.starts[:, 2] - np.pi / 2), -region.starts[:, 14]
    height = Z * np.cos(lean)
    xi = Z * np.sin(lean) + Z * np.cos(lean) * rate / np.sqrt(G / height)
    # The height moves a little at first, and the limit with it.
    assert region.attracted[np.abs(xi) < 0.95 * REACH].all()
    assert not region.attracted[np.abs(xi) > 1.05 * REACH].any()


def test_progress_is_told(law: PointStabiliser) -> None:
    told: list[float] = []
    starts = lean_grid(REST, [0.5 * LIMIT], [0.0])
    region_of_attraction(law, REST, starts, duration=0.5, progress=told.append)
    region_by_simulation(law, REST, starts, duration=0.5, progress=told.append)
    assert told == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


def test_unusable_grids_are_refused(law: PointStabiliser) -> None:
    with pytest.raises(InvalidInputError, match="stand"):
        lean_grid(REST, [1.2], [1.2])
    with pytest.raises(InvalidInputError):
        lean_grid(REST[:5], [0.1], [0.1])
    with pytest.raises(InvalidInputError, match="starts"):
        region_of_attraction(law, REST, np.zeros((2, 5)))
    with pytest.raises(InvalidInputError, match="near"):
        region_of_attraction(law, REST, lean_grid(REST, [0.0], [0.0]), near=0.0)
