"""Where the optimum of the cost alone keeps all bounds and rows, the core asks no solver."""

import numpy as np
import pytest

from tests.needs import needs_core
from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.controller import Controller
from wbc.controllers.native_problem import NO_SOLVER
from wbc.qp.kkt import kkt_residuals
from wbc.qp.proxqp_workspace import Workspace
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, InertiaTask, PostureTask

pytestmark = needs_core
LEVELS = (KinematicController, TorqueController)
# Residuals are below 1e-8, the least curvature is 0.3^2.
NEAR = 1e-7


def controller_of(
    robot: Robot, here: Snapshot, level: type = KinematicController, **options
) -> Controller:
    """A little is asked for: a mm, and hundredths of the inertia."""
    rng = np.random.default_rng(2)
    tasks = [
        ComTask(robot, here.com + 1e-3 * rng.normal(size=3), weight=3.0),
        InertiaTask(robot, 1.01 * here.inertia, per_mass=True, weight=3.0),
        PostureTask(robot, here.q, weight=0.3),
    ]
    options = {"limits": Limits(robot), "solver": "active_set", **options}
    return level(robot, tasks, contacts=support(here, "double"), **options)


@pytest.mark.parametrize("margin", [False, True])
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
def test_no_solver_is_asked_where_no_bound_is_active(
    solver: str, level, margin: bool, native, monkeypatch
) -> None:
    """ProxQP, in Python, finds the same."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    kept = {"constraints": [SelfCollision(robot, pairs=20)] if margin else []}
    with monkeypatch.context() as patch:
        patch.setattr(Workspace, "create", None)
        tick = controller_of(robot, here, level, solver=solver, **kept).step(here)
    found = tick.solution
    assert (found.solver, found.iterations, found.attempts) == (NO_SOLVER, 0, 1)
    assert max(kkt_residuals(tick.qp, found.x, found.y, found.z, found.z_box)) < 1e-8
    assert not found.z.any() and not found.z_box.any()
    plain = Controller._step(controller_of(robot, here, level, solver="proxqp", **kept), here)
    assert plain.solution.solver == "proxqp"
    np.testing.assert_allclose(tick.velocity, plain.velocity, rtol=0.0, atol=NEAR)
    assert np.abs(tick.velocity).max() > 1e-4


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
def test_every_bound_is_kept(solver: str, native) -> None:
    """One joint at a time may not be as fast: unknowns that stay, and eliminated ones of legs."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    free = controller_of(robot, here).step(here)
    assert free.solution.solver == NO_SOLVER
    moving = np.flatnonzero(np.abs(free.velocity[6:]) > 1e-4)
    assert moving.size > 10
    for joint in moving:
        limits = Limits(robot)
        speed = limits.speed.copy()
        speed[joint] = 0.5 * abs(free.velocity[6 + joint])
        limits.speed = speed
        controller = controller_of(robot, here, solver=solver, limits=limits)
        tick = controller.step(here)
        assert tick.solution.solver == solver
        np.testing.assert_allclose(
            tick.velocity[6 + joint],
            np.copysign(speed[joint], free.velocity[6 + joint]),
            rtol=0.0,
            atol=1e-8,
        )
        plain = Controller._step(controller_of(robot, here, limits=limits), here)
        np.testing.assert_allclose(tick.velocity, plain.velocity, rtol=0.0, atol=NEAR)


@pytest.mark.parametrize("level", LEVELS)
def test_a_solver_is_asked_exactly_where_something_is_active(level, native) -> None:
    """Bounds, margins, cones and torques, at postures near and far; against the Python tick."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    posture = PostureTask(robot, here.q, weight=0.3, gain=0.1)
    tasks = [ComTask(robot, here.com, weight=3.0), posture]
    kept = [SelfCollision(robot, pairs=20)]
    options = {"limits": Limits(robot), "constraints": kept, "solver": "active_set"}
    controller = level(robot, tasks, contacts=support(here, "double"), **options)
    rng, told = np.random.default_rng(3), []
    for size in np.geomspace(1e-3, 1.0, 40):
        turn = np.concatenate((np.zeros(6), size * rng.normal(size=robot.nv - 6)))
        posture.set_target(robot.limits.clamped(robot.integrate(here.q, turn, 1.0)))
        tick = controller.step(here)
        found = tick.solution
        active = found.z.any() or found.z_box.any()
        assert found.solver == ("active_set" if active else NO_SOLVER)
        plain = Controller._step(controller, here)
        assert (np.abs(plain.solution.z_box) > 1e-7).any() <= active
        np.testing.assert_allclose(tick.velocity, plain.velocity, rtol=0.0, atol=NEAR)
        told.append(bool(active))
    assert told.count(False) > 5
    assert len(told) - told.count(False) > 5
