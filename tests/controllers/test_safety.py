"""Limits hold whatever levels, margins and deadlines do; controllers leave no circular garbage."""

import gc

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import wbc
from tests.controllers.test_look_ahead import Slow, moving
from wbc.constraints import FrictionCone, Limits, PositionBox, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.look_ahead import CUTS
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Solution, Status
from wbc.robot import Robot
from wbc.rotations import exp_rotation
from wbc.tasks import ComTask, MomentumTask, OrientationTask, PositionTask, PostureTask

DT, HAND = 0.005, "left_rubber_hand"


@pytest.mark.parametrize("mode", ["floating", "double"])
@pytest.mark.parametrize("seed", range(15))
def test_levels_and_look_ahead_do_not_take_limits_away(mode: str, seed: int, g1: Robot) -> None:
    """Before: up to 130 rad/s above the limits, status "solved", in 11 of 20 of these states."""
    rng = np.random.default_rng(seed)
    q = g1.posture("standing")
    step = np.concatenate((np.zeros(6), rng.normal(scale=0.2, size=g1.nv - 6)))
    here = g1.snapshot(g1.integrate(q, step, 1.0))
    limits = Limits(g1)
    at, away = here.position(HAND), rng.normal(size=(2, 3))
    box = PositionBox(g1, HAND, at - 0.01, at + 0.01)  # the hand turns: look-ahead adds rows
    tasks = [
        OrientationTask(g1, "base", exp_rotation(rng.normal(size=3)), weight=10.0),
        PositionTask(g1, HAND, here.com + away[1], priority=1),
        ComTask(g1, here.com + away[0], priority=1),
        PostureTask(g1, g1.posture("standing"), priority=2),
    ]
    controller = KinematicController(
        g1, tasks, contacts=support(here, mode), limits=limits, constraints=[box], dt=DT
    )
    tick = controller.step(here)
    lower, upper = limits.box(here, DT)
    assert (tick.velocity >= lower - 1e-6).all() and (tick.velocity <= upper + 1e-6).all()


class Careless(ProxQP):
    """A solver whose answer is wrong by more than its own residuals admit."""

    def solve(self, qp: QP, workspace="default") -> Solution:
        solution = super().solve(qp, workspace)
        return solution._replace(x=3.0 * np.maximum(qp.upper, 1.0))


