"""A snapshot without a velocity is at rest: acceleration limits hold; loops of such are told."""

import logging
import pickle

import numpy as np
import pytest

from tests.conftest import ROBOTS, random_state
from wbc.constraints import Limits, support
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import ControllerFailure
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.tasks import ComTask, InertiaTask, PositionTask, PostureTask

DT = 0.005
CLOSE = 1e-6  # of solvers, by the bound


def shaping(robot: Robot, **options) -> KinematicController:
    """Asks for more in the first tick than accelerations allow."""
    start = robot.snapshot(robot.posture("standing"))
    inertia = 1.5 * start.inertia
    tasks = [
        InertiaTask(robot, inertia, components=["zz"], per_mass=True, weight=10.0),
        ComTask(robot, start.com, weight=10.0),
        PostureTask(robot, start.q, weight=0.01),
    ]
    given = {"limits": Limits(robot), "contacts": support(start, "double"), "dt": DT, **options}
    return KinematicController(robot, tasks, **given)


@pytest.mark.parametrize("braking", ["free", "bounded"])
def test_first_tick_without_velocity_keeps_the_acceleration_limit(hoap2, braking: str) -> None:
    limits = Limits(hoap2, braking=braking)
    controller = shaping(hoap2, limits=limits)
    q = hoap2.posture("standing")
    tick = controller.step(hoap2.snapshot(q))
    assert tick.ok
    part = np.abs(tick.velocity[6:]) / (DT * limits.acceleration)
    assert part.max() <= 1.0 + CLOSE
    # With gains lowered for braking's sake they may not reach it.
    assert braking == "bounded" or part.max() >= 1.0 - CLOSE
    same = shaping(hoap2, limits=Limits(hoap2, braking=braking))
    still = same.step(hoap2.snapshot(q, np.zeros(hoap2.nv)))
    np.testing.assert_array_equal(tick.velocity, still.velocity)


@pytest.mark.parametrize("name", ROBOTS)
def test_snapshot_without_velocity_has_the_box_of_rest(name: str, robot_named, rng) -> None:
    robot = robot_named(name)
    q = random_state(robot, rng)[0]
    for options in ({}, {"braking": "bounded"}, {"acceleration": 3.0}, {"velocity": None}):
        limits = Limits(robot, **options)
        box = limits.box(robot.snapshot(q), DT)
        np.testing.assert_array_equal(box, limits.box(robot.snapshot(q, np.zeros(robot.nv)), DT))
        most = DT * limits.acceleration * (1 + 1e-12)
        assert (np.abs(box)[:, 6:] <= most).all()


def test_torque_tick_without_velocity_is_that_of_rest(hoap2: Robot) -> None:
    q = hoap2.posture("standing")
    torques = []
    for v in (None, np.zeros(hoap2.nv)):
        start = hoap2.snapshot(q)
        tasks = [ComTask(hoap2, start.com + [0, 0, 0.1], weight=10.0), PostureTask(hoap2, q)]
        controller = TorqueController(
            hoap2, tasks, contacts=support(start, "double"), limits=Limits(hoap2), dt=0.002
        )
        torques.append(controller.step(hoap2.snapshot(q, v)).torque)
    np.testing.assert_array_equal(*torques)


def test_problem_keeps_the_acceleration_limit_from_its_first_tick(tmp_path) -> None:
    """The velocities that a run records, against the limits of its file."""
    path = tmp_path / "fast.yaml"
    path.write_text(
        "robot: hoap2_like\nstart: {posture: standing}\nsupport: double\n"
        "tasks:\n  com: {type: com, target: {offset: [0, 0, -0.05]}, weight: 10.0}\n"
        "  posture: {type: posture, target: start, weight: 0.01}\n"
        "limits: {acceleration: 3.0}\nstop: {duration: 0.2}\n"
    )
    history = load_problem(path).run().history
    v = np.asarray(history.v)[:, 6:]
    speeds = np.abs(np.vstack((np.zeros(v.shape[1]), v)))
    gained = np.diff(speeds, axis=0)
    assert gained.max() <= 3.0 * 0.005 * (1 + CLOSE)
    assert gained.max() >= 3.0 * 0.005 * (1 - CLOSE)


# ---------------------------------------------------------------------------- loops without v


def warned(caplog) -> list[str]:
    return [one.getMessage() for one in caplog.records if "v is 0 in" in one.getMessage()]


def run(controller, robot: Robot, ticks: int, passed: bool) -> np.ndarray:
    q, v = robot.posture("standing"), None
    for _ in range(ticks):
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity if passed else None
        q = robot.integrate(q, tick.velocity, controller.dt)
    return q


def test_loop_that_never_passes_the_velocity_is_told_once(hoap2: Robot, caplog) -> None:
    controller = shaping(hoap2)
    with caplog.at_level(logging.WARNING):
        run(controller, hoap2, 2, passed=False)
        assert not warned(caplog)  # two ticks at rest may be two first ones
        run(controller, hoap2, 3, passed=False)
        assert len(warned(caplog)) == 1
        run(controller, hoap2, 20, passed=False)
    (said,) = warned(caplog)
    assert "acceleration limits" in said and "robot.snapshot(q, tick.velocity)" in said


def test_loop_that_passes_the_velocity_is_told_nothing(hoap2: Robot, caplog) -> None:
    with caplog.at_level(logging.WARNING):
        run(shaping(hoap2), hoap2, 20, passed=True)
    assert not warned(caplog)


