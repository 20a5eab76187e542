"""A robot walks at changing velocities, turns, stops, and is pushed.

Needs the extra `sim`. Footsteps follow from the velocity and adapt to the measured capture point; a
command beyond the legs' limits is reduced to them, with a message.
"""

import math

import wbc
from wbc.gait import Walker
from wbc.simulation import FallLimits, FallWatch, Plant

robot = wbc.Robot.load("hoap2_like")
walker = Walker(robot, dt=0.002)
plant = Plant(robot, dt=0.002)
watch = FallWatch(plant, FallLimits())
plant.push("base", (0.0, 8.0, 0.0), start=0.9, duration=0.1)  # 0.8 N s on 7 kg, to the left

commands = {0.1: (0.15, 0.0, 0.0), 1.4: (9.0, 0.0, 0.0), 2.0: (0.1, 0.0, 0.5), 2.8: (0.0, 0.0, 0.0)}
relaxed = ticks = 0
while plant.time < 4.0 and watch.verdict().stood:
    if round(plant.time, 6) in commands:
        admitted = walker.command(*commands[round(plant.time, 6)])
        print(f"at {plant.time:.1f} s: {admitted.reason or 'all of it'}")
    tick = walker.step(plant.snapshot(), plant.contact_forces)
    plant.step(tick.torque)
    relaxed, ticks = relaxed + bool(tick.relaxed), ticks + 1

turn = math.degrees(walker.heading)
print(f"{watch.verdict()}, {walker.steps} steps, {plant.com[0]:.2f} m ahead, turned {turn:.0f} deg")
print(f"it is {type(walker.phase).__name__} again; {relaxed} of {ticks} ticks relaxed")
