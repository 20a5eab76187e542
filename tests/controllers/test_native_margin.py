"""Ticks with self-collision in the native core against the Python tick on the same snapshot."""

import copy
import pickle

import numpy as np
import pytest

from tests.controllers.native_ticks import assert_same_entries
from tests.needs import needs_core
from wbc.constraints import BrakingParameters, Limits, PositionBox, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.controller import Controller
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel
from wbc.robot.collision.shapes import Body, Capsule
from wbc.tasks import ComTask, PositionTask, PostureTask

pytestmark = needs_core
HANDS = ("left_hand", "right_hand")
LEVELS = (KinematicController, TorqueController)
SOLVERS = ("active_set", "proxqp")


def controller_of(
    robot: Robot, here: Snapshot, level: type = KinematicController, **options
) -> Controller:
    """The hands reach for each other through whatever is between."""
    tasks = [PositionTask(robot, hand, here.com, weight=3.0, gain=0.2) for hand in HANDS]
    tasks += [ComTask(robot, here.com - [0, 0, 0.05]), PostureTask(robot, here.q, weight=0.05)]
    options = {"limits": Limits(robot), "solver": "active_set", **options}
    return level(robot, tasks, contacts=support(here, "double"), **options)


def assert_same_tick(controller: Controller, snapshot: Snapshot) -> bool:
    """Rows, verdict and command are the Python tick's; False: the core handed the tick over."""
    assert controller._native.margin is not None
    found = controller._native_problem(controller._native, snapshot)
    if found is None or not found.solved:
        return False
    plain = Controller._step(controller, snapshot)
    assert (plain.status.value, plain.policy, plain.step_scale) == ("solved", None, 1.0)
    assert found.qp.labels == plain.qp.labels
    assert_same_entries(found.qp, plain.qp)
    # Of the solver's two ways to one optimum, with and without equalities; warm or not, those of
    # ProxQP are as near as its residuals and the least curvature let them be.
    exact = controller.backend.name == "active_set"
    accuracy = {"rtol": 0.0, "atol": 1e-7 if exact else 1e-5}
    np.testing.assert_allclose(found.velocity, plain.velocity, **accuracy)
    fast = controller.step(snapshot)
    np.testing.assert_allclose(fast.velocity, found.velocity, **accuracy)
    assert not exact or np.array_equal(fast.velocity, found.velocity)
    return True


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("level", LEVELS)
def test_rows_verdict_and_command_near_and_inside_a_margin(level, solver, native, rng) -> None:
    """Boxes, hulls and capsules; other robots are compared by benchmarks/native_agreement.py."""
    robot = native("hoap2_like")
    here, v = robot.snapshot(robot.posture("standing")), np.zeros(robot.nv)
    limits = Limits(robot)
    margins = SelfCollision(robot, pairs=30, limits=limits)
    options = {"limits": limits, "constraints": [margins], "solver": solver}
    controller = controller_of(robot, here, level, **options)
    q, taken, active, inside = here.q, 0, 0, 0
    for _ in range(150):  # to where margins hold the hands
        v = controller.step(robot.snapshot(q, v)).velocity
        q = robot.integrate(q, v, controller.dt)
    for _ in range(60):
        size = 10.0 ** rng.uniform(-4, -1.5)
        there = robot.integrate(q, size * rng.normal(size=robot.nv), 1.0)
        snapshot = robot.snapshot(there, v + size * rng.normal(size=robot.nv))
        if assert_same_tick(controller, snapshot):
            tick = controller.step(snapshot)
            taken += 1
            active += any(" vs " in name for name in tick.active)
            inside += bool((margins.distances(snapshot).clearance < -1e-4).any())
    assert taken > 8
    assert active > 3
    assert inside > 3


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("level", LEVELS)
def test_a_closed_loop_into_the_margin(level, solver, native) -> None:
    """Where the answer leads inside, Python cuts; nothing is ever broken."""
    robot = native("hoap2_like")
    q = robot.posture("standing")
    here, v = robot.snapshot(q), np.zeros(robot.nv)
    margins = SelfCollision(robot, margin=0.02)
    controller = controller_of(robot, here, level, constraints=[margins], solver=solver)
    taken, held, least = 0, 0, np.inf
    for _ in range(120):
        snapshot = robot.snapshot(q, v)
        taken += assert_same_tick(controller, snapshot)
        tick = controller.step(snapshot)
        held += any(" vs " in name for name in tick.active)
        v = tick.velocity
        q = robot.integrate(q, v, controller.dt)
        least = min(least, margins.distances(robot.snapshot(q)).clearance.min())
    assert taken > 60
    assert held > 10
    assert least > -1e-4  # the skin


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_an_answer_leads_is_looked_at(solver, native) -> None:
    """From speeds and turns that rows, which are linear, know nothing of."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    margins = SelfCollision(robot, margin=0.02)
    controller = controller_of(robot, here, constraints=[margins], dt=0.3, solver=solver)
    q, cut = here.q, 0
    for _ in range(6):
        snapshot = robot.snapshot(q)
        native_took_it = assert_same_tick(controller, snapshot)
        tick = controller.step(snapshot)
        cuts = len(tick.qp.labels.inequality) > margins.count
        assert not (native_took_it and cuts)
        cut += cuts
        q = robot.integrate(q, tick.velocity, controller.dt)
    assert cut > 0


def test_what_is_changed_is_read_or_left_to_python(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    margins = SelfCollision(robot)
    controller = controller_of(robot, here, constraints=[margins])
    assert controller._native.serves(controller.limits, controller.dt)
    before = controller.step(here)
    assert len(before.qp.labels.inequality) == margins.count
    margins.braking = BrakingParameters(gain=0.01)
    assert not controller._native.serves(controller.limits, controller.dt)
    after = controller.step(here)
    assert (after.qp.l[before.qp.l < -1e-3] > before.qp.l[before.qp.l < -1e-3]).any()
    controller.change(constraints=[margins])
    assert assert_same_tick(controller, here)
    np.testing.assert_allclose(controller.step(here).qp.l, after.qp.l, atol=1e-12)


def test_only_what_the_core_knows_is_kept_by_it(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    margins = SelfCollision(robot)

    class Own(SelfCollision):
        pass

    box = PositionBox.height(robot, here.q[2] + 1.0)
    for options in (
        {"constraints": [margins, box]},
        {"constraints": [Own(robot)]},
        {"constraints": [margins], "slack": {margins.name: 100.0}},
        {"constraints": [margins], "solver": "proxqp_cold"},
        {"constraints": [margins], "formulation": "reduced"},
    ):
        controller = controller_of(robot, here, **options)
        assert controller._native is None or controller._native.margin is None
        assert controller.step(here).ok
    assert controller_of(robot, here, constraints=[margins])._native.margin is not None


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_keeps_its_own_bodies_apart(how, native) -> None:
    """A ball of the world is moved into the way of one controller, and not of its copy."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    hand = robot.model.frames[robot.frame_id("left_hand")].parentJoint
    ball = Capsule.sphere([0.0, 0.0, 0.0], 0.02)
    bodies = [Body("hand", "left_hand", hand, ball), Body("ball", "", 0, ball)]
    model = CollisionModel(robot, bodies, [(0, 1)])
    margins = SelfCollision(robot, model=model)
    controller = controller_of(robot, here, constraints=[margins])
    model.place(1, np.eye(3), here.com + [0.0, 0.0, 5.0])
    other = how(controller)
    towards = here.position("left_hand") + 0.06 * (here.com - here.position("left_hand"))
    model.place(1, np.eye(3), towards + [0.0, 0.0, 0.05])
    assert assert_same_tick(controller, here)
    near, far = controller.step(here), other.step(other.robot.snapshot(here.q, here.v))
    assert far.qp.l[0] < near.qp.l[0] - 0.1
    found = margins.distances(here)
    np.testing.assert_allclose(near._evidence._answer.clearance, found.clearance, atol=1e-12)


