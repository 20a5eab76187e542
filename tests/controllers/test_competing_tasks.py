"""Tasks that keep each other from their targets: what gains and weights make of that."""

import logging

import numpy as np
import pytest

import wbc
from wbc.controllers.competing_tasks import competing_tasks
from wbc.laws import Residual
from wbc.robot import Robot

TICKS = 600


class Elbow(wbc.Task):
    """One joint at an angle, computed in Python."""

    def __init__(self, robot: Robot, angle: float, **gains: object) -> None:
        super().__init__(robot, f"elbow at {angle:g}", ("angle",), **gains)
        self.__dict__["angle"] = angle
        self.__dict__["column"] = 6 + robot.joint_names.index("left_elbow_pitch")

    def residual(self, snapshot):
        J = np.zeros((1, self.robot.nv))
        J[0, self.column] = 1.0
        return Residual(snapshot.q[[self.column + 1]] - self.angle, J, np.zeros(1))


def at_rest(robot: Robot, tasks: list[wbc.Task], ticks: int = TICKS):
    controller = wbc.KinematicController(robot, tasks, contacts=(), limits=wbc.Limits(robot))
    q, v = robot.posture("standing"), None
    for _ in range(ticks):
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity
        q = robot.integrate(q, v, controller.dt)
    return tick, q


def elbow(robot: Robot, q) -> float:
    return float(q[7 + robot.joint_names.index("left_elbow_pitch")])


def test_gains_act_as_weights_at_rest_and_weights_of_errors_do_not(hoap2) -> None:
    """Two goals of one joint, -0.2 (weight 1) and -1.2 (weight 2): a mean by w^2 g, or by w^2."""
    for options, mean in (({}, (0.02 * -0.2 + 4.0 * 0.5 * -1.2) / (0.02 + 4.0 * 0.5)),
                          ({"weighs_error": True}, (-0.2 + 4.0 * -1.2) / 5.0)):  # fmt: skip
        one = Elbow(hoap2, -0.2, gain=0.02, **options)
        other = Elbow(hoap2, -1.2, gain=0.5, weight=2.0, **options)
        _, q = at_rest(hoap2, [one, other])
        assert elbow(hoap2, q) == pytest.approx(mean, abs=1e-4)  # the damping of 1e-6, and time


def test_core_and_python_weigh_errors_alike(hoap2) -> None:
    """The same task of the core's own: a posture of one joint."""
    goal = hoap2.posture("standing")
    goal[7 + hoap2.joint_names.index("left_elbow_pitch")] = -0.2
    only = {"*": 1e-6, "left_elbow_pitch": 1.0}
    known = wbc.PostureTask(hoap2, goal, joints=only, gain=0.02, weighs_error=True)
    other = Elbow(hoap2, -1.2, gain=0.5, weight=2.0, weighs_error=True)
    _, q = at_rest(hoap2, [known, other])
    assert elbow(hoap2, q) == pytest.approx(-1.0, abs=1e-4)


def test_tasks_that_compete_at_other_gains_are_said_once(hoap2, caplog) -> None:
    with caplog.at_level(logging.WARNING):
        at_rest(hoap2, [Elbow(hoap2, -0.2, gain=0.1), Elbow(hoap2, -1.2, gain=0.5)])
    (said,) = [one.getMessage() for one in caplog.records]
    assert "'elbow at -0.2' (gain 0.1), 'elbow at -1.2' (gain 0.5)" in said
    assert "gains act as weights" in said


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"gain": 0.5}, {"gain": 0.5}),
        ({"gain": 0.1, "weighs_error": True}, {"gain": 0.5, "weighs_error": True}),
        ({"gain": 0.1, "priority": 1}, {"gain": 0.5}),
        ({"gain": 0.1, "weight": 1e-3}, {"gain": 0.5}),  # far too light to be heard
    ],
    ids=["one gain", "weights of errors", "two levels", "a light one"],
)
def test_tasks_that_do_not_compete_so_are_not_named(hoap2, one, other, caplog) -> None:
    at_rest(hoap2, [Elbow(hoap2, -0.2, **one), Elbow(hoap2, -1.2, **other)])
    assert not [record for record in caplog.records if "act as weights" in record.getMessage()]


def test_tasks_on_their_way_and_light_ones_are_not_named(hoap2) -> None:
    tasks = [Elbow(hoap2, -0.2, gain=0.1), Elbow(hoap2, -1.2, gain=0.5)]
    tick, _ = at_rest(hoap2, tasks, 3)
    here = hoap2.snapshot(hoap2.posture("standing"))
    assert np.abs(tick.velocity).max() > 0.1
    assert competing_tasks(tasks, here, tick.velocity, 0.005) == {}
    assert list(competing_tasks(tasks, here, np.zeros(hoap2.nv), 0.005)) == [
        one.name for one in tasks
    ]
    # One that is lighter than a fiftieth of the heaviest has no part in it.
    tasks = [tasks[1], Elbow(hoap2, -0.7, gain=0.1, weight=1e-3)]
    assert competing_tasks(tasks, here, np.zeros(hoap2.nv), 0.005) == {}
    tasks[1].weight = 0.5
    assert len(competing_tasks(tasks, here, np.zeros(hoap2.nv), 0.005)) == 2
