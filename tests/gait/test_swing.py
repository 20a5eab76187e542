"""The foot in the air: rates, changed goals, soft landings; soles that tip are pressed inwards."""

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
import pytest

from wbc.gait.foothold import Foothold
from wbc.gait.swing import FootPose, SwingFoot, SwingMotion, towards, turned, yaw_of
from wbc.rotations import upright_on
from wbc.validate import Array

DT = 0.002
MOST = 100.0  # m/s^2


def test_an_unchanged_goal_is_met_on_one_curve_of_least_jerk() -> None:
    goal, T = np.array((0.4, -0.1, 0.2)), 0.4
    now = SwingMotion.rest(np.zeros(3))
    for k in range(1, 186):  # until 0.03 s before the end
        now = towards(now, goal, T - (k - 1) * DT, DT)
        x = k * DT / T
        curve = goal * (10 * x**3 - 15 * x**4 + 6 * x**5)  # Flash and Hogan
        np.testing.assert_allclose(now.value, curve, atol=1e-9)


def test_a_foot_rises_as_fast_as_it_goes_ahead() -> None:
    """On a step of 0.35 m, lifted by 5.8 cm: a toe 1 cm before an edge is lifted over 9 mm."""
    foot = SwingFoot.lift_off(np.zeros(3), 0.0, np.array((0.0, 0.0, 1.0)), 0.058, 1.0, 0.2)
    ahead, heights = [], []
    for k in range(500):
        foot = foot.advance((0.35, 0.0, 0.0), 0.0, 1.0 - 1e-3 * k, 1e-3, MOST)
        x, _, z = foot.pose().position
        ahead.append(x)
        heights.append(z)
    assert np.interp(0.01, ahead, heights) > 9e-3


def test_a_foot_that_finds_no_ground_goes_on_down() -> None:
    poses, foot = flown([0.4 - k * DT for k in range(250)])
    assert foot.late > 0.09
    # At 0.2 m/s, which it took up at 6 m/s^2.
    way = 0.2 * foot.late - 0.5 * 0.2**2 / 6.0
    assert poses[-1].position[2] == pytest.approx(-way, abs=1e-3)
    assert min(pose.acceleration[2] for pose in poses[-50:]) > -10.0  # not at once
    assert poses[-1].rate[2] == pytest.approx(-0.2, abs=1e-3)
    assert yaw_of(poses[-1].rotation) == pytest.approx(0.1)


def flown(lefts: Iterable[float]) -> tuple[list[FootPose], SwingFoot]:
    """A foot with a usual time of 0.4 s, by the time left in each tick."""
    foot = SwingFoot.lift_off(np.zeros(3), 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.4, 0.2)
    poses = []
    for left in lefts:
        foot = foot.advance(np.array((0.2, 0.0, 0.1)), 0.0, left, DT, MOST)
        poses.append(foot.pose())
    return poses, foot


