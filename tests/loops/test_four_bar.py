"""A planar four-bar by its closed form: postures, both levels, the plant; loops out of QPs."""

import pickle
import re

import numpy as np
import pytest

from tests.loops import ankle, four_bar
from tests.standing import commanded
from wbc import KinematicController, Limits, PostureTask, TorqueController, WbcError
from wbc.constraints.mechanics import ClosedLoop
from wbc.errors import UnknownNameError
from wbc.qp.core import DONE, INFEASIBLE, solve_in_core
from wbc.robot import Robot
from wbc.simulation import Plant, simulate

pytest.importorskip("mujoco")  # which compiles MJCF
WELD = '<weld name="pin" body1="coupler" body2="rocker"/>'
# Twice over, and a pose that the plane keeps in part: rows that follow from others.
TWICE = (
    '<connect name="pin" body1="coupler" body2="rocker" anchor=".2 0 0"/>'
    '<connect name="again" body1="rocker" body2="coupler" anchor=".08 .1 .05"/>'
)


def load(**given: str) -> Robot:
    return Robot.load(four_bar.mjcf(**given))


def test_postures_are_closed_by_the_joints_without_a_motor() -> None:
    robot = load(more='<keyframe><key name="open" qpos=".5 .3 -.2"/></keyframe>')
    assert robot.unactuated == ("coupler", "rocker")
    told = "no motor of the file drives coupler, rocker; none does here, unless unactuated=[...]"
    assert told in robot.notes
    for crank in (-1.1, -0.4, 0.3, 1.1):
        q = robot.posture("standing", {"crank": crank})
        np.testing.assert_allclose(q[7:], four_bar.joints(crank), atol=1e-12)
    np.testing.assert_allclose(robot.postures["open"][7:], four_bar.joints(0.5), atol=1e-12)
    # What is named stays; then the motor's joint moves.
    wanted = four_bar.joints(0.7)
    q = robot.posture("standing", {"rocker": wanted[2]})
    np.testing.assert_allclose(q[7:], wanted, atol=1e-9)
    again = pickle.loads(pickle.dumps(robot))
    assert again.loops == robot.loops and again.gaps(q) == robot.gaps(q)
    q[8] += 0.1
    assert robot.gaps(q)["pin"] > 0.01
    np.testing.assert_allclose(robot.closed(q)[7:], wanted, atol=1e-9)
    with pytest.raises(UnknownNameError, match="did you mean 'rocker'"):
        robot.closed(q, kept=["rokcer"])
    with pytest.raises(WbcError, match=r"no posture near it closes them \(open: pin by"):
        robot.posture("standing", {"rocker": wanted[2], "crank": 0.0})


@pytest.mark.parametrize("tie", ["", WELD, TWICE])
def test_rows_are_the_derivatives_of_the_gap(tie: str) -> None:
    """By differences of 1e-4 s: 1e-8 of truncation, and 3e-8 = 2e-16 / 1e-8 of rounding."""
    robot = Robot.load(four_bar.mjcf(tie=tie), base="floating", feet={})
    rng, h = np.random.default_rng(1), 1e-4
    q, v, a = (0.3 * rng.normal(size=robot.nv) for _ in range(3))
    q[6:] *= 0.1 * (tie == WELD) + (tie != WELD)
    q = robot.integrate(robot.posture("standing"), q, 1.0)
    for name in robot.loops:
        loop = ClosedLoop(robot, name)

        def gap(t: float, loop: ClosedLoop = loop) -> np.ndarray:
            there = robot.integrate(q, v * t + 0.5 * a * t * t, 1.0)
            return np.asarray(loop.residual(robot.snapshot(there)).error)

        here = robot.snapshot(q, v)
        J = loop.residual(here).jacobian
        assert np.abs(J[:, :6]).max() < 1e-15  # the base moves nothing
        np.testing.assert_allclose(J @ v, (gap(h) - gap(-h)) / (2 * h), atol=1e-7)
        second = (gap(h) - 2.0 * gap(0.0) + gap(-h)) / h**2
        np.testing.assert_allclose(J @ a + loop.drift(here), second, atol=2e-7)


