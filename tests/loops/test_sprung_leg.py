"""A leg with the topology of Cassie's, its own numbers, against MuJoCo with the loops closed.

A rod with a universal joint goes from the thigh to a sprung heel, a crank drives the foot by a
second rod; shin and heel are springs. Motors: hip roll, hip pitch, knee, crank.
"""

from typing import Any

import numpy as np
import pytest

import wbc
from tests.standing import commanded
from wbc import KinematicController, Limits, PositionTask, PostureTask, TorqueController
from wbc.robot import Robot
from wbc.simulation import Plant, simulate

mujoco: Any = pytest.importorskip("mujoco")


def body(name: str, pos: str, joint: str, mass: float, com: str, inside: str = "") -> str:
    size = 0.01 * mass
    return (
        f'<body name="{name}" pos="{pos}">{joint}<inertial pos="{com}" mass="{mass}"'
        f' diaginertia="{size} {size} {size}"/>{inside}</body>'
    )


def hinge(name: str, axis: str = "0 1 0", more: str = 'range="-1.2 1.2"') -> str:
    return f'<joint name="{name}" axis="{axis}" {more}/>'


SPRING = 'stiffness="{}" range="-.35 .35"'
FOOT = body("foot", ".42 0 0", hinge("foot", "0 1 .1"), 0.15, ".03 0 -.02")
CRANK = body(
    *("crank", ".05 .05 -.02", hinge("crank", "0 1 .1"), 0.12, ".02 0 0"),
    body("plantar", ".06 0 0", hinge("plantar", "0 1 .1"), 0.1, ".18 0 0"),
)
HEEL = body("heel", "-.01 0 .05", hinge("heel", more=SPRING.format(1200)), 0.12, "0 0 .03")
TARSUS = body("tarsus", ".43 0 -.02", hinge("tarsus"), 0.8, ".2 0 0", HEEL + CRANK + FOOT)
SHIN = body("shin", ".1 0 0", hinge("shin", more=SPRING.format(1500)), 0.6, ".2 0 0", TARSUS)
KNEE = body("knee", ".12 0 -.1", hinge("knee"), 0.8, ".05 0 .01", SHIN)
ROD = body("rod", ".0 .06 .02", hinge("rod y") + hinge("rod z", "0 0 1"), 0.16, ".25 0 0")
THIGH = body("thigh", "0 0 -.09", hinge("pitch"), 5.0, ".06 0 -.03", KNEE + ROD)
HIP = body("hip", ".02 .13 -.1", hinge("roll", "1 0 0"), 1.8, ".0 .02 -.04", THIGH)
MOTORS = ("roll", "pitch", "knee", "crank")
XML = f"""<mujoco model="sprung_leg"><compiler angle="radian"/><worldbody>
  <body name="pelvis" pos="0 0 1.1">
    <inertial pos="0 0 .05" mass="10" diaginertia=".1 .08 .09"/>{HIP}
  </body></worldbody>
  <equality>
    <connect name="achilles" body1="heel" body2="rod" anchor="0 0 .06"/>
    <connect name="plantar" body1="plantar" body2="foot" anchor=".36 0 0"/>
    <connect name="spare" body1="foot" body2="rod" anchor="0 0 0" active="false"/>
  </equality>
  <actuator>{"".join(f'<motor joint="{one}" ctrlrange="-90 90"/>' for one in MOTORS)}</actuator>
</mujoco>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(XML)


@pytest.fixture(scope="module")
def model(robot: Robot) -> Any:
    model = mujoco.MjModel.from_xml_string(XML)
    names = tuple(model.joint(k).name for k in range(model.njnt))
    assert names == robot.joint_names  # the same coordinates, in the same order
    model.opt.tolerance, model.opt.iterations = 0.0, 100
    return model


def closed_states(robot: Robot, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Random configurations with closed loops, and velocities that keep them so."""
    rng, found = np.random.default_rng(3), []
    while len(found) < count:
        motors = dict(zip(MOTORS, rng.uniform(-0.25, 0.25, 4), strict=True))
        q = robot.posture("standing", {**motors, "shin": 0.02, "heel": -0.01})
        _, J = robot.closure.errors(q)
        J = J[:, 6:]
        free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-8) :].T
        found.append((q, np.concatenate((np.zeros(6), free @ rng.normal(size=free.shape[1])))))
    return found


def test_what_is_read(robot: Robot) -> None:
    assert list(robot.loops) == ["achilles", "plantar"]
    assert set(robot.unactuated) == {*robot.joint_names} - {*MOTORS}
    assert "equality constraints that are not active: spare" in robot.notes
    assert set(robot.passive.springs) == {"shin", "heel"}
    assert max(robot.gaps(robot.postures["standing"]).values()) < 1e-12


