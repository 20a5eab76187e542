"""Targets of a problem file as numbers, against SciPy and the robot itself; what ramps hand on."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.problem.loading import problem_of
from wbc.errors import UnknownNameError
from wbc.problem import Problem
from wbc.problem.kinds.com import ComSpec
from wbc.problem.kinds.frame import (
    AxisSpec,
    DistanceSpec,
    OrientationSpec,
    PoseSpec,
    PositionSpec,
    RelativePoseSpec,
)
from wbc.problem.kinds.inertia import InertiaSpec
from wbc.problem.kinds.posture import PostureSpec
from wbc.problem.kinds.rates import MomentumSpec
from wbc.problem.mistakes import Misplaced
from wbc.problem.task_spec import TaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import MinimumJerk, MovingTarget
from wbc.spatial import vech
from wbc.tasks import Task


def problem(
    folder: Path, task: str, head: str = "robot: hoap2_like\nsupport: floating\n"
) -> Problem:
    return problem_of(folder, f"{head}tasks:\n  it: {task}\n")


def built(folder: Path, task: str) -> tuple[Task, Snapshot]:
    parts = problem(folder, task).parts
    return parts.tasks[0], parts.robot.snapshot(parts.start)


def test_points(tmp_path: Path) -> None:
    task, start = built(tmp_path, "{type: com, target: {offset: [0.1, 0, -0.2]}}")
    np.testing.assert_allclose(task.target, start.com + [0.1, 0, -0.2])
    task, _ = built(tmp_path, "{type: com, target: [0.1, 0, 0.2]}")
    np.testing.assert_array_equal(task.target, [0.1, 0, 0.2])
    task, start = built(
        tmp_path, "{type: frame, frame: left_hand, control: position, axes: [z, x], target: start}"
    )
    assert task.rows == ("z", "x")
    np.testing.assert_array_equal(task.target, start.position("left_hand"))


def test_rotations(tmp_path: Path) -> None:
    frame = "type: frame, frame: torso, control: orientation"
    task, _ = built(tmp_path, f"{{{frame}, target: {{rpy: [0.3, -0.4, 1.2]}}}}")
    wanted = Rotation.from_euler("xyz", [0.3, -0.4, 1.2]).as_matrix()  # lower case: fixed axes
    np.testing.assert_allclose(task.target, wanted, atol=1e-15)
    task, _ = built(tmp_path, f"{{{frame}, target: {{quaternion: [1, 2, 3, 4]}}}}")
    np.testing.assert_allclose(
        task.target, Rotation.from_quat([1, 2, 3, 4]).as_matrix(), atol=1e-15
    )
    task, start = built(tmp_path, f"{{{frame}, target: start}}")
    np.testing.assert_array_equal(task.target, start.rotation("torso"))


def test_poses_and_axes(tmp_path: Path) -> None:
    pose = "type: frame, frame: left_hand, control: pose"
    task, start = built(tmp_path, f"{{{pose}, target: {{position: {{offset: [0, 0, 0.1]}}}}}}")
    np.testing.assert_allclose(task.position, start.position("left_hand") + [0, 0, 0.1])
    np.testing.assert_array_equal(task.rotation, start.rotation("left_hand"))
    task, start = built(tmp_path, f"{{{pose}, target: start}}")
    # The logarithm of R'R: rounding of a product of two rotations.
    np.testing.assert_allclose(task.residual(start).error, 0.0, atol=1e-15)
    axis = "type: frame, frame: left_hand, control: axis, axis: [0, 2, 0]"
    task, start = built(tmp_path, f"{{{axis}, target: start}}")
    np.testing.assert_allclose(task.target, start.rotation("left_hand")[:, 1], atol=1e-15)


def test_inertias(tmp_path: Path) -> None:
    def target(entries: str) -> tuple[np.ndarray, np.ndarray]:
        task, start = built(tmp_path, f"{{type: inertia, frame: base, {entries}}}")
        return task.target, vech(start.inertia_in("base"))

    wanted, start = target("target: start")
    np.testing.assert_array_equal(wanted, start)
    wanted, start = target("target: {scale: 1.5}")
    np.testing.assert_allclose(wanted, 1.5 * start)
    wanted, start = target("components: diagonal, target: {scale: [1, 2, 3]}")
    np.testing.assert_allclose(wanted[[0, 3, 5]], start[[0, 3, 5]] * [1, 2, 3])
    wanted, _ = target("target: [[3, 0.1, 0.2], [0.1, 4, 0.3], [0.2, 0.3, 5]]")
    np.testing.assert_array_equal(wanted, [3, 0.1, 0.2, 4, 0.3, 5])
    wanted, _ = target("components: trace, target: 0.6")
    assert wanted[[0, 3, 5]].sum() == pytest.approx(0.6, rel=1e-15)


@pytest.mark.parametrize("about", ["world", "left_sole", "[0.1, 0, 0.3]"])
def test_inertias_about_other_points(tmp_path: Path, about: str) -> None:
    text = f"{{type: inertia, about: {about}, target: {{scale: 1.5}}}}"
    task, start = built(tmp_path, text)
    point = (0.1, 0.0, 0.3) if about.startswith("[") else about
    assert task.about == point
    np.testing.assert_allclose(task.target, 1.5 * vech(start.inertia_in("world", point)))


def test_principal_moments(tmp_path: Path) -> None:
    task, start = built(tmp_path, "{type: inertia, components: principal, target: {scale: 2}}")
    np.testing.assert_allclose(task.target, 2 * np.linalg.eigvalsh(start.inertia), rtol=1e-12)
    task, _ = built(tmp_path, "{type: inertia, components: principal, target: [3, 1, 2]}")
    np.testing.assert_array_equal(task.target, [1, 2, 3])


def test_postures(tmp_path: Path) -> None:
    def joints(target: str, head: str = "") -> tuple[np.ndarray, Problem]:
        one = problem(
            tmp_path,
            f"{{type: posture, target: {target}}}",
            f"robot: hoap2_like\nsupport: floating\n{head}",
        )
        return one.parts.tasks[0].target[7:], one

    bent = "start: {joints: {waist_pitch: -0.4}}\n"
    at, one = joints("start", bent)
    robot = one.parts.robot
    waist = robot.joint_index("waist_pitch") - 6
    knees = [index - 6 for index in robot.joint_indices("*_knee_pitch")]
    assert at[waist] == -0.4
    np.testing.assert_array_equal(joints("standing", bent)[0], robot.posture("standing")[7:])
    expected = at.copy()
    expected[knees] = 0.7
    np.testing.assert_allclose(joints('{"*_knee_pitch": 0.7}', bent)[0], expected, atol=1e-15)


def test_momenta(tmp_path: Path) -> None:
    task, _ = built(tmp_path, "{type: momentum, components: [ky, lx], target: [2, 3]}")
    np.testing.assert_array_equal(task.target, [3, 0, 0, 0, 2, 0])
    task, _ = built(tmp_path, "{type: momentum, target: [1, 2, 3, 4, 5, 6]}")
    np.testing.assert_array_equal(task.target, [1, 2, 3, 4, 5, 6])


def test_accelerations_by_joint(tmp_path: Path) -> None:
    limits = 'limits: {velocity: 0.5, acceleration: {"*": 7, waist_pitch: 3}, braking: bounded}\n'
    parts = problem(
        tmp_path, "{type: posture}", f"robot: hoap2_like\nsupport: floating\n{limits}"
    ).parts
    waist = parts.robot.joint_index("waist_pitch") - 6
    assert parts.limits.acceleration[waist] == 3.0
    assert parts.limits.braking == "bounded"
    assert (np.delete(parts.limits.acceleration, waist) == 7.0).all()
    np.testing.assert_allclose(parts.limits.speed, 0.5 * parts.robot.limits.velocity)
    limits = "limits: {acceleration: {waist_pitch: 3}}\n"
    parts = problem(
        tmp_path, "{type: posture}", f"robot: hoap2_like\nsupport: floating\n{limits}"
    ).parts
    assert parts.limits.braking == "free"
    others = np.delete(parts.limits.acceleration, waist)
    np.testing.assert_allclose(others, np.delete(parts.robot.limits.velocity, waist) / 0.1)


def test_files_are_relative_to_the_problem(tmp_path: Path) -> None:
    from wbc.robot.library import find_robot

    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "mine.urdf").write_bytes(find_robot("hoap2_like").path.read_bytes())
    robot = "{model: models/mine.urdf, feet: {left: {link: left_foot}, right: {link: right_foot}}}"
    parts = problem(tmp_path, "{type: posture}", f"robot: {robot}\nsupport: right\n").parts
    assert parts.robot.path == tmp_path / "models" / "mine.urdf"
    assert len(parts.contacts) == 1


H = 1e-4
LOOP = {"loop": {"left_elbow_pitch": [-0.1, 0.0]}, "period": 1.0}
RPY = {"rpy": [0.6, -0.4, 0.9]}
PLACE = {"position": [0.3, 0.2, 0.9], "orientation": RPY}
PALM = {"type": "frame", "frame": "left_palm"}
SPECS: dict[str, TaskSpec] = {
    "com": ComSpec.model_validate({"type": "com", "target": [0.1, -0.2, 0.3]}),
    "position": PositionSpec.model_validate({**PALM, "control": "position", "target": [1, 0, 1]}),
    "orientation": OrientationSpec.model_validate(
        {**PALM, "control": "orientation", "target": RPY}
    ),
    "pose": PoseSpec.model_validate({**PALM, "control": "pose", "target": PLACE}),
    "axis": AxisSpec.model_validate({**PALM, "control": "axis", "target": [1, -2, 0.3]}),
    "relative pose": RelativePoseSpec.model_validate(
        {"type": "relative_pose", "frame": "left_palm", "relative_to": "right_palm"}
        | {"target": PLACE}
    ),
    "distance": DistanceSpec.model_validate(
        {"type": "distance", "frame": "left_palm", "other": "right_palm", "target": 0.5}
    ),
    "posture": PostureSpec.model_validate(
        {"type": "posture", "target": {"*_elbow_pitch": -0.6, "*_knee_pitch": 0.9}}
    ),
    "inertia": InertiaSpec.model_validate(
        {"type": "inertia", "components": "all", "target": {"scale": 1.4}}
    ),
    "principal inertia": InertiaSpec.model_validate(
        {"type": "inertia", "components": "principal", "target": {"scale": 1.2}}
    ),
}


@pytest.mark.parametrize("kind", SPECS)
def test_ramps_hand_on_rate_and_acceleration(kind: str, hoap2) -> None:
    """Against differences in time of the task's error at a robot that stands still."""
    start = hoap2.snapshot(hoap2.posture("standing"))
    assert SPECS[kind].build(kind, start).moving(start) is None
    one = SPECS[kind].model_copy(update={"ramp": 2.0}).build(kind, start)
    moving = one.moving(start)
    assert moving is not None and "ramp" in type(SPECS[kind]).model_fields

    def error(t: float) -> np.ndarray:
        moving.move_to(t)
        return one.task.residual(start).error

    for t in (0.3, 1.4):
        behind, middle, ahead = error(t - H), error(t), error(t + H)
        moving.move_to(t)
        rate, second = (ahead - behind) / (2 * H), (ahead - 2.0 * middle + behind) / H**2
        scale = np.abs(second).max()
        assert scale > 0.01  # it moves
        np.testing.assert_allclose(one.task.residual(start).bias, rate, atol=2e-6)
        np.testing.assert_allclose(one.task.drift(start), second, atol=1e-4 * max(scale, 1.0))
    moving.move_to(9.0)
    assert not one.task.residual(start).bias.any()


