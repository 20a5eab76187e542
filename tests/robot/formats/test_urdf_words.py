"""What a URDF says in words that URDF does not know: passed over, but not in silence."""

from pathlib import Path

import pytest

from tests.urdf import joint, link, robot
from wbc.errors import ModelError
from wbc.robot import Robot

J = joint("j", "trunk", "upper", '<dynamics damping="1"/>', at="0 0 .2")
F = '<joint name="f" type="fixed"><parent link="upper"/><child link="lower"/></joint>'
ARM = robot("arm", *map(link, ("trunk", "upper", "lower")), J, F)


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
def test_unknown_word_is_told_with_its_place_and_what_is_meant(
    right: str, wrong: str, told: str, meant: str
) -> None:
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
    vast = Robot.load(ARM.replace('velocity="3"', 'velocity="1e9"'))  # as an ergoCub's
    assert "speed limits in the file that bound nothing: j 1e+09" in vast.notes
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
