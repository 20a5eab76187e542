"""The torque level against recursive dynamics, exact cones, hostile states, and dry friction."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests import urdf
from tests.standing import stack, standing
from tests.urdf import link
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.simulation import Plant

Load = Callable[[str], Robot]
ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")


@pytest.fixture
def here(g1: Robot) -> Snapshot:
    return standing(g1)


def disturbed(here: Snapshot, rng: np.random.Generator, size: float) -> Snapshot:
    robot = here.robot
    q = robot.integrate(here.q, size * rng.normal(size=robot.nv), 1.0)
    return robot.snapshot(q, 3.0 * size * rng.normal(size=robot.nv))


def generalized(here: Snapshot, forces: dict[str, np.ndarray]) -> np.ndarray:
    """Sum of J' f by Pinocchio's own Jacobians, computed afresh."""
    model, total = here.robot.model, np.zeros(here.robot.nv)
    data = model.createData()
    for frame, wrench in forces.items():
        J = pin.computeFrameJacobian(
            model, data, here.q, model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED
        )
        total += J.T @ wrench
    return total


def test_a_root_without_mass_stands() -> None:
    """It turns between its hips without moving a mass: the mass matrix has no inverse."""
    parts, sole = ['<link name="trunk"/>'], urdf.collision('box size="0.2 0.08 0.04"')
    for side, y in (("left", 0.1), ("right", -0.1)):
        parts += [urdf.link(f"{side}_thigh", at="0 0 -0.1"), urdf.link(f"{side}_foot", sole)]
        hip, knee = f"{side}_hip", f"{side}_knee"
        parts.append(urdf.joint(hip, "trunk", f"{side}_thigh", at=f"0 {y} 0"))
        parts.append(urdf.joint(knee, f"{side}_thigh", f"{side}_foot", at="0 0 -0.3"))
    robot = Robot.load(urdf.robot("massless root", *parts))
    s = robot.snapshot(robot.posture())
    assert abs(np.linalg.eigvalsh(s.mass_matrix)[0]) < 1e-12
    tasks = [wbc.PostureTask(robot, s.q)]
    contacts = wbc.support(s, "double")
    tick = wbc.TorqueController(robot, tasks, contacts=contacts, limits=wbc.Limits(robot)).step(s)
    assert not tick.relaxed and float(np.abs(tick.acceleration).max()) < 0.1


def test_contacts_that_legs_cannot_hold_independently_are_told(g1, caplog) -> None:
    """Legs without an ankle's roll: where soles drift, torques of an H1 reached 450 N m."""
    parts, sole = [urdf.link("trunk")], urdf.collision('box size="0.2 0.08 0.04"')
    for side, y in (("left", 0.1), ("right", -0.1)):
        above = "trunk"
        for name, axis, z in (("r", "1 0 0", 0), ("p", "0 1 0", 0), ("k", "0 1 0", -0.3),
                              ("a", "0 1 0", -0.3)):  # fmt: skip
            below = f"{side}_foot" if name == "a" else f"{side}_{name}_link"
            place = f"0 {y if name == 'r' else 0} {z}"
            parts.append(urdf.link(below, sole if name == "a" else ""))
            parts.append(urdf.joint(f"{side}_{name}", above, below, at=place, axis=axis))
            above = below
    robot = Robot.load(urdf.robot("no ankle roll", *parts))
    for one, kind, told in ((robot, wbc.Contact, True), (robot, wbc.LineContact, False),
                            (g1, wbc.Contact, False)):  # fmt: skip
        caplog.clear()
        s = one.snapshot(one.posture())
        contacts = [kind.hold(s, foot.frame) for foot in one.feet.values()]
        wbc.TorqueController(one, [wbc.PostureTask(one, s.q)], contacts=contacts).step(s)
        assert ("left_sole rx" in caplog.text and "LineContact" in caplog.text) is told


