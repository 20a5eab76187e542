"""Contacts that come and go at random times: accelerations and QPs through every switch.

Each run starts on both feet with random targets; at a random tick one foot is released and moved to
a random place, at another it is held again at its current place. Checked on every tick: the QP is
solved, and no joint speeds up by more than the declared acceleration bound.

    python benchmarks/switching.py [--runs 1000] [--seed 0]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse

import numpy as np

from wbc.constraints import Contact, Limits, support
from wbc.controllers import KinematicController
from wbc.robot import Robot
from wbc.tasks import ComTask, InertiaTask, PositionTask, PostureTask, Task

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")
DT, TICKS = 0.005, 60


def speed_gain(v: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the gain in joint speed; a joint that reverses counts with its full speed."""
    same_way = v * before > 0.0
    return np.abs(v) - np.where(same_way, np.abs(before), 0.0)


def run(robot: Robot, rng: np.random.Generator) -> tuple[float, float, int]:
    """Return the worst excess over the bound, the same at the switches, and failed QPs."""
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    here = robot.snapshot(q, v)
    limits = Limits(robot, acceleration=float(rng.uniform(5.0, 50.0)))
    tasks: list[Task] = [
        ComTask(robot, here.com + rng.uniform(-0.03, 0.03, 3), weight=10.0, gain=0.1),
        InertiaTask(robot, rng.uniform(0.7, 1.4) * here.inertia, per_mass=True, gain=0.1),
        PostureTask(robot, q, weight=0.05),
    ]
    contacts = support(here, "double")
    free = contacts[int(rng.integers(2))]
    held = tuple(contact for contact in contacts if contact is not free)
    start, end = sorted(rng.choice(np.arange(5, TICKS - 5), size=2, replace=False).tolist())
    goal = free.position + rng.uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.15))
    pull = PositionTask(robot, free.frame, goal, weight=10.0, gain=0.2)
    settings = {"limits": limits, "dt": DT}
    controller = KinematicController(robot, tasks, contacts=contacts, **settings)
    worst, at_switch, failed = -np.inf, -np.inf, 0
    bound = limits.acceleration * DT
    for k in range(TICKS):
        snapshot = robot.snapshot(q, v)
        if k == start:
            controller = KinematicController(robot, [*tasks, pull], contacts=held, **settings)
        elif k == end:
            landed = Contact.hold(snapshot, free.frame)
            controller = KinematicController(robot, tasks, contacts=(*held, landed), **settings)
        tick = controller.step(snapshot)
        if not tick.ok:
            failed += 1
            print(f"tick {k} of {robot.name}: {tick.report()}")
        excess = float((speed_gain(tick.velocity[6:], v[6:]) - bound).max())
        worst = max(worst, excess / DT)
        if k in (start, end):
            at_switch = max(at_switch, excess / DT)
        v = tick.velocity
        q = robot.integrate(q, v, DT)
    return worst, at_switch, failed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    robots = [Robot.load(name) for name in ROBOTS]
    results = np.array([run(robots[k % len(robots)], rng) for k in range(options.runs)])
    print(f"{options.runs} runs of {TICKS} ticks with two switches each, {len(ROBOTS)} robots")
    print(f"worst excess over the acceleration bound: {results[:, 0].max():.2g} rad/s^2")
    print(f"  at the switches: {results[:, 1].max():.2g} rad/s^2")
    print(f"QPs not solved: {int(results[:, 2].sum())}")


if __name__ == "__main__":
    main()
