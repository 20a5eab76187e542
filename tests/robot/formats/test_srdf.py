"""SRDF: states of several groups, values that are none, and what the robot does not have."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.formats.srdf import read_srdf

URDF = urdf.robot(
    "r",
    *(urdf.link(name, at="0 0 .1") for name in ("base", "l1", "l2", "l3")),
    urdf.joint("j1", "base", "l1"),
    urdf.joint("j2", "l1", "l2"),
    urdf.joint("spin", "l2", "l3", kind="continuous"),
)


def load(folder: Path, content: str) -> Robot:
    (folder / "r.urdf").write_text(URDF)
    (folder / "r.srdf").write_text(f'<robot name="r">{content}</robot>')
    return Robot.load(folder / "r.urdf", srdf=folder / "r.srdf", base="fixed")


def state(name: str, group: str, **values: object) -> str:
    joints = "".join(f'<joint name="{joint}" value="{v}"/>' for joint, v in values.items())
    return f'<group_state name="{name}" group="{group}">{joints}</group_state>'


@pytest.mark.parametrize(
    "states",
    [
        state("home", "arm", j1=0.5) + state("home", "hand", j2=0.8),
        state("home", "hand", j2=0.8) + state("home", "arm", j1=0.5),
        state("home", "all", j1=0.5, j2=0.8) + state("home", "hand", j2=0.8),
        state("home", "a", j1=0.5) + state("away", "a", j1=0.1) + state("home", "b", j2=0.8),
    ],
)
def test_states_of_one_name_of_several_groups_are_one(tmp_path: Path, states: str) -> None:
    robot = load(tmp_path, states)
    np.testing.assert_allclose(robot.postures["home"][7:9], [0.5, 0.8])
    assert not any("SRDF" in note for note in robot.notes)


def test_groups_that_contradict_each_other_are_said(tmp_path: Path) -> None:
    robot = load(tmp_path, state("home", "a", j1=0.5, j2=0.1) + state("home", "b", j1=0.7))
    np.testing.assert_allclose(robot.postures["home"][7:9], [0.7, 0.1])
    assert "SRDF, state 'home': groups give different values of j1; the last counts" in robot.notes


@pytest.mark.parametrize("joint", ["j1", "j2"])
def test_two_values_are_of_continuous_joints_only(tmp_path: Path, joint: str) -> None:
    said = rf"r\.srdf: state 'home', joint '{joint}': '0.5 0.2': two"
    with pytest.raises(ModelError, match=said):
        load(tmp_path, state("home", "a", **{joint: "0.5 0.2"}))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (state("home", "a", spin="2 0"), r"no \(cos, sin\): its squares sum to 4"),
        (state("home", "a", spin="0 0"), r"no \(cos, sin\): its squares sum to 0"),
        ('<group_state group="all"><joint name="j1" value="0.5"/></group_state>', "without name"),
        ('<xacro:arm xmlns:xacro="http://ros.org/wiki/xacro"/>', "is left of a xacro file"),
        (state("home", "a", j1="$(arg bend)"), "is left of a xacro file"),
        (state("home", "a", j1=""), "joint 'j1': '' is neither one number nor"),
    ],
)
def test_what_is_no_configuration_is_refused(tmp_path: Path, content: str, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        load(tmp_path, content)


def test_a_urdf_is_no_srdf(tmp_path: Path) -> None:
    """It was read as one that says nothing."""
    with pytest.raises(ModelError, match="is it the URDF itself"):
        load(tmp_path, '<link name="base"/>' + state("home", "all", j1=0.5))


def test_a_continuous_joint_takes_one_value_or_two(tmp_path: Path) -> None:
    for value in ("0.6435011087932844", "0.8 0.6"):
        robot = load(tmp_path, state("home", "a", spin=value))
        np.testing.assert_allclose(robot.postures["home"][-2:], [0.8, 0.6], atol=1e-12)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (state("home", "a", elbow=0.5), "state 'home': the robot has no joint elbow"),
        (state("home", "a", elbow="0.5 0.2", j1=0.1), "state 'home': the robot has no joint elbow"),
        ('<disable_collisions link1="l1" link2="nothing"/>', "the robot has no link nothing"),
        ('<disable_default_collisions link="nothing"/>', "the robot has no link nothing"),
        ('<passive_joint name="elbow"/>', "passive_joint: the robot has no joint elbow"),
        ('<passive_joint name="j2"/>', "passive_joint: torques are asked of j2 all the same"),
    ],
)
def test_what_is_not_used_is_said(tmp_path: Path, content: str, said: str) -> None:
    assert any(said in note for note in load(tmp_path, content).notes)


def test_links_that_are_not_watched_but_with_some(tmp_path: Path) -> None:
    """MoveIt's defaults by link: all pairs of it are off but those that are switched on again."""
    content = '<disable_default_collisions link="l1"/><enable_collisions link1="l2" link2="l1"/>'
    robot = load(tmp_path, content + '<disable_collisions link1="l3" link2="l2"/>')
    links = {str(f.name) for f in robot.model.frames if f.type == pin.FrameType.BODY}
    wanted = {frozenset(("l1", other)) for other in links - {"l1", "l2"}}
    wanted.add(frozenset(("l2", "l3")))
    assert robot.srdf is not None
    assert read_srdf(robot.srdf, robot.model).disabled == wanted
    assert not any("SRDF" in note for note in robot.notes)


