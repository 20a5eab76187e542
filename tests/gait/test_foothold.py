"""A sole that tips about an edge is pressed farther in; one that stands flat on all of it."""

import numpy as np
import pinocchio as pin
import pytest

from wbc.gait.foothold import Foothold
from wbc.gait.swing import turned
from wbc.validate import Array

HALF, WEIGHT = np.array((0.08, 0.03)), 300.0
UP = np.array((0.0, 0.0, 1.0))


def tipped(about: Array, angle: float) -> Array:
    """Return a sole that stood at a heading of 0.7 rad, turned about an axis of its own."""
    return turned(0.7) @ pin.exp3(angle * about)


def pressed_at(point: tuple[float, float], R: Array, load: float = WEIGHT) -> Array:
    """Return the wrench of a force at a point in the axes of the sole R, with friction."""
    force = R @ (0.1 * load, -0.2 * load, load)
    return np.concatenate((force, np.cross(R @ (*point, 0.0), force)))


@pytest.mark.parametrize(
    ("axis", "sign", "point"),
    [(0, 1, (0.028, 0.01)), (0, -1, (-0.05, 0.0)), (1, 1, (0.0, 0.02)), (1, -1, (0.03, -0.01))],
)
def test_who_tips_over_an_edge_is_pressed_this_side_of_it(
    axis: int, sign: int, point: tuple[float, float]
) -> None:
    stood = Foothold.whole(tipped(np.zeros(3), 0.0), UP, HALF)
    # ahead is over the axis to the left, to the left is over the one that points back
    about = sign * (np.array((0.0, 1.0, 0.0)), np.array((-1.0, 0.0, 0.0)))[axis]
    R = tipped(about, 0.05)
    way = sign * np.eye(3)[axis]
    assert (R @ way)[2] < -0.04  # that side is down
    known = stood.update(R, pressed_at(point, R), WEIGHT)
    beyond = known.nearest(*way[:2])  # a metre that way
    assert beyond[axis] == pytest.approx(point[axis] - sign * 0.1 * HALF[axis], abs=1e-12)
    assert known.nearest(*-way[:2])[axis] == pytest.approx(-sign * HALF[axis])  # nothing else
    other = 1 - axis
    assert known.lower[other] == -HALF[other] and known.upper[other] == HALF[other]
    # What it is pressed at as it turns back says nothing; once it is flat again that is kept.
    back, flat, inner = tipped(about, 0.04), tipped(about, 0.0), (0.0, 0.0)
    known = known.update(back, pressed_at(inner, back), WEIGHT)
    known = known.update(flat, pressed_at(inner, flat), WEIGHT)
    np.testing.assert_array_equal(known.nearest(*way[:2]), beyond)
    # It shrinks when it tips on, and when it tips again, farther in.
    farther = tipped(about, 0.06)
    for kept, now in ((stood.update(R, pressed_at(point, R), WEIGHT), farther), (known, R)):
        again = kept.update(now, pressed_at(inner, now), WEIGHT)
        assert sign * again.nearest(*way[:2])[axis] == pytest.approx(-0.1 * HALF[axis])


def test_who_goes_on_tipping_is_pressed_this_side_of_its_edge_all_the_time() -> None:
    """Pressed on its own edge for as long as it takes to turn back, a sole keeps the rest of it."""
    R = tipped(np.array((0.0, 1.0, 0.0)), 0.05)
    known = Foothold.whole(tipped(np.zeros(3), 0.0), UP, HALF)
    for _ in range(20):
        known = known.update(R, pressed_at((HALF[0], 0.0), R), WEIGHT)
    np.testing.assert_allclose(known.upper, (0.9 * HALF[0], HALF[1]), atol=1e-12)
    np.testing.assert_array_equal(known.lower, -HALF)


def test_who_settles_from_a_tilted_landing_does_not_tip() -> None:
    """From 0.12 rad back to the ground it turns the other way; farther from it, it tips."""
    about = np.array((0.0, 1.0, 0.0))
    landed = Foothold.whole(tipped(about, 0.12), UP, HALF)
    for angle in (0.1, 0.05, 0.0, -0.02):
        R = tipped(about, angle)
        assert landed.update(R, pressed_at((0.07, 0.0), R), WEIGHT) is landed
    for angle, way in ((0.16, 1.0), (-0.05, -1.0)):
        R = tipped(about, angle)
        known = landed.update(R, pressed_at((way * 0.07, 0.0), R), WEIGHT)
        assert way * known.nearest(*way * HALF)[0] == pytest.approx(0.07 - 0.1 * HALF[0])


def test_what_turns_little_or_bears_little_tells_nothing() -> None:
    flat, about = tipped(np.zeros(3), 0.0), np.array((0.0, 1.0, 0.0))
    stood = Foothold.whole(flat, UP, HALF)
    for angle, load in ((0.02, WEIGHT), (0.2, 0.05 * WEIGHT)):
        R = tipped(about, angle)
        assert stood.update(R, pressed_at((0.02, 0.0), R, load), WEIGHT) is stood
    R = turned(0.3) @ flat  # about the vertical
    assert stood.update(R, pressed_at((0.02, 0.0), R), WEIGHT) is stood


def test_something_is_left_of_a_sole_that_tips_all_ways() -> None:
    known = Foothold.whole(tipped(np.zeros(3), 0.0), UP, HALF)
    for about, point in (((0.0, 1.0, 0.0), (-0.06, 0.0)), ((0.0, -1.0, 0.0), (0.07, 0.0))):
        R = tipped(np.array(about), 0.1)
        known = known.update(R, pressed_at(point, R), WEIGHT)
    assert (known.lower <= known.upper).all()
    assert (known.lower >= -HALF).all() and (known.upper <= HALF).all()
