"""Reading URDF: what is accepted, what is refused by name, and joints locked in it."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from tests.urdf import collision
from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError, ModelError, UnknownNameError
from wbc.robot import Robot
from wbc.robot.formats import urdf_check

LIMIT = '<limit lower="-1" upper="2" effort="30" velocity="4"/>'
CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"


def link(name: str, mass: float = 1, moment: urdf.Moments = 0.01, inside: str = "") -> str:
    return urdf.link(name, inside, mass, moment, "0 0 -0.1")


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    inside: str = "",
    axis: str = "0 1 0",
    limit: str = LIMIT,
) -> str:
    ends = parent, child, inside
    return urdf.joint(name, *ends, kind=kind, at="0 0 -0.2", axis=axis, limit=limit)


def toy(*parts: str) -> str:
    return urdf.robot("toy", *parts)


def two_links(kind: str = "revolute", limit: str = LIMIT, shapes: str = "") -> str:
    """A base and a shank, which has these shapes."""
    knee = joint("knee", "base", "shank", kind, limit=limit)
    return toy(link("base", 3), link("shank", inside=shapes), knee)


def chain(links: str, *joints: str) -> str:
    """Links of one letter each, on the first of which comes a joint to the next, and so on."""
    return toy(*map(link, links), *joints)


def floating(text: str, **options: object) -> Robot:
    return Robot.load(text, feet={}, base="floating", **options)


def refusal(source: Path | str) -> str:
    with pytest.raises(ModelError) as caught:
        Robot.load(source)
    return str(caught.value)


def test_a_urdf_floats_at_its_root() -> None:
    robot = Robot.load(two_links())
    assert (robot.name, robot.nq, robot.nv, robot.joint_names) == ("toy", 8, 7, ("knee",))
    assert robot.mass == 4.0
    assert robot.model.joints[1].shortname() == "JointModelFreeFlyer"


@pytest.mark.parametrize(("kind", "nq"), [("revolute", 8), ("prismatic", 8), ("continuous", 9)])
@pytest.mark.parametrize("axis", ["0 1 0", "1 1 0"])
def test_joints_of_one_axis_are_accepted(kind: str, nq: int, axis: str) -> None:
    robot = Robot.load(two_links(kind).replace('xyz="0 1 0"', f'xyz="{axis}"'))
    assert (robot.nq, robot.nv) == (nq, 7)


@pytest.mark.parametrize(
    ("kind", "limit", "missing"),
    [
        ("revolute", "", ["position", "velocity", "effort"]),
        ("revolute", '<limit lower="-1" upper="1" effort="0"/>', ["velocity", "effort"]),
        ("continuous", '<limit velocity="3" effort="1"/>', []),
    ],
)
def test_missing_limits_are_named(kind: str, limit: str, missing: list[str]) -> None:
    found = Robot.load(two_links(kind, limit)).limits.missing
    assert found == tuple(f"knee: {one}" for one in missing)


DRAWN = collision('sphere radius="0.1"').replace("collision", "visual")


def six_joints(effort: str = "0", kinds: str = "pppttt", links: str = "") -> str:
    """Return joints from an empty world to ``base`` about x, y, z, x, y, z."""
    named = {"p": "prismatic", "t": "continuous"}
    parts, above = ['<link name="odom"/>'], "odom"
    for k, kind in enumerate(kinds):
        below = f"v{k}" if k < len(kinds) - 1 else "base"
        parts += [] if below == "base" else [f'<link name="{below}">{links}</link>']
        limit = f'<limit lower="-9" upper="9" effort="{effort}" velocity="9"/>'
        axis = " ".join("1" if k % 3 == one else "0" for one in range(3))
        parts.append(joint(f"j{k}", above, below, named[kind], axis=axis, limit=limit))
        above = below
    return "".join(parts)


def test_six_joints_without_motors_are_a_floating_base() -> None:
    body = link("base", 3) + link("shank") + joint("knee", "base", "shank")
    robot = Robot.load(toy(six_joints(), body))
    assert not robot.fixed_base and robot.joint_names == ("knee",)
    assert "joints of the root that are its floating base: j0, j1, j2, j3, j4, j5" in robot.notes
    plain = Robot.load(toy(body), base="floating")
    q = plain.integrate(plain.posture(), np.linspace(-0.4, 0.6, plain.nv), 1.0)
    np.testing.assert_allclose(robot.snapshot(q).mass_matrix, plain.snapshot(q).mass_matrix)
    for other in (
        six_joints(effort="5"),  # motors
        six_joints(kinds="pptttt"),
        six_joints(links=DRAWN),
        six_joints().replace('xyz="0 0 -0.2"', 'xyz="0 0 0" rpy="1 0 0"'),
        six_joints().replace('xyz="0 0 1"', 'xyz="0 1 0"'),
    ):
        assert len(Robot.load(toy(other, body)).joint_names) == 7


@pytest.mark.parametrize("drawn", ["", DRAWN])
def test_a_floating_joint_from_an_empty_world_is_the_root(drawn: str) -> None:
    world = f'<link name="world">{drawn}</link>'
    world += joint("root", "world", "base", "floating", limit="")
    robot = Robot.load(two_links().replace('<link name="base">', f'{world}<link name="base">'))
    assert any("'world'" in note for note in robot.notes) == bool(drawn)
    assert (robot.nq, robot.nv) == (8, 7)
    np.testing.assert_array_equal(robot.model.jointPlacements[1].homogeneous, np.eye(4))


def test_massless_fixed_frames_are_fine() -> None:
    tip = '<link name="tip"/>' + joint("tip_fixed", "shank", "tip", "fixed", limit="")
    robot = Robot.load(two_links().replace("</robot>", f"{tip}</robot>"))
    assert robot.nv == 7
    assert "tip" in robot.frame_names


def test_a_massless_link_between_two_joints_is_noted() -> None:
    joints = joint("roll", "base", "cross", axis="1 0 0") + joint("pitch", "cross", "shank")
    robot = floating(toy(link("base", 3), '<link name="cross"/>', link("shank"), joints))
    assert robot.notes == ("links without mass between two joints: cross",)


def test_placeholders_for_inertias_are_noted() -> None:
    """A chain of eight links over 1.4 m, two of which turn like rods longer than 10 m."""
    names = "abcdefgh"
    parts = [link(name, 0.1, 1) if name in "cg" else link(name) for name in names]
    parts += [joint(f"j{k}", names[k], names[k + 1]) for k in range(7)]
    (note,) = floating(toy(*parts)).notes
    assert "larger than the whole robot" in note and ": c, g;" in note
    few = floating(toy(link("base"), link("arm", 1, 1e4), joint("j", "base", "arm"))).notes
    assert len(few) == 1 and "larger than the whole robot" in few[0] and ": arm;" in few[0]


@pytest.mark.parametrize(
    ("usual", "changed", "told"),
    [
        ("", "", ""),
        ('xyz="0 0 -0.2"', 'xyz="0 0 -200"', "m apart: are lengths in millimetres?"),
        ('xyz="0 0 -0.1"', 'xyz="0 0 -100"', "m apart: are lengths in millimetres?"),  # the CoM
        ('mass value="1"', 'mass value="2000"', "kg: are masses in grams?"),
        ('lower="-1" upper="2"', 'lower="-57" upper="115"', "turn by 115 rad and more: are limits"),
        ('lower="-1" upper="2"', 'lower="-1e16" upper="1e16"', ""),  # none
        ('xyz="0 0 -0.2"', 'xyz="0 0 -0.2" rpy="0 90 0"', "in degrees? joint 'j0', joint 'j1'"),
        ('xyz="0 0 -0.2"', 'xyz="0 0 -0.2" rpy="0 6.2832 0"', ""),
    ],
)
def test_files_in_other_units_are_noted(usual: str, changed: str, told: str) -> None:
    names = "abcde"
    text = chain(names, *(joint(f"j{k}", names[k], names[k + 1]) for k in range(4)))
    notes = floating(text.replace(usual, changed) if usual else text).notes
    assert [told in note for note in notes if "?" in note] == ([True] if told else [])


A, B, C, AB = link("a"), link("b"), link("c"), link("a") + link("b")
J, K = joint("j", "a", "b"), joint("k", "b", "c")
TURNED = A + B.replace('xyz="0 0 -0.1"', 'quat_xyzw="{}"') + J


def mimic(name: str, offset: str = "0") -> str:
    return f'<mimic joint="{name}" offset="{offset}"/>'


TWO_MIMICS = joint("k", "b", "c", inside=mimic("j"))
TWO_MIMICS += joint("m", "a", "d") + joint("n", "d", "e", inside=mimic("m"))
REFUSED_URDFS = {
    "planar": (AB + joint("j", "a", "b", "planar"), ("'j'", "planar")),
    "spherical": (AB + joint("j", "a", "b", "ball"), ("'j'", "ball")),
    "floating inside": (AB + joint("j", "a", "b", "floating"), ("'j'", "root")),
    "mimic in a circle": (
        AB + C + joint("j", "a", "b", inside=mimic("k")) + joint("k", "b", "c", inside=mimic("j")),
        ("'j'", "'k'", "in a circle", "locked={'j': 0.0, 'k': 0.0}"),
    ),
    "mimic of nothing": (
        AB + joint("j", "a", "b", inside=mimic("x")),
        ("'j'", "'x'", "but there is no joint 'x'; or lock"),
    ),
    "mimic that turns": (
        AB + C + link("d") + link("e") + joint("j", "a", "b", "continuous") + TWO_MIMICS,
        ("'k'", "'j' turns without end: give it limits", "locked={'k': 0.0}"),  # n is fine
    ),
    "mimic text": (AB + joint("j", "a", "b", inside=mimic("x", "pi")), ("'j'", "offset", "pi")),
    "mimic beyond all measure": (
        AB + C + joint("j", "a", "b", inside=mimic("k", "-1e308")) + K,
        ("'j'", "offset", "larger than 1000"),
    ),
    "no mass": (A + '<link name="b"/>' + J, ("'j'", "'b'", "no mass")),
    "no mass of several": (
        A + link("b", 0) + link("c", 0) + J + K,
        ("'j'", "no mass", "locked={'j': 0, 'k': 0}"),
    ),
    "inertias of several": (
        A + link("b", 1, (1, 1, 3)) + link("c", 1, (4, 1, 1)) + J + K,
        ("'j'", "triangle", "likewise c"),
    ),
    "no mass at all": ('<link name="a"/><link name="b"/>' + J, ("no link has a mass",)),
    "zero mass": (A + link("b", 0) + J, ("'j'", "'b'", "no mass")),
    "negative mass": (A + link("b", -1) + J, ("'b'", "negative")),
    "nan mass": (A + link("b", np.nan) + J, ("'b'", "mass", "nan")),
    "nan inertia": (A + link("b", 1, (0.1, np.nan, 0.1)) + J, ("'b'", "iyy", "nan")),
    "negative inertia": (A + link("b", 1, (0.1, -0.1, 0.1)) + J, ("'j'", "'b'", "negative")),
    "triangle": (A + link("b", 1, (0.01, 0.01, 0.1)) + J, ("'j'", "'b'", "triangle")),
    "on its own axis": (
        A + link("b", 1, 0) + joint("j", "a", "b", axis="0 0 1"),
        ("'j'", "'b'", "about its axis"),
    ),
    "several on their own axes": (
        A
        + link("b", 1, 0)
        + link("c", 1, 0)
        + "".join(
            joint(n, "a", to, axis="0 0 1").replace('lower="-1" upper="2"', 'lower="1" upper="1"')
            for n, to in (("j", "b"), ("k", "c"))
        ),
        ("'j'", "about its axis", "locked={'j': 1, 'k': 1}"),
    ),
    "axis": (AB + joint("j", "a", "b", axis="0 0 0"), ("'j'", "axis")),
    "quaternion of nothing": (TURNED.format("0 0 0 0"), ("'b'", "quat_xyzw", "no rotation")),
    "quaternion of three": (TURNED.format("0 0 1"), ("'b'", "quat_xyzw", "4 finite numbers")),
    "quaternion and angles": (
        TURNED.format('0 0 0 1" rpy="0 0 1'),
        ("'b'", "both 'rpy' and 'quat_xyzw'"),
    ),
    "swapped limits": (AB + J.replace('upper="2"', 'upper="-2"'), ("'j'", "lower")),
    "text limit": (AB + J.replace('lower="-1"', 'lower="-pi"'), ("'j'", "-pi")),
    "two roots": (AB, ("one root", "'a'", "'b'")),
    "loop": (AB + C + joint("j", "a", "c") + K + joint("l", "a", "b"), ("'c'", "loops")),
    "same name": (A + A, ("2 links", "'a'")),
    "no such link": (A + J, ("'j'", "child", "'b'")),
    "nothing": ("", ("no <link>",)),
}


@pytest.mark.parametrize("case", REFUSED_URDFS)
def test_unsupported_urdfs_are_refused_by_name_and_print_nothing(case: str, capfd) -> None:
    content, words = REFUSED_URDFS[case]
    message = refusal(toy(content))
    assert [word for word in words if word not in message] == []
    assert capfd.readouterr() == ("", "")


def test_prefixes_that_a_file_does_not_declare_are_no_matter() -> None:
    """As of cameras in files for old versions of Gazebo: URDF knows no prefixes."""
    gazebo = '<gazebo><sensor:camera name="c"><controller:x/></sensor:camera></gazebo>'
    found = Robot.load(two_links().replace("</robot>", gazebo + "</robot>"))
    assert found.notes == Robot.load(two_links()).notes


def test_lines_before_the_declaration_are_no_matter() -> None:
    assert Robot.load(f'\n  <?xml version="1.0"?>\n{two_links()}').nv == 7


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<!DOCTYPE html>\n<html><body>a robot<br></body></html>", "web page; download the file"),
        ("robot: g1\n", "is it a robot"),
        ("<robot><link></robot>", "line 1, column 15; mend the file there"),
        ('<robot name="toy">\n<link name="a">\n</robot>', "line 3"),
        ("<sdf/>", "<sdf>"),
        ('<robot name="r"><group name="arm"/></robot>', "an SRDF? load the URDF, with srdf="),
    ],
)
def test_what_is_no_urdf_is_told_as_what_it_is(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    message = refusal(path)
    assert "robot.urdf: " in message and words in message


def test_files_that_are_not_there_or_of_other_formats_are_told(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "other.urdf")
    for name in ("toy.urdf.xacro", "toy.xacro"):
        assert refusal(tmp_path / name).endswith(f"xacro {name} > toy.urdf")
    assert "usda files are not read; export a URDF or an MJCF" in refusal(tmp_path / "toy.usda")
    (tmp_path / "walk.yaml").write_text("robot: {model: g1}")
    assert "a problem file; name its robot" in refusal(tmp_path / "walk.yaml")
    for name, begin in (("toy.mjz", b"PK\x03\x04"), ("toy.urdf.gz", b"\x1f\x8b")):
        (tmp_path / name).write_bytes(begin)
        assert "an archive; unpack it, and name the robot" in refusal(tmp_path / name)


def test_a_file_larger_than_any_robot_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.urdf"
    with path.open("wb") as file:
        file.truncate((64 << 20) + 1)
    assert "robot.urdf: larger than 64 MB; is it a robot?" in refusal(path)


def test_a_little_triangle_violation_is_noted() -> None:
    # The least second moment is (a + b - c) / 2 = -5e-6 kg m^2 against a robot of about 0.05.
    tag = link("tag", 0.01, (0.00001, 0.00001, 0.00003))
    (note,) = floating(toy(link("base", 3), tag, joint("j", "base", "tag"))).notes
    assert "triangle" in note and "tag" in note


BALL = collision('sphere radius="0.1"')


def kinds_of(robot: Robot) -> list[str]:
    return [type(one.geometry).__name__ for one in robot.collision_model.geometryObjects]


def test_a_missing_mesh_is_noted() -> None:
    mesh = collision('mesh filename="package://toy/none.stl"')
    robot = floating(two_links(shapes=mesh + BALL))
    (note,) = robot.notes
    assert "package://toy/none.stl" in note and "package_dirs=[...]" in note
    assert kinds_of(robot) == ["Sphere"]


@pytest.mark.parametrize("version", ["", ' version="1.0"', ' version="1.2"'])
def test_capsules_are_shapes(version: str, capfd: pytest.CaptureFixture[str]) -> None:
    """They came with URDF 1.1; many files have them and say nothing of a version."""
    text = two_links(shapes=collision('capsule radius="0.1" length="0.5"'))
    robot = floating(text.replace('<robot name="toy"', f'<robot name="toy"{version}'))
    (shape,) = robot.collision_model.geometryObjects
    assert (shape.geometry.radius, 2 * shape.geometry.halfLength) == (0.1, 0.5)
    assert robot.notes == ()
    assert capfd.readouterr() == ("", "")


def test_shapes_that_urdf_does_not_know_are_noted(capfd: pytest.CaptureFixture[str]) -> None:
    odd = collision('ellipsoid radii="1 1 1"') + "<visual><geometry/></visual><collision/>"
    robot = floating(two_links(shapes=odd + BALL))
    (note,) = robot.notes
    assert note.startswith("3 shapes")
    assert "<ellipsoid> as collision of link 'shank'" in note
    assert "nothing as visual of link 'shank'" in note
    with pytest.raises(ModelError, match="not found: <ellipsoid> of link 'shank', nothing of"):
        SelfCollision(robot, margin=0.01)  # which would not see them
    assert kinds_of(robot) == ["Sphere"]
    assert capfd.readouterr() == ("", "")


def test_a_joint_without_end_may_follow_one_with_limits() -> None:
    """As the fingers of NAO's own file follow its hands."""
    tie = '<mimic joint="j" multiplier="3" offset="0.5"/>'
    robot = floating(chain("abc", J, joint("k", "b", "c", "continuous", tie, limit="")))
    assert robot.nq == 9
    np.testing.assert_array_equal(robot.limits.upper, [2.0, np.inf])
    q = robot.posture("neutral", {"j": 2.0})
    np.testing.assert_array_equal(q[7:], [2.0, 6.5])


