"""Feet that stand on a belt: found, and seen from it; knees that only a static trial has."""

from dataclasses import replace

import numpy as np
import pytest

from tests.human.walker import LABELS, recorded
from wbc.human import MarkerRecording, human_motion
from wbc.human.body import HumanBody
from wbc.human.contacts import belt_velocity, in_belt_frame
from wbc.human.landmarks import landmark, landmark_of, missing_landmarks
from wbc.human.marker_identification import static_trial_notes
from wbc.human.markers import ForcePlate
from wbc.human.skeleton import configurations, human_robot

BODY = HumanBody.of(1.76, 72.0, "male")
NAMES = ("LASI", "RASI", "SACR", "LHEE", "LTOE", "RHEE", "RTOE")
MARKERS = {name: landmark(str(landmark_of(name))) for name in NAMES}
SPEED, STRIDE, STANCE = 1.2, 1.1, 0.62  # m/s, s, part of a stride


def walked(speed: float, over: float = 0.0) -> MarkerRecording:
    """Feet that stand move at -speed along x and are brought back; all moves on at ``over``."""
    time = np.arange(0.0, 5.0, 0.01)
    at = np.zeros((len(time), len(NAMES), 3))
    at[:, :3] = [(0.1, 0.12, 1.0), (0.1, -0.12, 1.0), (-0.1, 0.0, 1.0)]
    at[:, :3, 2] += 0.02 * np.cos(4.0 * np.pi * time / STRIDE)[:, None]
    for side, first in ((0.0, 3), (0.5, 5)):
        phase = (time / STRIDE + side) % 1.0
        swing = np.clip((phase - STANCE) / (1.0 - STANCE), 0.0, 1.0)
        way = speed * STRIDE * STANCE
        x = np.where(
            phase < STANCE, -speed * STRIDE * phase, -way + way * swing**2 * (3 - 2 * swing)
        )
        z = 0.15 * np.sin(np.pi * swing)
        for k, ahead in ((first, 0.0), (first + 1, 0.2)):
            at[:, k] = np.column_stack((x + ahead, np.full_like(x, 0.1 - 0.2 * (first == 5)), z))
    at[..., 0] += over * time[:, None]
    at += 1e-3 * np.random.default_rng(0).standard_normal(at.shape)
    return MarkerRecording(time, NAMES, at, up="z")


def test_belt_is_detected_and_ground_at_rest_is_not() -> None:
    np.testing.assert_allclose(belt_velocity(walked(SPEED), MARKERS), (-SPEED, 0.0, 0.0), atol=0.05)
    assert not belt_velocity(walked(SPEED, over=SPEED), MARKERS).any()  # over ground
    assert not belt_velocity(walked(0.0), MARKERS).any()  # on the spot
    assert not belt_velocity(walked(0.0, over=1.0), MARKERS).any()  # carried along


def test_plates_in_the_belt_frame_have_the_same_force_at_moved_points() -> None:
    """Oracle: the CoP moves with the axes, force and free moment stay."""
    recording = walked(SPEED)
    time, rng = np.arange(0.0, 5.0, 1e-3), np.random.default_rng(1)
    push = rng.normal(size=(len(time), 2)) * 20.0, rng.uniform(300, 800, len(time))
    force = np.column_stack(push)
    cop = np.column_stack((rng.normal(size=(len(time), 2)), np.zeros(len(time))))
    plate = ForcePlate("belt", time, force, np.cross(cop, force))
    belt = np.array((-SPEED, 0.0, 0.0))
    moved = in_belt_frame(recording.with_plates((plate,)), belt)
    (seen,) = moved.plates
    np.testing.assert_array_equal(seen.force, force)
    expected = np.cross(cop - time[:, None] * belt, force)
    np.testing.assert_allclose(seen.moment, expected, atol=1e-9)
    again = belt_velocity(moved, MARKERS)
    assert not again.any()
    in_belt_frame(replace(recording, time=300.0 * recording.time), belt)  # 1.8 km of it


def test_missing_landmarks_may_come_from_static_trials_and_clusters() -> None:
    walk = ["left_asis", "right_asis", "sacrum", "c7", "jugular", "xiphoid"]
    for side in ("left", "right"):
        walk += [f"{side}_thigh", f"{side}_shank", f"{side}_heel"]
    assert len(missing_landmarks(walk)) == 4
    sides = ("left", "right")
    beside = [f"{side}_{joint}_lateral" for side in sides for joint in ("knee", "ankle")]
    assert missing_landmarks(walk, beside) == []
    assert missing_landmarks([name for name in walk if "thigh" not in name], beside) != []
    clusters = [f"{side}_{part}" for side in sides for part in ("thigh", "shank", "foot")]
    assert missing_landmarks(walk + 2 * clusters) == []


@pytest.mark.parametrize(("scale", "prefix"), [(1.0, ""), (1.1, ""), (1.0, "X")])
def test_static_trial_of_another_human_is_noted(scale: float, prefix: str) -> None:
    whole, _ = recorded(BODY, noise=1e-3, seed=2)
    labels = tuple(prefix + name for name in whole.labels)
    static = MarkerRecording(whole.time[:40], labels, scale * whole.positions[:40], up="z")
    markers = {name: landmark(str(landmark_of(name))) for name in whole.labels}
    told = static_trial_notes(whole, static, markers)
    if scale > 1.0:
        assert told[0].startswith("markers of the static trial are 1.10 times as far apart")
    else:
        assert len(told) == bool(prefix)
        assert all(one.startswith("the static trial shares no two") for one in told)


@pytest.mark.slow
def test_knees_and_ankles_of_the_static_trial_are_used() -> None:
    """Without them in the motion the CoM is found as with them, to what one shank marker tells."""
    whole, truth = recorded(BODY, noise=1e-3, seed=2)
    gone = ("LKNE", "RKNE", "LANK", "RANK")
    kept = [k for k, name in enumerate(LABELS) if name not in gone]
    walk = MarkerRecording(
        whole.time, tuple(LABELS[k] for k in kept), whole.positions[:, kept], up="z"
    )
    static = MarkerRecording(whole.time[:40], whole.labels, whole.positions[:40], up="z")
    robot = human_robot(BODY)
    true = np.array([robot.snapshot(q).com for q in configurations(robot, truth)])
    off = []
    for recording, stood in ((whole, None), (walk, static)):
        human = human_motion(recording, static=stood, mass=BODY.mass)
        q = np.hstack((human.motion.base, human.motion.joints))
        com = np.array([human.motion.robot.snapshot(one).com for one in q])
        moving = com - true
        off.append(np.sqrt(((moving - moving.mean(axis=0)) ** 2).sum(axis=1).mean()))
    assert off[0] < 5e-3 and off[1] < 8e-3
