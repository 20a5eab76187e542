"""Runs in phases: what moves between them, what is held, and what is kept of it."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from tests.problem.loading import problem_of
from wbc.problem import Problem, Result, RunStatus
from wbc.robot import Robot

# A step: over the right foot, the left one up, and down again 2 cm further forward.
STEP = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: start, weight: 30}
  torso: {type: frame, frame: torso, control: orientation, target: start}
  foot: {type: frame, frame: left_sole, control: pose, target: start, weight: 30, active: false}
  hand: {type: frame, frame: left_hand, control: position, target: start, active: false}
  calm: {type: posture, weight: 0.05, gain: 0.1}
controller: {dt: 0.01}
phases:
  over: {duration: 0.8, tasks: {com: {target: {over: right, height: 0.27}}}}
  lift:
    duration: 0.5
    support: right
    tasks:
      foot: {active: true, target: {position: {offset: [0.01, 0.0, 0.03]}}, weight: 20}
      hand: {active: true, target: {offset: [0.02, 0.0, 0.05]}, weight: 5}
  down: {duration: 0.5, tasks: {foot: {target: {position: {offset: [0.02, 0.0, 0.0]}}}}}
  stand:
    duration: 0.8
    support: double
    tasks:
      foot: {active: false}
      hand: {active: false}
      com: {target: {over: double}}
stop: {accept: {com: 1.0e-3, foot: 1.0e-3}}
"""
BORDERS = {"over": 0.0, "lift": 0.8, "down": 1.3, "stand": 1.8}
DT = 0.01


def problem(folder: Path, overrides: dict[str, Any] | None = None, text: str = STEP) -> Problem:
    return problem_of(folder, text, overrides)


class Watched:
    """A run, with the targets and weights of every tick."""

    def __init__(self, one: Problem) -> None:
        self.problem = one
        self.robot = one.parts.robot
        tasks = {task.name: task for task in one.parts.tasks}
        self.com, self.rate, self.foot = [], [], []
        self.weights: dict[str, list[float]] = {name: [] for name in tasks}

        def note(_: object) -> None:
            self.com.append(tasks["com"].target)
            self.rate.append(tasks["com"].target_rate)
            self.foot.append(tasks["foot"].position)
            for name, task in tasks.items():
                self.weights[name].append(task.weight[0])

        self.result = one.run(observe=note)
        self.history = self.result.history

    def first(self, phase: str) -> int:
        return round(BORDERS[phase] / DT)


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    return Watched(problem(tmp_path_factory.mktemp("step")))


def sole(robot: Robot, q: np.ndarray, foot: str) -> pin.SE3:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(f"{foot}_sole")].copy()


def test_the_step_is_made(step: Watched) -> None:
    assert step.result.status is RunStatus.ACCEPTED, step.result.reason
    assert step.result.reason == "ran for 2.6 s; every tolerance met"
    robot, before, after = step.robot, step.problem.parts.start, step.result.q
    moved = sole(robot, after, "left").translation - sole(robot, before, "left").translation
    np.testing.assert_allclose(moved, [0.02, 0.0, 0.0], atol=1e-4)
    stayed = sole(robot, after, "right").translation - sole(robot, before, "right").translation
    np.testing.assert_allclose(stayed, 0.0, atol=1e-4)
    top = sole(robot, step.history.q[step.first("down")], "left").translation[2]
    assert top == pytest.approx(0.03, abs=1e-3)


def test_every_tick_knows_its_phase_and_support(step: Watched) -> None:
    phases, support = step.history.phase, step.history.support
    assert list(dict.fromkeys(phases)) == list(BORDERS)
    for name, begins in BORDERS.items():
        assert np.flatnonzero(phases == name)[0] == round(begins / DT)
    assert set(support[phases == "over"]) == {"left,right"}
    assert set(support[(phases == "lift") | (phases == "down")]) == {"right"}
    assert support[-1] == "left,right"
    assert [(name, one.begins) for name, one in step.result.phases.items()] == [
        (name, pytest.approx(begins)) for name, begins in BORDERS.items()
    ]


