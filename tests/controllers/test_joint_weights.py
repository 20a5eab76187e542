"""Weights of joints by the weighted pseudo-inverse; what gains and weights make of rival tasks."""

import logging
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import null_space

import wbc
from wbc.constraints import support
from wbc.controllers import Controller, KinematicController, TorqueController, TorqueTick
from wbc.controllers.competing_tasks import competing_tasks
from wbc.laws import Residual
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
