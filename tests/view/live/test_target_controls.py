"""The controls of targets and weights: the user's stand over those of others, and can be reset."""

import numpy as np
import pytest

import wbc
from wbc.robot import Robot
from wbc.view.live.messages import Release, SetTarget, SetWeight
from wbc.view.live.target_controls import TargetControls


@pytest.fixture
def controller(hoap2: Robot) -> wbc.KinematicController:
    start = hoap2.snapshot(hoap2.posture("standing"))
    hand = hoap2.frame_names[-1]
    tasks = [
        wbc.ComTask(hoap2, start.com, weight=10.0),
        wbc.PoseTask(hoap2, hand, start.position(hand), start.rotation(hand), name="hand"),
        wbc.InertiaTask(hoap2, start.inertia, weight=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
    ]
    return wbc.KinematicController(hoap2, tasks, contacts=wbc.support(start, "double"))


def test_targets_are_set_and_given_back(controller: wbc.KinematicController) -> None:
    com, hand, _ = controller.tasks
    before, wanted = com.target, com.target + 0.01
    place, turn = hand.position, hand.rotation
    steering = TargetControls()
    assert not steering
    steering.receive(SetTarget("com", (wanted,)), controller)
    steering.receive(SetTarget("hand", (place + 0.1, np.eye(3))), controller)
    assert steering
    np.testing.assert_array_equal(com.target, wanted)
    np.testing.assert_array_equal(hand.position, place + 0.1)
    np.testing.assert_array_equal(hand.rotation, np.eye(3))
    for _ in range(3):
        steering.apply(controller)
    steering.receive(Release(), controller)
    assert not steering
    np.testing.assert_array_equal(com.target, before)
    np.testing.assert_array_equal(hand.position, place)
    np.testing.assert_array_equal(hand.rotation, turn)


def test_the_user_stands_over_a_ramp_which_goes_on_underneath(controller) -> None:
    com, steering = controller.tasks[0], TargetControls()
    wanted, start = com.target + 0.05, com.target
    steering.receive(SetTarget("com", (wanted,)), controller)
    for tick in range(1, 4):
        com.set_target(start + 0.001 * tick)  # what a ramp does before each tick
        steering.apply(controller)
        np.testing.assert_array_equal(com.target, wanted)
    steering.receive(Release(), controller)
    np.testing.assert_allclose(com.target, start + 0.003, rtol=0, atol=1e-15)


def test_weights_are_factors_that_do_not_pile_up(controller: wbc.KinematicController) -> None:
    inertia, steering = controller.tasks[2], TargetControls()
    before = inertia.weight
    for factor in (0.1, 10.0):
        steering.receive(SetWeight("inertia", factor), controller)
        for _ in range(3):
            steering.apply(controller)
        np.testing.assert_allclose(inertia.weight, factor * before, rtol=1e-15)
    inertia.weight = 2.0 * before  # a phase changes it
    steering.apply(controller)
    np.testing.assert_allclose(inertia.weight, 20.0 * before, rtol=1e-15)
    steering.receive(Release(), controller)
    np.testing.assert_array_equal(inertia.weight, 2.0 * before)


def test_what_a_task_refuses_is_dropped_and_said(controller: wbc.KinematicController) -> None:
    hand, steering = controller.tasks[1], TargetControls()
    turn = hand.rotation
    steering.receive(SetTarget("hand", (hand.position, np.ones((3, 3)))), controller)
    assert "task 'hand', rotation" in steering.refusal
    assert hand.rotation is turn
    assert not steering
    steering.receive(SetTarget("nobody", (turn,)), controller)  # of a phase that is over
    assert not steering.refusal
