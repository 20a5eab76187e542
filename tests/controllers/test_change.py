"""A controller that is given other parts: as one made of them, but for what it remembers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import wbc
from wbc.controllers import Controller
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Snapshot


def made(level: str, parts: Mapping[str, Any], solver: str = "daqp") -> Controller:
    parts = {"contacts": (), **parts}
    robot = parts["tasks"][0].robot
    kind = wbc.TorqueController if level == "torque" else wbc.KinematicController
    tasks = parts.pop("tasks")
    return kind(robot, tasks, limits=wbc.Limits(robot), solver=solver, dt=0.002, **parts)


def before(here: Snapshot) -> dict[str, Any]:
    robot = here.robot
    return {
        "tasks": [wbc.ComTask(robot, here.com, weight=10.0), wbc.PostureTask(robot, here.q)],
        "contacts": wbc.support(here, "double"),
        "constraints": [wbc.ComSupport.over(here, ["left", "right"])],
        "slack": {},
    }


def after(here: Snapshot) -> dict[str, Any]:
    """Another task, another order, one foot, a margin of that foot alone that may give way."""
    robot = here.robot
    aside = here.com + [0.0, 0.02, -0.01]
    return {
        "tasks": [
            wbc.PostureTask(robot, here.q, weight=0.5),
            wbc.OrientationTask(robot, "base", here.rotation("base"), weight=3.0, name="base"),
            wbc.ComTask(robot, aside, weight=20.0, priority=1),
        ],
        "contacts": wbc.support(here, "left"),
        "constraints": [wbc.ComSupport.over(here, ["left"], margin=0.0)],
        "slack": {"com support": 50.0},
    }


@pytest.mark.parametrize("solver", ["daqp", "proxqp"])
@pytest.mark.parametrize("level", ["velocity", "torque"])
def test_it_answers_as_one_made_of_the_new_parts(level: str, solver: str, here: Snapshot) -> None:
    """Without ramps; both solve to 1e-6 of their rows, which are dv / dt: 500 times as much."""
    no_ramp = {"force_ramp": 0.0} if level == "torque" else {}
    changed = made(level, {**before(here), **no_ramp}, solver)
    assert changed.step(here).ok
    changed.change(**after(here))
    fresh = made(level, {**after(here), **no_ramp}, solver)
    ours, theirs = changed.step(here), fresh.step(here)
    assert ours.ok and theirs.ok, (ours.report(), theirs.report())
    assert list(ours.errors) == list(theirs.errors) == ["posture", "base", "com"]
    assert ours.qp.labels == theirs.qp.labels
    np.testing.assert_array_equal(ours.qp.P, theirs.qp.P)
    np.testing.assert_array_equal(ours.qp.C, theirs.qp.C)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, atol=1e-5)


def test_what_is_left_out_stays(here: Snapshot) -> None:
    controller = made("velocity", before(here))
    task = wbc.PostureTask(here.robot, here.q, name="calm")
    kept = controller.contacts, controller.constraints
    controller.change(tasks=[task])
    assert controller.tasks == (task,)
    assert (controller.contacts, controller.constraints) == kept
    with pytest.raises(InvalidInputError, match="contacts"):
        controller.set_contacts(None)  # type: ignore[arg-type]  # which is no word for staying
    controller.change(constraints=[])
    assert controller.constraints == () and controller.contacts == kept[0]
    assert list(controller.step(here).errors) == ["calm"]


def test_forces_go_on_where_tasks_change_with_the_contacts(here: Snapshot) -> None:
    """The foot that is left out is relieved linearly in 10 ticks from what it bore."""
    controller = made("torque", {**before(here), "constraints": [], "force_ramp": 0.02})
    load = controller.step(here).forces["right_sole"][2]
    assert load > 0.3 * here.robot.weight
    controller.change(tasks=after(here)["tasks"], contacts=wbc.support(here, "left"))
    bounds = []
    for _ in range(10):
        tick = controller.step(here)
        assert tick.ok, tick.report()
        bounds.append(tick.ramps.get("right_sole", 0.0))
        found = tick.forces.get("right_sole", np.zeros(6))[2]
        assert found <= bounds[-1] + 1e-6 * load
    np.testing.assert_allclose(bounds, load * (1.0 - np.arange(1, 11) / 10), atol=1e-9 * load)
    assert set(tick.forces) == {"left_sole"}


@pytest.mark.parametrize(
    ("parts", "error", "words"),
    [
        ({"tasks": []}, InvalidInputError, "no task given"),
        ({"tasks": "posture"}, InvalidInputError, "tasks: expected a list"),
        ({"constraints": [3]}, InvalidInputError, "constraints"),
        ({"slack": {"com suport": 1.0}}, UnknownNameError, "com suport"),
        ({"slack": {"com support": -1.0}}, InvalidInputError, "slack of 'com support'"),
        ({"slack": 3.0}, InvalidInputError, "slack: expected weights by name"),
    ],
)
@pytest.mark.parametrize("level", ["velocity", "torque"])
def test_what_is_refused_changes_nothing(level, parts, error, words, here) -> None:
    controller = made(level, before(here))
    first = controller.step(here)
    with pytest.raises(error, match=words):
        controller.change(contacts=wbc.support(here, "left"), **parts)
    again = controller.step(here)
    np.testing.assert_array_equal(again.velocity, first.velocity)
    assert again.qp.labels == first.qp.labels


def test_idle_and_foreign_tasks_are_refused(here: Snapshot) -> None:
    robot, controller = here.robot, made("velocity", before(here))
    idle = wbc.ComTask(robot, here.com, weight=0.0)
    share = wbc.LoadShareTask(robot, {"left_sole": 1.0, "right_sole": 1.0})
    for task, words in ((idle, "no weight"), (share, "about forces")):
        with pytest.raises(InvalidInputError, match=words):
            controller.change(tasks=[task])
    assert len(controller.tasks) == 2 and controller.step(here).ok


def test_a_change_that_is_refused_changes_nothing(here: Snapshot) -> None:
    """Where forces act on a palm is not known: the feet were being released, and tasks new."""
    controller = made("torque", before(here))
    wanted = controller.step(here)
    palm, aside = wbc.Contact.hold(here, "left_palm"), wbc.ComTask(here.robot, here.com + 0.1)
    tasks, contacts = controller.tasks, controller.contacts
    for refused in (
        lambda: controller.set_contacts([palm]),
        lambda: controller.change(tasks=[aside], contacts=[palm]),
    ):
        with pytest.raises(InvalidInputError, match="where its forces act is not known"):
            refused()
        assert controller.tasks == tasks and controller.contacts == contacts
        tick = controller.step(here)
        assert not tick.ramps
        np.testing.assert_allclose(tick.torque, wanted.torque, atol=1e-8)
