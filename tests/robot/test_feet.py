"""Feet: soles against dimensions read from the files, shapes placed by hand, and plain geometry."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from tests.robot.formats import mjcf_texts as mjcf
from tests.standing import sole_corners
from wbc.constraints import support
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import Walker
from wbc.polygon import centroid, convex_hull, thinned
from wbc.robot import FootSpec, Robot
from wbc.robot.foot_guess import foot_of
from wbc.robot.postures import is_standing
from wbc.robot.sole import extreme_points

Load = Callable[[str], Robot]
Array = np.ndarray


def area(polygon: Array) -> float:
    x, y = polygon.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def sole_in_link(robot: Robot, foot: str, link: str) -> tuple[Array, Array]:
    """Return the sole's corners (k, 3) and normal (3,) in a link's frame."""
    s = robot.snapshot(robot.posture("neutral"))
    frame = robot.feet[foot].frame
    corners = np.column_stack([robot.feet[foot].polygon, np.zeros(len(robot.feet[foot].polygon))])
    world = corners @ s.rotation(frame).T + s.position(frame)
    R = s.rotation(link)
    return (world - s.position(link)) @ R, R.T @ s.rotation(frame)[:, 2]


def unordered(points: Array) -> Array:
    return points[np.lexsort(points.round(9).T)]


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_sole_of_hoap2_like_is_its_box(hoap2: Robot, side: str) -> None:
    x, y = 0.094 / 2, 0.062 / 2
    expected = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    np.testing.assert_allclose(hoap2.feet[side].polygon, expected, atol=1e-9)
    assert hoap2.feet[side].frame == f"{side}_sole"  # the file's own frame, used again
    assert [f.name for f in hoap2.model.frames].count(f"{side}_sole") == 1


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_sole_of_g1_is_below_its_four_balls(g1: Robot, side: str) -> None:
    link = f"{side}_ankle_roll_link"
    balls = []
    for collision in ET.parse(g1.path).findall(f"link[@name='{link}']/collision"):
        origin, sphere = collision.find("origin"), collision.find("geometry/sphere")
        assert origin is not None and sphere is not None
        centre = np.array(origin.get("xyz", "").split(), dtype=float)
        balls.append(centre - [0, 0, float(sphere.get("radius", "nan"))])
    corners, normal = sole_in_link(g1, side, link)
    np.testing.assert_allclose(unordered(corners), unordered(np.array(balls)), atol=1e-12)
    np.testing.assert_allclose(normal, [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("name", ["hoap2_like", "g1", "talos", "icub", "romeo"])
def test_polygons_are_convex_centred_and_mirrored(name: str, robot_named: Load) -> None:
    feet = robot_named(name).feet
    for foot in feet.values():
        edges = np.roll(foot.polygon, -1, axis=0) - foot.polygon
        following = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
        assert (turns > 0).all()  # counter-clockwise, no straight corner
        np.testing.assert_allclose(centroid(foot.polygon), 0.0, atol=1e-9)
        with pytest.raises(ValueError, match="read-only"):
            foot.polygon[0] = 0.0
    left, right = (feet[side].polygon * [1, sign] for side, sign in (("left", 1), ("right", -1)))
    # 0.1 mm: the meshes of the two feet are not mirrored to the last digit
    np.testing.assert_allclose(unordered(left.round(4)), unordered(right.round(4)), atol=1.1e-4)


# The SRDFs give 205 x 122 mm (TALOS) and 193.5 x 121 mm (Romeo, with its rounded edges).
@pytest.mark.parametrize(
    ("name", "size", "slack"), [("talos", (0.205, 0.122), 4e-3), ("romeo", (0.1935, 0.121), 0.012)]
)
def test_soles_of_a_humanoid_are_of_their_size(name, size, slack: float, robot_named: Load) -> None:
    extent = np.ptp(robot_named(name).feet["left"].polygon, axis=0)
    np.testing.assert_allclose(extent, size, atol=slack)


# ---------------------------------------------------------------------------- a toy with legs

BOX = urdf.collision('box size="0.2 0.1 0.02"', "0.02 0 -0.05")


SOLE = np.array([[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])  # of that box
LEFT_RIGHT = (("left", 0.1), ("right", -0.1))


def legged(rpy: str = "0 0 0", shape: str = BOX, extra: str = "", **names: str) -> str:
    """One body with two feet, whose links are turned by ``rpy`` against the body."""
    parts = [urdf.link("body")]
    for side, y in LEFT_RIGHT:
        name = names.get(side, f"{side}_foot")
        parts.append(
            f'{urdf.link(name, shape)}<joint name="{side}_ankle" type="revolute">'
            f'<parent link="body"/><child link="{name}"/><origin xyz="0 {y} -0.5" rpy="{rpy}"/>'
            f'<axis xyz="0 1 0"/>{urdf.limit(1, 1, 1)}</joint>'
        )
    return urdf.robot("legged", *parts, extra)


def links_of(robot: Robot) -> dict[str, str]:
    return {name: foot.link for name, foot in robot.feet.items()}


def test_feet_are_guessed_from_names_and_shapes() -> None:
    robot = Robot.load(legged())
    assert links_of(robot) == {"left": "left_foot", "right": "right_foot"}
    s = robot.snapshot(robot.postures["standing"])
    np.testing.assert_allclose(s.position("left_sole"), [0.02, 0.1, 0.0], atol=1e-12)
    assert s.position("base")[2] == pytest.approx(0.56)  # 0.5 to the ankle, 0.06 to the sole


def test_no_feet_are_said_at_load_and_when_asked_for(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot.load(legged(shape=""))
    assert robot.feet == {}
    (note,) = robot.notes
    assert "no feet were found: no shapes to find soles from on left_foot, right_foot" in note
    assert "feet: {left: {link: LINK}, ...}" in note
    assert caplog.messages == [f"{robot.path}: {note}"]
    with pytest.raises(UnknownNameError, match=r"foot of legged 'left'; .*feet: \{left: \{link"):
        support(robot.snapshot(robot.posture("neutral")), "double")
    caplog.clear()
    robot = Robot.load(legged(), feet={})  # meant so
    assert (robot.feet, robot.notes, caplog.records) == ({}, (), [])


@pytest.mark.parametrize(
    ("left", "right", "feet"),
    [
        ("LEFT_FOOT", "RIGHT_FOOT", ["left", "right"]),
        ("lfoot", "rfoot", ["left", "right"]),
        ("l_sole", "r_sole", ["left", "right"]),
        ("r2/left_foot", "r2/right_foot", ["left", "right"]),  # a namespace is no side
        ("L_ANKLE_R_S", "R_ANKLE_R_S", ["left", "right"]),  # about roll
        ("LLEG_ANKLE_R", "RLEG_ANKLE_R", ["left", "right"]),
        ("FL_foot", "FR_foot", ["left", "right"]),  # a biped may call its legs front ones
        ("LF_FOOT", "RH_FOOT", ["front_left", "hind_right"]),
        ("one", "two", ["left", "right"]),  # the lowest flat bodies, the left one first
    ],
)
def test_feet_go_by_many_names(left: str, right: str, feet: list[str]) -> None:
    robot = Robot.load(legged(left=left, right=right))
    assert links_of(robot) == dict(zip(feet, (left, right), strict=True))
    s = robot.snapshot(robot.postures["standing"])
    np.testing.assert_allclose(s.position(f"{feet[0]}_sole"), [0.02, 0.1, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        ({"left": "wheel_l", "right": "wheel_r"}, "it has wheels, and wheels are no soles"),
        ({"left": "left_foot_wheel", "right": "x"}, "it has wheels, and wheels are no soles"),
        ({"left": "l_hand", "right": "r_hand"}, "r_hand, l_hand, are called hands or wheels"),
        ({"left": "one", "right": "two", "shape": BOX.replace("0.2 0.1", "0.02 0.02")}, "no flat"),
    ],
)
def test_why_no_feet_were_found_is_said(names: dict[str, str], reason: str) -> None:
    robot = Robot.load(legged(**names))
    (note,) = robot.notes
    assert robot.feet == {} and note.startswith("no feet were found: ") and reason in note


@pytest.mark.parametrize("fingers", ["f{}", "finger_{}", "l_ring_{}"])
def test_fingers_of_a_hand_are_no_feet(fingers: str) -> None:
    parts = [urdf.link("left_palm"), urdf.link("mount")]
    parts.append(urdf.joint("m", "left_palm", "mount", kind="fixed"))
    for k, (x, y) in enumerate(((0.1, 0.1), (0.1, -0.1), (-0.1, 0.1), (-0.1, -0.1))):
        tip = fingers.format("abcd"[k])
        shape = urdf.collision('box size="0.02 0.02 0.1"', "0 0 -0.05")
        parts += [urdf.link(tip, shape), urdf.joint(f"j{k}", "mount", tip, at=f"{x} {y} -0.1")]
    robot = Robot.load(urdf.robot("hand", *parts))
    assert robot.feet == {} and robot.fixed_base


def test_fingers_of_a_hand_in_an_mjcf_are_no_feet() -> None:
    fingers = (
        f'<body pos="{x} {y} -.1"><joint axis="0 1 0"/><geom type="box" size=".01 .01 .05"/></body>'
        for x in (0.1, -0.1)
        for y in (0.1, -0.1)
    )
    hand = f'<body name="left_hand"><body name="mount"><geom size=".05"/>{"".join(fingers)}</body>'
    robot = Robot.load(f"<mujoco><worldbody>{hand}</body></worldbody></mujoco>")
    assert robot.feet == {} and robot.fixed_base


def test_notes_on_a_robot_are_logged_once(tmp_path: Path, caplog) -> None:
    path = tmp_path / "armature.urdf"
    path.write_text(legged())
    options = {"armature": 300.0}  # more than the whole robot's inertia: a unit, most likely
    first = Robot.load(path, **options)
    assert first.notes
    assert caplog.messages == [f"{path}: {note}" for note in first.notes]
    assert all(record.levelname == "WARNING" for record in caplog.records)
    Robot.load(path, **options)
    assert len(caplog.records) == len(first.notes)


def test_a_foot_without_its_other_one_is_said(caplog: pytest.LogCaptureFixture) -> None:
    text = legged(left="left_foot", right="starboard")
    robot = Robot.load(text)
    assert list(robot.feet) == ["left"]
    assert "no link is called the right foot, as left_foot is" in robot.notes[0]
    assert "not all feet were found" in caplog.text
    both = {"left": {"link": "left_foot"}, "right": {"link": "starboard"}}
    assert Robot.load(text, feet=both).notes == ()


@pytest.mark.parametrize("axis", ["y", "-y", "x", "-x"])
def test_a_file_whose_other_axis_points_up_stands_upright(axis: str) -> None:
    """The toy, described in axes that are turned against the ground."""
    up = {"y": (1, 0, 0), "-y": (-1, 0, 0), "x": (0, -1, 0), "-x": (0, 1, 0)}[axis]
    turn = pin.exp3(-np.pi / 2 * np.array(up))  # takes z, up, to the axis
    rpy = " ".join(map(str, pin.rpy.matrixToRpy(turn).tolist()))
    text = legged()
    for _, y in LEFT_RIGHT:
        place = " ".join(map(str, (turn @ [0.0, y, -0.5]).tolist()))
        text = text.replace(f'xyz="0 {y} -0.5" rpy="0 0 0"', f'xyz="{place}" rpy="{rpy}"')
    robot = Robot.load(text)
    assert f"the base's {axis} axis points up" in robot.notes[0]
    s = robot.snapshot(robot.posture("standing"))
    for side, y in LEFT_RIGHT:
        place = s.position(f"{side}_sole") - s.position("base")
        np.testing.assert_allclose(place, [0.02, y, -0.56], atol=1e-9)
        np.testing.assert_allclose(s.rotation(f"{side}_sole"), np.eye(3), atol=1e-9)


def test_a_base_between_the_soles_stays_upright() -> None:
    """As OP2's and others' whose root is on the ground, below their ankles."""
    trunk = urdf.link("trunk") + '<joint name="up" type="fixed">'
    trunk += '<parent link="body"/><child link="trunk"/><origin xyz="0 0 0.8"/></joint>'
    robot = Robot.load(legged(extra=trunk).replace(" -0.5", " 0.06"))
    assert robot.notes == ()
    s = robot.snapshot(robot.posture("standing"))
    np.testing.assert_allclose(s.rotation("base"), np.eye(3), atol=1e-12)
    assert s.com[2] > 0.2


def test_joints_that_stand_at_an_end_of_their_ranges_are_told() -> None:
    """As calves of quadrupeds, of which 0 is out of range: their first steps met the bounds."""
    text = legged().replace('lower="-1"', 'lower="-1.5"').replace('upper="1"', 'upper="-0.3"', 1)
    robot = Robot.load(text)
    assert robot.snapshot(robot.posture("standing")).q[7] == -0.3
    assert any("'standing' has left_ankle at an end of their" in note for note in robot.notes)
    assert "right_ankle" not in str(robot.notes)


def test_a_robot_that_its_file_lays_down_stands_up() -> None:
    """As in tasks about getting up: the file's own pose of the base is not how it stands."""
    lies = '<body name="trunk" pos="0 0 0.1" quat="0.7071 0 0.7071 0"><freejoint/>'
    robot = Robot.load(mjcf.text(mjcf.LEGS, root=lies + mjcf.INERTIAL.format(5)))
    lying, up = (robot.snapshot(robot.postures[name]) for name in ("neutral", "standing"))
    np.testing.assert_allclose(lying.rotation("trunk")[:, 0], [0, 0, -1], atol=1e-3)
    np.testing.assert_allclose(up.rotation("trunk"), np.eye(3), atol=1e-12)
    np.testing.assert_allclose(up.position("left_sole"), [0.0, 0.2, 0.0], atol=1e-9)