def test_springs_stay_at_rest_where_other_joints_close_the_loops(robot: Robot) -> None:
    q = robot.posture("standing", {"knee": -0.2, "crank": 0.15})
    assert max(robot.gaps(q).values()) < 1e-9
    held = [robot.joint_names.index(joint) for joint in ("shin", "heel", *MOTORS)]
    np.testing.assert_array_equal(
        robot.limits.joint_positions(q)[held], [0.0, 0.0, 0.0, 0.0, -0.2, 0.15]
    )


def test_motion_and_forces_obey_mujocos_own_equations(robot: Robot, model: Any) -> None:
    """M a + bias = tau + springs + J' f with its M, bias, springs and J, moving at 1 rad/s.

    Loops stay closed to second order: differences over 3e-5 s at 300 rad/s^2 leave 1e-6 of the
    fourth derivative, and 1e-6 of rounding.
    """
    data, h = mujoco.MjData(model), 3e-5
    for q, v in closed_states(robot, 5):
        here = robot.snapshot(q, v)
        task = PostureTask(robot, robot.posture("standing"), kp=50.0)
        tick = TorqueController(robot, [task], torque_limits=None).step(here)
        assert tick.ok and not tick.torque[[k not in MOTORS for k in robot.joint_names]].any()
        a = tick.acceleration[6:]
        data.qpos[:], data.qvel[:] = q[7:], v[6:]
        mujoco.mj_forward(model, data)
        J, inertial = data.efc_J[: 6 * model.nv].reshape(6, model.nv), np.zeros(model.nv)
        mujoco.mj_mulM(model, data, inertial, a)
        pull = np.zeros(model.nv)
        for k, (name, loop) in enumerate(robot.loops.items()):
            # MuJoCo's rows are of the first body's point less the second's, in the world's axes.
            force = here.rotation(loop.frames[1]) @ tick.forces[f"loop {name}"]
            pull -= J[3 * k : 3 * k + 3].T @ force
        left = inertial + data.qfrc_bias - data.qfrc_passive - tick.torque - pull
        assert np.abs(left).max() < 1e-9 * np.abs(data.qfrc_bias).max()

        def gaps(t: float, q: np.ndarray = q, v: np.ndarray = v, tick=tick) -> np.ndarray:
            there = robot.integrate(q, v * t + 0.5 * tick.acceleration * t * t, 1.0)
            return robot.closure.errors(there)[0]

        assert np.abs(gaps(h) - 2.0 * gaps(0.0) + gaps(-h)).max() / h**2 < 5e-6


def test_accelerations_are_mj_forwards(robot: Robot, model: Any) -> None:
    """At rest, where MuJoCo leaves nothing out; its softness (1 - d)/d taken to 0.

    By the parabola through three of them; of third order 1e-7 is left.
    """
    data = mujoco.MjData(model)
    for q, _ in closed_states(robot, 5):
        task = PostureTask(robot, robot.posture("standing"), kp=50.0)
        tick = TorqueController(robot, [task], torque_limits=None).step(robot.snapshot(q))
        found, soft = [], []
        for d in (0.9999, 0.9998, 0.9996):
            model.eq_solimp[:, :2] = d
            data.qpos[:], data.qvel[:] = q[7:], 0.0
            data.qfrc_applied[:] = tick.torque
            mujoco.mj_forward(model, data)
            found.append(data.qacc.copy())
            soft.append((1.0 - d) / d)
        rigid = np.linalg.solve(np.vander(soft, increasing=True), np.array(found))[0]
        size = np.abs(rigid).max()
        assert np.abs(tick.acceleration[6:] - rigid).max() < 1e-6 * size


def test_the_foot_is_led_by_both_levels(robot: Robot) -> None:
    start = robot.posture("standing")
    goal = robot.snapshot(robot.posture("standing", {"knee": -0.2, "crank": 0.15})).position("foot")
    tasks = [
        PositionTask(robot, "foot", goal, kp=60.0, gain=0.05),
        PostureTask(robot, start, weight=0.003, kp=10.0),
    ]
    controller = KinematicController(robot, tasks, limits=Limits(robot, velocity=None))
    for _, q in commanded(controller, start, 250):
        assert max(robot.gaps(q).values()) < 1e-9
    assert np.linalg.norm(robot.snapshot(q).position("foot") - goal) < 2e-3  # the posture's pull
    torque, plant = TorqueController(robot, tasks, limits=Limits(robot)), Plant(robot)
    plant.reset(start)
    for now in simulate(torque, plant, 1.2):
        assert now.tick.ok
    there = plant.snapshot()
    assert max(robot.gaps(there.q).values()) < 1e-4
    assert np.linalg.norm(there.position("foot") - goal) < 0.02


