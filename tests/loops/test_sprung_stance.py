"""A table on four legs whose shanks are springs: all that its motors press on gives way."""

import numpy as np
import pytest

import wbc
from wbc.robot import Robot
from wbc.simulation import Plant, simulate

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
