"""The loaded robot: names, postures, configurations, and what a measurement must look like."""

import copy
import dataclasses
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from tests.standing import sole_corners
from tests.urdf import joint, link, robot
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot

Load = Callable[[str], Robot]


# ---------------------------------------------------------------------------- names


def test_joint_indices_are_rows_of_v(robot: Robot) -> None:
    for k, name in enumerate(robot.joint_names):
        index = robot.joint_index(name)
        assert index == 6 + k
        joint = robot.model.getJointId(name)
        assert robot.model.idx_vs[joint] == index
    assert len(robot.joint_names) == robot.nv - 6


def test_patterns_select_joints(hoap2: Robot) -> None:
    left = hoap2.joint_indices("left_*")
    assert len(left) == 11
    assert [hoap2.joint_names[k - 6].startswith("left_") for k in left] == [True] * 11
    assert hoap2.joint_indices("*") == tuple(range(6, 31))
    assert hoap2.joint_indices("head_yaw") == (hoap2.joint_index("head_yaw"),)


def test_unknown_names_suggest_the_nearest(hoap2: Robot) -> None:
    for ask, name, said in (
        (hoap2.joint_index, "left_knee_pich", "did you mean 'left_knee_pitch'"),
        (hoap2.joint_indices, "lef_*", "unknown joint 'lef_"),
        (hoap2.frame_id, "left_soul", "did you mean 'left_sole'"),
        (hoap2.posture, "standin", "did you mean 'standing'"),
    ):
        with pytest.raises(UnknownNameError, match=said):
            ask(name)


def test_every_frame_name_is_a_frame(robot: Robot) -> None:
    for name in robot.frame_names:
        assert robot.frame(name).name == name
    assert {"base", *(foot.frame for foot in robot.feet.values())} <= set(robot.frame_names)


def test_a_name_shared_by_a_link_and_a_joint_means_the_link() -> None:
    same_name = urdf.joint("b", "a", "b", kind="continuous")
    robot = Robot.load(urdf.robot("same", *map(urdf.link, "ab"), same_name))
    assert robot.model.frames[robot.frame_id("b")].type == pin.FrameType.BODY


def test_base_always_means_the_floating_base() -> None:
    moved = urdf.joint("j", "root", "base", kind="continuous", at="1 2 3")
    robot = Robot.load(urdf.robot("based", *map(urdf.link, ("root", "base")), moved))
    s = robot.snapshot(robot.postures["neutral"])
    np.testing.assert_array_equal(s.position("base"), np.zeros(3))
    assert any("floating base" in note for note in robot.notes)


# ---------------------------------------------------------------------------- postures