def test_feet_that_are_points_are_said() -> None:
    robot = Robot.load(legged(shape=urdf.collision('sphere radius="0.02"')))
    assert "its feet are points" in robot.notes[0]
    with pytest.raises(InvalidInputError, match=r"soles to .* expected.* left_foot, right_foot"):
        Walker(robot)


def test_a_base_that_faces_backwards_is_turned(tmp_path: Path) -> None:
    text = legged(left="right_foot", right="left_foot")
    robot = Robot.load(text)
    assert "its -x axis forwards" in robot.notes[0]
    s = robot.snapshot(robot.posture("standing"))
    np.testing.assert_allclose(s.rotation("base"), np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(s.position("left_sole"), [-0.02, 0.1, 0.0], atol=1e-9)
    srdf = tmp_path / "legged.srdf"
    srdf.write_text(
        '<robot name="legged"><group_state name="standing" group="all">'
        '<joint name="root_joint" value="0 0 1 0 0 0.6 0.8"/></group_state></robot>'
    )
    told = Robot.load(text, srdf=srdf)  # a file that says how it stands is believed
    np.testing.assert_allclose(told.posture("standing")[3:7], [0, 0, 0.6, 0.8])
    assert told.notes == ()


def test_shapes_to_draw_do_where_none_collide() -> None:
    foot = Robot.load(legged(shape=BOX.replace("collision>", "visual>"))).feet["left"]
    np.testing.assert_allclose(np.ptp(foot.polygon, axis=0), [0.2, 0.1], atol=1e-12)


def test_feet_of_a_quadruped_are_named_by_all_or_in_a_list(g1: Robot) -> None:
    """They stand as they should in test_library.py."""
    folder = next(p for p in g1.path.parents if p.name == "robots")
    robot = Robot.load(folder / "go2_description/urdf/go2.urdf")
    s = robot.snapshot(robot.posture("standing"))
    for name, foot in robot.feet.items():
        place = s.position(foot.frame)
        assert (place[0] > s.com[0]) == name.startswith("front")
        assert (place[1] > s.com[1]) == name.endswith("left")
    soles = [foot.frame for foot in robot.feet.values()]
    assert [contact.frame for contact in support(s, "all")] == soles
    some = support(s, ["hind_left", soles[0]])
    assert [contact.frame for contact in some] == [soles[2], soles[0]]
    with pytest.raises(UnknownNameError, match=r"its feet are front_left, .*; write all, or a"):
        support(s, "double")


def test_all_feet_of_a_robot_without_any_are_refused(g1: Robot) -> None:
    folder = next(p for p in g1.path.parents if p.name == "robots")
    arm = Robot.load(folder / "ur_description/urdf/ur5_robot.urdf")
    with pytest.raises(UnknownNameError, match="no feet were found"):
        support(arm.snapshot(arm.posture("neutral")), "all")


def test_standing_is_found_where_the_neutral_posture_falls() -> None:
    """A heavy box far in front: the ankles lean back until the CoM is over the soles again."""
    heavy = urdf.link("box", mass=2, moment=0.1)
    heavy += urdf.joint("arm", "body", "box", kind="fixed", at="0.6 0 0.3", limit="")
    robot = Robot.load(legged(extra=heavy))
    assert robot.notes == ()
    s = robot.snapshot(robot.posture("standing"))
    corners = sole_corners(s)
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=1e-5)
    assert corners[:, 0].min() < s.com[0] < corners[:, 0].max()
    assert robot.snapshot(robot.posture("neutral")).com[0] > 0.2  # which the soles do not reach
    stiff = legged(extra=heavy.replace('"0.6 0 0.3"', '"9 0 0"'))
    assert "posture 'standing' does not stand" in Robot.load(stiff).notes[0]


