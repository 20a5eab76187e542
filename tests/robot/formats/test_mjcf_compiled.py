"""MJCF as MuJoCo compiles it. Oracle: MuJoCo's own model of the same text, moved by mj_forward."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import wbc.robot.formats.mjcf as reading
from tests.robot.formats.mjcf_texts import (
    INERTIAL,
    LEGS,
    TRUNK,
    arm,
    assert_agree,
    assert_placed,
    forward,
    load,
    mujoco,
    text,
)
from wbc.errors import MissingPackageError, ModelError
from wbc.robot import Robot
from wbc.robot.postures import is_standing
from wbc.simulation import Plant

CLASS = '<default><default class="k"><joint ref=".3" range="-.5 .9"/></default></default>'
SLIDE = '<body name="rod"><joint name="j1" type="slide" axis="1 1 0" ref=".2" range="0 .5"/>'
TWO = (
    '<body name="two"><joint name="j1" axis="1 0 0" ref=".2" pos="0 0 .1" range="-1 1"/>'
    '<joint name="j2" axis="0 0 1" ref="-.4" pos=".1 0 0" range="-2 1"/>'
)
REFS = {
    "hinge": text(arm('ref=".4"')),
    "skew axis": text(arm('ref="-.7"').replace("0 1 0", "1 2 -1")),
    "in a class": text(arm('class="k"').replace('range="-1 1"', ""), head=CLASS),
    "slide": text(SLIDE + INERTIAL.format(1) + "</body>"),
    "several": text(TWO + INERTIAL.format(1) + "</body>"),
    "degrees": text(arm('ref="30"')).replace("radian", "degree"),
}


@pytest.mark.parametrize("content", REFS.values(), ids=REFS)
def test_the_coordinate_of_a_joint_with_ref_is_qpos(content: str) -> None:
    assert_agree(*load(content))


def test_key_frames_and_couplings_are_in_the_same_coordinates() -> None:
    second = arm('ref=".4"') + arm('ref="-.1"', name="other").replace("j1", "j2")
    content = text(
        second,
        tail='<keyframe><key name="bent" qpos="0 0 1 1 0 0 0 .9 -.3"/></keyframe>'
        '<equality><joint joint1="j2" joint2="j1" polycoef=".05 -2"/></equality>',
    )
    robot, model = load(content)
    q = robot.posture("bent", on_ground=False)
    data = mujoco.MjData(model)
    data.qpos[7] = q[7] = 0.5
    data.qpos[8] = robot.couplings["j2"].ratio * 0.5 + robot.couplings["j2"].offset
    mujoco.mj_forward(model, data)
    assert abs(float(data.efc_pos[0])) < 1e-12  # MuJoCo's own error of the coupling
    assert robot.postures["bent"][7] == 0.9


BALL = '<geom type="sphere" size=".1" contype="0" conaffinity="0" {}/>'
BOX = '<geom type="box" size=".1 .1 .2" pos=".1 0 0" {}/>'
HINGED = '<body name="arm" pos="0 .1 .2"><joint name="j1" axis="0 1 0" range="-1 1"/>'
VISUAL = '<default><default class="v"><geom contype="0" conaffinity="0" group="2"/></default>'
PLAIN = BOX.format("")
WEIGHED = {
    "by density": (BALL.format("") + BOX.format('density="300"'), ""),
    "by mass": (BALL.format('mass="2"') + BOX.format('mass="1"'), ""),
    "alone": (BALL.format(""), ""),
    "not by choice": (BALL.format('density="0"') + PLAIN, ""),
    "by class": ('<geom class="v" size=".1"/>' + PLAIN, VISUAL + "</default>"),
    "instead of an inertial": (INERTIAL.format(1) + PLAIN, '<compiler inertiafromgeom="true"/>'),
    "of one group": (BALL.format('group="3"') + PLAIN, '<compiler inertiagrouprange="0 1"/>'),
    "not less than": (BALL.format('mass=".001"'), '<compiler boundmass="2" boundinertia=".3"/>'),
    "as a shell": (BOX.format('shellinertia="true"'), ""),
}


@pytest.mark.parametrize(("geoms", "head"), WEIGHED.values(), ids=WEIGHED)
def test_masses_are_those_that_mujoco_takes_from_geoms(geoms: str, head: str) -> None:
    assert_agree(*load(text(HINGED + geoms + "</body>", head=head)))


RANGES = {
    "0 0": (arm().replace("-1 1", "0 0"), ""),
    "equal": (arm().replace("-1 1", ".5 .5"), ""),
    "upside down": (arm().replace("-1 1", "1 -1"), ""),
    "switched off": (arm('limited="false"'), ""),
    "class switched off": (
        arm('class="k" limited="false"').replace('range="-1 1"', ""),
        '<default><default class="k"><joint range="-1 1"/></default></default>',
    ),
    "no automatic ones": (arm('limited="false"'), '<compiler autolimits="false"/>'),
    "of all joints": (arm(), '<default><joint range="-1 1" limited="true"/></default>'),
}


@pytest.mark.parametrize(("bodies", "head"), RANGES.values(), ids=RANGES)
def test_ranges_are_those_that_mujoco_keeps(bodies: str, head: str) -> None:
    assert_agree(*load(text(bodies, head=head)))


DRAWN = '<body name="trunk" pos=".2 .1 1" euler="0 .2 .3">'
PLANAR = (
    '<body name="trunk" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0"/>'
    '<joint name="z" type="slide" axis="0 0 1"/><joint name="pitch" axis="0 1 0"/>'
)
ROOTS = {
    "static": DRAWN + INERTIAL.format(5),
    "hinge": DRAWN + '<joint name="j0" axis="1 0 0"/>' + INERTIAL.format(5),
    "planar": PLANAR + INERTIAL.format(5),
    "slide with ref": '<body name="trunk"><joint name="x" type="slide" ref=".3" axis="1 0 0"/>'
    + INERTIAL.format(5),
}


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize("base", [None, "fixed"])
def test_robots_without_a_free_joint_are_where_mujoco_has_them(root: str, base: str | None) -> None:
    count = 1 + ROOTS[root].count("<joint")
    values = " ".join(str(0.1 * (k + 1)) for k in range(count))
    keys = f'<keyframe><key name="home" qpos="{values}"/><key/></keyframe>'
    robot, model = load(text(arm(), root=ROOTS[root], tail=keys), base=base)
    assert_agree(robot, model)
    assert robot.fixed_base
    np.testing.assert_allclose(robot.postures["home"][7:], 0.1 * np.arange(1, count + 1))
    np.testing.assert_allclose(robot.postures["key_1"][7:], model.qpos0)


def test_a_pendulum_on_a_fixed_root_moves_as_in_mujoco() -> None:
    content = text(arm(), root=ROOTS["hinge"])
    robot, model = load(content)
    plant, data = Plant(robot), mujoco.MjData(model)
    q = robot.posture("neutral", {"j0": 0.4, "j1": -0.3})
    plant.reset(q)
    data.qpos[:] = q[7:]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(plant.data.qacc, data.qacc, rtol=1e-12)


def test_a_planar_walker_with_feet_has_a_fixed_base_too() -> None:
    content = text(LEGS, root=ROOTS["planar"])
    robot = Robot.load(content)
    assert robot.fixed_base and list(robot.feet) == ["left", "right"]
    assert "the base is fixed, since the root moves by joints of its own" in robot.notes
    assert_agree(robot, mujoco.MjModel.from_xml_string(content))
    with pytest.raises(ModelError, match="the root moves by joints of its own"):
        Robot.load(content, base="floating")


SIX = (
    '<joint name="tx" type="slide" axis="1 0 0"/><joint name="ty" type="slide" axis="0 1 0"/>'
    '<joint name="tz" type="slide" axis="0 0 1"/><joint name="tilt" axis="0 1 0"/>'
    '<joint name="list" axis="-1 0 0" ref=".1"/><joint name="turn" axis="0 0 1" range="-1 1"/>'
)


SLIDES = SIX[: SIX.index('<joint name="tilt"')]


@pytest.mark.parametrize(
    ("joints", "names", "turns"),
    [
        (SIX, "tx, ty, tz, tilt, list, turn", ".4 .5 .6"),
        # As makers' files have it that began as a planar model; a key frame may turn the ball.
        (SLIDES + '<joint name="turn" type="ball"/>', "tx, ty, tz, turn", ".6 0 .8 0"),
    ],
    ids=["six joints", "slides and a ball"],
)
def test_joints_that_move_the_root_any_way_are_its_floating_base(joints, names, turns) -> None:
    """As files of models of people and of robots that learn to walk have them."""
    root = TRUNK.replace("<freejoint/>", joints)
    keys = f'<keyframe><key name="bent" qpos=".1 .2 .3 {turns} .2 -.3"/></keyframe>'
    content = text(LEGS, root=root, tail=keys)
    robot, model = Robot.load(content), mujoco.MjModel.from_xml_string(content)
    assert not robot.fixed_base and robot.joint_names == ("left_hip", "right_hip")
    assert list(robot.feet) == ["left", "right"]
    assert any(f"floating base: {names}" in note for note in robot.notes)
    assert_agree(robot, model)
    s = robot.snapshot(robot.postures["bent"])
    assert_placed(s, forward(model, 0), "trunk", "left_foot", "right_foot")


def test_joints_of_the_root_that_are_driven_or_do_not_turn_it_any_way_are_joints() -> None:
    content = text(LEGS, root=TRUNK.replace("<freejoint/>", SIX))
    driven = content.replace("</worldbody>", '</worldbody><actuator><motor joint="tz"/></actuator>')
    assert Robot.load(driven).nv == 6 + 8  # a gantry is a gantry
    flat = content.replace('axis="-1 0 0"', 'axis="0 1 .1"')
    assert Robot.load(flat).nv == 6 + 8  # these hinges do not turn every way


def test_a_nameless_root_weighs_what_it_weighs() -> None:
    nameless = TRUNK.replace(' name="trunk"', "")
    robot = Robot.load(text(arm(), root=nameless), feet={})
    assert robot.mass == pytest.approx(6.0, abs=1e-12)
    assert "body_1" in robot.frame_names


def test_two_arms_side_by_side_are_one_robot_on_a_fixed_root() -> None:
    root = '<body name="{0}" pos="0 {1} 1">' + INERTIAL.format(5)
    second = root.format("second", -0.3) + arm(name="other").replace("j1", "j2")
    content = (
        f"<mujoco><worldbody>{root.format('trunk', 0.3)}{arm()}</body>{second}</body></worldbody>"
        "<actuator><motor joint='j1'/><motor joint='j2'/></actuator></mujoco>"
    )
    robot, model = load(content)
    assert robot.joint_names == ("j1", "j2") and robot.fixed_base
    s = robot.snapshot(robot.postures["neutral"])
    assert_placed(s, forward(model), "trunk", "second", "arm", "other")
    one = content.replace("<motor joint='j2'/>", "")
    assert Robot.load(one, feet={}).joint_names == ("j1",)  # what no motor drives is scenery


POT = '<body name="pot"><freejoint/>{0}<body name="lid"><joint/>{0}</body></body>'.format(
    INERTIAL.format(1)
)
CUBE = '<body name="cube"><freejoint/>' + INERTIAL.format(1) + "</body>"
PULLED = (
    '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'
    '<actuator><motor tendon="t"/></actuator>'
)


@pytest.mark.parametrize(
    ("things", "tail"),
    [
        (POT, '<actuator><motor joint="j1"/></actuator>'),
        (POT + CUBE, PULLED),
        (CUBE, ""),  # which has no joints beside its free one
    ],
)
def test_the_robot_of_a_scene_is_what_motors_drive(things: str, tail: str) -> None:
    content = text(arm(), root=ROOTS["static"], tail=tail)
    content = content.replace("<worldbody>", "<worldbody>" + things)
    robot, model = load(content)
    assert robot.joint_names == ("j1",)
    assert any("root is trunk, left out: " in note for note in robot.notes)
    assert robot.mass == pytest.approx(model.body("trunk").subtreemass[0])


def test_many_bodies_that_may_be_the_robot_are_told_shortly() -> None:
    balls = "".join(CUBE.replace("cube", f"ball{k}") for k in range(50))
    with pytest.raises(ModelError, match=r"'ball0'.* and 45 more may be .*in one body, the trunk"):
        Robot.load(f"<mujoco><worldbody>{balls}</worldbody></mujoco>")


def test_missing_ground_is_done_without() -> None:
    head = '<asset><hfield name="hills" file="gone.png" size="1 1 1 1"/></asset>'
    content = text(arm(), head=head)
    ground = '<worldbody><geom type="hfield" hfield="hills"/>'
    assert Robot.load(content.replace("<worldbody>", ground), feet={}).mass == 6.0


def test_included_files_are_found_beside_the_including_one(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name, inside in (("outer", '<include file="inner.xml"/>'), ("inner", arm())):
        (tmp_path / f"sub/{name}.xml").write_text(f"<mujocoinclude>{inside}</mujocoinclude>")
    path = tmp_path / "robot.xml"
    path.write_text(text('<include file="sub/outer.xml"/>'))
    robot = Robot.load(path, feet={})
    assert_agree(robot, mujoco.MjModel.from_xml_path(str(path)))


@pytest.mark.parametrize("ending", ["", ".mjcf", ".XML", ".xml.txt"])
def test_a_file_may_have_any_ending(tmp_path: Path, ending: str) -> None:
    (tmp_path / "nested.xml").write_text(text(arm()))
    content = (
        '<mujoco><asset><model name="nested" file="nested.xml"/></asset><worldbody><frame>'
        '<attach model="nested" body="trunk" prefix="A/"/></frame></worldbody></mujoco>'
    )
    path, usual = tmp_path / f"robot{ending}", tmp_path / "robot.xml"
    path.write_text(content)
    usual.write_text(content)
    robot = Robot.load(path, feet={})
    assert robot.joint_names == ("A/j1",)
    assert_agree(robot, mujoco.MjModel.from_xml_path(str(usual)), root="A/trunk")


def test_what_mujoco_made_is_read_as_its_file(tmp_path: Path) -> None:
    content = text(arm('ref=".2"') + LEGS)
    path = tmp_path / "robot.xml"
    path.write_text(content)
    model, spec = mujoco.MjModel.from_xml_string(content), mujoco.MjSpec.from_string(content)
    whole = Robot.load(path)
    for source in (content, "\n " + content, model, spec):
        robot = Robot.load(source)
        assert (robot.name, robot.joint_names) == ("two", whole.joint_names)
        assert list(robot.feet) == list(whole.feet) == ["left", "right"]
        for name, q in whole.postures.items():
            np.testing.assert_array_equal(robot.postures[name], q)
    assert mujoco.MjModel.from_xml_string(spec.to_xml()).nq == model.nq  # as it was


def test_a_wrong_reading_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of these faults is put into the tree after it was built."""
    real = reading.build_tree

    def shift(tree: pin.Model) -> None:
        aside = pin.SE3(np.eye(3), np.array([0, 0, 1e-6]))
        tree.jointPlacements[2] = tree.jointPlacements[2] * aside

    def fatten(tree: pin.Model) -> None:
        tree.inertias[2] = pin.Inertia(1.001, np.zeros(3), np.eye(3))

    def twist(tree: pin.Model) -> None:
        heavy = tree.inertias[2]
        tree.inertias[2] = pin.Inertia(heavy.mass, heavy.lever, 1.001 * np.array(heavy.inertia))

    for fault, words in ((shift, "frame"), (fatten, "mass"), (twist, "the mass matrix at .*'j1'")):

        def faulty(*given: Any, fault: Any = fault) -> pin.Model:
            tree = real(*given)
            fault(tree)
            return tree

        monkeypatch.setattr(reading, "build_tree", faulty)
        with pytest.raises(ModelError, match=words):
            Robot.load(text(arm()))