def test_neutral_is_all_zero(robot: Robot) -> None:
    q = robot.postures["neutral"]
    np.testing.assert_array_equal(q[:7], [0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(robot.limits.joint_positions(q), 0.0)
    np.testing.assert_array_equal(robot.snapshot(q).v, np.zeros(robot.nv))  # at rest


def test_a_posture_changes_the_joints_it_is_told_to(hoap2: Robot) -> None:
    q = hoap2.posture("neutral", {"*_knee_pitch": 0.8, "right_knee_pitch": 0.5, "head_yaw": -0.2})
    joints = dict(zip(hoap2.joint_names, hoap2.limits.joint_positions(q).tolist(), strict=True))
    changed = {name: value for name, value in joints.items() if value != 0.0}
    assert changed == {"left_knee_pitch": 0.8, "right_knee_pitch": 0.5, "head_yaw": -0.2}


def test_a_posture_is_put_on_the_ground(hoap2: Robot) -> None:
    q = hoap2.posture("standing", {"right_knee_pitch": 1.2, "right_hip_pitch": -0.6})
    left, right = sole_corners(hoap2.snapshot(q))[:, 2].reshape(2, -1).min(axis=1)
    assert left == pytest.approx(0.0, abs=1e-12)
    assert right > 0.01  # the bent leg is lifted
    lifted = hoap2.posture("neutral", on_ground=False)
    np.testing.assert_array_equal(lifted, hoap2.postures["neutral"])


def test_postures_are_checked(hoap2: Robot) -> None:
    for name, value, said in (
        ("left_knee_pitch", -1.0, r"'left_knee_pitch': -1 is outside .*\[-0.017"),
        ("head_yaw", np.nan, "'head_yaw': must be finite"),
        ("head_jaw", 0.1, "did you mean 'head_yaw'"),
    ):
        with pytest.raises((InvalidInputError, UnknownNameError), match=said):
            hoap2.posture(joints={name: value})


def test_postures_are_read_only_and_returned_as_copies(hoap2: Robot) -> None:
    with pytest.raises(ValueError, match="read-only"):
        hoap2.postures["standing"][0] = 1.0
    q = hoap2.posture()
    q[0] = 1.0
    assert hoap2.postures["standing"][0] == 0.0


def srdf(folder: Path, value: str, joint: str = "head_yaw") -> Path:
    path = folder / "states.srdf"
    path.write_text(
        '<robot name="x"><group_state name="look" group="all">'
        f'<joint name="{joint}" value="{value}"/></group_state></robot>'
    )
    return path


def test_an_srdf_gives_postures(tmp_path: Path) -> None:
    robot = Robot.load("hoap2_like", srdf=srdf(tmp_path, "0.5"))
    q = robot.postures["look"]
    assert robot.limits.joint_positions(q)[robot.joint_index("head_yaw") - 6] == 0.5
    assert np.count_nonzero(q[7:]) == 1
    base = Robot.load("hoap2_like", srdf=srdf(tmp_path, "1 2 3 0 0 2 0", "root_joint"))
    np.testing.assert_array_equal(base.postures["look"][:7], [1, 2, 3, 0, 0, 1, 0])


def test_an_srdf_outside_the_limits_is_noted(tmp_path: Path) -> None:
    robot = Robot.load("hoap2_like", srdf=srdf(tmp_path, "3"))
    assert robot.notes == ("posture 'look': brought within the limits: head_yaw",)
    k = robot.joint_index("head_yaw") - 6
    assert robot.limits.joint_positions(robot.postures["look"])[k] == robot.limits.upper[k]


# ---------------------------------------------------------------------------- configurations


def test_difference_undoes_integration(robot: Robot, rng: np.random.Generator) -> None:
    for _ in range(10):
        q = robot.integrate(robot.postures["neutral"], rng.normal(size=robot.nv), 1.0)
        v = rng.normal(size=robot.nv)
        found = robot.difference(q, robot.integrate(q, v, 0.5))
        np.testing.assert_allclose(found, 0.5 * v, atol=1e-9)  # logarithms lose digits near pi


def test_the_angle_of_a_continuous_joint_must_be_one(robot_named: Load) -> None:
    robot = robot_named("mixed_joints")
    k = robot.limits.unbounded[0]
    turn = slice(robot.limits.starts[k], robot.limits.starts[k] + 2)
    q = robot.postures["neutral"].copy()
    q[turn] = 0.6 * 1.0005, 0.8 * 1.0005
    np.testing.assert_allclose(robot.check_configuration(q)[turn], [0.6, 0.8], atol=1e-15)
    q[turn.start] = 0.7
    with pytest.raises(InvalidInputError, match=f"joint '{robot.joint_names[k]}' has norm"):
        robot.check_configuration(q)


# ---------------------------------------------------------------------------- the object


def test_a_robot_does_not_change(hoap2: Robot) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        hoap2.name = "other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        hoap2.feet["left"] = hoap2.feet["right"]  # type: ignore[index]
    with pytest.raises(TypeError):
        hoap2.postures["standing"] = hoap2.posture()  # type: ignore[index]


def pickled(robot: Robot) -> Robot:
    return pickle.loads(pickle.dumps(robot))


@pytest.mark.slow
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, pickled])
@pytest.mark.parametrize("name", ["hoap2_like", "g1_27", "mixed_joints"])
def test_a_copy_is_the_same_robot_with_its_own_memory(name, robot_named, rng, again) -> None:
    robot = robot_named(name)
    other = again(robot)
    assert other.native is not robot.native
    for name in ("name", "frame_names", "notes"):
        assert getattr(other, name) == getattr(robot, name)
    assert not other.postures["standing"].flags.writeable
    q = robot.integrate(robot.posture(), rng.normal(size=robot.nv), 0.1)
    s, t = robot.snapshot(q), other.snapshot(q)
    np.testing.assert_array_equal(t.inertia, s.inertia)
    assert len(other.collision_model.geometryObjects) == len(robot.collision_model.geometryObjects)