@pytest.mark.parametrize("tie", ["", WELD, TWICE])
def test_the_core_writes_the_same_rows(tie: str) -> None:
    robot = Robot.load(four_bar.mjcf(tie=tie), base="floating", feet={})
    rng = np.random.default_rng(2)
    q = robot.integrate(robot.posture("standing"), 0.2 * rng.normal(size=robot.nv), 1.0)
    here = robot.snapshot(q, rng.normal(size=robot.nv))
    tick = TorqueController(robot, [PostureTask(robot, q)], contacts=(), dt=0.002).step(here)
    for k, name in enumerate(robot.loops):
        loop, rows = ClosedLoop(robot, name), tick.qp.labels.equality
        first = rows.index(f"loop {name} x")
        own = slice(first, first + len(loop.rows))
        error, J, _, *_ = loop.residual(here)
        law, moving = loop.acceleration_law, J @ here.v
        wanted = moving - 0.002 * (law.kp * error + law.velocity_gain * moving + loop.drift(here))
        np.testing.assert_allclose(tick.qp.A[own, : robot.nv], J, atol=1e-15)
        np.testing.assert_allclose(tick.qp.b[own], wanted, atol=1e-14)
        forces = slice(robot.nv + k * len(loop.rows), robot.nv + (k + 1) * len(loop.rows))
        # Of the joints without a motor, whose dynamics are rows: M/m v+ - J' f
        np.testing.assert_allclose(tick.qp.A[6:8, forces], -J[:, 7:9].T, atol=1e-15)


def test_a_pose_is_held_by_controllers_and_the_plant() -> None:
    """A loop of kind pose leaves the four-bar rigid: it hangs on what holds it together."""
    robot = load(tie=WELD)
    q = robot.posture("standing")
    controller, plant = TorqueController(robot, [PostureTask(robot, q)]), Plant(robot)
    plant.reset(q)
    for now in simulate(controller, plant, 0.2):
        assert now.tick.ok
    there = plant.state()[0]
    assert robot.loops["pin"].kind == "pose" and robot.gaps(there)["pin"] < 1e-4
    assert np.abs(there[7:] - q[7:]).max() < 1e-3


@pytest.mark.parametrize("crank", [-0.9, 0.2, 1.0])
def test_velocities_are_those_of_the_closed_form(crank: float) -> None:
    robot = load()
    here = robot.snapshot(robot.posture("standing", {"crank": crank}))
    J = ClosedLoop(robot, "pin").residual(here).jacobian
    assert np.abs(J[:, 6:] @ four_bar.rates(crank)).max() < 1e-14


def follow(robot: Robot, ticks: int, dt: float) -> tuple[float, float]:
    """Swing the crank by 0.8 rad; return the largest gap, and distance from the closed form."""
    start = robot.posture("standing")
    task = PostureTask(robot, start, weight=1.0, gain=0.2)
    given = {"limits": Limits(robot, velocity=None), "solver": "active_set"}
    controller = KinematicController(robot, [task], dt=dt, **given)
    gap, off = 0.0, 0.0
    for k, (_, q) in enumerate(commanded(controller, start, ticks)):
        task.set_target([*q[:7], *four_bar.joints(0.8 * np.sin(1.3 * (k + 1) * dt))])
        gap = max(gap, *robot.gaps(q).values())
        off = max(off, float(np.abs(q[7:] - four_bar.joints(q[7])).max()))
    return gap, off


@pytest.mark.parametrize(
    ("tie", "ticks", "most"),
    [
        ("", 200, 1e-8),
        (TWICE, 200, 1e-8),
        # By the levers of 0.1 m a gap is that angle [rad].
        pytest.param("", 3_000, 5e-9, marks=pytest.mark.slow),
    ],
)
def test_a_swing_keeps_to_the_closed_form(tie: str, ticks: int, most: float) -> None:
    """At 1 rad/s plain rows would miss by 3e-6 m in each tick; they do not drift."""
    gap, off = follow(load(tie=tie), ticks, 0.005)
    assert gap < 1.1e-10 and off < most


