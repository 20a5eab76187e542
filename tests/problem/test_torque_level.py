"""``controller: {level: torque}``: what is built of it; weights of joints, singular tasks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import complaint_of, problem_of
from wbc.constraints import FrictionCone
from wbc.controllers import TorqueController
from wbc.errors import InvalidInputError, ProblemFileError
from wbc.laws import AccelerationLaw
from wbc.problem import Problem

STAND = """\
robot: {model: hoap2_like, armature: 0.003}
support: double
tasks:
  com: {type: com, axes: [x, y], target: start, law: capture_point, weight: 30}
  height: {type: com, axes: [z], target: start, kp: 50}
  torso: {type: frame, frame: base, control: orientation, target: start, kp: 50, kd: 9}
  spin: {type: momentum, components: angular, weight: 0.3, kd: 4}
  calm: {type: damping, weight: 0.01}
  posture: {type: posture, weight: 0.3}
controller: {level: torque, solver: proxqp, friction: 0.5, torque_limits: 0.9, force_damping: 0.02}
"""


def problem(folder: Path, text: str = STAND, overrides: dict[str, Any] | None = None) -> Problem:
    return problem_of(folder, text, overrides)


def test_a_file_makes_the_controller_that_python_makes(tmp_path: Path) -> None:
    one = problem(tmp_path)
    controller = one.executor().controller
    assert isinstance(controller, TorqueController)
    robot, start = one.parts.robot, one.parts.robot.snapshot(one.parts.start)
    assert controller.dt == 0.002
    assert controller.force_damping == 0.02
    np.testing.assert_allclose(controller.torque_bounds, 0.9 * robot.limits.effort)
    laws = {task.name: task.acceleration_law for task in controller.tasks}
    assert laws["com"] == AccelerationLaw.capture_point(float(start.com[2]))
    assert laws["height"] == AccelerationLaw(50.0)
    assert laws["torso"] == AccelerationLaw(50.0, 9.0)
    assert laws["spin"].kd == 4.0
    assert laws["calm"] == laws["posture"] == AccelerationLaw()
    assert {contact.friction for contact in one.parts.contacts} == {FrictionCone(0.5)}
    np.testing.assert_array_equal(robot.model.armature[6:], 0.003)


def test_a_capture_point_moves_by_the_gravity_of_the_robot(tmp_path: Path) -> None:
    file = '<mujoco><option gravity="0 0 -1.62"/><worldbody><body name="b" pos="0 0 0.5">'
    file += '<freejoint/><geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    (tmp_path / "moon.xml").write_text(file)
    text = "robot: {model: moon.xml}\nsupport: floating\ncontroller: {level: torque}\ntasks:\n"
    one = problem(
        tmp_path, f"{text}  com: {{type: com, axes: [x, y], target: start, law: capture_point}}\n"
    )
    (com,) = one.executor().controller.tasks
    height = float(one.parts.robot.snapshot(one.parts.start).com[2])
    assert com.acceleration_law == AccelerationLaw.capture_point(height, gravity=1.62)


def test_a_first_tick_is_solved_and_stands_still(tmp_path: Path) -> None:
    one = problem(tmp_path)
    tick = one.executor().controller.step(one.parts.robot.snapshot(one.parts.start))
    assert tick.ok
    assert not tick.policy
    # Everything is at its target at rest, so that nothing should move.
    np.testing.assert_allclose(tick.velocity, 0.0, atol=1e-4)


def test_contacts_say_what_they_bear(tmp_path: Path) -> None:
    listed = (
        "support: [left_sole, {frame: right_sole, kp: 30, kd: 7, corners: [[0.01, 0]], friction:"
        " {coefficient: 0.7, facets: 8, inner: false, least: 1, most: 50}}]"
    )
    left, right = problem(tmp_path, STAND.replace("support: double", listed)).parts.contacts
    assert left.friction == FrictionCone(0.5)
    assert right.friction == FrictionCone(0.7, 8, inner=False, least=1.0, most=50.0)
    assert right.acceleration_law == AccelerationLaw(30.0, 7.0)
    assert left.acceleration_law == AccelerationLaw(left.STIFFNESS)
    np.testing.assert_array_equal(right.corners, [[0.01, 0.0, 0.0]])
    grip = STAND.replace("double", "[left_sole, {frame: right_sole, friction: grip}]")
    assert problem(tmp_path, grip).parts.contacts[1].friction is None


def test_phases_switch_contacts_with_their_friction(tmp_path: Path) -> None:
    phases = "phases:\n  both: {duration: 0.1}\n  left: {duration: 0.1, support: left}\n"
    one = problem(tmp_path, STAND + phases)
    start = one.parts.robot.snapshot(one.parts.start)
    executor = one.executor()
    first = executor.controller
    before = list(first.contacts)
    later = executor.update(50, start)
    assert isinstance(later, TorqueController)
    assert later is first  # warm starts and forces go on
    assert [contact.frame for contact in before] == ["left_sole", "right_sole"]
    assert [contact.frame for contact in later.contacts] == ["left_sole"]
    assert later.contacts[0] is before[0]  # it goes on, with its anchor
    assert later.contacts[0].friction == FrictionCone(0.5)


CONTROLLER = STAND.splitlines(keepends=True)[-1]
MISTAKES = [
    ("kp: 50}", "gain: 0.1}", "p.yaml:5: tasks.height.gain: belongs to the velocity level; at the"),
    ("target: start, kp: 50}", "target: start, lm_damping: 1}",
     "height.lm_damping: belongs to the"),
    (CONTROLLER, "", "p.yaml:4: tasks.com.law: belongs to the torque level; give controller"),
    ("level: torque, ", "", "p.yaml:10: controller.friction: belongs to the torque level; give le"),
    ("level: torque, ", "level: torqe, ", "controller.level: 'torqe' does not exist; did you mean"),
    ("solver: proxqp", "starts: 3", "p.yaml:10: controller.starts: belongs to the method global"),
    ("solver: proxqp", "method: global", "pseudo_inverse are of the velocity level, got 'torque'"),
    ("solver: proxqp", "on_failure: hold", "controller.on_failure: 'hold' does not exist"),
    ("friction: 0.5", "friction: {facets: 2}", "controller.friction.facets: must be at least 3"),
    ("friction: 0.5", "friction: {facet: 8}", "friction.facet: unknown key; did you mean 'facets'"),
    ("friction: 0.5", "friction: {least: 2, most: 1}",
     "p.yaml:10: controller.friction.most: must not be below least, got 1"),
    ("friction: 0.5", "friction: low", "controller.friction: expected a coefficient, or {coeff"),
    ("law: capture_point", "law: capture_piont",
     "com.law: 'capture_piont' does not exist; did you"),
    ("law: capture_point", "law: capture_point, kd: 3", "tasks.com.kd: give kd or law, not both"),
    ("axes: [x, y], ", "", "tasks.com.law: a capture point is on the ground; give axes: [x, y]"),
    ("double", "[{frame: torso}]", "torso"),  # no sole: its corners are not known
    ("double", "[{frame: left_sole, gain: 0.2}]", "support[0].gain: belongs to the velocity level"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_mistakes_are_told_with_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in STAND
    text = STAND.replace(old, new, 1)
    assert words in complaint_of(tmp_path, text)


def test_contacts_of_the_velocity_level_bear_nothing(tmp_path: Path) -> None:
    text = (
        "robot: hoap2_like\nsupport: [{frame: left_sole, friction: 0.5}]\n"
        "tasks:\n  com: {type: com, target: start}\n"
    )
    words = "p.yaml:2: support[0].friction: belongs to the torque level; give controller"
    assert words in complaint_of(tmp_path, text)


def test_a_run_says_that_torques_are_simulated(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"level is torque.*wbc sim .*p\.yaml"):
        problem(tmp_path).run()


TEXT = """robot: g1_27
start: {posture: standing}
support: double
limits: none
controller: {method: METHOD, damping: 1e-6, joint_weights: {"*": 2, "*wrist*": 10, base: 100}}
tasks:
  com: {type: com, target: {offset: [0, 0, 0.1]}, ramp: 1.0, weight: 10, singular_threshold: 0.08}
  posture: {type: posture, target: start, weight: 0.01, gain: 0.1, singular_threshold: 0.001}
  still: {type: momentum, weight: 1e-4, singular_threshold: 0.01}
