"""Plain ticks in the native core against the Python tick on the same snapshot."""

import copy
import pickle
import sys
import threading

import numpy as np
import pytest

from tests.conftest import ROBOTS, random_state
from tests.controllers.native_ticks import FIELDS, assert_same_qp, every_task
from tests.needs import needs_core
from wbc.constraints import (
    Contact,
    Limits,
    PointContact,
    PositionBox,
    SelfCollision,
    support,
)
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.controller import Controller
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.tick import Tick
from wbc.native import VARIABLE
from wbc.native.rows import NativeRows
from wbc.qp.active_set import ActiveSet
from wbc.qp.kkt import kkt_residuals
from wbc.qp.proxqp import ProxQP
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation
from wbc.tasks import (
    ComTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
)
from wbc.tasks.placement import homogeneous

pytestmark = needs_core


def controller_of(robot: Robot, tasks, contacts=(), **options) -> KinematicController:
    options = {"limits": Limits(robot), "solver": "active_set", **options}
    return KinematicController(robot, tasks, contacts=contacts, **options)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_qp_at_random_states(name: str, rng, native) -> None:
    robot = native(name)
    for k in range(12):
        snapshot = robot.snapshot(*random_state(robot, rng))
        held = [robot.frame_names[i] for i in rng.integers(len(robot.frame_names), size=2)]
        contacts = [Contact.hold(snapshot, held[0]), PointContact.hold(snapshot, held[1])]
        if held[0] == held[1]:
            contacts = contacts[:1]
        limits = Limits(robot, base_twist=[1, 1, 1, 2, 2, 2]) if k % 3 else None
        controller = controller_of(robot, every_task(robot, rng, snapshot), contacts, limits=limits)
        drifted = robot.integrate(snapshot.q, 1e-3 * snapshot.v, 1.0)
        assert_same_qp(controller, robot.snapshot(drifted, snapshot.v))
        assert_same_qp(controller, robot.snapshot(drifted))


def test_gears_and_a_bolted_base(native, geared: Robot, rng) -> None:
    assert geared.couplings
    q, v = random_state(geared, rng)
    controller = controller_of(geared, [PostureTask(geared, q)])
    assert_same_qp(controller, geared.snapshot(q, v))
    assert controller._native.problem(geared.snapshot(q, v)).qp.b.size == 7