def test_a_loop_with_a_ramp_is_refused(hoap2) -> None:
    spec = PostureSpec.model_validate({"type": "posture", "ramp": 1.0, "target": LOOP})
    with pytest.raises(Misplaced, match="a loop says itself"):
        spec.build("posture", hoap2.snapshot(hoap2.posture("standing")))


def test_a_com_goes_over_several_feet(hoap2) -> None:
    """As a quadruped's that lifts one: before, only one foot, two or all could be said."""
    start = hoap2.snapshot(hoap2.posture("standing", {"left_hip_roll": 0.2}))
    places = [start.position(f"{side}_sole") for side in ("left", "right")]
    spec = ComSpec.model_validate({"type": "com", "target": {"over": ["left", "right"]}})
    goal = spec.build("com", start).goal(start, start.com)
    np.testing.assert_allclose(goal[:2], np.mean(places, axis=0)[:2], atol=1e-12)
    wrong = ComSpec.model_validate({"type": "com", "target": {"over": ["left", "rigth"]}})
    with pytest.raises(UnknownNameError, match="'rigth'; did you mean 'right'"):
        wrong.build("com", start)


def test_a_momentum_that_ramps_is_a_force(hoap2) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    spec = MomentumSpec.model_validate({"type": "momentum", "target": [1, 2, 3, 0.1, 0.2, 0.3]})
    one = spec.build("momentum", start)
    ramp = MinimumJerk(np.zeros(6), np.array(spec.target), 2.0)
    MovingTarget(ramp, one.set_target).move_to(1.0)
    # Half way a minimum-jerk ramp has its peak slope, 1.875 / duration (Flash and Hogan 1985).
    force = 1.875 / 2.0 * np.array(spec.target)
    np.testing.assert_allclose(one.task.target_rate, force)
    np.testing.assert_allclose(one.task.drift(start), -force, atol=1e-12)
