"""Where feet go: at the velocity commanded, and never across each other."""

import numpy as np
import pytest

from wbc.gait import CommandLimits, GaitSettings, Legs, Velocity
from wbc.gait.dcm import dcm_offsets, in_plane
from wbc.gait.foothold import Foothold
from wbc.gait.footsteps import SIGN, first_swing, nominal_offset, nominal_step, other
from wbc.gait.phases import DoubleSupport, GaitState, SingleSupport, Standing
from wbc.gait.reference import StepPlanner
from wbc.gait.swing import SwingFoot, turned
from wbc.robot import Robot
from wbc.validate import Array


def as_array(point: complex) -> Array:
    return np.array((point.real, point.imag))


@pytest.fixture
def legs(g1_27: Robot) -> Legs:
    return Legs.of(g1_27)


def planner_of(legs: Legs, gait: GaitSettings) -> StepPlanner:
    soles = dict.fromkeys(SIGN, np.array((0.08, 0.03)))
    return StepPlanner(gait, CommandLimits.of(legs, gait), legs, soles)


def on_one_foot(support: str, elapsed: float, left: float, goal: complex = 0j) -> SingleSupport:
    swing = SwingFoot.lift_off(np.zeros(3), 0.0, np.array((0.0, 0.0, 1.0)), 0.05, 0.4, 0.1)
    stands = Foothold.whole(np.eye(3)[2], np.eye(3)[2], np.array((0.08, 0.03)))
    return SingleSupport(support, swing, elapsed, left, goal, 0j, stands)


@pytest.mark.parametrize("velocity", [(0.5, 0.0, 0.0), (0.0, 0.2, 0.0), (-0.2, -0.1, 0.0)])
def test_the_middle_moves_at_the_velocity(legs: Legs, velocity: tuple[float, ...]) -> None:
    gait = GaitSettings.of(legs)
    way, foot = 0j, "left"
    for _ in range(10):  # pairs of steps: sideways the leading foot does it all
        way = way + nominal_step(gait, foot, 0.0, Velocity(*velocity))
        foot = other(foot)
    assert way == pytest.approx(10 * gait.times.total * complex(*velocity[:2]), abs=1e-12)


def test_turning_on_the_spot_keeps_the_middle(legs: Legs) -> None:
    gait, heading, foot = GaitSettings.of(legs), 0.0, "left"
    place = 0.5j * gait.width
    for _ in range(20):
        place = place + nominal_step(gait, foot, heading, Velocity(0.0, 0.0, 0.7))
        heading, foot = heading + 0.7 * gait.times.total, other(foot)
        beside = turned(heading)[:2, :2] @ (0.0, 0.5 * SIGN[foot] * gait.width)
        assert place == pytest.approx(complex(*beside), abs=1e-12)


@pytest.mark.parametrize("speed", [0.5, 1.2])
def test_a_foot_lands_early_on_its_usual_way_and_not_far_from_a_goal_that_moved(
    legs: Legs, speed: float
) -> None:
    """A fast one had to come within 0.1 m first: a G1 on boards of 4 cm was slowed down so."""
    gait, velocity, dt = GaitSettings.of(legs), Velocity(speed), 0.002
    planner, goal = planner_of(legs, gait), 2.0 * speed * gait.times.total + 0j
    phase = on_one_foot("left", 0.0, gait.single, goal)
    for left in np.arange(gait.single, 0.29 * gait.single, -dt):
        swing = phase.swing.advance((goal.real, goal.imag, 0.0), 0.0, left, dt, 100.0)
        phase = phase._replace(swing=swing, left=left - dt)
    assert planner.has_landed(phase, 0.2, velocity) and not planner.has_landed(phase, 0.0, velocity)
    assert not planner.has_landed(phase._replace(goal=goal + 0.2j), 0.2, velocity)


@pytest.mark.parametrize("foot", ["left", "right"])
@pytest.mark.parametrize("velocity", [(0.5, 0.0, 0.0), (0.2, -0.1, 0.7), (-0.3, 0.2, -0.4)])
def test_the_offset_is_that_of_many_steps_ahead(legs, foot, velocity) -> None:
    gait, steps, here, heading = GaitSettings.of(legs), list[complex](), foot, 0.3
    for _ in range(30):  # 1e-24 of the first is what comes after them
        steps.append(nominal_step(gait, here, heading, Velocity(*velocity)))
        here, heading = other(here), heading + velocity[2] * gait.times.total
    expected = dcm_offsets(steps, gait.times, gait.omega)[0]
    found = nominal_offset(gait, foot, 0.3, Velocity(*velocity))
    assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("elapsed", [0.0, 0.1])
