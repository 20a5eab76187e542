"""Reading URDF: what is accepted, what is refused by name, and joints locked in it."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError, ModelError, UnknownNameError
from wbc.robot import Robot
from wbc.robot.formats import urdf_check

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


def with_shapes(folder: Path, shapes: str) -> Robot:
    """Return the robot of two links, with shapes on its shank."""
    path = two_links(folder)
    path.write_text(path.read_text().replace('<link name="shank">', f'<link name="shank">{shapes}'))
    return Robot.load(path, feet={}, base="floating")


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


DRAWN = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'


def six_joints(effort: str = "0", kinds: str = "pppttt", links: str = "") -> str:
    """Return joints from an empty world to ``base`` about x, y, z, x, y, z."""
    named = {"p": "prismatic", "t": "continuous"}
    parts, above = ['<link name="odom"/>'], "odom"
    for k, kind in enumerate(kinds):
        below = f"v{k}" if k < len(kinds) - 1 else "base"
        parts += [] if below == "base" else [f'<link name="{below}">{links}</link>']
        limit = f'<limit lower="-9" upper="9" effort="{effort}" velocity="9"/>'
        axis = " ".join("1" if k % 3 == one else "0" for one in range(3))
        parts.append(joint(f"j{k}", above, below, named[kind], limit, axis))
        above = below
    return "".join(parts)


def test_six_joints_without_motors_are_a_floating_base(tmp_path: Path) -> None:
    body = link("base", "3") + link("shank") + joint("knee", "base", "shank")
    robot = Robot.load(write(tmp_path, six_joints(), body))
    assert not robot.fixed_base and robot.joint_names == ("knee",)
    assert "joints of the root that are its floating base: j0, j1, j2, j3, j4, j5" in robot.notes
    plain = Robot.load(write(tmp_path, body), base="floating")
    q = plain.integrate(plain.posture(), np.linspace(-0.4, 0.6, plain.nv), 1.0)
    np.testing.assert_allclose(robot.snapshot(q).mass_matrix, plain.snapshot(q).mass_matrix)
    drawn = '<visual><geometry><sphere radius="1"/></geometry></visual>'
    for other in (
        six_joints(effort="5"),  # motors
        six_joints(kinds="pptttt"),
        six_joints(links=drawn),
        six_joints().replace('xyz="0 0 -0.2"', 'xyz="0 0 0" rpy="1 0 0"'),
        six_joints().replace('xyz="0 0 1"', 'xyz="0 1 0"'),
    ):
        assert len(Robot.load(write(tmp_path, other, body)).joint_names) == 7


@pytest.mark.parametrize("drawn", ["", DRAWN])
def test_a_floating_joint_from_an_empty_world_is_the_root(tmp_path: Path, drawn: str) -> None:
    world = f'<link name="world">{drawn}</link>' + joint("root", "world", "base", "floating", "")
    parts = world, link("base", "3"), link("shank"), joint("knee", "base", "shank")
    robot = Robot.load(write(tmp_path, *parts))
    assert any("'world'" in note for note in robot.notes) == bool(drawn)
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


def test_placeholders_for_inertias_are_noted(tmp_path: Path) -> None:
    """A chain of eight links over 1.4 m, two of which turn like rods longer than 10 m."""
    names = "abcdefgh"
    parts = [link(name) for name in names]
    parts[2] = link("c", "0.1", ("1", "1", "1"))
    parts[6] = link("g", "0.1", ("1", "1", "1"))
    parts += [joint(f"j{k}", names[k], names[k + 1]) for k in range(7)]
    (note,) = Robot.load(write(tmp_path, *parts), feet={}, base="floating").notes
    assert "larger than the whole robot" in note
    assert ": c, g;" in note


@pytest.mark.parametrize(
    ("usual", "changed", "told"),
    [
        ("", "", ""),
        ('xyz="0 0 -0.2"', 'xyz="0 0 -200"', "m apart: are lengths in millimetres?"),
        ('mass value="1"', 'mass value="2000"', "kg: are masses in grams?"),
        ('lower="-1" upper="2"', 'lower="-57" upper="115"', "turn by 115 rad and more: are limits"),
        ('lower="-1" upper="2"', 'lower="-1e16" upper="1e16"', ""),  # none
    ],
)
def test_files_in_other_units_are_noted(
    tmp_path: Path, usual: str, changed: str, told: str
) -> None:
    names = "abcde"
    parts = [link(name) for name in names]
    parts += [joint(f"j{k}", names[k], names[k + 1]) for k in range(4)]
    path = write(tmp_path, *(part.replace(usual, changed) if usual else part for part in parts))
    notes = Robot.load(path, feet={}, base="floating").notes
    assert [told in note for note in notes if "?" in note] == ([True] if told else [])


QUATERNION = (link("a") + link("b") + joint("j", "a", "b")).replace(
    '<inertial><origin xyz="0 0 -0.1"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0"'
    ' iyy="0.01" iyz="0" izz="0.01"/></inertial></link><joint',
    '<inertial><origin quat_xyzw="{}"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0"'
    ' iyy="0.01" iyz="0" izz="0.01"/></inertial></link><joint',
)
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
        ("'j'", "'x'", "but there is no joint 'x'; or lock"),
    ),
    "mimic that turns": (
        link("a")
        + link("b")
        + link("c")
        + link("d")
        + joint("j", "a", "b", "continuous")
        + joint("k", "b", "c", inside=LIMIT + '<mimic joint="j"/>')
        + joint("m", "a", "d", inside=LIMIT)
        + joint("n", "d", "e", inside=LIMIT + '<mimic joint="m"/>')
        + link("e"),
        ("'k'", "'j' turns without end: give it limits", "locked={'k': 0.0}"),  # n is fine
    ),
    "mimic text": (
        link("a")
        + link("b")
        + joint("j", "a", "b", inside=LIMIT + '<mimic joint="x" offset="pi"/>'),
        ("'j'", "offset", "pi"),
    ),
    "mimic beyond all measure": (
        link("a")
        + link("b")
        + link("c")
        + joint("j", "a", "b", inside=LIMIT + '<mimic joint="k" offset="-1e308"/>')
        + joint("k", "b", "c", inside=LIMIT),
        ("'j'", "offset", "larger than 1000"),
    ),
    "no mass": (link("a") + '<link name="b"/>' + joint("j", "a", "b"), ("'j'", "'b'", "no mass")),
    "no mass of several": (
        link("a") + link("b", "0") + link("c", "0") + joint("j", "a", "b") + joint("k", "b", "c"),
        ("'j'", "no mass", "locked={'j': 0, 'k': 0}"),
    ),
    "inertias of several": (
        link("a")
        + link("b", "1", ("1", "1", "3"))
        + link("c", "1", ("4", "1", "1"))
        + joint("j", "a", "b")
        + joint("k", "b", "c"),
        ("'j'", "triangle", "likewise c"),
    ),
    "no mass at all": (
        '<link name="a"/><link name="b"/>' + joint("j", "a", "b"),
        ("no link has a mass",),
    ),
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
    "quaternion of nothing": (QUATERNION.format("0 0 0 0"), ("'b'", "quat_xyzw", "no rotation")),
    "quaternion of three": (QUATERNION.format("0 0 1"), ("'b'", "quat_xyzw", "4 finite numbers")),
    "quaternion and angles": (
        QUATERNION.format('0 0 0 1" rpy="0 0 1'),
        ("'b'", "both 'rpy' and 'quat_xyzw'"),
    ),
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
def test_unsupported_urdfs_are_refused_by_name_and_print_nothing(
    tmp_path: Path, case: str, capfd: pytest.CaptureFixture[str]
) -> None:
    content, words = REFUSED_URDFS[case]
    message = refusal(write(tmp_path, content))
    assert "toy.urdf" in message
    for word in words:
        assert word in message
    assert capfd.readouterr() == ("", "")


def test_prefixes_that_a_file_does_not_declare_are_no_matter(tmp_path: Path) -> None:
    """As of cameras in files for old versions of Gazebo: URDF knows no prefixes."""
    gazebo = '<gazebo><sensor:camera name="c"><controller:x/></sensor:camera></gazebo>'
    path = two_links(tmp_path)
    plain = Robot.load(path)
    path.write_text(path.read_text().replace("</robot>", gazebo + "</robot>"))
    assert Robot.load(path).notes == plain.notes


def test_lines_before_the_declaration_are_no_matter(tmp_path: Path) -> None:
    path = two_links(tmp_path)
    path.write_text(f'\n  <?xml version="1.0"?>\n{path.read_text()}')
    assert Robot.load(path).nv == 7


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<!DOCTYPE html>\n<html><body>a robot<br></body></html>", "web page; download the file"),
        ("robot: g1\n", "is it a robot"),
        ("<robot><link></robot>", "line 1, column 15; mend the file there"),
    ],
)
def test_what_is_no_xml_is_told_as_what_it_is(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    assert words in refusal(path)


def test_broken_files_are_refused_by_line(tmp_path: Path) -> None:
    path = tmp_path / "toy.urdf"
    path.write_text('<robot name="toy">\n<link name="a">\n</robot>')
    assert "line 3" in refusal(path)
    path.write_text("<sdf/>")
    assert "<sdf>" in refusal(path)
    assert "no such file" in refusal(tmp_path / "other.urdf")
    for name in ("toy.urdf.xacro", "toy.xacro"):
        assert refusal(tmp_path / name).endswith(f"xacro {name} > toy.urdf")
    assert "usda files are not read; export a URDF or an MJCF" in refusal(tmp_path / "toy.usda")


def test_a_file_larger_than_any_robot_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    with path.open("wb") as file:
        file.truncate((64 << 20) + 1)
    assert "robot.urdf: larger than 64 MB; is it a robot?" in refusal(path)


def test_a_little_triangle_violation_is_noted(tmp_path: Path) -> None:
    # The least second moment is (a + b - c) / 2 = -5e-6 kg m^2 against a robot of about 0.05.
    moments = ("0.00001", "0.00001", "0.00003")
    parts = link("base", "3"), link("tag", "0.01", moments), joint("j", "base", "tag")
    (note,) = Robot.load(write(tmp_path, *parts), feet={}, base="floating").notes
    assert "triangle" in note
    assert "tag" in note


def test_a_missing_mesh_is_noted(tmp_path: Path) -> None:
    shapes = (
        '<collision><geometry><mesh filename="package://toy/none.stl"/></geometry></collision>'
        '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    )
    robot = with_shapes(tmp_path, shapes)
    (note,) = robot.notes
    assert "package://toy/none.stl" in note and "package_dirs=[...]" in note
    assert [type(s.geometry).__name__ for s in robot.collision_model.geometryObjects] == ["Sphere"]


@pytest.mark.parametrize("version", ["", ' version="1.0"', ' version="1.2"'])
def test_capsules_are_shapes(tmp_path: Path, version: str, capfd) -> None:
    """They came with URDF 1.1; many files have them and say nothing of a version."""
    path = two_links(tmp_path)
    capsule = '<collision><geometry><capsule radius="0.1" length="0.5"/></geometry></collision>'
    text = path.read_text().replace('<link name="shank">', f'<link name="shank">{capsule}')
    path.write_text(text.replace('<robot name="toy"', f'<robot name="toy"{version}'))
    robot = Robot.load(path, feet={}, base="floating")
    (shape,) = robot.collision_model.geometryObjects
    assert (shape.geometry.radius, 2 * shape.geometry.halfLength) == (0.1, 0.5)
    assert robot.notes == ()
    assert capfd.readouterr() == ("", "")


def test_shapes_that_urdf_does_not_know_are_noted(tmp_path: Path, capfd) -> None:
    shapes = (
        '<collision><geometry><ellipsoid radii="1 1 1"/></geometry></collision>'
        "<visual><geometry/></visual><collision/>"
        '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    )
    robot = with_shapes(tmp_path, shapes)
    (note,) = robot.notes
    assert note.startswith("3 shapes")
    assert "<ellipsoid> as collision of link 'shank'" in note
    assert "nothing as visual of link 'shank'" in note
    with pytest.raises(ModelError, match="not found: <ellipsoid> of link 'shank', nothing of"):
        SelfCollision(robot, margin=0.01)  # which would not see them
    assert [type(s.geometry).__name__ for s in robot.collision_model.geometryObjects] == ["Sphere"]
    assert capfd.readouterr() == ("", "")


def test_a_joint_without_end_may_follow_one_with_limits(tmp_path: Path) -> None:
    """As the fingers of NAO's own file follow its hands."""
    follower = joint("k", "b", "c", "continuous", '<mimic joint="j" multiplier="3" offset="0.5"/>')
    path = write(tmp_path, link("a") + link("b") + link("c") + joint("j", "a", "b") + follower)
    robot = Robot.load(path, feet={}, base="floating")
    assert robot.nq == 9
    np.testing.assert_array_equal(robot.limits.upper, [2.0, np.inf])
    q = robot.posture("neutral", {"j": 2.0})
    np.testing.assert_array_equal(q[7:], [2.0, 6.5])


