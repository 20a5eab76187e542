"""Weights of the joints: against closed forms of the weighted pseudo-inverse."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import null_space

from wbc.constraints import support
from wbc.controllers import Controller, KinematicController, TorqueController, TorqueTick
from wbc.robot import Robot
from wbc.tasks import ComTask, PositionTask

Load = Callable[[str], Robot]
DAMPING = 1e-3


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
def test_without_contacts_it_is_the_weighted_pseudo_inverse(
    name: str, robot_named: Load, rng, random_snapshot
) -> None:
    """Oracle: M^-1 J' (J M^-1 J' + damping W^-2)^-1 rate, for a target moving at that rate."""
    robot = robot_named(name)
    for _ in range(5):
        here = random_snapshot(robot, rng)
        M, weight = np.exp(2 * rng.normal(size=robot.nv)), np.array([1.0, 2.0, 5.0])
        rate = rng.normal(size=3)
        task = ComTask(robot, here.com, weight=weight)
        task.set_target(here.com, rate)
        controller = KinematicController(robot, [task], joint_weights=M, damping=DAMPING)
        J = here.com_jacobian
        compliance = J @ (J / M).T + DAMPING * np.diag(weight**-2)
        expected = (J / M).T @ np.linalg.solve(compliance, rate)
        # ProxQP stops at about 1e-9 in the slope of the cost; the baseline has no such end.
        slope = DAMPING * M * (controller.step(here).velocity - expected)
        np.testing.assert_allclose(slope, 0.0, atol=1e-8)
        baseline = KinematicController(
            robot, [task], joint_weights=M, damping=DAMPING, solver="pseudo_inverse"
        )
        np.testing.assert_allclose(baseline.step(here).velocity, expected, atol=1e-9)


@pytest.mark.parametrize("mode", ["left", "double"])
def test_in_the_motions_that_contacts_leave(mode: str, g1_27: Robot, rng) -> None:
    """Oracle: the optimality conditions with the contacts' rows, solved by numpy."""
    here = g1_27.snapshot(g1_27.posture("standing"), np.zeros(g1_27.nv))
    M, rate = np.exp(rng.normal(size=g1_27.nv)), np.array([0.1, -0.2, 0.3])
    task = PositionTask(g1_27, "left_wrist_yaw_link", np.zeros(3), weight=2.0)
    task.set_target(here.position(task.frame), rate)
    J = here.jacobian(task.frame)[:3]
    sides = ("left", "right") if mode == "double" else (mode,)
    N = null_space(np.concatenate([here.jacobian(f"{side}_sole") for side in sides]))
    H = N.T @ (4.0 * J.T @ J + DAMPING * np.diag(M)) @ N
    expected = N @ np.linalg.solve(H, 4.0 * N.T @ J.T @ rate)
    settings = {"contacts": support(here, mode), "joint_weights": M, "damping": DAMPING}
    tick = KinematicController(g1_27, [task], **settings).step(here)
    np.testing.assert_allclose(tick.velocity, expected, atol=1e-5)
    tick = KinematicController(g1_27, [task], solver="pseudo_inverse", **settings).step(here)
    np.testing.assert_allclose(tick.velocity, expected, atol=1e-9)


def test_names_patterns_and_the_base(g1_27: Robot) -> None:
    com = ComTask(g1_27, np.zeros(3))
    given = {"*": 2.0, "*wrist*": 10.0, "left_wrist_yaw_joint": 0.5, "base": 100.0}
    weights = KinematicController(g1_27, [com], joint_weights=given).joint_weights
    expected = np.full(g1_27.nv, 2.0)
    expected[:6] = 100.0
    for k, name in enumerate(g1_27.joint_names):
        if "wrist" in name:
            expected[6 + k] = 0.5 if name == "left_wrist_yaw_joint" else 10.0
    np.testing.assert_array_equal(weights, expected)
    alone = KinematicController(g1_27, [com], joint_weights={"*knee*": 3.0}).joint_weights
    assert (alone[:6] == 1.0).all()
    assert np.count_nonzero(alone == 3.0) == 2
    assert (KinematicController(g1_27, [com]).joint_weights == 1.0).all()


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_heavy_joints_move_less(g1_27: Robot, level: type[Controller]) -> None:
    """At the usual damping of 1e-6: the arm moves a hand, or if that is heavy the trunk."""
    here = g1_27.snapshot(g1_27.posture("standing"), np.zeros(g1_27.nv))
    hand = "left_wrist_yaw_link"
    rate = np.array([0.1, 0.0, 0.05])
    arm = [6 + k for k, n in enumerate(g1_27.joint_names) if n.startswith("left_") and
           any(part in n for part in ("shoulder", "elbow", "wrist"))]  # fmt: skip

    def moves(weights: dict[str, float]) -> np.ndarray:
        task = PositionTask(g1_27, hand, here.position(hand), kp=0.0, kd=1.0)
        task.set_target(here.position(hand), rate)
        contacts = support(here, "double")
        tick = level(g1_27, [task], contacts=contacts, joint_weights=weights).step(here)
        v, atol = tick.velocity, 1e-4
        if isinstance(tick, TorqueTick):
            v, atol = tick.acceleration, 1e-2  # contact forces weigh a little, too
        np.testing.assert_allclose(here.jacobian(hand)[:3] @ v, rate, atol=atol)
        return np.abs(v[arm])

    plain = moves({})
    heavy = moves({"left_shoulder*": 1e3, "left_elbow*": 1e3, "left_wrist*": 1e3})
    assert heavy.max() < 0.1 * plain.max()


def test_conditioning_measures_by_the_weights(hoap2: Robot, rng) -> None:
    """Oracle: singular values of J M^-1/2 in the motions that contacts leave."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    M = np.exp(rng.normal(size=hoap2.nv))
    controller = KinematicController(
        hoap2,
        [ComTask(hoap2, here.com, weight=3.0)],
        contacts=support(here, "left"),
        damping=1e-9,
        joint_weights=M,
    )
    found = controller.conditioning(controller.step(here))
    free = null_space(here.jacobian("left_sole") / np.sqrt(M))
    values = np.linalg.svd(3.0 * here.com_jacobian / np.sqrt(M) @ free, compute_uv=False)
    assert found.rank == 3
    assert found.free == free.shape[1]
    # The squares of 1e-9 of rounding and damping, relative to the least curvature.
    assert found.condition == pytest.approx((values[0] / values[-1]) ** 2, rel=1e-5)
