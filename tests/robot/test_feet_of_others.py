"""Feet as robots of others have them: drawn off level, on wheels, with frames at heel and toe."""

import math
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from tests.robot.formats import mjcf_texts as mjcf
from tests.urdf import on_both_legs
from wbc.errors import InvalidInputError
from wbc.gait import Walker
from wbc.polygon import polygon_area
from wbc.robot import Robot
from wbc.robot.postures import is_standing
from wbc.robot.sole import lowest_point

LIMIT = urdf.limit(1.5, 50, 5)
LEFT_RIGHT = ("left", "right")
LEG = (("hip_roll", "1 0 0"), ("hip_pitch", "0 1 0"), ("knee", "0 1 0"))
ANKLE = (("ankle_pitch", "0 1 0"), ("ankle_roll", "1 0 0"))


def link(name: str, shapes: str = "", mass: float = 0.5) -> str:
    return urdf.link(name, shapes, mass)


def joint(name: str, parent: str, child: str, axis: str, xyz: str, kind: str = "revolute") -> str:
    return urdf.joint(name, parent, child, kind=kind, at=xyz, axis=axis, limit=LIMIT)


def box(xyz: str, size: str, rpy: str = "0 0 0") -> str:
    return urdf.collision(f'box size="{size}"', xyz, rpy)


def biped(
    foot: str,
    joints: tuple[tuple[str, str], ...] = LEG + ANKLE,
    extra: str = "",
    end: str = "{0}_foot",
) -> str:
    """Two legs of ``joints``; ``extra`` comes for each side, ``{0}`` being its name."""
    parts = [link("trunk", box("0 0 .2", ".2 .2 .3"), 5)]
    for side, y in (("left", 0.1), ("right", -0.1)):
        above = "trunk"
        for k, (name, axis) in enumerate(joints):
            last = k == len(joints) - 1
            below = end.format(side) if last else f"{side}_l{k}"
            drop = {"knee": -0.3, "ankle_pitch": -0.3}.get(name, 0.0)
            place = f"0 {y if k == 0 else 0} {drop}"
            parts.append(link(below, foot if last else ""))
            parts.append(joint(f"{side}_{name}", above, below, axis, place))
            above = below
        parts.append(extra.replace("{0}", side).replace("{y}", str(y)).replace("{end}", above))
    return urdf.robot("biped", *parts)


def links_of(robot: Robot) -> dict[str, str]:
    return {name: foot.link for name, foot in robot.feet.items()}


def assert_sole_sizes(robot: Robot, size: list[float], atol: float = 1e-9) -> None:
    """Fail unless both soles have this length and width [m]."""
    assert list(robot.feet) == ["left", "right"]
    for foot in robot.feet.values():
        np.testing.assert_allclose(np.ptp(foot.polygon, axis=0), size, atol=atol)


FOOT = box("0.03 0 -.03", ".2 .1 .04")


def gridded(folder: Path, tilt: float) -> str:
    """Write a plate of many small triangles below, tilted about y, as meshes of feet are."""
    grid = np.meshgrid(np.linspace(-0.08, 0.08, 33), np.linspace(-0.03, 0.03, 13))
    x, y = (a.ravel() for a in grid)
    points = np.concatenate([np.stack([x, y, np.full_like(x, z)], axis=1) for z in (0.0, -0.02)])
    c, s = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    rows = "".join(f"v {a} {b} {c}\n" for a, b, c in points)
    faces = "".join(f"f {k} {k + 1} {k + 34}\n" for k in range(1, 33 * 25))
    (folder / "plate.obj").write_text(rows + faces)
    return urdf.collision(f'mesh filename="{folder / "plate.obj"}"')


@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.07, -0.2])
def test_the_sole_of_a_mesh_is_its_whole_face(tmp_path: Path, tilt: float) -> None:
    assert_sole_sizes(Robot.load(biped(gridded(tmp_path, tilt))), [0.16, 0.06], atol=1e-6)


