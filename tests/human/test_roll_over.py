"""Feet on belts and static trials; roll-over correction: the CoP rolls over, the load shifts."""

from dataclasses import replace

import numpy as np
import pytest

import wbc
from tests.human.walker import LABELS, recorded
from wbc.human import HumanBody, MarkerRecording, human_motion, human_robot
from wbc.human.body import HINGE_NAMES, HINGES
from wbc.human.kinematics import Poses
from wbc.human.landmarks import landmark, landmark_of, missing_landmarks
from wbc.human.marker_identification import static_trial_notes
from wbc.human.markers import ForcePlate
from wbc.human.roll_over import (
    COP_PER_LEAN,
    MAX_COP,
    MAX_OUTWARD,
    OUTWARD_PART,
    UPRIGHT_COP,
    _invert_low_pass,
    _least_squares,
    _load_shares,
    _roll_over_cop,
    roll_over_correction,
)
from wbc.human.skeleton import configurations
from wbc.human.treadmill import belt_velocity, in_belt_frame
from wbc.motion import Motion
from wbc.motion.filtering import low_pass

BODY = HumanBody.of(1.76, 72.0, "male")
STEP, GRAVITY, HEIGHT = 0.01, 9.81, 1.0


@pytest.mark.parametrize("sway", [0.002, -0.001])
def test_sway_contradicted_by_the_cop_is_reduced_in_steps(sway: float) -> None:
    # A point mass: the CoP is c - h c'' / g, here by the derivative of a sine, not by differences.
    time = np.arange(300) * STEP
    rate = 2.0 * np.pi * 1.8  # of steps
    error = sway * np.sin(rate * time)
    cop_error = error * (1.0 + HEIGHT * rate**2 / GRAVITY)
    stepping = (time > 0.5) & (time < 2.5)
    wanted = np.where(stepping, -cop_error, 0.0)[:, None] * (1.0, 0.0)
    moves = _least_squares(wanted, stepping, np.full(300, HEIGHT / GRAVITY), STEP)
    inner = (time > 1.0) & (time < 2.0)
    # By 1 / (1 + (COP_DEVIATION / SWAY g / h)^2), and a little more by CENTRE_DEVIATION.
    left = error[inner] + moves[inner, 0]
    assert np.sqrt((left**2).mean()) < 0.5 * np.sqrt((error[inner] ** 2).mean())
    assert np.abs(moves[:, 1]).max() == 0.0
    assert np.abs(moves[:20]).max() < np.abs(moves[inner]).max()


def test_load_shifts_in_a_step_and_is_unknown_elsewhere() -> None:
    left = [True] * 9 + [False] * 6 + [True] * 7
    right = [False] * 4 + [True] * 18
    load, known = _load_shares(np.column_stack((left, right)))
    assert known[:15].all() and not known[15:].any()  # the last double support has no step after it
    np.testing.assert_array_equal(load[:4], np.tile((1.0, 0.0), (4, 1)))
    np.testing.assert_array_equal(load[9:15], np.tile((0.0, 1.0), (6, 1)))
    np.testing.assert_allclose(load[:15].sum(axis=1), 1.0)
    assert (np.diff(load[3:10, 1]) > 0.0).all()
    assert load[6, 1] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("lean", "front"), [(-0.3, 0.0), (0.2, UPRIGHT_COP + 0.2 * COP_PER_LEAN), (0.6, MAX_COP)]
)
def test_leaning_shank_has_its_cop_in_front_of_the_ankle(lean: float, front: float) -> None:
    angles = np.zeros((40, len(HINGES)))
    for side in ("left", "right"):
        angles[:, HINGE_NAMES.index(f"{side}_ankle_dorsiflexion")] = lean
    # Shanks lean as the body does; ankles turn the feet back to level.
    turn = np.array([[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0],
                     [-np.sin(lean), 0.0, np.cos(lean)]])  # fmt: skip
    poses = Poses(np.zeros((40, 3)), np.tile(turn, (40, 1, 1)), angles)
    robot = human_robot(BODY)
    q = configurations(robot, poses)
    motion = Motion(robot, np.arange(40) / 100.0, q[:, 7:], q[:, :7])
    series = wbc.analyze(motion, cutoff=None, noise=None, feet=None)
    cop, heading = _roll_over_cop(series, BODY.stature)
    np.testing.assert_allclose(heading, np.tile((1.0, 0.0), (40, 2, 1)), atol=1e-6)
    for k, (side, s) in enumerate((("left", 1.0), ("right", -1.0))):
        ankle = robot.snapshot(series.q[0]).position(f"{side}_foot")[:2]
        wanted = ankle + BODY.stature * np.array(
            (front, s * min(OUTWARD_PART * front, MAX_OUTWARD))
        )
        np.testing.assert_allclose(cop[0, k], wanted, atol=1e-3)


