"""What tasks hand to the native core: the numbers of the Python residual and drift, at rest."""

import numpy as np
import pytest

from tests.controllers.native_ticks import every_task
from wbc.constraints import Contact, PointContact
from wbc.native.rows import Kind
from wbc.robot import Robot
from wbc.tasks import PositionTask

EXACT = (Kind.POINT, Kind.INERTIA, Kind.JOINTS, Kind.MOMENTUM, Kind.LINEAR, Kind.CONTACT)


def test_bias_and_drift_are_those_of_the_python_path(robot: Robot, rng, random_snapshot) -> None:
    """At rest the drift is minus the target's acceleration; rotations hand over their motion."""
    moving = random_snapshot(robot, rng)
    here = robot.snapshot(moving.q, np.zeros(robot.nv))
    tasks = every_task(robot, rng, here)
    for kind in (Contact, PointContact):
        tasks.append(kind.hold(here, robot.frame_names[2]))
    place = PositionTask(robot, robot.frame_names[3], [0, 0, 0], axes=("z", "x"))
    place.set_target([0.1, 0.2, 0.3], *rng.normal(size=(2, 3)))
    seen = set()
    for task in [*tasks, place]:
        residual, drift = task.residual(here), task.drift(here)
        first = 0
        for rows in task.native():
            own = slice(first, first + len(rows.entries))
            first = own.stop
            seen.add(rows.kind)
            if rows.kind in EXACT:
                np.testing.assert_allclose(rows.bias, residual.bias[own], atol=1e-12)
                np.testing.assert_allclose(rows.drift, drift[own], atol=1e-9 * robot.mass)
                continue
            assert tuple(rows.entries) == (0, 1, 2) and not rows.bias.any()
            goal, rate, acceleration = rows.numbers
            turning = slice(None) if len(task.rows) == 3 else slice(3, 6)
            np.testing.assert_array_equal(rate, task.target_rate[turning])
            np.testing.assert_array_equal(acceleration, task.target_acceleration[turning])
            wanted = task.target if len(task.rows) == 3 else task.rotation
            np.testing.assert_array_equal(goal, np.ravel(wanted))
        assert first == len(task.rows)
    assert {Kind.POINT, Kind.INERTIA, Kind.JOINTS, Kind.MOMENTUM, Kind.CONTACT} <= seen


@pytest.mark.parametrize("order", [0, 1])
def test_targets_may_stop(robot_named, rng, order: int) -> None:
    """A target that moved and rests again asks for nothing but its place."""
    robot = robot_named("hoap2_like")
    here = robot.snapshot(robot.posture())
    for task in every_task(robot, rng, here):
        if not hasattr(task, "position"):
            target = task.target
            if order:
                task.set_target(target)
            else:
                task.target = target
            momentum = task.name == "momentum"
            assert momentum == bool(task.residual(here).bias.any()), task
            assert not task.target_rate.any() and not task.target_acceleration.any()