BASE = "0 0 1 0 0 0 1"


@pytest.mark.parametrize(
    "content",
    [
        state("home", "a", world_joint=BASE, root_joint=BASE),
        '<group name="g"/><end_effector name="e"/><rotor_params/><virtual_joint type="floating"/>',
    ],
)
def test_the_base_of_a_state_and_elements_of_other_programs_are_no_mistakes(
    tmp_path: Path, content: str
) -> None:
    assert not any("SRDF" in note for note in load(tmp_path, content).notes)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('<group_stat name="home" group="g"/>', "<group_stat> (is 'group_state' meant?)"),
        ('<disable_collision link1="l1" link2="l3"/>', "(is 'disable_collisions' meant?)"),
        ('<group_state name="home"><Joint name="j1" value="1"/></group_state>', "<Joint> in state"),
        ('<virtual_joint type="fixed" child_link="base"/>', "<virtual_joint> of type 'fixed'"),
        (f"<group name='g'>{state('home', 'g', j1=1)}</group>", "<group_state> inside <group>"),
    ],
)
def test_what_looks_as_if_it_should_be_read_is_told(tmp_path, content: str, told: str) -> None:
    (note,) = [note for note in load(tmp_path, content).notes if note.startswith("SRDF")]
    assert told in note


def test_neutral_has_joints_at_zero_whatever_the_file_calls_so(tmp_path: Path) -> None:
    robot = load(tmp_path, state("neutral", "g", j1=0.5))
    np.testing.assert_array_equal(robot.posture("neutral")[7:9], [0.0, 0.0])
    np.testing.assert_array_equal(robot.posture("neutral_2")[7:9], [0.5, 0.0])
    assert any("is called 'neutral_2'" in note for note in robot.notes)


def test_rotors_are_told(tmp_path: Path) -> None:
    rotor = '<rotor_params><joint name="j1" mass="1e-5" gear_ratio="100"/></rotor_params>'
    (note,) = (note for note in load(tmp_path, rotor).notes if "rotor" in note)
    assert note.startswith("SRDF, not read: rotors' inertia") and note.endswith("of j1")


def test_files_may_be_in_a_home_and_are_found_from_elsewhere(tmp_path: Path, monkeypatch) -> None:
    """Pairs of links are read when margins are made, wherever the program is by then."""
    monkeypatch.setenv("HOME", str(tmp_path))
    load(tmp_path, state("home", "arm", j1=0.5))
    robot = Robot.load("~/r.urdf", srdf="~/r.srdf", base="fixed")
    assert robot.posture("home", on_ground=False)[7] == 0.5
    monkeypatch.chdir(tmp_path)
    robot = Robot.load("r.urdf", srdf="r.srdf", base="fixed")
    monkeypatch.chdir("/")
    assert robot.srdf is not None and robot.srdf.samefile(tmp_path / "r.srdf")


def test_folders_of_packages_may_be_in_a_home(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "away" / "mine").mkdir(parents=True)
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "away" / "mine" / "m.obj").write_text(corners)
    mesh = urdf.collision('mesh filename="package://mine/m.obj"')
    robot = Robot.load(urdf.robot("r", urdf.link("base", mesh)), package_dirs=["~/away"])
    assert robot.collision_model.ngeoms == 1
