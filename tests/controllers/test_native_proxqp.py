"""ProxQP solves what the core leaves of a tick: against DAQP and Python, and what is rejected."""

import copy
import itertools
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from tests.needs import needs_core
from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.controller import Controller
from wbc.qp import proxqp
from wbc.qp.kkt import kkt_residuals
from wbc.qp.proxqp_workspace import Workspace
from wbc.qp.solution import RawSolution
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, InertiaTask, PostureTask

pytestmark = needs_core
LEVELS = (KinematicController, TorqueController)
# Least curvature is 0.3^2, of the posture, residuals 1e-8; the velocities are some rad/s.
NEAR = 1e-5
ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")


def controller_of(
    robot: Robot, here: Snapshot, level: type = KinematicController, **options
) -> Controller:
    """Limits hold the robot: its posture is to be another, and joints may not be fast."""
    limits = Limits(robot)
    limits.speed = np.minimum(limits.speed, 0.3)
    rng = np.random.default_rng(5)
    there = robot.integrate(here.q, 0.1 * rng.normal(size=robot.nv), 1.0)
    tasks = [
        ComTask(robot, here.com + 0.01 * rng.normal(size=3), weight=3.0),
        InertiaTask(robot, 1.1 * here.inertia, per_mass=True, weight=3.0),
        PostureTask(robot, robot.limits.clamped(there), weight=0.3),
    ]
    held = {"contacts": support(here, "double"), "limits": limits, "solver": "proxqp"}
    return level(robot, tasks, **{**held, **options})


def assert_evidence(tick) -> None:
    """Residuals and multipliers are those of the QP that the tick shows."""
    qp, found = tick.qp, tick.solution
    again = kkt_residuals(qp, found.x, found.y, found.z, found.z_box)
    np.testing.assert_allclose(found.residuals, again, rtol=0.0, atol=1e-11)
    assert max(again) < 1e-8


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_answers_are_those_of_daqp_and_of_the_python_tick(
    name: str, level, native, monkeypatch
) -> None:
    """In closed loop, warm, bounds active."""
    monkeypatch.setattr(proxqp, "COOLDOWN", 0)
    robot = native(name)
    here = robot.snapshot(robot.posture("standing"))
    ours, daqp = (controller_of(robot, here, level, solver=one) for one in ("proxqp", "active_set"))
    q, v, active, warm = here.q, np.zeros(robot.nv), 0, 0
    for _ in range(25 if level is KinematicController else 60):
        snapshot = robot.snapshot(q, v)
        tick, exact = ours.step(snapshot), daqp.step(snapshot)
        assert tick.ok and exact.ok
        assert_evidence(tick)
        np.testing.assert_allclose(tick.velocity, exact.velocity, rtol=0.0, atol=NEAR)
        plain = Controller._step(daqp, snapshot)
        np.testing.assert_allclose(tick.velocity, plain.velocity, rtol=0.0, atol=NEAR)
        if (tick.solution.solver, tick.solution.attempts) == ("proxqp", 1):
            warm += 1
            active += np.count_nonzero(np.abs(tick.solution.z_box) > 1e-6)
        v = tick.velocity
        q = robot.integrate(q, v, ours.dt)
    assert warm > 5
    assert active > 30


def test_the_first_tick_asks_daqp_whether_there_is_a_solution(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, here)
    first, second = controller.step(here), controller.step(here)
    assert (first.solution.solver, first.solution.attempts) == ("proxqp", 2)
    assert (second.solution.solver, second.solution.attempts) == ("proxqp", 1)
    assert second.solution.iterations <= first.solution.iterations
    # Each set of contacts has a warm start of its own, which waits for it.
    feet = controller.contacts
    controller.set_contacts(feet[:1])
    assert controller.step(here).solution.attempts == 2
    controller.set_contacts(feet)
    assert controller.step(here).solution.attempts == 1


def wrong(honest: Callable[..., object]) -> Callable[..., object]:
    """Solve, and then another QP: what is read is no answer of the first."""

    def run(self: Workspace, qp, *rest: object) -> object:
        return honest(self, qp._replace(g=qp.g + 1.0), *rest)

    return run