@pytest.mark.parametrize("told", [False, True])
@pytest.mark.parametrize("weight", [1.0, 0.01])
def test_a_bolted_arm_with_gears_does_not_sag(weight: float, told: bool) -> None:
    """Forces in its bolts and gears cost nothing: its motion determines them, and it let go.

    Its bolts are also among what ``support`` returns, as in problem files: there they did cost.
    """
    robot = Robot.load(urdf.geared_arm(at="0.3 0 0", limits=urdf.limit(2, 90, 2)))
    s = robot.snapshot(robot.posture())
    assert robot.fixed_base and len(robot.couplings) == 2
    contacts = wbc.support(s, "floating") if told else ()
    tasks = [wbc.PostureTask(robot, s.q, weight=weight)]
    tick = wbc.TorqueController(robot, tasks, contacts=contacts).step(s)
    assert float(np.abs(tick.acceleration).max()) < 0.01  # rad/s^2; it was 0.03 and 11


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("mode", ["double", "left", "floating"])
def test_torque_is_what_recursive_newton_euler_needs(name, mode, robot_named) -> None:
    """Oracle: Pinocchio's RNEA at the tick's acceleration, less its forces; exact to rounding."""
    robot = robot_named(name)
    here, rng = standing(robot), np.random.default_rng(3)
    bounds = robot.limits.effort
    for k in range(4):
        there = disturbed(here, rng, 0.02)
        contacts = wbc.support(there, mode)
        controller = wbc.TorqueController(
            robot,
            stack(here),
            contacts=contacts,
            limits=wbc.Limits(robot),
            solver=("proxqp", "daqp")[k % 2],
        )
        tick = controller.step(there)
        needed = pin.rnea(
            robot.model, robot.model.createData(), there.q, there.v, tick.acceleration
        )
        needed -= generalized(there, tick.forces)
        needed[6:] += robot.model.damping[6:] * tick.velocity[6:]  # no part of rnea
        size = np.abs(needed).max() + 9.81 * robot.mass
        assert np.abs(needed[:6]).max() < 1e-9 * size
        clipped = np.clip(needed[6:], -bounds, bounds)  # by what a solver leaves at a bound
        np.testing.assert_allclose(needed[6:], clipped, atol=1e-5 * size)
        np.testing.assert_allclose(tick.torque, clipped, atol=1e-9 * size)
        for frame, (points, forces) in tick.corner_forces.items():
            assert len(points) == len(forces)
            for force in forces @ there.rotation(frame):  # in the sole's axes
                # 1e-8 of an unknown is 1e-8 m / dt newton.
                assert np.hypot(*force[:2]) <= 0.6 * force[2] + 1e-6 * robot.mass / 0.002
        assert set(tick.forces) == {contact.name for contact in contacts}


def test_what_cannot_be_kept_gives_way_by_name(g1: Robot, here: Snapshot) -> None:
    """A sole that rushes upwards cannot be stopped by forces that only push."""
    v = np.zeros(g1.nv)
    v[2] = 2.0
    there = g1.snapshot(here.q, v)
    controller = wbc.TorqueController(
        g1, stack(here), contacts=wbc.support(here, "double"), limits=wbc.Limits(g1)
    )
    tick = controller.step(there)
    assert tick.ok and tick.policy == "relax"
    assert any("sole" in name for name in tick.relaxed)
    assert "gave way" in tick.report()
    # The strongest thing legs can do is pull their feet down no faster than torques allow.
    assert (np.abs(tick.torque) <= g1.limits.effort).all()


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_every_command_is_finite_and_inside_the_torque_bounds(solver: str, g1: Robot) -> None:
    """States no stance can be in: limits exceeded, feet off the ground, rushing joints."""
    here, rng = standing(g1), np.random.default_rng(5)
    contacts = wbc.support(here, "double")
    controller = wbc.TorqueController(
        g1,
        stack(here),
        contacts=contacts,
        limits=wbc.Limits(g1),
        constraints=[wbc.SelfCollision(g1, margin=0.01)],
        solver=solver,
    )
    relaxed = 0
    for _ in range(40):
        tick = controller.step(disturbed(here, rng, 0.3))
        assert np.isfinite(tick.torque).all() and np.isfinite(tick.velocity).all()
        assert (np.abs(tick.torque) <= g1.limits.effort).all()
        assert tick.ok, tick.report()  # the last resort is for what we have not seen
        relaxed += tick.policy == "relax"
    assert relaxed > 15


def test_a_surface_of_unknown_shape_is_refused(g1: Robot, here: Snapshot) -> None:
    hand = next(name for name in g1.frame_names if "wrist_yaw" in name)
    with pytest.raises(InvalidInputError, match="corners"):
        wbc.TorqueController(g1, stack(here), contacts=[wbc.Contact.hold(here, hand)])
    for held in (
        wbc.Contact.hold(here, hand, friction=None),
        wbc.Contact.hold(here, hand, corners=[[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]]),
        wbc.PointContact.hold(here, hand),
    ):
        tick = wbc.TorqueController(
            g1, stack(here), contacts=[*wbc.support(here, "double"), held]
        ).step(here)
        assert tick.ok and tick.policy is None, tick.report()
        assert tick.forces[hand].shape == (6,)


def test_normal_forces_keep_their_range(g1: Robot, here: Snapshot) -> None:
    left, right = wbc.support(here, "double")
    left.friction = wbc.FrictionCone(least=30.0, most=80.0)
    controller = wbc.TorqueController(g1, stack(here), contacts=[left, right], solver="daqp")
    tick = controller.step(here)
    assert tick.policy is None
    assert tick.forces["left_sole"][2] == pytest.approx(80.0, abs=1e-2)
    left.friction = wbc.FrictionCone(0.1, most=40.0, facets=8)  # a ramp, and another cone
    tick = controller.step(here)
    assert tick.forces["left_sole"][2] == pytest.approx(40.0, abs=1e-2)
    left.friction = wbc.FrictionCone(least=1e4)  # more than the ground can be pushed with
    tick = controller.step(here)
    assert tick.ok and tick.forces["left_sole"][2] < 1e4