def test_joints_may_be_held(native) -> None:
    """A posture met exactly: its matrix, which costs do without, is in the equality rows."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    knees = PostureTask(robot, here.q, joints={"*": 0.0, "*knee*": 1.0})
    controller = controller_of(robot, [ComTask(robot, here.com + 0.01)], [knees])
    assert_same_qp(controller, here)
    tick = controller.step(here)
    joints = [robot.joint_index(name) for name in knees.rows]
    assert tick.qp.A.sum() == len(joints) == 2
    np.testing.assert_allclose(tick.velocity[joints], 0.0, atol=1e-12)


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
@pytest.mark.parametrize("formulation", ["equality", "reduced"])
def test_a_closed_loop_goes_the_same_way(solver: str, formulation: str, monkeypatch) -> None:
    """Moving targets, limits active: after 150 ticks within 1e-7 rad, what solvers leave."""
    ends = []
    for mode in ("require", "off"):
        monkeypatch.setenv(VARIABLE, mode)
        robot = Robot.load("g1_27")
        q = robot.posture("standing")
        here = robot.snapshot(q)
        inertia = InertiaTask(robot, here.inertia, per_mass=True, weight=10.0, gain=0.2)
        com = ComTask(robot, here.com, weight=10.0)
        posture = PostureTask(robot, q, weight=0.1, gain=0.1)
        contacts = support(here, "double")
        controller = controller_of(
            robot, [inertia, com, posture], contacts, solver=solver, formulation=formulation
        )
        assert (controller._native is not None) == (mode == "require")
        v = np.zeros(robot.nv)
        for k in range(150):
            com.set_target(
                here.com + [0.03 * np.sin(0.1 * k), 0.04 * np.sin(0.07 * k), -0.0005 * k]
            )
            inertia.set_target(here.inertia * (1 + 0.2 * np.sin(0.05 * k)))
            tick = controller.step(robot.snapshot(q, v))
            assert tick.ok
            v = tick.velocity
            q = robot.integrate(q, v, controller.dt)
        ends.append(q)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-7)


def test_a_tick_tells_the_same(native, rng) -> None:
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q, 0.01 * rng.standard_normal(robot.nv))
    tasks = [ComTask(robot, here.com + 0.01, weight=3.0), MomentumTask(robot, weight=0.01)]
    controller = controller_of(robot, [*tasks, PostureTask(robot, q)], support(here, "double"))
    fast, plain = controller.step(here), Controller._step(controller, here)
    assert fast.status is plain.status
    assert fast.qp.labels == plain.qp.labels
    assert fast.report() == "solved"
    np.testing.assert_allclose(fast.velocity, plain.velocity, atol=1e-9)
    assert list(fast.errors) == list(plain.errors)
    for key, error in plain.errors.items():
        np.testing.assert_allclose(fast.errors[key], error, atol=1e-12)
    condition = [controller.conditioning(tick) for tick in (fast, plain)]
    assert condition[0].rank == condition[1].rank


def test_what_is_changed_between_ticks_is_followed(native, rng) -> None:
    """Targets, weights, gains and laws may be assigned at any time."""
    robot = native("hoap2_like")
    anchored = robot.snapshot(*random_state(robot, rng))
    snapshot = robot.snapshot(robot.integrate(anchored.q, 1e-3 * anchored.v, 1.0))
    tasks = every_task(robot, rng, snapshot)
    contact = Contact.hold(anchored, "left_sole")
    controller = controller_of(robot, tasks, [contact])
    other = robot.snapshot(*random_state(robot, rng))
    changes = (
        lambda: tasks[0].set_target(other.inertia),
        lambda: setattr(tasks[3], "target", other.com),
        lambda: setattr(tasks[3], "gain", 0.9),
        lambda: setattr(tasks[9], "weight", 0.7),
        lambda: tasks[9].set_target(other.q),
        lambda: setattr(tasks[0], "lm_damping", 0.3),
        lambda: tasks[8].set_target(np.ones(6)),
        lambda: setattr(contact, "gain", 0.0),
        lambda: setattr(tasks[7], "target", homogeneous(other.com, tasks[7].rotation)),
    )
    before = controller._native.problem(snapshot).qp
    for change in changes:
        change()
        assert_same_qp(controller, snapshot)
        after = controller._native.problem(snapshot).qp
        assert not all(np.array_equal(getattr(before, f), getattr(after, f)) for f in FIELDS)
        before = after


def with_margins(
    robot: Robot, here: Snapshot, margins: SelfCollision, height: float, soft: bool
) -> KinematicController:
    """The hands reach for each other and the base goes down, until margins hold them."""
    hands = ["left_hand", "right_hand"]
    between = 0.5 * (here.position(hands[0]) + here.position(hands[1]))
    tasks = [PositionTask(robot, hand, between, weight=3.0, gain=0.2) for hand in hands]
    tasks += [ComTask(robot, here.com - [0, 0, 0.2]), PostureTask(robot, here.q, weight=0.05)]
    box = PositionBox.height(robot, here.q[2] + height)
    options = {"constraints": [margins, box], "slack": {box.name: 100.0} if soft else {}}
    return controller_of(robot, tasks, support(here, "double"), **options)


def assert_same_tick(controller: KinematicController, snapshot: Snapshot) -> Tick:
    """The QP with margins and the command are those of the Python tick."""
    assert controller._native.problem(snapshot) is not None
    fast, plain = controller.step(snapshot), Controller._step(controller, snapshot)
    assert fast.ok and plain.ok
    assert fast.qp.labels == plain.qp.labels
    assert fast.step_scale == plain.step_scale
    assert fast.slack.keys() == plain.slack.keys()
    for field in (*FIELDS, "C", "l", "u"):
        ours, theirs = getattr(fast.qp, field), getattr(plain.qp, field)
        finite = np.isfinite(theirs)
        scale = max(1.0, np.abs(theirs[finite]).max(initial=0.0))
        # Cutting planes are drawn where the last solution leads: what solvers leave of it comes in.
        np.testing.assert_allclose(ours[finite], theirs[finite], rtol=0.0, atol=1e-7 * scale)
    np.testing.assert_allclose(fast.velocity, plain.velocity, atol=1e-5)
    return fast


FEW = {"*": 1.0, "*knee*": 0.0}


class Silent(OrientationTask):
    """Describes its rows without saying which of their numbers move with the target."""

    def native(self) -> tuple[NativeRows, ...]:
        return tuple(rows._replace(moving=()) for rows in super().native())


def test_targets_that_move_and_stop_are_followed(native, rng) -> None:
    """Alone, or with a weight set in between, after which all numbers are written again."""
    robot = native("hoap2_like")
    here = robot.snapshot(*random_state(robot, rng))
    there = robot.snapshot(robot.integrate(here.q, rng.uniform(-0.1, 0.1, robot.nv), 1.0))
    frame = robot.frame_names[-1]
    com, R = ComTask(robot, here.com, axes=("y", "x")), there.rotation(frame)
    turn, inertia = OrientationTask(robot, frame, R), InertiaTask(robot, here.inertia)
    silent = Silent(robot, "base", here.rotation("base"), name="silent")
    pose = PoseTask(robot, "base", here.com, here.rotation("base"))
    posture, few = PostureTask(robot, here.q), PostureTask(robot, here.q, joints=FEW, name="few")
    tasks = [com, turn, inertia, silent, pose, posture, few]
    held = PositionTask(robot, frame, here.position(frame), name="held")
    controller = controller_of(robot, tasks, [held])
    targets = {com: (there.com,), turn: (R,), silent: (there.rotation("base"),)}
    targets |= {inertia: (there.inertia,), pose: there.placement("base")}
    targets |= {posture: (there.q,), few: (there.q,), held: (there.position(frame),)}
    shapes = {inertia: (3, 3), pose: (6,), posture: (robot.nv,), few: (robot.nv,)}
    for task, target in targets.items():
        rates = [rng.normal(size=shapes.get(task, (3,))) for _ in range(2)]
        motion = [rate + rate.T for rate in rates]  # of vectors: twice
        for given in ((), motion[:1], motion, ()):
            for weight in (None, 0.5, 2.0):
                changes = task._changes
                task.set_target(*target, *given)
                assert task._changes == changes  # only what moves is told to the core again
                if weight is not None:
                    task.weight = weight
                assert_same_qp(controller, here)
                if weight is not None:
                    task.set_target(*target)
                    task.weight = 1.0  # nobody saw it at rest
    described = [rows for task in tasks if task is not silent for rows in task.native()]
    assert all(rows.moving for rows in described)


def test_a_target_that_stops_after_a_weight_was_set(native, rng) -> None:
    """Rest is one and the same array whenever it is told: it was written, and written over."""
    robot = native("hoap2_like")
    here = robot.snapshot(*random_state(robot, rng))
    com = ComTask(robot, here.com)
    controller = controller_of(robot, [com, PostureTask(robot, here.q)])
    controller.step(here)
    com.set_target(here.com + 0.1)
    assert_same_qp(controller, here)
    com.set_target(here.com, [1.0, 2.0, 3.0])
    com.weight = 2.0
    assert_same_qp(controller, here)
    com.set_target(here.com)
    assert_same_qp(controller, here)


def test_margins_are_added_to_the_cores_qp(native) -> None:
    """Until they hold the robot, soft ones too, and pushed out of one by a cost that outweighs."""
    robot = native("hoap2_like")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    margins, nv = SelfCollision(robot, margin=0.03), robot.nv
    for soft in (False, True):
        q, v, active = robot.posture("standing"), np.zeros(nv), 0
        controller = with_margins(robot, here, margins, -0.005, soft)
        for _ in range(40):
            tick = assert_same_tick(controller, robot.snapshot(q, v))
            active += len(tick.active)
            v = tick.velocity
            q = robot.integrate(q, v, controller.dt)
        assert active > 10
        assert bool(tick.slack) == soft
    higher = with_margins(robot, here, margins, 0.01, soft=False)
    pushed = assert_same_tick(higher, robot.snapshot(q, v))
    assert np.linalg.eigvalsh(pushed.qp.P - tick.qp.P[:nv, :nv])[-1] > 1.0


def test_a_qp_lasts(native, rng) -> None:
    robot = native("hoap2_like")
    snapshot = robot.snapshot(*random_state(robot, rng))
    controller = controller_of(robot, every_task(robot, rng, snapshot))
    qp = controller._native.problem(snapshot).qp
    kept = {field: getattr(qp, field).copy() for field in FIELDS}
    controller._native.problem(robot.snapshot(*random_state(robot, rng)))
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(qp, field), kept[field])


def test_what_the_core_does_not_know_is_left_to_python(native, rng) -> None:
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    com, posture = ComTask(robot, here.com), PostureTask(robot, q, weight=0.1)
    limits, contacts = Limits(robot), support(here, "double")
    assert controller_of(robot, [com, posture], contacts)._native is not None
    second = InertiaTask(robot, here.inertia, second_order=True)
    low = PostureTask(robot, q, priority=1)
    for tasks in (
        [com, second],
        [com, low],
        [ComTask(robot, here.com, singular_threshold=0.1), posture],
    ):
        controller = controller_of(robot, tasks, contacts)
        assert controller._native is None, tasks
        assert controller.step(here).ok
    for options in (
        {"limits": Limits(robot, braking="bounded")},
        {"slack": {"left_sole": 10.0}},
    ):
        assert controller_of(robot, [com, posture], contacts, **options)._native is None
    # Later changes are noticed too.
    controller = controller_of(robot, [com, posture], contacts, limits=limits)
    assert controller._native.problem(here) is not None
    com.singular_threshold = 0.1
    assert controller._native.problem(here) is None
    com.singular_threshold = 0.0
    assert controller._native.problem(here) is not None
    limits.braking = "bounded"
    assert not controller._native.serves(controller.limits, controller.dt)
    assert controller.step(here).ok


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_limits_assigned_later_are_the_cores_too(level, native) -> None:
    """Whoever slows a robot down shall not get ticks that take four times as long."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"), 1e-3 * np.ones(robot.nv))
    limits = Limits(robot)
    there = robot.integrate(here.q, 0.2 * np.ones(robot.nv), 1.0)
    posture = PostureTask(robot, robot.limits.clamped(there), gain=0.5)
    contacts = support(here, "double")
    controller = level(robot, [posture], contacts=contacts, limits=limits, solver="active_set")
    before = controller.step(here)
    for name, factor in (("acceleration", 0.1), ("speed", 1e-3), ("speed", 2.0)):
        setattr(limits, name, factor * getattr(limits, name))
        assert controller._native.serves(controller.limits, controller.dt)
        assert_same_qp(controller, here)
        tick = controller.step(here)
        assert not np.array_equal(tick.qp.upper, before.qp.upper)
        before = tick


