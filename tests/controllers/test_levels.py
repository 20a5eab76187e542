"""Strict priorities against the null-space recursion, and what a level may not do."""

from types import SimpleNamespace

import numpy as np
import pytest
import qpsolvers
from scipy.sparse import csc_matrix

from tests.conftest import random_state
from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.core_memory import INFEASIBLE, CoreMemory
from wbc.controllers.outcome import Outcome
from wbc.controllers.tick import Tick
from wbc.qp import QP, Status
from wbc.qp.active_set import ActiveSet
from wbc.robot.tree import LARGEST
from wbc.rotations import exp_rotation
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PositionTask, PostureTask

DT = 0.005


def test_free_levels_are_the_null_space_recursion(g1_27, rng) -> None:
    """Oracle: Siciliano and Slotine's recursion with NumPy's pinv, nothing else active."""
    here = g1_27.snapshot(g1_27.posture("standing"))
    tasks = [
        ComTask(g1_27, here.com),
        PositionTask(g1_27, "left_sole", here.position("left_sole"), priority=1),
        PositionTask(g1_27, "right_sole", here.position("right_sole"), priority=2),
    ]
    for task in tasks:  # at their targets, which move: no error, so no damping of the tasks' own
        task.set_target(task.target, rate=rng.normal(size=3))
    tick = KinematicController(g1_27, tasks, dt=DT, damping=1e-8, solver="active_set").step(here)
    assert tick.ok, tick.report()
    v, N = np.zeros(g1_27.nv), np.eye(g1_27.nv)
    for task in tasks:
        r = task.residual(here)
        J = r.jacobian @ N
        v = v + N @ np.linalg.pinv(J, rcond=1e-9) @ (-r.bias - r.jacobian @ v)
        N = N @ (np.eye(g1_27.nv) - np.linalg.pinv(J, rcond=1e-9) @ J)
    # The damping of 1e-8 bends each level by about 1e-8 / (smallest singular value)^2.
    np.testing.assert_allclose(tick.velocity, v, atol=1e-5 * np.abs(v).max())


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27", "talos"])
@pytest.mark.parametrize("mode", ["floating", "left", "double"])
def test_a_level_never_gives_way(name, mode, robot_named, rng) -> None:
    """Level 0 achieves the same with and without level 1, to 1e-7, limits active or not."""
    robot = robot_named(name)
    here = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    first = ComTask(robot, here.com + [0.01, 0.005, 0.0], weight=[1, 1, 0.0], gain=0.02)
    second = InertiaTask(robot, 2 * here.inertia, per_mass=True, weight=100, priority=1)
    third = PostureTask(robot, robot.posture("neutral"), priority=2)

    def achieved(*tasks) -> tuple[np.ndarray, np.ndarray]:
        controller = KinematicController(
            robot, tasks, contacts=support(here, mode), limits=Limits(robot), dt=DT, damping=1e-4
        )
        tick = controller.step(here)
        assert tick.ok, tick.report()
        assert tick.solution.residuals.primal < 1e-7
        return first.residual(here).jacobian[:2] @ tick.velocity, tick.velocity

    alone, without = achieved(first)
    for tasks in ([first, second], [third, first, second]):
        together, velocity = achieved(*tasks)
        np.testing.assert_allclose(together, alone, atol=1e-7)
        assert np.abs(velocity - without).max() > 1e-3, "the lower level does act"