FORE = INERTIAL.format(1) + '<body name="fore"><joint name="j2"/>' + INERTIAL.format(1) + "</body>"
SHARED = {
    "site beside": f'<body name="arm"><joint name="arm" axis="0 1 0"/><site name="tip"/>{FORE}',
    "locked itself": f'<body name="j2"><joint name="arm" axis="0 1 0"/>{FORE}',
    "site so called": f'<body name="arm"><joint name="j1" axis="0 1 0"/><site name="arm"/>{FORE}',
}


@pytest.mark.parametrize("body", SHARED.values(), ids=SHARED)
def test_joints_are_locked_whatever_else_has_their_names(body: str) -> None:
    whole, model = load(text(body + "</body>"))
    robot, _ = load(text(body + "</body>"), locked={"j2": 0.3})
    assert (robot.nv, robot.frame_names) == (whole.nv - 1, whole.frame_names)
    data = mujoco.MjData(model)
    data.joint("j2").qpos[:] = 0.3
    mujoco.mj_forward(model, data)
    s = robot.snapshot(robot.postures["neutral"])
    assert_placed(s, data, *(model.body(k).name for k in range(1, model.nbody)))
    np.testing.assert_allclose(s.com, data.subtree_com[1], atol=1e-12)


TEXTURES = (
    '<texture type="skybox" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="8" height="48"/>',
    '<texture name="t" type="2d" file="gone.png"/><material name="m" texture="t"/>',
    '<texture type="cube" file="gone.png"/><material name="m" texture="gone"/>',
    '<texture name="t" type="cube" fileright="a.png" fileleft="b.png"/>',
)


