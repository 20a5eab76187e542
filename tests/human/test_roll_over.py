"""Roll-over correction: the CoP rolls over the sole, the load shifts smoothly."""

import numpy as np
import pytest

import wbc
from tests.human.walker import recorded
from wbc.human import HumanBody, human_motion, human_robot
from wbc.human.body import HINGE_NAMES, HINGES
from wbc.human.kinematics import Poses
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