def test_states_that_are_handed_back(native, rng) -> None:
    """A joint outside its limits, an orientation half a turn away: Python's answer is given."""
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    posture = PostureTask(robot, q, weight=0.1)
    outside = q.copy()
    k = robot.joint_names.index("left_knee_joint")
    outside[7 + k] = robot.limits.upper[k] + 0.01
    half = here.rotation("torso_link") @ exp_rotation(np.array([0.0, 0.0, np.pi - 1e-3]))
    turn = OrientationTask(robot, "torso_link", half, weight=0.1)
    for tasks, state in (([posture], outside), ([posture, turn], q)):
        controller, snapshot = controller_of(robot, tasks), robot.snapshot(state)
        assert controller._native.problem(snapshot) is None
        tick, plain = controller.step(snapshot), Controller._step(controller, snapshot)
        assert tick.ok
        np.testing.assert_array_equal(tick.velocity, plain.velocity)
    # At the limit to 1e-9 a joint is not outside.
    outside[7 + k] = robot.limits.upper[k] + 1e-10
    assert controller_of(robot, [posture])._native.problem(robot.snapshot(outside)) is not None


def test_a_qp_without_solution_is_judged_by_the_python_tick(native) -> None:
    """Two contacts ask one link to be in two places: the rows in conflict are named as ever."""
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    R, p = here.rotation("left_sole"), here.position("left_sole")
    contacts = [
        Contact(robot, "left_sole", p, R),
        Contact(robot, "left_ankle_roll_link", here.position("left_ankle_roll_link") + 0.1, R),
    ]
    controller = controller_of(robot, [PostureTask(robot, q)], contacts)
    assert controller._native.problem(here) is not None
    tick = controller.step(here)
    assert not tick.ok
    assert "left_sole" in tick.report()
    np.testing.assert_array_equal(tick.velocity, np.zeros(robot.nv))


