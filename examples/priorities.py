"""One hand reaches forward, the other sideways, with one trunk: weights against priorities.

Each target alone can be met; with the CoM held, both together cannot. On one level both hands miss
by a little, according to their weights. With priorities the first one arrives, at the expense of
the other.
"""

import numpy as np

import wbc

robot = wbc.Robot.load("hoap2_like")
start = robot.snapshot(robot.posture("standing"))
dt = 0.005
palms = "left_palm", "right_palm"
goals = {palms[0]: (0.2, 0.1, 0.2), palms[1]: (0.05, -0.25, 0.2)}  # m


def misses(priorities: tuple[int, int]) -> list[float]:
    """Return each hand's final distance from its target [mm]."""
    q, v = start.q, None
    tasks: list[wbc.Task] = [
        wbc.PositionTask(robot, palm, goals[palm], name=palm, priority=level, gain=0.1)
        for palm, level in zip(palms, priorities, strict=True)
    ]
    tasks += [
        wbc.ComTask(robot, start.com, weight=10.0),
        wbc.PostureTask(robot, q, weight=0.01, priority=2),
    ]
    controller = wbc.KinematicController(
        robot, tasks, contacts=wbc.support(start, "double"), limits=wbc.Limits(robot), dt=dt
    )
    for _ in range(600):
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity
        q = robot.integrate(q, v, dt)
    return [1e3 * float(np.linalg.norm(tick.errors[palm])) for palm in palms]


for name, priorities in {"one level": (0, 0), "left first": (0, 1), "right first": (1, 0)}.items():
    left, right = misses(priorities)
    print(f"{name}: left misses by {left:.1f} mm, right by {right:.1f} mm")
