"""Reach with one hand while the CoM stays over the feet.

The hand has a weight, the feet are contacts (met exactly), and the support polygon is a hard
constraint: a target too far away is missed, the robot does not fall.
"""

import wbc

robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)
support = wbc.ComSupport.over(start, ["left", "right"], margin=0.01)
hand = wbc.PositionTask(robot, "left_palm", start.position("left_palm"), name="hand", weight=1.0)
controller = wbc.KinematicController(
    robot,
    [
        hand,
        wbc.OrientationTask(robot, "torso", start.rotation("torso"), name="torso", weight=0.1),
        wbc.PostureTask(robot, q, weight=0.003),
    ],
    contacts=wbc.support(start, "double"),
    limits=wbc.Limits(robot),
    constraints=[support],
    dt=dt,
)

for name, target in {"near": (0.15, 0.10, 0.25), "too far": (0.60, 0.10, 0.20)}.items():
    hand.set_target(target)
    for _ in range(400):  # 2 s
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity
        q = robot.integrate(q, v, dt)
    snapshot = robot.snapshot(q)
    miss = 1e3 * sum(tick.errors["hand"] ** 2) ** 0.5
    inside = 1e3 * support.distances(snapshot).clearance.min() + 1e3 * support.margin
    held = ", ".join(tick.active[:2]) or "nothing"
    print(f"{name}: hand misses by {miss:.1f} mm, CoM {inside:.1f} mm inside, held by: {held}")
