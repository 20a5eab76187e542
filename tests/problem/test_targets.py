"""Targets of a problem file as numbers, against SciPy and against the robot itself."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.problem.loading import problem_of
from wbc.problem import Problem
from wbc.robot import Snapshot
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