@pytest.mark.parametrize("margin", [False, True])
@pytest.mark.parametrize("level", LEVELS)
def test_a_wrong_answer_is_rejected_and_daqp_answers(level, margin, native, monkeypatch) -> None:
    """Warm, and from nothing behind DAQP's own answer, the look where it leads in between."""
    monkeypatch.setattr(proxqp, "COOLDOWN", 0)
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    kept = [SelfCollision(robot, pairs=20)] if margin else []
    options = {"constraints": kept}
    exact = controller_of(robot, here, level, solver="active_set", **options).step(here)
    controller = controller_of(robot, here, level, **options)
    for _ in range(2):
        assert controller.step(here).solution.solver == "proxqp"
    create = Workspace.create.__func__
    false = classmethod(lambda cls, qp, *a, **b: create(cls, qp._replace(g=qp.g + 1.0), *a, **b))
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "run", wrong(Workspace.run))
        patch.setattr(Workspace, "create", false)
        for attempts in (2, 3, 3):  # warm, then from nothing: a false warm start is not kept
            tick = controller.step(here)
            assert (tick.solution.solver, tick.solution.attempts) == ("active_set", attempts)
            assert_evidence(tick)
            np.testing.assert_array_equal(tick.velocity, exact.velocity)
    assert controller.step(here).solution.solver == "proxqp"


def test_the_same_unknowns_are_eliminated_from_tick_to_tick(native) -> None:
    """Hips serve nearly as well as each other: a warm start is of use only to who has the same."""
    robot = native("g1")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, here)
    com, memory = controller.tasks[0], controller._native.memory
    begin = 2 * memory.n + memory.m
    q, v, chosen = here.q, np.zeros(robot.nv), []
    for k in range(300):
        com.set_target(here.com + [0.01 * np.sin(0.1 * k), 0.02 * np.sin(0.05 * k), 0.0])
        v = controller.step(robot.snapshot(q, v)).velocity
        q = robot.integrate(q, v, controller.dt)
        chosen.append(memory.arrays["order"][begin : begin + memory.k].tolist())
    assert min(chosen[0]) > 0
    changes = sum(one != other for one, other in itertools.pairwise(chosen))
    assert changes < 3


def test_what_stalls_is_left_in_peace(native, monkeypatch) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, here)
    controller.step(here)
    asked: list[int] = []
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "is_capped", True)
        patch.setattr(Workspace, "run", wrong(Workspace.run))
        assert controller.step(here).solution.solver == "active_set"
    honest = Workspace.solve_cold
    count: Callable[[Workspace], RawSolution] = lambda self: asked.append(1) or honest(self)  # noqa: E731
    monkeypatch.setattr(Workspace, "solve_cold", count)
    for _ in range(proxqp.COOLDOWN):
        assert controller.step(here).solution[8:] == ("active_set", None, 1, "")
    assert not asked
    assert controller.step(here).solution.solver == "proxqp"
    assert asked


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_has_a_warm_start_of_its_own(how, native) -> None:
    """Both go on, in turns, each with its own memory."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, here)
    for _ in range(3):
        expected = controller.step(here)
    other = how(controller)
    for _ in range(3):
        other.tasks[0].set_target(other.tasks[0].target + 0.01)
        moved = other.step(other.robot.snapshot(here.q))
        tick = controller.step(here)
        for one in (moved, tick):
            assert one.solution.solver == "proxqp"
            assert_evidence(one)
        np.testing.assert_allclose(tick.velocity, expected.velocity, rtol=0.0, atol=NEAR)
        assert np.abs(moved.velocity - tick.velocity).max() > 1e-3


def test_small_costs_are_scaled_for_proxqp(native) -> None:
    """With a cost of 1e-4 multipliers would sink into the accuracy that is asked for."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    ticks = []
    for solver in ("proxqp", "active_set"):
        controller = controller_of(robot, here, solver=solver, damping=1e-9)
        for task in controller.tasks:
            task.weight = 1e-2 * task.weight
        for _ in range(2):
            tick = controller.step(here)
        ticks.append(tick)
    assert ticks[0].solution.solver == "proxqp"
    assert np.abs(ticks[0].solution.z_box).max() < 1e-2
    assert_evidence(ticks[0])
    np.testing.assert_allclose(ticks[0].velocity, ticks[1].velocity, rtol=0.0, atol=1e-2)
