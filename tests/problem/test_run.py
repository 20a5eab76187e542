"""Short real runs on the small humanoid: what moves, what is held, and how a run ends."""

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.failing_ticks import let_ticks_fail
from tests.problem.loading import problem_of as problem
from tests.texts import CHEAP
from wbc.cli.printing import print_result
from wbc.errors import ProblemFileError
from wbc.problem import RunStatus, load_problem
from wbc.qp.solution import Status
from wbc.spatial import vech

FLOATING = """\
robot: hoap2_like
support: floating
tasks:
  shape:
    {type: inertia, components: diagonal, frame: base, target: {scale: 1.02}, gain: 0.1, weight: 99}
  calm: {type: posture, weight: 1.0e-2}
stop: {duration: 2.0, speed: 1.0e-3, accept: {shape: 1.0e-3}}
"""
DOUBLE = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {offset: [0.01, 0.0, -0.02]}, ramp: 0.6, weight: 100}
  torso: {type: frame, frame: torso, control: orientation, target: start}
  calm: {type: posture, weight: 1.0e-2}
stop: {duration: 2.0, speed: 1.0e-3, accept: {com: 1.0e-3}}
"""


def test_floating_robot_grows(tmp_path: Path) -> None:
    one = problem(tmp_path, FLOATING)
    result = one.run()
    robot = one.parts.robot
    assert result.status is RunStatus.CONVERGED
    reading = result.inertia["shape"]
    np.testing.assert_allclose(reading.wanted, 1.02 * reading.start, rtol=1e-12)
    np.testing.assert_allclose(reading.reached, reading.wanted, atol=1e-3)
    # The reading is that of the final state, computed anew.
    end = robot.snapshot(result.q)
    np.testing.assert_allclose(reading.reached, np.diag(end.inertia_in("base")), atol=1e-15)
    # Base-frame inertia needs the joints only: damping leaves the base where it is.
    np.testing.assert_allclose(result.q[:3], one.parts.start[:3], atol=1e-6)
    assert result.slip is None
    assert not result.failures


def test_an_inertia_about_a_sole_is_told_as_such(tmp_path: Path, monkeypatch, capsys) -> None:
    text = DOUBLE.replace(
        "calm:",
        "shape: {type: inertia, components: [zz], about: left_sole, target: {scale: 0.95}}\n"
        "  calm:",
    )
    one = problem(tmp_path, text, {"stop.duration": 0.6})
    result, robot = one.run(), one.parts.robot
    reading = result.inertia["shape"]
    assert (reading.axes, reading.about) == ("world", "left_sole")
    for q, told in ((one.parts.start, reading.start), (result.q, reading.reached)):
        expected = robot.snapshot(q).inertia_in("world", "left_sole")[2, 2]
        np.testing.assert_allclose(told, [expected], rtol=1e-12)
    np.testing.assert_allclose(reading.wanted, 0.95 * reading.start)
    assert result.summary()["inertia"]["shape"]["about"] == "left_sole"
    monkeypatch.setenv("COLUMNS", "200")
    print_result(result, [])
    assert "shape: zz in world axes about left_sole" in capsys.readouterr().out


def test_history_is_the_run(tmp_path: Path) -> None:
    one = problem(tmp_path, FLOATING, {"stop.duration": 0.5, "stop.speed": None})
    result = one.run()
    history, robot = result.history, one.parts.robot
    assert len(history) == 100
    np.testing.assert_allclose(history.time, 0.005 * np.arange(100))
    assert history.q.shape == (100, robot.nq)
    assert history.v.shape == (100, robot.nv)
    np.testing.assert_array_equal(history.q[0], one.parts.start)
    for k in (0, 50, 98):  # each state follows from the one before
        np.testing.assert_allclose(
            robot.integrate(history.q[k], history.v[k], 0.005), history.q[k + 1], atol=1e-12
        )
    np.testing.assert_allclose(robot.integrate(history.q[-1], history.v[-1], 0.005), result.q)
    here = robot.snapshot(history.q[50])
    np.testing.assert_allclose(history.inertia[50], vech(here.inertia), atol=1e-14)
    np.testing.assert_allclose(
        history.task_inertia["shape"][50], vech(here.inertia_in("base")), atol=1e-14
    )
    np.testing.assert_allclose(history.com[50], here.com, atol=1e-14)
    wanted = result.inertia["shape"].wanted
    np.testing.assert_allclose(
        history.errors["shape"][50], np.diag(here.inertia_in("base")) - wanted, atol=1e-14
    )
    assert (history.tick_time > 0.0).all()
    assert (history.status == "solved").all()
    assert history.kkt.max() < 1e-6


def test_a_ramp_is_followed(tmp_path: Path) -> None:
    fixed = problem(tmp_path, DOUBLE.replace(", ramp: 0.6", "")).run().history.errors["com"]
    one = problem(tmp_path, DOUBLE)
    ramped = one.run().history.errors["com"]
    assert np.linalg.norm(fixed[0]) == pytest.approx(np.hypot(0.01, 0.02), rel=1e-9)
    # With its rate fed forward the target is never far away; without, it would lag by
    # rate * dt / gain = 1.875 * 0.022 m / 0.6 s * 0.005 s / 0.5 = 0.7 mm.
    assert np.linalg.norm(ramped, axis=1).max() < 2e-4


@pytest.mark.parametrize(
    "head", ["left", "[left_sole]", "[{frame: left_hand, type: point, gain: 1}]"]
)
def test_other_supports(tmp_path: Path, head: str) -> None:
    text = DOUBLE.replace("double", head)
    one = problem(tmp_path, text, {"stop.duration": 0.2, "tasks.com.ramp": None})
    result = one.run()
    assert result.slip is not None
    # m; the CoM target jumps, and an Euler step of a foot turning at speed drifts by its square.
    assert result.slip.value < 5e-4
    assert not result.failures


@pytest.mark.parametrize(
    "overrides",
    [
        {"controller": {"method": "pseudo_inverse", "damping": 1e-2}},
        {"limits": "none"},
        {"tasks.shape.components": "principal", "tasks.shape.target": "start"},
        {"tasks.shape.components": "trace", "tasks.shape.target": 0.22, "tasks.shape.ramp": 0.1},
        {"tasks.shape.second_order": True},
        {"tasks.spin": {"type": "momentum", "components": "angular", "weight": 0.1}},
    ],
)
def test_every_way_to_control(tmp_path: Path, overrides: dict[str, Any]) -> None:
    base = {"stop": {"duration": 0.2, "speed": None}}
    text = FLOATING
    if "tasks.shape.components" in overrides:
        text = text.replace(", frame: base", "")
    result = problem(tmp_path, text, {**base, **overrides}).run()
    assert result.status is RunStatus.COMPLETED
    assert len(result.history) == 40


def test_progress_is_told(tmp_path: Path) -> None:
    calls: list[tuple[int, int, float]] = []
    one = problem(tmp_path, FLOATING, {"stop": {"duration": 0.25, "speed": None}})
    one.run(lambda done, total, info: calls.append((done, total, info["time"])))
    assert [done for done, _, _ in calls] == [1, 11, 21, 31, 41, 50]
    assert all(total == 50 for _, total, _ in calls)
    assert calls[-1][2] == pytest.approx(49 * 0.005)


# A solver that contradicts itself on every tick: the controller then uses its declared policy.
@pytest.mark.parametrize(("policy", "ticks"), [("hold", 20), ("damp", 20), ("raise", 1)])
def test_failed_ticks_end_as_qp_failed(tmp_path, policy, ticks, monkeypatch) -> None:
    let_ticks_fail(monkeypatch, Status.CONTRADICTED)
    overrides = {"stop.duration": 0.1, "controller.on_failure": policy}
    result = problem(tmp_path, FLOATING, overrides).run()
    assert result.status is RunStatus.QP_FAILED
    assert len(result.history) == len(result.failures) == ticks  # standing still is not "at rest"
    assert result.failures[0].tick == 0
    assert "contradicted" in result.failures[0].report
    assert np.isnan(result.worst_kkt)


def test_a_gain_per_second_means_the_same_at_every_time_step(tmp_path: Path) -> None:
    text = """\
robot: hoap2_like
support: floating
tasks: {joint: {type: posture, target: {left_hip_roll: 0.01}, gain_per_second: 5.0}}
stop: {duration: 0.2, speed: null}
"""
    for dt in (0.005, 0.01):
        result = problem(tmp_path, text, {"controller.dt": dt}).run()
        first = float(np.linalg.norm(result.history.errors["joint"][0]))
        # exp(-5/s 0.2 s); the QP's damping of 1e-6 takes that part of each tick.
        assert result.tasks["joint"].norm == pytest.approx(np.exp(-1.0) * first, rel=1e-4)
    with pytest.raises(ProblemFileError, match=r"joint.gain_per_second: give gain or gain_per_sec"):
        problem(tmp_path, text, {"tasks.joint.gain": 0.5})


def test_a_problem_can_be_pickled_and_copied(tmp_path) -> None:
    """As for a pool of processes: the copy is the problem as it was loaded, values replaced."""
    path = tmp_path / "p.yaml"
    path.write_text(CHEAP)
    problem = load_problem(path, {"stop.duration": 0.03})
    for again in (pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):
        assert again.overrides == {"stop.duration": 0.03}
        np.testing.assert_array_equal(again.run().q, problem.run().q)