@pytest.mark.parametrize("rpy", ["0 0 0", "0 .07 0", "0 -.2 0", ".15 0 0", "-.1 .1 0", ".1 .45 0"])
def test_the_sole_is_the_face_that_looks_down_however_it_is_drawn(rpy: str) -> None:
    robot = Robot.load(biped(box(".03 0 -.03", ".16 .06 .02", rpy)))
    q = robot.posture("standing")
    for foot in robot.feet.values():
        np.testing.assert_allclose(polygon_area(foot.polygon), 0.16 * 0.06, rtol=1e-9)
        np.testing.assert_allclose(robot.snapshot(q).rotation(foot.frame)[2, 2], 1.0, atol=1e-6)
    assert is_standing(robot.model, q, robot.feet)
    assert not any("stand" in note for note in robot.notes)


def test_a_face_that_is_too_steep_is_no_sole() -> None:
    robot = Robot.load(biped(box(".03 0 -.03", ".16 .06 .02", "0 .7 0")))
    assert all(len(foot.polygon) == 2 for foot in robot.feet.values())  # the edge below


@pytest.mark.parametrize("frames", [("foot_fl", "foot_rr"), ("front_contact", "rear_contact")])
def test_a_foot_that_only_its_frames_are_called_is_found(frames: tuple[str, ...]) -> None:
    """Beside a body that is called an ankle, and has no shapes."""
    extra = "".join(
        f'<link name="{{0}}_{frame}"/>'
        + joint(f"{{0}}_f{k}", "{end}", f"{{0}}_{frame}", "0 1 0", "-.07 .05 -.05", "fixed")
        for k, frame in enumerate(frames)
    )
    robot = Robot.load(biped(FOOT, extra=extra, end="{0}_last").replace('_l4"', '_ankle"'))
    assert links_of(robot) == {side: f"{side}_{frames[0]}" for side in LEFT_RIGHT}
    assert not any("feet" in note for note in robot.notes)


def test_a_sole_far_smaller_than_its_body_is_said() -> None:
    plate, stud = box("0 0 -.03", ".2 .1 .02"), box("0 0 -.045", ".05 .04 .02")
    notes = Robot.load(biped(plate + stud)).notes
    assert sum("of the rectangle round its body" in note for note in notes) == 2
    wide = box("0 0 -.045", ".15 .08 .02")
    assert not any("rectangle" in one for one in Robot.load(biped(plate + wide)).notes)


WHEEL = urdf.collision('cylinder radius=".08" length=".03"', rpy="1.5708 0 0")
BALL_WHEEL = urdf.collision('sphere radius=".08"')


@pytest.mark.parametrize(
    ("end", "wheel"),
    [
        ("{0}_ankle", "{0}_wheel"),
        ("{0}_foot", "{0}_caster"),
        ("{0}_sole", "{0}_front_wheel"),
        ("{0}_foot", "{0}_tire"),  # by its shape, which is round about a joint without limits
    ],
)
@pytest.mark.parametrize("shape", [WHEEL, BALL_WHEEL])
def test_what_carries_wheels_is_no_foot(end: str, wheel: str, shape: str) -> None:
    extra = link(wheel, shape) + joint("{0}_w", "{end}", wheel, "0 1 0", "0 0 -.03", "continuous")
    robot = Robot.load(biped(box("0 0 -.02", ".1 .06 .04"), LEG + ANKLE, extra, end))
    assert not robot.feet
    assert any("it has wheels" in note for note in robot.notes)


@pytest.mark.parametrize(("root", "fixed"), [("base", False), ("trunk", False), ("world", True)])
def test_a_root_called_base_on_wheels_floats(root: str, fixed: bool) -> None:
    drive = joint("{0}_w", "{end}", "{0}_wheel", "0 1 0", "0 0 -.03", "continuous")
    text = biped("", LEG, link("{0}_wheel", WHEEL) + drive, "{0}_shank")
    assert Robot.load(text.replace('"trunk"', f'"{root}"')).fixed_base is fixed


