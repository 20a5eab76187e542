"""The velocity level: limits hold, joints outside come back; eq. 38 against least squares."""

from collections.abc import Callable
from time import perf_counter

import numpy as np
import pytest

from tests.standing import commanded
from wbc.constraints import Limits, PointContact, PositionBox, SelfCollision, support
from wbc.controllers import KinematicController
from wbc.controllers.tick import Times
from wbc.qp import QP, make_backend
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PositionTask, PostureTask, Task

DT = 0.005
HUMANOIDS = ("hoap2_like", "g1_27", "talos")
Load = Callable[[str], Robot]


def stance(robot: Robot, rng: np.random.Generator, spread: float = 0.1) -> Snapshot:
    q = robot.posture("standing")
    step = np.concatenate((np.zeros(6), spread * rng.normal(size=robot.nv - 6)))
    return robot.snapshot(bring_inside(robot, robot.integrate(q, step, 1.0)))


def bring_inside(robot: Robot, q: np.ndarray) -> np.ndarray:
    p = robot.limits.joint_positions(q)
    within = np.clip(p, robot.limits.lower, robot.limits.upper)
    return robot.integrate(q, np.concatenate((np.zeros(6), within - p)), 1.0)


def test_joints_come_back_though_all_tasks_are_off(g1_27: Robot) -> None:
    """Against the damping alone: 10000 to 1, so by almost the rate that is asked for."""
    q = g1_27.posture("standing")
    knee = g1_27.joint_index("left_knee_joint")
    q[knee + 1] = g1_27.limits.upper[knee - 6] + 0.01
    task, limits = PostureTask(g1_27, q), Limits(g1_27)
    controller = KinematicController(g1_27, [task], contacts=(), limits=limits, dt=DT)
    task.switch_off()
    back = controller.step(g1_27.snapshot(q)).velocity
    wanted = -limits.recovery / DT * 0.01
    assert back[knee] == pytest.approx(1e4 / 10001.0 * wanted, rel=1e-6)
    assert np.abs(np.delete(back, knee)).max() < 1e-6


def test_a_list_of_frames_and_points_can_be_held(hoap2: Robot, rng) -> None:
    here = stance(hoap2, rng)
    contacts = [*support(here, ["left_sole"]), PointContact.hold(here, "right_palm")]
    controller = KinematicController(
        hoap2, [ComTask(hoap2, here.com - [0.01, 0, 0.01])], contacts=contacts, dt=DT
    )
    *_, (_, q) = commanded(controller, here.q, 100)
    end = hoap2.snapshot(q)
    assert np.linalg.norm(end.com - controller.tasks[0].target) < 1e-6
    assert max(contact.slip(end) for contact in contacts) < 1e-5
    turned = here.rotation("right_palm").T @ end.rotation("right_palm")
    assert np.abs(turned - np.eye(3)).max() > 1e-4, "a point contact leaves the hand free to turn"


@pytest.mark.parametrize("mode", ["floating", "left", "double"])
@pytest.mark.parametrize("name", HUMANOIDS)
def test_limits_hold_under_greedy_targets(name, mode, robot_named: Load, rng) -> None:
    """Targets far out of reach, new ones now and then; the long version is in benchmarks/."""
    robot = robot_named(name)
    here = stance(robot, rng)
    limits = Limits(robot)
    tasks = [
        InertiaTask(robot, 2 * here.inertia, per_mass=True, weight=3, lm_damping=0.01),
        ComTask(robot, here.com),
        PostureTask(robot, here.q, weight=0.01),
    ]
    controller = KinematicController(
        robot, tasks, contacts=support(here, mode), limits=limits, dt=DT
    )
    q, v = here.q, np.zeros(robot.nv)
    for k in range(200):
        if k % 50 == 0:
            tasks[0].set_target(here.inertia * np.exp(rng.normal()))
            tasks[1].set_target(here.com + 0.2 * rng.normal(size=3))
        snapshot = robot.snapshot(q, v)
        tick = controller.step(snapshot)
        assert tick.ok, tick.report()
        v = tick.velocity
        q = robot.integrate(q, v, DT)
        assert limits.worst_margin(q)[0] > -1e-6
        assert (np.abs(v[6:]) <= robot.limits.velocity * (1 + 1e-6)).all()