def test_targets_are_continuous_at_the_borders(step: Watched) -> None:
    target, rate = np.array(step.com), np.array(step.rate)
    # The largest rate and acceleration of minimum jerk are 15/8 d/T and 10/sqrt(3) d/T^2; the CoM
    # goes no further than 8 cm in 0.8 s.
    assert np.abs(np.diff(target, axis=0)).max() <= 1.875 * 0.08 / 0.8 * DT
    assert np.abs(np.diff(rate, axis=0)).max() <= 5.78 * 0.08 / 0.8**2 * DT
    for phase in ("lift", "down", "stand"):
        k = step.first(phase)
        # At a border the target rests; a tick beside it the rate is at most 30 d/T (dt/T)^2.
        np.testing.assert_array_equal(rate[k], 0.0)
        assert np.abs(rate[k - 1]).max() <= 30 * 0.08 / 0.8 * (DT / 0.8) ** 2
    np.testing.assert_allclose(np.gradient(target[:80], DT, axis=0)[1:-1], rate[1:79], atol=2e-3)


def test_over_a_foot_is_above_the_middle_of_its_sole(step: Watched) -> None:
    start = step.problem.parts.start
    right = sole(step.robot, start, "right")
    corners = step.robot.feet["right"].polygon
    assert ConvexHull(corners).volume > 0.0
    np.testing.assert_allclose(corners.mean(axis=0), 0.0, atol=1e-12)  # a rectangle
    k = step.first("lift")
    np.testing.assert_allclose(step.com[k], [*right.translation[:2], 0.27], atol=1e-5)
    # "double" is half way between the feet where they are when the phase begins; the height stays.
    q = step.history.q[step.first("stand")]
    middle = (
        sole(step.robot, q, "left").translation + sole(step.robot, q, "right").translation
    ) / 2
    end = step.result.final.com
    np.testing.assert_allclose(end, [*middle[:2], 0.27], atol=1e-4)


def test_a_target_that_was_off_starts_where_the_robot_is(step: Watched) -> None:
    k = step.first("lift")
    np.testing.assert_allclose(
        step.foot[k], sole(step.robot, step.history.q[k], "left").translation, atol=1e-12
    )


def test_weights_rise_and_fall_smoothly(step: Watched) -> None:
    hand, foot = np.array(step.weights["hand"]), np.array(step.weights["foot"])
    lift, down, stand = (step.first(phase) for phase in ("lift", "down", "stand"))
    # Not a foot's: it comes in and goes out within the phase, never faster than 15/8 w/T.
    assert hand[lift] == pytest.approx(5e-6)  # faint, but never nothing
    assert np.abs(np.diff(hand[lift:])).max() <= 1.875 * 5.0 / 0.5 * DT
    assert (hand[down:stand] == 5.0).all()
    assert hand[-1] < 0.01
    # A foot that is let go of has been held with all the force there is.
    assert foot[lift] == 30.0
    assert foot[down] == pytest.approx(20.0)
    assert (np.diff(foot[lift:down]) <= 0.0).all()


def test_errors_and_slips_are_nan_while_there_is_nothing_to_tell(step: Watched) -> None:
    history = step.history
    air = (history.phase == "lift") | (history.phase == "down")
    np.testing.assert_array_equal(np.isfinite(history.errors["foot"]).all(axis=1), air)
    np.testing.assert_array_equal(np.isfinite(history.slip["left_sole"]), ~air)
    np.testing.assert_array_equal(
        np.isfinite(history.errors["hand"]).all(axis=1), history.phase != "over"
    )
    assert np.isfinite(history.slip["right_sole"]).all()
    # From where it was put down last: 2 cm from its first place, and still no slip.
    assert np.nanmax(history.slip["left_sole"]) < 1e-4
    assert step.result.slip is not None
    assert step.result.slip.value < 1e-4


def test_commands_do_not_jump_at_the_borders(step: Watched) -> None:
    jumps = np.abs(np.diff(step.history.v, axis=0)).max(axis=1)
    for phase in ("lift", "down", "stand"):
        k = step.first(phase)
        # rad/s, a third of what limits allow in a tick (50 rad/s^2). A pose follows its target two
        # ticks behind, so that it comes to rest with a rate of 30 d/T (2 dt/T)^2 or so left.
        assert jumps[k - 1] < 0.16
        assert jumps[k] < 0.08


