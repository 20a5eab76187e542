"""Inertia shaping: a small humanoid on both feet spreads its mass while its CoM stays in place.

The CRB inertia about the CoM is a task like any other. Its target about the vertical is 1.5 times
the start's; arms and legs spread to reach it.
"""

import wbc
from wbc.rmp.ellipsoid import equimomental, reaction_mass_radii

robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)
tasks = [
    wbc.InertiaTask(robot, 1.5 * start.inertia, components=["zz"], per_mass=True, weight=10.0),
    wbc.ComTask(robot, start.com, weight=10.0),
    wbc.PostureTask(robot, q, weight=0.001),
]
controller = wbc.KinematicController(
    robot, tasks, contacts=wbc.support(start, "double"), limits=wbc.Limits(robot), dt=dt
)
for _ in range(400):
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)

end = robot.snapshot(q)
gained = end.inertia[2, 2] / start.inertia[2, 2]
print(f"Izz times {gained:.3f}, CoM moved {1e3 * abs(end.com - start.com).max():.3f} mm")
for name, snapshot in {"start": start, "end": end}.items():
    axes = equimomental(snapshot.inertia, robot.mass).semi_axes  # the longest first
    radii = reaction_mass_radii(snapshot.inertia, robot.mass)
    print(f"{name}: semi-axes {axes.round(3)} m, reaction masses at {radii.round(3)} m")
