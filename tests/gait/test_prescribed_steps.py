"""Footsteps that are given: what can be made of them, the DCM between, and where feet land."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import Footstep, GaitSettings, Legs, Walker
from wbc.gait.footsteps import SIGN, other
from wbc.gait.phases import DoubleSupport, SingleSupport, Standing, sole_poses
from wbc.gait.prescribed_steps import Landing, in_world, prescribed_dcm_offsets, velocity_for
from wbc.gait.step_range import StepRange
from wbc.polygon import polygon_margin
from wbc.robot import Robot
from wbc.simulation import FallLimits, FallWatch, Plant
from wbc.validate import Array


@pytest.fixture
def able(g1_27: Robot) -> StepRange:
    legs = Legs.of(g1_27)
    return StepRange.of(g1_27, GaitSettings.of(legs), legs)


@pytest.fixture
def feet(able: StepRange) -> dict[str, Array]:
    half = 0.5 * able.gait.width
    return {"left": np.array((0.0, half, 0.0, 0.0)), "right": np.array((0.0, -half, 0.0, 0.0))}


def ahead(able: StepRange, count: int, x: float = 0.2, **other: Any) -> list[Footstep]:
    width = able.gait.width
    sides = [("right", -width), ("left", width)] * count
    return [Footstep(foot, x, y, **other) for foot, y in sides[:count]]


def test_relative_footsteps_are_seen_from_the_one_before(feet: dict[str, Array]) -> None:
    """By complex numbers: a turn is a factor."""
    steps = [Footstep("left", 0.1, 0.3, 0.5), Footstep("right", 0.2, -0.25, -0.2)]
    steps.append(Footstep("left", 0.0, 0.3, 0.4))
    place, yaw = complex(*feet["right"][:2]), 0.0
    for step, made in zip(steps, in_world(steps, feet), strict=True):
        place += complex(step.x, step.y) * complex(math.cos(yaw), math.sin(yaw))
        yaw += step.yaw
        np.testing.assert_allclose(made.pose(0.0), (place.real, place.imag, yaw, 0.0), atol=1e-12)
        assert made.foot == step.foot


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_dcm_comes_to_rest_between_the_feet(able: StepRange, count: int) -> None:
    """By integrating xi' = omega (xi - r) forwards, over steps of different durations."""
    gait, base = able.gait, np.array((0.3, -0.1))
    rng = np.random.default_rng(count)
    places = np.cumsum(rng.normal(scale=0.2, size=(count, 2)), axis=0) + base
    times = rng.uniform(0.8, 1.4, size=count) * gait.single
    steps = [
        Footstep("right" if k % 2 else "left", *place, duration=float(time))
        for k, (place, time) in enumerate(zip(places.tolist(), times, strict=True))
    ]
    offsets = [
        np.array((b.real, b.imag)) for b in prescribed_dcm_offsets(complex(*base), steps, gait)
    ]
    points = [base, *places]
    # Where the VRP begins and ends, and how long it takes: on one foot, and to the next one.
    ways = [(points[0], points[0], times[0])]
    for (a, b), time in zip(pairwise(points[:-1]), times[1:], strict=True):
        ways += [(a, b, gait.double), (b, b, float(time))]
    ways.append((points[-2], 0.5 * (points[-2] + points[-1]), 1.2 / gait.omega))
    xi = base + offsets[0]
    for k, (a, b, T) in enumerate(ways):
        found = solve_ivp(
            lambda t, x, a=a, b=b, T=T: gait.omega * (x - a - t / T * (b - a)),
            (0.0, T), xi, rtol=1e-12, atol=1e-14,
        )  # fmt: skip
        xi = found.y[:, -1]
        if k == 1 and count > 1:  # the first footstep alone begins to bear
            np.testing.assert_allclose(xi, places[0] + offsets[1], atol=1e-9)
    # errors of the integration have grown by exp(omega T), some 1e3
    np.testing.assert_allclose(xi, 0.5 * (points[-2] + points[-1]), atol=1e-7)


def test_only_so_many_steps_count_as_matter(able: StepRange) -> None:
    steps = in_world(ahead(able, 12), {"left": np.zeros(4), "right": np.zeros(4)})
    near, all_of_them = (prescribed_dcm_offsets(0j, some, able.gait) for some in (steps[:8], steps))
    assert near == all_of_them


BAD = {
    "ahead": ({"x": 0.9}, "right), x: 0.9 m ahead of the left foot is out of reach of the legs"),
    "behind": ({"x": -0.9}, "x: -0.9 m ahead of the left foot is out of reach"),
    "aside": ({"y": -1.0}, "y: 1 m beside the left foot is out of reach of the legs"),
    "both": ({"x": 0.45, "y": -0.55}, "as far beside it as this is"),
    "across": ({"y": 0.1}, "y: -0.1 m beside the left foot, on its own side, is across it"),
    "near": ({"y": -0.03}, "y: 0.03 m beside the left foot, on its own side, is too near"),
    "turned": ({"yaw": 0.6}, "yaw: 0.6 rad from the left foot is out of reach of the hips"),
    "short": ({"duration": 0.1}, "duration: 0.1 s on one foot; 0."),
    "long": ({"duration": 9.0}, "duration: 9 s on one foot; 0."),
}