@pytest.mark.parametrize("assets", TEXTURES)
def test_textures_are_done_without(assets: str) -> None:
    assert Robot.load(text(arm(), head=f"<asset>{assets}</asset>"), feet={}).mass == 6.0


LOOP = (
    '<equality><connect name="c" body1="arm" body2="trunk" anchor="0 0 0" active="{}"/></equality>'
)


@pytest.mark.parametrize(
    "tail",
    [
        '<deformable><skin file="away.skn"/></deformable>',
        '<sensor><touch site="in_a_scene"/></sensor>',
        '<sensor><accelerometer site="in_a_scene"/></sensor><asset><mesh name="away"'
        ' file="away.stl"/></asset>',
    ],
)
def test_sensors_and_skins_of_what_is_elsewhere_are_done_without(tail: str) -> None:
    assert Robot.load(text(LEGS, tail=tail)).mass == Robot.load(text(LEGS)).mass


def test_equality_constraints_act_while_they_are_active() -> None:
    passed = "equality constraints that are not active: c"
    for content in (
        text(arm(), tail=LOOP.format("false")),
        text(arm(), head='<option><flag equality="disable"/></option>', tail=LOOP.format("true")),
    ):
        robot, _ = load(content)
        assert robot.joint_names == ("j1",) and not robot.loops and passed in robot.notes
    tied = '<equality><tendon name="c" tendon1="t"/></equality>'
    with pytest.raises(ModelError, match=r"<tendon name='c'>: constraints of tendons"):
        load(text(arm(), tail=PULLED + tied))