@pytest.mark.parametrize(("held", "told"), [("j", False), ("k", True)])
def test_a_follower_locked_without_its_driver_is_told(
    tmp_path: Path, held: str, told: bool
) -> None:
    follower = joint("k", "b", "c", inside=LIMIT + '<mimic joint="j"/>')
    path = write(tmp_path, link("a") + link("b") + link("c") + joint("j", "a", "b") + follower)
    robot = Robot.load(path, feet={}, base="floating", locked={held: 0.1})
    assert robot.nq == 7 + told
    said = "locked, though they follow joints that still move: k (j)"
    assert (said in robot.notes) is told


@pytest.mark.parametrize(
    ("tie", "own", "standing"),
    [
        ('multiplier="1" offset=".8"', "-.5 .5", (-0.3, 0.5)),
        ('multiplier="-2"', ".4 .9", (-0.2, 0.4)),
        ('multiplier="0" offset=".4"', "-1 1", (0.0, 0.4)),
    ],
)
def test_standing_moves_a_driver_that_its_mimic_joint_cannot_follow(
    tmp_path: Path, tie: str, own: str, standing: tuple[float, float]
) -> None:
    lower, upper = own.split()
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    follower = joint("k", "b", "c", inside=f'{limit}<mimic joint="j" {tie}/>')
    path = write(tmp_path, link("a") + link("b") + link("c") + joint("j", "a", "b") + follower)
    robot = Robot.load(path, feet={}, base="floating")
    np.testing.assert_allclose(robot.posture("standing")[7:], standing, atol=1e-9)


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


