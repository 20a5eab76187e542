"""Torque control in simulation: a G1 stands, is pushed at the pelvis, and comes back.

Needs the extras `robots` and `sim`. The plant is made from the same robot; pushes are in units of
M omega d, the most that the CoP alone absorbs in a linear inverted pendulum.
"""

import math

import numpy as np

import wbc
from wbc.simulation import Plant

robot = wbc.Robot.load("g1")
q, dt = robot.posture("standing"), 0.002
start = robot.snapshot(q)
support = wbc.ComSupport.over(start, margin=0.0)
contacts = wbc.support(start, "double")
controller = wbc.TorqueController(
    robot,
    [
        wbc.ComTask(robot, start.com, weight=10.0),
        wbc.OrientationTask(robot, "torso_link", start.rotation("torso_link"), name="torso"),
        wbc.PostureTask(robot, q, weight=0.1),
    ],
    contacts=contacts,
    limits=wbc.Limits(robot),
    dt=dt,
)
plant = Plant(robot, dt=dt)
plant.reset(q)

ahead = support.corners[:, 0].max() - start.com[0]  # m, from the CoM to the toes
bound = robot.mass * math.sqrt(9.81 / start.com[2]) * ahead
impulse = 0.8 * bound
farthest = relaxed = 0
for k in range(1500):  # 3 s
    if k == 250:
        plant.push("base", (impulse / 0.1, 0.0, 0.0), point="com", duration=0.1)
    tick = controller.step(plant.snapshot())
    plant.step(tick.torque)
    farthest = max(farthest, plant.com[0] - start.com[0])
    relaxed += bool(tick.relaxed)

off = np.linalg.norm(plant.com - start.com)
slip = max(contact.slip(plant.snapshot()) for contact in contacts)
print(f"push of {impulse:.1f} N s forward, {impulse / bound:.2f} times M omega d")
print(f"CoM went {1e3 * farthest:.0f} mm, is back to {1e3 * off:.1f} mm; feet {1e3 * slip:.1f} mm")
print(f"{relaxed} of 1500 ticks relaxed")
