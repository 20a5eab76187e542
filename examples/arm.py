"""A fixed arm: the tool follows a circle, and the redundant joint keeps the elbow in place.

Any URDF or MJCF file loads; ``base="fixed"`` bolts the root link down. The panda's file comes with
the extra ``wbc[robots]``.
"""

import importlib.metadata
import math

import numpy as np

import wbc

data = importlib.metadata.distribution("example-robot-data")
robots = data.locate_file("cmeel.prefix/share/example-robot-data/robots")
fingers = {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}
robot = wbc.Robot.load(f"{robots}/panda_description/urdf/panda.urdf", base="fixed", locked=fingers)
q = robot.posture("neutral", joints={"*joint2": -0.4, "*joint4": -2.2, "*joint6": 1.9})
v, dt = None, 0.005
start = robot.snapshot(q)
centre = start.position("panda_hand")
tool = wbc.PositionTask(robot, "panda_hand", centre, name="tool", weight=10.0)
controller = wbc.KinematicController(
    robot,
    [
        tool,
        wbc.OrientationTask(robot, "panda_hand", start.rotation("panda_hand"), name="wrist"),
        wbc.PostureTask(robot, q, weight=0.01),
    ],
    contacts=wbc.support(start, "floating"),  # for a fixed base: the base itself
    limits=wbc.Limits(robot),
    dt=dt,
)

radius, period, worst = 0.1, 4.0, 0.0  # m, s
for k in range(800):
    phase = 2.0 * math.pi * k * dt / period
    turn = phase - math.sin(phase)  # from rest to rest, for the acceleration limits
    speed = 2.0 * math.pi / period * (1.0 - math.cos(phase))
    out = radius * np.array([0.0, math.sin(turn), 1.0 - math.cos(turn)])
    rate = radius * speed * np.array([0.0, math.cos(turn), math.sin(turn)])
    tool.set_target(centre + out, rate=rate)
    tick = controller.step(robot.snapshot(q, v))
    worst = max(worst, float(np.linalg.norm(tick.errors["tool"])))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
moved = np.linalg.norm(robot.snapshot(q).position("base") - start.position("base"))
print(f"{robot.name}: tool off the circle by {1e3 * worst:.2f} mm at most, base by {moved:.1e} m")
