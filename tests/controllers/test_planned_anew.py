"""What is assigned counts in the next tick, plans come back: a new controller is the oracle."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import wbc
from tests.standing import standing
from wbc.constraints import FrictionCone
from wbc.robot import Robot, Snapshot


class OwnLaw(wbc.VelocityLaw):
    """The same law, which the core does not know."""


class OwnAccelerationLaw(wbc.AccelerationLaw):
    """The same."""


def tasks_of(robot: Robot, start: Snapshot) -> list[wbc.Task]:
    hand = wbc.PositionTask(robot, "left_palm", start.position("left_palm") + [0.1, 0.0, 0.1])
    trunk = wbc.PoseTask(robot, "base", *pose(start), name="trunk", weight=2.0)
    return [hand, trunk, wbc.ComTask(robot, start.com), wbc.PostureTask(robot, start.q, weight=0.1)]


def pose(start: Snapshot) -> tuple[np.ndarray, np.ndarray]:
    return start.position("base") + [0.02, 0.0, 0.0], start.rotation("base")


# Which task, its attribute, and what is assigned to it.
CHANGES = {
    "damped": [(1, "lm_damping", 1e-3)],
    "damped in place of another": [(0, "lm_damping", 0.0), (1, "lm_damping", 1e-3)],
    "with laws of its own": [
        (2, "law", OwnLaw(gain=0.2)), (2, "acceleration_law", OwnAccelerationLaw(kp=30.0))],
    "near singular": [(0, "singular_threshold", 0.5)],
    "no longer singular": [(2, "singular_threshold", 0.0)],
    "at a lower priority": [(0, "priority", 1)],
    "accelerated": [],
}  # fmt: skip


def change(tasks: list[wbc.Task], name: str) -> None:
    for k, attribute, value in CHANGES[name]:
        setattr(tasks[k], attribute, value)
    if name == "accelerated":
        tasks[0].set_target(tasks[0].target, acceleration=[2.0, -1.0, 0.5])


@pytest.mark.parametrize("kind", [wbc.KinematicController, wbc.TorqueController])
@pytest.mark.parametrize("margin", [None, 0.005, 0.04])  # none, far, and in the way
@pytest.mark.parametrize("name", CHANGES)
def test_a_task_that_is_changed_commands_as_if_it_had_always_been_so(
    hoap2: Robot, kind: type[wbc.Controller], margin: float | None, name: str
) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    v = 0.1 * np.random.default_rng(1).standard_normal(hoap2.nv)
    moving = hoap2.snapshot(start.q, v)

    def controller(tasks: list[wbc.Task]) -> wbc.Controller:
        return kind(
            hoap2,
            tasks,
            contacts=wbc.support(start, "double"),
            limits=wbc.Limits(hoap2, acceleration=100.0),
            constraints=[wbc.SelfCollision(hoap2, margin=margin)] if margin else [],
            solver="active_set",
        )

    tasks, fresh = tasks_of(hoap2, start), tasks_of(hoap2, start)
    for one in (tasks, fresh):
        one[0].lm_damping = 1e-4 if name == "damped in place of another" else 0.0
        one[2].singular_threshold = 0.3 if name == "no longer singular" else 0.0
    changed = controller(tasks)
    before = changed.step(start)
    change(tasks, name)
    change(fresh, name)
    wanted = controller(fresh).step(moving)
    found = changed.step(moving)
    assert before.ok and found.ok and wanted.ok
    np.testing.assert_allclose(found.velocity, wanted.velocity, rtol=0.0, atol=1e-8)
    assert found.singular.keys() == wanted.singular.keys()
    assert found.qp.C.shape == wanted.qp.C.shape  # no margin's rows twice


def test_held_tasks_that_repeat_each_other_follow_new_targets(hoap2: Robot) -> None:
    """Only some of their rows are in the QP; the others hold with them."""
    start = hoap2.snapshot(hoap2.posture("standing"))
    steps = []
    for moved in (True, False):
        low = [0.0, 0.0, 0.01]
        tasks = [wbc.ComTask(hoap2, start.com - (not moved) * np.array(low), name=n) for n in "ab"]
        posture = wbc.PostureTask(hoap2, start.q)
        held = [*wbc.support(start, "double"), *tasks]
        controller = wbc.KinematicController(hoap2, [posture], contacts=held)
        if moved:
            assert controller.step(start).ok
            for task in tasks:
                task.set_target(start.com - low)
        steps.append(controller.step(start).velocity)
    np.testing.assert_allclose(*steps, atol=1e-9)
    assert np.abs(steps[0]).max() > 0.1


@pytest.mark.parametrize("slack", [{}, {"left_sole": 1e3}])
@pytest.mark.parametrize("before", [None, wbc.FrictionCone(0.8)])
def test_friction_that_is_assigned_counts_in_the_next_tick(hoap2, before, slack) -> None:
    """A grip that gets a cone pulls no more, and a contact that may give way has its cone, too."""
    start = hoap2.snapshot(hoap2.posture("standing"))
    after, torques = wbc.FrictionCone(0.6, most=20.0), []
    for first in (before, after):
        cones = zip(("left_sole", "right_sole"), (first, after), strict=True)
        soles = [wbc.Contact.hold(start, frame, friction=cone) for frame, cone in cones]
        tasks = [wbc.ComTask(hoap2, start.com + [0.0, 0.02, 0.0]), wbc.PostureTask(hoap2, start.q)]
        controller = wbc.TorqueController(hoap2, tasks, contacts=soles, slack=slack, force_ramp=0.0)
        controller.step(start)
        soles[0].friction = after
        torques.append(controller.step(start).torque)
    np.testing.assert_allclose(*torques, atol=1e-6)


def test_braking_that_is_assigned_counts_in_the_next_tick(hoap2: Robot) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    gently = wbc.BrakingParameters(deceleration=0.01, gain=0.01)

    def inwards(apart: wbc.SelfCollision) -> wbc.KinematicController:
        hand = wbc.PositionTask(hoap2, "left_palm", start.position("base"))
        return wbc.KinematicController(hoap2, [hand], contacts=(), constraints=[apart])

    apart = wbc.SelfCollision(hoap2)
    changed, fresh = inwards(apart), inwards(wbc.SelfCollision(hoap2, braking=gently))
    before, wanted = changed.step(start), fresh.step(start)
    apart.braking = gently
    np.testing.assert_allclose(changed.step(start).velocity, wanted.velocity, atol=1e-6)
    assert np.abs(before.velocity - wanted.velocity).max() > 0.1


def test_an_axis_that_is_assigned_is_the_one_that_is_given() -> None:
    """Of any length, as where the task is made."""
    robot = Robot.load("hoap2_like")
    start = robot.snapshot(robot.posture("standing"))
    given = wbc.AxisTask(robot, "head", [0.0, 0.1, 1.0], axis=[0.0, 0.3, 2.0])
    assigned = wbc.AxisTask(robot, "head", [0.0, 0.1, 1.0])
    assigned.axis = [0.0, 0.3, 2.0]
    for one, other in zip(assigned.residual(start)[:3], given.residual(start)[:3], strict=True):
        np.testing.assert_array_equal(one, other)


DT = 0.002
FEET = ("left_sole", "right_sole")
SETS = (FEET, FEET[::-1], FEET[:1], FEET[1:], ())


@pytest.fixture
def here(g1: Robot) -> Snapshot:
    return standing(g1)


def controlled(here: Snapshot, level: str, **more: object) -> wbc.Controller:
    robot = here.robot
    tasks: list[wbc.Task] = [
        wbc.ComTask(robot, here.com, weight=10.0),
        wbc.InertiaTask(robot, here.inertia, weight=1.0),
        wbc.PostureTask(robot, here.q, weight=0.3),
    ]
    make = wbc.TorqueController if level == "torque" else wbc.KinematicController
    contacts = [wbc.Contact.hold(here, frame) for frame in FEET]
    return make(robot, tasks, contacts=contacts, limits=wbc.Limits(robot), dt=DT, **more)


def test_contacts_that_come_back_are_not_planned_anew(here: Snapshot) -> None:
    controller = controlled(here, "torque", force_ramp=0.0)
    left, right = controller.contacts
    both = controller.core
    controller.set_contacts([left])
    alone = controller.core
    left.move_to(here)
    controller.set_contacts([left, right])
    assert controller.core is both
    controller.set_contacts([left])
    assert controller.core is alone
    for _ in range(10):  # new contacts beside them: those that come back stay known
        controller.set_contacts([wbc.Contact.hold(here, "right_sole")])
        controller.set_contacts([left, right])
        assert controller.core is both
    controller.change(tasks=controller.tasks[:2])
    controller.set_contacts([left, right])
    assert controller.core is not both
    assert copy.copy(controller).core is not controller.core


@pytest.mark.parametrize("level", ["velocity", "torque"])
def test_ticks_are_those_of_new_contacts(here: Snapshot, level: str) -> None:
    rng = np.random.default_rng(62)
    known, anew = (controlled(here, level, solver="active_set") for _ in range(2))
    held, cones = dict(zip(FEET, known.contacts, strict=True)), dict.fromkeys(FEET, FrictionCone())

    def changed() -> None:
        """Change something else than contacts, as users do between ticks."""
        what, k = rng.integers(6), int(rng.integers(3))
        weight, speed = rng.uniform(0.1, 10.0), rng.uniform(1.0, 9.0)
        frame = FEET[rng.integers(2)]
        cone = None if rng.uniform() < 0.3 else FrictionCone(rng.uniform(0.4, 0.9))
        for one in (known, anew):
            task = one.tasks[k]
            if what == 0:
                task.weight = weight
            elif what == 1:
                task.priority = 1 - task.priority if k else 0
            elif what == 2 and one.limits is not None:
                one.limits.speed = np.full(here.robot.nv - 6, speed)
            elif what == 3 and level == "torque":
                cones[frame] = held[frame].friction = cone
                for contact in anew.contacts:
                    if contact.name == frame:
                        contact.friction = cone

    for _ in range(60):
        changed()
        q = here.robot.integrate(here.q, 0.02 * rng.standard_normal(here.robot.nv), 1.0)
        now = here.robot.snapshot(q, 0.1 * rng.standard_normal(here.robot.nv))
        if rng.uniform() < 0.7:
            frames = SETS[rng.integers(len(SETS))]
            for frame in frames:
                held[frame].move_to(now)
            known.set_contacts([held[frame] for frame in frames])
            new = [wbc.Contact.hold(now, frame, friction=cones[frame]) for frame in frames]
            anew.set_contacts(new)
        one, other = known.step(now), anew.step(now)
        assert (one.status, one.policy) == (other.status, other.policy)
        np.testing.assert_array_equal(one.velocity, other.velocity)
        if isinstance(one, wbc.TorqueTick) and isinstance(other, wbc.TorqueTick):
            np.testing.assert_array_equal(one.torque, other.torque)
