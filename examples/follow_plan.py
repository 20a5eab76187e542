"""A motion planned for the reaction mass pendulum, followed by a simulated humanoid.

A crouch with a bow, planned for the robot's own pendulum, gives targets of CoM, CoP and momentum.
Needs the extra `sim`.
"""

import numpy as np

import wbc
from wbc.rmp.plan import PathLimits, PlanPhase, PlanProblem, State, solve
from wbc.simulation import Plant

FEET = ("left", "right")
robot = wbc.Robot.load("hoap2_like")
q, dt = robot.posture("standing"), 0.002
start = robot.snapshot(q)
own = wbc.pendulum_of(start)
soles = own.soles(FEET, margin=0.01)
x, y, z = start.com.tolist()
plan = solve(
    PlanProblem(
        own.pendulum,
        schedule=(
            PlanPhase(
                "down", 0.5, soles, 8, end=State(com=(x, y, z - 0.02), rotation=(0, 0.03, 0))
            ),
            PlanPhase("up", 0.5, soles, 8),
        ),
        start=own.rest,
        goal=own.rest,
        nominal=own.rest,
        limits=PathLimits(friction=0.5, torsion=0.02, normal_force=(5.0, 200.0)),
        reference=own.reference,
    )
)
reference = wbc.PlanReference(plan, start, feet=FEET)
com = wbc.ComTask(robot, start.com, weight=30.0)
spin = wbc.MomentumTask(robot, components=("kx", "ky", "kz"), weight=20.0)
cop = wbc.CopTask(robot, start.com[:2])
controller = wbc.TorqueController(
    robot,
    [com, spin, cop, wbc.PostureTask(robot, q, weight=0.1)],
    contacts=wbc.support(start, "double"),
    limits=wbc.Limits(robot),
    dt=dt,
)
plant = Plant(robot, dt=dt)
plant.reset(q)
error = {"CoM": 0.0, "momentum": 0.0}
peak = float(np.abs(plan.knots.momentum).max())
while plant.time < reference.ends - dt / 2:
    target = reference.at(plant.time)
    com.set_target(target.com, target.com_velocity, target.com_acceleration)
    spin.set_target(target.momentum, target.momentum_rate)
    cop.set_target(target.cop)
    plant.step(controller.step(plant.snapshot()).torque)
    actual, target = plant.snapshot(), reference.at(plant.time)
    error["CoM"] = max(error["CoM"], float(np.linalg.norm(actual.com - target.com)))
    difference = float(np.linalg.norm((actual.momentum - target.momentum)[3:]))
    error["momentum"] = max(error["momentum"], difference)

print(f"planned in {plan.stats.iterations} iterations, {plan.duration:.1f} s long")
print(f"CoM at most {1e3 * error['CoM']:.2f} mm from the plan, which goes down by 20 mm")
print(f"angular momentum at most {100 * error['momentum'] / peak:.1f} % of its peak off")