@pytest.mark.parametrize(("change", "said"), BAD.values(), ids=BAD)
def test_what_legs_cannot_do_is_refused(able, feet, change, said) -> None:
    step = Footstep(**{"foot": "right", "x": 0.1, "y": -able.gait.width, **change})
    with pytest.raises(InvalidInputError) as refused:
        able.admitted([step], feet, relative=True)
    assert str(refused.value).startswith("footstep 1 (")
    assert said in str(refused.value)
    good = Footstep("right", 0.1, -able.gait.width)
    assert len(able.admitted([good], feet, relative=True)) == 1


GROUNDS = {
    "no function": (0.0, "ground: expected a function of points .k, 2. that returns heights"),
    "one number": (lambda points: 0.1, "ground, at k points: expected shape"),
    "NaN": (lambda points: points[:, 0] * math.nan, "ground, at k points: NaN"),
    "elsewhere": (lambda points: 0.3 + 0.0 * points[:, 0], "z: 0 m in the world, but the ground"),
}


@pytest.mark.parametrize(("ground", "said"), GROUNDS.values(), ids=GROUNDS)
def test_ground_that_is_none_or_not_where_a_footstep_is_is_refused(
    able: StepRange, feet: dict[str, Array], ground: Any, said: str
) -> None:
    step = Footstep("right", 0.1, -able.gait.width, z=0.0)
    with pytest.raises(InvalidInputError, match=said):
        able.admitted([step], feet, relative=True, ground=ground)


def test_the_range_that_is_told_is_the_range(able: StepRange, feet: dict[str, Array]) -> None:
    far, apart, near = able.limits.step, able.limits.apart, able.gait.least_width
    slow = {"duration": 2.0}  # in a gait's time hips do not go so far
    for x, y in ((far, able.gait.width), (-far, near), (0.0, apart)):
        able.admitted([Footstep("left", x, y, **slow)], feet, relative=True)
        for more in ((1e-3 * np.sign(x), 0.0), (0.0, 1e-3 * np.sign(y - 0.5 * apart))):
            if any(np.array(more) * (x, y - able.gait.width)):
                step = Footstep("left", x + more[0], y + more[1], **slow)
                with pytest.raises(InvalidInputError):
                    able.admitted([step], feet, relative=True)


def test_a_foot_is_not_carried_faster_than_hips_can(able, feet) -> None:
    """Peak rates of the minimum-jerk way, sampled, less what the pelvis does of it."""
    steps = ahead(able, 2, x=0.4, duration=0.25)
    with pytest.raises(InvalidInputError, match=r"footstep 2 .*, duration: the foot goes") as error:
        able.admitted(steps, feet, relative=True)
    words = str(error.value).split()
    most = float(words[words.index("most") + 1])
    T, total = 0.25, 0.25 + able.gait.double
    s = np.linspace(0.0, 1.0, 100001)
    curve = 10 * s**3 - 15 * s**4 + 6 * s**5
    rate = np.gradient(curve, s).max() * most / T - 0.5 * most / total
    acceleration = np.gradient(np.gradient(curve, s), s).max() * most / T**2
    uses = (rate / able.legs.swing_speed, acceleration / able.legs.swing_acceleration)
    assert max(uses) == pytest.approx(1.0, rel=5e-3)  # three digits are told


@pytest.mark.parametrize("seed", range(3))
def test_soles_do_not_lie_on_each_other(able: StepRange, seed: int) -> None:
    """By points of one sole that are inside the other."""
    rng = np.random.default_rng(seed)
    a, b = able.corners["right"], able.corners["left"]
    weights = rng.dirichlet(np.full(len(a), 0.5), size=4000)
    judged = {True: 0, False: 0}
    for _ in range(40):
        step = Footstep("right", *rng.uniform(-0.2, 0.2, size=2), rng.uniform(-1.5, 1.5))
        c, s = math.cos(step.yaw), math.sin(step.yaw)
        points = weights @ a @ np.array(((c, s), (-s, c))) + (step.x, step.y)
        deepest = polygon_margin(b, points).max()
        found = able._overlap("right", step)
        if deepest > 0.0 or deepest < -0.01:  # between, points are too few to say
            assert found == (deepest > 0.0), step
            judged[found] += 1
    assert min(judged.values()) > 5


