"""Tasks that the core works out: derived from, held, changed, or asked of another robot."""

import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import Contact, Limits, PointContact, support
from wbc.constraints.margin import Margin
from wbc.constraints.rows import Distances
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError
from wbc.laws import Residual
from wbc.qp import kkt_residuals
from wbc.tasks import (
    ComTask,
    CopTask,
    InertiaTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    RelativePoseTask,
    Task,
    TorqueTask,
)

DT = 0.002
FRAME = "left_hand"
DAMPING = 1e-6


def test_snapshot_of_another_robot_is_refused(hoap2, g1) -> None:
    there = g1.snapshot(g1.posture("standing"))
    tasks = PostureTask(hoap2, hoap2.posture("standing")), InertiaTask(hoap2, np.eye(3))
    asked = [ask for task in tasks for ask in (task.residual, task.drift)]
    for ask in (*asked, lambda s: Limits(hoap2).box(s, DT)):
        with pytest.raises(InvalidInputError, match="the snapshot is of another robot, 'g1"):
            ask(there)


class Own(Contact):
    """Asked in Python, for the same."""

    def residual(self, snapshot):
        return super().residual(snapshot)


@pytest.mark.parametrize("slack", [{}, {"left_sole": 1e3}])
def test_contact_of_ones_own_bears_what_a_contact_does(hoap2, here, slack) -> None:
    ticks = []
    for kind in (Contact, Own):
        held = [kind.hold(here, f"{side}_sole") for side in ("left", "right")]
        tasks = [PostureTask(hoap2, here.q), CopTask(hoap2, here.com[:2], weight=0.1)]
        ticks.append(TorqueController(hoap2, tasks, contacts=held, slack=slack, dt=DT).step(here))
    assert ticks[0].ok
    np.testing.assert_allclose(ticks[1].torque, ticks[0].torque, atol=1e-6)
    np.testing.assert_allclose(ticks[1].errors["cop"], ticks[0].errors["cop"], atol=1e-6)


class TorqueOfMyOwn(TorqueTask):
    """Asked in Python, for the same; it asks for the dynamics before the QP is set up."""

    def expression(self, dynamics):
        return super().expression(dynamics)


def test_contact_of_ones_own_bears_at_the_frame_that_it_is_given_later(hoap2, here) -> None:
    """It pushes with a hand at first; both feet stand."""
    found = []
    for later in (False, True):
        place, level = here.position("left_sole"), here.rotation("left_sole")
        frame = "left_hand" if later else "left_sole"
        own = Own(hoap2, frame, place, level, corners=[[0.02, 0.02], [0.02, -0.02], [-0.02, 0.0]])
        held = [own, Contact.hold(here, "right_sole")]
        tasks = [PostureTask(hoap2, here.q), TorqueOfMyOwn(hoap2)]
        controller = TorqueController(hoap2, tasks, contacts=held, dt=DT, solver="active_set")
        if later:
            controller.step(here)
            own.frame = "left_sole"
        found.append(controller.step(here))
    assert found[0].policy is None
    np.testing.assert_allclose(found[1].torque, found[0].torque, atol=1e-9)


