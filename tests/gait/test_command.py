"""Commands: brought to what legs can do, followed no faster than asked; schedules and paces."""

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wbc.constraints import Limits
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import CommandLimits, GaitSettings, Legs, Velocity, Walker, WalkingWeights
from wbc.gait.pace import Paces
from wbc.gait.phases import Standing
from wbc.gait.reference import StepPlanner, sole_half_sizes
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand, describe_way
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.run.supervisor import BEFORE_START
from wbc.simulation import FallLimits, FallWatch, Plant

Load = Callable[[str], Robot]


@pytest.fixture(params=["g1_27", "hoap2_like", "talos", "icub", "romeo"])
def legs(request: pytest.FixtureRequest, robot_named: Load) -> Legs:
    return Legs.of(robot_named(request.param))


def test_what_is_asked_beyond_the_limits_keeps_its_direction(legs: Legs) -> None:
    limits = CommandLimits.of(legs, GaitSettings.of(legs))
    for angle in np.linspace(0.0, 2.0 * math.pi, 13):
        vx, vy = 5.0 * math.cos(angle), 5.0 * math.sin(angle)
        admitted, reason = limits.admit(vx, vy, 0.0)
        assert "beyond" in reason and f"{limits.forwards:.3g}" in reason
        assert math.hypot(admitted.vx / limits.forwards, admitted.vy / limits.sideways) <= 1 + 1e-9
        assert vx * admitted.vy == pytest.approx(vy * admitted.vx, abs=1e-9)
    inside = limits.admit(0.3 * limits.forwards, 0.3 * limits.sideways, 0.5 * limits.turning)
    assert not inside.reason and inside.velocity.vx == 0.3 * limits.forwards


def test_a_step_aside_that_catches_is_as_wide_as_both_legs_reach(legs: Legs) -> None:
    """From a pelvis half way both ankles are a leg's length from their hips, within stretching."""
    gait = GaitSettings.of(legs)
    limits = CommandLimits.of(legs, gait)
    hip = legs.hip_height + gait.height - legs.com_height
    beside = 0.5 * (limits.catch_aside - legs.width)
    if limits.catch_aside > limits.apart:
        assert math.hypot(hip, beside) == pytest.approx(0.98 * legs.length)
    else:  # feet that walk far apart
        assert limits.catch_aside == limits.apart


@pytest.mark.parametrize("part", [0.5, 0.3])
def test_a_part_of_the_torques_is_that_of_a_robot_with_no_more(g1: Robot, part: float) -> None:
    efforts = dict(zip(g1.joint_names, (part * g1.limits.effort).tolist(), strict=True))
    weak, held = Walker(Robot.load("g1", effort=efforts)), Walker(g1, torque_limits=part)
    assert held.limits == weak.limits and held.gait == weak.gait
    assert held.limits != Walker(g1).limits


def test_feet_turn_no_farther_than_the_limits_of_their_hips(robot_named: Load) -> None:
    """Four fifths of what a margin leaves of the narrower side, if it leaves anything."""
    robot = robot_named("talos")
    turn = [Legs.of(robot, Limits(robot, margin=margin)).turn for margin in (0.0, 0.1, 0.4)]
    assert turn[0] == Legs.of(robot).turn > 0.2
    assert turn[1] == pytest.approx(turn[0] - 0.08) and turn[2] == 0.0


def test_the_height_for_a_reach_is_the_inverse_of_the_reach(legs: Legs) -> None:
    reach = legs.reach(legs.com_height)
    assert legs.com_height_for(reach) == pytest.approx(legs.com_height)
    assert legs.com_height_for(9.0) == pytest.approx(legs.com_height - legs.hip_height)


def test_the_reach_of_a_leg_is_that_of_its_links(hoap2: Robot) -> None:
    """hoap2_like is drawn with thigh and shank of 0.1 m each (docs: published dimensions)."""
    legs = Legs.of(hoap2)
    assert legs.length == pytest.approx(0.2, abs=1e-3)
    assert legs.width == pytest.approx(0.078)


def test_weak_knees_walk_on_straighter_legs(g1_27: Robot, robot_named: Load) -> None:
    """Romeo's thigh and shank are equally long: its knee bears W l/2 sin(q/2) at l cos(q/2)."""
    robot = robot_named("romeo")
    legs, knee = Legs.of(robot), robot.limits.names.index("LKneePitch")
    half = math.asin(0.8 * robot.limits.effort[knee] / (robot.weight * legs.length / 2.0))
    least = legs.length * math.cos(half)
    assert least <= legs.bearing_length <= least + 0.01  # the knee is looked at every few degrees
    hip = legs.hip_height + GaitSettings.of(legs).height - legs.com_height
    assert hip == pytest.approx(legs.bearing_length) and hip > legs.hip_height
    strong = Legs.of(g1_27)
    assert strong.bearing_length < 0.5 * strong.length