def test_upside_down_is_not_standing(hoap2: Robot) -> None:
    q = hoap2.posture("standing")
    assert is_standing(hoap2.model, q, hoap2.feet)
    q[3:7] = (pin.Quaternion(q[3:7]) * pin.Quaternion(np.diag([1.0, -1.0, -1.0]))).coeffs()
    assert not is_standing(hoap2.model, q, hoap2.feet)


@pytest.mark.parametrize(("name", "link"), [("g1", "left_ankle_roll_link"), ("romeo", "l_ankle")])
def test_the_lowest_link_of_a_side_is_the_foot(name: str, link: str, robot_named: Load) -> None:
    whole = robot_named(name)
    foot = Robot.load(whole.path).feet["left"]
    assert foot.link == link
    np.testing.assert_allclose(foot.polygon, whole.feet["left"].polygon, atol=1e-12)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (-1, 0, 0), (1, 1, 1), (0, 0, 0)], ids=str)
def test_the_sole_faces_down_however_its_link_is_turned(axis: tuple[int, int, int]) -> None:
    turn = pin.exp3(2.0 * np.array(axis))  # 2 rad and more, no right angle
    rpy = [" ".join(map(str, pin.rpy.matrixToRpy(R).tolist())) for R in (turn, turn.T)]
    centre = " ".join(map(str, (turn.T @ [0.02, 0, -0.05]).tolist()))
    robot = Robot.load(legged(rpy[0], urdf.collision('box size="0.2 0.1 0.02"', centre, rpy[1])))
    foot = robot.feet["left"]
    np.testing.assert_allclose(unordered(foot.polygon), unordered(SOLE), atol=1e-9)
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.rotation(foot.frame), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(s.position(foot.frame), [0.02, 0.1, -0.56], atol=1e-9)