def in_python(kind: type[Task]) -> type[Task]:
    """Return a kind of task that is asked in Python, for the same."""
    return type(kind.__name__, (kind,), {"residual": kind.residual})


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
@pytest.mark.parametrize("seed", range(6))
def test_tasks_asked_in_python_command_what_those_of_the_core_do(hoap2, level, seed) -> None:
    """Of any law, with rows left out, about moving targets, and changed between two ticks."""
    ticks = []
    for known in (True, False):
        rng = np.random.default_rng(seed)
        here = hoap2.snapshot(hoap2.posture("standing"), 0.02 * rng.normal(size=hoap2.nv))
        goal = hoap2.integrate(here.q, 0.05 * rng.normal(size=hoap2.nv), 1.0)
        there = hoap2.snapshot(goal)
        made = {
            ComTask: (there.com,),
            PositionTask: ("left_hand", there.position("left_hand")),
            PoseTask: ("right_hand", there.position("right_hand"), there.rotation("right_hand")),
            InertiaTask: (there.inertia,),
            PostureTask: (goal,),
        }
        tasks = []
        for kind, given in made.items():
            law = {
                "gain": rng.uniform(0.05, 0.9),
                "kp": rng.uniform(5.0, 200.0),
                "weight": rng.uniform(0.2, 3.0),
                "weighs_error": bool(rng.random() < 0.5),
                "curvature_damping": bool(rng.random() < 0.7),
                "lm_damping": rng.choice([0.0, 0.1]),
                "singular_threshold": rng.choice([0.0, 0.05]),
            }
            if kind is InertiaTask:
                law["second_order"] = bool(rng.random() < 0.5)
            task = (kind if known else in_python(kind))(hoap2, *given, **law)
            if kind in (ComTask, PositionTask, PoseTask):
                k = len(task.rows)
                task.weight = rng.uniform(0.5, 2.0, k) * (rng.random(k) < 0.8)
            if kind in (ComTask, PositionTask):
                task.set_target(given[-1], *0.1 * rng.normal(size=(2, 3)))
            tasks.append(task)
        contacts, slack = support(here, "double"), {"left_sole": 1e2} if seed % 2 else {}
        controller = level(hoap2, tasks, contacts=contacts, slack=slack, dt=DT, solver="active_set")
        found = [controller.step(here)]
        tasks[seed % len(tasks)].gain = 0.3
        tasks[0].set_target(here.com, [0.1, 0.0, 0.0])
        found.append(controller.step(here))
        tasks[1].weight = 2.0
        found.append(controller.step(here))
        ticks.append(found)
    for ours, theirs in zip(*ticks, strict=True):
        assert ours.ok
        np.testing.assert_allclose(theirs.velocity, ours.velocity, atol=1e-7)


class MyCop(CopTask):
    """Nothing but a name."""


def test_derived_kind_of_task_is_what_it_is_derived_from(hoap2, here) -> None:
    held, posture = support(here, "double"), PostureTask(hoap2, here.q)
    torques = [
        TorqueController(hoap2, [posture, kind(hoap2, here.com[:2])], contacts=held, dt=DT)
        .step(here)
        .torque
        for kind in (CopTask, MyCop)
    ]
    np.testing.assert_array_equal(*torques)


def test_pose_task_damped_by_nothing_is_not_damped(hoap2, here) -> None:
    """A whole pose leaves no curvature out, whoever works it out: lm_damping alone is added."""
    goal = here.position("left_hand") + [0.02, 0.01, 0.03]
    found = []
    for damping in (0.0, 1e-12):
        task = PoseTask(hoap2, "left_hand", goal, here.rotation("left_hand"), lm_damping=damping)
        found.append(KinematicController(hoap2, [task], contacts=()).step(here).velocity)
    np.testing.assert_allclose(*found, atol=1e-5)


def test_frame_that_a_pose_is_seen_from_may_be_changed(hoap2, here) -> None:
    task = RelativePoseTask(hoap2, "left_hand", "base", [0.1, 0.1, 0.1], np.eye(3))
    controller = KinematicController(hoap2, [task], contacts=())
    controller.step(here)
    task.relative_to = "right_hand"
    tick = controller.step(here)
    np.testing.assert_allclose(tick.errors[task.name], task.residual(here).error, atol=1e-12)


def test_tasks_may_be_added_while_others_are_off(hoap2, here) -> None:
    posture, com = PostureTask(hoap2, here.q), ComTask(hoap2, here.com)
    controller = KinematicController(hoap2, [posture, com], contacts=())
    com.switch_off()
    controller.change(tasks=[*controller.tasks, ComTask(hoap2, here.com, name="again")])
    assert controller.step(here).ok
    with pytest.raises(InvalidInputError, match="task 'idle' has no weight"):
        controller.change(tasks=[posture, ComTask(hoap2, here.com, name="idle", weight=0.0)])


