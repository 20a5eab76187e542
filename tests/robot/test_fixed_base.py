"""Robots bolted to the world: which they are, and that they stay where they are."""

import logging
from pathlib import Path

import numpy as np
import pytest

from tests import urdf
from tests.problem.loading import problem_of
from tests.robot.formats import mjcf_texts as mjcf
from wbc import KinematicController, PositionTask, support
from wbc.errors import InvalidInputError
from wbc.robot import Robot


def arm(root: str = "world", floating: bool = False) -> str:
    names = [root, "shoulder", "elbow", "wrist"]
    parts = [urdf.link(name, mass=2, moment=0.02, at="0 0 0.1") for name in names]
    if root == "world":
        parts[0] = '<link name="world"/>'
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
        kind = "floating" if floating and k == 0 else "revolute"
        place = {"at": f"0 0 {0.3 * (k > 0)}", "axis": axis, "limit": urdf.limit(2, 50, 2)}
        parts.append(urdf.joint(f"j{k}", names[k], names[k + 1], kind=kind, **place))
    return urdf.robot("arm", *parts)


@pytest.mark.parametrize("root", ["world", "base"])
def test_a_root_called_world_or_base_is_fixed(root: str, caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot.load(arm(root))
    assert robot.fixed_base
    assert f"root link is called {root!r}" in robot.notes[-1]
    assert "feet" not in caplog.text  # a robot that is bolted down needs none
    floats = root == "world"  # as the file says then
    assert Robot.load(arm(root, floating=floats)).fixed_base is not floats


def test_a_root_that_carries_a_single_arm_is_fixed(caplog: pytest.LogCaptureFixture) -> None:
    upright = arm("plate_link0")
    robot = Robot.load(upright)
    assert robot.fixed_base
    assert "the root link carries a single arm and there are no feet" in robot.notes[-1]
    assert not caplog.records
    assert not Robot.load(upright, base="floating").fixed_base
    hopper = upright.replace('xyz="0 0 0.3"/><axis', 'xyz="0 0 -0.3"/><axis')
    two_arms = upright.replace('parent link="shoulder"', 'parent link="plate_link0"')
    for text in (hopper, two_arms):
        assert text != upright
        other = Robot.load(text)
        assert not other.fixed_base
        assert other.notes[0].startswith("no feet were found: ")


def test_the_base_is_what_is_asked_for(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert Robot.load(arm("pelvis"), base="fixed").fixed_base
    assert not caplog.records
    assert not Robot.load(arm(), base="floating").fixed_base
    with pytest.raises(InvalidInputError, match="base: expected floating or fixed, got 'bolted'"):
        Robot.load(arm(), base="bolted")


def test_a_fixed_base_stays() -> None:
    robot = Robot.load(arm())
    q = robot.posture("neutral", {"j1": 0.4, "j2": 0.5})
    start = robot.snapshot(q)
    target = robot.snapshot(robot.posture("neutral", {"j0": 0.5, "j1": 0.7})).position("wrist")
    task = PositionTask(robot, "wrist", target)
    controller = KinematicController(robot, [task], contacts=support(start, "floating"), dt=0.01)
    for _ in range(200):
        q = robot.integrate(q, controller.step(robot.snapshot(q)).velocity, 0.01)
    np.testing.assert_allclose(q[:7], start.q[:7], atol=1e-9)
    np.testing.assert_allclose(robot.snapshot(q).position("wrist"), target, atol=1e-4)  # m


def test_a_problem_file_may_fix_the_base(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(arm("pelvis"))
    text = (
        "robot: {model: arm.urdf, base: fixed}\nstart: {joints: {j1: 0.4, j2: 0.5}}\n"
        "tasks:\n  wrist:\n    {type: frame, frame: wrist, control: position,"
        " target: {offset: [0.05, 0.1, -0.05]}}\n"
        "stop: {duration: 2.0}\n"
    )
    history = problem_of(tmp_path, text).run().history
    np.testing.assert_allclose(history.q[-1][:7], history.q[0][:7], atol=1e-9)
    assert np.ptp(history.q[:, 7:], axis=0).max() > 0.05


def legs(trunk: str, shape: str) -> str:
    return "".join(
        urdf.link(f"{side}_foot", shape)
        + urdf.joint(f"{side}_hip", trunk, f"{side}_foot", at=f"0 {y} -0.5")
        for side, y in (("left", 0.1), ("right", -0.1))
    )


def test_a_root_without_mass_that_moves_by_a_joint_is_a_mount() -> None:
    # Floating, it would move twice along the joint: planar walkers are drawn so.
    sole = urdf.collision('box size=".2 .1 .04"')
    ends = urdf.joint("ahead", "rail", "slider", kind="prismatic", axis="1 0 0")
    ends += urdf.joint("up", "slider", "trunk", kind="prismatic", axis="0 0 1")
    empty = '<link name="rail"/><link name="slider"/>'
    text = urdf.robot("walker", empty, urdf.link("trunk"), ends, legs("trunk", sole))
    robot = Robot.load(text)
    assert robot.fixed_base and {*robot.feet} == {"left", "right"}
    assert np.linalg.eigvalsh(robot.snapshot(robot.posture()).mass_matrix[6:, 6:])[0] > 1e-3
    (note,) = (note for note in robot.notes if note.startswith("the base is fixed"))
    assert "the root has no mass and moves by a joint; base: floating" in note
    assert not Robot.load(text, base="floating").fixed_base
    assert Robot.load(text.replace("_foot", "_end").replace(sole, "")).fixed_base  # without feet


def test_a_bolted_root_that_floats_for_its_feet_is_noted() -> None:
    text = mjcf.text(mjcf.LEGS, root=mjcf.TRUNK.replace("<freejoint/>", ""))
    robot = Robot.load(text)
    assert not robot.fixed_base
    said = "the base floats, as there are feet, though the root has no free joint"
    assert f"{said}; base: fixed bolts it" in robot.notes
    for kept in ({"base": "floating"}, {"base": "fixed"}):
        assert not any("bolts it" in note for note in Robot.load(text, **kept).notes)


def test_a_base_with_feet_that_have_no_shapes_floats() -> None:
    robot = Robot.load(urdf.robot("biped", urdf.link("base"), legs("base", "")))
    assert not robot.fixed_base
    assert any("no shapes to find soles from on left_foot, right_foot" in n for n in robot.notes)
