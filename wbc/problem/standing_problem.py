"""The problem file that tracks a standing motion in simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wbc.problem.source import quoted
from wbc.retargeting.reference import MotionReference
from wbc.retargeting.standing import StandingMotion
from wbc.robot import Robot

REST_AFTER = 0.5  # s: simulated time after the motion's end
DEFAULT_ARMATURE = 0.003  # kg m^2, if the robot's file has none: without it joints chatter
TEMPLATE = """\
# {source}, on a {robot} that stays on both feet: `wbc sim {name}`.
# With slower: 1.5 in {{motion: ...}} it takes more time; with lean: 0.01 the CoP is kept inside.

robot: {drives}
start: {{motion: {motion}}}
support: double

tasks:
  com: {{type: com, axes: [x, y], target: &motion {target},
        law: {{type: capture_point, gain: 3}}, weight: 30}}
  height: {{type: com, axes: [z], target: *motion, kp: 100, weight: 15}}
  spin: {{type: momentum, components: angular, target: *motion, weight: 5}}
  trunk: {{type: frame, frame: {trunk}, control: orientation, target: *motion, kp: 50, weight: 0.3}}
  posture: {{type: posture, target: *motion, kp: 30, weight: 0.3}}

controller: {{level: torque, dt: 0.002, solver: active_set, friction: 0.6}}
simulation: {{duration: {duration:.3f}}}
"""


def standing_problem(
    motion: StandingMotion,
    file: str,
    *,
    model: str,
    trunk: str,
    name: str = "FILE.yaml",
    slower: float = 1.0,
    lean: float | None = None,
) -> str:
    """Return the text of a problem that tracks a standing motion in simulation.

    ``file``: the motion's file, relative to the problem's.
    ``model``: the robot's name or file. Rotor inertias that differ between joints are left to it.
    ``trunk``: frame of the trunk, whose rotation is followed.
    ``name``: that the problem's file will have.
    ``slower``, ``lean``: as of :class:`~wbc.retargeting.reference.MotionReference`.
    """
    reference = MotionReference(motion, slower=slower, lean=lean)
    more = "" if slower == 1.0 else f", slower: {slower:g}"
    more += "" if lean is None else f", lean: {lean:g}"
    target = f"{{motion: {quoted(file)}{more}}}"
    return TEMPLATE.format(
        source=Path(motion.source).name,
        robot=motion.robot.name,
        name=name,
        drives=_robot_line(motion.robot, model),
        motion=quoted(file),
        target=target,
        trunk=quoted(trunk),
        duration=reference.ends + REST_AFTER,
    )


def _robot_line(robot: Robot, model: str) -> str:
    """Return the robot's line, with its armature if one number is that of all rotors."""
    rotors = np.unique(robot.armature)
    if len(rotors) > 1:
        return f"{{model: {quoted(model)}}}"
    rotor = float(rotors[0]) if rotors.any() else DEFAULT_ARMATURE
    return f"{{model: {quoted(model)}, armature: {rotor:g}}}  # rotors, in kg m^2 at the joints"