GRIPPER = (
    arm('ref=".2"') + '<body name="finger"><joint name="j2" axis="0 1 0" range="-2 2" ref="-.1"/>'
    f"{INERTIAL.format(1)}</body><body name='third'><joint name='j3'/>{INERTIAL.format(1)}</body>"
)
BOTH = '<fixed name="a"><joint joint="j1" coef="2"/><joint joint="j2" coef="-.5"/></fixed>'
SINGLE = (
    '<fixed name="a"><joint joint="j1" coef="2"/></fixed>'
    '<fixed name="b"><joint joint="j2" coef="-.5"/></fixed>'
)


@pytest.mark.parametrize(
    ("tendons", "tie", "driven", "joint"),
    [
        (BOTH, 'tendon1="a" polycoef=".1 0 0 0 0"', "j1", "j2"),
        (BOTH, 'tendon1="a"', "j2", "j1"),
        (SINGLE, 'tendon1="b" tendon2="a" polycoef=".01 .3 .1 -.02 .03"', "j1", "j2"),
    ],
)
def test_two_joints_tied_by_tendons_are_a_gear(tendons, tie, driven, joint) -> None:
    tail = (
        f"<tendon>{tendons}</tendon><equality><tendon {tie}/></equality>"
        f'<actuator><motor joint="{driven}"/></actuator>'
    )
    robot, model = load(text(GRIPPER, tail=tail))
    assert {joint: driven} == {one: gear.driver for one, gear in robot.couplings.items()}
    data = mujoco.MjData(model)
    for value in (0.3, -0.2):
        data.joint(driven).qpos[:] = value
        data.joint(joint).qpos[:] = robot.couplings[joint].value(value)
        mujoco.mj_forward(model, data)
        assert data.ne == 1 and abs(data.efc_pos[0]) < 1e-12


