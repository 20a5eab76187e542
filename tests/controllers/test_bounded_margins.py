"""What limits and margins ask of a joint that comes too fast: all that it can do, and no more."""

from collections.abc import Callable

import numpy as np
import pytest

from tests import urdf
from wbc.constraints import Limits, Obstacles, PositionBox, TiltLimit, support
from wbc.constraints.limits import Box
from wbc.constraints.rows import MARGIN_BRAKING, Bounds, reachable_rows
from wbc.controllers import TorqueController
from wbc.controllers.effort_bounds import StanceBraking
from wbc.laws import Rows
from wbc.robot import Robot
from wbc.robot.collision import Obstacle
from wbc.tasks import ComTask, PositionTask, PostureTask

DT = 0.002
A = 10.0  # what joints can brake [rad/s^2]
# Time constants [s] of joints that are on their way to a limit and too fast for it, and the hardest
# braking that limits ask for, by A.
ARRIVAL, SETTLE, BRAKING = 0.02, 0.02, 2.0


def box_of(limits: Limits) -> Callable[[np.ndarray, np.ndarray], Box]:
    """Return what ticks keep v+ in by q and v, of a robot in the air without torque bounds."""
    robot = limits.robot
    task = PostureTask(robot, robot.posture("standing"))
    controller = TorqueController(
        robot, [task], contacts=(), limits=limits, torque_limits=None, dt=DT
    )

    def box(q: np.ndarray, v: np.ndarray) -> Box:
        tick = controller.step(robot.snapshot(q, v))
        assert tick.ok and tick.policy is None, tick.report()
        return tick.qp.lower[: robot.nv], tick.qp.upper[: robot.nv]

    return box


def test_boxes_hold_what_braking_can_reach(hoap2: Robot) -> None:
    bounds, q, v = (
        box_of(Limits(hoap2, acceleration=A)),
        hoap2.posture("standing"),
        np.zeros(hoap2.nv),
    )
    q[7] = hoap2.limits.upper[0]
    v[6] = 3.0
    lower, upper = bounds(q, v)
    assert upper[6] == pytest.approx(3.0 - BRAKING * A * DT)  # braked as hard as it can be
    assert lower[6] < upper[6]
    v[6], q[7] = 0.0, hoap2.limits.upper[0] + 1e-4
    assert bounds(q, v)[1][6] == pytest.approx(-1e-4 / ARRIVAL * DT / SETTLE)  # it is back


def test_no_state_leaves_an_empty_box(hoap2: Robot) -> None:
    robot, rng = hoap2, np.random.default_rng(4)
    kinds = [Limits(robot), Limits(robot, braking="bounded", velocity=None, acceleration=np.inf)]
    boxes = [box_of(limits) for limits in kinds]
    for _ in range(200):
        q = robot.posture("standing")
        q[7:] = rng.uniform(-4.0, 4.0, robot.nv - 6)
        v = rng.normal(size=robot.nv) * 10.0 ** rng.uniform(-6.0, 2.0)
        kinds[0].acceleration = 10.0 ** rng.uniform(-1.0, 3.0)
        for bounds in boxes:
            lower, upper = bounds(q, v)
            assert (lower <= upper).all()


@pytest.mark.parametrize("speed", [0.05, 0.5, 3.0])
def test_joints_arrive_by_one_deceleration(speed: float, hoap2: Robot) -> None:
    """Moved by what is allowed, the acceleration held over a tick, as motors and physics do."""
    bounds, q, v = (
        box_of(Limits(hoap2, acceleration=A)),
        hoap2.posture("standing"),
        np.zeros(hoap2.nv),
    )
    most, left, used = hoap2.limits.upper[0], [], []
    q[7], v[6] = most - speed * ARRIVAL - speed**2 / (2.0 * A), speed
    for _ in range(500):
        asked = bounds(q, v)[1][6]
        used.append((asked - v[6]) / DT)
        q[7] += 0.5 * DT * (v[6] + asked)
        v[6] = asked
        left.append(most - q[7])
    assert min(left) > -1e-9 and (np.diff(left) < 1e-9).all(), "met from inside, and never left"
    assert left[-1] < 1e-5
    assert min(used) > -1.1 * A
    # Down to the braking and back to none: no chatter.
    assert np.abs(np.diff(used)).sum() < 2.5 * A