@pytest.mark.parametrize("tie", ["", TWICE])
@pytest.mark.parametrize("crank", [-0.9, 0.2, 1.0])
def test_static_forces_are_those_of_the_closed_form(crank: float, tie: str) -> None:
    robot = load(tie=tie)
    q = robot.posture("standing", {"crank": crank})
    here = robot.snapshot(q)
    # Forces are damped so little that rest is the optimum to 1e-9.
    controller = TorqueController(robot, [PostureTask(robot, q)], force_damping=1e-9)
    tick = controller.step(here)
    assert tick.ok and np.abs(tick.acceleration).max() < 1e-8
    torque, force = four_bar.statics(crank)
    np.testing.assert_allclose(tick.torque, [torque, 0.0, 0.0], atol=1e-8)
    found = np.zeros(3)  # of the coupler on the rocker: two forces, where it is held twice
    for name, loop in robot.loops.items():
        held, other = loop.frames
        sign = 1.0 if held.endswith("rocker") else -1.0
        found += sign * here.rotation(other) @ tick.forces[f"loop {name}"]
    np.testing.assert_allclose(found, [force[0], 0.0, force[1]], atol=1e-8)


def test_a_plant_keeps_closed_under_torques_at_the_motor_alone() -> None:
    robot = load()
    q = robot.posture("standing", {"crank": 0.3})
    task = PostureTask(robot, q)
    controller = TorqueController(robot, [task], limits=Limits(robot))
    plant = Plant(robot)
    plant.reset(q)
    gap = 0.0
    for k in range(500):
        if k == 100:
            task.set_target(robot.posture("standing", {"crank": -0.5}))
        tick = controller.step(plant.snapshot())
        assert tick.ok and not tick.torque[1:].any()
        plant.step(tick.torque + [0.0, 1.0, 1.0])  # which nothing can give
        assert not plant.torque[1:].any()
        gap = max(gap, *robot.gaps(plant.state()[0]).values())
    assert gap < 1e-5
    assert abs(plant.state()[0][7] + 0.5) < 0.02


POLYNOMIAL = (0.1, -0.8, 0.3, 0.2, -0.1)


def test_polynomials_are_followed_by_postures_levels_and_the_plant() -> None:
    powers = " ".join(map(str, POLYNOMIAL))
    tie = f'<joint name="cam" joint1="rocker" joint2="crank" polycoef="{powers}"/>'
    robot = load(tie=tie)
    assert not robot.loops and list(robot.couplings) == ["rocker"]

    def cam(crank: float) -> float:
        return float(np.polyval(POLYNOMIAL[::-1], crank))

    start = robot.posture("standing", {"crank": 0.6})
    assert abs(start[9] - cam(0.6)) < 1e-15
    wanted = robot.posture("standing", {"crank": -0.7})
    task = PostureTask(robot, wanted, gain=0.05)
    controller = KinematicController(robot, [task], limits=Limits(robot, velocity=None))
    for _, q in commanded(controller, start, 100):
        assert abs(q[9] - cam(q[7])) < 1.1e-10
    assert abs(q[7] + 0.7) < 0.01
    torque, plant = TorqueController(robot, [PostureTask(robot, q)]), Plant(robot)
    plant.reset(start)
    for now in simulate(torque, plant, 0.4):
        assert now.tick.ok
        there = plant.state()[0]
        # MuJoCo leaves the curvature out of what it takes back: at 3 rad/s that is 2e-4.
        assert abs(there[9] - cam(there[7])) < 5e-4
    assert abs(there[7] + 0.7) < 0.3


def test_what_a_constraint_holds_at_a_value_is_locked() -> None:
    robot = load(tie='<joint joint1="rocker" polycoef=".2"/>')
    assert robot.joint_names == ("crank", "coupler")
    assert "joints that constraints hold at a value, locked: rocker" in robot.notes


def test_locked_joints_leave_a_loop_rigid_or_are_refused() -> None:
    closed = four_bar.joints(0.4)
    names = ("crank", "coupler", "rocker")
    robot = Robot.load(four_bar.mjcf(), locked=dict(zip(names, closed, strict=True)))
    assert not robot.loops and "loop 'pin' is rigid, with its joints locked" in robot.notes
    with pytest.raises(WbcError, match=r"loop 'pin': one rigid body .* m or rad apart"):
        Robot.load(four_bar.mjcf(), locked=dict.fromkeys(names, 0.4))
    with pytest.raises(WbcError, match=r"posture 'standing': loops: no posture near it"):
        Robot.load(four_bar.mjcf(), locked={"crank": 0.5, "coupler": 2.0})


