"""An ankle that two rods drive, its loops given to a URDF: closed form, both levels, and a file."""

from pathlib import Path

import numpy as np
import pytest

from tests.loops import ankle
from tests.problem.loading import problem_of
from tests.standing import commanded
from wbc import KinematicController, Limits, OrientationTask, PostureTask, TorqueController
from wbc.constraints.mechanics import mechanics_of
from wbc.controllers.closed_loop import closed_loop
from wbc.errors import WbcError
from wbc.robot import Robot, Snapshot

MOTORS = ["left_motor", "right_motor"]
PROBLEM = """
robot:
  model: ankle.urdf
  base: fixed
  loops:
    left: {frames: [left_rod_end, left_ball]}
    right: {frames: [right_rod_end, right_ball], kind: point}
  unactuated: [pitch, roll, "*_rod_?"]
start: {posture: standing, joints: {pitch: 0.2}}
support: floating
tasks:
  foot: {type: frame, frame: foot, control: orientation, target: {rpy: [0.1, -0.2, 0.0]}}
stop: {duration: 1.0}
"""
robot = ankle.robot


def angles(robot: Robot, q: np.ndarray, *names: str) -> np.ndarray:
    return np.array([q[robot.joint_index(name) + 1] for name in names])


@pytest.mark.parametrize(("pitch", "roll"), ankle.POSES)
def test_postures_velocities_and_torques_are_the_closed_forms(robot, pitch, roll) -> None:
    wanted = [ankle.crank_angle(pitch, roll, side) for side in ankle.SIDES]
    q = robot.posture("standing", {"pitch": pitch, "roll": roll})
    np.testing.assert_allclose(angles(robot, q, *MOTORS), wanted, atol=1e-11)
    again = robot.posture("standing", dict(zip(MOTORS, wanted, strict=True)))
    np.testing.assert_allclose(angles(robot, again, "pitch", "roll"), [pitch, roll], atol=1e-9)

    here = robot.snapshot(q)
    J = np.concatenate([one.residual(here).jacobian for one in mechanics_of(robot, ())])
    free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :].T  # (nv, 2): what loops leave
    by_ankle = [robot.joint_index(name) for name in ("pitch", "roll")]
    rates = free @ np.linalg.inv(free[by_ankle])
    by_motors = [robot.joint_index(name) for name in MOTORS]
    slopes = ankle.crank_slopes(pitch, roll)
    np.testing.assert_allclose(rates[by_motors], slopes, atol=1e-9)  # differences leave 1e-11

    controller = TorqueController(robot, [PostureTask(robot, q)], force_damping=1e-9)
    tick = controller.step(here)
    motors = [k - 6 for k in by_motors]
    np.testing.assert_allclose(tick.torque[motors], ankle.static_torques(pitch, roll), atol=1e-8)
    assert not np.delete(tick.torque, motors).any()


def swing(robot: Robot, ticks: int, dt: float = 0.005) -> tuple[float, float]:
    """Let the foot nod and sway; return the largest gap, and distance of motors from the form."""
    foot = OrientationTask(robot, "foot", np.eye(3), gain=0.3)
    given = {"limits": Limits(robot), "solver": "active_set"}
    controller = KinematicController(robot, [foot], dt=dt, **given)
    gap, off = 0.0, 0.0
    for k, (_, q) in enumerate(commanded(controller, robot.posture("standing"), ticks)):
        pitch, roll = 0.35 * np.sin(1.1 * k * dt), 0.2 * np.sin(1.7 * k * dt)
        foot.target = ankle.rotation(pitch, roll)
        gap = max(gap, *robot.gaps(q).values())
        now = angles(robot, q, "pitch", "roll")
        form = [ankle.crank_angle(*now, side) for side in ankle.SIDES]
        off = max(off, float(np.abs(angles(robot, q, *MOTORS) - form).max()))
    assert abs(now[0] - pitch) < 0.05
    return gap, off


