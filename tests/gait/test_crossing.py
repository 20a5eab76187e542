"""Feet over edges that are known: they clear them, by the corners of soles as they are turned."""

import math

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.gait import Footstep, GaitSettings, Legs, Walker
from wbc.gait.crossing import Crossing
from wbc.gait.phases import sole_poses
from wbc.gait.step_range import StepRange
from wbc.gait.swing import FootPose, SwingFoot
from wbc.robot import Robot
from wbc.rotations import upright_on
from wbc.simulation import FallLimits, FallWatch, Plant, Step, Terrain
from wbc.validate import Array

DT, T, CLEARANCE = 0.002, 0.8, 0.06
UP = np.array((0.0, 0.0, 1.0))
SOLE = np.array(((0.085, 0.03), (-0.085, 0.03), (-0.085, -0.03), (0.085, -0.03)))


def stairs(rise: float, tread: float, count: int, begin: float) -> Terrain:
    """Return steps up, and as many down behind a landing of two treads."""
    heights = [*range(1, count + 1), count, *range(count, 0, -1)]
    return Terrain(
        steps=tuple(
            Step(np.array((begin + (k + 0.5) * tread, 0.0, n * rise)), (tread, 1.0, n * rise))
            for k, n in enumerate(heights)
        )
    )


def flown(foot: SwingFoot, goal: Array, ground: float) -> list[FootPose]:
    poses = []
    for k in range(round(T / DT)):
        foot = foot.advance(goal, ground, T - k * DT, DT, 100.0)
        poses.append(foot.pose())
    return poses


@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi, -3.1])
def test_the_path_is_the_same_wherever_it_heads(heading: float) -> None:
    """At pi the sole was taken to turn by 6 rad on its way, over a wall beside it."""
    c, s = math.cos(heading), math.sin(heading)
    R = np.array(((c, -s), (s, c)))

    def ground(points: Array) -> Array:
        ahead, left = (points @ R).T
        return np.where(ahead > 0.25, 0.1, np.where(left > 0.11, 0.2, 0.0))

    yaws = [math.remainder(heading + turn, math.tau) for turn in (-0.1, 0.1)]
    start, goal = np.array((0.0, 0.0, yaws[0], 0.0)), np.array((*R[:, 0] * 0.4, yaws[1], 0.1))
    over = Crossing.over(start, goal, SOLE, CLEARANCE, 0.0, ground)
    assert over is not None and over.top < 0.1 + 2.0 * CLEARANCE


# From tread to tread but one, up and down, onto the first and from the last one.
WAYS = {"up": (0.115, 0.715), "first": (-0.185, 0.115), "down": (2.25, 2.85), "last": (2.55, 3.15)}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_soles_clear_the_edges(way: tuple[float, float]) -> None:
    terrain = stairs(0.15, 0.3, 4, 0.0)
    first, last = (float(z) for z in terrain.height(np.array([(x, 0.1) for x in way])))
    start, goal = (np.array((x, 0.1, 0.0, z)) for x, z in zip(way, (first, last), strict=True))
    beside = 0.5 * (first + last)
    over = Crossing.over(start, goal, SOLE, CLEARANCE, beside, terrain.height)
    assert over is not None and over.tip > 0.2 and over.begins + over.ends < 0.6
    foot = SwingFoot.lift_off(start[:3], first, UP, CLEARANCE, 0.4, 0.1, crossing=over)
    poses = flown(foot, goal[:3], last)
    for pose in poses[:-20]:  # then it is 2 mm above the ground
        corners = np.column_stack((SOLE, np.zeros(4))) @ pose.rotation.T + pose.position
        assert np.all(corners[:, 2] > terrain.height(corners[:, :2]) - 1e-3)
    np.testing.assert_allclose(poses[-1].position, (goal[0], goal[1], last), atol=1e-3)
    np.testing.assert_allclose(poses[-1].rotation, np.eye(3), atol=1e-3)
    # What is not known may be anywhere: the foot goes up first, and as high.
    blind = Crossing.over(start, goal, SOLE, CLEARANCE, max(first, last))
    assert blind is not None and blind.top == pytest.approx(over.top, abs=0.2)
    assert blind.begins + blind.ends >= over.begins + over.ends - 1e-9