@pytest.mark.parametrize(("held", "told"), [("j", False), ("k", True)])
def test_a_follower_locked_without_its_driver_is_told(held: str, told: bool) -> None:
    text = chain("abc", J, joint("k", "b", "c", inside=mimic("j")))
    robot = floating(text, locked={held: 0.1})
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
def test_standing_moves_a_driver_that_its_mimic_joint_cannot_follow(tie, own, standing) -> None:
    lower, upper = own.split()
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
    follower = joint("k", "b", "c", inside=f'<mimic joint="j" {tie}/>', limit=limit)
    robot = floating(chain("abc", J, follower))
    np.testing.assert_allclose(robot.posture("standing")[7:], standing, atol=1e-9)


@pytest.mark.parametrize("where", ["package://renamed/", "package://toy/", ""])
def test_a_mesh_is_found_from_its_package_and_beside_the_urdf(tmp_path: Path, where: str) -> None:
    package = tmp_path / "elsewhere" / "renamed"
    package.mkdir(parents=True)
    for folder in (package, tmp_path):
        (folder / "cube.obj").write_text(CUBE)
    path = tmp_path / "toy.urdf"
    path.write_text(two_links(shapes=collision(f'mesh filename="{where}cube.obj"')))
    robot = floating(path, package_dirs=[tmp_path / "elsewhere"])
    assert robot.notes == () and len(kinds_of(robot)) == 1