@pytest.mark.parametrize(
    ("loops", "words"),
    [
        ({"pin": ["coupler"]}, "loop 'pin': expected two frames"),
        ({"pin": ["coupler", "coupler"]}, "loop 'pin': 'coupler' is both frames"),
        ({"pin": {"frames": ["coupler", "rocker"], "kind": "ball"}}, "kind of loop 'pin'.*point"),
        ({"pin": ["coupler", "rockers"]}, "frame of loop 'pin'.*did you mean 'rocker'"),
        ({"pin": {"frame": "coupler"}}, "loop 'pin': expected frames and kind"),
        (["coupler", "rocker"], "loops: expected"),
    ],
)
def test_loops_are_refused_by_name(loops: object, words: str) -> None:
    with pytest.raises(WbcError, match=words):
        Robot.load(four_bar.mjcf(tie=" "), loops=loops)  # type: ignore[arg-type]


def test_what_does_not_know_loops_says_so() -> None:
    from wbc.codegen.core_parts import CodegenError, core_parts
    from wbc.flight.planner import plan_turn
    from wbc.shaping import GlobalShaping

    robot = load()
    task = PostureTask(robot, robot.posture("standing"))
    words = re.escape("four_bar has loop pin, and closed loops are not supported here")
    with pytest.raises(WbcError, match=f"global shaping: {words}"):
        GlobalShaping(robot, [task])
    with pytest.raises(WbcError, match=f"turn: {words}"):
        plan_turn(robot, (0.1, 0.0, 0.0))
    controller = KinematicController(robot, [task], solver="active_set")
    with pytest.raises(CodegenError, match="closed loops: 'pin'"):
        core_parts(controller)


robot = ankle.robot


def torque_level(robot: Robot, q: np.ndarray, **given: object) -> TorqueController:
    wanted = q.copy()
    wanted[robot.joint_index("pitch") + 1] += 0.3
    return TorqueController(robot, [PostureTask(robot, wanted)], limits=Limits(robot), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
@pytest.mark.parametrize(("pitch", "roll"), ankle.POSES)
def test_torque_tick_of_loops_answers_the_qp_as_it_stands(robot, pitch, roll, solver) -> None:
    q = robot.posture("standing", {"pitch": pitch, "roll": roll})
    controller = torque_level(robot, q, solver=solver)
    for tick, _ in commanded(controller, q, 5):  # at speed, rows have ends
        whole = solve_in_core(tick.qp, 1e-9, 1000)  # nothing is known of loops there
        assert whole.status == DONE
        np.testing.assert_allclose(tick.solution.x, whole.x, atol=1e-8)
        kkt = tick.qp.P @ tick.solution.x + tick.qp.g + tick.solution.z_box
        kkt += tick.qp.A.T @ tick.solution.y + tick.qp.C.T @ tick.solution.z
        np.testing.assert_allclose(kkt, 0.0, atol=1e-8)


def test_torque_tick_of_loops_without_a_solution_is_given_a_certificate(robot: Robot) -> None:
    q = robot.posture("standing", {"pitch": 0.1})
    weak = 1e-3  # of the motors: gravity asks for more than that part of their torques
    controller = torque_level(robot, q, torque_limits=weak, solver="active_set")
    assert controller.limits is not None
    controller.limits.speed = np.full(robot.nv - 6, 1e-6)  # and none may fall
    found = controller.core.tick(robot.snapshot(q, np.zeros(robot.nv)))
    assert found is not None
    assert controller.core.memory.status == INFEASIBLE
    qp, at = found.qp_of(0), found.views_of(0)
    np.testing.assert_allclose(at.y @ qp.A + at.z @ qp.C + at.z_box, 0.0, atol=1e-9)
    ends = at.y @ qp.b
    for z, lower, upper in ((at.z, qp.l, qp.u), (at.z_box, qp.lower, qp.upper)):
        ends += sum(one * (upper[k] if one > 0 else lower[k]) for k, one in enumerate(z) if one)
    assert ends < -1e-9