@pytest.mark.parametrize(("mode", "spread"), [("floating", 0.8), ("left", 0.8), ("double", 0.3)])
def test_from_outside_its_limits_a_robot_comes_back(mode, spread, hoap2: Robot, rng) -> None:
    """Any start: the QP is never infeasible, and every joint returns.

    Two held feet may leave no way back for a leg; nothing may get worse.
    """
    limits = Limits(hoap2)
    for _ in range(5):
        step = np.concatenate((np.zeros(6), spread * rng.normal(size=hoap2.nv - 6)))
        q = hoap2.integrate(hoap2.posture("standing"), step, 1.0)
        here = hoap2.snapshot(q)
        start = limits.worst_margin(q)[0]
        assert start < -0.01
        tasks: list[Task] = [PostureTask(hoap2, hoap2.posture("standing"), weight=0.1)]
        if mode == "double":
            tasks.append(ComTask(hoap2, here.com))
        controller = KinematicController(
            hoap2, tasks, contacts=support(here, mode), limits=limits, dt=DT
        )
        *_, (_, q) = commanded(controller, q, 400)
        assert limits.worst_margin(q)[0] > (start if mode == "double" else 0.0) - 1e-6


def test_diagnostics(hoap2: Robot, rng) -> None:
    here = stance(hoap2, rng)
    com = ComTask(hoap2, here.com + [0.01, 0, 0])
    control = KinematicController(hoap2, [com], limits=Limits(hoap2))
    began = perf_counter()
    tick = control.step(here)
    elapsed = perf_counter() - began
    np.testing.assert_allclose(tick.errors["com"], [-0.01, 0, 0], atol=1e-12)
    stages = (tick.times.tasks, tick.times.assembly, tick.times.solve)
    assert min(stages) >= 0.0  # the core assembles while it solves
    assert min(tick.times.tasks, tick.times.solve) > 0.0
    assert tick.times.total <= elapsed and Times(1.0, 2.0, 4.0).total == 7.0
    assert tick.report() == "solved"
    assert tick.qp.labels.variables[6:] == hoap2.joint_names
    with pytest.raises(ValueError, match="read-only"):
        tick.velocity[0] = 1.0


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
def test_a_com_out_of_reach_does_not_make_it_chatter(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    q = robot.posture("standing")
    here = robot.snapshot(q)
    tasks = [
        ComTask(robot, here.com + [0, 0, 0.3], weight=10, gain=0.1),
        PostureTask(robot, q, weight=0.01),
    ]
    controller = KinematicController(
        robot, tasks, contacts=support(here, "double"), limits=Limits(robot), dt=DT
    )
    *_, (tick, _) = commanded(controller, q, 1000)
    assert np.abs(tick.velocity).max() < 0.1  # 1.6 rad/s for ever without damping by the lever


def test_target_at_rest_again_after_it_moved_is_followed_at_rest(hoap2: Robot) -> None:
    """Though all of the task was written in between, and rest is the same array as before."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    com, posture = ComTask(hoap2, here.com, weight=5.0), PostureTask(hoap2, here.q, weight=0.1)
    held = support(here, "double")
    controller = KinematicController(hoap2, [com, posture], contacts=held, dt=DT)
    goal = here.com + (0.0, 0.01, 0.0)
    controller.step(here)
    com.set_target(goal)
    first = controller.step(here).velocity
    com.set_target(goal, (0.05, 0.0, 0.0))
    com.weight = 4.0
    assert np.abs(controller.step(here).velocity - first).max() > 1e-3
    com.set_target(goal)
    fresh = KinematicController(hoap2, [com, posture], contacts=held, dt=DT)
    np.testing.assert_array_equal(controller.step(here).velocity, fresh.step(here).velocity)


def test_it_is_the_pseudo_inverse(hoap2, rng) -> None:
    """Floating, nothing active: J'(JJ' + damping)^-1 (-k e), the minimum-norm form of eq. 38."""
    here = hoap2.snapshot(hoap2.posture("standing", {"*elbow*": -0.5}))
    task = InertiaTask(hoap2, here.inertia * 1.001, gain=0.1)
    tick = KinematicController(
        hoap2, [task], dt=0.005, damping=1e-12, solver="pseudo_inverse"
    ).step(here)
    residual = task.residual(here)
    J, wanted = residual.jacobian, -0.1 / 0.005 * residual.error
    # the controller's, and gain/2 of the task's
    damping = np.diag(1e-12 + 0.05 * residual.curvature_bound())
    expected = np.linalg.solve(J.T @ J + damping, J.T @ wanted)
    np.testing.assert_allclose(tick.velocity, expected, atol=1e-6 * np.abs(expected).max())


def test_the_plain_step_of_the_paper(hoap2) -> None:
    """Eq. 38 as printed, J^+ (I_d - I) in one step, by NumPy; twice the inertia."""
    here = hoap2.snapshot(hoap2.posture("standing", {"*elbow*": -0.5}))
    task = InertiaTask(hoap2, 2.0 * here.inertia, gain=1.0, curvature_damping=False)
    controller = KinematicController(hoap2, [task], dt=1.0, damping=1e-13, solver="pseudo_inverse")
    residual = task.residual(here)
    expected = np.linalg.pinv(residual.jacobian) @ -residual.error
    found = controller.step(here).velocity
    # The damping of 1e-13 beside least singular values squared of 1e-8.
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("rows", [1, 3])
def test_rows_that_repeat_others_to_rounding_count_once(rows: int, rng) -> None:
    """Oracle: the least cost in the null space of the rows without the last, by SVD."""
    A, g = rng.normal(size=(rows, 6)), rng.normal(size=6)
    b = A @ rng.normal(size=6)
    near = np.vstack((A, A[0] + 1e-11 * rng.normal(size=6)))
    qp = QP.build(np.eye(6), g, A=near, b=np.append(b, b[0]))
    null = np.linalg.svd(A)[2][rows:].T
    point = np.linalg.pinv(A) @ b
    expected = point - null @ null.T @ (g + point)
    found = make_backend("pseudo_inverse").solve(qp)
    np.testing.assert_allclose(found.x, expected, atol=1e-8)


def test_clipping_is_not_the_optimum_and_says_so(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [ComTask(hoap2, here.com + [0.1, 0, 0.1])]
    same = {"contacts": support(here, "double"), "limits": Limits(hoap2), "damping": 1e-4}
    baseline = KinematicController(hoap2, tasks, solver="pseudo_inverse", **same).step(here)
    by_qp = KinematicController(hoap2, tasks, **same).step(here)
    residuals = baseline.solution.residuals
    assert max(residuals.primal, residuals.dual, residuals.complementarity) > 1e-3
    assert max(by_qp.solution.residuals.dual, by_qp.solution.residuals.primal) < 1e-6


OUTWEIGHS = 1e4  # the heaviest of the tasks, squared


def beyond(robot: Robot, by: dict[str, float], v: np.ndarray | None = None) -> Snapshot:
    """Return the standing posture with joints beyond their upper (> 0) or lower (< 0) limits."""
    q = robot.posture("standing")
    joints = robot.limits.joint_positions(q).copy()
    step = np.zeros(robot.nv)
    for name, excess in by.items():
        k = robot.joint_index(name) - 6
        end = robot.limits.upper[k] if excess > 0.0 else robot.limits.lower[k]
        step[6 + k] = end + excess - joints[k]
    return robot.snapshot(robot.integrate(q, step, 1.0), np.zeros(robot.nv) if v is None else v)


@pytest.mark.parametrize("braking", ["free", "bounded"])
@pytest.mark.parametrize("levels", [1, 2])
def test_joints_outside_are_moved_back_as_limits_say(hoap2, rng, braking: str, levels: int) -> None:
    """Two of them, one so far that its speed bounds how fast: box, cost and command."""
    limits = Limits(hoap2, recovery=0.3, braking=braking)
    v = 0.05 * rng.normal(size=hoap2.nv)
    outside = {"left_knee_pitch": 1e-3, "right_elbow_pitch": -0.3}
    here = beyond(hoap2, outside, v)
    box, joints = limits.box(here, DT), [hoap2.joint_index(name) for name in outside]
    speed = limits.speed[joints[1] - 6]
    assert speed < 0.3 * 0.3 / DT
    target, M = np.array((-0.3 * 1e-3 / DT, speed)), np.eye(hoap2.nv)[joints]
    # At its target, so that no gain is lowered for it where braking is bounded.
    tasks = [PostureTask(hoap2, here.q, weight=3.0), ComTask(hoap2, here.com, priority=levels - 1)]
    qps, ticks = [], []
    for bounds in (limits, None):
        controller = KinematicController(hoap2, tasks, contacts=(), limits=bounds, dt=DT)
        qps.append(controller.core.tick(here, solve=False).qp_of(0))
        ticks.append(controller.step(here))
    assert ticks[0].ok, ticks[0].report()
    np.testing.assert_allclose(qps[0].lower, box[0], atol=1e-12)
    np.testing.assert_allclose(qps[0].upper, box[1], atol=1e-12)
    heaviest = 9.0  # a row of the posture: those of the CoM are shorter
    assert np.square(here.com_jacobian).sum(axis=1).max() < heaviest
    weight = OUTWEIGHS * heaviest
    np.testing.assert_allclose(qps[0].P - qps[1].P, weight * M.T @ M, atol=1e-9)
    np.testing.assert_allclose(qps[0].g - qps[1].g, -weight * target @ M, atol=1e-9)
    wanted = np.clip(target, box[0][joints], box[1][joints])
    # The posture, which weighs a ten-thousandth (squared), holds a joint back by that part.
    np.testing.assert_allclose(ticks[0].velocity[joints], wanted, rtol=1e-3)


def test_joints_that_rounding_leaves_outside_are_at_their_limits(hoap2) -> None:
    """A nanometre; a cost that outweighs all tasks appears beyond that."""
    limits = Limits(hoap2)
    P = []
    for excess in (-0.5e-9, 0.5e-9, 2e-9):
        here = beyond(hoap2, {"left_knee_pitch": excess})
        task = PostureTask(hoap2, here.q)
        P.append(KinematicController(hoap2, [task], contacts=(), limits=limits).step(here).qp.P)
    np.testing.assert_array_equal(P[0], P[1])
    joint = hoap2.joint_index("left_knee_pitch")
    assert P[2][joint, joint] - P[1][joint, joint] == pytest.approx(OUTWEIGHS)


@pytest.mark.parametrize("what", ["joint", "box", "bodies"])
def test_a_lower_level_does_not_undo_recovery(hoap2, what: str) -> None:
    """It went on pulling outwards, and all stayed where it was: 20 mm inside, 50 mrad outside."""
    stands, joint = hoap2.snapshot(hoap2.posture("standing")), "left_shoulder_roll"
    here = beyond(hoap2, {"left_knee_pitch": 0.05}) if what == "joint" else stands
    inwards = np.zeros(hoap2.nv)
    inwards[hoap2.joint_index("left_knee_pitch" if what == "joint" else joint)] = 0.3
    box, bodies = PositionBox.height(hoap2, -1.0, stands.q[2] - 0.02), SelfCollision(hoap2)
    pull = PostureTask(hoap2, hoap2.integrate(here.q, inwards, 1.0), priority=1)
    if what == "box":
        pull = PositionTask(hoap2, "base", stands.q[:3] + (0.0, 0.0, 0.1), priority=1)
    if what == "bodies":
        here = hoap2.snapshot(hoap2.integrate(here.q, -inwards, 1.0))
        pull = PostureTask(hoap2, hoap2.integrate(here.q, -inwards, 1.0), priority=1)

    def outside(now: Snapshot) -> float:
        if what == "joint":
            knee = hoap2.joint_index("left_knee_pitch") - 6
            return hoap2.limits.joint_positions(now.q)[knee] - hoap2.limits.upper[knee]
        if what == "box":
            return now.q[2] - box.upper[2]
        found = bodies.model.nearest(now, 25)
        return (bodies.margins[found.pairs] - found.distance).max()

    first = OrientationTask(hoap2, "torso", here.rotation("torso"))
    constraints = {"box": [box], "bodies": [bodies]}.get(what, [])
    controller = KinematicController(
        hoap2, [first, pull], contacts=(), limits=Limits(hoap2), constraints=constraints, dt=DT
    )
    assert outside(here) > 0.015
    for _ in range(200):
        tick = controller.step(here)
        assert tick.ok, tick.report()
        here = hoap2.snapshot(hoap2.integrate(here.q, tick.velocity, DT), tick.velocity)
    assert outside(here) < 5e-4