def test_rates_are_derivatives() -> None:
    """By differences of second order; the tilt's own rates are those to first order in it."""
    start, goal = np.array((0.0, 0.1, 0.2, 0.0)), np.array((0.6, 0.15, 0.5, 0.3))
    over = Crossing.over(start, goal, SOLE, CLEARANCE, 0.15)
    assert over is not None
    lands = upright_on(np.array((-0.06, 0.04, np.sqrt(1.0 - 0.0052))))[:, 2]
    foot = SwingFoot.lift_off(start[:3], 0.0, lands, CLEARANCE, 0.4, 0.1, sole=UP, crossing=over)
    poses = flown(foot, goal[:3], 0.3)
    for a, pose, b in zip(poses[:370], poses[1:], poses[2:], strict=False):
        rate = (b.position - a.position) / (2 * DT)
        np.testing.assert_allclose(pose.rate[:3], rate, atol=2e-2)
        W = (b.rotation - a.rotation) @ pose.rotation.T / (2 * DT)
        np.testing.assert_allclose(pose.rate[3:], (W[2, 1], W[0, 2], W[1, 0]), atol=8e-2)
        change = (b.rate - a.rate) / (2 * DT)
        np.testing.assert_allclose(pose.acceleration[:3], change[:3], atol=1.0)


def test_level_ground_has_no_edges() -> None:
    start, goal = np.array((0.0, 0.1, 0.0, 0.0)), np.array((0.4, 0.1, 0.0, 0.0))
    assert Crossing.over(start, goal, SOLE, CLEARANCE, 0.0) is None
    stones = Terrain(steps=(Step((0.0, 0.1, 0.0), (0.2, 0.1, 0.5)),))
    assert Crossing.over(start, goal, SOLE, CLEARANCE, 0.0, stones.height) is None


def test_steps_that_legs_do_not_reach_are_refused(g1_27: Robot) -> None:
    legs = Legs.of(g1_27)
    able = StepRange.of(g1_27, GaitSettings.of(legs), legs)
    feet = sole_poses(g1_27.snapshot(g1_27.posture("standing")))
    w = able.gait.width
    for change, said in (
        ({"z": 0.7}, "z: 0.7 m over the left foot is out of reach"),
        ({"z": -0.7}, "z: -0.7 m over the left foot is out of reach"),
        ({"slope": (0.5, 0.0)}, "slope: 0.5 is steeper"),
        ({"z": 0.15, "x": 0.4, "duration": 0.2}, "beyond the torque of the hips"),
    ):
        step = Footstep(**{"foot": "right", "x": 0.1, "y": -w, "duration": 0.9, **change})
        with pytest.raises(InvalidInputError, match=said):
            able.admitted([step], feet, relative=True)
    world = able.admitted(
        [Footstep("right", 0.3, -w, 0.0, 0.9, 0.1, (0.1, 0.0)), Footstep("left", 0.3, w, z=0.1)],
        feet,
        relative=True,
    )
    assert world[1].z == pytest.approx(feet["left"][3] + 0.2)
    assert world[0].normal is not None and world[0].normal[0] < 0.0


@pytest.mark.slow
def test_a_small_humanoid_climbs_stairs_and_stones(hoap2: Robot) -> None:
    """Up and down two steps of 3 cm, then over a stone that is tilted; 2 mm were measured."""
    walker = Walker(hoap2)
    w = 0.5 * walker.gait.width
    foot = hoap2.snapshot(hoap2.posture("standing")).position(hoap2.feet["left"].frame)
    begin, tread = float(foot[0]) + 0.085, 0.13
    ground = stairs(0.03, tread, 2, begin)
    edge = begin + 5.5 * tread
    stone = Step((edge + 0.2, -w, 0.02), (0.122, 0.08, 0.02), slope=(0.08, -0.08))
    terrain = Terrain(steps=(*ground.steps, stone))
    ways = [(0.4, 1), (1.4, 2), (2.4, 2), (3.4, 2), (4.5, 1), (5.5, 0)]
    steps = [
        Footstep(("right", "left")[k % 2], begin + x * tread, (-w, w)[k % 2], 0.0, 0.9, 0.03 * n)
        for k, (x, n) in enumerate(ways)
    ]
    steps += [
        Footstep("right", edge + 0.05, -w, 0.0, 0.9, 0.0),
        Footstep("left", edge + 0.12, w, 0.0, 0.9, 0.0),
        Footstep("right", edge + 0.2, -w, 0.0, 0.9, 0.02, (0.08, -0.08)),
        Footstep("left", edge + 0.28, w, 0.0, 0.9, 0.0),
        Footstep("right", edge + 0.28, -w, 0.0, 0.6, 0.0),
    ]
    plant = Plant(hoap2, terrain=terrain)
    walker.follow(steps, plant.snapshot(), ground=terrain.height)
    watch, highest = FallWatch(plant, FallLimits()), 0.0
    while walker.steps < len(steps) or plant.time < 1.0:
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
        assert watch.verdict().stood and plant.time < 20.0
        highest = max(highest, float(plant.com[2]))
    assert max(landing.distance for landing in walker.landings) < 5e-3
    assert highest > 0.05 + walker.gait.height