@pytest.mark.parametrize(("kind", "turns"), [("revolute", "1000"), ("continuous", "2")])
def test_a_wheel_on_an_ankle_without_shapes_is_why_there_are_no_feet(kind: str, turns: str) -> None:
    drive = joint("{0}_w", "{end}", "{0}_drum", "0 1 0", "0 0 -.03", kind)
    extra = link("{0}_drum", WHEEL) + drive.replace("1.5", turns)
    robot = Robot.load(biped("", LEG + ANKLE, extra, "{0}_foot"))
    assert not robot.feet
    assert any("it has wheels" in note for note in robot.notes)


@pytest.mark.parametrize(("drop", "found"), [(-0.05, "left_toe"), (-0.02, "left_ankle_pitch")])
def test_an_ankle_is_no_foot_where_its_leg_ends_lower(drop: float, found: str) -> None:
    """Of an Adam Lite's anklePitchLeft and toeLeft; toes beside a sole are level with it."""
    toe = link("{0}_toe", box(f".03 0 {drop}", ".2 .1 .04"))
    toe += joint("{0}_roll", "{end}", "{0}_toe", "1 0 0", "0 0 0")
    ankle = box("0 0 0", ".04 .04 .08")
    text = biped(ankle, LEG + ANKLE[:1], toe, "{0}_ankle_pitch")
    assert Robot.load(text).feet["left"].link == found


def test_bearings_that_are_not_on_the_ground_are_no_wheels() -> None:
    """Those at the ends of rods that bend a ToddlerBot's knees; its soles have other names."""
    rod = link("{0}_bearing", WHEEL.replace(".08", ".01"))
    rod += joint("{0}_rod", "{0}_l2", "{0}_bearing", "0 1 0", "0.03 0 -.2", "continuous")
    robot = Robot.load(biped(FOOT, extra=rod, end="{0}_ank"))
    assert links_of(robot) == {"left": "left_ank", "right": "right_ank"}


def test_a_rotor_on_a_foot_is_no_wheel() -> None:
    rotor = link("{0}_rotor", WHEEL.replace(".08", ".02"))
    rotor += joint("{0}_r", "{end}", "{0}_rotor", "0 1 0", "0 .06 .03", "continuous")
    robot = Robot.load(biped(box("0 0 -.02", ".2 .1 .04"), extra=rotor))
    assert links_of(robot) == {"left": "left_foot", "right": "right_foot"}


@pytest.mark.parametrize(("kind", "shape"), [("continuous", "box"), ("revolute", "disc")])
def test_what_hangs_below_the_soles_is_said(kind: str, shape: str) -> None:
    """What turns without end and is no wheel, and what is round and has limits."""
    hanging = WHEEL if shape == "disc" else box("0 0 0", ".06 .06 .16")
    extra = link("{0}_disc", hanging)
    extra += joint("{0}_w", "{end}", "{0}_disc", "0 1 0", "0 0 -.03", kind)
    robot = Robot.load(biped(box("0 0 -.02", ".1 .06 .04"), extra=extra))
    (note,) = (note for note in robot.notes if "lower than the soles" in note)
    assert "left_disc by 70 mm" in note and "right_disc by 70 mm" in note


@pytest.mark.parametrize(
    "frames",
    [
        ("foot_heel",),
        ("foot_heel", "foot_toe"),
        ("ankle", "sole"),
        ("foot_fl", "foot_fr", "foot_rl", "foot_rr"),
        ("front_contact", "rear_contact"),
    ],
)
@pytest.mark.parametrize("style", ["{0}_{1}", "{2}l_{1}", "{2}f_{1}", "{2}_{1}"])
def test_the_frames_of_one_body_are_one_foot(frames: tuple[str, ...], style: str) -> None:
    """Names such as rl_foot_heel would be of a rear left foot by themselves."""
    parts = ""
    for side in LEFT_RIGHT:
        for k, frame in enumerate(frames):
            name = style.format(side, frame, side[0])
            at = "0 1 0", "-.07 .05 -.05", "fixed"
            parts += f'<link name="{name}"/>' + joint(f"{side}_f{k}", f"{side}_foot", name, *at)
    robot = Robot.load(biped(FOOT).replace("</robot>", parts + "</robot>"))
    assert not any("feet" in note for note in robot.notes)
    assert_sole_sizes(robot, [0.2, 0.1])


