"""The sweep over example-robot-data: its judge of raw shapes finds what is broken."""

import coal
import library_robots
import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import SelfCollision
from wbc.robot import Robot


@pytest.fixture(scope="module")
def bolt() -> Robot:
    return Robot.load(library_robots.folder() / "bolt_description/robots/bolt.urdf")


@pytest.mark.slow
def test_a_margin_that_raw_shapes_break_is_found(bolt: Robot) -> None:
    margins = SelfCollision(bolt, margin=0.01)
    raw = library_robots.RawShapes(bolt, margins)
    q = bolt.posture("standing")
    assert raw.broken(q) == (0.0, "")
    crossed = bolt.posture("standing", {"FL_HAA": -0.4, "FR_HAA": 0.4})
    by, pair = raw.broken(crossed)
    assert by > 0.0099  # m: they meet
    first, second = pair.split(" vs ")
    data = bolt.model.createData()
    pin.forwardKinematics(bolt.model, data, crossed)
    shapes = {shape.name: shape for shape in bolt.collision_model.geometryObjects}
    placed = []
    for name in (first, second):
        pose = data.oMi[shapes[name].parentJoint] * shapes[name].placement
        placed += [shapes[name].geometry, coal.Transform3s(pose.rotation, pose.translation)]
    meeting = coal.collide(*placed, coal.CollisionRequest(), coal.CollisionResult())
    assert meeting > 0


def test_random_ticks_keep_the_margins_of_bolt(bolt: Robot) -> None:
    seen = library_robots.random_ticks(bolt, ticks=1, seed=3)
    assert seen.startswith("400 ticks, 26 raw pairs")
    assert "margin broken by 0.0000 mm" in seen
    assert "{'solved': 400}" in seen


def test_what_stands_on_two_feet_is_a_humanoid(bolt: Robot) -> None:
    assert library_robots.is_humanoid(bolt)
    assert library_robots.verdict(bolt) == "stands on FL_FOOT (4), FR_FOOT (4)"
    arm = library_robots.loaded(library_robots.folder() / "z1_description/urdf/z1.urdf")
    assert isinstance(arm, Robot)
    assert not library_robots.is_humanoid(arm)
    assert library_robots.verdict(arm) == "fixed base"
    assert "no <link>" in str(
        library_robots.loaded(library_robots.folder() / "ur_description/urdf/ur3.urdf")
    )


@pytest.mark.slow
def test_mimic_joints_of_random_postures_follow_their_drivers() -> None:
    """Else every tick is infeasible, and margins are kept by a robot that stands still."""
    path = next(library_robots.folder().rglob("talos_full_v2.urdf"))
    robot = library_robots.loaded(path)
    margins = SelfCollision(robot, margin=library_robots.MARGIN)
    random, opened = np.random.default_rng(1), 0.0
    assert len(robot.couplings) == 12
    for _ in range(4):
        q = library_robots.clear_posture(robot, margins, random)
        joints = dict(zip(robot.limits.names, robot.limits.joint_positions(q), strict=True))
        for joint, gear in robot.couplings.items():
            assert joints[joint] == pytest.approx(gear.ratio * joints[gear.driver] + gear.offset)
            opened = max(opened, abs(joints[joint]))
    assert opened > 0.01
