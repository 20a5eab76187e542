"""The base from a planted foot, against forward kinematics by snapshots."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.motion import Motion, analyze
from wbc.motion.planted_base import EASE, planted_base
from wbc.robot import Robot

RATE = 200.0
TIME = np.arange(600) / RATE


def moved(robot: Robot, parts: dict[str, np.ndarray]) -> np.ndarray:
    """Joint positions (n, nv-6): standing, with some joints moved by (n,)."""
    joints = np.tile(robot.limits.joint_positions(robot.postures["standing"]), (len(TIME), 1))
    for pattern, values in parts.items():
        for k in robot.joint_indices(pattern):
            joints[:, k - 6] += values
    return joints


def lift(robot: Robot, start: float, end: float) -> np.ndarray:
    """Return 0 but between two times, where it rises smoothly to 1 and falls again (n,)."""
    phase = np.clip((TIME - start) / (end - start), 0.0, 1.0)
    return np.sin(np.pi * phase) ** 4


@pytest.mark.parametrize("foot", ["left", "right"])
@pytest.mark.parametrize("height", [0.0, 0.3])
def test_planted_sole_is_flat_and_at_rest(hoap2: Robot, foot: str, height: float) -> None:
    swing = 0.2 * np.sin(4.0 * TIME + 0.3)
    parts = {"*_hip_pitch": swing, "*_ankle_roll": 0.5 * swing, "left_hip_yaw": swing**2}
    motion = Motion(hoap2, TIME, moved(hoap2, parts))
    series = analyze(motion, planted=foot, ground_height=height, feet=[foot])
    places = []
    for k in (0, 100, 333, 599):
        here = hoap2.snapshot(series.q[k])
        frame = hoap2.feet[foot].frame
        places.append(here.position(frame))
        # The base is found on the very grid that the spline goes through: but for rounding.
        np.testing.assert_allclose(here.rotation(frame)[2], [0.0, 0.0, 1.0], atol=1e-9)
        np.testing.assert_allclose(here.rotation(frame)[:, 0] @ series_axis(hoap2, series, foot), 1)
    np.testing.assert_allclose(places, np.tile(places[0], (4, 1)), atol=1e-9)
    assert places[0][2] == pytest.approx(height, abs=1e-9)
    np.testing.assert_allclose(series.q[0, :2], 0.0, atol=1e-9)
    assert hoap2.snapshot(series.q[0]).rotation("base")[1, 0] == pytest.approx(0.0, abs=1e-9)
    # And so does its velocity: the foot's Jacobian times v is nothing.
    k = 300
    speed = hoap2.snapshot(series.q[k]).jacobian(hoap2.feet[foot].frame) @ series.v[k]
    np.testing.assert_allclose(speed, 0.0, atol=1e-7)  # the spline's (w h)^5 between its points


def series_axis(robot: Robot, series, foot: str) -> np.ndarray:
    return robot.snapshot(series.q[0]).rotation(robot.feet[foot].frame)[:, 0]


def test_auto_follows_the_lower_foot_without_a_jump(hoap2: Robot) -> None:
    up_left, up_right = lift(hoap2, 0.2, 1.2), lift(hoap2, 1.6, 2.6)
    parts = {}
    for side, up in (("left", up_left), ("right", up_right)):
        parts |= {f"{side}_hip_pitch": -0.5 * up, f"{side}_knee_pitch": up}
        parts |= {f"{side}_ankle_pitch": -0.5 * up}
    joints = moved(hoap2, parts)
    q = np.hstack((np.zeros((600, 6)), np.ones((600, 1)), joints))
    base, foot = planted_base(hoap2, TIME, q, "auto")
    feet = tuple(hoap2.feet)
    assert feet[foot[np.argmax(up_left)]] == "right"
    assert feet[foot[np.argmax(up_right)]] == "left"
    # Both feet are flat when they change places, so every frame agrees with the hip of the legs
    # that stand, which do not move: the base stays where it was.
    np.testing.assert_allclose(base, np.tile(base[0], (600, 1)), atol=2e-6)
    series = analyze(Motion(hoap2, TIME, joints), planted="auto")
    k = int(np.argmax(up_left))
    assert series.standing[k].tolist() == [False, True]
    assert series.standing[0].tolist() == [True, True]
    assert not series.flight.any()


def test_contradicting_feet_are_blended(hoap2: Robot) -> None:
    # The left ankle is off by 0.08 rad; its leg gets longer than the right, so that it takes over.
    longer = np.clip((TIME - 1.0) / 0.2, 0.0, 1.0)
    parts = {"left_ankle_roll": 0.08}
    for side, bent in (("left", 1.0 - longer), ("right", longer)):
        parts |= {f"{side}_{n}_pitch": k * bent for n, k in (("hip", -0.3), ("knee", 0.6))}
        parts[f"{side}_ankle_pitch"] = -0.3 * bent
    joints = moved(hoap2, parts)
    q = np.hstack((np.zeros((600, 6)), np.ones((600, 1)), joints))
    base, foot = planted_base(hoap2, TIME, q, "auto")
    changes = np.flatnonzero(np.diff(foot))
    steps = np.abs(np.diff(base, axis=0)).max(axis=1)
    # No step is larger than what the easing and the legs move in 5 ms: 0.08 rad * 1.9 / 0.1 s.
    assert steps.max() < 0.08 * 1.9 / EASE / RATE + 0.005
    settled = min(int(changes[-1]) + 1 + int(EASE * RATE) + 2, 599)
    here = hoap2.snapshot(np.hstack((base[settled], joints[settled])))
    frame = hoap2.feet[tuple(hoap2.feet)[foot[settled]]].frame
    np.testing.assert_allclose(here.rotation(frame)[2], [0.0, 0.0, 1.0], atol=1e-9)
    assert here.position(frame)[2] == pytest.approx(0.0, abs=1e-9)


def test_unknown_feet_are_refused(hoap2: Robot) -> None:
    motion = Motion(hoap2, TIME, moved(hoap2, {}))
    with pytest.raises(UnknownNameError, match="did you mean 'left'"):
        analyze(motion, planted="lefd")
    footless = Robot.load("hoap2_like", feet={})
    with pytest.raises(UnknownNameError, match="no feet"):
        analyze(Motion(footless, TIME, motion.joints), planted="auto", feet=None)


def test_base_and_planted_foot_exclude_each_other(hoap2: Robot) -> None:
    joints = moved(hoap2, {})
    with pytest.raises(InvalidInputError, match="planted foot: left, right or auto"):
        analyze(Motion(hoap2, TIME, joints))
    base = np.tile(hoap2.postures["standing"][:7], (600, 1))
    with pytest.raises(InvalidInputError, match="leave planted out"):
        analyze(Motion(hoap2, TIME, joints, base), planted="left")