def test_tendons_of_three_joints_tie_what_is_refused() -> None:
    three = BOTH.replace("</fixed>", '<joint joint="j3" coef="1"/></fixed>')
    tail = f'<tendon>{three}</tendon><equality><tendon name="c" tendon1="a"/></equality>'
    with pytest.raises(ModelError, match=r"<tendon name='c'>: .*but for those of two joints"):
        load(text(GRIPPER, tail=tail))


HOME = '<keyframe><key name="home"/></keyframe>'


@pytest.mark.parametrize("name", ["dof_damping", "jnt_stiffness", "key_qpos", "geom_size"])
def test_numbers_of_a_changed_model_that_are_none_are_named(name: str) -> None:
    """For masses see test_odd_files.py."""
    model = mujoco.MjModel.from_xml_string(text(LEGS, tail=HOME))
    getattr(model, name).flat[-1] = np.nan
    with pytest.raises(ModelError, match=f"{name} of the model is not finite"):
        Robot.load(model)


def test_a_key_frame_without_an_orientation_is_upright() -> None:
    model = mujoco.MjModel.from_xml_string(text(LEGS, tail=HOME))
    model.key_qpos[0, 3:7] = 0.0
    np.testing.assert_array_equal(Robot.load(model).postures["home"][3:7], [0, 0, 0, 1])