def test_small_errors_ask_for_small_accelerations(hoap2: Robot) -> None:
    """Joints at the end of their range, where contacts leave them 1e-2 rad/s and 1e-4 rad off."""
    robot, rng = hoap2, np.random.default_rng(1)
    limits = Limits(robot, acceleration=1e3)
    bounds, q, v = box_of(limits), robot.posture("standing"), np.zeros(robot.nv)
    for _ in range(50):
        off, rate = rng.normal(size=2) * [1e-4, 1e-2]
        q[7], v[6] = robot.limits.upper[0] - off, rate
        asked = (bounds(q, v)[1][6] - rate) / DT
        assert abs(asked) < 1.2 * (abs(rate) * (1 / SETTLE + 1 / ARRIVAL) + abs(off) / ARRIVAL**2)


def test_legs_that_stand_brake_what_they_carry(g1: Robot) -> None:
    """Against the forces that hold the soles while a joint's own torque moves the robot."""
    start = g1.snapshot(g1.posture("standing"))
    torques = g1.limits.effort
    limits = Limits(g1).within_torques(torques)
    held = support(start, "double")
    braking = StanceBraking(g1, torques)
    found = braking.decelerations(limits, held)
    J = np.concatenate([contact.residual(start).jacobian for contact in held])
    for name in ("left_ankle_pitch_joint", "right_ankle_roll_joint", "left_knee_joint"):
        k = g1.joint_index(name)
        kkt = np.block([[start.mass_matrix, J.T], [J, np.zeros((len(J), len(J)))]])
        force = np.zeros(len(kkt))
        force[k] = 0.5 * torques[k - 6]
        moved = np.linalg.lstsq(kkt, force, rcond=1e-12)[0][k]
        ground = g1.gravity / np.linalg.norm(start.position(name) - start.com)
        able = min(max(moved, ground), limits.acceleration[k - 6])
        assert found[k - 6] == pytest.approx(able, rel=1e-6)
    pitch, roll = (g1.joint_index(f"left_ankle_{axis}_joint") - 6 for axis in ("pitch", "roll"))
    assert 20.0 < found[pitch] < 0.5 * limits.acceleration[pitch]  # the motor's
    assert 10.0 < found[roll] < 20.0  # the ground's
    np.testing.assert_array_equal(braking.decelerations(limits, ()), limits.acceleration)
    given = Limits(g1, acceleration=5.0)
    np.testing.assert_array_equal(braking.decelerations(given, held), 5.0)
    # What was found for other contacts is not mixed up with it.
    one = braking.decelerations(limits, held[:1])
    assert not np.array_equal(one, found)
    np.testing.assert_array_equal(braking.decelerations(limits, held), found)
    anew = StanceBraking(g1, torques).decelerations(limits, held[:1])
    np.testing.assert_array_equal(anew, one)


def test_margins_ask_for_what_braking_can_reach() -> None:
    """The way out, too: of joints at 5 rad/s^2 whose levers are 1 and 0.1 m."""
    rows, v = np.eye(3, 8, k=5), np.zeros(8)
    rows[2, 7] = 0.1
    v[5] = -1.0
    push = Rows(rows, np.array([0.1, 0.01, 0.1]), np.ones(3))
    bounds = Bounds(("a", "b", "c"), rows, np.array([0.0, -0.1, -0.1]), np.full(3, np.inf), push)
    found = reachable_rows(bounds, v, DT)
    change = MARGIN_BRAKING * DT
    np.testing.assert_allclose(found.lower, [-1.0 + change, -0.1, -0.1])
    assert found.push is not None
    np.testing.assert_allclose(found.push.target, [-1.0 + change, 5.0 * DT, 0.5 * DT])
    other = reachable_rows(Bounds(bounds.labels, -rows, -bounds.upper, -bounds.lower), v, DT)
    np.testing.assert_array_equal((other.lower, other.upper), (-found.upper, -found.lower))
    v[6] = 0.1  # on its way, faster than it should be: no harder back, either
    found = reachable_rows(bounds, v, DT)
    assert found.push is not None
    np.testing.assert_allclose(found.push.target, [-1.0 + change, 0.1 - 5.0 * DT, 0.5 * DT])