def test_a_steady_turn_that_faces_where_it_goes_is_left_alone(legs: Legs, elapsed: float) -> None:
    """Half way through a single support the robot is over its foot, and faces as that does.

    Steps were those of its lift-off: the robot went aside, to the outside of its turn.
    """
    gait, velocity = GaitSettings.of(legs), Velocity(0.4, 0.1, 0.6)
    planner, rate, T = planner_of(legs, gait), velocity.yaw_rate, gait.times.total
    steps = [
        nominal_step(gait, ("left", "right")[k % 2], rate * k * T, velocity) for k in range(30)
    ]
    first, second, *_ = dcm_offsets(steps, gait.times, gait.omega)
    places = {"left": np.zeros(3), "right": np.append(as_array(steps[0]), 0.0)}
    now = GaitState(first * np.exp(gait.omega * elapsed), places, dict.fromkeys(SIGN, np.eye(3)))
    phase, heading = on_one_foot("left", elapsed, gait.single - elapsed), rate * elapsed
    after = planner.adapt(phase, now, heading - 0.5 * rate * gait.single, velocity)
    assert after.goal == pytest.approx(steps[0], abs=1e-6)
    assert after.offset == pytest.approx(second, abs=1e-9)
    assert after.left == pytest.approx(gait.single - elapsed, abs=1e-6)
    lands = planner.landing_pose(after, now, heading - 0.5 * rate * gait.single, velocity)
    assert lands[2] == pytest.approx(rate * T)
    # Where a turn is reversed feet were up to 0.8 rad apart.
    lands = planner.landing_pose(after, now, heading, velocity._replace(yaw_rate=-3.0))
    assert lands[2] == pytest.approx(-planner.limits.turn)


def test_the_leading_foot_begins() -> None:
    assert first_swing(Velocity(0.0, 0.2, 0.0)) == "left"
    assert first_swing(Velocity(0.3, -0.1, 1.0)) == "right"
    assert first_swing(Velocity(0.0, 0.0, 0.5)) == "left"
    assert first_swing(Velocity(0.3)) == "right"


@pytest.mark.parametrize("seed", range(5))
def test_feet_never_cross_whatever_is_commanded_and_measured(legs: Legs, seed: int) -> None:
    rng = np.random.default_rng(seed)
    gait = GaitSettings.of(legs)
    limits = CommandLimits.of(legs, gait)
    planner = planner_of(legs, gait)
    for _ in range(60):
        support = str(rng.choice(["left", "right"]))
        velocity = limits.admit(*rng.normal(scale=(1.0, 1.0, 2.0))).velocity
        heading = float(rng.uniform(-3.0, 3.0))
        places = {foot: np.array((*rng.normal(size=2), 0.0)) for foot in SIGN}
        dcm = places[support][:2] + rng.normal(scale=0.3, size=2)
        now = GaitState(complex(*dcm), places, dict.fromkeys(SIGN, np.eye(3)))
        elapsed = float(rng.uniform(0.0, 0.9 * gait.single))
        phase = on_one_foot(support, elapsed, gait.single - elapsed)
        after = planner.adapt(phase, now, heading, velocity)
        if after is phase:  # too late to change it
            assert phase.left <= 0.15 / gait.omega
            continue
        step = turned(-heading)[:2, :2] @ (as_array(after.goal) - places[support][:2])
        beside = SIGN[other(support)] * step[1]
        assert gait.least_width - 1e-7 <= beside <= limits.catch_aside + 1e-7
        assert abs(step[0]) <= limits.catch + 1e-7
        kept = set(phase._fields) - {"left", "goal", "offset", "multipliers"}
        assert all(getattr(after, name) is getattr(phase, name) for name in kept)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_no_step_catches_is_pressed_against_with_all_of_the_sole(legs, side) -> None:
    """A DCM that no step catches does not take the pressure back to the middle of the sole."""
    gait = GaitSettings.of(legs)
    planner = planner_of(legs, gait)
    places = {"left": np.zeros(3), "right": np.array((0.0, -gait.width, 0.0))}
    dcm = side * planner.limits.catch_aside * 1j
    now = GaitState(dcm, places, dict.fromkeys(SIGN, np.eye(3)))
    phase = planner.adapt(on_one_foot("left", 0.0, gait.single), now, 0.0, Velocity())
    reference = planner.single_support(phase, now)
    vrp = reference.vrp + (1.0 + gait.gain) * (now.dcm - reference.dcm)
    assert side * vrp.imag > planner.soles["left"][1]


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_the_com_sinks_to_where_the_leg_behind_reaches_the_ground(legs, heading) -> None:
    gait = GaitSettings.of(legs)
    planner, R = planner_of(legs, gait), turned(heading)
    measured = [
        GaitState(0j, {"left": R @ (0.3, y, 0.0), "right": np.zeros(3)}, {})
        for y in (gait.width, 0.5)
    ]
    here = Standing()
    assert planner.height_reduction(here, measured[0], heading) == 0.0
    sunk = planner.height_reduction(here, measured[1], heading)
    # The pelvis over the right foot and half of the way ahead: the left hip is to the left of it,
    # the ankle farther.
    hip = legs.hip_height + gait.height - sunk - legs.com_height
    way = (hip, 0.5 - legs.width, 0.15)
    assert np.linalg.norm(way) == pytest.approx(0.98 * legs.length)
    assert sunk > 0.0
    # A foot that is still on its way there counts, and one that comes back from there.
    coming = on_one_foot("right", 0.1, 0.1, in_plane(R @ (0.3, 0.5, 0.0)))
    assert planner.height_reduction(coming, measured[0], heading) == pytest.approx(sunk)
    assert planner.height_reduction(
        on_one_foot("right", 0.1, 0.1), measured[1], heading
    ) == pytest.approx(sunk)