def test_a_foot_tied_to_the_world_needs_a_fixed_base() -> None:
    """Of a root without a free joint, which floats for it has feet; the tie was to the root."""
    tie = '<equality><connect name="c" body1="left_foot" anchor="0 0 0"/></equality>'
    content = text(LEGS, root=TRUNK.replace("<freejoint/>", ""), tail=tie)
    with pytest.raises(ModelError, match=r"'c' ties the robot to the world.* base: fixed"):
        Robot.load(content)
    robot = Robot.load(content, base="fixed")
    assert robot.gaps(robot.postures["neutral"])["c"] < 1e-12


def test_shapes_of_the_world_beside_the_robot_are_told() -> None:
    mark = '<geom type="sphere" size=".1" contype="0" conaffinity="0"/>'
    floor = f'<geom type="plane" size="1 1 1"/>{mark}'
    content = text(arm())
    with_floor = content.replace("<worldbody>", f"<worldbody>{floor}", 1)
    assert Robot.load(with_floor).notes == Robot.load(content).notes
    table = with_floor.replace(floor, floor + '<geom name="table" type="box" size="1 1 1"/>')
    told = {*Robot.load(table).notes} - {*Robot.load(content).notes}
    assert told == {"shapes of the world, which are no part of the robot, left out: table"}
    hills = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 0 1"/></asset>'
    for ground in ('hfield" hfield="h', 'plane" euler=".2 0 0" size="1 1 1'):
        world = f'{hills}<worldbody><geom name="hill" type="{ground}"/>'
        sloping = Robot.load(content.replace("<worldbody>", world, 1))
        (note,) = {*sloping.notes} - {*Robot.load(content).notes}
        assert note.endswith("left out: hill")