def test_what_has_no_effect_at_this_level_is_said(hoap2, caplog) -> None:
    here = standing(hoap2)
    tasks = [wbc.ComTask(hoap2, here.com, singular_threshold=5e-4)]
    wbc.TorqueController(hoap2, tasks, contacts=wbc.support(here, "double"))
    assert "singular_threshold of task 'com' has no effect" in caplog.text
    caplog.clear()
    posture = wbc.PostureTask(hoap2, here.q)
    later = wbc.TorqueController(hoap2, [posture], contacts=wbc.support(here, "double"))
    later.change(tasks=[posture, *tasks])
    assert "singular_threshold of task 'com' has no effect" in caplog.text
    caplog.clear()
    first, second = wbc.ComTask(hoap2, here.com, gain=0.3), wbc.ComTask(hoap2, here.com, kp=50.0)
    both = wbc.ComTask(hoap2, here.com, gain_per_second=5.0, kd=9.0)
    for task in (first, second, both, wbc.ComTask(hoap2, here.com)):
        wbc.TorqueController(hoap2, [task], contacts=wbc.support(here, "double"))
        wbc.KinematicController(hoap2, [task], contacts=wbc.support(here, "double"))
    assert [record.getMessage() for record in caplog.records] == [
        "controller: gain of task 'com' has no effect at the torque level; give kp, kd",
        "controller: kp, kd of task 'com' has no effect at the velocity level; give gain",
    ]


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_motors_have_bounds_and_what_follows_them_has_none(geared: Robot, share: float) -> None:
    """At random accelerations without forces: a row holds where Pinocchio's RNEA is in bounds."""
    rng = np.random.default_rng(6)
    q = geared.integrate(geared.posture(), 0.1 * rng.normal(size=geared.nv), 1.0)
    here = geared.snapshot(q, np.where(np.arange(geared.nv) < 6, 0.0, 0.1))
    most = share * geared.limits.effort
    controller = wbc.TorqueController(
        geared, [wbc.PostureTask(geared, q)], contacts=[], torque_limits=share, solver="daqp"
    )
    qp = controller.step(here).qp
    motors = [name for name in geared.joint_names if name not in geared.couplings]
    assert geared.couplings and qp.labels.inequality == tuple(f"{name} torque" for name in motors)
    bounds = np.array([most[geared.joint_index(name) - 6] for name in motors])
    unit, data, crossed = geared.mass / controller.dt, geared.model.createData(), 0
    np.testing.assert_allclose(unit * (qp.u - qp.l), 2.0 * bounds)
    for _ in range(40):
        v = here.v + controller.dt * np.append(np.zeros(6), 300.0 * rng.normal(size=geared.nv - 6))
        needed = pin.rnea(geared.model, data, here.q, here.v, (v - here.v) / controller.dt)
        torques = np.array([needed[geared.joint_index(name)] for name in motors])
        values = qp.C @ np.append(v, np.zeros(qp.g.size - geared.nv))
        np.testing.assert_allclose(unit * (qp.u - values), bounds - torques, atol=1e-7 * unit)
        crossed += np.count_nonzero(np.abs(torques) > bounds)
    assert crossed


ARM = """<mujoco><compiler angle="radian"/><worldbody>
<body name="b"><joint name="j1" axis="0 0 1" range="-3 3"/>
 <geom type="capsule" size=".04" fromto="0 0 0 0 0 .3" mass="2"/>
 <body name="c" pos="0 0 .3"><joint name="j2" axis="0 1 0" range="-2 2"/>
  <geom type="capsule" size=".04" fromto="0 0 0 .3 0 0" mass="1"/></body></body></worldbody>
<actuator><motor joint="j1" ctrlrange="-50 50"/><motor joint="j2" ctrlrange="-50 50"/></actuator>
</mujoco>"""