def test_a_level_sole_that_the_posture_tilts_is_still_level() -> None:
    robot = Robot.load(legged("0.02 -0.01 0"))  # rad: one degree
    polygon = robot.feet["left"].polygon
    np.testing.assert_allclose(unordered(polygon), unordered(SOLE), atol=1e-9)
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.rotation("left_sole"), s.rotation("left_foot"), atol=1e-12)


@pytest.mark.parametrize("kind", [FootSpec, dict])
def test_a_given_polygon_is_taken(kind: type) -> None:
    corners = [[0.1, 0.0], [0.0, 0.03], [0.0, -0.03], [0.03, 0.0]]  # any order, one inside
    spec = kind(link="left_foot", polygon=corners, height=0.07)
    robot = Robot.load(legged(shape=""), feet={"paw": spec})
    assert list(robot.feet) == ["paw"]
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.position("paw_sole"), [0.1 / 3, 0.1, -0.57], atol=1e-12)
    polygon = robot.feet["paw"].polygon + np.array([0.1 / 3, 0.0])
    np.testing.assert_allclose(unordered(polygon), unordered(np.array(corners[:3])), atol=1e-12)
    assert area(polygon) == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("spec", "said", "text"),
    [
        (FootSpec("left_fot"), "did you mean 'left_foot'", legged()),
        ({"lnk": "left_foot"}, "foot 'left'", legged()),
        ({"link": ["left_foot"]}, "foot 'left', link", legged()),
        (FootSpec("left_foot", [[0.0, 1.0, 2.0]]), "polygon", legged()),
        (FootSpec("left_foot", []), "corners", legged()),
        (FootSpec("left_foot", 3.0), "corners", legged()),
        ({"link": "left_foot", "polygon": [[1, 2], [3]]}, "foot 'left': polygon", legged()),
        (FootSpec("left_foot"), "no shape", legged(shape="")),
        (FootSpec("left_foot", SOLE), "does not point up", legged("3.14159 0 0")),
    ],
)
def test_feet_that_make_no_sense_are_refused(spec: object, said: str, text: str) -> None:
    with pytest.raises((InvalidInputError, UnknownNameError), match=said):
        Robot.load(text, feet={"left": spec})