def gliding(speed: float, ahead: float) -> tuple[wbc.motion.RmpSeries, np.ndarray]:
    """A body that stands stiffly and glides, trunk bent forwards; on one foot, then the other."""
    time = np.arange(200) / 100.0
    angles = np.zeros((200, len(HINGES)))
    angles[:, HINGE_NAMES.index("lumbar_flexion")] = ahead
    position = np.column_stack((speed * time, np.zeros(200), np.full(200, 0.93)))
    robot = human_robot(BODY)
    q = configurations(robot, Poses(position, np.tile(np.eye(3), (200, 1, 1)), angles))
    motion = Motion(robot, time, q[:, 7:], q[:, :7])
    left = (time % 1.0) < 0.55
    right = (time % 1.0 >= 0.5) | (time % 1.0 < 0.05)
    series = wbc.analyze(motion, cutoff=5.0, noise=None, feet=None)
    return series, np.column_stack((left, right))


def test_forward_steps_move_the_cop_to_the_feet_with_a_note() -> None:
    series, down = gliding(1.2, 0.35)
    moves, notes = roll_over_correction(series, down, BODY.stature)
    cop, _ = _roll_over_cop(series, BODY.stature)
    towards = np.mean(cop[:, :, 0].mean(axis=1) - series.cop[:, 0])
    assert np.sign(moves[100, 0]) == np.sign(towards) and 0.0 < abs(moves[100, 0]) < abs(towards)
    assert len(notes) == 1 and "moved by" in notes[0]


def test_inverted_low_pass_is_undone_by_the_low_pass() -> None:
    time = np.arange(400) / 100.0
    wanted = np.sin(2.0 * np.pi * 4.5 * time)[:, None]  # Hz: the second harmonic of steps
    inner = slice(50, 350)
    plain, inverted = (
        low_pass(one, 100.0, 5.0) for one in (wanted, _invert_low_pass(wanted, 100.0, 5.0))
    )
    assert np.abs(plain - wanted)[inner].max() > 0.1
    assert np.abs(inverted - wanted)[inner].max() < 0.01


@pytest.mark.parametrize(
    ("speed", "ahead", "told"), [(0.3, 0.35, []), (1.2, -1.2, ["requires a CoP"])]
)
def test_human_without_forward_steps_or_leaning_on_something_is_not_moved(
    speed: float, ahead: float, told: list[str]
) -> None:
    moves, notes = roll_over_correction(*gliding(speed, ahead), BODY.stature)
    assert not moves.any()
    assert len(notes) == len(told) and all(one in notes[0] for one in told)


def test_march_on_the_spot_is_not_moved() -> None:
    recording, _ = recorded(BODY, seconds=1.0)
    found, left = (human_motion(recording, mass=72.0, by_steps=by) for by in (True, False))
    np.testing.assert_array_equal(found.motion.base, left.motion.base)
    assert not any("moved by" in note for note in found.notes)


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
