"""What limits and margins ask of a joint that comes too fast: all that it can do, and no more."""

from collections.abc import Callable

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.reachable import BRAKING, MARGIN_BRAKING, reachable_limits, reachable_rows
from wbc.laws import Rows
from wbc.robot import Robot

DT = 0.002


def test_boxes_hold_what_braking_can_reach(robot_named: Callable[[str], Robot]) -> None:
    robot = robot_named("hoap2_like")
    v = np.zeros(robot.nv)
    v[6], v[7] = 3.0, -0.01
    box = np.full(robot.nv, -0.5), np.full(robot.nv, 0.5)
    recovery = Rows(np.eye(2, robot.nv, 6), np.array([-1.0, -0.02]), np.ones(2))
    acceleration = np.full(robot.nv - 6, 10.0)
    (lower, upper), found = reachable_limits(box, recovery, v, acceleration, DT)
    step = BRAKING * 10.0 * DT
    assert upper[6] == 3.0 - step  # braked as hard as it can be
    assert upper[7] == 0.5 and lower[7] == -0.5  # nothing to brake
    assert found is not None
    np.testing.assert_allclose(found.target, [3.0 - step, -0.02])


def test_a_joint_without_effort_limit_recovers_at_once(robot_named: Callable[[str], Robot]) -> None:
    robot = robot_named("hoap2_like")
    recovery = Rows(np.eye(2, robot.nv, 6), np.array([-1.0, -1.0]), np.ones(2))
    acceleration = np.full(robot.nv - 6, 10.0)
    acceleration[0] = np.inf
    v, box = np.zeros(robot.nv), (np.full(robot.nv, -1.0), np.full(robot.nv, 1.0))
    _, found = reachable_limits(box, recovery, v, acceleration, DT)
    assert found is not None
    np.testing.assert_allclose(found.target, [-1.0, -BRAKING * 10.0 * DT])


def test_margins_ask_for_what_braking_can_reach() -> None:
    v = np.array([-1.0, 0.0])
    push = Rows(np.eye(2), np.array([0.1, 0.01]), np.ones(2))
    bounds = Bounds(("a", "b"), np.eye(2), np.array([0.0, -0.1]), np.full(2, np.inf), push)
    found = reachable_rows(bounds, v, DT)
    change = MARGIN_BRAKING * DT
    np.testing.assert_allclose(found.lower, [-1.0 + change, -0.1])
    assert found.push is not None
    np.testing.assert_allclose(found.push.target, [-1.0 + change, 0.01])


def test_boxes_out_of_reach_end_where_reach_begins(robot_named: Callable[[str], Robot]) -> None:
    """Whatever the side: what is in reach is the box's, or else the reach's end next to it."""
    robot, rng = robot_named("hoap2_like"), np.random.default_rng(4)
    for _ in range(50):
        middle, half = rng.normal(size=robot.nv), rng.uniform(0.0, 0.5, robot.nv)
        v, acceleration = rng.normal(size=robot.nv), rng.uniform(1.0, 300.0, robot.nv - 6)
        (lower, upper), none = reachable_limits(
            (middle - half, middle + half), None, v, acceleration, DT
        )
        assert none is None
        np.testing.assert_array_equal(lower[:6], (middle - half)[:6])
        np.testing.assert_array_equal(upper[:6], (middle + half)[:6])
        for k in range(6, robot.nv):
            change = BRAKING * DT * acceleration[k - 6]
            least, most = v[k] - change, v[k] + change
            low, high = middle[k] - half[k], middle[k] + half[k]
            expected = (most, high) if low > most else (low, least) if high < least else (low, high)
            np.testing.assert_allclose((lower[k], upper[k]), expected, rtol=0.0, atol=1e-14)