stop: {duration: 1.5, speed: null}
"""


def load(tmp_path: Path, text: str, **overrides):
    return problem_of(tmp_path, text, overrides)


@pytest.mark.parametrize("method", ["qp", "pseudo_inverse"])
def test_both_reach_the_controller(tmp_path: Path, method: str) -> None:
    loaded = load(tmp_path, TEXT.replace("METHOD", method))
    parts, start = loaded.parts, loaded.parts.robot.snapshot(loaded.parts.start)
    controller = parts.controller(loaded.spec.controller, parts.tasks, parts.contacts, start)
    names = parts.robot.joint_names
    expected = [100.0] * 6 + [10.0 if "wrist" in name else 2.0 for name in names]
    np.testing.assert_array_equal(controller.joint_weights, expected)
    assert [task.singular_threshold for task in parts.tasks] == [0.08, 0.001, 0.01]
    assert controller.step(start).singular.keys() == {"com", "posture", "still"}


def test_joints_do_not_race_towards_a_height_out_of_reach(tmp_path: Path) -> None:
    """A plain text without joint weights; the only difference between the runs is the threshold."""
    text = TEXT.replace("METHOD", "qp").replace(", singular_threshold: 0.001", "")
    text = text.replace('joint_weights: {"*": 2, "*wrist*": 10, base: 100}', "dt: 0.005")
    text = text.replace("  still: {type: momentum, weight: 1e-4, singular_threshold: 0.01}\n", "")
    fastest = {}
    for least in (0.0, 0.08):
        result = load(tmp_path, text, **{"tasks.com.singular_threshold": least}).run()
        assert not result.failures
        fastest[least] = np.abs(result.history.v[:, 6:]).max()
    assert fastest[0.08] < 0.5 * fastest[0.0]


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("controller.joint_weights", {"*wirst*": 2}, "unknown joint '*wirst*'"),
        ("controller.joint_weights", {"base": 0}, "greater than 0"),
        ("tasks.com.singular_threshold", -0.1, "must be at least 0"),
        ("tasks.still.singular_threshold", "small", "number"),
    ],
)
def test_mistakes_have_their_lines(tmp_path: Path, key: str, value: object, said: str) -> None:
    with pytest.raises(ProblemFileError) as caught:
        load(tmp_path, TEXT.replace("METHOD", "qp"), **{key: value})
    assert said in str(caught.value)
    assert key in str(caught.value)


def test_an_unknown_joint_is_named_with_its_line(tmp_path: Path) -> None:
    text = TEXT.replace("METHOD", "qp").replace("*wrist*", "left_wirst_yaw_joint")
    with pytest.raises(ProblemFileError) as caught:
        load(tmp_path, text)
    assert "did you mean 'left_wrist_yaw_joint'" in str(caught.value)
    assert "p.yaml:5: controller.joint_weights" in str(caught.value)