def test_the_com_sinks_for_a_step_that_is_longer_than_in_a_walk(legs: Legs) -> None:
    gait = GaitSettings.of(legs)
    planner = planner_of(legs, gait)
    walking, catching = planner.limits.step, planner.limits.catch
    assert catching > 1.1 * walking
    places = {"left": np.array((0.0, legs.width, 0.0)), "right": np.zeros(3)}
    now = GaitState(0j, places, {})
    sunk = [
        planner.height_reduction(on_one_foot("right", 0.1, 0.1, complex(far, legs.width)), now, 0.0)
        for far in (walking - 1e-9, catching)
    ]
    assert sunk[0] == 0.0
    hip = legs.hip_height + gait.height - legs.com_height
    assert sunk[1] == pytest.approx(0.03 * hip)


def still(dcm: complex) -> GaitState:
    return GaitState(dcm, dict.fromkeys(SIGN, np.zeros(3)), {})


@pytest.mark.parametrize("aside", [0.0, 0.5, 2.0])
def test_a_foot_that_lands_early_waits_until_the_dcm_is_nearest(legs: Legs, aside: float) -> None:
    """Of a DCM that is pushed aside, or goes back, by a search over times."""
    gait = GaitSettings.of(legs)
    planner, phase = planner_of(legs, gait), on_one_foot("left", 0.3, 0.2, 0.3 - 0.2j)
    wanted = planner.single_support(phase._replace(left=0.0), still(0.0)).dcm
    for part in (0.8, 0.5, -0.3):
        dcm = wanted * (part + 1j * part * aside)
        times = np.linspace(0.0, phase.left, 20001)
        nearest = times[np.argmin(np.abs(dcm * np.exp(gait.omega * times) - wanted))]
        found = planner.double_time(phase, still(dcm))
        assert found == pytest.approx(gait.double + nearest, abs=2e-5)
        hurried = phase._replace(elapsed=0.1)
        assert planner.double_time(hurried, still(dcm)) == gait.double
        assert planner.double_time(phase._replace(left=-0.02), still(dcm)) == gait.double


def test_between_two_feet_the_pressure_is_wanted_where_they_are(legs: Legs) -> None:
    """A push outwards over the left foot, as the right one lands and then bears alone."""
    gait = GaitSettings.of(legs)
    places = {"left": np.array((0.0, 0.2, 0.0)), "right": np.array((0.3, 0.0, 0.0))}
    now = GaitState(0j, places, dict.fromkeys(SIGN, np.eye(3)))
    planner, far = planner_of(legs, gait), np.array((0.0, 0.8))

    def within(vrp: Array, left: float, unloading: bool = False) -> Array:
        phase = DoubleSupport("right", 0j, gait.double, left, unloading=unloading)
        return as_array(planner.project_onto_support(phase, complex(*vrp), now))

    np.testing.assert_allclose(within(far, gait.double), (0.0, 0.23), atol=1e-12)
    np.testing.assert_allclose(within(far, gait.ramp, True), (0.0, 0.23), atol=1e-12)
    half = within(far, 0.5 * gait.ramp, True)  # the left foot bears half at most
    np.testing.assert_allclose(half[1], 0.115, atol=1e-12)
    np.testing.assert_allclose(within(far, 0.0, True), (0.22, 0.03), atol=1e-12)
    for part in (1.0, 0.7, 0.5):  # of a walk that nothing disturbs nothing is changed
        vrp = (1.0 - part) * places["right"][:2] + part * places["left"][:2]
        left = part * gait.double
        np.testing.assert_allclose(within(vrp, left, part <= 0.5), vrp, atol=1e-12)
