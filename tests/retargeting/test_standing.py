"""Standing motions in physics: a crouch that is followed, and where it cannot be balanced."""

from pathlib import Path

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import crouching
from wbc.polygon import inset
from wbc.problem import Problem, load_problem
from wbc.problem.standing_problem import REST_AFTER, standing_problem
from wbc.problem.targets import BEGINS, EASE
from wbc.retargeting import reference as references
from wbc.retargeting.reference import FrameRotation, MotionReference
from wbc.retargeting.standing import StandingMotion
from wbc.robot import Robot

TRUNK = "torso"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load("hoap2_like", armature=0.003)


@pytest.fixture(scope="module")
def crouch(robot: Robot) -> wbc.Retargeted:
    return wbc.retarget(crouching(1.2), robot, rate=40.0)


@pytest.fixture(scope="module")
def reference(crouch: wbc.Retargeted) -> MotionReference:
    return MotionReference(StandingMotion.of(crouch), begins=0.1, slower=1.5)


def test_what_a_motion_asks_for(crouch: wbc.Retargeted, reference: MotionReference) -> None:
    motion, h = reference.motion, 5e-4
    robot = motion.robot
    assert (BEGINS, EASE) == (references.BEGINS, references.EASE)
    assert reference.duration == pytest.approx(1.5 * crouch.time[-1] + EASE)
    for end, frame in ((reference.begins, 0), (reference.ends, -1)):  # at rest there
        target = reference.at(end)
        np.testing.assert_allclose(target.q, motion.q[frame], atol=1e-9)
        assert not target.v.any() and not target.acceleration.any()
    # In the middle by its own time, slowed: frames are met where there are some.
    k = len(crouch) // 2
    at = reference.begins + 0.5 * EASE + 1.5 * crouch.time[k]
    np.testing.assert_allclose(reference.at(at).q, motion.q[k], atol=1e-4)  # linear over 1 ms
    # Rates are those of the values, by differences of samples: second order in h.
    times = reference.begins + h * np.arange(600, 1800)
    target = reference.at(times)
    for value, rate, size in (
        (target.com, target.com_velocity, 1e-4),
        (target.com_velocity, target.com_acceleration, 2e-2),
        (target.momentum, target.momentum_rate, 3e-2),
        (target.inertia, target.inertia_rate, 1e-4),
        (target.q[:, 7:], target.v[:, 6:], 1e-3),
        (target.v, target.acceleration, 1.0),
    ):
        slope = (value[2:] - value[:-2]) / (2.0 * h)
        assert np.abs(slope - rate[1:-1]).max() < size
    turn = FrameRotation(reference, TRUNK)
    for t in (0.5, 1.1):
        (R0, w0, _), (R, w, alpha), (R1, w1, _) = (turn.at(t + d) for d in (-h, 0.0, h))
        spin = R.T @ (R1 - R0) / (2.0 * h)  # [w] in the frame's axes
        np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], w, atol=2e-3)
        np.testing.assert_allclose((w1 - w0) / (2.0 * h), alpha, atol=0.2)
    # Newton and Euler: the moment about the CoP is vertical.
    force = robot.mass * (target.com_acceleration + [0.0, 0.0, robot.gravity])
    moment = target.momentum_rate[:, 3:] + np.cross(target.com - target.cop, force)
    assert np.abs(moment[:, :2]).max() < 0.05  # N m; rates of the CoM's are differences twice


def test_hasty_motion_is_unbalanced(crouch: wbc.Retargeted, reference: MotionReference) -> None:
    assert not [one for one in reference.unbalanced if one.by > 0.05]
    # The same frames in a fifth of the time: the CoM would be thrown up and down.
    hasty = StandingMotion(reference.motion.robot, "hasty", 0.2 * crouch.time, reference.motion.q)
    found = MotionReference(hasty, ease=0.05).unbalanced
    assert {one.what for one in found} & {"CoP outside the feet", "torque above the limit"}
    one = max(found, key=lambda one: one.by)
    assert BEGINS <= one.start <= one.worst <= one.end <= BEGINS + 0.2 * crouch.time[-1] + 0.06
    with pytest.raises(wbc.WbcError, match="slower"):
        MotionReference(hasty, slower=0.5)
    led = MotionReference(hasty, ease=0.05, lean=0.005)
    assert led.led > 0.0
    inside = inset(hasty.stands(hasty.q[:1])[0].polygon, 0.005)
    corners = np.array([inside.min(axis=0), inside.max(axis=0)])
    cop = led.at(np.linspace(BEGINS, led.ends, 200)).cop[:, :2]
    assert (cop >= corners[0] - 1e-6).all() and (cop <= corners[1] + 1e-6).all()


