"""Files that are odd in one thing each: read as MuJoCo or the format has them, or refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests import urdf as toy
from tests.robot.formats.mjcf_texts import INERTIAL, arm, assert_agree, mujoco, text
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.formats.couplings import Coupling

MOTOR = '<actuator><motor joint="{}" ctrlrange="-3 3"/></actuator>'
TWO = arm() + arm(name="b2").replace("j1", "j2")
THREE = TWO + arm(name="b3").replace("j1", "j3")
BESIDE = (
    '<mujoco><worldbody>{0}<body name="r" pos="0 0 1"><freejoint/><geom size=".1"/>'
    + arm()
    + "</body></worldbody>{1}</mujoco>"
)


def tied(*constraints: str, bodies: str = TWO, motor: str = "") -> str:
    tail = "".join(f"<joint {one}/>" for one in constraints)
    driven = MOTOR.format(motor) if motor else ""
    return text(bodies, tail=f"<equality>{tail}</equality>{driven}")


def couplings(**wanted: tuple[str, float, float]) -> Callable[[Robot], None]:
    def check(robot: Robot) -> None:
        assert dict(robot.couplings) == {name: Coupling(*one) for name, one in wanted.items()}

    return check


def noted(*words: str) -> Callable[[Robot], None]:
    def check(robot: Robot) -> None:
        said = " ".join(robot.notes)
        assert [word for word in words if word not in said] == [], said

    return check


def feet(*links: str, corners: int = 4) -> Callable[[Robot], None]:
    """Soles of these links, their axes those of the base."""

    def check(robot: Robot) -> None:
        assert tuple(foot.link for foot in robot.feet.values()) == links
        here = robot.snapshot(robot.posture())
        for name, foot in robot.feet.items():
            assert len(foot.polygon) == corners, robot.notes
            forward = here.rotation(f"{name}_sole")[:, 0] @ here.rotation("base")[:, 0]
            assert forward > 1.0 - 1e-6

    return check


def without_friction(robot: Robot) -> None:
    np.testing.assert_array_equal(robot.friction, 0.0)


def as_long_as_spheres(robot: Robot) -> None:
    for foot in robot.feet.values():
        np.testing.assert_allclose(np.ptp(foot.polygon[:, 0]), 0.15, atol=1e-9)


def legs(geoms: str, *places: tuple[str, float, float], turned: str = "") -> str:
    hips = "".join(
        f'<body name="{name}_thigh" pos="{x} {y} -.1"><joint name="{name}_hip" axis="0 1 0"'
        f' range="-1 1"/>{INERTIAL.format(1)}<body name="{name}" pos="0 0 -.4">'
        f'<joint name="{name}_an" axis="0 1 0" range="-1 1"/>{INERTIAL.format(1)}{geoms}'
        "</body></body>"
        for name, x, y in places
    )
    root = f'<body name="trunk" pos=".5 .3 1" {turned}><freejoint/>{INERTIAL.format(5)}'
    return text(hips, root=root)


def spheres(pitch: float) -> str:
    """Return four balls below an ankle, the sole drawn off level by an angle [rad]."""
    places = [(x, y) for x in (-0.05, 0.1) for y in (-0.03, 0.03)]
    c, s = np.cos(pitch), np.sin(pitch)
    return "".join(
        f'<geom size=".01" pos="{c * x - s * 0.05} {y} {-s * x - c * 0.05}"/>' for x, y in places
    )


PAIR = ("a", 0.0, 0.1), ("b", 0.0, -0.1)
NAMED = ("left_foot", 0.0, 0.1), ("right_foot", 0.0, -0.1)
FOUR = ("w", 0.2, 0.1), ("x", 0.2, -0.1), ("y", -0.2, 0.1), ("z", -0.2, -0.1)
PLATE = '<geom type="box" size=".1 .05 .02" pos="0 0 -.05"/>'
MJCF: dict[str, tuple[str, Callable[[Robot], None] | str]] = {
    "two constraints of one joint": (
        tied('joint1="j1" joint2="j2"', 'joint1="j1" joint2="j3" polycoef=".1 -2"', bodies=THREE),
        couplings(j3=("j2", -0.5, 0.05), j1=("j2", 1.0, 0.0)),
    ),
    "said twice": (tied(*['joint1="j1" joint2="j2"'] * 2), couplings(j1=("j2", 1.0, 0.0))),
    "of which none turns around": (
        tied(*(f'joint1="j1" joint2="{k}" polycoef="0 1 1"' for k in ("j2", "j3")), bodies=THREE),
        "joint 'j1' is tied by several",
    ),
    "beyond degree 4": (
        tied(
            'joint1="j1" joint2="j2" polycoef="0 1 1"',
            'joint1="j2" joint2="j3" polycoef="0 1 0 1"',
            bodies=THREE,
        ),
        r"'j1' is coupled to 'j3' .*, but together that is a polynomial beyond degree 4; or lock",
    ),
    "the motor's joint drives": (
        tied('joint1="j1" joint2="j2" polycoef=".1 2"', motor="j1"),
        couplings(j2=("j1", 0.5, -0.05)),
    ),
    "never within its limits": (
        tied('joint1="j1" joint2="j2" polycoef="3 .5"'),
        r"'j1' follows 'j2' to 2.5 or more and 3.5 or less, outside its own limits \[-1, 1\]",
    ),
    "tied to what is left out": (
        BESIDE.format(
            '<body name="o"><joint name="jo" axis="0 1 0"/><geom size=".1"/></body>',
            '<equality><joint joint1="j1" joint2="jo"/></equality>',
        ),
        noted("constraints with what is left out do not act: o to r to arm".replace("r to ", "")),
    ),
    "welded to what a hand moves": (
        BESIDE.format(
            '<body name="mc" mocap="true"><geom size=".1"/></body>',
            '<equality><weld name="hold" body1="mc" body2="arm"/></equality>',
        ),
        noted("constraints with what is left out do not act: hold"),
    ),
    "pairs with a scene's ground": (
        text(
            arm(rest='<geom name="tip" size=".1" mass="0"/>'),
            tail='<contact><pair geom1="tip" geom2="floor"/></contact>',
        ),
        noted("contact pairs with what is not in the file left out: floor"),
    ),
    "friction below zero": (text(arm('frictionloss="-.2"')), without_friction),
    "damping below zero": (text(arm('damping="-.2"')), "joint 'j1': negative damping -0.2"),
    "a rotor below zero": (text(arm('armature="-.01"')), "joint 'j1': negative armature -0.01"),
    "a joint called as the world": (
        text(arm().replace("j1", "universe")),
        "a moving joint is called 'universe'",
    ),
    "feet beside the origin": (legs(PLATE, *PAIR), feet("a", "b")),
    "feet that face aside": (legs(PLATE, *PAIR, turned='euler="0 0 2"'), feet("a", "b")),
    "named feet that face aside": (
        legs(PLATE, *NAMED, turned='euler="0 0 -.5"'),
        feet("left_foot", "right_foot"),
    ),
    "four feet that face aside": (
        legs('<geom size=".03"/>', *FOUR, turned='euler="0 0 1.6"'),
        feet("w", "x", "y", "z", corners=1),
    ),
    "balls below a foot off level": (legs(spheres(0.2), *NAMED), as_long_as_spheres),
    "a hand below the soles": (
        legs(PLATE, *NAMED).replace(
            "</body></worldbody>",
            '<body name="grip" pos="0 .4 -1"><joint name="g" range="-1 1"/>'
            '<geom size=".05"/></body></body></worldbody>',
        ),
        noted("lower than the soles in 'standing': grip by 480 mm"),
    ),
    "feet on their edges": (
        legs(PLATE.replace("/>", ' euler="0 .7 0"/>'), *NAMED),
        noted("the left foot touches level ground along a line only"),
    ),
}


@pytest.mark.parametrize("case", MJCF)
def test_odd_mjcfs_are_read_rightly_or_refused(case: str) -> None:
    content, wanted = MJCF[case]
    if isinstance(wanted, str):
        with pytest.raises(ModelError, match=wanted):
            Robot.load(content)
        return
    robot = Robot.load(content)
    wanted(robot)
    if not robot.couplings and "<equality>" not in content and "<contact>" not in content:
        assert_agree(robot, mujoco.MjModel.from_xml_string(content))


BODY = toy.inertial(1, (0.01, 0.02, 0.015), ".01 0 .1")
SPHERE = '<collision><geometry><sphere radius=".1"/>{}</geometry></collision>'

LOOK = '<visual><geometry><sphere radius=".1"/></geometry>{}</visual>'


def urdf(
    joint: str = "", link: str = "", head: str = 'name="two"', top: str = "", name: str = "j"
) -> str:
    return (
        f'<robot {head}>{top}<link name="base">{BODY}</link><link name="a">{BODY}{link}</link>'
        f'<joint name="{name}" type="revolute"><parent link="base"/><child link="a"/>'
        '<origin xyz="0 .1 .2"/><axis xyz="0 1 0"/>'
        f'<limit lower="-1" upper="1" effort="10" velocity="5"/>{joint}</joint></robot>'
    )


def read(*words: str) -> Callable[[Robot], None]:
    """Return a check that the robot is the plain one, with these words in its notes."""

    def check(robot: Robot) -> None:
        plain = Robot.load(urdf())
        q = robot.posture("neutral", {"j": 0.4}, on_ground=False)
        here, there = robot.snapshot(q), plain.snapshot(q)
        np.testing.assert_array_equal(here.mass_matrix, there.mass_matrix)
        np.testing.assert_array_equal(here.position("a"), there.position("a"))
        np.testing.assert_array_equal(robot.limits.lower, plain.limits.lower)
        noted(*words)(robot)

    return check


def shapes(count: int, *words: str) -> Callable[[Robot], None]:
    def check(robot: Robot) -> None:
        read(*words)(robot)
        assert robot.collision_model.ngeoms + robot.visual_model.ngeoms == count

    return check


def coloured(*wanted: float) -> Callable[[Robot], None]:
    def check(robot: Robot) -> None:
        shapes(1)(robot)
        found = robot.visual_model.geometryObjects[0].meshColor
        np.testing.assert_allclose(found, (*wanted, 1.0), atol=1e-6)

    return check


BAD = LOOK.format('<material name="m"><color rgba="{}"/></material>')
URDF: dict[str, tuple[str, Callable[[Robot], None] | str]] = {
    "a joint called as the base": (
        urdf(name="root_joint"),
        "a moving joint is called 'root_joint'",
    ),
    "damping below zero": (urdf('<dynamics damping="-1"/>'), "joint 'j': negative damping -1"),
    "friction below zero": (urdf('<dynamics friction="-1"/>'), "joint 'j': negative friction -1"),
    "empty dynamics": (urdf("<dynamics/>"), read()),
    "empty safety": (urdf("<safety_controller/><calibration/>"), read()),
    "soft limits": (
        urdf('<safety_controller soft_lower_limit="-.5" soft_upper_limit="9"/>'),
        read("not used: soft limits of safety controllers, of j at -0.5 and 9"),
    ),
    "xacro without its namespace": (
        urdf("").replace("<link", '<xacro:property name="a" value="1"/><link', 1),
        "unbound prefix: .*; expand its xacro first",
    ),
    "empty mimic": (urdf("<mimic/>"), "joint 'j': <mimic> has no 'joint'"),
    "no name": (urdf(head=""), read("the file gives the robot no name")),
    "version of the future": (urdf(head='name="r" version="2.0"'), "URDF '2.0' is not known"),
    "namespace of Drake": (urdf(head='name="r" xmlns="http://drake.mit.edu"'), read()),
    "loops of Drake": (
        urdf(top='<loop_joint name="rod"/>'),
        read("not read, as URDF does not know them: loop 'rod'"),
    ),
    "two parents": (urdf('<parent link="a"/>'), "joint 'j': <parent> is given twice"),
    "two limits": (
        urdf('<limit lower="-2" upper="2" effort="1" velocity="1"/>'),
        read("given twice, of which the first counts: <limit> of joint 'j'"),
    ),
    "two places of a mass": (
        urdf().replace('<mass value="1"/>', '<origin xyz="0 0 1"/><mass value="1"/>'),
        read("the first counts: <origin> of link 'base', <origin> of link 'a'"),
    ),
    "a prefix that is nowhere declared": (
        urdf(link="<sensor:camera/>").replace('<robot name="two">', "<robot>"),
        read("the file gives the robot no name"),
    ),
    "two shapes in one": (
        urdf(link=SPHERE.format('<box size="1 1 1"/>')),
        shapes(1, "the first counts: <box> as collision of link 'a'"),
    ),
    "colour of bytes": (urdf(link=BAD.format("255 102 0 255")), coloured(1.0, 0.4, 0.0)),
    "colour of bytes with a share": (urdf(link=BAD.format("255 102 0 1")), coloured(1.0, 0.4, 0.0)),
    "colour beyond white": (urdf(link=BAD.format("1 256 0 1")), coloured(0.5, 0.5, 0.5)),
    "colour without numbers": (
        urdf(link=LOOK.format('<material name="m"><color/></material>') + SPHERE.format("")),
        shapes(2, "grey, since their colours"),
    ),
    "one colour twice": (
        urdf(link=LOOK.format('<material name="m"/>'), top='<material name="m"/>' * 2),
        shapes(1),
    ),
}


@pytest.mark.parametrize("case", URDF)
def test_odd_urdfs_are_read_rightly_or_refused(case: str, capfd) -> None:
    content, wanted = URDF[case]
    if isinstance(wanted, str):
        with pytest.raises(ModelError, match=wanted):
            Robot.load(content)
    else:
        wanted(Robot.load(content))
    assert "Error" not in capfd.readouterr().err  # of the parser below Pinocchio


def test_a_turned_frame_of_urdf_1_2_is_turned() -> None:
    """A quaternion, which MuJoCo passes over: half a right angle about z, by its matrix."""
    turn = f"0 0 {np.sin(np.pi / 8)} {np.cos(np.pi / 8)}"
    content = urdf(head='name="r" version="1.2"')
    robot = Robot.load(content.replace('xyz="0 .1 .2"', f'xyz="0 .1 .2" quat_xyzw="{turn}"'))
    R = robot.snapshot(robot.posture("neutral", on_ground=False)).rotation("a")
    half = np.sqrt(0.5)
    np.testing.assert_allclose(R, [[half, -half, 0], [half, half, 0], [0, 0, 1]], atol=1e-12)


def test_a_compiled_model_that_was_changed_is_read_as_it_is() -> None:
    """As where masses are drawn at random; what no robot has is refused."""
    model = mujoco.MjModel.from_xml_string(text(TWO))
    model.body_mass[2] *= 1.5
    robot = Robot.load(model)
    assert robot.mass == pytest.approx(float(model.body_mass.sum()), rel=1e-12)
    model.jnt_range[1] = 1.0, -1.0
    with pytest.raises(ModelError, match="joint 'j1': its range is 1 to -1"):
        Robot.load(model)
    model.body_mass[2] = np.nan
    with pytest.raises(ModelError, match="body 'arm': its mass"):
        Robot.load(model)


def test_a_compiled_file_says_how_it_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "r.mjb").write_bytes(b"\1\0\2")
    with pytest.raises(ModelError, match=r"MjModel\.from_binary_path"):
        Robot.load(tmp_path / "r.mjb")


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-16", "UTF-8"])
def test_what_text_says_of_its_encoding_means_nothing(encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n' + urdf(name="kr\u00e4ftig")
    assert Robot.load(text).joint_names == ("kr\u00e4ftig",)
