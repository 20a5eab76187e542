"""The loop closed with the torque controller: it stands, falls and says why, also off its model."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import tests.standing
import wbc
from tests.conftest import load, random_state
from tests.simulation.accelerations import acceleration_from_mujoco
from tests.standing import stack, torque_controller
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait import Walker
from wbc.gait.scheduled_walk import ScheduledWalk
from wbc.motion import analyze, read_motion
from wbc.robot import Robot
from wbc.run import Stop
from wbc.simulation import FallLimits, FallWatch, Plant, Recorder, Sensors, run_trial, simulate

DT = 0.002


def standing(robot: Robot) -> wbc.TorqueController:
    return torque_controller(tests.standing.standing(robot), solver="daqp")


@pytest.mark.slow
def test_it_stands_and_what_is_planned_is_what_acts(humanoid: Robot) -> None:
    plant = Plant(humanoid, dt=DT)
    last = None
    for last in simulate(standing(humanoid), plant, 0.3):
        assert last.verdict.stood and last.fresh
    assert last is not None and last.time == pytest.approx(0.3)
    assert str(last.verdict) == "stood for 0.300 s"
    weight = 9.81 * humanoid.mass
    for frame, wrench in plant.contact_forces.items():
        planned = last.tick.forces[frame]
        # nearly at rest; TALOS's joints have dry friction, which the controller does not know
        np.testing.assert_allclose(wrench[:3], planned[:3], atol=0.02 * weight)
    assert last.tick.cop is not None and plant.cop is not None
    np.testing.assert_allclose(plant.cop[:2], last.tick.cop[:2], atol=5e-3)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (FallLimits(), "touched the ground"),
        (FallLimits(touch=False, com_height=0.0), r"base tilted by 1\.2"),
        (FallLimits(touch=False, tilt=4.0), "the CoM sank"),
    ],
)
def test_a_fall_ends_the_run_and_says_why(limits: FallLimits, words: str) -> None:
    robot = load("hoap2_like")
    plant = Plant(robot, dt=DT)
    plant.reset(robot.posture("standing"), 1.5 * np.eye(robot.nv)[0])
    watch = FallWatch(plant, limits)
    for _ in range(1000):
        plant.step(-0.02 * plant.state()[1][6:])  # limp
        verdict = watch.verdict()
        if not verdict.stood:
            break
    assert not verdict.stood and verdict.time == plant.time < 2.0
    assert re.search(words, str(verdict))


def test_the_loop_ends_with_the_fall_unless_told_otherwise() -> None:
    robot = load("hoap2_like")
    controller, plant = standing(robot), Plant(robot, dt=DT)
    for falls in (FallLimits(), None):
        plant.reset(robot.posture("standing"))
        plant.push("base", [60.0, 0.0, 0.0], "com", duration=0.1)  # 6 N s on 7 kg
        # It falls at 0.35 s. Commanded on as if it stood, a robot that lies thrashes: some reach
        # 1e5 rad/s from 0.57 s on, which the physics does not survive.
        ticks = list(simulate(controller, plant, 0.45, falls=falls))
        assert not ticks[-1].verdict.stood
        assert (len(ticks) == 225) == (falls is None)


def test_lost_frames_hold_the_torque() -> None:
    robot = load("hoap2_like")
    plant = Plant(robot, dt=DT, sensors=Sensors(dropout=0.4, seed=2))
    held, last = 0, None
    for now in simulate(standing(robot), plant, 0.4):
        if not now.fresh and last is not None:
            assert now.tick is last.tick and now.snapshot is last.snapshot
            held += 1
        last = now
    assert last is not None and last.verdict.stood and 40 < held < 120


def test_the_loop_is_deterministic() -> None:
    robot = load("hoap2_like")
    sensors = Sensors(position_noise=1e-3, velocity_noise=0.05, delay=0.002, dropout=0.1, seed=8)
    ends = []
    for _ in range(2):
        plant = Plant(robot, dt=DT, sensors=sensors)
        plant.push("base", [5.0, 3.0, 0.0], duration=0.05, start=0.02)
        for _ in simulate(standing(robot), plant, 0.1):
            pass
        ends.append(b"".join(part.tobytes() for part in plant.state()))
    assert ends[0] == ends[1]


def test_update_chooses_the_controller_and_ends_the_loop() -> None:
    robot = load("hoap2_like")
    first, second = standing(robot), standing(robot)
    plant = Plant(robot, dt=DT)
    seen = []

    def update(k: int, snapshot: wbc.Snapshot) -> wbc.TorqueController | None:
        seen.append(snapshot)
        return None if k == 5 else (first, second)[k % 2]

    ticks = list(simulate(first, plant, 1.0, update=update))
    assert len(ticks) == 5 and len(seen) == 6
    assert ticks[0].snapshot is seen[0]
    slower = wbc.TorqueController(robot, first.tasks, contacts=(), dt=2.0 * DT)
    with pytest.raises(InvalidInputError, match=r"ticks last 0\.002 s, .* for 0\.004 s"):
        next(simulate(first, plant, 1.0, update=lambda k, snapshot: slower))


def test_a_recording_is_read_by_analyze(tmp_path: Path) -> None:
    robot = load("hoap2_like")
    plant = Plant(robot, dt=DT)
    recorder = Recorder(plant)
    push = plant.push("base", [4.0, 0.0, 0.0], "com", duration=0.05, start=0.1)
    for now in simulate(standing(robot), plant, 0.4):
        recorder.add(now.tick)
    recorder.save(tmp_path / "run.npz", {"verdict": str(now.verdict)})
    recorder.save(tmp_path / "run.csv")
    found = dict(np.load(tmp_path / "run.npz"))
    rows = len(recorder)
    assert rows == 201 and found["q"].shape == (rows, robot.nq)
    assert tuple(found["joint_names"]) == robot.joint_names
    assert "stood for 0.400 s" in str(found["summary"])
    total = sum(found[f"forces/{foot.frame}"] for foot in robot.feet.values())
    assert total[-1, 2] == pytest.approx(9.81 * robot.mass, rel=0.05)
    planned = sum(found[f"planned_forces/{foot.frame}"] for foot in robot.feet.values())
    assert np.isnan(planned[0]).all() and np.isfinite(planned[1:]).all()
    # sampled at the end of each period: the impulse to one period's share
    sampled = found["push"].sum(axis=0) * DT
    np.testing.assert_allclose(sampled, push.impulse, atol=DT * np.abs(push.force).max())
    for name, ignore in (("run.npz", ()), ("run.csv", ("*/*",))):
        motion = read_motion(tmp_path / name, robot, ignore=ignore)
        np.testing.assert_allclose(motion.time, found["time"], atol=1e-9)
        np.testing.assert_allclose(motion.joints, found["q"][:, 7:], atol=1e-8)
        series = analyze(motion, cutoff=None)
        # the reaction that analysis derives from the motion is the one that was recorded
        middle = slice(100, 190)
        np.testing.assert_allclose(series.cop[middle, 0], found["cop"][middle, 0], atol=0.01)
        reaction = robot.mass * (series.com_acceleration[middle, 2] + 9.81)
        np.testing.assert_allclose(reaction, total[middle, 2], rtol=0.05)


def test_no_part_of_a_duration_is_left_out() -> None:
    """It was rounded to periods, half of one to none: nothing was simulated, in silence."""
    robot = load("hoap2_like")
    for duration, periods in ((0.0005, 1), (2.5 * DT, 3), (3.0 * DT, 3)):
        assert len(list(simulate(standing(robot), Plant(robot, dt=DT), duration))) == periods


def test_a_trial_of_a_slower_controller_has_its_ticks_at_their_times() -> None:
    """They were a period of the plant before their ends, and half of them was said to be to do."""
    robot = load("hoap2_like")
    walk, plant, said = ScheduledWalk(Walker(robot, dt=2.0 * DT), ()), Plant(robot, dt=DT), []
    result = run_trial(
        walk, plant, Stop(duration=0.1), progress=lambda *told: said.append(told[:2])
    )
    ticks = result.run.history.arrays()["time"]
    np.testing.assert_allclose(ticks, 2.0 * DT * np.arange(25), atol=1e-9)
    assert said[-1] == (25, 25)


def test_mistakes_are_typed() -> None:
    robot = load("hoap2_like")
    plant, loaded = Plant(robot, dt=DT), Plant(robot, dt=DT)
    start = robot.snapshot(robot.posture("standing"))
    kinematic = wbc.KinematicController(robot, [wbc.PostureTask(robot, start.q)], dt=DT)
    loaded.apply("torso", (0.0, 0.0, -20.0, 0.0, 0.0, 0.0))
    trunk, other = FallLimits(trunk="trnk"), standing(Robot.load("hoap2_like"))
    mistakes = (
        (lambda: next(simulate(kinematic, plant, 1.0)), "KinematicController commands no torques"),
        # It sank by 3 cm, in silence.
        (lambda: next(simulate(Walker(robot, dt=DT), loaded, 1.0)), r"takes no known .* on torso"),
        (lambda: next(simulate(other, plant, 1.0)), "same object"),
        (lambda: next(simulate(standing(robot), plant, -1.0)), "duration"),
        (lambda: next(simulate(standing(robot), plant, 1.0, falls=trunk)), "frame"),
        (lambda: FallLimits(com_height=1.0), "com_height"),
        (lambda: Recorder(plant).save("run.txt"), "written as"),
    )
    for mistake, said in mistakes:
        with pytest.raises((InvalidInputError, UnknownNameError), match=said):
            mistake()


@pytest.mark.parametrize("mode", ["double", "right", "floating"])
def test_forward_dynamics_give_the_acceleration_of_the_tick(mode, humanoid, rng) -> None:
    """Oracle: MuJoCo's accelerations under the tick's torques and contact forces."""
    robot = humanoid
    standing = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    plant = Plant(robot, shapes=False)
    plant.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    plant.model.dof_damping[:] = 0.0  # the tick's is implicit, by the velocity at its end
    for _ in range(3):
        q, v = random_state(robot, rng)
        here = robot.snapshot(q, 0.3 * v)
        given = {"contacts": wbc.support(here, mode), "solver": "daqp"}
        tick = wbc.TorqueController(robot, stack(standing), **given).step(here)
        plant.reset(here.q, here.v)
        torque = tick.torque - robot.model.damping[6:] * tick.velocity[6:]
        plant.states.torques_to_mujoco(torque, plant.data.qfrc_applied)
        for frame, wrench in tick.forces.items():
            joint = robot.model.frames[robot.frame_id(frame)].parentJoint
            body = plant.model.body(f"body {joint}").id
            arm = here.position(frame) - plant.data.xipos[body]
            moment = wrench[3:] + np.cross(arm, wrench[:3])
            plant.data.xfrc_applied[body] += np.concatenate((wrench[:3], moment))
        mujoco.mj_forward(plant.model, plant.data)
        found = acceleration_from_mujoco(plant.states, here.q, here.v, plant.data.qacc)
        # A torque at its bound is clipped by what the solver leaves there, about 1e-8 of it.
        size = np.abs(tick.acceleration).max() + np.abs(tick.torque).max()
        np.testing.assert_allclose(found, tick.acceleration, atol=1e-8 * size)


@pytest.mark.slow
def test_every_humanoid_stands_without_a_gain(humanoid: Robot) -> None:
    """Default gains, weights and contacts; the ground is MuJoCo's."""
    robot = humanoid
    plant = Plant(robot)
    plant.reset(robot.posture("standing"))
    start = plant.snapshot()
    controller = torque_controller(start, limits=wbc.Limits(robot))
    for now in simulate(controller, plant, 0.5):
        assert now.tick.policy is None, now.tick.report()
    here, tick = plant.snapshot(), now.tick
    assert np.linalg.norm(here.com - start.com) < 1e-3
    for foot in robot.feet.values():
        assert np.linalg.norm(here.position(foot.frame) - start.position(foot.frame)) < 5e-4
    # Predicted and measured: the ground gives way by a tenth of a millimetre.
    assert tick.cop is not None and plant.cop is not None
    np.testing.assert_allclose(tick.cop, plant.cop, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seconds", "armature"), [("g1", 0.6, 0.003), ("g1", 0.35, 0.003), ("talos", 0.7, None)]
)
def test_a_crouch_into_the_ankles_limits_does_not_chatter(name, seconds, armature) -> None:
    """The forces' total variation: one weight and back is 2, and 100 where limits chattered."""
    robot = wbc.Robot.load(name, **({} if armature is None else {"armature": armature}))
    plant = Plant(robot)
    start = robot.snapshot(robot.posture("standing"))
    com = wbc.ComTask(robot, start.com, weight=30.0, kp=100.0)
    tasks = [com, wbc.PostureTask(robot, start.q, weight=0.1)]
    given = {"contacts": wbc.support(start, "double"), "limits": wbc.Limits(robot)}
    controller = wbc.TorqueController(robot, tasks, **given, solver="daqp")
    down = np.array([0.0, 0.0, -0.35 * start.com[2]])
    forces, margins = [], []
    for k in range(round((seconds + 0.6) / controller.dt)):
        x = min(k * controller.dt / seconds, 1.0)
        way = np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], x)
        rate = np.polyval([30.0, -60.0, 30.0, 0.0, 0.0], x) / seconds
        com.set_target(start.com + way * down, rate=rate * down)
        here = robot.snapshot(*plant.state())
        tick = controller.step(here)
        assert tick.policy is None, tick.report()
        plant.step(tick.torque)
        forces.append(sum(force[2] for force in tick.forces.values()) / robot.weight)
        ankles = [k for k, joint in enumerate(robot.joint_names) if "ankle_pitch" in joint]
        ankles = ankles or [robot.joint_names.index(f"leg_{s}_5_joint") for s in ("left", "right")]
        margins.append((here.joint_positions - robot.limits.lower)[ankles].min())
    assert min(margins) < 1e-3, "the limit is what ends the crouch"
    assert np.abs(np.diff(forces)).sum() < 12.0
    assert max(forces) < 2.5
    assert here.com[2] > 0.55 * start.com[2]