@pytest.mark.parametrize(
    ("end", "on_thigh", "on_foot"),
    [
        ("{0}_ankle", "{0}_upper_leg_back_contact", ""),  # as iCub has it
        ("{0}_ankle", "{0}_front_contact", ""),
        ("{0}_end", "{0}_rear_contact", "{0}_front_contact"),
    ],
)
def test_frames_along_one_leg_are_one_foot(end: str, on_thigh: str, on_foot: str) -> None:
    parts = ""
    for name, carrier in ((on_thigh, "{0}_l1"), (on_foot, "{end}")):
        fixed = joint(f"{name}_j", carrier, name, "0 1 0", ".1 0 0", "fixed")
        parts += link(name, "", 0.1) + fixed if name else ""
    thigh = r"\g<0>" + box("0 0 -.1", ".05 .05 .1")
    text = on_both_legs(biped(FOOT, extra=parts, end=end), r'<link name="\w+_l1">', thigh)
    robot = Robot.load(text)
    assert_sole_sizes(robot, [0.2, 0.1])
    assert is_standing(robot.model, robot.posture(), robot.feet)


CORNERS = (("FL", 1, 1), ("FR", 1, -1), ("RL", -1, 1), ("RR", -1, -1))
FOUR_FEET = {
    "front_left": "FL_foot", "front_right": "FR_foot",
    "hind_left": "RL_foot", "hind_right": "RR_foot",
}  # fmt: skip


def test_ankles_above_the_feet_of_four_legs_make_no_two_of_them() -> None:
    parts, ball = [link("trunk", "", 5)], urdf.collision('sphere radius=".02"')
    for corner, x, y in CORNERS:
        ankle, foot = f"{corner}_ankle", f"{corner}_foot"
        parts += [link(ankle, ball), link(foot, ball)]
        parts.append(joint(f"{corner}_hip", "trunk", ankle, "0 1 0", f"{0.2 * x} {0.1 * y} -.2"))
        parts.append(joint(f"{corner}_knee", ankle, foot, "0 1 0", "0 0 -.2"))
    assert links_of(Robot.load(urdf.robot("four", *parts))) == FOUR_FEET


def test_legs_that_stick_out_do_not_turn_the_robot_over() -> None:
    """As an ant's: at zero angles feet are level with the base, whose mass hangs a little lower."""
    parts, down = [urdf.link("trunk", mass=8, at="0 0 -.03")], LIMIT.replace("-1.5", ".5")
    for corner, x, y in CORNERS:
        hip, foot, place = f"{corner}_hip", f"{corner}_foot", f"{0.2 * x} {0.2 * y} 0"
        end = urdf.collision('sphere radius=".02"', f"{0.3 * x} {0.3 * y} 0")
        parts += [link(hip, "", 0.1), link(foot, end, 0.1)]
        parts.append(joint(f"{corner}_h", "trunk", hip, "0 0 1", place))
        knee = joint(f"{corner}_k", hip, foot, f"{-y} {x} 0", place)
        parts.append(knee.replace(LIMIT, down))
    robot = Robot.load(urdf.robot("ant", *parts))
    assert not any("points up" in note for note in robot.notes)
    assert links_of(robot) == FOUR_FEET
    q = robot.posture("standing")
    np.testing.assert_array_equal(q[3:7], [0.0, 0.0, 0.0, 1.0])
    assert q[2] > 0.1