@pytest.mark.parametrize("given", ["file", "text"])
def test_without_mujoco_the_extra_is_named(tmp_path: Path, monkeypatch, given: str) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text(arm()))
    monkeypatch.setitem(sys.modules, "mujoco", None)  # as if it were not installed
    with pytest.raises(MissingPackageError, match=r"reading MJCF needs mujoco.*wbc\[sim\]"):
        Robot.load(path if given == "file" else path.read_text())


@pytest.mark.parametrize("where", ["main", "included", "text"])
def test_what_mujoco_knows_no_more_is_left_out_and_said(tmp_path: Path, where: str) -> None:
    old = '<option><flag sensornoise="enable"/></option>'
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/legs.xml").write_text(f"<mujocoinclude>{LEGS}</mujocoinclude>")
    (tmp_path / "parts/old.xml").write_text(f"<mujoco>{old}</mujoco>")
    head = '<include file="parts/old.xml"/>' if where == "included" else old
    path = tmp_path / "robot.xml"
    path.write_text(text('<include file="parts/legs.xml"/>', head=head))
    robot = Robot.load(text(LEGS, head=old) if where == "text" else path)
    assert robot.joint_names == ("left_hip", "right_hip") and list(robot.feet) == ["left", "right"]
    assert "left out, as MuJoCo knows them no more: <flag sensornoise>" in robot.notes


JOINED_BALL = (
    '<body name="rod" pos=".1 0 .2"><joint name="end" type="ball" pos="0 0 .1" damping=".3"'
    ' armature=".01" range="0 1" limited="true"/>' + INERTIAL.format(1) + "</body>"
)


def test_a_ball_is_three_hinges_in_turn_and_is_said() -> None:
    """Frames and masses are those of the ball at a quaternion; also where a key frame turns it."""
    quaternion = np.array((0.9, 0.2, -0.3, 0.1))
    quaternion /= np.linalg.norm(quaternion)
    turned = " ".join(f"{part:.17g}" for part in quaternion)
    keys = f'<keyframe><key name="bent" qpos=".1 .2 .9 1 0 0 0 {turned}"/></keyframe>'
    content = text(JOINED_BALL, tail=keys)
    robot, model = Robot.load(content), mujoco.MjModel.from_xml_string(content)
    assert robot.joint_names == ("end:x", "end:y", "end:z")
    assert any("ball joints are three hinges each" in note for note in robot.notes)
    q = robot.postures["neutral"].copy()
    straight, turns = robot.snapshot(q).rotation("rod"), []
    for signs in ((1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)):
        q[7:] = signs
        turned_by = straight.T @ robot.snapshot(q).rotation("rod")
        turns.append(np.arccos(0.5 * np.trace(turned_by) - 0.5))
    said = f"which turn it by more together: end by {max(turns):.3g} rad, not 1"
    in_degrees = content.replace('range="0 1"', f'range="0 {np.rad2deg(1.0)}"')
    in_degrees = in_degrees.replace('angle="radian"', 'angle="degree"')
    for one in (robot, Robot.load(in_degrees)):
        assert any(said in note for note in one.notes)
        np.testing.assert_allclose(one.limits.upper, 1.0)
    np.testing.assert_allclose(robot.damping, 0.3)
    s, data = robot.snapshot(robot.postures["bent"]), forward(model, 0)
    assert_placed(s, data, "rod", atol=1e-9)
    np.testing.assert_allclose(s.com, data.subtree_com[1], atol=1e-9)
    Plant(robot).step(np.zeros(3))
    # A model that is compiled already cannot be changed: refused by its name.
    with pytest.raises(ModelError, match=r"'end'.*of its file or MjSpec a ball joint is read"):
        Robot.load(model)