def test_slow_hips_turn_slowly(robot_named: Load) -> None:
    legs = Legs.of(robot_named("romeo"))
    limits = CommandLimits.of(legs, GaitSettings.of(legs))
    admitted = limits.admit(0.0, 0.0, -0.5)
    assert "rad/s is beyond the speed at which hips turn" in admitted.reason
    assert admitted.velocity.yaw_rate == pytest.approx(-0.08, abs=0.01)  # 0.32 rad/s in the URDF


def test_a_walker_says_what_it_cannot_do(hoap2: Robot, caplog: pytest.LogCaptureFixture) -> None:
    walker = Walker(hoap2)
    with caplog.at_level(logging.WARNING):
        admitted = walker.command(3.0)
    assert walker.wanted == admitted.velocity and walker.wanted.vx < 1.0
    assert admitted.reason in caplog.text


def test_velocities_follow_in_small_steps() -> None:
    now, goal = Velocity(), Velocity(0.3, -0.4, 1.0)
    for _ in range(7):
        before, now = now, now.towards(goal, 0.1, 0.2)
        assert math.hypot(now.vx - before.vx, now.vy - before.vy) <= 0.1 + 1e-12
        assert abs(now.yaw_rate - before.yaw_rate) <= 0.2 + 1e-12
    assert now == goal
    assert now.towards(Velocity(), 9.0, 9.0).at_rest


@pytest.mark.parametrize("bad", [(math.nan, 0, 0), (0, math.inf, 0), (0, 0, "fast")])
def test_commands_are_numbers(hoap2: Robot, bad: tuple[float, float, float]) -> None:
    walker = Walker(hoap2)
    with pytest.raises(InvalidInputError, match="walking command, "):
        walker.command(*bad)


BAD = {
    "no period": ({"single": 0.0}, "gait, single: must be greater than 0, got 0"),
    "no double support": ({"double": 0.0}, "gait, double: must be greater than 0"),
    "too tall": ({"height": 0.5}, r"height: with the CoM at 0.5 m .* less than 0.28\d m"),
    "too low": ({"height": 0.05}, r"give more than 0.09\d"),
    "too wide": ({"width": 3.0}, "width: feet 3 m from each other are out of reach of the legs"),
    "on each other": ({"width": 0.03}, "width: feet 0.03 m .* on one another; give at least 0.062"),
    "pushed on each other": ({"least_width": 0.02}, "least_width: feet 0.02 m .* at least 0.062"),
    "above the hips": ({"clearance": 20.0}, r"clearance: feet 20 m .* give less than 0.\d+ m"),
    "too slow": ({"single": 100.0}, "single: 100 s and double: 0.02.* at most 8.3. s together"),
    "hasty": ({"ramp": 0.2}, "ramp: 0.2 s is longer than the double support"),
    "crossing": ({"least_width": 0.2}, "least_width: 0.2 m is above the width, 0.09"),
}


@pytest.mark.parametrize("case", BAD)
def test_settings_out_of_range(hoap2: Robot, case: str) -> None:
    gait, message = BAD[case]
    with pytest.raises(InvalidInputError, match=message):
        Walker(hoap2, gait)


def test_a_height_below_the_ground_is_refused(legs: Legs) -> None:
    """Legs as heavy reach it, and the root of a negative height was a ValueError."""
    with pytest.raises(InvalidInputError, match="gait, height: must be greater than 0"):
        GaitSettings.of(replace(legs, com_height=0.5 * legs.hip_height), height=-0.01)


def test_wide_soles_that_cannot_stand_so_tall_are_told(hoap2: Robot) -> None:
    """The usual width was not looked at: a KeyError, of a width that was not given."""
    sole = [[-0.05, -0.1], [0.05, -0.1], [0.05, 0.1], [-0.05, 0.1]]
    feet = {
        side: {"link": foot.link, "polygon": sole, "height": 0.02}
        for side, foot in hoap2.feet.items()
    }
    with pytest.raises(InvalidInputError, match=r"width: feet 0\.23\d* m .* or a lower height"):
        Walker(Robot.load("hoap2_like", feet=feet), {"height": 0.26})


def test_limits_that_are_assigned_are_limits(hoap2: Robot) -> None:
    """The next command ended in an AttributeError, or a division by zero."""
    walker = Walker(hoap2)
    with pytest.raises(InvalidInputError, match="walker, limits: expected a CommandLimits"):
        walker.limits = 0.3  # type: ignore[assignment]
    with pytest.raises(InvalidInputError, match="walking limits, sideways: must be greater than 0"):
        replace(walker.limits, sideways=0.0)
    walker.limits = replace(walker.limits, forwards=0.05, turning=0.0)
    assert walker.command(0.1, 0.0, 0.3).velocity == (0.05, 0.0, 0.0)


def test_a_posture_that_does_not_stand_is_refused(hoap2: Robot) -> None:
    lies = hoap2.posture("standing")
    lies[3:7] = 0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)
    with pytest.raises(
        InvalidInputError, match=r"sole is tilted by 90 degrees; .* at most 19 degrees"
    ):
        Walker(hoap2, posture=lies)


def test_a_misspelt_setting(hoap2: Robot) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'clearance'"):
        Walker(hoap2, {"clearence": 0.03})