def test_a_command_outside_the_limits_is_never_given(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [ComTask(hoap2, here.com + 0.01)]
    twist = np.full(6, 0.5)
    controller = KinematicController(
        hoap2, tasks, limits=Limits(hoap2, base_twist=twist), solver=Careless()
    )
    tick = controller.step(here)
    assert tick.status is Status.CONTRADICTED and tick.policy == "hold"
    assert not tick.velocity.flags.writeable
    assert not tick.velocity.any()
    assert "outside its limits" in tick.report()


@pytest.mark.parametrize("seed", range(30))
def test_the_second_level_is_the_lexicographic_optimum(seed: int, g1: Robot) -> None:
    """Oracle: SciPy's bounded least squares on what the first level leaves, all rows at once.

    Before, bounds that only damping held became equalities: up to 67 % above the optimum.
    """
    rng = np.random.default_rng(seed)
    step = np.concatenate((np.zeros(6), rng.normal(scale=0.2, size=g1.nv - 6)))
    q = g1.integrate(g1.posture("standing"), step, 1.0)
    q[7:] = np.clip(q[7:], g1.limits.lower, g1.limits.upper)  # else recovery takes part
    here = g1.snapshot(q, rng.normal(scale=0.5, size=g1.nv))
    limits = Limits(g1, base_twist=np.full(6, 1.0))
    away = rng.normal(scale=0.5, size=(2, 3))
    tasks = [
        ComTask(g1, here.com + away[0], weight=10.0),
        PositionTask(g1, HAND, here.position(HAND) + away[1], priority=1),
        PostureTask(g1, g1.posture("standing"), weight=0.1, priority=1),
    ]
    controller = KinematicController(g1, tasks, limits=limits, dt=DT, solver="active_set")
    tick = controller.step(here)
    assert tick.ok, tick.report()
    first = KinematicController(g1, tasks[:1], limits=limits, dt=DT, solver="active_set").step(here)
    com = tasks[0].residual(here)
    np.testing.assert_allclose(
        com.jacobian @ tick.velocity, com.jacobian @ first.velocity, atol=1e-6
    )
    # The second level's cost as rows: its tasks, and the damping that its law adds.
    stacked, wanted, damping = [], [], controller.damping
    for task in tasks[1:]:
        residual = task.residual(here)
        bound = residual.curvature_bound
        stacked.append(task.weight[:, None] * residual.jacobian)
        wanted.append(task.weight * (-task.gain / DT * residual.error - residual.bias))
        damping += 0.5 * task.gain * (bound() if callable(bound) else bound)
    stacked.append(np.sqrt(damping) * np.eye(g1.nv))
    wanted.append(np.zeros(g1.nv))
    J, w = np.concatenate(stacked), np.concatenate(wanted)
    heavy = 1e5 * com.jacobian
    lower, upper = limits.box(here, DT)
    oracle = lsq_linear(
        np.concatenate((heavy, J)),
        np.concatenate((heavy @ first.velocity, w)),
        (lower, upper + 1e-12),
        method="bvls",
        tol=1e-14,
    ).x
    cost, best = (float(np.sum((J @ v - w) ** 2)) for v in (tick.velocity, oracle))
    assert cost <= best * (1.0 + 1e-4) + 1e-9


@pytest.mark.parametrize("solver", ["proxqp", "active_set"])
@pytest.mark.parametrize("margins", [False, True])
def test_without_limits_nothing_is_commanded_that_no_state_may_have(g1, solver, margins) -> None:
    """Before: 1e9 rad/s and "solved", or, with margins, an error from where it led."""
    here = g1.snapshot(g1.posture("standing"))
    for policy in ("hold", "damp", "closest"):
        controller = KinematicController(
            g1,
            [MomentumTask(g1, np.full(6, 1e9))],
            contacts=[],
            constraints=[PositionBox.height(g1, 0.1)] if margins else [],
            limits=None,
            dt=DT,
            solver=solver,
            on_failure=policy,
        )
        tick = controller.step(here)
        assert tick.status is Status.CONTRADICTED
        assert "beyond 1e+06, which no state may have" in tick.report()
        assert np.abs(tick.velocity).max() <= 1e6
        g1.snapshot(g1.integrate(here.q, tick.velocity, 1e-6), tick.velocity)


AT_ONCE = 1e-9  # s


def test_ticks_of_one_attempt_lack_nothing(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [ComTask(hoap2, here.com + 0.01), PostureTask(hoap2, here.q, priority=1)]
    for kind in (KinematicController, TorqueController):
        parts = {"contacts": support(here, "double"), "constraints": [SelfCollision(hoap2)]}
        free, late = (
            kind(hoap2, tasks, limits=Limits(hoap2), deadline=deadline, **parts).step(here)
            for deadline in (None, AT_ONCE)
        )
        assert late.ok and late.left_out == () and late.report() == "solved"
        np.testing.assert_array_equal(late.velocity, free.velocity)


def test_cuts_that_came_too_late_are_said_and_the_step_is_shorter(hoap2) -> None:
    """All of the step would break the margin; a quarter, which needs no QP, does not."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    ticks = []
    for deadline in (None, 60.0, AT_ONCE):
        constraint = Slow(hoap2, 0.5, useful=True)
        constraint.start = here.q
        control = moving(hoap2, constraint, "left_elbow_pitch", deadline=deadline)
        tick = control.step(here)
        lower, upper = control.limits.box(here, control.dt)
        assert tick.ok and (tick.velocity >= lower).all() and (tick.velocity <= upper).all()
        assert np.abs(tick.velocity).max() <= 0.5 + 1e-6
        ticks.append(tick)
    *free, late = ticks
    assert all(tick.left_out == () and tick.step_scale == 1.0 for tick in free)
    assert late.left_out == (CUTS,) and 0.0 < late.step_scale < 1.0
    assert late.report() == f"solved, but left out: {CUTS}"


def test_torque_ticks_give_way_in_time(hoap2) -> None:
    """What is relaxed once the deadline is over keeps physics and torque bounds all the same."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    contacts = support(here, "double", friction=FrictionCone(least=10.0 * hoap2.weight))
    control = TorqueController(
        hoap2, [PostureTask(hoap2, here.q)], contacts=contacts, limits=Limits(hoap2),
        force_ramp=0.0, deadline=AT_ONCE,
    )  # fmt: skip
    tick = control.step(here)
    assert tick.policy == "relax" and np.isfinite(tick.velocity).all()
    assert (np.abs(tick.torque) <= control.torque_bounds).all()
    assert "not everything could be kept" in tick.report()
    assert tick.conflict is not None or tick.left_out


@pytest.mark.parametrize("level", [wbc.KinematicController, wbc.TorqueController])
def test_ticks_and_changes_of_contacts_leave_none(hoap2, level) -> None:
    """Loops run without a collector: plans of a walk kept each other alive, 1.8 MB a second."""
    now = hoap2.snapshot(hoap2.posture("standing"))
    tasks = [wbc.ComTask(hoap2, now.com), wbc.PostureTask(hoap2, now.q, weight=0.1)]
    both, left = wbc.support(now, "double"), wbc.support(now, "left")
    controller = level(
        hoap2,
        tasks,
        contacts=both,
        limits=wbc.Limits(hoap2),
        constraints=[wbc.SelfCollision(hoap2, margin=0.005)],
    )

    def ticks(count: int) -> None:
        for k in range(count):
            controller.set_contacts(left if k % 2 else both)
            tasks[0].weight = 10.0 + k
            controller.step(hoap2.snapshot(now.q, 0.01 * k * now.v)).report()

    ticks(4)
    gc.collect()
    gc.disable()
    try:
        ticks(10)
        assert gc.collect() == 0
    finally:
        gc.enable()
