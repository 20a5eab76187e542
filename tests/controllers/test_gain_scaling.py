"""Bounded braking: tasks ask for no more than joints can stop from, and lose nothing by it."""

import numpy as np
import pytest

from wbc.constraints import Contact, Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.braking import ACCELERATION_SHARE
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PositionTask, PostureTask, Task

DT = 0.005
HANDS = {
    "g1_27": "left_rubber_hand",
    "talos": "gripper_left_base_link",
    "hoap2_like": "left_hand_link",
}


def bounded(robot: Robot, acceleration: float | None = 10.0) -> Limits:
    return Limits(robot, acceleration=acceleration, braking="bounded")


def stopping(way: float, acceleration: float) -> float:
    """Return u with u dt + u^2 / (2 a) = way for the part of a that tasks count on."""
    return float(np.roots([0.5 / (ACCELERATION_SHARE * acceleration), DT, -way]).max())


def moved(robot: Robot, rng: np.random.Generator, size: float) -> np.ndarray:
    """Return the standing posture with every joint moved by up to ``size``, inside its range."""
    q = robot.posture("standing")
    joints = robot.limits.joint_positions(q)
    goal = joints + size * rng.uniform(-1.0, 1.0, joints.size)
    step = np.zeros(robot.nv)
    step[6:] = np.clip(goal, robot.limits.lower + 0.05, robot.limits.upper - 0.05) - joints
    return robot.integrate(q, step, 1.0)


@pytest.mark.parametrize("gain", [0.05, 0.5, 1.0])
def test_one_joint_goes_as_a_double_integrator_does(hoap2, gain) -> None:
    """Speeding up at the bound, then the stopping profile, then the gain: in closed form."""
    robot, acceleration = hoap2, 10.0
    joint = robot.joint_index("left_shoulder_pitch")
    step = np.zeros(robot.nv)
    step[joint] = -0.8
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    controller = KinematicController(
        robot, [PostureTask(robot, robot.integrate(q, step, 1.0), gain=gain)],
        limits=bounded(robot, acceleration), dt=DT,
    )  # fmt: skip
    goal = q[joint + 1] - 0.8  # a quaternion in q, an angular velocity in v
    arrived = None
    for k in range(300):
        way, before = q[joint + 1] - goal, -v[joint]
        v = controller.step(robot.snapshot(q, v)).velocity
        q = robot.integrate(q, v, DT)
        asked = min(gain / DT * way, stopping(way, acceleration))
        # The damping of 1e-6 takes that part off; solvers add 1e-8 times a gain of 200/s.
        most = min(before + acceleration * DT, robot.limits.velocity[joint - 6])
        expected = max(min(most, asked), before - acceleration * DT)
        assert -v[joint] == pytest.approx(expected, rel=1e-5, abs=1e-5)
        if arrived is None and way < 0.01 * 0.8:
            arrived = (k + 1) * DT
    assert arrived is not None
    if gain >= 0.5:  # the quickest that any law could be is 2 sqrt(way / a) = 0.57 s
        assert arrived < 1.2 * 2.0 * np.sqrt(0.8 / acceleration)


def scene(robot: Robot, kind: str, gain: float) -> tuple[Task, list[Task], str]:
    """Return a task with a step to go, all tasks, and the support."""
    q = robot.posture("standing")
    here, hand = robot.snapshot(q), HANDS[robot.name]
    com = here.com
    weak = PostureTask(robot, q, weight=0.01, gain=gain, name="weak")
    still = ComTask(robot, com, gain=gain)
    rng = np.random.default_rng(1)
    turn = np.array([[0.0, -1.0, 0.0], [0.8, 0.0, 0.6], [-0.6, 0.0, 0.8]])
    if kind == "posture":
        task: Task = PostureTask(robot, moved(robot, rng, 0.6), gain=gain)
        return task, [task], "floating"
    if kind == "com":
        task = ComTask(robot, com + com[2] * np.array([0.03, 0.03, -0.06]), gain=gain)
        return task, [task, weak], "double"
    if kind == "hand":
        goal = here.position(hand) + com[2] * np.array([0.15, 0.05, 0.2])
        task = PositionTask(robot, hand, goal, gain=gain)
        return task, [task, still, weak], "double"
    if kind == "turn":
        goal = here.rotation(hand) @ np.linalg.matrix_power(turn, 4)
        task = OrientationTask(robot, hand, goal, gain=gain)
        return task, [task, still, weak], "double"
    inertia = robot.snapshot(moved(robot, rng, 0.35)).inertia_in("base")
    task = InertiaTask(robot, inertia, frame="base", gain=gain, per_mass=True, weight=100.0)
    weak.weight = 0.001
    return task, [task, weak], "floating"


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(HANDS))
@pytest.mark.parametrize("kind", ["posture", "com", "hand", "turn", "inertia"])
def test_nothing_overshoots(robot_named, name, kind) -> None:
    robot: Robot = robot_named(name)
    for gain in (0.5, 1.0):
        task, tasks, feet = scene(robot, kind, gain)
        q, v = robot.posture("standing"), np.zeros(robot.nv)
        contacts = support(robot.snapshot(q), feet)
        limits = bounded(robot)
        controller = KinematicController(
            robot, tasks, contacts=contacts, limits=limits, dt=DT, on_failure="raise"
        )
        errors, hardest = [], 0.0
        for _ in range(200):
            now = robot.snapshot(q, v)
            errors.append(task.residual(now).error)
            command = controller.step(now).velocity
            change = np.abs(command - v)[6:] / (limits.acceleration * DT)
            hardest, v = max(hardest, float(change.max())), command
            q = robot.integrate(q, v, DT)
        e = np.array(errors)
        assert (e @ e[0]).min() >= -0.01 * (e[0] @ e[0])
        if kind == "posture":
            assert (e * np.sign(e[0])).min() >= -0.01 * np.abs(e[0]).max()
        # What a weak posture leaves is a tenth at most (the small robot over straight knees).
        assert np.linalg.norm(e[-1]) < 0.12 * np.linalg.norm(e[0]), "it does arrive"
        assert hardest <= 1.0 + 1e-4, "and within the bound"


