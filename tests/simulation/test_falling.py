"""What counts as a fall: a lifted foot that comes down; and what does not: toes."""

import numpy as np
import pytest

from tests import urdf
from tests.robot.test_feet_of_others import FOOT, TOE, biped
from tests.simulation.idle import in_the_air
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import Wall
from wbc.robot import Robot
from wbc.simulation import FallLimits, Plant, Step, Terrain
from wbc.simulation.falling import FallWatch


@pytest.fixture
def plant() -> Plant:
    return Plant(Robot.load("hoap2_like"))


def test_a_lifted_foot_that_touches_the_ground_is_a_fall(plant: Plant) -> None:
    q, _ = plant.state()
    q[2] += 5e-3
    plant.reset(q)
    standing, on_one = (FallWatch(plant, FallLimits(lifted=foot)) for foot in ("", "right"))
    assert standing.verdict().stood and on_one.verdict().stood
    plant.step(plant.torque, 0.05)  # it falls by 5 mm in 32 ms
    assert standing.verdict().stood
    verdict = on_one.verdict()
    assert not verdict.stood
    assert verdict.reason.endswith("the right foot, which was lifted, touched the ground")


def test_the_lifted_foot_must_exist(plant: Plant) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'right'"):
        FallWatch(plant, FallLimits(lifted="rihgt"))


def test_a_tilt_in_degrees_is_refused() -> None:
    """It was never reached, in silence."""
    with pytest.raises(InvalidInputError, match=r"60 degrees are 1.05 rad"):
        FallLimits(tilt=60)


def test_toes_on_joints_of_their_own_may_touch_the_ground() -> None:
    """Before, a robot with toes had fallen after two steps of the physics."""
    robot = Robot.load(biped(FOOT, extra=TOE))
    plant = Plant(robot)
    plant.reset(robot.posture("standing"))
    watch = FallWatch(plant, FallLimits())
    plant.step(np.zeros(robot.nv - 6), 0.004)
    assert plant.touching() == ("left_toe", "right_toe")
    assert watch.verdict().stood
    lying = robot.posture("standing")
    lying[2:7] = 0.1, 0.0, 2**-0.5, 0.0, 2**-0.5
    plant.reset(lying)
    assert "trunk touched the ground" in watch.verdict().reason


@pytest.mark.parametrize(
    ("terrain", "what"),
    [
        (Terrain(walls=[Wall((0.15, 0.0, 0.3), (-1.0, 0.0, 0.0))]), "wall 0"),
        (Terrain(steps=(Step((0.2, 0.0, 0.3), (0.1, 1.0, 0.3)),)), "step 0"),
        (Terrain(), "the ground"),
    ],
)
def test_what_a_link_touched_is_told_and_whether_it_did_at_the_start(terrain, what) -> None:
    plant = Plant(Robot.load("hoap2_like"), terrain=terrain)
    q, _ = plant.state()
    watch = FallWatch(plant, FallLimits())
    assert watch.verdict().stood
    into = q.copy()
    into[0] += 0.1
    if what == "the ground":
        into[2] -= 0.2
    plant.reset(into)
    assert watch.verdict().reason.endswith(f" touched {what}")
    inside = FallWatch(plant, FallLimits()).verdict().reason
    assert f" touched {what}, as at the start: the robot begins there; falls: " in inside
    assert set(plant.touched()) == set(plant.touching())


def test_a_bolted_robot_does_not_sink() -> None:
    """An arm that folded down had fallen, and one below its base at the first tick."""
    robot = Robot.load("hoap2_like", base="fixed", feet={})
    plant = Plant(robot, shapes=False)
    q, _ = plant.state()
    for height in (0.4, 0.0, -1.0):
        q[2] = height
        plant.reset(q)
        watch = FallWatch(plant, FallLimits(com_height=0.99))
        plant.step(plant.torque, 0.3)  # its limbs hang down
        assert watch.verdict().stood


def test_a_robot_that_floats_below_the_origin_has_not_fallen(plant: Plant) -> None:
    """It had, at the first tick: its CoM "sank to -0.039 m, below 0.5 of -0.039 m"."""
    floating = in_the_air(plant.robot, -2.0, gravity=(0.0, 0.0, 0.0))
    watch = FallWatch(floating, FallLimits())
    floating.step(floating.torque)
    assert watch.verdict().stood


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_links_of_a_bolted_robot_that_begin_in_the_ground_are_told(height: float, caplog) -> None:
    """As of arms whose zero posture hangs or lies, with their base at the origin."""
    ball = urdf.link("ball", urdf.collision('sphere radius="0.1"'))
    arm = urdf.robot("arm", urdf.link("root"), urdf.joint("j", "root", "ball", at=".3 0 0"), ball)
    plant = Plant(robot := Robot.load(arm, base="fixed"))
    caplog.clear()
    q = robot.posture()
    q[2] = height
    plant.reset(q)
    for _ in range(2):
        plant.step(np.zeros(1))
    told = "plant: arm begins 100 mm deep in the ground with ball, which will be thrown: raise"
    assert [text[: len(told)] for text in caplog.messages] == [told] * (height == 0.0)