@pytest.mark.parametrize("ticks", [200, pytest.param(2_500, marks=pytest.mark.slow)])
def test_a_swing_keeps_to_the_closed_form_and_does_not_drift(robot: Robot, ticks: int) -> None:
    gap, off = swing(robot, ticks)
    assert gap < 1e-9 and off < 1e-8  # angles are gaps by the crank of 0.04 m


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
@pytest.mark.parametrize("path", ["bounds", "levels", "braking", "singular", "deadline"])
def test_loops_are_closed_on_every_path_of_a_tick(robot: Robot, path: str, solver: str) -> None:
    """The core's own steps with and without bounds, and steps around QPs that Python changes."""
    start = robot.posture("standing")
    goal = robot.posture("standing", {"pitch": 0.3, "roll": 0.2})
    limits = Limits(robot, braking="bounded" if path == "braking" else "free")
    if path == "bounds":
        limits.speed = np.full(robot.nv - 6, 1.0)
    threshold = 0.05 if path == "singular" else 0.0
    R = robot.snapshot(goal).rotation("foot")
    foot = OrientationTask(robot, "foot", R, singular_threshold=threshold)
    posture = PostureTask(robot, goal, weight=0.1, priority=1 if path == "levels" else 0)
    given = {"solver": solver, "deadline": 10.0 if path == "deadline" else None}
    controller = KinematicController(robot, [foot, posture], limits=limits, **given)
    q, bent = start, 0.0
    loops = [one for one in controller.contacts if one.name.startswith("loop")]
    for tick, there in commanded(controller, start, 120):
        assert not tick.left_out, tick.report()
        J = np.concatenate([one.residual(robot.snapshot(q)).jacobian for one in loops])
        bent = max(bent, float(np.abs(J @ tick.velocity).max()) * controller.dt)
        q = there
        assert max(robot.gaps(q).values()) < 1e-9
    assert bent > 1e-8  # what rows that are met to first order would have left
    np.testing.assert_allclose(angles(robot, q, "pitch", "roll"), [0.3, 0.2], atol=0.02)


@pytest.mark.slow
def test_five_seconds_of_torques_do_not_drift(robot: Robot) -> None:
    """Integrated, and in the plant, where what nobody drives is held by the rods alone."""
    pytest.importorskip("mujoco")
    from wbc.simulation import Plant, simulate

    start = robot.posture("standing")
    foot = OrientationTask(robot, "foot", np.eye(3), kp=100.0)
    plant = Plant(robot)
    plant.reset(start)

    def lead(k: int, _: Snapshot) -> TorqueController:
        foot.target = ankle.rotation(0.3 * np.sin(2.0 * k * controller.dt), 0.0)
        return controller

    for in_plant in (True, False):
        controller = TorqueController(robot, [foot], limits=Limits(robot), damping=1e-6)
        moving = simulate(controller, plant, 5.0, update=lead)
        for now in moving if in_plant else closed_loop(controller, start, 2500, lead):
            assert now.tick.ok
            q = plant.state()[0] if in_plant else now.q
            assert max(robot.gaps(q).values()) < 1e-4


def test_loops_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "ankle.urdf").write_text(ankle.urdf())
    problem = problem_of(tmp_path, PROBLEM)
    robot, result = problem.parts.robot, problem.run()
    rows = result.history.q
    assert list(robot.loops) == ["left", "right"] and len(robot.unactuated) == 6
    assert max(robot.gaps(rows[0]).values()) < 1e-12
    assert max(max(robot.gaps(q).values()) for q in rows) < 1e-9
    np.testing.assert_allclose(angles(robot, result.q, "pitch", "roll"), [-0.2, 0.1], atol=0.01)
    with pytest.raises(WbcError, match=r"frame of loop 'left'.*did you mean 'left_ball'"):
        problem_of(tmp_path, PROBLEM.replace("left_ball", "left_bal"))