def test_feet_take_turns(able: StepRange, feet: dict[str, Array]) -> None:
    twice = [Footstep("right", 0.1, -0.2), Footstep("right", 0.2, -0.2)]
    with pytest.raises(InvalidInputError, match=r"footstep 2 .*has just landed; it must be left"):
        able.admitted(twice, feet)
    with pytest.raises(InvalidInputError, match=r"footstep 1 .*stands next; it must be left"):
        able.admitted(twice[:1], feet, first="left")
    with pytest.raises(InvalidInputError, match="none are given"):
        able.admitted([], feet)


def test_feet_that_are_edges_walk_on_footsteps(hoap2: Robot) -> None:
    """Each was refused: an edge has no inside that the other foot could be over."""
    edge = [[0.05, 0.0], [-0.05, 0.0]]
    feet = {
        side: {"link": foot.link, "polygon": edge, "height": 0.02}
        for side, foot in hoap2.feet.items()
    }
    robot = Robot.load("hoap2_like", feet=feet)
    legs, here = Legs.of(robot), robot.posture("standing")
    able = StepRange.of(robot, GaitSettings.of(legs), legs)
    stands = sole_poses(robot.snapshot(here))
    assert able.admitted([Footstep("left", 0.02, 0.08)], stands, relative=True)
    assert able._overlap("left", Footstep("left", 0.0, 0.02, yaw=0.5))
    assert not able._overlap("left", Footstep("left", 0.0, 0.03, yaw=0.5))


@pytest.mark.parametrize("given", ["left", 3, None, [(0.1, 0.2)], ["left"]])
def test_what_are_no_footsteps_is_refused(able, feet, given) -> None:
    with pytest.raises(InvalidInputError, match="footsteps: expected"):
        able.admitted(given, feet)


def test_bad_values_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'left'"):
        Footstep("lefd", 0.0, 0.0)
    with pytest.raises(InvalidInputError, match="footstep, x"):
        Footstep("left", math.nan, 0.0)
    with pytest.raises(InvalidInputError, match="footstep, duration: must be greater than 0"):
        Footstep("left", 0.0, 0.0, duration=0.0)


def test_landings_and_velocity(able: StepRange) -> None:
    step = Footstep("left", 1.0, 2.0, 3.1)
    landing = Landing.of(step, np.array((1.03, 1.96, -3.1, 0.2)))
    assert landing.distance == pytest.approx(0.05) and landing.height == 0.0
    assert landing.turn == pytest.approx(math.tau - 6.2)
    high = Footstep("left", 1.0, 2.0, z=0.25)
    assert Landing.of(high, np.array((1.0, 2.0, 0.0, 0.2))).height == pytest.approx(-0.05)
    gait = able.gait
    ahead = Footstep("left", 0.2, gait.width, 0.2)
    velocity = velocity_for(np.zeros(3), ahead, 0.0, 0.5, gait)
    np.testing.assert_allclose(velocity, (0.2 / gait.times.total, 0.0, 0.2), atol=1e-12)


def simulated(walker: Walker, plant: Plant, steps: int) -> None:
    """Walk until the robot has made ``steps`` more and stands, and half a second."""
    watch, steps = FallWatch(plant, FallLimits()), walker.steps + steps
    still = 0.0
    while still < 0.5:
        tick = walker.step(plant.snapshot(), plant.contact_forces)
        plant.step(tick.torque)
        assert watch.verdict().stood and plant.time < 30.0
        ended = isinstance(walker.phase, Standing) and walker.steps >= steps
        still = still + walker.dt if ended else 0.0


def really(plant: Plant) -> dict[str, Array]:
    return sole_poses(plant.robot.snapshot(*plant.state()))


@pytest.mark.slow
def test_feet_land_where_they_should(hoap2: Robot) -> None:
    """By the simulation's own state; 1.8 mm at most was measured."""
    walker, plant = Walker(hoap2), Plant(hoap2)
    w = walker.gait.width
    steps = [
        Footstep("right", 0.03, -w),
        Footstep("left", 0.04, 1.2 * w, 0.2),
        Footstep("right", 0.04, -w, 0.1, duration=0.6),
        Footstep("left", 0.04, w),
    ]
    world = walker.follow(steps, plant.snapshot(), relative=True)
    assert world == in_world(steps, sole_poses(plant.snapshot()))
    simulated(walker, plant, 4)
    for step in world[-2:]:
        apart = really(plant)[step.foot] - step.pose(0.0)
        assert np.linalg.norm(apart[:2]) < 3e-3 and abs(apart[2]) < 0.01
    assert [landing.footstep for landing in walker.landings] == list(world)
    assert max(landing.distance for landing in walker.landings) < 3e-3
    assert walker.steps == 4 and walker.coming == ()
    np.testing.assert_allclose(plant.com[:2], sum(really(plant).values())[:2] / 2, atol=5e-3)
    assert abs(walker.heading - 0.3) < 0.05