def test_a_hexapod_with_knees_above_its_trunk_is_not_turned_over() -> None:
    """Its feet are named: their joints, the knees, are 80 mm above the base, 0.3 m aside."""
    parts, feet = [link("trunk", mass=3)], {}
    for k in range(6):
        x, y = 0.25 * (1 - k // 2), 0.15 * (-1) ** k
        hip, tibia = f"hip_{k}", f"tibia_{k}"
        parts += [link(hip, mass=0.2), joint(f"h{k}", "trunk", hip, "0 0 1", f"{x} {y} 0")]
        parts += [link(tibia, BALL), joint(f"k{k}", hip, tibia, "1 0 0", f"0 {y} .08")]
        feet[f"leg_{k}"] = {"link": tibia}
    robot = Robot.load(urdf.robot("hexapod", *parts), feet=feet)
    assert not any("turned" in note for note in robot.notes)
    np.testing.assert_allclose(robot.posture()[:7], (0, 0, 0.14, 0, 0, 0, 1), atol=1e-9)


def test_legs_of_insects_are_not_said_to_end_above_the_base() -> None:
    """Their knees are level with the trunk; what makes them feet is to name them."""
    parts, feet = [link("trunk", mass=3)], {}
    for k in range(6):
        tibia, place = f"tibia_{k}", f"{0.2 * math.cos(k + 0.5)} {0.2 * math.sin(k + 0.5)} 0"
        parts += [link(tibia, BALL), joint(f"k{k}", "trunk", tibia, "0 1 0", place)]
        feet[f"leg_{k}"] = {"link": tibia}
    text = urdf.robot("insect", *parts)
    (note,) = (note for note in Robot.load(text).notes if "no feet were found" in note)
    assert "tibia_5, which reach below the base, move about joints level with it" in note
    assert [len(foot.polygon) for foot in Robot.load(text, feet=feet).feet.values()] == [1] * 6


BALL = urdf.collision('sphere radius=".02"', "0 0 -.2")


@pytest.mark.parametrize(
    "names",
    [
        ("FL_calf", "FR_calf", "RL_calf", "RR_calf"),
        ("shank_1", "shank_2", "shank_3", "shank_4"),
        ("lf_foot", "rf_foot", "lr_foot", "rr_foot"),
        ("fl_foot", "fr_foot", "hl_foot", "hr_foot"),
        ("front_left_foot", "FrontRightFoot", "rear_left_foot", "hind_right_foot"),
        ("left_foot_a", "right_foot_a", "left_shank_b", "right_shank_b"),
    ],
)
def test_four_legs_that_end_in_balls_are_four_points(names: tuple[str, ...]) -> None:
    parts = [link("trunk", box("0 0 0", ".5 .2 .1"), 5)]
    places = ((0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1))
    for k, (name, (x, y)) in enumerate(zip(names, places, strict=True)):
        parts += [link(f"thigh{k}"), link(name, BALL)]
        parts.append(joint(f"hip{k}", "trunk", f"thigh{k}", "0 1 0", f"{x} {y} 0"))
        parts.append(joint(f"knee{k}", f"thigh{k}", name, "0 1 0", "0 0 -.2"))
    robot = Robot.load(urdf.robot("four", *parts))
    if "left_foot_a" in names:  # two are called feet, and are taken for them
        assert list(robot.feet) == ["left", "right"]
        return
    assert links_of(robot) == dict(zip(FOUR_FEET, names, strict=True))
    assert all(foot.polygon.shape == (1, 2) for foot in robot.feet.values())


def test_four_ends_without_shapes_are_no_feet() -> None:
    """They were guessed as feet, and the file was refused for their lack of shapes."""
    parts = [link("trunk", box("0 0 0", ".5 .2 .1"), 5)]
    for corner, x, y in CORNERS:
        parts += [link(corner), joint(f"{corner}_j", "trunk", corner, "0 1 0", f"{x} {y} -.2")]
    (note,) = (note for note in Robot.load(urdf.robot("bare", *parts)).notes if "feet" in note)
    assert "the lowest ends of limbs, RR, RL, FR, FL, have no shapes" in note


def test_legs_that_cannot_bring_the_com_to_the_middle_stand_and_are_not_said_to_fall() -> None:
    """On knees alone, which cannot stretch, feet are 0.1 m behind the CoM and bear it."""
    parts = [link("trunk", box("0 0 0", ".5 .2 .1"), 5)]
    for corner, x, y in CORNERS:
        knee = joint(f"{corner}_knee", "trunk", f"{corner}_foot", "0 1 0", f"{0.2 * x} {0.1 * y} 0")
        parts += [link(f"{corner}_foot", BALL), knee.replace('lower="-1.5"', 'lower=".5"')]
    robot = Robot.load(urdf.robot("four", *parts))
    assert is_standing(robot.model, robot.posture(), robot.feet)
    assert not any("does not stand" in note for note in robot.notes)


@pytest.mark.parametrize(
    ("joints", "where"),
    [
        ((("hip_roll", "1 0 0"), ("hip_pitch", "0 1 0"), ("knee", "0 1 0")), "forwards"),
        ((("hip_pitch", "0 1 0"), ("knee", "0 1 0"), ("ankle_pitch", "0 1 0")), "to a side"),
        ((("hip_yaw", "0 0 1"), ("hip_pitch", "0 1 0"), ("knee", "0 1 0"), ANKLE[0]), "to a side"),
    ],
)  # fmt: skip
def test_legs_that_cannot_swing_their_feet_are_refused_when_a_walker_is_made(joints, where) -> None:
    robot = Robot.load(biped(FOOT, joints))
    with pytest.raises(InvalidInputError, match=f"cannot swing the foot {where}"):
        Walker(robot)


def test_places_between_joints_of_one_body_are_no_feet() -> None:
    """In an MJCF ankles of two joints in one body, called foot, which carry wheels."""
    ankles, wheels = '<joint axis="1 0 0" range="-1 1"/><inertial', '<joint axis="0 1 0"/>'
    wheels += '<geom type="cylinder" size=".05 .02" euler="1.5708 0 0"/>'
    legs = mjcf.LEGS.replace("<inertial", ankles)
    legs = legs.replace("</body>", f'<body pos="0 0 -.05">{wheels}</body></body>')
    robot = Robot.load(mjcf.text(legs))
    assert not robot.feet and any("it has wheels" in note for note in robot.notes)


@pytest.mark.parametrize(("left", "right"), [("LL_FOOT", "LR_FOOT"), ("ll_foot", "rl_foot")])
def test_legs_called_left_and_right_are_no_corners(left: str, right: str) -> None:
    """LR and RL are the rear left of a quadruped, and the right leg of these bipeds."""
    text = biped(FOOT).replace('"left_foot"', f'"{left}"')
    robot = Robot.load(text.replace('"right_foot"', f'"{right}"'))
    assert links_of(robot) == {"left": left, "right": right}
    standing = robot.snapshot(robot.posture("standing"))
    assert standing.position("left_sole")[1] > 0.05 > -0.05 > standing.position("right_sole")[1]


def test_ends_of_legs_on_the_sides_they_are_not_called_are_no_guess() -> None:
    """As of a base whose x axis points backwards; with the feet given it is turned."""
    swapped = {"left": "right", "right": "left"}
    text = re.sub("left|right", lambda side: swapped[side[0]], biped(FOOT, end="{0}_leg_6"))
    robot = Robot.load(text)
    assert not robot.feet
    assert any("not on the sides they are called" in note for note in robot.notes)
    robot = Robot.load(text, feet={side: {"link": f"{side}_leg_6"} for side in LEFT_RIGHT})
    assert robot.snapshot(robot.posture()).position("left_sole")[1] > 0.05


def test_feet_without_a_side_or_shapes_are_told_as_such() -> None:
    text = biped("", end="foot_{0}").replace("foot_left", "foot_1").replace("foot_right", "foot_2")
    (note,) = [note for note in Robot.load(text).notes if "no feet" in note]
    assert "no link is called a left or right foot" in note
    assert "foot_2, foot_1, have no shapes" in note


@pytest.mark.parametrize("size", ["200 100 40", ".0002 .0001 .00004"])
def test_soles_in_other_units_are_told(size: str) -> None:
    notes = Robot.load(biped(box("0 0 -.03", size))).notes
    assert sum("in other units?" in note for note in notes) == 2
    assert not any("units" in note for note in Robot.load(biped(FOOT)).notes)


TOE = link("{0}_toe", box(".03 0 0", ".06 .1 .04"), 0.1)
TOE += joint("{0}_ball", "{end}", "{0}_toe", "0 1 0", ".13 0 -.03")


def test_toes_on_joints_of_their_own_are_told_where_they_touch_the_ground() -> None:
    text = biped(FOOT, extra=TOE)
    (note,) = [note for note in Robot.load(text).notes if "soles" in note]
    assert "left_toe, right_toe" in note
    robot = Robot.load(text, locked={"*_ball": 0.0})
    assert not any("soles" in note for note in robot.notes)
    assert_sole_sizes(robot, [0.26, 0.1])  # from the heel to the toe's tip


def test_one_link_is_not_two_feet() -> None:
    both = {name: {"link": "left_foot"} for name in LEFT_RIGHT}
    with pytest.raises(InvalidInputError, match="'left_foot' is the left foot already"):
        Robot.load(biped(FOOT), feet=both)


def test_feet_drawn_rolled_inwards_are_levelled_where_they_are() -> None:
    """By the ankles: hips that share the turn would cross the legs."""
    text = biped(box("0.03 0 -.03", ".2 .1 .04", "ROLL 0 0"))
    robot = Robot.load(text.replace("ROLL", "0.35", 1).replace("ROLL", "-0.35", 1))
    standing = robot.snapshot(robot.posture("standing"))
    for side, y in (("left", 0.1), ("right", -0.1)):
        assert abs(standing.position(f"{side}_sole")[1] - y) < 0.03
        np.testing.assert_allclose(standing.rotation(f"{side}_sole")[2], [0, 0, 1], atol=1e-6)


def test_legs_drawn_astride_come_together_to_stand() -> None:
    """Digit's are, by 0.8 m: soles levelled there are too far apart to walk on."""
    text = biped(box("0.03 0 -.03", ".2 .1 .04", "ROLL 0 0"))
    for side, y, out, back in (("left", "0.1", 0.6, -0.4), ("right", "-0.1", -0.6, 0.4)):
        drawn = f'<child link="{side}_l0"/><origin xyz="0 {y} 0.0"'
        assert drawn in text
        text = text.replace(drawn, f'{drawn} rpy="{out} 0 0"').replace("ROLL", f"{back}", 1)
    robot = Robot.load(text)
    neutral, standing = (robot.snapshot(robot.posture(q)) for q in ("neutral", "standing"))
    wide, now = (
        np.linalg.norm(one.position("left_sole") - one.position("right_sole"))
        for one in (neutral, standing)
    )
    assert wide > 0.9 and now == pytest.approx(0.3 * neutral.com[2], abs=0.05)
    np.testing.assert_allclose(standing.rotation("left_sole")[2], [0, 0, 1], atol=1e-6)


def test_locked_legs_are_told_and_turn_nothing_upside_down() -> None:
    """With both legs locked the base carries the feet, below it; with one, the other stands."""
    robot = Robot.load(biped(FOOT), locked={"*": 0.0})
    assert not robot.feet
    np.testing.assert_array_equal(robot.posture("standing")[3:7], [0.0, 0.0, 0.0, 1.0])
    assert "the base carries left_foot, right_foot with no joint between" in robot.notes[0]
    one = Robot.load(biped(FOOT), locked={"left_*": 0.1})
    assert list(one.feet) == ["right"]
    assert "the base carries left_foot with no joint between" in one.notes[0]


@pytest.mark.parametrize("turned", ["1.5707963 0 0", "0 1.5707963 0.4"])
@pytest.mark.parametrize("radius", [0.06, 0.02])
def test_a_lying_cylinder_stands_on_a_line(turned: str, radius: float) -> None:
    """Not on a facet of the prism that stands for it, which is tilted by 11 degrees.

    Nor on facets that are 1.5 mm higher, as of a thin one: that was a sole 15 mm wide.
    """
    roller = urdf.collision(f'cylinder radius="{radius}" length="0.1"', "0 0 0", turned)
    robot = Robot.load(biped(roller))
    for foot in robot.feet.values():
        assert len(foot.polygon) == 2
        np.testing.assert_allclose(np.linalg.norm(np.ptp(foot.polygon, axis=0)), 0.1, rtol=1e-6)
        np.testing.assert_allclose(robot.frame(foot.frame).placement.rotation[:, 2], [0, 0, 1])
    assert any("left foot touches level ground along a line only" in note for note in robot.notes)


@pytest.mark.parametrize("yaw", [0.1, 0.7, 1.3])
@pytest.mark.parametrize(
    ("along", "corners"), [((-0.07, 0.013, 0.11), 2), ((0.02, 0.02 + 1e-12), 1)]
)
def test_balls_in_line_but_for_rounding_make_a_line_and_in_one_place_a_point(
    yaw: float, along: tuple[float, ...], corners: int
) -> None:
    """Feet were lines 3e-18 m long, and held along these, and soles 1e-18 m wide."""
    places = (f"{t * math.cos(yaw)!r} {t * math.sin(yaw)!r} -0.02" for t in along)
    balls = "".join(urdf.collision('sphere radius="0.01"', place) for place in places)
    robot = Robot.load(biped(balls))
    for foot in robot.feet.values():
        assert len(foot.polygon) == corners
        length = np.linalg.norm(np.ptp(foot.polygon, axis=0))
        np.testing.assert_allclose(length, along[-1] - along[0], atol=1e-9)
    assert not [note for note in robot.notes if "other units" in note]


def test_nothing_of_a_foot_of_round_shapes_is_below_its_sole() -> None:
    shapes = (
        ('capsule radius="0.0437" length="0.0716"', "0.0101 0.0023 -0.0199"),
        ('sphere radius="0.034"', "0.0356 -0.0125 -0.0219"),
        ('cylinder radius="0.0597" length="0.0694"', "-0.0066 0 -0.0258", "0 1.5708 -0.0555"),
    )
    robot = Robot.load(biped("".join(urdf.collision(*one) for one in shapes)))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.posture())
    for foot in robot.feet.values():
        joint = int(robot.frame(foot.frame).parentJoint)
        assert abs(lowest_point(robot.model, data, robot.geometry, joint)) < 1e-9