def test_the_same_bits_twice(native, rng) -> None:
    robot = native("talos")
    snapshot = robot.snapshot(*random_state(robot, rng))
    tasks = every_task(robot, rng, snapshot)
    again = robot.snapshot(snapshot.q, snapshot.v)
    found = [controller_of(robot, tasks)._native.problem(one) for one in (snapshot, again)]
    for field in FIELDS:
        np.testing.assert_array_equal(*(getattr(one.qp, field) for one in found))


# ---------------------------------------------------------------------- solved in the core


def solved(controller: KinematicController, snapshot: Snapshot) -> NativeProblem:
    found = controller._native.problem(snapshot)
    assert found is not None
    assert found.solution is not None
    return found


@pytest.mark.parametrize("name", ROBOTS)
def test_the_answer_is_daqps_and_its_residuals_are_ours(name: str, native) -> None:
    """Limits active on the base and on joints; contacts with rows that depend on each other too."""
    robot = native(name)
    rng = np.random.default_rng(3)
    backend, active = ActiveSet(), 0
    for k in range(20):
        snapshot = robot.snapshot(*random_state(robot, rng))
        frames = [robot.frame_names[i] for i in rng.integers(1, len(robot.frame_names), size=2)]
        contacts = [Contact.hold(snapshot, frame) for frame in dict.fromkeys(frames[: k % 3])]
        limits = Limits(robot, base_twist=0.2 * np.ones(6)) if k % 2 else Limits(robot)
        there = robot.snapshot(*random_state(robot, rng))
        tasks = [
            ComTask(robot, snapshot.com + 0.02 * rng.normal(size=3), weight=10.0),
            InertiaTask(robot, there.inertia, per_mass=True, weight=3.0),
            PostureTask(robot, there.q, weight=0.3, gain=0.05),
        ]
        controller = controller_of(robot, tasks, contacts, limits=limits)
        found = controller._native.problem(snapshot)
        expected = backend.solve(found.qp)
        if found.solution is None:  # left to Python, which finds rows in conflict or solves it
            assert len(contacts) == 2
            continue
        ours = found.solution
        assert expected.solved
        # Damping 1e-6 beside weights of 10: what is left undetermined is a part in 1e7.
        scale = max(1.0, np.abs(expected.x).max())
        np.testing.assert_allclose(ours.x, expected.x, rtol=0.0, atol=1e-6 * scale)
        theirs = kkt_residuals(found.qp, ours.x, ours.y, ours.z, ours.z_box)
        for field in ("primal", "dual", "complementarity"):
            a, b = getattr(ours.residuals, field), getattr(theirs, field)
            assert a == pytest.approx(b, abs=1e-10)
            assert a <= backend.eps
        active += np.count_nonzero(np.abs(ours.z_box) > 1e-6)
    assert active > 20


