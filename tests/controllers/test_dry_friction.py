"""Dry friction that torques make up for, judged by how a robot with it moves in MuJoCo."""

import numpy as np

import wbc
from wbc.robot import Robot
from wbc.simulation import Plant

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