def test_the_hinges_of_a_ball_have_its_spring_and_damper_alone() -> None:
    """Made by ``springdamper``; what a class gives hinges, such as ``ref``, is none of a ball's."""
    ball = JOINED_BALL.replace('damping=".3"', 'springdamper=".2 .5"')
    given = '<joint ref="20" springref="30" actuatorfrcrange="-3 3" damping="9"/>'
    content = text(ball).replace("<worldbody>", f"<default>{given}</default><worldbody>", 1)
    robot, model = Robot.load(content), mujoco.MjModel.from_xml_string(content)
    end = model.joint("end")
    assert model.jnt_stiffness[end.id] > 0.0
    for spring in robot.passive.springs.values():
        assert (spring.stiffness, spring.rest) == (model.jnt_stiffness[end.id], 0.0)
    np.testing.assert_array_equal(robot.damping, model.dof_damping[end.dofadr[0]])
    assert len(robot.passive.springs) == 3 and np.isinf(robot.limits.effort).all()
    assert_placed(robot.snapshot(robot.postures["neutral"]), forward(model), "rod")


def test_motors_about_an_axis_of_a_ball_are_those_of_its_hinge() -> None:
    tail = (
        '<keyframe><key name="k" qpos="0 0 1 1 0 0 0 1 0 0 0" ctrl="1 1 1"/></keyframe><actuator>'
        '<motor name="roll" joint="end" gear="2 0 0" ctrlrange="-3 3"/><motor name="skew" joint='
        '"end" gear="0 1 1"/><motor name="yaw" jointinparent="end" gear="0 0 1" ctrlrange="-1 1"/>'
        "</actuator>"
    )
    robot = Robot.load(text(JOINED_BALL, tail=tail))
    np.testing.assert_array_equal(robot.limits.effort, [6.0, np.inf, 1.0])
    assert any("hinge about that axis: roll, yaw" in note for note in robot.notes)
    assert any("several axes of a ball joint are not read: skew" in note for note in robot.notes)


def test_motors_that_turn_a_whole_ball_are_left_out_with_a_note() -> None:
    content = text(
        JOINED_BALL, tail='<actuator><orientation name="o" joint="end" kp="5"/></actuator>'
    )
    try:
        mujoco.MjModel.from_xml_string(content)
    except ValueError:
        pytest.skip("this MuJoCo has no such actuators")
    notes = Robot.load(content).notes
    assert any("several axes of a ball joint are not read: o" in note for note in notes)


def test_a_key_frame_that_stands_is_standing_where_the_neutral_posture_does_not() -> None:
    """A boom that is drawn aside: only where a key frame folds it up is the CoM over the soles."""
    boom = '<body name="boom"><joint name="boom" axis="1 0 0" range="-3 3"/>'
    boom += '<inertial pos="0 2 0" mass="20" diaginertia="1 1 1"/></body>'
    keys = '<keyframe><key name="up" qpos="0 0 .8 1 0 0 0 0 0 1.5708"/></keyframe>'
    root = TRUNK.replace("0 .2 .3", "0 0 0")
    for tail, stood in ((keys, True), ("", False)):
        robot = Robot.load(text(LEGS + boom, root=root, tail=tail))
        assert is_standing(robot.model, robot.posture(), robot.feet) is stood
        assert any("key frame 'up'" in note for note in robot.notes) is stood
    # Where the neutral posture stands, it stays.
    keys = keys.replace(" 1.5708", "")
    robot = Robot.load(text(LEGS, root=root, tail=keys))
    assert not any("key frame 'up'" in note for note in robot.notes)


def test_radians_that_are_read_as_degrees_are_told() -> None:
    """Angles of an MJCF are in degrees unless it says otherwise: 1 is 0.017 rad then."""
    radians = text(arm())
    degrees = radians.replace('<compiler angle="radian"/>', "")
    robot, model = load(degrees)
    np.testing.assert_allclose(robot.limits.upper, np.deg2rad(1.0), rtol=1e-12)
    np.testing.assert_array_equal(robot.limits.upper, model.jnt_range[1:, 1])
    assert any("are limits in radians" in note for note in robot.notes)
    assert not any("radians" in note for note in load(radians)[0].notes)