@pytest.mark.parametrize("kind", [KinematicController, TorqueController])
def test_task_at_every_frame_fits_in_the_memory_of_a_tick(hoap2, here, kind) -> None:
    tasks = [PositionTask(hoap2, name, here.position(name)) for name in hoap2.frame_indices]
    tasks.append(InertiaTask(hoap2, 1.5 * here.inertia, second_order=True))
    point = PointContact(hoap2, "left_sole", here.position("left_sole"), np.eye(3))  # few unknowns
    assert kind(hoap2, tasks, contacts=[point]).step(here).ok


class Ordered(Task):
    """Keeps what it works out for its drift."""

    asked: list[str]

    def residual(self, snapshot):
        self.asked.append("r")
        return Residual(np.zeros(1), np.eye(1, self.robot.nv, 6), np.zeros(1))

    def drift(self, snapshot):
        self.asked.append("d")
        return np.zeros(1)


def test_residual_is_asked_before_drift(hoap2, here) -> None:
    task = Ordered(hoap2, "ordered", ("a",))
    task.asked = []
    contacts = support(here, "double")
    TorqueController(hoap2, [task], contacts=contacts, dt=DT).step(here)
    assert task.asked[:2] == ["r", "d"]


class Short(Margin):
    """Three rows, and one clearance."""

    def distances(self, snapshot, keys=None):
        return Distances(np.arange(3), np.ones(1), np.zeros((3, self.robot.nv)), None)

    def labels(self, distances):
        return ("a", "b", "c")

    def curvature_bound(self, distances, step):
        return np.zeros(3)


def test_what_is_of_other_sizes_is_refused(hoap2, here) -> None:
    with pytest.raises(InvalidInputError, match=r"'short': distances\(\), clearance"):
        Short(hoap2, "short", None).rows(here, DT)
    qp = KinematicController(hoap2, [PostureTask(hoap2, here.q)], contacts=()).step(here).qp
    none, n = np.zeros(0), qp.g.size
    with pytest.raises(InvalidInputError, match="x, y, z, z_box of a QP: expected shapes"):
        kkt_residuals(qp, np.zeros(n - 1), none, none, np.zeros(n))
    with pytest.raises(InvalidInputError):
        kkt_residuals(qp._replace(P=np.zeros((1, 1))), np.zeros(n), none, none, np.zeros(n))


@pytest.mark.parametrize("short", [1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_errors_and_rows_next_to_half_a_turn_are_log3(hoap2, rng, short, level) -> None:
    """About any axis, those of the frame too, by pi less a bit.

    Oracle: Pinocchio's log3, whose angle is an arc cosine there, and the rotation it was made of.
    """
    q = hoap2.integrate(hoap2.posture("standing"), 0.1 * rng.normal(size=hoap2.nv), 1.0)
    here = hoap2.snapshot(q)
    axes = [*np.eye(3), *-np.eye(3), *rng.normal(size=(4, 3))]
    for axis in axes:
        turn = (np.pi - short) * axis / np.linalg.norm(axis)
        R = here.rotation(FRAME)
        task = OrientationTask(hoap2, FRAME, R @ pin.exp3(-turn))
        tick = level(hoap2, [task], contacts=(), damping=DAMPING).step(here)
        error = tick.errors[task.name]
        relative = task.target.T @ R
        # The arc cosine of -1 + 1e-16 is 1e-8 off; the axis is known as well.
        np.testing.assert_allclose(error, pin.log3(relative), atol=1e-7)
        # To rounding of the rotations; beside an axis it is halved where it is squared.
        np.testing.assert_allclose(error, turn, atol=1e-12)
        own = here.rotation(FRAME).T @ here.jacobian(FRAME)[3:]
        J = pin.Jlog3(relative) @ own
        expected = J.T @ J + DAMPING * np.eye(hoap2.nv)
        P = tick.qp.P[: hoap2.nv, : hoap2.nv]
        np.testing.assert_allclose(P, expected, atol=1e-6 * np.abs(expected).max())
        assert np.isfinite(tick.velocity).all()