def test_an_arm_whose_joint_is_bolted_to_the_world_is_held(tmp_path: Path) -> None:
    """Its base has no mass, so that base and first joint turn the same; torques by Pinocchio."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    arm = wbc.Robot.load(path)
    here = arm.snapshot(arm.posture("standing"), np.zeros(arm.nv))
    assert arm.fixed_base and np.linalg.matrix_rank(here.mass_matrix) < arm.nv
    tick = wbc.TorqueController(arm, [wbc.PostureTask(arm, here.q)], contacts=()).step(here)
    data, still = arm.model.createData(), np.zeros(arm.nv)
    held = pin.rnea(arm.model, data, here.q, still, still)[6:]
    np.testing.assert_allclose(tick.torque, held, rtol=1e-3, atol=1e-9)  # damping takes 1e-4
    assert abs(held[1]) > 1.0


def test_bolts_named_by_support_hold_where_a_joint_is_too_weak_for_its_load(tmp_path: Path) -> None:
    """The second joint cannot lift its link at its stop: the base does not fall with it."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM.replace('range="-2 2"', 'range="-2 0"').replace("-50 50", "-.5 .5"))
    arm = wbc.Robot.load(path)
    here = arm.snapshot(arm.posture("neutral"), np.zeros(arm.nv))
    tasks, limits = [wbc.PostureTask(arm, here.q)], wbc.Limits(arm)
    for contacts in ((), wbc.support(here, "floating")):
        tick = wbc.TorqueController(arm, tasks, contacts=contacts, limits=limits).step(here)
        assert tick.relaxed == ("j2",)
        np.testing.assert_allclose(tick.acceleration[:6], 0.0, atol=1e-6)


def test_a_box_without_joints_stands_on_its_corners() -> None:
    """A robot whose joints are all locked is one, too."""
    box = wbc.Robot.load(f'<robot name="box">{link("it", mass=2)}</robot>', base="floating")
    here = box.snapshot(box.posture("neutral"))
    corners = [[0.1, 0.1, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1], [0.1, -0.1, -0.1]]
    tick = wbc.TorqueController(
        box,
        [wbc.ComTask(box, here.com)],
        contacts=[wbc.Contact.hold(here, "it", corners=corners)],
        limits=wbc.Limits(box),
    ).step(here)
    np.testing.assert_allclose(tick.forces["it"], [0, 0, box.weight, 0, 0, 0], atol=1e-6)
    with pytest.raises(InvalidInputError, match="box has no joint; leave the task out"):
        wbc.PostureTask(box, here.q)


DT, SECONDS = 0.002, 2.0


def controller_of(robot: Robot, part: float) -> wbc.TorqueController:
    start = robot.snapshot(robot.posture("standing"))
    trunk = wbc.OrientationTask(robot, "base", start.rotation("base"))
    posture = wbc.PostureTask(robot, start.q, weight=0.01)
    tasks = [wbc.ComTask(robot, start.com), trunk, posture]
    held = wbc.support(start, "double")
    return wbc.TorqueController(
        robot, tasks, contacts=held, dt=DT, solver="active_set", friction_compensation=part
    )


def off(robot: Robot, part: float) -> float:
    """Return how far the CoM is from its way down and up, root mean square [m]."""
    controller, plant = controller_of(robot, part), Plant(robot, dt=DT)
    com = next(task for task in controller.tasks if isinstance(task, wbc.ComTask))
    start, errors = plant.com.copy(), []
    for k in range(round(SECONDS / DT)):
        angle = np.pi * k * DT
        down = 0.01 * np.array((1.0 - np.cos(angle), np.pi * np.sin(angle)))
        com.set_target(start - [0.0, 0.0, down[0]], rate=[0.0, 0.0, -down[1]])
        tick = controller.step(plant.snapshot())
        assert (np.abs(tick.torque) <= controller.torque_bounds).all()
        plant.step(tick.torque)
        errors.append(plant.com - com.target)
    return float(np.sqrt(np.mean(np.square(errors).sum(axis=1))))


def test_a_robot_with_dry_friction_goes_where_it_should() -> None:
    robot = Robot.load("hoap2_like", friction={"*": 1.0})  # of 9 N m
    behind, there = off(robot, 0.0), off(robot, 1.0)
    assert behind > 2e-3
    assert there < 0.35 * behind


def test_without_dry_friction_nothing_is_added(hoap2: Robot) -> None:
    rng = np.random.default_rng(3)
    plain, helped = (controller_of(hoap2, part) for part in (0.0, 1.0))
    for _ in range(5):
        v = 0.1 * rng.normal(size=hoap2.nv)
        here = hoap2.snapshot(hoap2.posture("standing"), v)
        np.testing.assert_array_equal(plain.step(here).torque, helped.step(here).torque)


def test_joints_without_a_motor_are_not_helped() -> None:
    free = ["left_elbow_pitch"]
    robot = Robot.load("hoap2_like", friction={"*": 0.5}, unactuated=free)
    k = robot.joint_names.index(free[0])
    v = np.zeros(robot.nv)
    v[6 + k] = 3.0
    here = robot.snapshot(robot.posture("standing"), v)
    none, all_ = (controller_of(robot, part).step(here).torque for part in (0.0, 1.0))
    assert none[k] == all_[k]
    assert np.abs(all_ - none).max() > 0.1