def test_first_ticks_at_many_postures_are_told_nothing(hoap2: Robot, caplog, rng) -> None:
    controller = shaping(hoap2, contacts=())
    with caplog.at_level(logging.WARNING):
        for _ in range(20):
            controller.step(hoap2.snapshot(random_state(hoap2, rng)[0]))
            here = hoap2.snapshot(hoap2.posture("standing"))
            controller.step(here)
            controller.step(here)
    assert not warned(caplog)


def test_loop_that_no_limit_holds_is_told_nothing(hoap2: Robot, caplog) -> None:
    """At the velocity level nothing else reads the velocity."""
    with caplog.at_level(logging.WARNING):
        for limits in (None, Limits(hoap2, acceleration=1e4)):
            run(shaping(hoap2, limits=limits), hoap2, 10, passed=False)
    assert not warned(caplog)


def test_torque_loop_without_velocity_is_told_that_nothing_is_damped(hoap2: Robot, caplog) -> None:
    q, v = hoap2.posture("standing"), np.zeros(hoap2.nv)
    start = hoap2.snapshot(q)
    tasks = [ComTask(hoap2, start.com + [0, 0, -0.05], weight=10.0), PostureTask(hoap2, q)]
    controller = TorqueController(
        hoap2, tasks, contacts=support(start, "double"), limits=Limits(hoap2), dt=0.002
    )
    with caplog.at_level(logging.WARNING):
        for _ in range(6):
            tick = controller.step(hoap2.snapshot(q))
            v = v + 0.002 * tick.acceleration  # a plant that moves on
            q = hoap2.integrate(q, v, 0.002)
    (said,) = warned(caplog)
    assert "nothing is damped" in said


# ---------------------------------------------------------------------------- braking is told


def reaching(robot: Robot, braking: str) -> KinematicController:
    """A hand is called back in the middle of its way, so that joints turn round."""
    start = robot.snapshot(robot.posture("standing"))
    place = start.position("left_palm")
    hand = PositionTask(robot, "left_palm", place, name="hand", weight=3.0)
    return KinematicController(
        robot,
        [ComTask(robot, start.com), hand, PostureTask(robot, start.q, weight=0.01)],
        contacts=support(start, "double"),
        limits=Limits(robot, braking=braking, acceleration=50.0),
        dt=DT,
    )


@pytest.mark.parametrize("braking", ["free", "bounded"])
def test_tick_names_joints_that_brake_beyond_their_acceleration(hoap2: Robot, braking: str) -> None:
    """Oracle: differences of the commands; no joint speeds up beyond its limit."""
    controller = reaching(hoap2, braking)
    hand = controller.tasks[1]
    away = hand.target + [0.05, 0.03, 0.05]
    home = hand.target.copy()
    q, v, named = hoap2.posture("standing"), np.zeros(hoap2.nv), 0
    for k in range(120):
        if k % 8 == 0:
            hand.set_target(away if k % 16 == 0 else home)
        tick = controller.step(hoap2.snapshot(q, v))
        part = np.abs(tick.velocity - v)[6:] / (50.0 * DT)
        beyond = {hoap2.joint_names[j]: part[j] for j in np.flatnonzero(part > 1.001)}
        assert tick.braked == pytest.approx(beyond)
        for name, by in beyond.items():
            j = hoap2.joint_index(name)
            slower = abs(tick.velocity[j]) <= abs(v[j]) or tick.velocity[j] * v[j] < 0.0
            assert slower and f"{name} by {by:.3g} times" in tick.report()
            assert abs(tick.velocity[j]) <= max(abs(v[j]), 50.0 * DT) * (1 + CLOSE)
        named += len(beyond)
        v = tick.velocity
        q = hoap2.integrate(q, v, DT)
    assert named == 0 if braking == "bounded" else named > 5


def test_braking_outlives_a_pickle_and_later_limits(hoap2: Robot) -> None:
    controller = reaching(hoap2, "free")
    controller.tasks[1].set_target(controller.tasks[1].target + [0.05, 0.0, 0.05])
    v = np.zeros(hoap2.nv)
    v[hoap2.joint_index("left_elbow_pitch")] = 3.0
    tick = controller.step(hoap2.snapshot(hoap2.posture("standing"), v))
    controller.limits.acceleration = 1e6
    assert "left_elbow_pitch" in pickle.loads(pickle.dumps(tick)).braked
    assert "left_elbow_pitch" in tick.braked


def test_failure_policy_that_stops_at_once_says_how_hard(hoap2: Robot) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    contacts = support(start, "double")
    held = PositionTask(hoap2, "left_sole", start.position("left_sole") + 1.0, name="elsewhere")
    held.set_target(held.target, [5.0, 0.0, 0.0])
    options = {"limits": Limits(hoap2), "contacts": [*contacts, held], "dt": DT}
    v = np.zeros(hoap2.nv)
    v[10] = 3.0
    for policy in ("hold", "raise"):
        controller = KinematicController(
            hoap2, [PostureTask(hoap2, start.q)], on_failure=policy, **options
        )
        if policy == "hold":
            tick = controller.step(hoap2.snapshot(start.q, v))
            assert not tick.ok and not tick.velocity.any()
            expected = 3.0 / (DT * controller.limits.acceleration[4])
            assert tick.braked == pytest.approx({hoap2.joint_names[4]: expected})
        else:
            with pytest.raises(ControllerFailure):
                controller.step(hoap2.snapshot(start.q, v))
