"""From a human's size to a robot's: length, time, mass, momentum and inertia."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wbc.constraints import Limits, support
from wbc.controllers.kinematic import KinematicController
from wbc.errors import InvalidInputError, shown
from wbc.gait.legs import SIDES, Legs, hip_and_ankle
from wbc.human import HumanMotion
from wbc.retargeting.body_map import BodyMap
from wbc.robot import Robot, Snapshot
from wbc.robot.postures import STANDING
from wbc.tasks import AxisTask, OrientationTask, PostureTask, Task
from wbc.validate import Array, finite_number

FROUDE, KEPT = "froude", "kept"
# Factors on the human's angular momentum, and from which one on a note tells it.
MIN_MOMENTUM_SCALE, MAX_MOMENTUM_SCALE, NOTED_MOMENTUM_SCALE = 0.5, 3.0, 1.25
DT, STEPS = 0.02, 60  # s, 1: ticks that bring a robot from standing to hanging arms


@dataclass(frozen=True)
class MotionScale:
    """What a human's motion is multiplied by.

    With lengths scaled by L and times by sqrt(L), accelerations and the Froude number v^2/(g l) are
    unchanged (Alexander and Jayes 1983): CoP and friction then scale with the body, and a motion
    that balances a human balances a robot of the same shape. With another time it does not, and the
    CoM has to be moved (:mod:`wbc.retargeting.cop_correction`).

    Attributes
    ----------
    length:
        Of the robot's legs, hip to sole, by the human's.
    time, mass:
        Duration and mass by the human's.
    human_height, robot_height:
        Of the CoM over the soles with straight legs and arms hanging [m].
    """

    length: float
    time: float
    mass: float
    human_height: float
    robot_height: float

    @property
    def angular_momentum(self) -> float:
        """Of m l^2 / t; with the Froude number's time that is m h sqrt(g h)."""
        return self.mass * self.length**2 / self.time

    @property
    def inertia(self) -> float:
        """Of m l^2."""
        return self.mass * self.length**2


@dataclass(frozen=True, eq=False)
class StandingBody:
    """Dimensions of a robot that stands with hanging arms."""

    hips: Array  # from the CoM (2, 3) [m], left and right; x forwards, z up
    com_height: float  # of the CoM over the soles with straight legs [m]
    ankle_height: float  # of the ankles over the soles [m]
    # of the arms that the robot has, by side (2,) [m], see arm_levers
    arm_levers: Mapping[str, Array]


def standing_body(robot: Robot, legs: Legs, body: BodyMap) -> StandingBody:
    """Return the dimensions of a robot that stands with an upright trunk and hanging arms."""
    start = robot.snapshot(robot.postures[STANDING])
    tasks: list[Task] = [PostureTask(robot, start.q, weight=0.02, gain=0.2)]
    for frame, R in body.upright.items():
        tasks.append(OrientationTask(robot, frame, R, name=frame, gain=0.2))
    for side, arm in body.arms.items():
        for name, frame, axis in arm.segments:
            task = AxisTask(robot, frame, (0, 0, -1), axis=axis, name=f"{side} {name}", gain=0.2)
            tasks.append(task)
    contacts, limits = support(start, "double"), Limits(robot, velocity=None)
    controller = KinematicController(
        robot, tasks, contacts=contacts, limits=limits, dt=DT, damping=1e-4
    )
    q = start.q
    for _ in range(STEPS):
        q = robot.integrate(q, controller.step(robot.snapshot(q)).velocity, DT)
    found = robot.snapshot(q)
    hips, ankles = np.stack([hip_and_ankle(found, side) for side in SIDES], axis=1)
    soles = np.array([found.position(robot.feet[side].frame) for side in SIDES])
    hip, ankle = float(np.mean(hips[:, 2])), float(np.mean(ankles[:, 2]))
    up = float(found.com[2] - np.mean(soles[:, 2])) + legs.length - (hip - ankle)
    levers = {
        side: arm_levers(robot, found, arm.shoulder, arm.forearm) for side, arm in body.arms.items()
    }
    return StandingBody(hips - found.com, up, ankle - float(np.mean(soles[:, 2])), levers)


def arm_levers(robot: Robot, snapshot: Snapshot, shoulder: str, forearm: str) -> Array:
    """Return how far upper arm and forearm displace the CoM along their directions (2,) [m].

    That is their first moments about shoulder and elbow by the whole mass: an arm that points up
    raises the CoM of a robot that hangs its arms by twice their sum.

    ``shoulder``, ``forearm``: frames at the shoulder and at the elbow; all links behind their
    joints move with them.
    """
    rotations, origins = snapshot.joint_placements
    model = robot.model
    upper_joint, elbow = (robot.frame(name).parentJoint for name in (shoulder, forearm))
    places = [snapshot.position(name) for name in (shoulder, forearm)]
    distal = set(model.subtrees[elbow])
    mass, moments = 0.0, np.zeros((2, 3))
    for joint in model.subtrees[upper_joint]:
        body, part = model.inertias[joint], int(joint in distal)
        com = origins[joint] + rotations[joint] @ body.lever
        moments[part] += body.mass * (com - places[part])
        mass += part * body.mass
    moments[0] += mass * (places[1] - places[0])
    return np.linalg.norm(moments, axis=1) / robot.mass


def motion_scale(
    human: HumanMotion, robot: Robot, legs: Legs, standing: StandingBody, duration: str | float
) -> MotionScale:
    """Return the scale from a human to a robot with these legs.

    ``duration``: ``froude``: times scale with the square root of lengths; ``kept``: they stay; or a
    factor.
    """
    body = human.motion.robot
    upright = body.snapshot(body.postures["neutral"])
    sole = np.mean([upright.position(foot.frame)[2] for foot in body.feet.values()])
    length = (legs.length + standing.ankle_height) / float(upright.position("left_thigh")[2] - sole)
    if isinstance(duration, str):
        if duration not in (FROUDE, KEPT):
            raise InvalidInputError(
                f"retarget, duration: expected {FROUDE!r}, {KEPT!r} or a factor, got"
                f" {shown(duration)}"
            )
        time = math.sqrt(length) if duration == FROUDE else 1.0
    else:
        time = finite_number("retarget, duration", duration, above=0.0)
    height = float(upright.com[2] - sole)
    return MotionScale(length, time, robot.mass / human.body.mass, height, standing.com_height)


def momentum_scale(own: Array, human: Array, weights: Array) -> float:
    """Return the factor on the human's angular momentum at which the robot's is nearest to it.

    A robot whose arms are a larger part of its mass has more momentum in the same motion. At the
    human's, scaled by m h sqrt(g h), it could not raise its arms as far.

    ``own``, ``human``: of the robot, and of the human, scaled (n, 3) [kg m^2/s]; ``weights``: of
    the three axes (3,).
    """
    square = float(np.square(weights * human).sum())
    if square == 0.0:
        return 1.0
    factor = float((weights**2 * own * human).sum()) / square
    return min(max(factor, MIN_MOMENTUM_SCALE), MAX_MOMENTUM_SCALE)


def momentum_notes(scale: float) -> list[str]:
    """Return a note on a factor that is far from 1."""
    if 1.0 / NOTED_MOMENTUM_SCALE < scale < NOTED_MOMENTUM_SCALE:
        return []
    return [
        f"the angular momentum is {scale:.2f} times the human's, scaled: arms and legs have another"
        " part of the mass"
    ]
