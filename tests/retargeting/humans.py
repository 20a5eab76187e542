"""Humans that move as they are told: contacts and targets are known, no recording is needed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from wbc import ComTask, KinematicController, Motion, OrientationTask, PoseTask, PostureTask
from wbc.gait.swing import turned
from wbc.human import HumanBody, HumanMotion, MarkerRecording, human_robot
from wbc.human.fit import MarkerSet
from wbc.minimum_jerk import minimum_jerk
from wbc.retargeting import Retargeted, RetargetWeights
from wbc.retargeting.robot_setup import robot_setup
from wbc.retargeting.tasks import FrameTasks
from wbc.retargeting.trajectory_problem import TrajectoryProblem
from wbc.validate import Array

RATE = 50.0
BODY = HumanBody.of(1.75, 70.0, "male")
TURN = {"left": -1.0, "right": 1.0}  # of toes that point inward


def moving(
    seconds: float, sway: Array, dip: Array, feet: dict[str, Array], arm: Array, inward: float = 0.0
) -> HumanMotion:
    """Return a human whose CoM sways and dips (n,) [m], and lifts feet (n, 3) and an arm (n,).

    Toes point ``inward`` [rad].
    """
    robot = human_robot(BODY)
    bent = {"*_knee_flexion": 0.25, "*_hip_flexion": 0.12, "*_ankle_dorsiflexion": 0.12}
    q = robot.posture("neutral", bent).copy()
    start = robot.snapshot(q)
    q[2] -= np.mean([start.position(foot.frame)[2] for foot in robot.feet.values()])
    start = robot.snapshot(q)
    middle = np.mean([start.position(foot.frame) for foot in robot.feet.values()], axis=0)
    com = ComTask(robot, start.com, weight=20.0, gain=1.0)
    places = {s: start.position(robot.feet[s].frame) for s in feet}
    soles = {
        s: PoseTask(robot, foot.frame, places[s], np.eye(3), name=s, weight=100.0, gain=1.0)
        for s, foot in robot.feet.items()
    }
    trunk = OrientationTask(robot, "trunk", np.eye(3), name="trunk", weight=2.0, gain=1.0)
    posture = PostureTask(robot, q, weight=0.3, gain=1.0)
    controller = KinematicController(
        robot, [com, trunk, posture, *soles.values()], contacts=(), dt=1.0 / RATE, damping=1e-5
    )
    rows = []
    for k in range(-20, round(seconds * RATE)):  # some frames to get there
        at = max(k, 0)
        com.set_target((middle[0] + 0.02, middle[1] + sway[at], start.com[2] - 0.02 - dip[at]))
        wanted = start.q.copy()
        robot.limits.set_joint(wanted, "right_shoulder_lift", float(arm[at]))
        posture.set_target(wanted)
        for side, task in soles.items():
            task.set_target(places[side] + feet[side][at], turned(TURN[side] * inward))
        q = robot.integrate(q, controller.step(robot.snapshot(q)).velocity, 1.0 / RATE)
        if k >= 0:
            rows.append(q)
    found = np.array(rows)
    time = np.arange(len(found)) / RATE
    motion = Motion(robot, time, found[:, 7:], found[:, :7], (), "made")
    down = np.column_stack([feet[s][:, 2] < 0.01 for s in ("left", "right")])
    none = np.zeros((len(found), 0, 3))
    markers = MarkerSet((), np.zeros(0, dtype=int), np.zeros((0, 3)), BODY.dimensions)
    recording = MarkerRecording(time, ("none",), np.zeros((len(time), 1, 3)), (), up="z")
    rest = recording, markers, none, down, 6.0, 0.0, None, ()
    return HumanMotion(motion, BODY, *rest)  # type: ignore[arg-type]


def crouching(seconds: float = 2.0, inward: float = 0.0) -> HumanMotion:
    """Return a human that crouches by 15 cm, rises again and lifts its right arm."""
    t = np.arange(round(seconds * RATE)) / (seconds * RATE)
    bump = 0.5 - 0.5 * np.cos(2.0 * np.pi * t)
    still = {s: np.zeros((len(t), 3)) for s in ("left", "right")}
    return moving(seconds, 0.0 * t, 0.15 * bump, still, 0.8 * bump, inward)


def stepping(seconds: float = 3.0) -> HumanMotion:
    """Return a human that shifts its weight and takes one step ahead with its left foot."""
    t = np.arange(round(seconds * RATE)) / RATE
    feet = {s: np.zeros((len(t), 3)) for s in ("left", "right")}
    u = np.clip((t - 1.2) / 0.6, 0.0, 1.0)
    feet["left"][:, 0] = 0.2 * minimum_jerk(u)
    feet["left"][:, 2] = 0.08 * 64.0 * (u * (1.0 - u)) ** 3
    over = minimum_jerk(np.clip(t / 1.0, 0.0, 1.0)) - minimum_jerk(np.clip((t - 1.9) / 1.0, 0, 1))
    return moving(seconds, -0.085 * over, 0.0 * t, feet, 0.0 * t)


def reaching_up(seconds: float = 2.5) -> HumanMotion:
    """Return a human that stands and lifts its right arm above its head, within 0.6 s."""
    t = np.arange(round(seconds * RATE)) / RATE
    still = {s: np.zeros((len(t), 3)) for s in ("left", "right")}
    up = minimum_jerk(np.clip((t - 0.4) / 0.6, 0.0, 1.0))
    return moving(seconds, 0.0 * t, 0.0 * t, still, 2.8 * up)


def facing(human: HumanMotion, angle: float) -> HumanMotion:
    """Return a human that does the same, turned by an angle about the vertical [rad]."""
    base, R = human.motion.base, turned(angle)
    assert base is not None
    turn = Rotation.from_matrix(R) * Rotation.from_quat(base[:, 3:])
    return replace(
        human, motion=replace(human.motion, base=np.hstack((base[:, :3] @ R.T, turn.as_quat())))
    )


def trajectory_problem(motion: Retargeted, collision: bool = True) -> TrajectoryProblem:
    """Return the least squares of a retargeted motion."""
    setup = robot_setup(motion.robot, None, 0.01 if collision else None)
    tasks = FrameTasks(setup, motion.targets, RetargetWeights())
    return TrajectoryProblem(tasks, setup.collision)
