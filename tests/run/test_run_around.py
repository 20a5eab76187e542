"""What a run says of what was around it: constraints, what held it back, targets, obstacles."""

import csv
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.controllers import Tick
from wbc.motion import read_motion
from wbc.problem import load_problem
from wbc.robot.collision import Capsule, HalfSpace, Hull, Obstacle
from wbc.run import Result
from wbc.run.obstacles import ObstacleTrack, place_of

REACH = """\
robot: hoap2_like
support: double
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0.2, 0, 0.1]},
         gain: 0.1}
  com: {type: com, target: start, axes: [x, y], weight: 5}
constraints:
  room:
    type: obstacles
    links: [left_hand_link]
    things:
      wall: {half_space: [-1, 0, 0], position: [0.1, 0, 0]}
      ball: {sphere: 0.05, position: [0.4, 0.3, 0.2], velocity: [-0.05, 0, 0]}
  desk: {type: obstacles, slack: 1.0, things: {top: {box: [0.1, 0.1, 0.02], position: [9, 0, 0]}}}
phases:
  reach: {duration: 0.5}
  stay: {duration: 0.25, tasks: {hand: {active: false}}}
  rest: {duration: 0.05}
"""


@pytest.fixture(scope="module")
def reached(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, list[Tick]]:
    path = tmp_path_factory.mktemp("reach") / "p.yaml"
    path.write_text(REACH)
    ticks: list[Tick] = []
    return load_problem(path).run(observe=ticks.append), ticks


def test_what_held_it_back_is_what_the_ticks_say(reached: tuple[Result, list[Tick]]) -> None:
    result, ticks = reached
    counts = Counter(label for tick in ticks for label in tick.active)
    rows = {label: one.ticks for label, one in result.held_back.items() if " vs " in label}
    assert rows == counts
    label = next(label for label in result.held_back if label.endswith(" vs wall"))
    wall = result.held_back[label]
    on = [k for k, tick in enumerate(ticks) if label in tick.active]
    assert (wall.first, wall.last) == (result.history.time[on[0]], result.history.time[on[-1]])
    # What holds back is near: it is braked for, and then leaned on.
    clearance = result.history.clearance["room"]
    assert clearance[on[-1]] < 2e-4  # rows keep 0.1 mm more than the margin
    longest = [one.ticks for one in result.held_back.values()]
    assert longest == sorted(longest, reverse=True)


def test_joints_at_a_bound_are_those_whose_velocity_is_at_it(
    reached: tuple[Result, list[Tick]],
) -> None:
    result, ticks = reached
    at_bound = {label: on for label, on in result.history.active.items() if "bound" in label}
    assert at_bound
    for label, on in at_bound.items():
        name, side, _ = label.split()
        k = result.robot.joint_index(name)
        for tick, held in zip(ticks, on, strict=True):
            bound = (tick.qp.upper if side == "upper" else tick.qp.lower)[k]
            assert not held or abs(tick.velocity[k] - bound) < 1e-6  # the solver's accuracy


def test_constraints_that_may_give_way_are_told_too_but_not_judged(
    reached: tuple[Result, list[Tick]],
) -> None:
    result, _ = reached
    assert result.yielding == {"desk"}
    told = result.summary()["constraints"]
    assert {name: one["may_give_way"] for name, one in told.items()} == {
        "room": False,
        "desk": True,
    }
    assert told["room"]["time"] == told["room"]["tick"] * 0.005
    nearest = {str(one).split(" vs ")[1] for one in result.history.nearest["room"]}
    assert nearest <= {"wall", "ball"}


def test_targets_and_points_are_where_the_error_is_between_them(
    reached: tuple[Result, list[Tick]],
) -> None:
    history = reached[0].history
    error = history.points["hand"] - history.targets["hand"]
    np.testing.assert_allclose(error, history.errors["hand"], atol=1e-15)  # NaN where it is off
    off = history.phase == "rest"
    assert np.isnan(history.targets["hand"][off]).all() and off.any()
    # The CoM's height is free: there its target is where it is.
    np.testing.assert_array_equal(history.targets["com"][:, 2], history.com[:, 2])


def test_obstacles_are_where_they_move_to(reached: tuple[Result, list[Tick]]) -> None:
    history = reached[0].history
    ball = history.obstacles["room/ball"]
    expected = np.array([0.4, 0.3, 0.2]) + history.time[:, None] * np.array([-0.05, 0.0, 0.0])
    np.testing.assert_allclose(ball.place[:, :, 3], expected, atol=1e-12)
    assert isinstance(ball.shape, Capsule) and ball.shape.radius == 0.05


def test_the_table_is_the_run_and_can_be_read_as_a_motion(
    reached: tuple[Result, list[Tick]], tmp_path: Path
) -> None:
    result, _ = reached
    result.save(tmp_path / "r.csv")
    with (tmp_path / "r.csv").open() as file:
        header, *rows = csv.reader(file)
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    history, robot = result.history, result.robot
    np.testing.assert_allclose(table["time [s]"], history.time, rtol=1e-8)
    np.testing.assert_allclose(
        table["constraint/room [m]"], history.clearance["room"], rtol=1e-8, atol=1e-12
    )
    for label, on in history.active.items():
        np.testing.assert_array_equal(table[f"held_back/{label} [1]"], on)
    knee = robot.joint_index("left_elbow_pitch")
    np.testing.assert_allclose(
        table["velocity/left_elbow_pitch [rad/s]"], history.v[:, knee], rtol=1e-8, atol=1e-12
    )
    motion = read_motion(tmp_path / "r.csv", robot, ignore=["*/*"])
    np.testing.assert_allclose(motion.joints, history.q[:, 7:], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("obstacle", [
    Obstacle.sphere("s", (1.0, 2.0, 3.0), 0.2), Obstacle.capsule("c", (0, 0, 0), (0, 0, 1), 0.1),
    Obstacle.box("b", (0.1, 0.2, 0.3)), Obstacle.half_space("h", (0.0, 3.0, 4.0), -0.5),
], ids=lambda one: one.name)  # fmt: skip
def test_a_track_is_what_its_arrays_say(obstacle: Obstacle) -> None:
    track = ObstacleTrack(obstacle.shape, np.stack([place_of(obstacle)] * 2))
    again = ObstacleTrack.from_arrays(track.arrays())
    np.testing.assert_array_equal(again.place, track.place)
    assert type(again.shape) is type(obstacle.shape)
    np.testing.assert_allclose(again.shape.core, obstacle.shape.core, atol=1e-15)
    kinds: dict[type, Any] = {HalfSpace: "normal", Capsule: "radius", Hull: "radius"}
    name = kinds[type(obstacle.shape)]
    np.testing.assert_allclose(getattr(again.shape, name), getattr(obstacle.shape, name))