@pytest.mark.slow
def test_after_a_push_feet_come_back_to_their_footsteps(hoap2: Robot) -> None:
    """1.8 N s on 7 kg: one foot lands 20 mm away, all others within 0.4 mm."""
    walker, plant = Walker(hoap2), Plant(hoap2)
    w = walker.gait.width
    sides = [("right", -w), ("left", w)] * 3
    steps = [Footstep(foot, 0.04, y) for foot, y in sides]
    world = walker.follow(steps, plant.snapshot(), relative=True)
    plant.push("base", (0.0, 18.0, 0.0), start=1.05, duration=0.1)
    simulated(walker, plant, len(steps))
    away = [landing.distance for landing in walker.landings]
    assert away[3] > 10e-3 and max(away[:3] + away[4:]) < 2e-3
    for step in world[-2:]:
        assert np.linalg.norm(really(plant)[step.foot][:2] - step.place) < 5e-3


@pytest.mark.slow
def test_footsteps_after_a_command_and_before_one(hoap2: Robot) -> None:
    walker, plant = Walker(hoap2), Plant(hoap2)
    w = walker.gait.width
    walker.command(0.1)
    while walker.steps < 3 or not isinstance(walker.phase, SingleSupport):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    bears = walker.phase.support
    sides = {"left": w, "right": -w}
    swings = "left" if bears == "right" else "right"
    with pytest.raises(InvalidInputError, match=f"must be {bears}"):
        walker.follow([Footstep(swings, 0.0, sides[swings])], plant.snapshot(), relative=True)
    order = [bears, swings, bears, swings]
    steps = [Footstep(foot, 0.03, sides[foot]) for foot in order]
    world = walker.follow(steps, plant.snapshot(), relative=True)
    simulated(walker, plant, 5)
    for step in world[-2:]:
        assert np.linalg.norm(really(plant)[step.foot][:2] - step.place) < 5e-3
    # A command takes the place of what is left.
    walker.follow(steps, plant.snapshot(), relative=True)
    made = walker.steps
    while walker.steps < made + 1:
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    assert isinstance(walker.phase, DoubleSupport) and len(walker.coming) == 3
    walker.command(0.0)
    assert walker.coming == ()
    simulated(walker, plant, 1)
    assert walker.steps <= made + 3


@pytest.mark.slow
def test_a_stop_before_the_last_of_long_footsteps_takes_further_steps(g1_27: Robot) -> None:
    """The DCM is on its way to the next one: a G1 that halted all the same fell on its face."""
    walker, plant = Walker(g1_27), Plant(g1_27)
    far, w = 0.7 * walker.limits.step, walker.gait.width
    sides = [("right", -w), ("left", w)] * 3
    steps = [Footstep(foot, 0.5 * far if k == 0 else far, y) for k, (foot, y) in enumerate(sides)]
    walker.follow(steps, plant.snapshot(), relative=True)
    while not isinstance(walker.phase, SingleSupport):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    walker.command(0.0)
    for _ in range(1500):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    assert isinstance(walker.phase, Standing)
    assert plant.com[2] > 0.95 * walker.gait.height


@pytest.mark.slow
def test_a_push_on_the_last_footstep_takes_further_steps(g1_27: Robot) -> None:
    """10 N s on 33 kg: the robot halted on its last footstep all the same, and fell."""
    walker, plant = Walker(g1_27), Plant(g1_27)
    w = walker.gait.width
    sides = [("right", -w), ("left", w)] * 2
    walker.follow([Footstep(foot, 0.2, y) for foot, y in sides], plant.snapshot(), relative=True)
    while not (walker.steps == 3 and isinstance(walker.phase, SingleSupport)):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
    plant.push("torso_link", (0.0, -100.0, 0.0), start=plant.time + 0.15, duration=0.1)
    simulated(walker, plant, 2)
    assert len(walker.landings) == 4


@pytest.mark.slow
def test_footsteps_are_relative_to_where_the_foot_in_the_air_lands(hoap2: Robot) -> None:
    """It slowed down in the air, after its place was told: a G1 at 0.8 m/s was 7 cm off."""
    walker, plant = Walker(hoap2, dt=0.002), Plant(hoap2, dt=0.002)
    walker.command(0.15, 0.0, 0.8)

    def step() -> None:
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)

    while not (walker.steps > 1 and isinstance(walker.phase, SingleSupport)):
        step()
    foot, made = walker.phase.support, walker.steps
    beside = SIGN[foot] * walker.gait.width
    (wanted,) = walker.follow([Footstep(foot, 0.02, beside)], plant.snapshot(), relative=True)
    while walker.steps == made:
        step()
    landed = sole_poses(plant.snapshot())[other(foot)]
    seen = wanted.seen_from(landed)
    assert abs(seen.yaw) < 0.02 and math.hypot(seen.x - 0.02, seen.y - beside) < 3e-3