def test_balance_is_the_distance_to_the_hull(step: Watched) -> None:
    robot, history = step.robot, step.history
    for k in range(0, len(history), 20):
        q = history.q[k]
        corners = []
        for foot in history.support[k].split(","):
            place = sole(robot, q, foot)
            flat = robot.feet[foot].polygon
            corners += [(place.act(np.array([x, y, 0.0])))[:2] for x, y in flat]
        edges = ConvexHull(np.array(corners)).equations
        com = pin.centerOfMass(robot.model, robot.model.createData(), q)[:2]
        inside = -(edges[:, :2] @ com + edges[:, 2]).max()
        # Inside, the distance to the nearest edge's line is that to the polygon.
        assert history.balance[k] == pytest.approx(inside, abs=1e-9)
    worst = step.result.balance
    assert worst is not None
    assert worst.value == pytest.approx(history.balance.min())
    assert worst.where == history.phase[worst.tick]
    assert step.result.phases["over"].balance == history.balance[history.phase == "over"].min()


def test_phases_need_not_fit_the_time_step(tmp_path: Path) -> None:
    result = problem(tmp_path, {"phases.over.duration": 0.8041}).run()
    assert result.status is RunStatus.ACCEPTED
    assert result.history.time[result.history.phase == "lift"][0] == pytest.approx(0.81)
    assert len(result.history) == 261


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ({"position": {"offset": [0, 0, 0.02]}}, "left foot does not stand"),
        ({"orientation": {"rpy": [0.0, 0.05, 0.0]}}, "from corner to corner it rises by 4.7 mm"),
        ({"position": {"offset": [0, 0, -0.004]}}, " mm below the ground"),
    ],
)
def test_a_foot_in_the_air_cannot_be_stood_on(tmp_path, target, words) -> None:
    one = problem(tmp_path, {"phases.down.tasks.foot.target": target})
    result = one.run()
    assert result.status is RunStatus.NOT_STANDING
    assert not result.status.good
    assert result.reason.startswith("phase 'stand' cannot begin: ")
    assert words in result.reason
    assert set(result.history.phase) == {"over", "lift", "down"}
    assert len(result.history) == 180
    assert result.q.shape == (one.parts.robot.nq,)


def test_what_is_not_a_foot_may_be_held_too(tmp_path: Path) -> None:
    held = ["right_sole", {"frame": "left_hand", "type": "point"}]
    overrides = {"phases.lift.support": held, "phases.lift.tasks.hand": {}}
    result = problem(tmp_path, overrides).run()
    lift = result.history.phase == "lift"
    assert set(result.history.support[lift]) == {"right,left_hand"}
    assert np.isnan(result.history.balance[lift]).all()  # hands help: soles do not tell
    assert np.isfinite(result.history.slip["left_hand"][lift]).all()


@pytest.mark.parametrize("controller", [{"method": "pseudo_inverse", "dt": 0.01}, None])
def test_strict_levels_and_other_controllers(tmp_path, controller) -> None:
    overrides: dict[str, Any] = {"tasks.calm.priority": 1, "tasks.torso.priority": 1}
    result = problem(
        tmp_path, overrides if controller is None else {"controller": controller}
    ).run()
    assert not result.failures
    assert len(result.history) == 260


def test_without_phases_there_is_one_without_a_name(tmp_path: Path) -> None:
    text = STEP.split("phases:")[0] + "stop: {duration: 0.1, speed: null}\n"
    result: Result = problem(tmp_path, text=text).run()
    assert result.status is RunStatus.COMPLETED
    assert set(result.history.phase) == {""}
    assert result.phases == {}
    assert set(result.history.errors) == {"com", "torso", "calm"}  # the others are off
    assert result.balance is not None
    assert result.balance.where == ""
    floating = problem(tmp_path, {"support": "floating"}, text).run()
    assert floating.balance is None
    assert set(floating.history.support) == {""}


def test_a_task_that_comes_in_is_not_said_to_do_nothing(tmp_path, caplog) -> None:
    """Its ramp begins near 0: each such task of a problem was warned of in Python's log."""
    text = (
        "robot: hoap2_like\nsupport: double\n"
        "tasks:\n"
        "  com: {type: com, target: start, weight: 10}\n"
        "  hand: {type: frame, frame: left_hand, control: position, target: start, active: false}\n"
        "  posture: {type: posture, weight: 0.01}\n"
        "phases:\n"
        "  wait: {duration: 0.02}\n"
        "  reach: {duration: 0.02, tasks: {hand: {active: true}}}\n"
    )
    assert not problem(tmp_path, text=text).run().failures
    assert "weight" not in caplog.text
