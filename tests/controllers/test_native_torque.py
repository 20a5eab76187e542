"""Torque ticks in the native core against the Python tick on the same snapshot."""

import copy
import itertools

import numpy as np
import pytest

from tests.conftest import ROBOTS, load, random_state
from tests.controllers.native_ticks import FIELDS, assert_same_qp, every_task
from tests.needs import needs_core
from wbc.constraints import (
    Contact,
    FrictionCone,
    Limits,
    PointContact,
    PositionBox,
    SelfCollision,
    support,
)
from wbc.controllers import TorqueController
from wbc.controllers.controller import Controller
from wbc.laws import AccelerationLaw
from wbc.native import VARIABLE
from wbc.qp.active_set import ActiveSet
from wbc.qp.kkt import kkt_residuals
from wbc.robot import Robot, Snapshot
from wbc.tasks import (
    ComTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PostureTask,
)

pytestmark = needs_core
CORNERS = [[0.05, 0.03, -0.02], [0.05, -0.03, 0.0], [-0.05, 0.0, 0.01]]


def controller_of(robot: Robot, tasks, contacts=(), **options) -> TorqueController:
    options = {"limits": Limits(robot), "solver": "active_set", **options}
    return TorqueController(robot, tasks, contacts=contacts, **options)


def standing_tasks(robot: Robot, here: Snapshot) -> list:
    """What a humanoid stands by, its CoM on the way somewhere."""
    com = ComTask(robot, here.com + [0.01, 0.02, -0.01], weight=10.0)
    momentum, shape = MomentumTask(robot, weight=0.1), InertiaTask(robot, here.inertia, weight=0.1)
    trunk = OrientationTask(robot, "base", here.rotation("base"))
    return [com, momentum, shape, trunk, PostureTask(robot, here.q, weight=0.1)]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_qp_at_random_states(name: str, rng, native) -> None:
    """All tasks with moving targets; contacts that press, grip and pivot, and share a link."""
    robot = native(name)
    for k in range(10):
        q, v = random_state(robot, rng)
        snapshot = robot.snapshot(q, v)
        names = [robot.frame_names[i] for i in rng.permutation(len(robot.frame_names))[:3]]
        cone = FrictionCone(0.4, facets=5)
        contacts = [
            Contact.hold(snapshot, names[0], corners=CORNERS, friction=cone),
            Contact.hold(snapshot, names[1], friction=None),
            PointContact.hold(snapshot, names[2]),
        ][: 1 + k % 3]
        limits = Limits(robot, base_twist=[9, 9, 9, 9, 9, 9]) if k % 3 else None
        controller = controller_of(
            robot,
            every_task(robot, rng, snapshot),
            contacts,
            limits=limits,
            torque_limits=None if k % 4 == 3 else 1.0,
            joint_weights={"base": 3.0},
        )
        drifted = robot.integrate(q, 1e-3 * v, 1.0)
        for here in (robot.snapshot(drifted, 0.1 * v), robot.snapshot(drifted)):
            tick = Controller._step(controller, here)
            if tick.policy is None:  # a relaxed one shows another QP
                assert_same_qp(controller, here)
            found = controller._native_problem(controller._native, here)
            dynamics = controller._dynamics(here)
            scale = np.abs(dynamics.offset).max()
            np.testing.assert_allclose(found.matrix, dynamics.matrix, rtol=0.0, atol=1e-11)
            np.testing.assert_allclose(found.offset, dynamics.offset, rtol=0.0, atol=1e-10 * scale)


