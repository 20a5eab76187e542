"""Every robot of example-robot-data: what it is taken for, and whether it stands as it should.

The kinds are written down here by looking at the files and their pictures.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.standing import sole_corners
from wbc.constraints import PointContact, support
from wbc.errors import ModelError
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.robot.library import find_robot

FOLDER = next(one for one in find_robot("g1").path.parents if one.name == "robots")


def files(names: str) -> list[str]:
    return names.split()


HUMANOIDS = files("""
alexander_description/urdf/alexander_v1.lowerBodyOnly bolt_description/robots/bolt
g1_description/urdf/g1_29dof_rev_1_0 g1_description/urdf/g1_29dof_with_hand_rev_1_0
human_description/robots/human icub_description/robots/icub icub_description/robots/icub_reduced
romeo_description/urdf/romeo_small talos_data/robots/talos_full_v2
talos_data/robots/talos_full_v2_box talos_data/robots/talos_reduced
talos_data/robots/talos_reduced_box talos_data/robots/talos_reduced_corrected
""")
QUADRUPEDS = files("""
a1_description/urdf/a1 anymal_b_simple_description/robots/anymal
anymal_b_simple_description/robots/anymal-kinova anymal_c_simple_description/urdf/anymal
b1_description/urdf/b1 b1_description/urdf/b1-z1 go1_description/urdf/go1 go2_description/urdf/go2
hyq_description/robots/hyq_no_sensors laikago_description/urdf/laikago
quadruped_description/urdf/quadruped solo_description/robots/solo solo_description/robots/solo12
""")
# Arms, hands, and two bodies on a column.
ARMS = files("""
allegro_hand_description/urdf/allegro_left_hand allegro_hand_description/urdf/allegro_right_hand
asr_twodof_description/urdf/TwoDofs baxter_description/urdf/baxter
double_pendulum_description/urdf/double_pendulum
double_pendulum_description/urdf/double_pendulum_continuous
double_pendulum_description/urdf/double_pendulum_simple finger_edu_description/robots/finger_edu
kinova_description/robots/kinova panda_description/urdf/panda
panda_description/urdf/panda_collision pr2_description/urdf/pr2 so_arm_description/urdf/so100
so_arm_description/urdf/so101 talos_data/robots/talos_left_arm
ur_description/urdf/ur10_joint_limited_robot ur_description/urdf/ur10_robot
ur_description/urdf/ur3_gripper ur_description/urdf/ur3_joint_limited_robot
ur_description/urdf/ur3_robot ur_description/urdf/ur5_gripper
ur_description/urdf/ur5_joint_limited_robot ur_description/urdf/ur5_robot
xarm_description/urdf/xarm7 z1_description/urdf/z1
""")
NO_FEET = {  # what floats, and why it has no feet
    "alex_description/urdf/alex_nub_hands": "are called hands or wheels",
    "alex_description/urdf/alex_sake_hands": "are called hands or wheels",
    "borinot_description/urdf/borinot_flying_arm_2": "are called hands or wheels",
    "centauro_description/urdf/centauro": "wheels are no soles",
    "hector_description/robots/quadrotor_base": "no limb ends below the base",
    "hextilt_description/urdf/hextilt_flying_arm_5": "are called hands or wheels",
    "iris_description/robots/iris": "no limb ends below the base",
    "iris_description/robots/iris_simple": "no limb ends below the base",
    "simple_humanoid_description/urdf/simple_humanoid": "no shapes to find soles from on l_ankle",
    "simple_humanoid_description/urdf/simple_humanoid_classical": "no shapes to find soles from",
    "tiago_description/robots/tiago": "wheels are no soles",
    "tiago_description/robots/tiago_dual": "wheels are no soles",
    "tiago_description/robots/tiago_no_hand": "wheels are no soles",
    "tiago_pro_description/robots/tiago_pro": "wheels are no soles",
}
REFUSED = {
    "alex_description/urdf/alex_psyonic_hands": "is coupled to 'index_q1'",
    "romeo_description/urdf/romeo": "has no mass",
    "romeo_description/urdf/romeo_laas_small": "has no mass",
    "ur_description/urdf/ur3": "no <link>",
}


def load(name: str, **given: object) -> Robot:
    return Robot.load(FOLDER / f"{name}.urdf", **given)


def assert_stands(robot: Robot) -> None:
    """Soles on the ground, all else above it, and the CoM over them."""
    s = robot.snapshot(robot.posture("standing"))
    corners = sole_corners(s)
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=1e-3)  # m
    assert polygon_margin(convex_hull(corners[:, :2]), s.com[:2]) > 0.0
    assert s.joint_placements[1][1:, 2].min() > 0.0
    assert s.com[2] > 0.08  # m
    assert (robot.limits.past(s.joint_positions) <= 1e-9).all()


def test_no_file_is_left_out() -> None:
    named = {*HUMANOIDS, *QUADRUPEDS, *ARMS, *NO_FEET, *REFUSED}
    assert named == {str(p.relative_to(FOLDER))[:-5] for p in FOLDER.rglob("*.urdf")}
    assert len(named) == sum(map(len, (HUMANOIDS, QUADRUPEDS, ARMS, NO_FEET, REFUSED)))


@pytest.mark.slow
@pytest.mark.parametrize("name", HUMANOIDS)
def test_humanoids_stand_on_two_feet(name: str) -> None:
    robot = load(name)
    assert list(robot.feet) == ["left", "right"]
    assert not robot.fixed_base
    assert_stands(robot)
    s = robot.snapshot(robot.posture())
    left, right = (s.position(foot.frame) for foot in robot.feet.values())
    np.testing.assert_allclose(s.rotation(robot.feet["left"].frame), np.eye(3), atol=0.02)
    assert left[1] - right[1] > 0.05  # m: it faces x
    if "bolt" not in name:  # which ends in balls
        longest = max(np.ptp(foot.polygon, axis=0)[0] for foot in robot.feet.values())
        assert 0.1 < longest < 0.35  # m


@pytest.mark.slow
@pytest.mark.parametrize("name", QUADRUPEDS)
def test_quadrupeds_stand_on_points(name: str) -> None:
    robot = load(name)
    assert list(robot.feet) == ["front_left", "front_right", "hind_left", "hind_right"]
    assert {len(foot.polygon) for foot in robot.feet.values()} == {1}
    assert_stands(robot)
    soles = [foot.frame for foot in robot.feet.values()]
    held = support(robot.snapshot(robot.posture()), soles)
    assert all(isinstance(contact, PointContact) for contact in held)


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_bolted_down(name: str) -> None:
    robot = load(name)
    assert robot.fixed_base
    assert robot.feet == {}
    assert any("the base is fixed, since" in note for note in robot.notes)


@pytest.mark.parametrize("name", NO_FEET)
def test_what_has_no_feet_says_why(name: str, caplog: pytest.LogCaptureFixture) -> None:
    robot = load(name)
    assert robot.feet == {}
    assert not robot.fixed_base
    (note,) = (note for note in robot.notes if note.startswith("no feet were found: "))
    assert NO_FEET[name] in note
    assert note in caplog.text


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_loaded_says_why(name: str) -> None:
    with pytest.raises(ModelError, match=REFUSED[name]):
        load(name)


def test_feet_without_shapes_stand_by_their_polygons() -> None:
    """The humanoid of which the file draws no feet: 0.1 m below the ankle, CoM 0.03 m in front."""
    sole = {"polygon": [[-0.1, -0.05], [0.15, -0.05], [0.15, 0.05], [-0.1, 0.05]], "height": 0.1}
    feet = {side: {"link": f"{side[0]}_ankle", **sole} for side in ("left", "right")}
    file = FOLDER / "simple_humanoid_description/srdf/simple_humanoid.srdf"
    robot = load("simple_humanoid_description/urdf/simple_humanoid", feet=feet, srdf=file)
    assert_stands(robot)


def test_a_human_described_with_y_up_stands_upright() -> None:
    robot = load("human_description/robots/human")
    assert any("the base's y axis points up" in note for note in robot.notes)
    s = robot.snapshot(robot.posture())
    assert s.position("middle_head")[2] > 1.3  # m
    left, right = (s.position(f"{side}_hand") for side in ("left", "right"))
    assert left[1] - right[1] > 0.3  # it faces forwards


def test_other_formats_are_refused_by_name() -> None:
    file: Path = FOLDER / "cassie_description/robots/cassie.sdf"
    with pytest.raises(ModelError, match="sdf files are not read; export a URDF"):
        Robot.load(file)
