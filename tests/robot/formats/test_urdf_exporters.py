"""URDFs as exporters leave them: mended, refused, or passed over, but not in silence."""

from pathlib import Path

import numpy as np
import pytest

from tests import urdf as toy
from tests.urdf import joint, link, robot
from wbc.constraints import Limits, SelfCollision
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.formats import urdf

SHAPE = (
    '<collision><origin xyz="0 0 -.1"/><geometry><sphere radius=".03"/></geometry></collision>'
    '<visual><origin xyz="0 0 -.1"/><geometry><sphere radius=".03"/></geometry>{0}</visual>'
)
LIMIT = toy.limit(effort=20)
J = joint("j", "trunk", "upper", '<dynamics damping="1"/>', at="0 0 .2")
F = '<joint name="f" type="fixed"><parent link="upper"/><child link="lower"/></joint>'
ARM = robot("arm", *map(link, ("trunk", "upper", "lower")), J, F)


def chain(
    material: str = "",
    limit: str = LIMIT,
    kind: str = "revolute",
    head: str = "",
    names: tuple[str, str, str] = ("j1", "j2", "j3"),
) -> str:
    """A chain of four links; the last three have a ball each."""
    shape = SHAPE.format(material)
    links = "".join(toy.link(f"l{k}", shape if k else "", at="0 0 -.1") for k in range(4))
    joints = "".join(
        toy.joint(name, f"l{k}", f"l{k + 1}", kind=kind, at="0 0 -.3", limit=limit)
        for k, name in enumerate(names)
    )
    xacro = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    return f'<robot name="r" {xacro}>{head}{links}{joints}</robot>'


def bolted(text: str = "", **parts: object) -> Robot:
    return Robot.load(text or chain(**parts), base="fixed")


COLOUR = '<color rgba="1 0 0 1"/>'


@pytest.mark.parametrize(
    ("material", "head"),
    [
        (f"<material>{COLOUR}</material>", ""),
        (f'<material name="">{COLOUR}</material>', ""),
        (f'<material name="red">{COLOUR}</material>', f"<material>{COLOUR}</material>"),
        ("<material/>", ""),
    ],
)
def test_shapes_of_links_with_nameless_materials_are_there(material: str, head: str) -> None:
    robot = bolted(material=material, head=head)
    assert (robot.collision_model.ngeoms, robot.visual_model.ngeoms) == (3, 3)
    found, whole = (SelfCollision(one, margin=0.01).model.labels for one in (robot, bolted()))
    assert found == whole == ("l1 vs l3",)


def test_shapes_that_the_parser_loses_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    # What mends the only such case.
    monkeypatch.setattr(urdf, "complete_materials", lambda root: ())
    with pytest.raises(ModelError, match=r"link 'l1' has 1 collision shapes, but 0 were read"):
        Robot.load(chain("<material/>"))


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ('<xacro:include filename="leg.xacro"/>', "<xacro:include>"),
        ('<xacro:leg side="left"/>', "<xacro:leg>"),
        ('<xacro:property name="x" value="1"/>', "<xacro:property>"),
        ('<link name="${prefix}hand"/>', "name='${prefix}hand'"),
        ('<link name="$(arg side)_hand"/>', "name='$(arg side)_hand'"),
        ('<material name="m"><texture filename="$(find x)/m.png"/></material>', "$(find x)"),
    ],
)
def test_macros_that_were_not_expanded_are_refused(head: str, said: str) -> None:
    with pytest.raises(ModelError) as caught:
        Robot.load(chain(head=head))
    assert said in str(caught.value) and "expand that first" in str(caught.value)


@pytest.mark.parametrize(
    "value",
    ["1e10", "1e16", "1e30", "3.4028235e38", "1e300", "1.7976931348623157e308", "inf", "Infinity"],
)
def test_numbers_that_stand_for_no_limit_are_none(value: str) -> None:
    robot = bolted(limit=toy.limit(value, value, value))
    for found in (robot.limits.upper, robot.limits.velocity, robot.limits.effort):
        np.testing.assert_array_equal(found, np.inf)
    np.testing.assert_array_equal(robot.limits.lower, -np.inf)
    assert np.isinf(Limits(robot).speed).all()