def test_limits_ask_for_no_more_than_brakes_can_do(native, rng) -> None:
    """Joints too fast for their limits: a box within reach, which random states hardly meet."""
    robot = native("g1_27")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, standing_tasks(robot, here), support(here, "double"))
    bound, nv = 0, robot.nv
    for _ in range(10):
        q, _ = random_state(robot, rng)
        snapshot = robot.snapshot(q, 30.0 * rng.standard_normal(nv))
        found = controller._native_problem(controller._native, snapshot)
        assert found is not None
        (lower, upper), _ = controller._limits_at(snapshot)
        np.testing.assert_allclose(found.qp.lower[:nv], lower, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(found.qp.upper[:nv], upper, rtol=0.0, atol=1e-10)
        least, most = controller.limits.box(snapshot, controller.dt)
        bound += np.count_nonzero(lower < least) + np.count_nonzero(upper > most)
    assert bound > 50


@pytest.mark.parametrize("options", [{}, {"velocity": None}, {"velocity": None, "position": False}])
def test_joints_at_and_beyond_their_limits(options: dict, rng, native) -> None:
    robot = native("g1_27")
    q, joints = robot.posture("standing"), robot.nv - 6
    limits = Limits(robot, **options)
    controller = controller_of(robot, [PostureTask(robot, q)], limits=limits)
    for size in (0.0, 1e-12, 1e-6, 1e-3, 0.02):
        near = np.where(rng.random(joints) < 0.5, robot.limits.lower, robot.limits.upper)
        q[7:] = near + size * rng.normal(size=joints)
        snapshot = robot.snapshot(q, size * rng.normal(size=robot.nv))
        found = controller._native.problem(snapshot).qp
        plain = controller._limits_at(snapshot)[0]
        np.testing.assert_allclose(
            (found.lower[: robot.nv], found.upper[: robot.nv]), plain, rtol=1e-9, atol=1e-12
        )


def test_gears_and_a_bolted_base(native, geared: Robot, rng) -> None:
    """Their forces are unknowns too, and followers have no torque bound."""
    controller = controller_of(geared, [PostureTask(geared, geared.posture())], torque_limits=None)
    q, v = random_state(geared, rng)
    assert_same_qp(controller, geared.snapshot(q, 0.1 * v))
    assert len(controller.contact_forces.names) == 7


@pytest.mark.parametrize("name", ["g1_27", "talos", "hoap2_like"])
@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
def test_a_closed_loop_goes_the_same_way(name: str, solver: str, monkeypatch) -> None:
    """A push, a foot that is let go slowly, friction that changes: within what solvers leave."""
    ends, states = [], []
    for mode in ("require", "off"):
        monkeypatch.setenv(VARIABLE, mode)
        robot = Robot.load(name if name != "hoap2_like" else load(name).path)
        here = robot.snapshot(robot.posture("standing"))
        controller = controller_of(
            robot, standing_tasks(robot, here), support(here, "double"), solver=solver
        )
        assert (controller._native is not None) == (mode == "require")
        q, v, said = here.q, np.zeros(robot.nv), []
        for k in range(60):
            if k == 20:
                controller.set_contacts(support(here, "left"), ramp=0.02)
            if k == 30:
                controller.contacts[0].friction = FrictionCone(0.5, most=0.99 * robot.weight)
            tick = controller.step(robot.snapshot(q, v))
            said.append((tick.policy, tuple(tick.ramps)))
            v = tick.velocity + (0.1 if k == 10 else 0.0) * np.eye(robot.nv)[1]
            q = robot.integrate(q, v, controller.dt)
        ends.append(np.concatenate((q, v, tick.torque)))
        states.append(said)
    assert states[0] == states[1]
    assert any(ramps for _, ramps in states[0])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-6, atol=1e-6)


