"""What a run says of what must be kept, and of what was around it."""

import csv
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc import KinematicController, Limits, PostureTask, Robot, support
from wbc.controllers import Tick
from wbc.motion import read_motion
from wbc.problem import Problem, load_problem
from wbc.robot.collision import Capsule, HalfSpace, Hull, Obstacle
from wbc.run import Result, RunStatus, Stop, simulate
from wbc.run.obstacles import ObstacleTrack, place_of

LEAN = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0.08, 0, 0]}, axes: [x, y], weight: 100, gain: 0.1}
  calm: {type: posture, weight: 0.01}
stop: {duration: 4.0, speed: 1.0e-3, accept: {com: 1.0e-3}}
"""
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


def problem(folder: Path, overrides: dict[str, Any] | None = None, text: str = LEAN) -> Problem:
    return problem_of(folder, text, overrides)


def test_a_robot_that_falls_over_is_no_success(tmp_path: Path) -> None:
    one = problem(tmp_path)
    result = one.run()
    # By the soles' corners, wherever they are: outside.
    end = one.parts.robot.snapshot(result.q)
    corners = [
        end.position(f"{name}_sole")[:2] + foot.polygon @ end.rotation(f"{name}_sole")[:2, :2].T
        for name, foot in one.parts.robot.feet.items()
    ]
    outside = np.concatenate(corners)[:, 0].max() - end.com[0]
    assert outside < -0.01
    assert result.status is RunStatus.NOT_KEPT
    assert not result.status.good
    assert "the robot falls: its CoM was" in result.reason
    assert result.not_kept == tuple(result.summary()["not_kept"])
    assert result.tasks["com"].norm < 1e-3  # which is all that was looked at before


@pytest.mark.parametrize(("least", "good"), [(None, True), (-0.1, True), (0.0, False)])
def test_balance_can_be_switched_off(tmp_path: Path, least: float | None, good: bool) -> None:
    assert problem(tmp_path, {"stop.balance": least}).run().status.good == good


def test_balance_can_be_asked_with_a_margin(tmp_path: Path) -> None:
    asked = {"tasks.com.target": {"offset": [0.0, 0.0, 0.0]}, "stop.balance": 0.5}
    result = problem(tmp_path, asked).run()
    assert result.status is RunStatus.NOT_KEPT
    assert "inside the soles, less than 500 mm" in result.reason


def test_a_contact_far_from_its_anchor_has_slipped(hoap2: Robot) -> None:
    """Feet that are held without taking back a drift stay where they have been pushed."""
    start = hoap2.snapshot(hoap2.posture())
    contacts = support(start, "double")
    moved = hoap2.integrate(start.q, np.r_[0.02, np.zeros(hoap2.nv - 1)], 1.0)
    tasks = [PostureTask(hoap2, start.q)]
    made = KinematicController(hoap2, tasks, contacts=contacts, limits=Limits(hoap2))
    stop = Stop(duration=2.0, speed=1e-3)
    result = simulate(made, moved, stop)
    assert result.status is RunStatus.NOT_KEPT
    assert "_sole slipped by 20 mm (tick 0)" in result.reason
    assert simulate(made, moved, Stop(2.0, 1e-3, slip=0.03)).status is RunStatus.CONVERGED
    assert simulate(made, moved, Stop(2.0, 1e-3, slip=None)).status is RunStatus.CONVERGED
    soft = dict.fromkeys(("left_sole", "right_sole"), 1e4)
    loose = KinematicController(hoap2, tasks, contacts=contacts, slack=soft)
    assert simulate(loose, moved, stop).status is RunStatus.CONVERGED


COMING = """\
robot: hoap2_like
support: double
tasks: {calm: {type: posture}}
constraints:
  room:
    type: obstacles
    links: [torso]
    things: {ball: {sphere: 0.05, position: [0.5, 0, 0.35], velocity: [-2, 0, 0]}}
stop: {duration: 0.6, speed: null, balance: null, slip: null}
"""


def test_a_margin_that_is_not_kept_is_no_success(tmp_path: Path) -> None:
    """A ball comes faster than the robot can give way, whose feet are held."""
    result = problem(tmp_path, text=COMING).run()
    assert result.status is RunStatus.NOT_KEPT
    assert "room exceeded by" in result.reason
    assert result.clearance["room"].where.endswith(" vs ball")
    assert result.clearance["room"].value == result.history.clearance["room"].min() < -0.02
    told = result.summary()["constraints"]["room"]
    assert told["least_clearance"] == result.clearance["room"].value
    assert problem(tmp_path, {"stop.margins": None}, COMING).run().status.good
    assert problem(tmp_path, {"constraints.room.slack": 1.0}, COMING).run().status.good
    still = problem(tmp_path, {"constraints.room.things.ball.velocity": [0, 0, 0]}, COMING).run()
    assert still.status.good
    # The ball is 0.5 m from the middle of the torso: less its radius, the margin and the torso's.
    assert 0.3 < still.clearance["room"].value < 0.43


def test_what_starts_outside_its_limits_is_brought_back_first(hoap2: Robot) -> None:
    q = hoap2.posture()
    joint = hoap2.joint_index("left_elbow_pitch") - 6
    q[7 + joint] = hoap2.limits.upper[joint] + 0.05
    calm = PostureTask(hoap2, hoap2.posture(), weight=0.1)
    made = KinematicController(hoap2, [calm], limits=Limits(hoap2))
    result = simulate(made, q, Stop(duration=1.0, speed=None))
    assert result.margin.value == pytest.approx(-0.05)
    assert result.status is RunStatus.COMPLETED, result.reason
    free = KinematicController(hoap2, [PostureTask(hoap2, q)])
    stays = simulate(free, q, Stop(duration=0.1, speed=None))
    assert stays.status is RunStatus.COMPLETED  # no limits were asked for


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


def test_joints_at_a_bound_are_those_whose_velocity_is_at_it(reached) -> None:
    result, ticks = reached
    at_bound = {label: on for label, on in result.history.active.items() if "bound" in label}
    assert at_bound
    for label, on in at_bound.items():
        name, side, _ = label.split()
        k = result.robot.joint_index(name)
        for tick, held in zip(ticks, on, strict=True):
            bound = (tick.qp.upper if side == "upper" else tick.qp.lower)[k]
            assert not held or abs(tick.velocity[k] - bound) < 1e-6  # the solver's accuracy


def test_constraints_that_may_give_way_are_told_too_but_not_judged(reached) -> None:
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


def test_targets_and_points_are_where_the_error_is_between_them(reached) -> None:
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


def test_the_table_is_the_run_and_can_be_read_as_a_motion(reached, tmp_path) -> None:
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