def test_motion_that_leaves_the_ground_is_refused(crouch: wbc.Retargeted, tmp_path: Path) -> None:
    path, robot = tmp_path / "crouch.npz", crouch.robot
    crouch.save(path)
    assert StandingMotion.read(path, robot).q.shape == crouch.q.shape
    with pytest.raises(wbc.WbcError, match="joints are not those of g1"):
        StandingMotion.read(path, Robot.load("g1"))
    with pytest.raises(wbc.WbcError, match="No such file"):
        StandingMotion.read(tmp_path / "none.npz", robot)
    with np.load(path) as file:
        arrays = dict(file)
    for name, change, said in (
        ("contacts", lambda one: np.where(np.arange(len(one))[:, None] == 9, False, one),
         "the left foot leaves the ground at 0.2"),
        ("q", lambda one: one + np.eye(robot.nq)[2] * np.linspace(0, 0.02, len(one))[:, None],
         "foot moves by 0.02 m"),
        ("contacts", lambda one: one[:-1], "expected shape"),
        ("time", lambda one: one[::-1].copy(), "in order of time"),
    ):  # fmt: skip
        np.savez(path, **{**arrays, name: change(arrays[name])})
        with pytest.raises(wbc.WbcError, match=said):
            StandingMotion.read(path, robot)
    np.savez(path, time=arrays["time"])
    with pytest.raises(wbc.WbcError, match="it has no array 'q'"):
        StandingMotion.read(path, robot)


@pytest.fixture
def problem(crouch: wbc.Retargeted, tmp_path: Path) -> Path:
    crouch.save(tmp_path / "crouch's.npz")
    motion = StandingMotion.of(crouch)
    text = standing_problem(motion, "crouch's.npz", model="hoap2_like", trunk=TRUNK, slower=1.5)
    path = tmp_path / "crouch.yaml"
    path.write_text(text)
    return path


def test_mistakes_of_a_problem_are_refused(problem: Path) -> None:
    begun = load_problem(problem)
    assert isinstance(begun, Problem)
    reference = begun.parts.plan
    assert isinstance(reference, MotionReference)
    assert begun.spec.simulation.duration == pytest.approx(reference.ends + REST_AFTER, abs=1e-3)
    text = problem.read_text()
    for old, new, said in (
        ("start: {motion: 'crouch''s.npz'}", "start: {posture: standing}", "does not start where"),
        ("npz'}\nsupport", "npz', posture: standing}\nsupport", "leave this out"),
        ("support: double", "support: left", "both feet"),
        ("simulation: {duration: ", "simulation: {duration: 0.5}  # ", "after the run"),
        (", slower: 1.5", ", slwer: 1.5", "slower"),
        ("target: *motion, kp: 100", "target: {motion: other.npz}, kp: 100", "same plan or motion"),
    ):
        assert text.count(old) == 1
        problem.write_text(text.replace(old, new))
        with pytest.raises(wbc.WbcError, match=said):
            load_problem(problem)


@pytest.mark.slow
def test_crouch_is_followed_in_physics(problem: Path) -> None:
    pytest.importorskip("mujoco")
    noise = {"position_noise": 1e-3, "velocity_noise": 0.05, "delay": 0.002, "seed": 3}
    overrides = {"simulation.sensors": noise, "simulation.model_error": {"mass": 1.1}}
    loaded = load_problem(problem, overrides)
    assert isinstance(loaded, Problem)
    result = loaded.simulate()
    found = result.tracking
    assert result.status.good and found is not None and found.joints is not None
    assert found.followed == "motion" and found.whole
    # A tenth too heavy, the CoM sags by 0.1 g / kp = 9.8 mm where nothing else holds it.
    assert found.com.peak > 0.015 and found.com.worst < 0.1 * 9.81 / 100.0  # m
    assert found.joints.rms < 0.08  # rad, of which that sag is the most
    assert "joints" in result.summary()["plan"]
