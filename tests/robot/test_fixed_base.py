"""Robots bolted to the world stay where they are; postures meet the gears of mimic joints."""

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
from wbc.tasks import PostureTask


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


GEARED = urdf.robot(
    "geared",
    *map(urdf.link, ("trunk", "upper", "lower", "tip")),
    urdf.joint("j1", "trunk", "upper"),
    urdf.joint("j3", "lower", "tip"),
    urdf.joint("j2", "upper", "lower", '<mimic joint="j1" multiplier="-2" offset="0.1"/>'),
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(GEARED)


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"j1": 0.3}, [0.3, -0.5, 0.0]),
        ({"j2": 0.3}, [-0.1, 0.3, 0.0]),  # before, 0.3 was dropped without a word
        ({"j1": 0.3, "j2": -0.5}, [0.3, -0.5, 0.0]),
        ({"j*": 0.2}, [0.2, -0.3, 0.2]),
        ({"j3": 0.5}, [0.0, 0.1, 0.5]),
    ],
)
def test_named_joint_of_a_gear_moves_the_other(robot, given, found) -> None:
    np.testing.assert_allclose(robot.posture("neutral", given)[7:], found, atol=1e-9)


@pytest.mark.parametrize("given", [{"j1": 0.9}, {"j1": 0.3, "j2": 0.5}])
def test_gear_that_cannot_be_met_is_refused_by_name(robot: Robot, given: dict[str, float]) -> None:
    """At 0.9 the follower would have to be at -1.7, beyond its limit."""
    with pytest.raises(InvalidInputError, match="'j2' cannot follow 'j1' to -"):
        robot.posture("neutral", given)


@pytest.mark.parametrize(("joint", "found"), [("j1", [0.3, -0.5, 0.0]), ("j2", [-0.1, 0.3, 0.0])])
def test_posture_target_of_a_problem_names_either_end_of_a_gear(tmp_path, joint, found) -> None:
    (tmp_path / "geared.urdf").write_text(GEARED)
    target = f"{{type: posture, target: {{{joint}: 0.3}}}}"
    (task,) = problem_of(tmp_path, f"robot: geared.urdf\ntasks: {{p: {target}}}\n").parts.tasks
    assert isinstance(task, PostureTask)
    np.testing.assert_allclose(task.target[7:], found, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "set_to"),
    [
        ({"j1": 0.3, "j2": 0.5}, "j2 at -0.5, not 0.5"),
        ({"j2": -0.5}, "j2 at 0.1, not -0.5"),
        ({"j1": 0.3, "j2": -0.5002}, ""),  # rounded in the file
        ({"j1": 0.3}, ""),
    ],
)
def test_state_of_a_file_that_is_off_a_gear_is_noted(tmp_path, values, set_to) -> None:
    joints = "".join(f'<joint name="{key}" value="{value}"/>' for key, value in values.items())
    file = tmp_path / "r.srdf"
    file.write_text(f'<robot name="r"><group_state name="bent">{joints}</group_state></robot>')
    notes = [note for note in Robot.load(GEARED, srdf=file).notes if "'bent'" in note]
    told = "posture 'bent': joints follow their drivers in place of the file's values: "
    assert notes == [told + set_to] * bool(set_to)


def test_key_frame_that_is_off_an_equality_constraint_is_noted() -> None:
    second = mjcf.arm(name="b").replace("j1", "j2")
    tail = '<equality><joint joint1="j2" joint2="j1" polycoef=".1 -2 0 0 0"/></equality>'
    tail += '<keyframe><key name="bent" qpos="0 0 1 1 0 0 0 .3 .5"/></keyframe>'
    robot = Robot.load(mjcf.text(mjcf.arm() + second, tail=tail))
    assert [note[-20:] for note in robot.notes if "'bent'" in note] == [" j2 at -0.5, not 0.5"]


def test_a_point_mass_on_a_rail_loads() -> None:
    """Its inertia about its own place is 0, of which no difference is a part."""
    joint = urdf.joint("x", "world", "mass", kind="prismatic", axis="1 0 0")
    robot = Robot.load(urdf.robot("r", '<link name="world"/>', urdf.link("mass", moment=0), joint))
    q = np.append(robot.posture()[:7], 0.5)
    s = robot.snapshot(q)
    np.testing.assert_allclose(s.com, (0.5, 0, 0))
    np.testing.assert_allclose(s.inertia, 0.0, atol=1e-15)
    np.testing.assert_allclose(s.mass_matrix[6:, 6:], 1.0)