def fixed_frame(name: str, xyz: str) -> str:
    return (
        f'<link name="{name}"/><joint name="{name}_joint" type="fixed"><parent link="left_foot"/>'
        f'<child link="{name}"/><origin xyz="{xyz}"/></joint>'
    )


def test_a_frame_of_the_file_is_used_again_if_it_agrees() -> None:
    robot = Robot.load(legged(extra=fixed_frame("left_sole", "0.0195 0 -0.06")))
    assert robot.feet["left"].frame == "left_sole"
    assert robot.notes == ()
    # 0.5 mm between the file's frame and the middle of the sole: the polygon makes up for it
    np.testing.assert_allclose(robot.feet["left"].polygon.mean(axis=0), [0.0005, 0], atol=1e-12)


def test_a_frame_of_the_file_that_disagrees_is_left_alone() -> None:
    robot = Robot.load(legged(extra=fixed_frame("left_sole", "0 0 -0.06")))
    assert robot.feet["left"].frame == "left_sole_centre"
    assert "left_sole_centre" in robot.notes[0]
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.position("left_sole"), [0, 0.1, -0.56], atol=1e-12)
    np.testing.assert_allclose(s.position("left_sole_centre"), [0.02, 0.1, -0.56], atol=1e-12)


def test_frames_of_the_file_with_both_names_of_a_sole_are_left_alone() -> None:
    extra = fixed_frame("left_sole", "0 0 -0.06")
    extra += fixed_frame("left_sole_centre", "0 0 -0.05")
    robot = Robot.load(legged(extra=extra))
    frame = robot.feet["left"].frame
    assert frame == "left_sole_centre_centre"
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_allclose(s.position(frame), [0.02, 0.1, -0.56], atol=1e-12)
    assert s.position("left_sole_centre")[2] > -0.56 + 1e-3


