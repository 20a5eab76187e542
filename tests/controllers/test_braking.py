"""Bounded braking: the acceleration bound holds both ways, unless there is nothing else to do."""

import numpy as np
import pytest
import qpsolvers

from wbc.constraints import Contact, Limits, PositionBox, support
from wbc.controllers import KinematicController
from wbc.controllers.braking import least_acceleration_qp, relax_box
from wbc.qp import QP, Labels, Solution, Status
from wbc.qp.solution import KktResiduals
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PositionTask, PostureTask

DT = 0.005
# Solvers promise 1e-8 (a last resort 1e-6) [rad/s]; changes are counted in bounds of 0.05 and more.
SOLVED = 1e-4


def change(v: np.ndarray, before: np.ndarray, limits: Limits) -> np.ndarray:
    """Return changes of joint velocities in parts of what the bound allows in a tick."""
    return np.abs(v - before)[6:] / (limits.acceleration * DT)


def hardest(robot: Robot, braking: str) -> float:
    """Return the largest change while a greedy arm reaches for one place, then for another."""
    limits = Limits(robot, acceleration=20.0, braking=braking)
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    here = robot.snapshot(q)
    hand = PositionTask(robot, "left_hand_link", here.position("left_hand_link"), gain=1.0)
    controller = KinematicController(
        robot, [hand, PostureTask(robot, q, weight=0.01)], contacts=support(here, "double"),
        limits=limits, dt=DT,
    )  # fmt: skip
    start, worst = hand.target, 0.0
    for k in range(120):
        hand.set_target(start + np.cos(k // 12 * np.pi) * np.array([0.05, 0.05, 0.1]))
        tick = controller.step(robot.snapshot(q, v))
        assert tick.ok, tick.report()
        worst = max(worst, float(change(tick.velocity, v, limits).max()))
        v = tick.velocity
        q = robot.integrate(q, v, DT)
        assert limits.worst_margin(q)[0] > -1e-9
    return worst


def test_changes_are_bounded_both_ways(hoap2) -> None:
    assert hardest(hoap2, "bounded") <= 1.0 + SOLVED
    assert hardest(hoap2, "free") > 3.0, "the same without the bound: the test tests something"


def on_one_foot(robot: Robot, rng: np.random.Generator, speed: float) -> Snapshot:
    """Return a state in which the right foot rests and the left one moves."""
    still = robot.snapshot(robot.posture("standing"))
    J = still.jacobian("right_sole")
    v = speed * rng.normal(size=robot.nv)
    return robot.snapshot(still.q, v - np.linalg.pinv(J) @ (J @ v))


def gentlest(here: Snapshot, limits: Limits) -> np.ndarray:
    """Return the least change that stops both feet, in parts of the bounds; by another solver."""
    lower, upper = limits.emergency_braking_box(here, DT)
    scale = np.concatenate((np.full(6, 1e2), limits.acceleration * DT))  # the base is nearly free
    weight = scale**-2.0
    feet = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    x = qpsolvers.solve_qp(
        np.diag(weight), -weight * here.v, A=feet, b=np.zeros(12),
        lb=np.maximum(lower, -1e3), ub=np.minimum(upper, 1e3), solver="daqp",
    )  # fmt: skip
    return np.abs(x - here.v)[6:] / scale[6:]


def test_a_foot_put_down_in_motion_stops_as_gently_as_can_be(hoap2, rng) -> None:
    limits = Limits(hoap2, acceleration=20.0, braking="bounded")
    for speed in (0.2, 0.5, 1.0):
        here = on_one_foot(hoap2, rng, speed)
        tasks = [ComTask(hoap2, here.com), PostureTask(hoap2, here.q, weight=0.1, priority=1)]
        tick = KinematicController(
            hoap2, tasks, contacts=support(here, "double"), limits=limits, dt=DT
        ).step(here)
        assert tick.ok, tick.report()
        assert np.abs(here.jacobian("left_sole") @ tick.velocity).max() < 1e-6
        needed = gentlest(here, limits)
        assert needed.max() > 1.5, "it cannot be done within the bound"
        # A tenth of a bound is the room that solvers get; the base's weight is not the oracle's.
        changed = change(tick.velocity, here.v, limits)
        assert (changed <= np.maximum(1.0, needed) + 0.12).all()
        assert (changed[needed < 0.9] <= 1.0 + SOLVED).all(), "others keep their bound"


def test_what_is_asked_for_beyond_a_limit_counts_up_to_it(hoap2) -> None:
    """One factor on all gains, u / (gain / dt x), with u dt + u^2 / (2 0.7 a) = x to the limit."""
    near, other, gain, a = "left_elbow_pitch", "right_elbow_pitch", 0.1, 20.0
    for low in (True, False):
        limits = Limits(hoap2, acceleration=a, braking="bounded", margin=0.1)
        k = hoap2.joint_index(near) - 6
        place, way = (limits.lower[k], -1.0) if low else (limits.upper[k], 1.0)
        start = hoap2.posture("standing", {near: place - way * 0.1})
        goal = hoap2.posture("standing", {near: place + way * 0.09})
        goal[hoap2.joint_index(other) + 1] += 0.004
        here = hoap2.snapshot(start, np.zeros(hoap2.nv))
        posture = PostureTask(hoap2, goal, gain=gain)
        controller = KinematicController(hoap2, [posture], contacts=(), limits=limits, dt=DT)
        found = controller.step(here).velocity[hoap2.joint_index(other)]
        u = 2.0 * 0.1 / (DT + np.sqrt(DT**2 + 2.0 * 0.1 / (0.7 * a)))
        factor = u / (gain / DT * 0.1)
        assert found == pytest.approx(factor * gain / DT * 0.004, rel=1e-4)


def test_before_a_wall_that_appears_the_robot_stops_all_the_same(hoap2, rng) -> None:
    """A margin that asks for more than joints can brake is kept; the bound is not."""
    limits = Limits(hoap2, acceleration=5.0, braking="bounded")
    still = hoap2.snapshot(hoap2.posture("standing"))
    v = np.zeros(hoap2.nv)
    v[hoap2.joint_index("left_shoulder_pitch")] = 2.0
    here = hoap2.snapshot(still.q, v)
    rate = here.jacobian("left_hand_link")[:3] @ v
    way = int(np.abs(rate).argmax())
    sign = np.sign(rate[way])
    lower, upper = np.full(3, -np.inf), np.full(3, np.inf)
    (upper if sign > 0 else lower)[way] = here.position("left_hand_link")[way] + sign * 1e-3
    wall = PositionBox(hoap2, "left_hand_link", lower, upper)
    tick = KinematicController(
        hoap2, [PostureTask(hoap2, still.q)], contacts=support(here, "double"), limits=limits,
        constraints=[wall], dt=DT,
    ).step(here)  # fmt: skip
    assert tick.ok, tick.report()
    there = hoap2.snapshot(hoap2.integrate(here.q, tick.velocity, DT)).position("left_hand_link")
    assert (lower <= there).all() and (there <= upper).all()
    assert change(tick.velocity, v, limits).max() > 1.0


def some_qp(robot: Robot, lower: np.ndarray, upper: np.ndarray, slacks: int = 2) -> QP:
    n = robot.nv + slacks
    behind = np.arange(1.0, slacks + 1.0)
    return QP(np.eye(n), np.ones(n), np.zeros((0, n)), np.zeros(0), np.zeros((0, n)), np.zeros(0),
              np.zeros(0), np.concatenate((lower, -behind)), np.concatenate((upper, 2 * behind)),
              Labels.numbered(n))  # fmt: skip


def answer(x: np.ndarray, status: Status) -> Solution:
    none = np.zeros(0)
    return Solution(x, none, none, 0 * x, status, KktResiduals(0, 0, 0), 1, 0.0, "scripted")


def test_a_box_is_relaxed_just_so_far(hoap2, rng) -> None:
    """To the gentlest velocity and a tenth of a bound beyond, never beyond the emergency's box."""
    nv = hoap2.nv
    limits = Limits(hoap2, acceleration=20.0, braking="bounded")
    moving = np.concatenate((np.zeros(6), rng.normal(size=nv - 6)))
    here = hoap2.snapshot(hoap2.posture(), moving)
    widest = limits.emergency_braking_box(here, DT)
    middle = np.zeros(nv)
    middle[6:] = 0.5 * (widest[0][6:] + widest[1][6:])
    half = np.minimum(0.4 * (widest[1] - widest[0]), 0.5)
    assert np.isfinite(half).all()
    lower, upper = middle - half, middle + half
    qp = some_qp(hoap2, lower, upper)
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
    assert relax_box(some_qp(hoap2, *widest), limits, here, DT, solve) is None
    narrower = widest[1].copy()
    narrower[9] -= 0.01
    assert relax_box(some_qp(hoap2, widest[0], narrower), limits, here, DT, solve) is not None


def test_the_least_change_is_measured_in_what_joints_can_do(hoap2) -> None:
    """Gauss's principle: the optimum without rows is v itself, and weights are 1 / change^2."""
    nv = hoap2.nv
    change = np.full(nv, np.inf)
    change[6:] = np.linspace(0.01, 2.0, nv - 6)
    v = np.linspace(-1.0, 1.0, nv)
    qp = least_acceleration_qp(some_qp(hoap2, -np.ones(nv), np.ones(nv)), v, change)
    weights = np.diag(qp.P)
    np.testing.assert_array_equal(qp.P, np.diag(weights))
    np.testing.assert_allclose(-qp.g[:nv] / weights[:nv], v, atol=1e-15)
    np.testing.assert_array_equal(qp.g[nv:], 0.0)
    expected = np.maximum((change[6:].min() / change[6:]) ** 2, 1e-4)
    np.testing.assert_allclose(weights[6:nv], expected)
    np.testing.assert_allclose(weights[[*range(6), nv, nv + 1]], 1e-4)


def test_what_contradicts_without_the_bound_is_named(hoap2, rng) -> None:
    here = on_one_foot(hoap2, rng, 1.0)
    left, right = support(here, "double")
    apart = Contact(hoap2, left.frame, left.position + (1.0, 0.0, 0.0), left.rotation)
    limits = Limits(hoap2, acceleration=20.0, braking="bounded")
    tick = KinematicController(
        hoap2, [ComTask(hoap2, here.com)], contacts=[apart, right], limits=limits, dt=DT
    ).step(here)
    assert tick.status.value == "infeasible"
    assert not tick.velocity.any()
    assert tick.conflict is not None
    assert any(row.label.startswith("left_sole") for row in tick.conflict.rows)
    nv, (lower, upper) = hoap2.nv, limits.emergency_braking_box(here, DT)
    np.testing.assert_array_equal(tick.qp.lower[:nv], lower)
    np.testing.assert_array_equal(tick.qp.upper[:nv], upper)
