"""A squat in a loop of your own: a moving CoM target, both feet held.

The target has a rate, so that the CoM follows without lag.
"""

import math

import numpy as np

import wbc

robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)
com = wbc.ComTask(robot, start.com, weight=10.0)
contacts = wbc.support(start, "double")
controller = wbc.KinematicController(
    robot,
    [
        com,
        wbc.OrientationTask(robot, "torso", start.rotation("torso"), name="torso"),
        wbc.PostureTask(robot, q, weight=0.01),
    ],
    contacts=contacts,
    limits=wbc.Limits(robot),
    dt=dt,
)

depth, period = 0.03, 2.0  # m, s
worst = lowest = 0.0
for k in range(800):  # two squats
    phase = 2.0 * math.pi * k * dt / period
    drop = 0.5 * depth * (1.0 - math.cos(phase))
    rate = 0.5 * depth * math.sin(phase) * 2.0 * math.pi / period
    com.set_target(start.com - [0.0, 0.0, drop], rate=(0.0, 0.0, -rate))
    snapshot = robot.snapshot(q, v)
    tick = controller.step(snapshot)
    if not tick.ok:
        raise SystemExit(tick.report())
    worst = max(worst, float(np.linalg.norm(tick.errors["com"])))
    lowest = min(lowest, float(snapshot.com[2] - start.com[2]))
    v = tick.velocity
    q = robot.integrate(q, v, dt)

slip = max(contact.slip(robot.snapshot(q)) for contact in contacts)
print(
    f"CoM down by {-1e3 * lowest:.1f} mm, worst error {1e3 * worst:.2f} mm, "
    f"feet moved {1e3 * slip:.3f} mm"
)
