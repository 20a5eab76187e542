"""Bounded braking against its own statements: the factor on gains, and how a box is relaxed."""

import numpy as np
import pytest

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.braking import _factor, least_acceleration_qp, relax_box
from wbc.qp import QP, Labels, Solution, Status
from wbc.qp.solution import KktResiduals
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask, Task

DT, SHARE = 0.004, 0.7
MODES = ("floating", "left")


@pytest.fixture
def robot(robot_named) -> Robot:
    return robot_named("hoap2_like")


def pulls(here: Snapshot, tasks: list[Task], contacts, by: str) -> np.ndarray:
    """Return the velocity or the whole way that the tasks ask for under the contacts.

    By the saddle-point system in full, with the damping and curvature that the tasks declare.
    """
    nv = here.robot.nv
    P, slope = 1e-6 * np.eye(nv), np.zeros(nv)
    for task in tasks:
        residual = task.residual(here)
        bound = residual.curvature_bound
        J = np.zeros((len(task.rows), nv)) + residual.jacobian
        W = np.diag(task.weight**2)
        P += J.T @ W @ J
        P += np.diag(np.zeros(nv) + 0.5 * task.gain * (bound() if callable(bound) else bound))
        rate = task.gain / DT if by == "velocity" else 1.0
        slope -= rate * J.T @ W @ residual.error
    A = np.concatenate([np.zeros((0, nv)), *(one.residual(here).jacobian for one in contacts)])
    k = len(A)
    K = np.block([[P, A.T], [A, np.zeros((k, k))]])
    return np.linalg.solve(K, np.concatenate((slope, np.zeros(k))))[:nv]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("gains", [(0.5, 0.5), (0.5, 0.1), (0.1, 0.9)])
def test_gains_are_lowered_by_the_factor_that_joints_can_brake_from(
    robot, rng, mode, gains
) -> None:
    """s = min(1, min u_j / (r_j d_j)), u dt + u^2 / (2 0.7 a) = d: read from the QP's gradient.

    r d is asked for, d is the way to go or, where tasks of other gains pull the other way, what is
    asked for in the quickest one's time. Where a joint's limit is nearer, it goes no further.
    """
    slowed = 0
    for acceleration in (2.0, 30.0, 1e5):
        q = robot.integrate(robot.posture(), 0.1 * rng.normal(size=robot.nv), 1.0)
        near, low = rng.uniform(0.01, 0.2, robot.nv - 6), rng.random(robot.nv - 6) < 0.5
        q[7:] = np.where(low, robot.limits.lower + near, robot.limits.upper - near)
        here = robot.snapshot(q)
        q_wanted = robot.integrate(q, 0.2 * rng.normal(size=robot.nv), 1.0)
        tasks = [ComTask(robot, here.com + 0.05 * rng.normal(size=3), gain=gains[0], weight=5.0),
                 PostureTask(robot, q_wanted, gain=gains[1], weight=0.4)]  # fmt: skip
        contacts = support(here, mode)
        limits = {
            kind: Limits(robot, acceleration=acceleration, braking=kind)
            for kind in ("free", "bounded")
        }
        g = {
            kind: KinematicController(
                robot, tasks, contacts=contacts, limits=one, dt=DT
            ).step(here).qp.g
            for kind, one in limits.items()
        }  # fmt: skip
        asked = np.abs(pulls(here, tasks, contacts, "velocity")[6:])
        way = np.abs(pulls(here, tasks, contacts, "way")[6:])
        way = np.maximum(way, asked * DT / max(gains))
        rate = asked / way
        joints = robot.limits.joint_positions(q)
        up = pulls(here, tasks, contacts, "velocity")[6:] > 0.0
        way = np.minimum(
            way, np.where(up, robot.limits.upper - joints, joints - robot.limits.lower)
        )
        a = SHARE * acceleration
        able = -a * DT + np.sqrt((a * DT) ** 2 + 2.0 * a * way)
        factor = min(1.0, float((able / (rate * way)).min()))
        slowed += factor < 1.0
        # The equalities are weighed 1e4 there and the damping of rows is the same: to 1 %.
        np.testing.assert_allclose(g["bounded"], factor * g["free"], rtol=0,
                                   atol=0.02 * factor * np.abs(g["free"]).max())  # fmt: skip
        if factor == 1.0:
            np.testing.assert_allclose(g["bounded"], g["free"], rtol=1e-12, atol=1e-12)
    assert slowed >= 1


def test_what_a_moving_target_asks_for_beforehand_is_not_lowered(robot, rng) -> None:
    """At its place, a target's rate is asked for in full, whatever joints could brake from."""
    here = robot.snapshot(robot.posture())
    com = ComTask(robot, here.com)
    rate = np.array([0.3, -0.2, 0.1])
    com.set_target(here.com, rate)
    limits = Limits(robot, acceleration=1.0, braking="bounded")
    qp = KinematicController(robot, [com], contacts=(), limits=limits, dt=DT).step(here).qp
    np.testing.assert_allclose(qp.g, -here.com_jacobian.T @ rate, atol=1e-9)
    com.set_target(here.com + [0.1, 0.0, 0.0], rate)
    away = KinematicController(robot, [com], contacts=(), limits=limits, dt=DT).step(here).qp
    pull = -here.com_jacobian[0] * 0.1 * com.gain / DT
    share = (away.g - qp.g) @ pull / (pull @ pull)
    assert 0.0 < share < 0.9
    np.testing.assert_allclose(away.g, qp.g + share * pull, atol=1e-9)


