"""Reading MJCF: what is accepted, as MuJoCo reads it, and what is refused by name."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import assert_agree, assert_placed, forward, load
from wbc.constraints import SelfCollision
from wbc.errors import ModelError
from wbc.robot import Robot

LIGHT = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
HINGE = '<joint name="knee" type="hinge" axis="0 1 0" range="-60 120" actuatorfrcrange="-9 9"/>'
TURNED = {
    "quat": 'quat="0.6 0.8 0 0"',
    "unnormalised quat": 'quat="1 2 -1 0.5"',
    "axisangle": 'axisangle="1 -2 0.5 {40}"',
    "euler": 'euler="{30} {-50} {70}"',
    "xyaxes": 'xyaxes="1 1 0 -1 2 0.5"',
    "zaxis": 'zaxis="1 -0.3 -0.2"',
    "none": "",
}
SEQUENCES = ("xyz", "zyx", "XYZ", "zXy")


def mjcf(root: str = "<freejoint/>", inner: str = HINGE, **more: str) -> str:
    return (
        f'<mujoco model="toy">{more.get("compiler", "")}<worldbody>'
        f'<geom name="floor" type="plane" size="1 1 1"/>{more.get("before", "")}'
        f'<body name="base_body" pos="0 0 1">{root}<geom type="box" size=".1 .1 .1" mass="3"/>'
        f'<body name="shank" pos="0 0 -.2">{inner}'
        f'<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="1"/>{more.get("shank", "")}'
        f"</body></body>{more.get('world', '')}</worldbody>{more.get('end', '')}</mujoco>"
    )


@pytest.fixture
def toy(tmp_path: Path) -> Callable[..., Path]:
    """Return what writes the toy into a file, in a folder of its own."""

    def write(**parts: str) -> Path:
        (tmp_path / "toy.xml").write_text(mjcf(**parts))
        return tmp_path / "toy.xml"

    return write


@pytest.mark.parametrize("root", ["<freejoint/>", '<joint name="free" type="free"/>', ""])
def test_an_mjcf_has_one_free_flyer(root: str) -> None:
    robot = Robot.load(mjcf(root))
    assert (robot.name, robot.nq, robot.nv, robot.joint_names) == ("toy", 8, 7, ("knee",))
    assert robot.mass == pytest.approx(4.0, abs=1e-12)
    assert robot.snapshot(robot.posture("neutral")).position("base")[2] == 1.0  # as in the file
    np.testing.assert_allclose(robot.limits.lower, np.deg2rad(-60))
    np.testing.assert_allclose(robot.limits.effort, 9.0)
    assert robot.limits.missing == ("knee: velocity",)
    assert len(robot.collision_model.geometryObjects) == 2  # the floor is not the robot's


MESH = '<geom type="mesh" mesh="m"/>'
TWIN = '<body name="twin"><freejoint/><geom size="1"/><body><joint/><geom size="1"/></body></body>'
REFUSED_MJCFS = {
    "gear": (
        {"end": '<equality><joint joint1="knee" polycoef="-1e5"/></equality>'},
        ("'knee'", "polycoef", "larger than 1000"),
    ),
    "free inside": ({"inner": "<freejoint/>"}, ("MuJoCo", "top level", "'shank'")),
    "second robot": ({"world": TWIN}, ("'base_body', 'twin' may be", "2 bodies")),
    "include": ({"world": '<include file="x.xml"/>'}, ("x.xml", "include")),
    "itself": ({"world": '<include file="toy.xml"/>'}, ("toy.xml", "already included")),
    "class": ({"inner": '<joint class="thigh"/>'}, ("'joint'", "'thigh'", "unknown default")),
    "many copies": (
        {"world": '<replicate count="100000"><body/></replicate>'},
        ("<replicate count='100000'>", "more than 1000"),
    ),
    "odd copies": ({"world": '<replicate count="²"><body/></replicate>'}, ("MuJoCo", "count")),
    "frame turned by nothing": (
        {"shank": '<frame quat="0 0 0 0"><geom size=".1"/></frame>'},
        ("zero quaternion", "'frame'"),
    ),
    "tied to the world": (
        {"end": '<equality><weld name="w" body1="shank"/></equality>'},
        ("weld", "floating base"),
    ),
    "held beyond its range": (
        {"end": '<equality><joint joint1="knee" polycoef="9"/></equality>'},
        ("'knee'", "outside its limits"),
    ),
    "mesh inertia": (
        {"shank": MESH, "compiler": '<asset><mesh name="m" file="m.stl"/></asset>'},
        ("m.stl of body 'shank'", "<inertial>"),
    ),
    "nan": ({"shank": '<geom size="nan"/>'}, ("'shank'", "size", "nan")),
    "no mass": (
        {"shank": '<body name="t"><joint name="j"/><geom size="1" mass="0"/></body>'},
        ("mass and inertia of moving bodies",),
    ),
    "unknown joint": ({"inner": '<joint name="j" type="screw"/>'}, ("toy.xml: MuJoCo", "'screw'")),
    "misspelt switch": ({"compiler": '<compiler angle="radians"/>'}, ("'radians'", "line 1")),
    "old coordinates": ({"compiler": '<compiler coordinate="global"/>'}, ("global",)),
    "too far": ({"shank": '<body pos="0 0 1e12"/>'}, ("'body_3'", "pos", "1e+09: correct its")),
}


@pytest.mark.parametrize("case", REFUSED_MJCFS)
def test_unsupported_mjcfs_are_refused_by_name(toy: Callable[..., Path], case: str) -> None:
    changes, words = REFUSED_MJCFS[case]
    with pytest.raises(ModelError) as caught:
        Robot.load(toy(**changes))
    message = str(caught.value)
    assert [word for word in (*words, "toy.xml: ") if word not in message] == []
    assert "\n" not in message


@pytest.mark.parametrize(("group", "counts"), [("0 1", False), ("0 2", True)])
def test_a_missing_mesh_of_a_group_without_mass_is_left_out(group: str, counts: bool) -> None:
    mesh = '<geom type="mesh" mesh="m" group="2"/>'
    text = (
        f'<mujoco><compiler inertiagrouprange="{group}"/>'
        '<asset><mesh name="m" file="m.stl"/></asset><worldbody>'
        f'<body name="b"><freejoint/><geom size=".1" mass="3"/>{mesh}</body></worldbody></mujoco>'
    )
    if counts:
        with pytest.raises(ModelError, match="of body 'b' was not found, and the body takes its"):
            Robot.load(text)
        return
    assert Robot.load(text).mass == 3.0


@pytest.mark.parametrize("angle", ["radian", "degree"])
def test_slides_are_lengths_in_any_angle(angle: str) -> None:
    joints = (
        '<joint name="rail" type="slide" axis="0 0 1" range="-0.5 1"/>'
        '<geom size="0.1" mass="1"/></body><body name="rod">'
        '<joint name="rod" type="slide" axis="1 0 0" range="0.1 0.7" ref="0.25"/>'
    )
    text = mjcf(inner=joints, compiler=f'<compiler angle="{angle}"/>')
    robot = Robot.load(text, base="floating")
    np.testing.assert_array_equal(robot.limits.lower, [-0.5, 0.1])
    np.testing.assert_array_equal(robot.limits.upper, [1.0, 0.7])  # whatever ref is


def test_a_shape_whose_mesh_is_missing_is_left_out_alone() -> None:
    assets = '<asset><mesh name="m" file="none.stl"/><mesh file="gone.stl"/></asset>'
    text = mjcf(inner=HINGE + LIGHT + '<geom type="mesh" mesh="gone"/>' + MESH, compiler=assets)
    robot = Robot.load(text)
    (note,) = (note for note in robot.notes if "meshes" in note)
    assert "2 shapes" in note and "none.stl of body 'shank'" in note and "gone.stl" in note
    kinds = [type(shape.geometry).__name__ for shape in robot.collision_model.geometryObjects]
    assert kinds == ["Box", "Capsule"]
    with pytest.raises(ModelError, match=r"not found: gone\.stl of body 'shank', none\.stl of"):
        SelfCollision(robot, margin=0.01)  # which would not see them
    only_drawn = text.replace('type="mesh"', 'type="mesh" contype="0" conaffinity="0"')
    SelfCollision(Robot.load(only_drawn), margin=0.01)


PART = '<asset><mesh name="m" file="part.stl"/></asset>'


def test_a_mesh_that_mujoco_cannot_read_is_refused_by_name(tmp_path: Path, toy) -> None:
    (tmp_path / "part.stl").write_text("not a mesh")
    with pytest.raises(ModelError, match=r"toy\.xml: MuJoCo refuses.*'m'"):
        Robot.load(toy(compiler=PART, shank=LIGHT + MESH))


def test_a_pointer_of_git_lfs_counts_as_a_missing_mesh(tmp_path: Path, toy) -> None:
    (tmp_path / "part.stl").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    robot = Robot.load(toy(compiler=PART, shank=LIGHT + MESH))
    assert any("part.stl (a Git LFS pointer: git lfs pull)" in note for note in robot.notes)


SCENE = (
    '<body name="table"><geom size="1"/></body>'
    '<body name="door"><joint name="door" axis="0 0 1"/><geom size="1"/>'
    '<body name="handle"><joint name="handle" type="ball"/><geom size=".1"/></body></body>',
    '<body name="ball"><freejoint/><geom size="1"/></body>',
)


def test_the_robot_of_a_scene_is_read_alone() -> None:
    """Its key frames too; as MuJoCo reads the whole scene."""
    end = (
        '<keyframe><key name="home" qpos="0.1 0.7 0.7 0.1 0 1 2 3 0.6 0.8 0 0 0.5 4 5 6 1 0 0 0"/>'
        '</keyframe><equality><joint joint1="door" polycoef="0.1"/></equality>'
    )
    robot, model = load(mjcf(before=SCENE[0], world=SCENE[1], end=end), base="floating")
    assert robot.joint_names == ("knee",)
    assert robot.notes[0] == (
        "bodies beside the robot, whose root is base_body, left out: table, door, ball"
    )
    s = robot.snapshot(robot.postures["home"])
    assert_placed(s, forward(model, 0), "base_body", "shank")
    np.testing.assert_allclose(robot.mass, model.body_subtreemass[model.body("base_body").id])


def test_a_robot_without_free_joint_is_found_beside_scenery() -> None:
    text = mjcf(root="", world='<body name="table"><geom size="1"/></body>')
    assert Robot.load(text).joint_names == ("knee",)


LEG = (
    '<body name="{side}_thigh" pos="0 {y} -0.1">'
    '<joint name="{side}_hip" axis="0 1 0" range="-60 60"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="1"/>'
    '<body name="{side}_foot" pos="0 0 -0.3"><joint name="{side}_ankle" axis="0 1 0"/>'
    '<geom type="box" pos="0.03 0 -0.03" size="0.1 0.04 0.01" mass="0.5"/>'
    '<geom type="sphere" size="0.03" mass="0.1"/></body></body>'
)


def test_the_feet_of_an_mjcf_are_found() -> None:
    """Shapes are picked out of many: every one of a link, and none of another."""
    legs = "".join(LEG.format(side=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))
    text = (
        '<mujoco model="walker"><worldbody><geom name="floor" type="plane" size="1 1 1"/>'
        '<body name="pelvis" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/>'
        f'<geom type="sphere" size="0.05" mass="1"/>{legs}</body></worldbody></mujoco>'
    )
    for _ in range(5):  # which bytes were read in their place differed from run to run
        robot = Robot.load(text)
        assert list(robot.feet) == ["left", "right"]
        for side, y in (("left", 0.1), ("right", -0.1)):
            extent = np.ptp(robot.feet[side].polygon, axis=0)
            np.testing.assert_allclose(extent, [0.2, 0.08], atol=1e-9)
            s = robot.snapshot(robot.postures["standing"])
            np.testing.assert_allclose(s.position(f"{side}_sole"), [0.03, y, 0.0], atol=1e-9)
        for shapes in (robot.collision_model, robot.visual_model):
            links = [robot.model.frames[s.parentFrame].name for s in shapes.geometryObjects]
            once, twice = ("left_thigh", "right_thigh"), ("pelvis", "left_foot", "right_foot")
            assert Counter(links) == Counter((*once, *twice, *twice))


def content(turned: str, compiler: str, scale: float, root: str) -> str:
    for number in ("30", "-50", "70", "40"):
        turned = turned.replace("{" + number + "}", repr(float(number) * scale))
    geom = f'<geom name="{{0}}" type="box" size=".1 .2 .3" mass="1" pos="0.1 0 0.2" {turned}/>'
    return f"""<mujoco model="m"><compiler {compiler}/>
      <default><default class="thin"><geom type="capsule" size="0.03"/></default></default>
      <worldbody><frame pos="0 0 1"><body name="trunk" pos=".2 .1 .3" {turned}>{root}
        {geom.format("trunk")}
        <frame pos="0.1 -0.2 0.3" {turned} childclass="thin">
          <geom name="rod" fromto="0 0 0 0.1 0.2 0.3" mass="0.5"/>
          <frame pos="-0.3 0 0.1" {turned}>
            <body name="arm" pos="0 0 0.4" {turned}><joint name="arm" axis="1 0 0" range="-1 1"/>
              {geom.format("arm")}
              <frame {turned}><body name="hand" pos="0 .1 0"><joint name="hand" range="-1 1"/>
                {geom.format("hand")}</body></frame>
            </body>
            <camera name="eye"/>
          </frame>
        </frame>
      </body></frame></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("turned", "sequence"),
    [(name, "xyz") for name in TURNED] + [("euler", one) for one in SEQUENCES],
)
@pytest.mark.parametrize("degrees", [True, False])
@pytest.mark.parametrize("root", ["<freejoint/>", ""], ids=["floating", "bolted"])
def test_frames_are_where_mujoco_puts_them(turned, sequence, degrees, root) -> None:
    """In MuJoCo's own zero posture, the root where the file puts it, but for the joints."""
    compiler = f'angle="{"degree" if degrees else "radian"}" eulerseq="{sequence}"'
    scale = 1.0 if degrees else np.pi / 180.0
    robot, model = load(content(TURNED[turned], compiler, scale, root))
    assert_agree(robot, model)
    np.testing.assert_allclose(robot.limits.upper, np.pi / 180.0 if degrees else 1.0)
    assert robot.mass == pytest.approx(3.5)
    assert len(robot.collision_model.geometryObjects) == 4