def test_a_tick_tells_the_same(native, rng) -> None:
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q, 0.01 * rng.standard_normal(robot.nv))
    tasks = standing_tasks(robot, here)
    fast_one, plain_one = (controller_of(robot, tasks, support(here, "double")) for _ in range(2))
    fast, plain = fast_one.step(here), Controller._step(plain_one, here)
    assert (fast.status, fast.policy, fast.report()) == (plain.status, None, "solved")
    assert fast.qp.labels == plain.qp.labels
    assert list(fast.errors) == list(plain.errors)
    for key, error in plain.errors.items():
        np.testing.assert_allclose(fast.errors[key], error, atol=1e-11)
    for field in ("velocity", "torque", "acceleration", "cop"):
        ours, theirs = getattr(fast, field), getattr(plain, field)
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-7, err_msg=field)
    for key, wrench in plain.forces.items():
        np.testing.assert_allclose(fast.forces[key], wrench, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", ROBOTS[:-1])
def test_the_answer_is_daqps_and_its_residuals_are_ours(name: str, native) -> None:
    """Torque bounds, cones and limits active."""
    robot = native(name)
    rng, backend, active = np.random.default_rng(3), ActiveSet(), 0
    here = robot.snapshot(robot.posture("standing"))
    for _ in range(15):
        tasks = standing_tasks(robot, here)
        tasks[0].set_target(here.com + 0.1 * rng.normal(size=3))
        controller = controller_of(robot, tasks, support(here, "double"), torque_limits=0.7)
        state = robot.snapshot(here.q, 0.1 * rng.normal(size=robot.nv))
        found = controller._native_problem(controller._native, state)
        if found is None:  # a joint outside its limits
            continue
        expected = backend.solve(found.qp, quick=True)
        assert (found.solution is not None) == expected.solved
        if found.solution is None:
            continue
        ours = found.solution
        scale = max(1.0, np.abs(expected.x).max())
        np.testing.assert_allclose(ours.x, expected.x, rtol=0.0, atol=1e-7 * scale)
        theirs = kkt_residuals(found.qp, ours.x, ours.y, ours.z, ours.z_box)
        for field in ("primal", "dual", "complementarity"):
            a, b = getattr(ours.residuals, field), getattr(theirs, field)
            assert a == pytest.approx(b, abs=1e-10)
            assert a <= backend.eps
        active += np.count_nonzero(np.abs(ours.z) > 1e-6)
    assert active > 20


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
def test_margins_are_added_to_the_cores_qp(solver: str, native) -> None:
    """The base comes down on a box, hands near the body: until margins hold the robot."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    box = PositionBox.height(robot, here.q[2] - 0.005)
    tasks = standing_tasks(robot, here)
    tasks[0].set_target(here.com - [0.0, 0.0, 0.05])
    controller = controller_of(
        robot,
        tasks,
        support(here, "double"),
        constraints=[SelfCollision(robot, margin=0.03), box],
        solver=solver,
        dt=0.005,
    )
    q, v, held = here.q, np.zeros(robot.nv), 0
    for _ in range(40):
        snapshot = robot.snapshot(q, v)
        fast, plain = controller.step(snapshot), Controller._step(controller, snapshot)
        assert fast.policy == plain.policy
        assert fast.qp.labels == plain.qp.labels
        for field in FIELDS:
            ours, theirs = getattr(fast.qp, field), getattr(plain.qp, field)
            finite = np.isfinite(theirs)
            scale = max(1.0, np.abs(theirs[finite]).max(initial=0.0))
            np.testing.assert_allclose(ours[finite], theirs[finite], rtol=0.0, atol=1e-7 * scale)
        np.testing.assert_allclose(fast.velocity, plain.velocity, atol=1e-5)
        held += any("height" in name or "base" in name for name in fast.active)
        v = fast.velocity
        q = robot.integrate(q, v, controller.dt)
    assert held > 5


def test_what_cannot_be_kept_is_relaxed_in_python(native, monkeypatch) -> None:
    """Rushing joints: the core finds no solution, and the tick gives way as it would without.

    The QP that has no solution is not solved again in Python, and the relaxed one by the core.
    """
    asked: list[int] = []
    solve = ActiveSet.solve

    def counted(self, qp, *args, **options):
        asked.append(qp.g.size)
        return solve(self, qp, *args, **options)

    monkeypatch.setattr(ActiveSet, "solve", counted)
    robot = native("g1_27")
    here = robot.snapshot(robot.posture("standing"))
    rng = np.random.default_rng(5)
    controller = controller_of(robot, standing_tasks(robot, here), support(here, "double"))
    relaxed = 0
    for _ in range(5):
        rushing = robot.snapshot(here.q, 20.0 * rng.normal(size=robot.nv))
        asked.clear()
        fast = controller.step(rushing)
        core = list(asked)
        plain = Controller._step(controller, rushing)
        assert fast.policy == plain.policy
        assert not core and asked == [controller.plan.decision.size]
        assert fast.solution.solver == plain.solution.solver == "active_set"
        np.testing.assert_array_equal(fast.torque, plain.torque)
        relaxed += fast.policy == "relax"
    assert relaxed == 5


def test_what_the_core_does_not_know_is_left_to_python(native) -> None:
    robot = native("g1_27")
    here = robot.snapshot(robot.posture("standing"))
    tasks, contacts = standing_tasks(robot, here), support(here, "double")
    for others, options in (
        ([PostureTask(robot, here.q, priority=1, name="low")], {}),
        ([], {"slack": {"left_sole": 10.0}}),
        ([], {"limits": Limits(robot, braking="bounded")}),
    ):
        controller = controller_of(robot, [*tasks, *others], contacts, **options)
        assert controller._native is None
        assert controller.step(here).ok
    # What acts at the velocity level alone is no reason.
    tasks[0].singular_threshold = 0.1
    assert controller_of(robot, tasks, contacts)._native is not None
    controller = controller_of(robot, tasks, contacts)
    # A cone of other facets has other rows.
    contacts[0].friction = FrictionCone(facets=8)
    assert controller._native.problem(here) is None
    assert controller.step(here).ok


@pytest.mark.parametrize("friction", [FrictionCone(0.05, facets=8), None])
def test_cones_of_another_size_count_in_every_tick_from_then_on(native, friction) -> None:
    """The core's plan has no place for them: neither in the next tick nor in those behind it."""
    robot = native("g1_27")
    here = robot.snapshot(robot.posture("standing"))
    contacts = support(here, "double")
    controller = controller_of(robot, standing_tasks(robot, here), contacts)
    assert controller.step(here).ok
    usual, contacts[0].friction = contacts[0].friction, friction
    for _ in range(3):
        found, wanted = controller.step(here), Controller._step(controller, here)
        assert found.qp.labels == wanted.qp.labels
        np.testing.assert_allclose(found.qp.C, wanted.qp.C, rtol=0.0, atol=1e-10)
    contacts[0].friction = usual
    assert_same_qp(controller, here)


def test_a_copy_has_memory_of_its_own_and_a_qp_lasts(native, rng) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    controller = controller_of(robot, standing_tasks(robot, here), support(here, "double"))
    first = controller.step(here)
    kept = {field: getattr(first.qp, field).copy() for field in FIELDS}
    twin = copy.deepcopy(controller)
    twin.tasks[0].acceleration_law = AccelerationLaw(kp=1.0)
    other = twin.step(twin.robot.snapshot(here.q))
    assert np.abs(other.torque - first.torque).max() > 1e-3
    again = controller.step(robot.snapshot(here.q))
    np.testing.assert_array_equal(again.torque, first.torque)  # and the same bits twice
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(first.qp, field), kept[field])
    parts = (first.velocity, first.torque, first.solution.x, *first.errors.values())
    for small, big in itertools.product(parts, (first.qp.P, first.qp.C)):
        assert not np.shares_memory(small, big)  # who records them must not keep the QPs