def test_a_robot_can_be_renamed(hoap2: Robot) -> None:
    assert Robot.load("hoap2_like", name="ada").name == "ada"
    assert repr(hoap2) == "Robot('hoap2_like', nv=31, mass=7.10 kg)"


def test_shapes_sit_on_a_robot_with_locked_joints(hoap2: Robot) -> None:
    """Oracle: Pinocchio's own reduction of the shapes together with the model."""
    angles = {"waist_pitch": -0.4, "left_elbow_pitch": -1.0, "head_yaw": 0.3}
    bent = Robot.load("hoap2_like", locked=angles)
    q = hoap2.posture("neutral", angles)
    ids = [hoap2.model.getJointId(name) for name in angles]
    for shapes, ours in (
        (hoap2.collision_model, bent.collision_model),
        (hoap2.visual_model, bent.visual_model),
    ):
        _, (reduced,) = pin.buildReducedModel(hoap2.model, [shapes], ids, q)
        assert len(ours.geometryObjects) == len(reduced.geometryObjects) > 40
        for a, b in zip(ours.geometryObjects, reduced.geometryObjects, strict=True):
            assert (a.name, a.parentJoint) == (b.name, b.parentJoint)
            np.testing.assert_allclose(a.placement.homogeneous, b.placement.homogeneous, atol=1e-12)


def test_locking_by_pattern_keeps_the_rest_of_the_posture(hoap2: Robot) -> None:
    legs = Robot.load("hoap2_like", locked={"*shoulder*": 0.0, "*elbow*": -0.3, "head_*": 0.0})
    assert legs.nv == hoap2.nv - 10
    assert legs.mass == pytest.approx(hoap2.mass, rel=1e-12)
    bent = [one.posture()[one.joint_index("left_knee_pitch") + 1] for one in (legs, hoap2)]
    assert bent[0] == pytest.approx(bent[1])
    with pytest.raises(UnknownNameError, match="unknown joint to lock 'head_roll'"):
        Robot.load("hoap2_like", locked={"head_roll": 0.0})


@pytest.mark.parametrize("given", [("g1",), (), ("g1", "urdf")])
def test_a_robot_is_loaded(given: tuple[str, ...]) -> None:
    """Other libraries make robots by their class."""
    with pytest.raises(InvalidInputError, match=r"write Robot\.load\((source|'g1')\)"):
        Robot(*given)


def test_xml_text_of_a_file_with_a_byte_order_mark_is_read(hoap2: Robot) -> None:
    text = "\ufeff" + hoap2.path.read_text()
    assert Robot.load(text).joint_names == hoap2.joint_names


SOURCES = [None, 3, ["g1"], b"<robot/>" * 1000, "robot: g1\n" * 1000]


@pytest.mark.parametrize("source", SOURCES, ids=["None", "number", "list", "bytes", "long text"])
def test_what_is_no_file_and_no_name_is_told_in_short(source: object) -> None:
    with pytest.raises(InvalidInputError, match="expected a file or a name") as error:
        Robot.load(source)  # type: ignore[arg-type]
    assert len(str(error.value)) < 300


def two_joints(first: str, second: str) -> str:
    links = map(link, ("trunk", "upper", "lower"))
    return robot("arm", *links, joint(first, "trunk", "upper"), joint(second, "upper", "lower"))


@pytest.mark.parametrize(("first", "second"), [("j[0]", "j0"), ("j*", "j2"), ("j?", "j1")])
def test_name_that_would_be_a_pattern_means_its_own_joint_alone(first: str, second: str) -> None:
    arm = Robot.load(two_joints(first, second))
    np.testing.assert_array_equal(arm.posture("neutral", {first: 0.3})[7:], [0.3, 0.0])
    np.testing.assert_array_equal(arm.posture("neutral", {second: 0.3})[7:], [0.0, 0.3])
    loaded = Robot.load(two_joints(first, second), locked={first: 0.2}, effort={second: 5.0})
    assert loaded.joint_names == (second,)
    np.testing.assert_array_equal(loaded.limits.effort, [5.0])


def test_what_the_file_calls_as_the_centre_of_mass_is_told() -> None:
    """Moments about="com" were about the robot's CoM, and nobody said."""
    arm = Robot.load(two_joints("j0", "j1").replace('"lower"', '"com"'), base="floating")
    assert any("'com' means the centre of mass" in note for note in arm.notes)
    assert not any("'com'" in note for note in Robot.load(two_joints("j0", "j1")).notes)