def test_a_foot_whose_plan_stays_is_on_its_lift() -> None:
    """From one height to the other on the smoothest way, and up and down between."""
    foot, T, poses = SwingFoot.lift_off(np.zeros(3), 0.02, np.eye(3)[2], 0.06, 0.4, 0.2), 0.4, []
    for k in range(200):
        foot = foot.advance((0.2, 0.0, 0.1), 0.05, T - k * DT, DT, MOST)
        poses.append(foot.pose())

    def height(t: Array) -> Array:
        s = t / T
        return 0.02 + 0.03 * s**3 * (10 - 15 * s + 6 * s**2) + 0.06 * (4 * s * (1 - s)) ** 2.5

    z, rate, acceleration = (
        np.array([getattr(one, name)[2] for one in poses])
        for name in ("position", "rate", "acceleration")
    )
    np.testing.assert_allclose(z, height(DT * np.arange(1, 201)), atol=1e-9)
    assert (rate[-1], acceleration[-1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    t, h, inner = DT * np.arange(6, 196), 1e-4, slice(5, 195)
    ahead, here, behind = height(t + h), height(t), height(t - h)
    np.testing.assert_allclose(rate[inner], (ahead - behind) / (2 * h), atol=1e-4)
    np.testing.assert_allclose(acceleration[inner], (ahead - 2 * here + behind) / h**2, atol=1e-2)


@pytest.mark.parametrize("at", [20, 60, 100, 150])
def test_a_foot_told_to_hurry_or_late_does_not_jump(at: int) -> None:
    """0.5 m/s from one tick to the next were 25 m/s^2 for what follows the foot at 60 1/s."""
    first = [0.4 - k * DT for k in range(at)]
    soon = 0.4 * first[-1]
    poses, foot = flown([*first, *(soon - k * DT for k in range(round(soon / DT) + 30))])
    assert foot.late > 0.05
    z, rates = (np.array([getattr(one, name)[2] for one in poses]) for name in ("position", "rate"))
    np.testing.assert_allclose(np.diff(z), 0.5 * DT * (rates[1:] + rates[:-1]), atol=1e-4)
    assert np.abs(np.diff(rates)).max() < 0.1


def test_a_foot_that_hurries_is_accelerated_upwards_as_in_a_usual_step() -> None:
    usual, hurried = (
        [one.acceleration[2] for one in flown(np.arange(T, 0.0, -DT))[0]] for T in (0.4, 0.18)
    )
    assert max(np.abs(hurried)) < 1.02 * max(np.abs(usual))


@pytest.mark.parametrize("turn", [0.0, 2.0])
@pytest.mark.parametrize("soon", [0.03, 0.05, 0.08])
def test_a_foot_whose_landing_is_put_off_does_not_pass_its_goal(soon: float, turn: float) -> None:
    """It went 0.35 m past it, across the standing foot, and came back."""
    goal, way = np.array((0.1, -0.3)), np.array((0.2, -0.3))  # the goal moves ahead, too
    R = np.array(((np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))))
    foot = SwingFoot.lift_off(np.zeros(3), 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.4, 0.2)
    poses = []
    for left in np.append(np.arange(0.15, soon, -DT), np.arange(0.45, 0.0, -DT)):
        place = R @ (goal if len(poses) < (0.15 - soon) / DT else way)
        foot = foot.advance((*place, 0.0), 0.0, left, DT, MOST)
        poses.append(foot.pose())
    places, rates, changes = (
        np.array([getattr(one, name)[:2] for one in poses]) @ R
        for name in ("position", "rate", "acceleration")
    )
    assert places[:, 1].min() > -0.3 - 0.03
    assert np.abs(changes).max() < 1.5 * MOST
    np.testing.assert_allclose(
        np.diff(places, axis=0), 0.5 * DT * (rates[1:] + rates[:-1]), atol=1e-4
    )
    np.testing.assert_allclose(places[-1], way, atol=1e-3)
    np.testing.assert_allclose(rates[-1], 0.0, atol=0.05)


def test_the_shorter_way_round() -> None:
    start = np.array((0.0, 0.0, 3.1))
    foot = SwingFoot.lift_off(start, 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.4, 0.2)
    foot = foot.advance(np.array((0.0, 0.0, -3.1)), 0.0, 0.03, 0.03, MOST)
    assert foot.numbers[2] == pytest.approx(2 * np.pi - 3.1)


def test_soles_are_laid_on_slopes() -> None:
    normal = np.array((-0.1, 0.05, 1.0)) / np.linalg.norm((-0.1, 0.05, 1.0))
    R = upright_on(normal) @ turned(0.7)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R[:, 2], normal, atol=1e-12)


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
def test_who_tips_over_an_edge_is_pressed_this_side_of_it(axis, sign, point) -> None:
    stood = Foothold.whole(tipped(np.zeros(3), 0.0)[:, 2], UP, HALF)
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
    known = Foothold.whole(tipped(np.zeros(3), 0.0)[:, 2], UP, HALF)
    for _ in range(20):
        known = known.update(R, pressed_at((HALF[0], 0.0), R), WEIGHT)
    np.testing.assert_allclose(known.upper, (0.9 * HALF[0], HALF[1]), atol=1e-12)
    np.testing.assert_array_equal(known.lower, -HALF)


def test_who_settles_from_a_tilted_landing_does_not_tip() -> None:
    """From 0.12 rad back to the ground it turns the other way; farther from it, it tips."""
    about = np.array((0.0, 1.0, 0.0))
    landed = Foothold.whole(tipped(about, 0.12)[:, 2], UP, HALF)
    for angle in (0.1, 0.05, 0.0, -0.02):
        R = tipped(about, angle)
        assert landed.update(R, pressed_at((0.07, 0.0), R), WEIGHT) is landed
    for angle, way in ((0.16, 1.0), (-0.05, -1.0)):
        R = tipped(about, angle)
        known = landed.update(R, pressed_at((way * 0.07, 0.0), R), WEIGHT)
        assert way * known.nearest(*way * HALF)[0] == pytest.approx(0.07 - 0.1 * HALF[0])


def test_what_turns_little_or_bears_little_tells_nothing() -> None:
    flat, about = tipped(np.zeros(3), 0.0), np.array((0.0, 1.0, 0.0))
    stood = Foothold.whole(flat[:, 2], UP, HALF)
    for angle, load in ((0.02, WEIGHT), (0.2, 0.05 * WEIGHT)):
        R = tipped(about, angle)
        assert stood.update(R, pressed_at((0.02, 0.0), R, load), WEIGHT) is stood
    R = turned(0.3) @ flat  # about the vertical
    assert stood.update(R, pressed_at((0.02, 0.0), R), WEIGHT) is stood


def test_something_is_left_of_a_sole_that_tips_all_ways() -> None:
    known = Foothold.whole(tipped(np.zeros(3), 0.0)[:, 2], UP, HALF)
    for about, point in (((0.0, 1.0, 0.0), (-0.06, 0.0)), ((0.0, -1.0, 0.0), (0.07, 0.0))):
        R = tipped(np.array(about), 0.1)
        known = known.update(R, pressed_at(point, R), WEIGHT)
    assert (known.lower <= known.upper).all()
    assert (known.lower >= -HALF).all() and (known.upper <= HALF).all()