def test_a_level_that_takes_everything_leaves_the_next_nothing(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    everything = [
        PostureTask(hoap2, hoap2.posture("neutral")),
        PositionTask(hoap2, "base", here.position("base")),
        OrientationTask(hoap2, "base", here.rotation("base")),
    ]
    last = ComTask(hoap2, [1, 1, 1], priority=1)
    alone = KinematicController(hoap2, everything, limits=Limits(hoap2)).step(here)
    tick = KinematicController(hoap2, [*everything, last], limits=Limits(hoap2)).step(here)
    assert tick.ok
    np.testing.assert_allclose(tick.velocity, alone.velocity, atol=1e-9)


def test_the_command_is_that_of_the_last_level_solved(hoap2, monkeypatch) -> None:
    """Where the third has no solution its attempt was commanded, at 293 m/s in one tick."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [
        ComTask(hoap2, here.com + [0.01, 0.0, 0.0]),
        PositionTask(hoap2, "left_palm", here.position("left_palm") + 0.1, priority=1),
        ComTask(hoap2, here.com, name="again", singular_threshold=0.1, priority=2),
        PostureTask(hoap2, hoap2.posture("neutral"), priority=2),
    ]

    def tick(tasks) -> Tick:
        limits = Limits(hoap2, braking="bounded")  # level by level
        return KinematicController(hoap2, tasks, contacts=(), limits=limits).step(here)

    expected, solve = tick(tasks[:2]), CoreMemory.solve_level

    def fails(memory: CoreMemory, level: int) -> int:
        if level < 2:
            return solve(memory, level)
        memory.below += 1.0  # an attempt that came to nothing
        return INFEASIBLE

    whole = tick(tasks)
    assert np.abs(whole.velocity - expected.velocity).max() > 0.01 and "again" in whole.singular
    monkeypatch.setattr(CoreMemory, "solve_level", fails)
    last = tick(tasks)
    np.testing.assert_allclose(last.velocity, expected.velocity, atol=1e-9)
    assert last.left_out == ("level 2: again, posture",) and not last.singular


@pytest.mark.parametrize("seed", [69, 520, 2462])
def test_a_level_that_is_hard_to_solve_has_another_attempt(hoap2, seed: int) -> None:
    """Only the first one had: the second was left out. Oracle: Clarabel where the first is kept."""
    pytest.importorskip("clarabel")
    rng = np.random.default_rng(seed)
    here = hoap2.snapshot(random_state(hoap2, rng)[0])

    def turned(frame: str, weight: float, priority: int) -> OrientationTask:
        target = here.rotation(frame) @ exp_rotation(0.3 * rng.normal(size=3))
        law = {"weight": weight, "priority": priority, "gain": 0.3}
        return OrientationTask(hoap2, frame, target, **law)

    first = [turned("left_palm", 1000, 0), turned("right_sole", 1, 0)]
    last, law = turned("right_palm", 0.01, 1), {"contacts": (), "limits": Limits(hoap2)}
    alone, both = (
        KinematicController(hoap2, tasks, **law, dt=DT, damping=1e-9).step(here)
        for tasks in (first, [*first, last])
    )
    assert both.ok and not both.left_out
    kept = np.vstack([task.residual(here).jacobian for task in first])
    np.testing.assert_allclose(kept @ both.velocity, kept @ alone.velocity, atol=1e-9)
    J, wanted = last.residual(here).jacobian, -0.3 / DT * last.residual(here).error
    eye, x = np.eye(hoap2.nv), alone.velocity
    parts = [csc_matrix(one) for one in (J.T @ J + 1e-6 * eye, kept)]
    given = {"A": parts[1], "b": kept @ x, "lb": alone.qp.lower, "ub": alone.qp.upper}
    best = qpsolvers.solve_qp(parts[0], -J.T @ wanted, **given, solver="clarabel")
    assert best is not None
    lost, least, before = (np.linalg.norm(J @ v - wanted) for v in (both.velocity, best, x))
    assert lost < least + 1e-3 and least < 0.98 * before


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_bounds_that_hold_a_level_leave_the_next_one_room(g1_27, rng, solver) -> None:
    """Far targets: most joints are at their bounds at level 0, and no tick may fail for that.

    Between the rows that are kept and the bounds that limit them there was no room: ProxQP failed
    in every one of these ticks. Level 0 achieves what it does alone.
    """
    q, v = g1_27.posture("standing"), np.zeros(g1_27.nv)
    here = g1_27.snapshot(q)
    turn = exp_rotation(np.array([0.3, 0.4, -0.3]))
    hand = "left_wrist_yaw_link"
    first = [OrientationTask(g1_27, hand, here.rotation(hand) @ turn), ComTask(g1_27, here.com)]
    far = g1_27.integrate(q, np.concatenate((np.zeros(6), 0.8 * rng.normal(size=27))), 1.0)
    second = PostureTask(g1_27, far, weight=0.05, priority=1)

    def controller(tasks) -> KinematicController:
        return KinematicController(
            g1_27,
            tasks,
            contacts=support(here, "double"),
            limits=Limits(g1_27),
            dt=DT,
            solver=solver,
        )

    alone, both, acted = controller(first), controller([*first, second]), 0.0
    for _ in range(60):
        now = g1_27.snapshot(q, v)
        expected, tick = alone.step(now), both.step(now)
        assert tick.ok, tick.report()
        for task in first:
            J = task.residual(now).jacobian
            np.testing.assert_allclose(J @ tick.velocity, J @ expected.velocity, atol=1e-7)
        acted = max(acted, float(np.abs(tick.velocity - expected.velocity).max()))
        v = tick.velocity
        q = g1_27.integrate(q, v, DT)
    assert acted > 0.1, "the lower level does act"


@pytest.mark.parametrize(
    ("x", "said"),
    [
        ([0.5, -1.0, 9.0], None),
        ([1.0 + 0.9e-6, -1.0 - 0.9e-6, 9.0], None),
        ([1.0 + 1.1e-6, 0.0, 0.0], "a at 1, outside its limits [-1, 1]"),
        ([1.1, -1.3, 9.0], "b at -1.3, outside its limits [-1, inf]"),
        ([0.0, np.nan, 0.0], "b at nan, outside its limits"),
        ([0.0, LARGEST, 0.0], None),
        ([1.0, LARGEST, 9.0 * LARGEST], None),
        ([0.0, 1.01 * LARGEST, 0.0], f"b at {1.01 * LARGEST:g}, beyond {LARGEST:g}"),
    ],
)
def test_what_is_outside_the_limits_is_no_answer(x: list[float], said: str | None) -> None:
    """By more than 1e-6; what is behind the velocity has limits of its own."""
    upper = np.array([1.0, np.inf, 1.0])
    solution = ActiveSet().solve(QP.build(np.eye(3), np.zeros(3), lower=-np.ones(3), upper=upper))
    found = SimpleNamespace(
        velocity=np.array(x[:2]), box=(-np.ones(2), upper[:2]), solution=solution
    )
    outcome = Outcome(found).within_limits(("a", "b", "force"))
    assert outcome.solved is (said is None)
    if said is not None:
        assert outcome.solution.status is Status.CONTRADICTED
        assert outcome.solution.message.startswith(said)
    unsolved = Outcome(found, solution._replace(status=Status.FAILED))
    assert unsolved.within_limits(("a", "b", "force")) is unsolved