def test_walking_takes_two_feet(robot_named: Load) -> None:
    with pytest.raises(
        InvalidInputError, match=r"two feet are expected, left and right; .* has: none"
    ):
        Walker(robot_named("mixed_joints"))
    with pytest.raises(InvalidInputError, match="expected a robot"):
        Walker("g1")  # type: ignore[arg-type]
    one = Robot.load("hoap2_like", feet={"left": {"link": "left_foot"}})
    with pytest.raises(InvalidInputError, match="has: left"):
        Walker(one)


PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("name", ["walk_g1", "footsteps_g1"])
def test_a_robot_that_waits_makes_no_step(name: str) -> None:
    problem = load_problem(PROBLEMS / f"{name}.yaml")
    walk, start = problem.supervisor_on_robot(), problem.parts.at_start
    steps = round(3.0 / walk.controller.dt)
    for _ in range(steps):
        walk.update(BEFORE_START, start)
        assert isinstance(walk.walker.phase, Standing)
    phases = set()
    for tick in range(steps):
        walk.update(tick, start)
        phases.add(type(walk.walker.phase))
    assert phases - {Standing}


def test_distance_from_where_the_commands_lead_is_in_the_robots_axes(hoap2: Robot) -> None:
    walker = Walker(hoap2)
    walker.heading = 0.5 * math.pi
    told = describe_way(0.1 - 0.3j, walker)  # to the east and south of it, facing north
    assert (
        told == "commands: after 0 steps 0.30 m behind and 0.10 m to the right of where their"
        " speeds lead"
    )


def test_way_of_a_walk_is_the_integral_of_its_speeds(hoap2: Robot) -> None:
    """On a robot that never moves, after speeding up at the gait's acceleration."""
    walker, start = Walker(hoap2, dt=0.01), hoap2.snapshot(hoap2.posture("standing"))
    walk = ScheduledWalk(walker, [TimedCommand(0.5, Velocity(0.05))])
    for tick in range(200):
        walk.update(tick, start)
    ramp = 0.05 / walker.gait.acceleration
    behind = 0.05 * (1.5 - 0.5 * ramp)
    assert f" {behind:.2f} m behind and 0.00 m to the " in walk.notes[-1]


def paces_of(robot: Robot, *given: str) -> Paces:
    legs = Legs.of(robot)
    gait = GaitSettings.of(legs)
    limits = CommandLimits.of(legs, gait)
    planner = StepPlanner(gait, limits, legs, sole_half_sizes(robot))
    return Paces.of(planner, WalkingWeights(), given)


def test_legs_reach_the_steps_of_each_speed(g1: Robot) -> None:
    """What is admitted is beyond the usual settings, and within those of its own pace."""
    paces = paces_of(g1)
    usual = paces.usual.planner
    assert paces.limits.forwards > 1.05 * usual.limits.forwards
    last = usual.gait
    for speed in np.linspace(0.8, paces.limits.forwards, 60).tolist():
        for pace in (paces.at(speed), paces.at(-speed)):
            gait = pace.planner.gait
            assert pace.planner.limits == CommandLimits.of(usual.legs, gait)
            assert pace.planner.limits.forwards >= speed
            assert gait.height <= last.height and gait.single <= last.single
            assert last.height - gait.height < 0.01 * last.height  # no jumps
            assert (pace.planner is usual) == (speed <= paces.begins)
        last = gait


@pytest.mark.parametrize("name", ["talos", "hoap2_like", "romeo", "icub"])
def test_where_not_reach_limits_or_knees_are_weak_nothing_changes(name, robot_named) -> None:
    paces = paces_of(robot_named(name))
    assert paces.at(99.0) is paces.usual
    assert paces.limits == paces.usual.planner.limits


def test_settings_that_are_given_stay(g1: Robot) -> None:
    usual = Walker(g1).gait
    for given in ({"height": usual.height}, {"single": usual.single}):
        walker = Walker(g1, given)
        assert walker.limits == CommandLimits.of(Legs.of(g1), usual)


@pytest.mark.slow
def test_a_g1_walks_beyond_the_usual_limit(g1: Robot) -> None:
    """Twenty steps at 1.2 m/s by default settings, and it stops; then they are the usual ones."""
    walker, plant = Walker(g1), Plant(g1, dt=0.002)
    watch, usual = FallWatch(plant, FallLimits()), walker.gait
    assert not walker.command(1.2).reason

    def walk(until: Callable[[], bool]) -> float:
        begin, start = plant.time, plant.com
        while not until():
            plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
            verdict = watch.verdict()
            assert verdict.stood and plant.time < 20.0, verdict
        return float(np.linalg.norm((plant.com - start)[:2])) / (plant.time - begin)

    walk(lambda: walker.steps >= 8)
    assert 1.1 < walk(lambda: walker.steps >= 20) < 1.3
    assert walker.gait.height < usual.height
    walker.command(0.0)
    walk(lambda: isinstance(walker.phase, Standing))
    assert walker.gait == usual