def test_a_link_of_both_sides_is_no_foot() -> None:
    """As NAO's LFootBumperRight, the right bumper of the left foot."""
    assert foot_of("LFootBumperLeft_frame") == foot_of("r2/left_foot") == "left"
    assert foot_of("r1_left_foot") == foot_of("R_LeftAnkle") == "left"
    assert foot_of("LFootBumperRight_frame") is foot_of("r2/foot") is None


@pytest.mark.parametrize("prefix", ["", "left_", "FL_", "rear_"])
def test_what_all_names_begin_with_tells_no_foot(prefix: str) -> None:
    """All four were called left feet, and three were lost."""
    parts = [urdf.link(f"{prefix}trunk", urdf.collision('box size=".4 .2 .1"'))]
    for name, at in (("FL", ".3 .2"), ("FR", ".3 -.2"), ("RL", "-.3 .2"), ("RR", "-.3 -.2")):
        foot = f"{prefix}{name}_foot"
        parts.append(urdf.link(foot, urdf.collision('sphere radius=".02"')))
        parts.append(urdf.joint(f"{name}_leg", f"{prefix}trunk", foot, at=f"{at} -.3"))
    feet = Robot.load(urdf.robot("quadruped", *parts), base="floating").feet.values()
    assert [foot.link[len(prefix) :][:2] for foot in feet] == ["FL", "FR", "RL", "RR"]


# ---------------------------------------------------------------------------- geometry

SHAPES = {
    "box": coal.Box(0.2, 0.1, 0.06),
    "sphere": coal.Sphere(0.1),
    "ellipsoid": coal.Ellipsoid(0.1, 0.2, 0.05),
    "capsule": coal.Capsule(0.03, 0.2),
    "cylinder": coal.Cylinder(0.04, 0.2),
    "cone": coal.Cone(0.05, 0.2),
}


def depth_below(shape: coal.ShapeBase, up: Array) -> float:
    """Return how far the shape reaches below its origin, by Coal's distance to a far plane."""
    plane = coal.Halfspace(np.asarray(up, dtype=float), -1.0)
    identity = coal.Transform3s()
    result = coal.DistanceResult()
    coal.distance(shape, identity, plane, identity, coal.DistanceRequest(), result)
    return 1.0 - float(result.min_distance)


@pytest.mark.parametrize("name", SHAPES)
def test_extreme_points_hold_the_lowest(name: str, rng: np.random.Generator) -> None:
    shape = SHAPES[name]
    for direction in [*np.eye(3), *rng.normal(size=(20, 3))]:
        up = direction / np.linalg.norm(direction)
        lowest = -(extreme_points(shape, up) @ up).min()
        assert lowest == pytest.approx(depth_below(shape, up), abs=1e-7)  # Coal's own tolerance