def some_qp(robot: Robot, lower: np.ndarray, upper: np.ndarray, slacks: int = 2) -> QP:
    n = robot.nv + slacks
    behind = np.arange(1.0, slacks + 1.0)
    return QP(np.eye(n), np.ones(n), np.zeros((0, n)), np.zeros(0), np.zeros((0, n)), np.zeros(0),
              np.zeros(0), np.concatenate((lower, -behind)), np.concatenate((upper, 2 * behind)),
              Labels.numbered(n))  # fmt: skip


def answer(x: np.ndarray, status: Status) -> Solution:
    none = np.zeros(0)
    return Solution(x, none, none, 0 * x, status, KktResiduals(0, 0, 0), 1, 0.0, "scripted")


def test_a_box_is_relaxed_just_so_far(robot, rng) -> None:
    """To the gentlest velocity and a tenth of a bound beyond, never beyond the emergency's box."""
    nv = robot.nv
    limits = Limits(robot, acceleration=20.0, braking="bounded")
    moving = np.concatenate((np.zeros(6), rng.normal(size=nv - 6)))
    here = robot.snapshot(robot.posture(), moving)
    widest = limits.emergency_braking_box(here, DT)
    middle = np.zeros(nv)
    middle[6:] = 0.5 * (widest[0][6:] + widest[1][6:])
    half = np.minimum(0.4 * (widest[1] - widest[0]), 0.5)
    assert np.isfinite(half).all()
    lower, upper = middle - half, middle + half
    qp = some_qp(robot, lower, upper)
    step = 0.1 * 20.0 * DT
    v = middle + half * rng.uniform(-1.0, 1.0, nv)
    v[8], v[10] = lower[8] - 0.01, upper[10] + 0.01  # these must brake harder
    v[12] = widest[0][12] + 0.5 * step  # and this one as hard as can be
    seen: list[QP] = []

    def solve(given: QP) -> Solution:
        seen.append(given)
        return answer(np.concatenate((v, [9.0, 9.0])), Status.SOLVED)

    found = relax_box(qp, limits, here, DT, solve)
    assert found is not None
    expected_lower, expected_upper = lower.copy(), upper.copy()
    expected_lower[8], expected_upper[10] = v[8] - step, v[10] + step
    expected_lower[12] = widest[0][12]
    np.testing.assert_allclose(found.lower[:nv], expected_lower, atol=1e-12)
    np.testing.assert_allclose(found.upper[:nv], expected_upper, atol=1e-12)
    for one in (found, seen[0]):  # slacks keep their bounds
        np.testing.assert_array_equal(one.lower[nv:], qp.lower[nv:])
        np.testing.assert_array_equal(one.upper[nv:], qp.upper[nv:])
    np.testing.assert_array_equal(seen[0].lower[:nv], widest[0])
    np.testing.assert_array_equal(seen[0].upper[:nv], widest[1])
    np.testing.assert_array_equal(found.P, qp.P)
    np.testing.assert_array_equal(found.g, qp.g)
    # No solution even so: all the way; relaxed already: nothing more to do.
    whole = relax_box(qp, limits, here, DT, lambda given: answer(given.g, Status.INFEASIBLE))
    assert whole is not None
    np.testing.assert_array_equal(whole.lower[:nv], widest[0])
    np.testing.assert_array_equal(whole.upper[:nv], widest[1])
    assert relax_box(some_qp(robot, *widest), limits, here, DT, solve) is None
    narrower = widest[1].copy()
    narrower[9] -= 0.01
    assert relax_box(some_qp(robot, widest[0], narrower), limits, here, DT, solve) is not None


def test_the_least_change_is_measured_in_what_joints_can_do(robot) -> None:
    """Gauss's principle: the optimum without rows is v itself, and weights are 1 / change^2."""
    nv = robot.nv
    change = np.full(nv, np.inf)
    change[6:] = np.linspace(0.01, 2.0, nv - 6)
    v = np.linspace(-1.0, 1.0, nv)
    qp = least_acceleration_qp(some_qp(robot, -np.ones(nv), np.ones(nv)), v, change)
    weights = np.diag(qp.P)
    np.testing.assert_array_equal(qp.P, np.diag(weights))
    np.testing.assert_allclose(-qp.g[:nv] / weights[:nv], v, atol=1e-15)
    np.testing.assert_array_equal(qp.g[nv:], 0.0)
    expected = np.maximum((change[6:].min() / change[6:]) ** 2, 1e-4)
    np.testing.assert_allclose(weights[6:nv], expected)
    np.testing.assert_allclose(weights[[*range(6), nv, nv + 1]], 1e-4)


@pytest.mark.parametrize("asked", [4e-4, -4e-4, 0.3, -0.3])
@pytest.mark.parametrize("near", ["lower", "upper"])
def test_only_the_limit_that_a_joint_goes_to_is_in_its_way(robot, asked, near) -> None:
    """However slowly: at ``factor * asked`` it can stop at the way's end, or at the limit."""
    limits, joint, left = Limits(robot, acceleration=2.0), 3, 1e-6
    q = robot.posture()
    q[7:] = 0.5 * (robot.limits.lower + robot.limits.upper)
    end = getattr(robot.limits, near)[joint]
    q[7 + joint] = end + (left if near == "lower" else -left)
    newton = np.zeros((2, robot.nv - 6))
    newton[:, joint] = asked, asked / 200.0  # a rate of 200 /s
    factor = _factor(newton, 250.0, limits, robot.snapshot(q), DT)
    way, towards = abs(asked) / 200.0, (asked > 0.0) == (near == "upper")
    to_go = min(way, left) if towards else way
    u = factor * 200.0 * to_go  # the rate by what is left to go, from which it stops in time
    assert u * DT + u**2 / (2.0 * SHARE * 2.0) == pytest.approx(to_go, rel=1e-6)
