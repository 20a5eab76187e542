"""A retargeted walk as footsteps for a walker, from known footprints."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import moving
from wbc.errors import InvalidInputError
from wbc.retargeting.footsteps import contact_corners, yaw_pitch_rotations
from wbc.retargeting.steps import footsteps, posture_at, stride
from wbc.robot import Robot

DT, STRIDE = 0.02, 0.3  # s; m from a foot to the other one ahead
BEGINS, EVERY, AIR = 40, 25, 16  # frames: of the first landing, between two, of a foot in the air


def walking(count: int) -> Any:
    """Return a walk that turns to the left by 0.1 rad a step, each landing EVERY frames later."""
    prints, x, y, yaw = [], 0.0, 0.0, 0.0
    for k in range(count):
        foot, side = ("left", 0.1) if k % 2 else ("right", -0.1)
        first = 0 if k < 2 else BEGINS + EVERY * (k - 2)
        end = BEGINS + EVERY * k - AIR if k < 2 else first + 2 * EVERY - AIR
        place = x - np.sin(yaw) * side, y + np.cos(yaw) * side
        pose = np.array((*place, yaw))
        prints.append(SimpleNamespace(foot=foot, pose=pose, first=first, end=end))
        x, y, yaw = x + STRIDE * np.cos(yaw), y + STRIDE * np.sin(yaw), yaw + 0.1
    frames = BEGINS + EVERY * count
    q = np.arange(frames, dtype=float)[:, None] * np.ones(9)
    targets = SimpleNamespace(dt=DT, feet=SimpleNamespace(prints=prints[::-1]))
    return type("Walk", (SimpleNamespace,), {"__len__": lambda self: frames})(
        source="walk.trc", targets=targets, q=q
    )


def test_footsteps_of_alternating_feet_are_relative_and_repeat_the_last_stride() -> None:
    steps = footsteps(walking(6), 9)
    assert [step.foot for step in steps] == ["left", "right"] * 4 + ["left"]
    for k in range(2, 6):  # neither the first two nor the last three
        side = 0.2 if steps[k].foot == "left" else -0.2
        assert steps[k].yaw == pytest.approx(0.1)
        assert steps[k].duration == pytest.approx((AIR + 1) * DT)
        assert abs(steps[k].y - side) < 0.03 and abs(steps[k].x - STRIDE) < 0.03
    assert 0.0 < steps[0].x < steps[1].x < steps[2].x
    assert steps[-1].x == 0.0 and steps[-1].yaw == 0.0  # beside the other foot


def test_stride_lasts_from_touchdown_to_touchdown_and_postures_repeat() -> None:
    walk = walking(6)
    begin, period = stride(walk)
    assert period == pytest.approx(2 * EVERY * DT)
    first = posture_at(walk, -1.0)
    assert first[0] == pytest.approx(round(begin / DT))
    np.testing.assert_array_equal(posture_at(walk, 0.25 * period), posture_at(walk, 3.25 * period))


def test_motion_without_alternating_feet_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"walk.trc has 2 footprints in turn"):
        footsteps(walking(2), 4)
    with pytest.raises(InvalidInputError, match="no foot touches down twice"):
        stride(walking(3))
    with pytest.raises(InvalidInputError, match="count"):
        footsteps(walking(6), 1)


@pytest.mark.parametrize("name", ["g1", "talos", "romeo", "icub", "hoap2_like"])
def test_contact_corners_are_the_lowest_of_a_pitched_sole(name: str) -> None:
    polygon = Robot.load(name).feet["left"].polygon
    sole = np.column_stack((polygon, np.zeros(len(polygon))))
    for pitch in (-0.5, -0.1, 0.0, 0.1, 0.3):
        R = yaw_pitch_rotations(np.zeros(1), np.array([pitch]))[0]
        (own,) = contact_corners(polygon, np.array([pitch]))
        lifted = own @ R[2] - (sole @ R[2]).min()
        # Romeo's front is round: a corner 3.7 mm behind it is 1.8 mm above the ground.
        assert lifted.max() < 1e-3
        assert len(np.unique(own.round(9), axis=0)) >= (2 if pitch else len(polygon))


def test_a_squat_is_no_twist_where_thighs_are_wider_than_soles() -> None:
    """Thighs kept their margin by a turned pelvis, one knee bent by half a radian more."""
    still, rows = np.zeros((75, 3)), np.linspace(0.0, 1.0, 75)
    dip = 0.05 * (1.0 - np.cos(2.0 * np.pi * rows))
    human = moving(1.5, 0.0 * rows, dip, {"left": still, "right": still}, 0.0 * rows)
    robot = Robot.load("romeo")
    q = wbc.retarget(human, robot).q
    left, right = (q[:, 7 + robot.joint_names.index(f"{side}KneePitch")] for side in "LR")
    np.testing.assert_allclose(left, right, atol=0.15)
