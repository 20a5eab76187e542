"""Turns without momentum: the connection, closed paths and rounds of joints, plans."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import wbc
from wbc.errors import ProblemFileError, UnknownNameError
from wbc.flight.connection import rotation_of, turning_rate
from wbc.flight.planner import NoTurnError, plan_turn
from wbc.flight.rounds import JointLoop, Rounds, even_phases
from wbc.problem import Problem, load_problem

PROBLEMS = Path(__file__).parents[2] / "problems"
LEGS = ("*hip_pitch", "*knee*", "*shoulder_pitch")
JOINTS = {"left_hip_pitch": (0.2, -0.1, 0.5, 0.0), "right_knee_pitch": (-0.3, 0.0, 0.0, 0.1)}


@pytest.fixture(scope="module")
def pitch(hoap2: wbc.Robot) -> Rounds:
    """A plan of few joints, which takes seconds: 18 degrees forwards, bodies kept apart."""
    collision = wbc.SelfCollision(hoap2, margin=0.002)
    return plan_turn(
        hoap2, [0.0, np.deg2rad(18.0), 0.0], cycles=1, joints=LEGS, collision=collision
    )


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_the_connection_leaves_no_momentum(name: str) -> None:
    one = wbc.Robot.load(name)
    rate, random = turning_rate(one), np.random.default_rng(1)
    data = one.model.createData()
    for _ in range(3):
        q = one.posture("standing")
        q[7:] += 0.3 * random.standard_normal(one.nq - 7)
        v = np.zeros(one.nv)
        v[6:] = random.standard_normal(one.nv - 6)
        v[3:6] = np.array(rate(q[7:], v[6:])).ravel()
        pin.ccrba(one.model, data, q, v)
        # 1e-15 of joints' momenta of about 1 kg m^2/s.
        np.testing.assert_allclose(data.hg.angular, 0.0, atol=1e-13)


def test_the_rotation_of_a_round_does_not_hang_on_its_phase(hoap2: wbc.Robot) -> None:
    """Half rounds put together, and the round backwards: a path is a path."""
    rate = turning_rate(hoap2)
    random = np.random.default_rng(2)
    loop = JointLoop(hoap2.posture("standing")[7:], 0.2 * random.standard_normal((4, hoap2.nv - 6)))
    signs = np.array([1.0, 1.0, -1.0, -1.0])[:, None]  # phase to minus phase
    back = JointLoop(loop.start, signs * loop.coefficients)
    there = rotation_of(rate, loop, 400)
    np.testing.assert_allclose(there @ rotation_of(rate, back, 400), np.eye(3), atol=1e-9)
    assert Rotation.from_matrix(there).magnitude() > 1e-3


def rotation(robot: wbc.Robot, rounds: Rounds, steps: int) -> np.ndarray:
    """Rotation vector [deg] of a base that follows without momentum, by Pinocchio's A_g over time.

    Of fourth order: Magnus' series with Gauss' two points.
    """
    data, h = robot.model.createData(), rounds.duration / steps
    turned = Rotation.identity()

    def spin(t: float) -> np.ndarray:
        q, rate, _ = rounds.at(t)
        A = pin.computeCentroidalMap(robot.model, data, q)
        return np.linalg.solve(A[:, :6], -A[:, 6:] @ rate[6:])[3:]

    for k in range(steps):
        a, b = (spin((k + 0.5 + s * np.sqrt(3) / 6) * h) for s in (-1, 1))
        step = 0.5 * h * (a + b) - np.sqrt(3) / 12 * h**2 * np.cross(b, a)
        turned = turned * Rotation.from_rotvec(step)
    return turned.as_rotvec(degrees=True)


@pytest.mark.slow
def test_a_plan_turns_as_far_as_asked(hoap2: wbc.Robot, pitch: Rounds) -> None:
    np.testing.assert_allclose(rotation(hoap2, pitch, 400), [0.0, 18.0, 0.0], atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_shipped_turns_are_quarter_turns(axis: str) -> None:
    problem = load_problem(PROBLEMS / f"turn_{axis}_hoap2.yaml")
    assert isinstance(problem, Problem)
    robot = problem.parts.robot
    rounds = problem.parts.targeted[1].course
    assert isinstance(rounds, Rounds)
    wanted = 90.0 * np.eye(3)["xyz".index(axis)]
    np.testing.assert_allclose(rotation(robot, rounds, 1500), wanted, atol=0.1)
    collision, limits = wbc.SelfCollision(robot, margin=0.001), robot.limits
    round_ = rounds.loop.at(np.linspace(0.0, 2.0 * np.pi, 80))
    assert (round_ >= limits.lower).all() and (round_ <= limits.upper).all()
    for joints in round_:
        q = np.concatenate((rounds.posture[:7], joints))
        assert collision.distances(robot.snapshot(q)).clearance.min() > 0.0


@pytest.mark.slow
def test_a_plan_keeps_limits_and_distances(hoap2: wbc.Robot, pitch: Rounds) -> None:
    collision = wbc.SelfCollision(hoap2, margin=0.001)
    limits = hoap2.limits
    for t in np.linspace(0.0, pitch.duration, 60):
        q, _, _ = pitch.at(t)
        assert (q[7:] >= limits.lower).all() and (q[7:] <= limits.upper).all()
        assert collision.distances(hoap2.snapshot(q)).clearance.min() > 0.0
    still = [k for k, name in enumerate(hoap2.joint_names) if "yaw" in name or "roll" in name]
    assert (pitch.coefficients[:, still] == 0.0).all()


@pytest.mark.slow
def test_what_cannot_be_turned_is_said(hoap2: wbc.Robot) -> None:
    with pytest.raises(NoTurnError, match="give more cycles"):
        # Joints that turn about y alone cannot turn the robot about x.
        plan_turn(hoap2, [0.5, 0.0, 0.0], cycles=1, joints=("*hip_pitch",), starts=1)
    for wrong in ([0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 1.0]):
        with pytest.raises(wbc.WbcError, match="turn, rotation"):
            plan_turn(hoap2, wrong)
    with pytest.raises(UnknownNameError):
        plan_turn(hoap2, [0.0, 0.3, 0.0], joints=("*wing*",))


@pytest.fixture
def geared(hoap2: wbc.Robot, tmp_path: Path) -> wbc.Robot:
    """A robot whose right elbow follows the left one by half."""
    text = Path(str(hoap2.path)).read_text()
    at = text.index("</joint>", text.index('<joint name="right_elbow_pitch"'))
    file = tmp_path / "geared.urdf"
    file.write_text(f'{text[:at]}<mimic joint="left_elbow_pitch" multiplier="0.5"/>{text[at:]}')
    return wbc.Robot.load(file)


@pytest.mark.parametrize("elbow", ["left_elbow_pitch", "right_elbow_pitch"])
def test_mimic_joints_go_with_their_drivers(geared: wbc.Robot, elbow: str) -> None:
    """Each went its own way."""
    q = geared.posture("standing", {"left_elbow_pitch": -0.6})
    rounds = plan_turn(geared, [0.0, 0.0, 0.5], q=q, joints=(elbow, "*shoulder*"))
    left, right = (geared.joint_names.index(f"{side}_elbow_pitch") for side in ("left", "right"))
    moved = rounds.coefficients
    np.testing.assert_array_equal(moved[:, right], 0.5 * moved[:, left])
    assert np.abs(moved[:, left]).max() > 1e-3
    again = Rounds.of(geared, q, rounds.target()["loop"], 4, 3.0)  # as rounded in a file
    np.testing.assert_array_equal(again.coefficients[:, right], 0.5 * again.coefficients[:, left])
    with pytest.raises(wbc.WbcError, match="right_elbow_pitch follows left_elbow_pitch"):
        Rounds.of(geared, q, {"right_elbow_pitch": [0.1, 0.0]}, 1, 3.0)


def test_the_limbs_of_any_robot_move_by_default(hoap2: wbc.Robot, tmp_path: Path) -> None:
    """A robot without a joint called after its waist was told of an unknown joint '*waist*'."""
    text = Path(str(hoap2.path)).read_text()
    file = tmp_path / "other.urdf"
    for old, new in (("waist", "spine"), ("knee", "Knee"), ("hip", "j"), ("_shoulder", "_s")):
        text = text.replace(old, new)
    file.write_text(text)
    robot = wbc.Robot.load(file)
    rounds = plan_turn(robot, [0.0, 0.02, 0.0], cycles=1)
    moved = {robot.joint_names[k] for k in np.flatnonzero(rounds.coefficients.any(axis=0))}
    assert {"left_Knee_pitch", "right_elbow_pitch"} <= moved
    assert all("Knee" in name or "elbow" in name for name in moved)


def test_a_turn_from_the_end_of_a_range_stays_in_it(hoap2: wbc.Robot) -> None:
    """Each path went beyond it between two of the phases at which ranges are kept."""
    limits, name = hoap2.limits, "left_knee_pitch"
    k = hoap2.joint_names.index(name)
    turn: dict[str, Any] = {"cycles": 1, "joints": ("*knee*", "*hip_pitch"), "starts": 1}
    q = hoap2.posture("standing", {name: limits.lower[k]})
    rounds = plan_turn(hoap2, [0.0, 0.1, 0.0], q=q, **turn)
    knee = rounds.loop.at(np.linspace(0.0, 2.0 * np.pi, 2000))[:, k]
    assert knee.min() >= limits.lower[k] - 1e-9
    assert np.ptp(knee) > 0.05
    q[7 + k] -= 0.01
    with pytest.raises(NoTurnError, match=f"out of range: {name}"):
        plan_turn(hoap2, [0.0, 0.1, 0.0], q=q, **turn)


def test_unusable_numbers_of_a_turn_are_refused(hoap2: wbc.Robot) -> None:
    """IndexError, ValueError, and 2.7 cycles were 2."""
    for wrong, words in (
        ({"joints": []}, "turn, joints: name at least one"),
        ({"cycles": 2.7}, "turn, cycles: expected a whole number"),
        ({"seed": -1}, "turn, seed: must be at least 0"),
        ({"collision": 0.02}, r"turn, collision: expected a SelfCollision, .* got 0\.02"),
    ):
        with pytest.raises(wbc.WbcError, match=words):
            plan_turn(hoap2, [0.0, 0.3, 0.0], **wrong)


def test_a_robot_that_is_bolted_down_does_not_turn() -> None:
    """A path came back, and the base stayed where it was."""
    with pytest.raises(wbc.WbcError, match="turn: the base of hoap2_like is fixed"):
        plan_turn(wbc.Robot.load("hoap2_like", base="fixed"), [0.0, 0.0, 0.05])


def test_bodies_of_which_no_pair_is_watched_do_not_hinder(hoap2: wbc.Robot) -> None:
    """The least of no distances was a ValueError."""
    nothing = wbc.SelfCollision(hoap2, exclude=[("*", "*")])
    way = [0.0, 0.0, 0.05]
    turns = [plan_turn(hoap2, way, collision=one, starts=1) for one in (nothing, None)]
    np.testing.assert_array_equal(turns[0].coefficients, turns[1].coefficients)


def test_margins_that_leave_no_range_are_no_turn(hoap2: wbc.Robot) -> None:
    """It ended in IPOPT's RuntimeError of crossed bounds."""
    with pytest.raises(NoTurnError, match="smaller margins"):
        plan_turn(hoap2, [0.0, 0.0, 0.1], margin=10.0, starts=1)