def far_hand(robot: Robot, gains: tuple[float, float, float] = (0.5, 0.5, 0.5)) -> list[Task]:
    """Return tasks of which the hand's is far out of reach."""
    here = robot.snapshot(robot.posture("standing"))
    hand = HANDS[robot.name]
    away = here.position(hand) + np.array([1.0, 0.3, 0.5])
    return [
        PositionTask(robot, hand, away, gain=gains[0], lm_damping=0.1),
        ComTask(robot, here.com, weight=3.0, gain=gains[1]),
        PostureTask(robot, here.q, weight=0.5, gain=gains[2]),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("gains", [(0.5, 0.5, 0.5), (0.4, 0.8, 0.05)])
def test_what_is_out_of_reach_is_missed_as_before(hoap2, gains) -> None:
    ends = []
    for limits in (Limits(hoap2, acceleration=10.0), bounded(hoap2)):
        tasks = far_hand(hoap2, gains)
        q, v = hoap2.posture("standing"), np.zeros(hoap2.nv)
        contacts = support(hoap2.snapshot(q), "double")
        controller = KinematicController(hoap2, tasks, contacts=contacts, limits=limits, dt=DT)
        for _ in range(1500):
            v = controller.step(hoap2.snapshot(q, v)).velocity
            q = hoap2.integrate(q, v, DT)
        assert np.abs(v).max() < 1e-4, "it rests"
        now = hoap2.snapshot(q)
        ends.append([float(np.linalg.norm(task.residual(now).error)) for task in tasks])
    assert ends[0][0] > 0.5
    # Both rest to within 1e-4 rad/s, at gains of 10/s: 1e-5 of lengths of a tenth.
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-3, atol=1e-5)


def slopes(qp_controller: KinematicController, here: Snapshot) -> np.ndarray:
    return qp_controller.step(here).qp.g


def least_factor(tasks: list[Task], here: Snapshot, limits: Limits) -> float:
    """Return the factor by the whole KKT system and by roots of quadratic equations."""
    robot = here.robot
    nv = robot.nv
    P, pull, way = 1e-6 * np.eye(nv), np.zeros(nv), np.zeros(nv)
    for task in tasks:
        error, J, *_, bound = task.residual(here)
        bound = bound() if callable(bound) else bound
        W = np.diag(task.weight**2)
        P += J.T @ W @ J
        P += np.eye(nv) * (
            0.5 * task.gain * bound + task.lm_damping * np.linalg.norm(task.weight * error)
        )
        way -= J.T @ W @ error
        pull -= task.gain / DT * (J.T @ W @ error)
    feet = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    K = np.block([[P, feet.T], [feet, np.zeros((12, 12))]])
    right = np.zeros((nv + 12, 2))
    right[:nv] = np.stack((pull, way), axis=1)
    v, d = np.linalg.lstsq(K, right, rcond=None)[0][6:nv].T
    q = robot.limits.joint_positions(here.q)
    fastest = max(task.gain for task in tasks) / DT
    factors = [1.0]
    for j in np.flatnonzero(np.abs(v) > 1e-9):
        to_go = max(abs(d[j]), abs(v[j]) / fastest)
        rate = abs(v[j]) / to_go
        room = limits.upper[j] - q[j] if v[j] > 0.0 else q[j] - limits.lower[j]
        to_go = min(to_go, room)
        if to_go > 1e-9:
            factors.append(stopping(to_go, limits.acceleration[j]) / (rate * to_go))
    return min(factors)


@pytest.mark.parametrize("name", sorted(HANDS))
def test_one_factor_for_a_level_from_the_worst_joint(robot_named, name) -> None:
    robot: Robot = robot_named(name)
    here = robot.snapshot(robot.posture("standing"))
    contacts = support(here, "double")
    for gains in ((0.5, 0.5, 0.5), (0.3, 1.0, 0.05)):
        tasks, limits = far_hand(robot, gains), bounded(robot)
        free, slow = (
            KinematicController(robot, tasks, contacts=contacts, limits=each, dt=DT).step(here).qp
            for each in (Limits(robot, acceleration=10.0), limits)
        )
        expected = least_factor(tasks, here, limits)
        assert expected < 0.5
        # Feet are held by a weight of 1e4 where the way is estimated.
        np.testing.assert_allclose(slow.g, expected * free.g, rtol=2e-3, atol=1e-12)
        np.testing.assert_allclose(slow.P, free.P, rtol=0.0, atol=1e-12)  # of two paths


