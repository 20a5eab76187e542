"""Contacts that come back have the plan that was made for them, and the ticks of a new one."""

from __future__ import annotations

import copy

import numpy as np
import pytest

import wbc
from tests.standing import standing
from wbc.constraints import FrictionCone
from wbc.robot import Robot, Snapshot

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
