"""Reading URDF and MJCF: what is accepted, and what is refused by name."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from wbc.errors import InvalidInputError, ModelError, UnknownNameError
from wbc.robot import Robot

BODY = (
    '<inertial><origin xyz="0 0 -0.1"/><mass value="{mass}"/>'
    '<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" effort="30" velocity="4"/>'


def link(name: str, mass: str = "1", moments: tuple[str, str, str] = ("0.01",) * 3) -> str:
    ixx, iyy, izz = moments
    return f'<link name="{name}">{BODY.format(mass=mass, ixx=ixx, iyy=iyy, izz=izz)}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    inside: str = LIMIT,
    axis: str = "0 1 0",
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 -0.2"/><axis xyz="{axis}"/>{inside}</joint>'
    )


def write(folder: Path, *parts: str) -> Path:
    path = folder / "toy.urdf"
    path.write_text(f'<robot name="toy">{"".join(parts)}</robot>')
    return path


def two_links(folder: Path, kind: str = "revolute", inside: str = LIMIT, **changes: str) -> Path:
    body = link("base", "3") + link("shank", **changes)
    return write(folder, body, joint("knee", "base", "shank", kind, inside))


def refusal(path: Path) -> str:
    with pytest.raises(ModelError) as caught:
        Robot.load(path)
    return str(caught.value)


def test_a_urdf_floats_at_its_root(tmp_path: Path) -> None:
    robot = Robot.load(two_links(tmp_path))
    assert (robot.name, robot.nq, robot.nv, robot.joint_names) == ("toy", 8, 7, ("knee",))
    assert robot.mass == 4.0
    assert robot.model.joints[1].shortname() == "JointModelFreeFlyer"


@pytest.mark.parametrize(("kind", "nq"), [("revolute", 8), ("prismatic", 8), ("continuous", 9)])
def test_joints_of_one_axis_are_accepted(tmp_path: Path, kind: str, nq: int) -> None:
    robot = Robot.load(two_links(tmp_path, kind))
    assert (robot.nq, robot.nv) == (nq, 7)


def test_an_oblique_axis_is_accepted(tmp_path: Path) -> None:
    parts = link("base"), link("shank"), joint("knee", "base", "shank", axis="1 1 0")
    assert Robot.load(write(tmp_path, *parts)).nv == 7


def test_missing_limits_are_named(tmp_path: Path) -> None:
    robot = Robot.load(two_links(tmp_path, inside=""))
    assert robot.limits.missing == ("knee: position", "knee: velocity", "knee: effort")
    robot = Robot.load(two_links(tmp_path, inside='<limit lower="-1" upper="1" effort="0"/>'))
    assert robot.limits.missing == ("knee: velocity", "knee: effort")
    robot = Robot.load(two_links(tmp_path, "continuous", '<limit velocity="3" effort="1"/>'))
    assert robot.limits.missing == ()


def test_a_floating_joint_from_an_empty_world_is_the_root(tmp_path: Path) -> None:
    world = '<link name="world"/>' + joint("root", "world", "base", "floating", "")
    parts = world, link("base", "3"), link("shank"), joint("knee", "base", "shank")
    robot = Robot.load(write(tmp_path, *parts))
    assert (robot.nq, robot.nv) == (8, 7)
    np.testing.assert_array_equal(robot.model.jointPlacements[1].homogeneous, np.eye(4))


def test_massless_fixed_frames_are_fine(tmp_path: Path) -> None:
    path = two_links(tmp_path)
    tip = '<link name="tip"/>' + joint("tip_fixed", "shank", "tip", "fixed", "")
    path.write_text(path.read_text().replace("</robot>", f"{tip}</robot>"))
    robot = Robot.load(path)
    assert robot.nv == 7
    assert "tip" in robot.frame_names


def test_a_massless_link_between_two_joints_is_noted(tmp_path: Path) -> None:
    parts = (
        link("base", "3") + '<link name="cross"/>' + link("shank"),
        joint("roll", "base", "cross", axis="1 0 0") + joint("pitch", "cross", "shank"),
    )
    robot = Robot.load(write(tmp_path, *parts), feet={}, base="floating")
    assert robot.notes == ("links without mass between two joints: cross",)


REFUSED_URDFS = {
    "planar": (link("a") + link("b") + joint("j", "a", "b", "planar"), ("'j'", "planar")),
    "spherical": (link("a") + link("b") + joint("j", "a", "b", "ball"), ("'j'", "ball")),
    "floating inside": (link("a") + link("b") + joint("j", "a", "b", "floating"), ("'j'", "root")),
    "mimic in a circle": (
        link("a")
        + link("b")
        + link("c")
        + joint("j", "a", "b", inside=LIMIT + '<mimic joint="k"/>')
        + joint("k", "b", "c", inside=LIMIT + '<mimic joint="j"/>'),
        ("'j'", "'k'", "in a circle", "locked={'j': 0.0, 'k': 0.0}"),
    ),
    "mimic of nothing": (
        link("a") + link("b") + joint("j", "a", "b", inside=LIMIT + '<mimic joint="x"/>'),
        ("'j'", "'x'", "not supported"),
    ),
    "mimic that turns": (
        link("a")
        + link("b")
        + link("c")
        + joint("j", "a", "b")
        + joint("k", "b", "c", "continuous", LIMIT + '<mimic joint="j"/>'),
        ("'k'", "'j'", "turn without end"),
    ),
    "mimic text": (
        link("a")
        + link("b")
        + joint("j", "a", "b", inside=LIMIT + '<mimic joint="x" offset="pi"/>'),
        ("'j'", "offset", "pi"),
    ),
    "no mass": (link("a") + '<link name="b"/>' + joint("j", "a", "b"), ("'j'", "'b'", "no mass")),
    "zero mass": (link("a") + link("b", "0") + joint("j", "a", "b"), ("'j'", "'b'", "no mass")),
    "negative mass": (link("a") + link("b", "-1") + joint("j", "a", "b"), ("'b'", "negative")),
    "nan mass": (link("a") + link("b", "nan") + joint("j", "a", "b"), ("'b'", "mass", "nan")),
    "nan inertia": (
        link("a") + link("b", "1", ("0.1", "nan", "0.1")) + joint("j", "a", "b"),
        ("'b'", "iyy", "nan"),
    ),
    "negative inertia": (
        link("a") + link("b", "1", ("0.1", "-0.1", "0.1")) + joint("j", "a", "b"),
        ("'j'", "'b'", "negative"),
    ),
    "triangle": (
        link("a") + link("b", "1", ("0.01", "0.01", "0.1")) + joint("j", "a", "b"),
        ("'j'", "'b'", "triangle"),
    ),
    "on its own axis": (
        link("a") + link("b", "1", ("0", "0", "0")) + joint("j", "a", "b", axis="0 0 1"),
        ("'j'", "'b'", "about its axis"),
    ),
    "axis": (link("a") + link("b") + joint("j", "a", "b", axis="0 0 0"), ("'j'", "axis")),
    "swapped limits": (
        link("a")
        + link("b")
        + joint("j", "a", "b", inside='<limit lower="1" upper="-1" effort="1" velocity="1"/>'),
        ("'j'", "lower"),
    ),
    "text limit": (
        link("a") + link("b") + joint("j", "a", "b", inside='<limit lower="-pi" upper="1"/>'),
        ("'j'", "-pi"),
    ),
    "two roots": (link("a") + link("b"), ("one root", "'a'", "'b'")),
    "loop": (
        link("a")
        + link("b")
        + link("c")
        + joint("j", "a", "c")
        + joint("k", "b", "c")
        + joint("l", "a", "b"),
        ("'c'", "loops"),
    ),
    "same name": (link("a") + link("a"), ("2 links", "'a'")),
    "no such link": (link("a") + joint("j", "a", "b"), ("'j'", "child", "'b'")),
    "nothing": ("", ("no <link>",)),
}


@pytest.mark.parametrize("case", REFUSED_URDFS)
def test_unsupported_urdfs_are_refused_by_name(tmp_path: Path, case: str) -> None:
    content, words = REFUSED_URDFS[case]
    message = refusal(write(tmp_path, content))
    assert "toy.urdf" in message
    for word in words:
        assert word in message


def test_refusals_do_not_print(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for content, _ in REFUSED_URDFS.values():
        refusal(write(tmp_path, content))
    assert capfd.readouterr() == ("", "")


def test_broken_files_are_refused_by_line(tmp_path: Path) -> None:
    path = tmp_path / "toy.urdf"
    path.write_text('<robot name="toy">\n<link name="a">\n</robot>')
    assert "line 3" in refusal(path)
    path.write_text("<sdf/>")
    assert "<sdf>" in refusal(path)
    assert "no such file" in refusal(tmp_path / "other.urdf")
    assert "xacro toy.urdf.xacro > toy.urdf" in refusal(tmp_path / "toy.urdf.xacro")


def test_a_little_triangle_violation_is_noted(tmp_path: Path) -> None:
    # The least second moment is (a + b - c) / 2 = -5e-6 kg m^2 against a robot of about 0.05.
    moments = ("0.00001", "0.00001", "0.00003")
    parts = link("base", "3"), link("tag", "0.01", moments), joint("j", "base", "tag")
    (note,) = Robot.load(write(tmp_path, *parts), feet={}, base="floating").notes
    assert "triangle" in note
    assert "tag" in note


def test_a_missing_mesh_is_noted(tmp_path: Path) -> None:
    path = two_links(tmp_path)
    shapes = (
        '<collision><geometry><mesh filename="package://toy/none.stl"/></geometry></collision>'
        '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    )
    path.write_text(path.read_text().replace('<link name="shank">', f'<link name="shank">{shapes}'))
    robot = Robot.load(path, feet={}, base="floating")
    (note,) = robot.notes
    assert "package://toy/none.stl" in note
    assert [type(s.geometry).__name__ for s in robot.collision_model.geometryObjects] == ["Sphere"]


def test_a_mesh_is_found_from_its_package_and_beside_the_urdf(tmp_path: Path) -> None:
    package = tmp_path / "elsewhere" / "renamed"
    package.mkdir(parents=True)
    for folder in (package, tmp_path):
        (folder / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    path = two_links(tmp_path)
    text = path.read_text()
    for name in ("package://renamed/cube.obj", "package://toy/cube.obj", "cube.obj"):
        mesh = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        path.write_text(text.replace('<link name="shank">', f'<link name="shank">{mesh}'))
        robot = Robot.load(path, feet={}, base="floating", package_dirs=[tmp_path / "elsewhere"])
        assert robot.notes == ()
        assert len(robot.collision_model.geometryObjects) == 1


def test_a_mesh_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_text("not a mesh")
    path = two_links(tmp_path)
    mesh = '<visual><geometry><mesh filename="bad.stl"/></geometry></visual>'
    path.write_text(path.read_text().replace('<link name="shank">', f'<link name="shank">{mesh}'))
    robot = Robot.load(path)
    with pytest.raises(ModelError, match=r"bad\.stl"):
        _ = robot.visual_model


# ---------------------------------------------------------------------------- locked joints


def test_a_locked_joint_becomes_rigid_at_its_value(tmp_path: Path) -> None:
    path = two_links(tmp_path)
    robot = Robot.load(path, locked={"knee": 0.5})
    assert (robot.nq, robot.nv, robot.joint_names) == (7, 6, ())
    s = robot.snapshot(pin.neutral(robot.model))
    # the shank's CoM is 0.1 below the knee, which is 0.2 below the base, whose CoM is 0.1 below
    x = 1 * -0.1 * np.sin(0.5) / 4
    z = (3 * -0.1 + 1 * (-0.2 - 0.1 * np.cos(0.5))) / 4
    np.testing.assert_allclose(s.com, [x, 0.0, z], atol=1e-12)  # rounding


def test_locking_checks_names_and_limits(tmp_path: Path) -> None:
    path = two_links(tmp_path)
    with pytest.raises(UnknownNameError, match="did you mean 'knee'"):
        Robot.load(path, locked={"kneee": 0.0})
    with pytest.raises(InvalidInputError, match=r"'knee': 2.5 is outside its limits \[-1, 2\]"):
        Robot.load(path, locked={"knee": 2.5})
    with pytest.raises(InvalidInputError, match="finite"):
        Robot.load(path, locked={"knee": float("nan")})


def test_locking_rescues_what_would_be_refused(tmp_path: Path) -> None:
    content, _ = REFUSED_URDFS["mimic in a circle"]
    assert Robot.load(write(tmp_path, content), locked={"j": 0.0, "k": 0.0}).nv == 6
    content, _ = REFUSED_URDFS["mimic that turns"]
    assert Robot.load(write(tmp_path, content), locked={"k": 0.0}).joint_names == ("j",)
    content, _ = REFUSED_URDFS["zero mass"]
    assert Robot.load(write(tmp_path, content), locked={"j": 0.0}).nv == 6


# ---------------------------------------------------------------------------- MJCF

HINGE = '<joint name="knee" type="hinge" axis="0 1 0" range="-60 120" actuatorfrcrange="-9 9"/>'


def mjcf(folder: Path, root: str = "<freejoint/>", inner: str = HINGE, **more: str) -> Path:
    path = folder / "toy.xml"
    path.write_text(
        f'<mujoco model="toy">{more.get("compiler", "")}<worldbody>'
        '<geom name="floor" type="plane" size="1 1 1"/>'
        f'<body name="base_body" pos="0 0 1">{root}<geom type="box" size=".1 .1 .1" mass="3"/>'
        f'<body name="shank" pos="0 0 -.2">{inner}'
        f'<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="1"/>{more.get("shank", "")}'
        f"</body></body>{more.get('world', '')}</worldbody>{more.get('end', '')}</mujoco>"
    )
    return path


@pytest.mark.parametrize("root", ["<freejoint/>", '<joint name="free" type="free"/>', ""])
def test_an_mjcf_has_one_free_flyer(tmp_path: Path, root: str) -> None:
    robot = Robot.load(mjcf(tmp_path, root))
    assert (robot.name, robot.nq, robot.nv, robot.joint_names) == ("toy", 8, 7, ("knee",))
    assert robot.mass == pytest.approx(4.0, abs=1e-12)
    assert robot.snapshot(robot.posture("neutral")).position("base")[2] == 0.0
    np.testing.assert_allclose(robot.limits.lower, np.deg2rad(-60))
    np.testing.assert_allclose(robot.limits.effort, 9.0)
    assert robot.limits.missing == ("knee: velocity",)
    assert len(robot.collision_model.geometryObjects) == 2  # the floor is not the robot's


def test_key_frames_are_postures(tmp_path: Path) -> None:
    # MuJoCo writes quaternions w first
    end = '<keyframe><key name="home" qpos="1 2 3 0.6 0.8 0 0 0.5"/></keyframe>'
    robot = Robot.load(mjcf(tmp_path, end=end))
    np.testing.assert_allclose(robot.postures["home"], [1, 2, 3, 0.8, 0, 0, 0.6, 0.5], atol=1e-12)


MESH = '<geom type="mesh" mesh="m"/>'
REFUSED_MJCFS = {
    "ball": ({"inner": '<joint name="hip" type="ball"/>'}, ("'hip'", "Spherical")),
    "free inside": ({"inner": "<freejoint/>"}, ("FreeFlyer",)),
    "slide in degrees": (
        {"inner": '<joint name="rail" type="slide" range="-1 1"/>'},
        ("'rail'", "radian"),
    ),
    "second body": ({"world": '<body name="ball"><geom size="1"/></body>'}, ("'ball'", "2 bodies")),
    "total mass": ({"compiler": '<compiler settotalmass="50"/>'}, ("settotalmass",)),
    "switched off": (
        {"inner": '<joint name="knee" range="-1 1" limited="false"/>'},
        ("'knee'", "switched off"),
    ),
    "include": ({"world": '<include file="x.xml"/>'}, ("x.xml", "no such file")),
    "itself": ({"world": '<include file="toy.xml"/>'}, ("toy.xml", "included twice")),
    "class": ({"inner": '<joint class="thigh"/>'}, ("<joint>", "'thigh'", "no <default>")),
    "frame": ({"world": '<frame><body name="x"/></frame>'}, ("<frame>", "not supported")),
    "loop": ({"end": '<equality><weld name="w" body1="shank"/></equality>'}, ("weld", "loops")),
    "coupled": (
        {"end": '<equality><joint joint1="knee"/></equality>'},
        ("'knee'", "locked={"),
    ),
    "mesh inertia": ({"shank": MESH, "inner": HINGE}, ("'shank'", "<inertial>")),
    "nan": ({"shank": '<geom size="nan"/>'}, ("'shank'", "size", "nan")),
    "no mass": (
        {"shank": '<body name="t"><joint name="j"/><geom size="1" mass="0"/></body>'},
        ("'j'", "'t'", "no mass"),
    ),
}


@pytest.mark.parametrize("case", REFUSED_MJCFS)
def test_unsupported_mjcfs_are_refused_by_name(tmp_path: Path, case: str) -> None:
    changes, words = REFUSED_MJCFS[case]
    message = refusal(mjcf(tmp_path, **changes))
    for word in words:
        assert word in message


def test_a_slide_is_accepted_in_radians(tmp_path: Path) -> None:
    slide = '<joint name="rail" type="slide" range="-0.5 1"/>'
    robot = Robot.load(mjcf(tmp_path, inner=slide, compiler='<compiler angle="radian"/>'))
    np.testing.assert_array_equal(robot.limits.upper, [1.0])


def test_an_mjcf_whose_mesh_is_missing_has_no_shapes(tmp_path: Path) -> None:
    compiler = '<asset><mesh name="m" file="none.stl"/></asset>'
    robot = Robot.load(mjcf(tmp_path, compiler=compiler))
    assert "none.stl" in robot.notes[0]
    assert len(robot.collision_model.geometryObjects) == 0


LEG = (
    '<body name="{side}_thigh" pos="0 {y} -0.1">'
    '<joint name="{side}_hip" axis="0 1 0" range="-60 60"/>'
    '<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03" mass="1"/>'
    '<body name="{side}_foot" pos="0 0 -0.3"><joint name="{side}_ankle" axis="0 1 0"/>'
    '<geom type="box" pos="0.03 0 -0.03" size="0.1 0.04 0.01" mass="0.5"/>'
    '<geom type="sphere" size="0.03" mass="0.1"/></body></body>'
)


def test_the_feet_of_an_mjcf_are_found(tmp_path: Path) -> None:
    """Shapes are picked out of many: every one of a link, and none of another."""
    legs = "".join(LEG.format(side=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))
    path = tmp_path / "walker.xml"
    path.write_text(
        '<mujoco model="walker"><worldbody><geom name="floor" type="plane" size="1 1 1"/>'
        '<body name="pelvis" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/>'
        f'<geom type="sphere" size="0.05" mass="1"/>{legs}</body></worldbody></mujoco>'
    )
    for _ in range(5):  # which bytes were read in their place differed from run to run
        robot = Robot.load(path)
        assert list(robot.feet) == ["left", "right"]
        for side, y in (("left", 0.1), ("right", -0.1)):
            extent = np.ptp(robot.feet[side].polygon, axis=0)
            np.testing.assert_allclose(extent, [0.2, 0.08], atol=1e-9)
            s = robot.snapshot(robot.postures["standing"])
            np.testing.assert_allclose(s.position(f"{side}_sole"), [0.03, y, 0.0], atol=1e-9)
        for shapes in (robot.collision_model, robot.visual_model):
            links = [robot.model.frames[s.parentFrame].name for s in shapes.geometryObjects]
            assert sorted(links) == sorted(
                ["pelvis"] * 2
                + ["left_thigh", "right_thigh"]
                + ["left_foot"] * 2
                + ["right_foot"] * 2
            )


def turn(axis: str, angle: float) -> np.ndarray:
    return pin.exp3(angle * np.eye(3)["xyz".index(axis)])


def test_several_hinges_of_a_body_turn_one_after_the_other(tmp_path: Path) -> None:
    """Oracle: the product of rotations about the joints' anchor, as MuJoCo's documentation says."""
    joints = "".join(
        f'<joint name="{name}" axis="{axis}" pos="0 0 .05" range="-90 90"/>'
        for name, axis in (("yaw", "0 0 1"), ("roll", "1 0 0"), ("pitch", "0 1 0"))
    )
    end = '<keyframe><key name="bent" qpos="0 0 0 1 0 0 0 0.1 0.2 0.3"/></keyframe>'
    robot = Robot.load(mjcf(tmp_path, inner=joints, end=end), base="floating")
    assert robot.joint_names == ("yaw", "roll", "pitch")
    assert robot.mass == pytest.approx(4.0, abs=1e-12)
    np.testing.assert_allclose(robot.limits.upper, np.pi / 2)
    s = robot.snapshot(robot.postures["bent"])
    R = turn("z", 0.1) @ turn("x", 0.2) @ turn("y", 0.3)
    anchor = np.array([0, 0, 0.05])
    np.testing.assert_allclose(s.rotation("shank"), R, atol=1e-12)
    np.testing.assert_allclose(s.position("shank"), [0, 0, -0.2] + anchor - R @ anchor, atol=1e-12)
    com = s.position("shank") + R @ [0, 0, -0.1]
    np.testing.assert_allclose(s.com, com / 4, atol=1e-12)
    assert len(robot.collision_model.geometryObjects) == 2


def test_included_files_and_repeated_sections_are_one(tmp_path: Path) -> None:
    whole = Robot.load(mjcf(tmp_path))
    (tmp_path / "settings").mkdir()
    (tmp_path / "settings" / "units.xml").write_text(
        '<mujocoinclude><compiler angle="radian"/><default><joint armature="0.02"/></default>'
        "</mujocoinclude>"
    )
    (tmp_path / "leg.xml").write_text(
        '<mujocoinclude><body name="shank" pos="0 0 -.2"><joint name="knee" axis="0 1 0"'
        ' range="-1.047197551 2.094395102" actuatorfrcrange="-9 9"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="1"/></body></mujocoinclude>'
    )
    path = tmp_path / "scene.xml"
    path.write_text(
        '<mujoco model="scene"><worldbody><light pos="0 0 3"/></worldbody>'
        '<include file="settings/units.xml"/><compiler autolimits="true"/>'
        '<worldbody><body name="base_body"><freejoint/><geom type="box" size=".1 .1 .1" mass="3"/>'
        '<include file="leg.xml"/></body></worldbody></mujoco>'
    )
    robot = Robot.load(path)
    assert robot.joint_names == ("knee",)
    assert robot.mass == pytest.approx(4.0, abs=1e-12)
    np.testing.assert_allclose(robot.limits.upper, whole.limits.upper, atol=1e-9)
    q = robot.posture("neutral", {"knee": 0.5})
    a, b = robot.snapshot(q), whole.snapshot(q)
    np.testing.assert_allclose(a.inertia, b.inertia, atol=1e-12)
    assert a.mass_matrix[6, 6] - b.mass_matrix[6, 6] == pytest.approx(0.02, abs=1e-12)


def test_defaults_count_as_in_mujoco(tmp_path: Path) -> None:
    """A class gives mass and rotation, an inner class adds to it, and what is written wins."""
    defaults = (
        '<default><geom mass="9"/><default class="leg"><geom mass="1.5" type="box"'
        ' size=".1 .1 .3"/><joint axis="1 0 0" range="-10 10"/><default class="shin">'
        '<joint range="-20 20"/></default></default></default>'
    )
    path = tmp_path / "toy.xml"
    path.write_text(
        f'<mujoco model="toy">{defaults}<worldbody><body name="b"><freejoint/>'
        '<geom type="sphere" size=".1" mass="2"/><body name="c" childclass="leg">'
        '<joint name="hip"/><geom quat="0.6 0.8 0 0"/><body name="d"><joint name="knee"'
        ' class="shin" axis="0 1 0"/><geom mass="0.5"/></body></body></body></worldbody></mujoco>'
    )
    robot = Robot.load(path)
    assert robot.mass == pytest.approx(2 + 1.5 + 0.5, abs=1e-12)
    np.testing.assert_allclose(robot.limits.upper, np.deg2rad([10, 20]))
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.joint_twists[3:, 6:].T, [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    turned = robot.collision_model.geometryObjects[1].placement.rotation
    np.testing.assert_allclose(turned, pin.Quaternion(0.6, 0.8, 0, 0).matrix(), atol=1e-12)