@pytest.mark.parametrize("zero", ["0", "0.0", "-0.0", "0e0"])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_limits_that_are_all_zero_were_not_entered(zero: str, kind: str) -> None:
    limit = f'<limit lower="{zero}" upper="{zero}" velocity="{zero}" effort="{zero}"/>'
    robot = bolted(limit=limit, kind=kind)
    np.testing.assert_array_equal(robot.limits.upper, np.inf)
    assert any("limits of j1, j2, j3 are all 0" in note for note in robot.notes)
    meant = limit.replace(f'effort="{zero}"', 'effort="20"')  # a joint that is held
    np.testing.assert_array_equal(bolted(limit=meant, kind=kind).limits.upper, 0.0)


@pytest.mark.parametrize(
    ("turn", "told"), [("6.2831853", False), ("9.42477796", False), ("12.566", False), ("90", True)]
)
def test_joints_of_more_than_some_turns_may_be_in_degrees(turn: str, told: bool) -> None:
    notes = bolted(limit=toy.limit(turn, 20)).notes
    assert any("degrees" in note for note in notes) == told


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n"


def test_a_pointer_of_git_lfs_is_called_so(tmp_path: Path) -> None:
    (tmp_path / "m.stl").write_text(POINTER)
    mesh = toy.collision(f'mesh filename="{tmp_path / "m.stl"}"')
    notes = bolted(chain().replace("</link>", mesh + "</link>", 1)).notes
    assert any("m.stl (a Git LFS pointer: git lfs pull) of link 'l0'" in note for note in notes)
    (tmp_path / "r.urdf").write_text(POINTER)
    with pytest.raises(ModelError, match=r"r\.urdf: a Git LFS pointer"):
        Robot.load(tmp_path / "r.urdf")


@pytest.mark.parametrize("names", [("l1", "j2", "j3"), ("l3", "l1", "l2"), ("j1", "l2", "j3")])
def test_joints_may_be_called_as_links_are(names: tuple[str, str, str]) -> None:
    whole = Robot.load(chain(), base="fixed", locked={"j3": 0.2, "j1": -0.1})
    held = {names[2]: 0.2, names[0]: -0.1}
    robot = Robot.load(chain(names=names), base="fixed", locked=held)
    assert robot.joint_names == (names[1],)
    q = robot.posture("neutral", {names[1]: 0.4})
    one, other = robot.snapshot(q), whole.snapshot(whole.posture("neutral", {"j2": 0.4}))
    for body in ("l1", "l2", "l3"):
        np.testing.assert_allclose(one.position(body), other.position(body), atol=1e-15)
    np.testing.assert_allclose(one.com, other.com, atol=1e-15)


@pytest.mark.parametrize(("reach", "told"), [("1.5", True), ("3.14", False), ("9.42", False)])
def test_a_range_of_a_continuous_joint_is_told(reach: str, told: bool) -> None:
    robot = bolted(limit=toy.limit(reach, 20), kind="continuous")
    assert np.isinf(robot.limits.upper).all()
    note = "ranges of continuous joints, which URDF gives none, are not used: j1, j2, j3"
    assert (note in robot.notes) == told


def note_of(text: str) -> str:
    notes = [note for note in Robot.load(text).notes if "URDF does not know" in note]
    assert len(notes) <= 1
    return "".join(notes)


@pytest.mark.parametrize(
    ("right", "wrong", "told", "meant"),
    [
        ("<limit lower", "<Limit lower", "<Limit> of joint 'j'", "limit"),
        ("upper=", "uper=", "'uper' in <limit> of joint 'j'", "upper"),
        ('<origin xyz="0 0 .2"/>', '<orign xyz="0 0 .2"/>', "<orign> of joint 'j'", "origin"),
        ('<origin xyz="0 0 .2"/>', '<origin xzy="0 0 .2"/>', "'xzy' in <origin>", ""),
        ("damping=", "dampling=", "'dampling' in <dynamics> of joint 'j'", "damping"),
        ('damping="1"', 'damping="1" armature="2"', "'armature' in <dynamics>", ""),
        ("</joint>", '<mimik joint="k"/></joint>', "<mimik> of joint 'j'", "mimic"),
        ("</joint></robot>", "</joint><Link/></robot>", "<Link> of the robot", "link"),
        ("</link>", "<contact/></link>", "<contact> of link 'trunk' and 2 more", ""),
    ],
)
def test_unknown_word_is_told_with_its_place_and_what_is_meant(right, wrong, told, meant) -> None:
    note = note_of(ARM.replace(right, wrong, 1 if wrong != "<contact/></link>" else 3))
    assert told in note
    assert (f"(is {meant!r} meant?)" in note) == bool(meant)


