"""A ball flies at a humanoid that reaches forward: hand and body avoid it.

Obstacles are capsules, spheres, boxes or half-spaces with a velocity; a margin is approached with
braking distance, and no obstacle can make the QP infeasible.
"""

import numpy as np

import wbc

robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)
limits = wbc.Limits(robot)
ball = wbc.Obstacle.sphere("ball", (0.0, 0.0, 0.0), 0.04)  # in its own moving frame
ball.move(np.eye(3), (0.5, 0.12, 0.26), velocity=(-0.15, 0.0, 0.0))
around = wbc.Obstacles(robot, [ball], margin=0.02, limits=limits)
body = wbc.SelfCollision(robot, margin=0.005, limits=limits)
controller = wbc.KinematicController(
    robot,
    [
        wbc.PositionTask(robot, "left_palm", (0.17, 0.12, 0.24), name="hand"),
        wbc.ComTask(robot, start.com, weight=10.0),
        wbc.PostureTask(robot, q, weight=0.01),
    ],
    contacts=wbc.support(start, "double"),
    limits=limits,
    constraints=[around, body],
    dt=dt,
)

nearest, constrained = np.inf, 0
for _ in range(480):  # 2.4 s, in which the ball comes 36 cm nearer
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
    ball.advance(dt)
    gap = around.model.nearest(robot.snapshot(q), 1).distance[0]
    nearest, constrained = min(nearest, gap), constrained + bool(tick.active)
print(
    f"the ball came as near as {1e3 * nearest:.1f} mm (margin 20 mm); hand off by "
    f"{1e3 * np.linalg.norm(tick.errors['hand']):.0f} mm; {constrained} of 480 ticks constrained"
)
