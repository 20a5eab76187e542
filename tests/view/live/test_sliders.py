"""Sliders ask for inertia, CoM and weights, and follow targets that others move."""

import numpy as np
import pytest

import wbc
from tests.view.live.conftest import Stage, client_of, frame_at
from wbc.spatial import vech
from wbc.view.live.messages import Release, SetTarget, SetWeight


@pytest.fixture
def controller(robot: wbc.Robot) -> wbc.KinematicController:
    start = robot.snapshot(robot.posture("standing"))
    tasks = [
        wbc.ComTask(robot, start.com, axes=["y", "z"]),
        wbc.InertiaTask(robot, start.inertia, name="shape"),
        wbc.InertiaTask(robot, start.inertia.trace(), components=["trace"], name="size"),
        wbc.PrincipalInertiaTask(robot, np.linalg.eigvalsh(start.inertia), name="moments"),
    ]
    return wbc.KinematicController(robot, tasks)


def test_what_sliders_ask_for(stage: Stage, controller: wbc.KinematicController) -> None:
    start = stage.show(controller)
    with client_of(stage.url) as client:

        def asked(label: str, value: float) -> SetTarget:
            stage.move_slider(client, label, value)
            found = stage.pipe.recv()
            assert isinstance(found, SetTarget)
            return found

        shape = asked("zz times", 1.5)
        assert shape.task == "shape"
        np.testing.assert_allclose(shape.target[0], vech(start.inertia) * [1, 1, 1, 1, 1, 1.5])
        size = asked("trace times", 0.8)
        assert size.target[0][[0, 3, 5]].sum() == pytest.approx(0.8 * start.inertia.trace())
        controller.tasks[2].set_target(size.target[0])  # type: ignore[attr-defined]
        moments = asked("largest times", 1.25)
        wanted = np.linalg.eigvalsh(start.inertia) * [1.0, 1.0, 1.25]
        np.testing.assert_allclose(moments.target[0], wanted)
        com = asked("y [mm]", -20.0)
        np.testing.assert_allclose(com.target[0], start.com - [0.0, 0.02, 0.0])
        stage.move_slider(client, "shape", -1.0)
        assert stage.pipe.recv() == SetWeight("shape", 0.1)


def test_sliders_follow_the_targets(stage: Stage, controller: wbc.KinematicController) -> None:
    start = stage.show(controller)
    assert stage.gui("xx times").value == 1.0
    controller.tasks[1].set_target(1.2 * start.inertia)  # type: ignore[attr-defined]
    controller.tasks[0].set_target(start.com + 0.03)  # type: ignore[attr-defined]
    stage.draw(frame_at(controller, start.q, 0.1))
    assert stage.gui("xx times").value == pytest.approx(1.2)
    assert stage.gui("z [mm]").value == pytest.approx(30.0)
    assert not stage.pipe.poll(0.1)  # the page moved them, not the user


def test_giving_back(stage: Stage, controller: wbc.KinematicController) -> None:
    stage.show(controller)
    with client_of(stage.url) as client:
        stage.move_slider(client, "shape", 1.0)
        assert stage.pipe.recv() == SetWeight("shape", 10.0)
        stage.move_slider(client, "Give targets and weights back", True)
        assert stage.pipe.recv() == Release()
    assert stage.gui("shape").value == 0.0


def test_another_controller_has_other_sliders(stage, controller) -> None:
    robot, q = controller.robot, stage.show(controller).q
    other = wbc.KinematicController(robot, [wbc.PostureTask(robot, q)])
    stage.show(other, time=0.1)
    assert not stage.gui("shape").visible
    assert stage.gui("posture").visible
    stage.show(controller, time=0.2)
    assert stage.gui("shape").visible
    assert not stage.gui("posture").visible
    with pytest.raises(IndexError):  # made once, and shown again
        stage.gui("shape", nth=1)
