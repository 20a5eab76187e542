"""The globally best posture: a humanoid makes itself tall, where the QP alone gets stuck.

A QP descends to a local optimum, and inertia has many. Global shaping searches postures from many
starts, then runs the same QP towards the best posture that the QP can reach.
"""

import numpy as np

import wbc
from wbc.shaping import GlobalShaping

robot = wbc.Robot.load("hoap2_like")
q, dt = robot.posture("standing"), 0.005
start = robot.snapshot(q)
tall = (0.167, 0.0, 0.0, 0.146, 0.0, 0.0045)  # xx xy xz yy yz zz [kg m^2]; out of reach
shape = wbc.InertiaTask(robot, tall, gain=0.3, second_order=True)
contacts = wbc.support(start, "double")
limits = wbc.Limits(robot)
balance = wbc.ComSupport.over(start, margin=0.01)


def error(configuration: np.ndarray) -> float:
    """Return the error of the inertia, Frobenius norm [kg m^2]."""
    return float(np.linalg.norm(shape.residual(robot.snapshot(configuration)).error))


controller = wbc.KinematicController(
    robot, [shape], contacts=contacts, limits=limits, constraints=[balance], dt=dt
)
local, v = q, None
for _ in range(600):
    tick = controller.step(robot.snapshot(local, v))
    v = tick.velocity
    local = robot.integrate(local, v, dt)

shaping = GlobalShaping(robot, [shape], contacts, limits, [balance])
found = shaping.solve(q, starts=24, workers=1)
motion = shaping.reach(q, found)
print(
    f"start {error(q):.3f}, QP alone {error(local):.3f}, global {error(motion.q[-1]):.3f} kg m^2; "
    f"{len(found.candidates)} postures found, arrived: {motion.arrived}"
)