@pytest.mark.parametrize(
    ("variable", "share"), [("ROS_PACKAGE_PATH", "ws"), ("AMENT_PREFIX_PATH", "ws/share")]
)
def test_a_mesh_is_found_where_ros_has_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, share: str
) -> None:
    package = tmp_path / share / "arm"
    package.mkdir(parents=True)
    (package / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    (expanded := tmp_path / "tmp/deep").mkdir(parents=True)
    monkeypatch.setenv(variable, f":/no/such/folder:{tmp_path / 'ws'}")
    mesh = '<collision><geometry><mesh filename="package://arm/cube.obj"/></geometry></collision>'
    assert with_shapes(expanded, mesh).notes == ()


def test_a_mesh_is_found_as_exporters_and_mujoco_mean_it(tmp_path: Path) -> None:
    for folder in ("urdf", "meshes", "parts"):
        (tmp_path / folder).mkdir()
    cube = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"
    (tmp_path / "meshes/cube.obj").write_text(cube)
    (tmp_path / "parts/other.obj").write_text(cube)
    (tmp_path / "meshes/a cube.obj").write_text(cube)
    path, given = tmp_path / "urdf/robot.urdf", two_links(tmp_path).read_text()
    told = '<mujoco><compiler meshdir="../parts/"/></mujoco><link name="shank">'
    for name, before in (
        ("meshes/cube.obj", '<link name="shank">'),  # from the package's folder
        ("package://robot/meshes/a%20cube.obj", '<link name="shank">'),
        ("package://robot/meshes/other.obj", told),
        ("other.obj", told),
    ):
        mesh = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        path.write_text(given.replace('<link name="shank">', before + mesh))
        robot = Robot.load(path, feet={}, base="floating")
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
    robot = Robot.load(write(tmp_path, content), locked={"k": 0.0})
    assert set(robot.joint_names) == {"j", "m", "n"}
    content, _ = REFUSED_URDFS["zero mass"]
    assert Robot.load(write(tmp_path, content), locked={"j": 0.0}).nv == 6


def test_a_world_that_is_no_link_is_the_world(tmp_path: Path) -> None:
    """As Drake's files have it: there the world needs no link of its own."""
    weld = joint("weld", "world", "base", "fixed", "")
    parts = weld, link("base", "3"), link("shank"), joint("knee", "base", "shank")
    robot = Robot.load(write(tmp_path, *parts))
    assert robot.fixed_base and robot.joint_names == ("knee",) and robot.mass == 4.0
    assert any("'world' is not in the file" in note for note in robot.notes)
    # Another link that is not there is a mistake.
    assert "no parent link 'pelvis'" in refusal(
        write(tmp_path, *parts, joint("hip", "pelvis", "shank"))
    )


SPACED = (
    '<link name="a"><inertial><origin xyz="0 0 0.1" rpy="0 0 1"/><mass value="2"/><inertia'
    ' ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="0.03" izz="0.25"/></inertial><collision>'
    '<origin xyz="0 0 1" rpy="0 1 0"/><geometry><cylinder radius="0.1" length="0.5"/></geometry>'
    '</collision></link><link name="b"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0.01"'
    ' ixz="0.02" iyy="0.2" iyz="0.03" izz="0.25"/></inertial></link><joint name="j"'
    ' type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0 1 0"/>'
    '<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="3" velocity="4"/>'
    '<dynamics damping="0.5" friction="0.25"/></joint>'
)
NUMBER = re.compile(r'="([-.\d][-.\d ]*)"')


@pytest.mark.parametrize("around", [" ", "\t", "\n", "&#13;"])
def test_numbers_with_spaces_around_are_read_as_those_without(
    tmp_path: Path, around: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As in the URDFs of Unitree's hands: the parser drops an inertia, or the link, for one space.
    # MuJoCo, which would see it, is not always there.
    monkeypatch.setattr(urdf_check, "installed", lambda _: False)
    plain = Robot.load(write(tmp_path, SPACED), base="floating")
    found = Robot.load(write(tmp_path, NUMBER.sub(rf'="\1{around}"', SPACED)), base="floating")
    q = found.posture("neutral")
    assert np.array_equal(found.snapshot(q).mass_matrix, plain.snapshot(q).mass_matrix)
    for name in ("lower", "upper", "effort", "velocity"):
        assert np.array_equal(getattr(found.limits, name), getattr(plain.limits, name))
    assert np.array_equal(found.damping, plain.damping)
    assert found.collision_model == plain.collision_model
    assert found.notes == plain.notes