@pytest.mark.parametrize("core", [True, False])
def test_pairs_that_could_not_stop_in_time_have_rows_at_the_torque_level(core, native) -> None:
    """Of far pairs some close fast: seen when they were near, it was too late to brake."""
    robot = native("hoap2_like")
    here, v = robot.snapshot(robot.posture("standing")), np.zeros(robot.nv)
    v[6:] = 4.0 * np.random.default_rng(3).normal(size=robot.nv - 6)
    snapshot = robot.snapshot(here.q, v)
    judge = SelfCollision(robot, pairs=10_000)
    every = judge.distances(snapshot)
    late = -every.jacobian @ v > judge._speed(every, 0.002)
    wanted = {judge.model.labels[k] for k in np.flatnonzero(late)}
    for pairs in (3, 200):
        margins = SelfCollision(robot, pairs=pairs)
        solver = "active_set" if core else "proxqp_cold"
        options = {"constraints": [margins], "solver": solver, "limits": None}
        controller = controller_of(robot, here, TorqueController, **options)
        rows = {
            label for label in controller.step(snapshot).qp.labels.inequality if " vs " in label
        }
        assert len(wanted) > 3 and wanted <= rows
        found = controller._native_problem(controller._native, snapshot)
        if core:  # a plan has as many rows as pairs: more are added by Python
            assert (found is None) == (pairs == 3)
    slow = SelfCollision(robot, pairs=3)  # may stop at once: the nearest
    nearest = slow.rows(snapshot, 0.002).distances
    assert nearest.keys.tolist() == slow.distances(snapshot).keys.tolist()
    assert len(slow.rows(snapshot, 0.002).labels) == 3
