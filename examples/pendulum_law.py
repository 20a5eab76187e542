"""How hard a push the reaction mass pendulum absorbs without a step, and the law that does it.

A G1-like pendulum on a flat foot: the CoP goes to the edge first, then the masses rotate within the
bounds of their motors and ranges.
"""

import numpy as np

from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import Wheel, push_limits
from wbc.rmp.balance.simulate import Blow, simulate
from wbc.rmp.solid import SolidRmp

mass, height, radii = 35.0, 0.7, (0.3, 0.3, 0.3)  # kg, m, m
square = 0.1 * np.array(((-1, -1), (1, -1), (1, 1), (-1, 1)))
model = SolidRmp(mass)
bounds = LawBounds(polygon=square, friction=0.8, wheel_torque=50.0, wheel_angle=0.6)
law = MomentumQp(model, bounds, (0.0, 0.0, height), radii, dt=1e-3)

forward = np.array([[1.0, 0.0]])
inertia = mass * 2 / 3 * radii[0] ** 2
theory = push_limits(forward, square, Wheel(inertia, 50.0, 0.6), mass=mass, height=height)
print(f"forward: ankle {theory.ankle[0]:.1f} N s, with reaction mass {theory.wheel[0]:.1f} N s")

rest = np.array((0.0, 0.0, np.pi / 2, 0.0, height, 0.0, 0.0, 0.0, 1.0, *radii))
for part in (0.9, 0.97, 1.1):
    push = Blow(0.2, (part * theory.wheel[0], 0.0, 0.0))
    run = simulate(law, rest, np.zeros(len(model.V)), 4.0, bounds=bounds, pushes=[push])
    com, speed = (series[-1] for series in run.com())
    print(
        f"push of {part:.2f} times that: {run.ending.value}, CoM {1e3 * com[0]:.1f} mm from rest, "
        f"{np.linalg.norm(speed):.3f} m/s, CoP left the foot by {1e3 * run.cop_violation:.2f} mm"
    )