CORNERS = {
    "front_left": (0.2, 0.12),
    "front_right": (0.2, -0.12),
    "hind_left": (-0.2, 0.12),
    "hind_right": (-0.2, -0.12),
}
MOTOR = 'axis="0 1 0" range="-2.6 2.6" armature=".05" damping=".5"'


def leg(corner: str, x: float, y: float, stiffness: float) -> str:
    return f"""<body name="{corner}_thigh" pos="{x} {y} 0"><joint name="{corner}_hip" {MOTOR}/>
      <inertial pos="0 0 -.1" mass="1.5" diaginertia=".01 .01 .002"/>
      <body name="{corner}_knee" pos="0 0 -.25"><joint name="{corner}_knee" {MOTOR}/>
        <inertial pos="0 0 -.02" mass=".3" diaginertia=".001 .001 .001"/>
        <body name="{corner}_foot" pos="0 0 -.05">
          <joint name="{corner}_spring" axis="0 1 0" stiffness="{stiffness}" range="-.3 .3"/>
          <inertial pos="0 0 -.1" mass=".15" diaginertia=".001 .001 .0001"/>
          <geom type="sphere" size=".02" pos="0 0 -.2"/></body></body></body>"""


def table(stiffness: float) -> tuple[Robot, np.ndarray]:
    """Return the robot, and where it stands with its springs at rest."""
    legs = "".join(leg(corner, *place, stiffness) for corner, place in CORNERS.items())
    driven = [f"{corner}_{joint}" for corner in CORNERS for joint in ("hip", "knee")]
    motors = "".join(f'<motor joint="{joint}" ctrlrange="-80 80"/>' for joint in driven)
    robot = Robot.load(
        '<mujoco model="table"><compiler angle="radian"/><worldbody><body name="trunk">'
        '<freejoint/><inertial pos="0 0 .05" mass="20" diaginertia=".3 .5 .6"/>'
        f"{legs}</body></worldbody><actuator>{motors}</actuator></mujoco>",
        unactuated=["*_spring"],
    )
    return robot, robot.posture("standing", {"*_hip": -0.5, "*_knee": 1.0})


def controller(robot: Robot, q: np.ndarray, **settings: float) -> wbc.TorqueController:
    start = robot.snapshot(q)
    tasks = [
        wbc.ComTask(robot, start.com),
        wbc.OrientationTask(robot, "base", start.rotation("base")),
        wbc.PostureTask(robot, q, joints={"*_spring": 0.0}, weight=0.1),
    ]
    kept = {"contacts": wbc.support(start, "all"), "limits": wbc.Limits(robot)}
    return wbc.TorqueController(robot, tasks, solver="active_set", **kept, **settings)


@pytest.mark.parametrize("stiffness", [300.0, 1500.0, 6000.0])
def test_a_robot_on_springs_stands_and_takes_a_push(stiffness: float) -> None:
    robot, q = table(stiffness)
    plant, torques = Plant(robot, dt=0.002), []
    plant.reset(q)
    plant.push("base", (40.0, 0.0, 0.0), "com", start=0.5, duration=0.1)
    for now in simulate(controller(robot, q), plant, 2.5):
        torques.append(now.tick.torque)
        assert not now.tick.relaxed
    assert now.verdict.stood
    assert np.abs(np.diff(torques[-300:], axis=0)).max() < 1e-2  # N m from tick to tick


@pytest.mark.parametrize("spring_time", [0.0, 0.02])
def test_springs_force_less_by_what_they_give_way(spring_time: float) -> None:
    """M a + bias = tau - damping v + J' f - k (x + spring_time^2 a)."""
    robot, q = table(1500.0)
    rng = np.random.default_rng(4)
    v = 0.1 * rng.normal(size=robot.nv)
    q = robot.integrate(q, 0.02 * rng.normal(size=robot.nv), 1.0)
    here = robot.snapshot(q, v)
    tick = controller(robot, q, spring_time=spring_time).step(here)
    assert tick.ok
    left = here.mass_matrix @ tick.acceleration + here.bias - robot.passive_forces(q, v)
    left[6:] += robot.damping * (v + tick.acceleration * 0.002)[6:] - tick.torque
    for foot in robot.feet.values():
        left -= here.jacobian(foot.frame)[:3].T @ tick.forces[foot.frame].reshape(-1)[:3]
    springs = [robot.joint_index(f"{corner}_spring") for corner in CORNERS]
    left[springs] += 1500.0 * spring_time**2 * tick.acceleration[springs]
    assert np.abs(left).max() < 1e-9 * np.abs(here.bias).max()