@pytest.mark.slow
def test_a_shipped_turn_is_commanded_without_momentum() -> None:
    """By ticks of 5 ms, without the margin between bodies, which takes the time."""
    problem = load_problem(PROBLEMS / "turn_z_hoap2.yaml", {"constraints": {}})
    assert isinstance(problem, Problem)
    result = problem.run()
    assert result.status == "accepted", result.reason
    robot, start = problem.parts.robot, problem.parts.start
    between = Rotation.from_quat(start[3:7]).inv() * Rotation.from_quat(result.q[3:7])
    # Each tick holds its velocity: of first order in its 5 ms.
    np.testing.assert_allclose(between.as_rotvec(degrees=True), [0.0, 0.0, 90.0], atol=2.0)
    data = robot.model.createData()
    for q, v in zip(result.history.q, result.history.v, strict=True):
        pin.ccrba(robot.model, data, q, v)
        assert np.abs(data.hg.vector).max() < 1e-9
    np.testing.assert_allclose(result.q[7:], start[7:], atol=1e-3)


def test_mistakes_in_files_are_named(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    text = """\
robot: hoap2_like
support: floating
tasks:
  path: {type: posture, target: {loop: {left_hip_pitch: [0.1, 0.2]}, cycles: 2, period: 1.0}}
stop: {duration: 3.0, speed: null}
"""
    file.write_text(text)
    assert isinstance(load_problem(file), Problem)
    target = "tasks.path.target"
    for overrides, words in (
        ({f"{target}.period": 2.0}, "the loop ends at 4 s, after the run"),
        ({f"{target}.loop": {"left_hip": [0.1, 0.2]}}, "left_hip_"),
        ({f"{target}.loop": {"left_hip_pitch": [0.1, 0.2, 0.3]}}, "an even one"),
        ({f"{target}.cycles": 0}, "cycles"),
        ({"phases": {"a": {"duration": 3.0}}, "stop": {}}, "in a run without phases"),
    ):
        with pytest.raises(ProblemFileError, match=words):
            load_problem(file, overrides)


@pytest.fixture(scope="module")
def rounds(hoap2: wbc.Robot) -> Rounds:
    return Rounds.of(hoap2, hoap2.posture("standing"), JOINTS, 3, 2.0)


def test_a_loop_is_its_fourier_series() -> None:
    loop = JointLoop(np.array([0.4]), np.array([[0.2], [-0.1], [0.5], [0.0]]))
    p = 0.7
    wanted = 0.4 + 0.2 * (np.cos(p) - 1) - 0.1 * (np.cos(2 * p) - 1) + 0.5 * np.sin(p)
    np.testing.assert_allclose(loop.at(np.array([p])), [[wanted]], atol=1e-15)
    np.testing.assert_allclose(loop.at(np.array([0.0, 2 * np.pi])), 0.4, atol=1e-15)


@pytest.mark.parametrize("derivative", [1, 2])
def test_derivatives_by_the_phase(derivative: int) -> None:
    loop = JointLoop(np.zeros(2), np.random.default_rng(0).standard_normal((6, 2)))
    phases, h = even_phases(7), 1e-5
    difference = loop.at(phases + h, derivative - 1) - loop.at(phases - h, derivative - 1)
    np.testing.assert_allclose(loop.at(phases, derivative), difference / (2 * h), atol=1e-8)


def test_rounds_begin_and_end_at_rest_in_their_posture(rounds: Rounds) -> None:
    for t in (-1.0, 0.0, rounds.duration, rounds.duration + 1.0):
        q, rate, acceleration = rounds.at(t)
        np.testing.assert_allclose(q, rounds.posture, atol=1e-12)
        np.testing.assert_array_equal(rate, 0.0)
        np.testing.assert_allclose(acceleration, 0.0, atol=1e-12)


def test_rates_and_accelerations_are_those_of_the_postures(hoap2, rounds) -> None:
    h = 1e-4
    for t in (0.3, 2.1, 5.5):
        before, here, after = (rounds.at(t + k * h) for k in (-1, 0, 1))
        moved = hoap2.difference(before[0], after[0]) / (2 * h)
        np.testing.assert_allclose(here[1], moved, atol=1e-5)
        np.testing.assert_allclose(here[2], (after[1] - before[1]) / (2 * h), atol=1e-4)
        assert (here[1][:6] == 0.0).all()


def test_a_target_in_a_file_is_the_same_path(hoap2: wbc.Robot, rounds: Rounds) -> None:
    target = rounds.target()
    again = Rounds.of(hoap2, rounds.posture, target["loop"], target["cycles"], target["period"])
    np.testing.assert_array_equal(again.coefficients, rounds.coefficients)
    assert again.duration == rounds.duration == 6.0


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"loop": {"left_knee": (0.1, 0.1)}}, "left_knee_pitch"),
        ({"loop": {"left_knee_pitch": (0.1, 0.1, 0.1)}}, r"an even one.*got \[3\]"),
        ({"loop": {**JOINTS, "left_hip_yaw": (0.1, 0.1)}}, r"got \[2, 4\]"),
        # It was held at its limit, and the robot turned less than by the path.
        ({"loop": {"left_hip_pitch": (0.0, 3.0)}}, "hip_pitch' goes to .*outside its limits"),
        ({"cycles": 0}, "cycles"),
        ({"cycles": 1.5}, "cycles"),  # the path ended elsewhere, by up to 0.4 rad
        ({"period": 0.0}, "period"),
    ],
)
def test_mistakes_are_named(hoap2: wbc.Robot, changed: dict[str, Any], words: str) -> None:
    given: dict[str, Any] = {"loop": JOINTS, "cycles": 1, "period": 1.0, **changed}
    with pytest.raises(wbc.WbcError, match=words):
        Rounds.of(hoap2, hoap2.posture("standing"), **given)
