"""Joints outside their limits are moved back by costs that outweigh all tasks."""

import numpy as np
import pytest

from wbc.constraints import Limits
from wbc.controllers import KinematicController
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask

DT = 0.005
OUTWEIGHS = 1e4  # the heaviest of the tasks, squared


def beyond(robot: Robot, by: dict[str, float], v: np.ndarray | None = None) -> Snapshot:
    """Return the standing posture with joints beyond their upper (> 0) or lower (< 0) limits."""
    q = robot.posture("standing")
    joints = robot.limits.joint_positions(q).copy()
    step = np.zeros(robot.nv)
    for name, excess in by.items():
        k = robot.joint_index(name) - 6
        end = robot.limits.upper[k] if excess > 0.0 else robot.limits.lower[k]
        step[6 + k] = end + excess - joints[k]
    return robot.snapshot(robot.integrate(q, step, 1.0), np.zeros(robot.nv) if v is None else v)


@pytest.mark.parametrize("braking", ["free", "bounded"])
@pytest.mark.parametrize("levels", [1, 2])
def test_joints_outside_are_moved_back_as_limits_say(hoap2, rng, braking: str, levels: int) -> None:
    """Two of them, one so far that its speed bounds how fast: box, cost and command."""
    limits = Limits(hoap2, recovery=0.3, braking=braking)
    v = 0.05 * rng.normal(size=hoap2.nv)
    outside = {"left_knee_pitch": 1e-3, "right_elbow_pitch": -0.3}
    here = beyond(hoap2, outside, v)
    box, joints = limits.box(here, DT), [hoap2.joint_index(name) for name in outside]
    speed = limits.speed[joints[1] - 6]
    assert speed < 0.3 * 0.3 / DT
    target, M = np.array((-0.3 * 1e-3 / DT, speed)), np.eye(hoap2.nv)[joints]
    # At its target, so that no gain is lowered for it where braking is bounded.
    tasks = [PostureTask(hoap2, here.q, weight=3.0), ComTask(hoap2, here.com, priority=levels - 1)]
    qps, ticks = [], []
    for bounds in (limits, None):
        controller = KinematicController(hoap2, tasks, contacts=(), limits=bounds, dt=DT)
        qps.append(controller.core.tick(here, solve=False).qp_of(0))
        ticks.append(controller.step(here))
    assert ticks[0].ok, ticks[0].report()
    np.testing.assert_allclose(qps[0].lower, box[0], atol=1e-12)
    np.testing.assert_allclose(qps[0].upper, box[1], atol=1e-12)
    heaviest = 9.0  # a row of the posture: those of the CoM are shorter
    assert np.square(here.com_jacobian).sum(axis=1).max() < heaviest
    weight = OUTWEIGHS * heaviest
    np.testing.assert_allclose(qps[0].P - qps[1].P, weight * M.T @ M, atol=1e-9)
    np.testing.assert_allclose(qps[0].g - qps[1].g, -weight * target @ M, atol=1e-9)
    wanted = np.clip(target, box[0][joints], box[1][joints])
    # The posture, which weighs a ten-thousandth (squared), holds a joint back by that part.
    np.testing.assert_allclose(ticks[0].velocity[joints], wanted, rtol=1e-3)


def test_joints_that_rounding_leaves_outside_are_at_their_limits(hoap2) -> None:
    """A nanometre; a cost that outweighs all tasks appears beyond that."""
    limits = Limits(hoap2)
    P = []
    for excess in (-0.5e-9, 0.5e-9, 2e-9):
        here = beyond(hoap2, {"left_knee_pitch": excess})
        task = PostureTask(hoap2, here.q)
        P.append(KinematicController(hoap2, [task], contacts=(), limits=limits).step(here).qp.P)
    np.testing.assert_array_equal(P[0], P[1])
    joint = hoap2.joint_index("left_knee_pitch")
    assert P[2][joint, joint] - P[1][joint, joint] == pytest.approx(OUTWEIGHS)