@pytest.mark.parametrize(
    ("variable", "share"), [("ROS_PACKAGE_PATH", "ws"), ("AMENT_PREFIX_PATH", "ws/share")]
)
def test_a_mesh_is_found_where_ros_has_its_package(tmp_path, monkeypatch, variable, share) -> None:
    package = tmp_path / share / "arm"
    package.mkdir(parents=True)
    (package / "cube.obj").write_text(CUBE)
    monkeypatch.setenv(variable, f":/no/such/folder:{tmp_path / 'ws'}")
    mesh = collision('mesh filename="package://arm/cube.obj"')
    assert floating(two_links(shapes=mesh)).notes == ()


TOLD = '<mujoco><compiler meshdir="../parts/"/></mujoco>'


@pytest.mark.parametrize(
    ("name", "head"),
    [
        ("meshes/cube.obj", ""),  # from the package's folder
        ("package://robot/meshes/a%20cube.obj", ""),
        ("package://robot/meshes/other.obj", TOLD),
        ("other.obj", TOLD),
    ],
)
def test_a_mesh_is_found_as_exporters_and_mujoco_mean_it(tmp_path, name: str, head: str) -> None:
    for file in ("meshes/cube.obj", "parts/other.obj", "meshes/a cube.obj", "urdf/robot.urdf"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(CUBE)
    text = two_links(shapes=collision(f'mesh filename="{name}"'))
    path = tmp_path / "urdf/robot.urdf"
    path.write_text(text.replace('<link name="shank">', f'{head}<link name="shank">'))
    robot = floating(path)
    assert robot.notes == () and len(kinds_of(robot)) == 1


def test_a_mesh_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_text("not a mesh")
    mesh = collision(f'mesh filename="{tmp_path / "bad.stl"}"').replace("collision", "visual")
    robot = Robot.load(two_links(shapes=mesh))
    with pytest.raises(ModelError, match=r"bad\.stl"):
        _ = robot.visual_model


# ---------------------------------------------------------------------------- locked joints


def test_a_locked_joint_becomes_rigid_at_its_value() -> None:
    robot = Robot.load(two_links(), locked={"knee": 0.5})
    assert (robot.nq, robot.nv, robot.joint_names) == (7, 6, ())
    s = robot.snapshot(pin.neutral(robot.model))
    # the shank's CoM is 0.1 below the knee, which is 0.2 below the base, whose CoM is 0.1 below
    x = 1 * -0.1 * np.sin(0.5) / 4
    z = (3 * -0.1 + 1 * (-0.2 - 0.1 * np.cos(0.5))) / 4
    np.testing.assert_allclose(s.com, [x, 0.0, z], atol=1e-12)  # rounding


@pytest.mark.parametrize(
    ("locked", "error", "said"),
    [
        ({"kneee": 0.0}, UnknownNameError, "did you mean 'knee'"),
        ({"knee": 2.5}, InvalidInputError, r"'knee': 2.5 is outside its limits \[-1, 2\]"),
        ({"knee": np.nan}, InvalidInputError, "finite"),
    ],
)
def test_locking_checks_names_and_limits(locked: dict[str, float], error: type, said: str) -> None:
    with pytest.raises(error, match=said):
        Robot.load(two_links(), locked=locked)


@pytest.mark.parametrize(
    ("case", "locked", "left"),
    [
        ("mimic in a circle", "jk", set()),
        ("mimic that turns", "k", {"j", "m", "n"}),
        ("zero mass", "j", set()),
    ],
)
def test_locking_rescues_what_would_be_refused(case: str, locked: str, left: set[str]) -> None:
    robot = Robot.load(toy(REFUSED_URDFS[case][0]), locked=dict.fromkeys(locked, 0.0))
    assert set(robot.joint_names) == left


def test_a_world_that_is_no_link_is_the_world() -> None:
    """As Drake's files have it: there the world needs no link of its own."""
    weld = joint("weld", "world", "base", "fixed", limit="")
    text = two_links().replace("</robot>", weld + "</robot>")
    robot = Robot.load(text)
    assert robot.fixed_base and robot.joint_names == ("knee",) and robot.mass == 4.0
    assert any("'world' is not in the file" in note for note in robot.notes)
    # Another link that is not there is a mistake.
    hip = joint("hip", "pelvis", "shank")
    assert "no parent link 'pelvis'" in refusal(text.replace("</robot>", hip + "</robot>"))


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
def test_numbers_with_spaces_around_are_read_as_those_without(around: str, monkeypatch) -> None:
    # As in the URDFs of Unitree's hands: the parser drops an inertia, or the link, for one space.
    # MuJoCo, which would see it, is not always there.
    monkeypatch.setattr(urdf_check, "installed", lambda _: False)
    plain = Robot.load(toy(SPACED), base="floating")
    found = Robot.load(toy(NUMBER.sub(rf'="\1{around}"', SPACED)), base="floating")
    q = found.posture("neutral")
    assert np.array_equal(found.snapshot(q).mass_matrix, plain.snapshot(q).mass_matrix)
    for name in ("lower", "upper", "effort", "velocity"):
        assert np.array_equal(getattr(found.limits, name), getattr(plain.limits, name))
    assert np.array_equal(found.damping, plain.damping)
    assert found.collision_model == plain.collision_model
    assert found.notes == plain.notes
