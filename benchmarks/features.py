"""The cost of a feature in a tick: the same closed loop with one feature more, in turns.

A G1 on both feet follows a moving CoM, with its trunk's orientation, a posture, position and
velocity limits, dt = 5 ms. "own" is a task written in Python (its evaluation is in the time);
"bounds" is the plain loop with joints of at most 0.1 rad/s. Snapshot and step are timed, by the
thread's CPU time; medians.

    python benchmarks/features.py [--ticks 2000] [--output benchmarks/RESULTS.md]

Two versions of the package are compared by running it with each on the path, in turns.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from pathlib import Path
from time import thread_time

import numpy as np
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table

import wbc
from wbc.problem.provenance import versions

DT = 0.005
WARM_UP = 100
BLOCK = 50

# Priorities of trunk and posture, what else is in the stack, the level, and the joints' speed.
KINDS = {
    "plain": {},
    "inertia": {"inertia": 1.0},
    "inertia of second order": {"inertia": 1.2, "second_order": True},
    "two priorities": {"posture": 1},
    "three priorities": {"trunk": 1, "posture": 2},
    "own task": {"own": True},
    "bounds": {"speed": 0.1},
    "bounds, active_set": {"speed": 0.1, "solver": "active_set"},
    "torques": {"torque": True},
    "torques, two priorities": {"torque": True, "posture": 1},
}


class OwnTask(wbc.Task):
    """A position task as a user writes one."""

    def __init__(self, robot: wbc.Robot, frame: str, place: np.ndarray) -> None:
        super().__init__(robot, "own", ("x", "y", "z"), weight=1.0)
        self.frame, self.place = frame, np.array(place)

    def residual(self, snapshot: wbc.Snapshot) -> wbc.Residual:
        """Return how far the frame is from its place, and its Jacobian."""
        error = snapshot.position(self.frame) - self.place
        return wbc.Residual(error, snapshot.jacobian(self.frame)[:3], np.zeros(3))

    def drift(self, snapshot: wbc.Snapshot) -> np.ndarray:
        """Return dJ/dt v."""
        return snapshot.drift(self.frame)[:3]


class Loop:
    """A controller that moves a robot, and the times of its ticks [s]."""

    def __init__(self, robot: wbc.Robot, kind: str, q: np.ndarray | None = None) -> None:
        asked = KINDS[kind]
        self.robot, self.v = robot, np.zeros(robot.nv)
        self.q = robot.posture("standing") if q is None else q
        start = robot.snapshot(self.q, self.v)
        self.start, self.count, self.times, self.unsolved = start.com, 0, [], 0
        trunk = "torso_link"
        self.com = wbc.ComTask(robot, start.com, weight=10.0)
        tasks = [
            self.com,
            wbc.OrientationTask(
                robot,
                trunk,
                start.rotation(trunk),
                name="trunk",
                weight=1.0,
                priority=asked.get("trunk", 0),
            ),
            wbc.PostureTask(robot, self.q, weight=0.1, priority=asked.get("posture", 0)),
        ]
        if "inertia" in asked:
            second = asked.get("second_order", False)
            target = asked["inertia"] * start.inertia
            tasks.append(wbc.InertiaTask(robot, target, weight=1.0, second_order=second))
        if "own" in asked:
            tasks.append(OwnTask(robot, trunk, start.position(trunk)))
        limits = wbc.Limits(robot)
        if "speed" in asked:
            limits.speed = np.full(robot.nv - 6, asked["speed"])
        level = wbc.TorqueController if asked.get("torque") else wbc.KinematicController
        self.controller = level(
            robot,
            tasks,
            contacts=wbc.support(start, "double"),
            limits=limits,
            dt=DT,
            solver=asked.get("solver", "proxqp"),
        )

    def advance(self, ticks: int) -> None:
        """Move the target, time snapshot and step, integrate."""
        for _ in range(ticks):
            wave = 0.02 * np.sin(np.array([self.count / 30, 0.0, self.count / 37]))
            self.com.set_target(self.start + wave * [1, 0, -1])
            before = thread_time()
            tick = self.controller.step(self.robot.snapshot(self.q, self.v))
            spent = thread_time() - before
            if self.count >= WARM_UP:
                self.times.append(spent)
                self.unsolved += not tick.ok
            self.v = tick.velocity
            self.q = self.robot.integrate(self.q, self.v, DT)
            self.count += 1


def main() -> None:
    """Run the loops in turns and print or write their times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2000)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--output", type=Path, help="page to write a section into")
    options = parser.parse_args()
    robot = wbc.Robot.load("g1")
    loops = {kind: Loop(robot, kind) for kind in options.kinds}
    for _ in range(0, options.ticks + WARM_UP, BLOCK):
        for loop in loops.values():
            loop.advance(BLOCK)
    plain = float(np.median(next(iter(loops.values())).times))
    rows = []
    for kind, loop in loops.items():
        median, late = np.median(loop.times), np.percentile(loop.times, 99)
        rows.append(
            [
                kind,
                f"{1e6 * median:.1f}",
                f"{1e6 * late:.1f}",
                f"{median / plain:.2f}",
                str(loop.unsolved),
            ]
        )
    header = ["tick", "median us", "p99 us", f"by {options.kinds[0]}", "not solved"]
    told = ", ".join(f"{name} {one}" for name, one in versions().items())
    text = "\n\n".join(
        [
            "## What a feature adds",
            Table(f"g1, nv {robot.nv}, both feet held", header, rows).markdown(),
            f"{options.ticks} ticks each, in turns of {BLOCK}, thread CPU time, on {machine()};"
            f" {told}. Command: `python benchmarks/features.py --ticks {options.ticks}"
            " --output benchmarks/RESULTS.md`.",
        ]
    )
    print(text)
    if options.output:
        put_section(options.output, "features", text)


if __name__ == "__main__":
    main()