def test_near_the_target_and_with_free_braking_nothing_is_changed(g1_27, rng) -> None:
    here = g1_27.snapshot(g1_27.posture("standing"))
    for size, same in ((1e-4, True), (0.3, False)):
        task = PostureTask(g1_27, moved(g1_27, rng, size))
        error = task.residual(here).error
        limits = Limits(g1_27, acceleration=10.0)
        free = slopes(KinematicController(g1_27, [task], limits=limits, dt=DT), here)
        np.testing.assert_array_equal(free[6:], 0.5 / DT * error)
        slow = slopes(KinematicController(g1_27, [task], limits=bounded(g1_27), dt=DT), here)
        assert np.array_equal(slow, free) == same


def test_what_a_moving_target_asks_for_beforehand_stays(hoap2) -> None:
    """A hand follows its target at its rate while the other arm has far to go."""
    q = hoap2.posture("standing")
    joint = hoap2.joint_index("right_shoulder_pitch")
    step, v = np.zeros(hoap2.nv), np.zeros(hoap2.nv)
    step[joint], v[joint] = -1.0, -stopping(1.0, 10.0)
    hand = PositionTask(hoap2, "left_hand_link", np.zeros(3))
    rate = np.array([4e-3, -2e-3, 3e-3])
    others = {"*": 0.0, "right_shoulder_pitch": 1.0}
    posture = PostureTask(hoap2, hoap2.integrate(q, step, 1.0), joints=others)
    here = hoap2.snapshot(q, v)
    hand.set_target(here.position("left_hand_link"), rate)
    contacts = support(here, "double")
    tick = KinematicController(
        hoap2, [hand, posture], contacts=contacts, limits=bounded(hoap2), dt=DT
    ).step(here)
    # The shoulder at its stopping speed, a fifteenth of the 100 rad/s that the gain asks for.
    assert tick.velocity[joint] == pytest.approx(v[joint], rel=1e-4)
    # Damping 1e-6 takes about that part off.
    achieved = here.jacobian("left_hand_link")[:3] @ tick.velocity
    np.testing.assert_allclose(achieved, rate, rtol=1e-3)


def test_what_takes_precedence_over_tasks_is_not_held_back(hoap2) -> None:
    """A joint out of its range comes back as fast as ever; a soft contact may have no gain."""
    q = hoap2.posture("standing")
    joint = hoap2.joint_index("left_knee_pitch")
    step = np.zeros(hoap2.nv)
    lower = hoap2.limits.lower[joint - 6]
    step[joint] = lower - hoap2.limits.joint_positions(q)[joint - 6] - 0.05
    step[hoap2.joint_index("left_shoulder_pitch")] = 0.8  # far from its target
    here = hoap2.snapshot(hoap2.integrate(q, step, 1.0))
    feet = [
        Contact(hoap2, f"{side}_sole", here.position(f"{side}_sole"), here.rotation(f"{side}_sole"),
                gain=0.0)
        for side in ("left", "right")
    ]  # fmt: skip
    task = PostureTask(hoap2, q)
    free, slow = (
        KinematicController(
            hoap2, [task], contacts=feet, limits=limits, slack={"left_sole": 100.0}, dt=DT
        ).step(here).qp
        for limits in (Limits(hoap2, acceleration=10.0), bounded(hoap2))
    )  # fmt: skip
    pull = np.zeros(hoap2.nv)
    pull[6:] = -0.5 / DT * task.residual(here).error
    assert free.g[joint] < -2.0 * pull[joint], "recovery outweighs the posture"
    taken = (slow.g - free.g)[joint] / pull[joint]
    assert 0.1 < taken < 1.0
    np.testing.assert_allclose(slow.g - free.g, taken * pull, atol=1e-9)


def test_each_level_has_a_factor_of_its_own(hoap2, rng) -> None:
    """A posture far away on the second level does not slow a CoM on the first one down."""
    here = hoap2.snapshot(moved(hoap2, rng, 0.2))
    com = ComTask(hoap2, here.com + np.array([0.0, 0.0, 1e-5]), weight=100.0)
    far = PostureTask(hoap2, moved(hoap2, rng, 0.6), priority=1)
    contacts = support(here, "double")
    rates = []
    for tasks in ([com], [com, far]):
        tick = KinematicController(
            hoap2, tasks, contacts=contacts, limits=bounded(hoap2), dt=DT
        ).step(here)
        assert tick.ok
        rates.append(here.com_jacobian @ tick.velocity)
    # Nearly the whole gain, 0.5 * 1e-5 m in a tick, against a tenth for the posture.
    assert rates[0][2] > 0.95 * 1e-3
    np.testing.assert_allclose(rates[1], rates[0], atol=1e-6)