def test_torques_get_out_of_the_way_of_what_comes(hoap2: Robot) -> None:
    """As velocities do: a ball at 0.3 m/s went into the palm, as a violation is left slowly."""
    stands = hoap2.snapshot(hoap2.posture("standing"))
    ball = Obstacle.sphere("ball", (0.0, 0.0, 0.0), 0.04)
    ball.move(np.eye(3), (0.4, 0.12, 0.26), velocity=(-0.3, 0.0, 0.0))
    around = Obstacles(hoap2, [ball], margin=0.02)
    hand = PositionTask(hoap2, "left_palm", (0.17, 0.12, 0.24))
    controller = TorqueController(
        hoap2,
        [hand, ComTask(hoap2, stands.com, weight=10.0), PostureTask(hoap2, stands.q, weight=0.01)],
        contacts=support(stands, "double"),
        limits=Limits(hoap2),
        constraints=[around],
        dt=DT,
    )
    here, nearest = stands, np.inf
    for _ in range(400):
        tick = controller.step(here)
        assert tick.ok and not tick.relaxed, tick.report()
        here = hoap2.snapshot(hoap2.integrate(here.q, tick.velocity, DT), tick.velocity)
        ball.advance(DT)
        nearest = min(nearest, float(around.model.nearest(here, 1).distance[0]))
    assert nearest > 0.02


@pytest.mark.parametrize("what", ["height", "tilt"])
def test_legs_bring_the_base_out_of_a_margin(hoap2: Robot, what: str) -> None:
    """No joint moves its link, and all that was asked for was what joints' levers give: nothing."""
    stands, step = hoap2.snapshot(hoap2.posture("standing")), np.zeros(hoap2.nv)
    step[4] = 0.1 * (what == "tilt")
    here, margin = hoap2.snapshot(hoap2.integrate(stands.q, step, 1.0)), stands.q[2] - 0.02
    box, tilt = PositionBox.height(hoap2, -1.0, margin), TiltLimit(hoap2, "base", 0.05)
    balance = ComTask(hoap2, stands.com, axes=["x", "y"], weight=10.0)
    controller = TorqueController(
        hoap2,
        [balance, PostureTask(hoap2, here.q, weight=0.01)],
        contacts=support(here, "double"),
        limits=Limits(hoap2),
        constraints=[box if what == "height" else tilt],
        dt=DT,
    )
    for _ in range(750):
        tick = controller.step(here)
        assert tick.ok and not tick.relaxed, tick.report()
        here = hoap2.snapshot(hoap2.integrate(here.q, tick.velocity, DT), tick.velocity)
    left = controller.constraints[0].distances(here).clearance
    assert left.min() > -5e-4


def test_a_bolted_arm_leaves_a_margin_as_its_joints_do() -> None:
    """It has no legs: with their lever, a point 20 mm from its joint was to leave at 25 rad/s^2."""
    parts = [urdf.link(name, mass=0.1, moment=1e-4) for name in ("world", "upper", "tip")]
    tip = urdf.joint("k", "upper", "tip", kind="fixed", at="0.02 0 0")
    text = urdf.robot("arm", *parts, urdf.joint("j", "world", "upper", limit=urdf.limit(2)), tip)
    arm = Robot.load(text, base="fixed")
    here = arm.snapshot(arm.posture())
    inside = PositionBox.height(arm, here.position("tip")[2] + 0.01, frame="tip")
    at_rest = PostureTask(arm, here.q)
    tick = TorqueController(arm, [at_rest], constraints=[inside], dt=DT).step(here)
    assert 2.0 < -tick.velocity[6] / DT < 5.0