def test_inertia_that_is_misspelt_is_told_where_the_mass_is_lost() -> None:
    lost = ARM.replace(link("lower"), link("lower").replace("inertial", "interial"))
    assert Robot.load(lost).mass == 2.0
    assert "<interial> of link 'lower' (is 'inertial' meant?)" in note_of(lost)


def test_words_of_urdf_and_what_is_left_for_others_are_not_told(tmp_path: Path) -> None:
    more = '<gazebo/><transmission/><sensor/><mujoco/><material name="m"/><!-- c -->'
    with_more = ARM.replace("</joint></robot>", f"</joint>{more}</robot>")
    with_more = with_more.replace("<dynamics", '<d:x xmlns:d="drake"/><calibration/><dynamics')
    for text in (ARM, with_more):
        assert not note_of(text)
    for name in ("hoap2_like", "g1", "talos"):
        assert not any("URDF does not know" in note for note in Robot.load(name).notes)


@pytest.mark.parametrize(
    ("limit", "told"),
    [
        ('lower="-1_0" upper="1_0"', "<limit lower='-1_0'> is not a number"),
        (
            'lower="-1" upper="\N{ARABIC-INDIC DIGIT ONE}"',
            "<limit upper='\N{ARABIC-INDIC DIGIT ONE}'> is not a number",
        ),
        ('lower="1" upper="-1"', "swap them"),
        ('upper="-1"', "the one left out is 0: give both"),
    ],
)
def test_limits_that_are_none_are_refused_in_words_of_their_own(limit: str, told: str) -> None:
    """The first two are numbers to Python, and stopped the parser without a word of where."""
    with pytest.raises(ModelError, match=f"joint 'j': .*{told}"):
        Robot.load(ARM.replace('lower="-1" upper="1"', limit))


def test_joints_without_range_or_speed_are_told() -> None:
    free = Robot.load(ARM.replace(' lower="-1" upper="1"', ""))
    assert "j have no range in the file: taken as without limits" in free.notes
    still = Robot.load(ARM.replace('lower="-1" upper="1"', 'lower=".5" upper=".5"'))
    assert "limits leave these joints no range: j at 0.5" in still.notes
    slow = Robot.load(ARM.replace('velocity="3"', 'velocity="0"'))
    assert "speed limits of 0 are taken as none: j" in slow.notes
    for speed in ("1e+09", "360"):  # as an ergoCub's; in degrees, a turn per second
        vast = Robot.load(ARM.replace('velocity="3"', f'velocity="{speed}"'))
        told = f"speed limits in the file that bound nothing or are in degrees: j {speed}"
        assert told in vast.notes
    assert not any("range" in note or "speed" in note for note in Robot.load(ARM).notes)


@pytest.mark.parametrize(
    ("part", "told"),
    [
        (
            '<transmission type="SimpleTransmission"><joint name="j"/><actuator name="m">'
            '<drake:gear_ratio value="10"/><drake:rotor_inertia value="1e-4"/></actuator>'
            "</transmission>",
            "rotors' inertia (armature=... takes it, times the gear ratio squared), of j",
        ),
        ('<gazebo reference="j"><springStiffness>30</springStiffness></gazebo>', "springs, of j"),
        (
            '<gazebo reference="upper"><turnGravityOff>true</turnGravityOff></gazebo>',
            "that gravity does not act, of upper",
        ),
        ('<gazebo reference="upper"><turnGravityOff>false</turnGravityOff></gazebo>', ""),
        ('<gazebo reference="j"><springStiffness value="0.0"/></gazebo>', ""),
    ],
)
def test_physics_of_other_programs_is_told(part: str, told: str) -> None:
    notes = Robot.load(ARM.replace("</robot>", part + "</robot>")).notes
    wanted = [f"not read: {told}"] if told else []
    assert [note for note in notes if note.startswith("not read: ")] == wanted