def test_a_solution_that_is_not_good_enough_is_left_to_python(native, monkeypatch) -> None:
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    tasks = [ComTask(robot, here.com + 0.01), PostureTask(robot, q, weight=0.1)]
    controller = controller_of(robot, tasks, support(here, "double"))
    plan = controller._native
    for eps in (0.0, np.nan):  # of which no residual is below
        plan.memory.struct.eps = eps
        assert plan.problem(here).solution is None
        assert controller.step(here).ok  # solved by the backend
    plan.memory.struct.eps = controller.backend.eps
    assert plan.problem(here).solution is not None


def test_dependent_contacts_are_not_solved_in_the_core(native) -> None:
    """Two tasks hold the same rows: there is no pivot for the second."""
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    held = [
        PositionTask(robot, "left_sole", here.position("left_sole"), name=name) for name in "ab"
    ]
    controller = controller_of(robot, [PostureTask(robot, q)], held)
    assert controller._native.problem(here).solution is None
    assert controller.step(here).ok


def test_only_solvers_as_they_are_answer_the_core(native) -> None:
    class Other(ActiveSet):
        """Its answers may be anything."""

    class OtherProxQP(ProxQP):
        """So may this one's."""

    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture())
    tasks = [PostureTask(robot, here.q)]
    for options in (
        {"solver": "proxqp_cold"},
        {"solver": Other()},
        {"solver": OtherProxQP()},
        {"solver": ActiveSet(eps=1e-5)},  # may leave limits by more than a command may
        {"solver": ProxQP(eps=1e-5)},
        {"solver": "active_set", "formulation": "reduced"},
    ):
        assert controller_of(robot, tasks, **options)._native.problem(here).solution is None
    assert solved(controller_of(robot, tasks), here).solution.solver == "cholesky"


def test_settings_of_the_backend_are_kept(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture())
    tasks = [ComTask(robot, here.com + 0.1, weight=100.0), PostureTask(robot, here.q)]
    limits = Limits(robot, base_twist=0.1 * np.ones(6))
    whole = solved(controller_of(robot, tasks, limits=limits), here).solution
    assert whole.iterations > 2
    for most, there in ((whole.iterations - 1, False), (whole.iterations + 1, True)):
        few = controller_of(robot, tasks, limits=limits, solver=ActiveSet(max_iterations=most))
        assert (few._native.problem(here).solution is not None) == there