@pytest.mark.parametrize("given", [None, {side: {"link": f"{side}_foot"} for side in LEFT_RIGHT}])
def test_a_robot_whose_root_is_a_foot_stands_on_both(given) -> None:
    """As drawn for the stance on one foot: the base's origin is beside the middle of the feet."""
    sole = box("0 0 0", ".2 .1 .04")
    parts, below = [link("left_foot", sole)], "left_foot"
    for name, axis, xyz in (
        ("left_ankle", "0 1 0", "0 0 .06"),
        ("left_thigh", "0 1 0", "0 0 .35"),
        ("pelvis", "1 0 0", "0 0 .35"),
        ("right_thigh", "1 0 0", "0 -.2 0"),
        ("right_ankle", "0 1 0", "0 0 -.35"),
        ("right_foot", "0 1 0", "0 0 -.35"),
        ("right_sole", "0 1 0", "0 0 -.06"),
    ):
        shapes = sole if name == "right_sole" else ""
        parts += [link(name, shapes), joint(f"{name}_j", below, name, axis, xyz)]
        below = name
    content = urdf.robot("biped", *parts).replace("right_foot", "right_toe")
    robot = Robot.load(content.replace("right_sole", "right_foot"), feet=given)
    assert [foot.link for foot in robot.feet.values()] == ["left_foot", "right_foot"]
    assert not any("turned" in note or "feet" in note for note in robot.notes)
    assert is_standing(robot.model, robot.posture("standing"), robot.feet)
    np.testing.assert_allclose(robot.posture("standing")[7:], 0.0, atol=1e-9)
