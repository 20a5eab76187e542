"""Settings that follow the speed: within reach of the legs at each, and the usual ones below."""

from collections.abc import Callable

import numpy as np
import pytest

from wbc.gait import CommandLimits, GaitSettings, Legs, Walker, WalkingWeights
from wbc.gait.pace import Paces
from wbc.gait.phases import Standing
from wbc.gait.reference import StepPlanner, sole_half_sizes
from wbc.robot import Robot
from wbc.simulation import FallLimits, FallWatch, Plant

Load = Callable[[str], Robot]


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