# ---------------------------------------------------------------------- copies and threads


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_have_memory_of_their_own(how, native, rng) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(*random_state(robot, rng))
    controller = controller_of(robot, every_task(robot, rng, here), support(here, "double"))
    before = controller.step(here).velocity
    other = how(controller)
    twin = other.robot.snapshot(here.q, here.v)
    other.tasks[3].gain = 0.1
    assert np.abs(other.step(twin).velocity - before).max() > 1e-3
    np.testing.assert_array_equal(controller.step(here).velocity, before)
    again = how(here)
    assert again.native_state is None  # it is worked out by Pinocchio
    np.testing.assert_allclose(again.inertia_jacobian, here.inertia_jacobian, atol=1e-12)
    np.testing.assert_allclose(again.jacobian("left_hand"), here.jacobian("left_hand"), atol=1e-12)


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_tick_that_nobody_has_read_keeps_its_evidence(how, native) -> None:
    """Copied before it is read, and read after its targets and another tick have come."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    com = ComTask(robot, here.com + 0.01)
    momentum = MomentumTask(robot, np.ones(6), weight=0.1)
    tasks = [com, momentum, PostureTask(robot, here.q)]
    controller = controller_of(robot, tasks, support(here, "double"))
    expected = Controller._step(controller, here)
    tick = controller.step(here)
    twin = how(tick)
    com.set_target(here.com)
    momentum.set_target(np.zeros(6))
    controller.step(here)
    for one in (tick, twin):
        assert type(one) is Tick
        assert one.times.total > 0.0
        assert one.solution.solved
        np.testing.assert_allclose(one.qp.g, expected.qp.g, atol=1e-10)
        np.testing.assert_allclose(one.solution.x, tick.velocity, rtol=0.0, atol=0.0)
        for name, error in expected.errors.items():
            np.testing.assert_allclose(one.errors[name], error, atol=1e-12)
    with pytest.raises(AttributeError, match="no attribute 'velocities'"):
        _ = tick.velocities


def test_threads_may_share_a_controller(native, rng) -> None:
    robot = native("hoap2_like")
    states = [robot.snapshot(*random_state(robot, rng)) for _ in range(20)]
    controller = controller_of(robot, every_task(robot, rng, states[0]))
    expected = [controller.step(state).velocity for state in states]
    wrong: list[object] = []

    def run(first: int) -> None:
        for k in 10 * [*range(first, 20), *range(first)]:
            try:
                if not np.array_equal(controller.step(states[k]).velocity, expected[k]):
                    wrong.append(k)
            except Exception as error:  # an exception in a thread would only be printed
                wrong.append(error)

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=run, args=(first,)) for first in (0, 7, 13)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    assert not wrong


@pytest.mark.parametrize("moving", [True, False])
def test_position_limits_hold_where_speed_and_acceleration_have_none(moving, native, rng) -> None:
    """The box is that of Python: at 10 mrad from a limit and anywhere, from rest and in motion."""
    robot = native("g1_27")
    q = robot.posture("standing")
    limits = Limits(robot, velocity=None)
    assert np.isinf(limits.speed).all() and np.isinf(limits.acceleration).all()
    far = PostureTask(
        robot, robot.limits.clamped(robot.integrate(q, rng.normal(size=robot.nv), 1.0))
    )
    controller = controller_of(robot, [far], limits=limits)
    near = q.copy()
    near[7:] = robot.limits.upper - 0.01
    for k in range(20):
        state = near if k == 0 else random_state(robot, rng)[0]
        here = robot.snapshot(state, rng.normal(size=robot.nv) if moving else None)
        found = controller._native_problem(controller._native, here)
        if found is None:  # outside its limits
            continue
        lower, upper = limits.box(here, controller.dt)
        np.testing.assert_allclose(found.qp.lower, lower, rtol=1e-12)
        np.testing.assert_allclose(found.qp.upper, upper, rtol=1e-12)
        reached = robot.integrate(state, controller.step(here).velocity, controller.dt)
        assert limits.signed_distance(robot.snapshot(reached)).min() > -1e-9


def test_copies_keep_what_the_plan_was_made_with(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    box = PositionBox(robot, "left_palm", [-1, -1, -1], [1, 1, 1])
    tasks = [ComTask(robot, here.com), PostureTask(robot, here.q)]
    shared = controller_of(robot, tasks, support(here, "double"), constraints=[box])
    assert shared.native.shares_state
    for one in (pickle.loads(pickle.dumps(shared)), copy.deepcopy(shared)):
        assert one.native.shares_state