def test_other_shapes_have_no_points() -> None:
    assert extreme_points(coal.Halfspace(), np.array([0.0, 0.0, 1.0])).shape == (0, 3)


def test_thinning_stays_inside_and_near() -> None:
    turns = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    circle = 0.1 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    thin = thinned(circle, 2e-3)
    assert 4 <= len(thin) < 25
    assert {tuple(corner) for corner in thin} <= {tuple(corner) for corner in circle}
    assert 0.9 < area(thin) / area(circle) <= 1.0
    square = np.array([[0.0, 0.0], [1e-4, 0.0], [1e-4, 1e-4], [0.0, 1e-4]])
    np.testing.assert_array_equal(thinned(square), square)


def test_the_centroid_is_the_mean_of_the_area(rng: np.random.Generator) -> None:
    polygon = convex_hull(np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.05, 0.12]]))
    samples = rng.uniform([0, 0], [0.2, 0.12], size=(200_000, 2))
    edges = np.roll(polygon, -1, axis=0) - polygon
    inside = (
        edges[:, 0] * (samples[:, None, 1] - polygon[:, 1])
        - edges[:, 1] * (samples[:, None, 0] - polygon[:, 0])
        >= 0
    ).all(axis=1)
    # the mean of 1e5 samples spread over 0.06 m is good to 0.2 mm
    np.testing.assert_allclose(centroid(polygon), samples[inside].mean(axis=0), atol=6e-4)


def six_legged(names: list[str], foot: str) -> str:
    """Return an MJCF with three legs to each side, feet fixed to their shanks."""
    inertial = '<inertial pos="0 0 -.1" mass=".3" diaginertia=".01 .01 .01"/>'
    legs = "".join(
        f'<body name="{name}_thigh" pos="{0.3 - 0.3 * (k % 3)} {0.15 if k < 3 else -0.15} 0">'
        f'<joint axis="1 0 0" range="-50 50"/>{inertial}<body name="{name}_shank" pos="0 0 -.2">'
        f'<joint axis="0 1 0" range="-99 99"/>{inertial}'
        f'<body name="{name}_foot" pos="0 0 -.2">{foot}</body></body></body>'
        for k, name in enumerate(names)
    )
    trunk = '<freejoint/><inertial pos="0 0 0" mass="5" diaginertia=".1 .1 .1"/>'
    body = f'<body name="trunk" pos="0 0 .5">{trunk}{legs}</body>'
    return f"<mujoco><worldbody>{body}</worldbody></mujoco>"


def test_middle_feet_of_a_hexapod_that_are_not_found_are_told() -> None:
    ball = '<geom type="sphere" size=".02"/>'
    robot = Robot.load(six_legged(["lf", "lm", "lr", "rf", "rm", "rr"], ball))
    assert len(robot.feet) == 4
    assert any("no part of them: lm_shank, rm_shank; feet=..." in note for note in robot.notes)


def test_feet_of_other_legs_with_the_same_side_in_their_names_are_told() -> None:
    box = '<geom type="box" size=".06 .03 .02"/>'
    robot = Robot.load(six_legged(["l1", "l2", "l3", "r1", "r2", "r3"], box))
    assert {foot.link for foot in robot.feet.values()} == {"l1_foot", "r1_foot"}
    said = "l2_foot, l3_foot, r2_foot, r3_foot of other legs are called so, too, as l1_foot, r1_"
    assert any(said in note for note in robot.notes)


def test_a_mode_means_feet_even_if_joints_are_called_as_they_are() -> None:
    """Hips called left and right were held in place of the soles; in a list a frame's name wins."""
    parts = [urdf.link("trunk", mass=5)]
    for side, y in (("left", 0.1), ("right", -0.1)):
        sole = urdf.collision('box size=".2 .1 .04"', "0 0 -.4")
        parts += [urdf.link(f"{side}_foot", sole), urdf.joint(side, "trunk", f"{side}_foot")]
        parts[-1] = parts[-1].replace('xyz="0 0 0"', f'xyz="0 {y} 0"', 1)
    robot = Robot.load(urdf.robot("r", *parts))
    s = robot.snapshot(robot.posture())
    for mode in ("double", "all", "left"):
        frames = [contact.frame for contact in support(s, mode)]
        assert frames == ["left_sole", "right_sole"][: len(frames)]
    assert [contact.frame for contact in support(s, ["right"])] == ["right"]
