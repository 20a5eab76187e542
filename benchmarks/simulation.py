"""How long the closed loop in MuJoCo takes: ten simulated seconds of standing, on one core.

The job: a humanoid on both feet under the torque controller at 500 Hz with CoM, momentum, inertia,
torso and posture tasks, friction cones, torque bounds and joint limits; 1 ms physics; pushed once.
Times are thread CPU time, which other processes disturb least; the physics alone is what
``Plant.step`` takes.

    python benchmarks/simulation.py [--robots g1 talos] [--solvers daqp proxqp] [--seconds 10]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from time import perf_counter, thread_time

import numpy as np

import wbc
from wbc.simulation import Plant, simulate

DT = 0.002
TRUNKS = {"g1": "torso_link", "g1_27": "torso_link", "talos": "torso_2_link"}


class TimedPlant(Plant):
    """A plant that adds up what its steps take."""

    spent = 0.0

    def step(self, torque: np.ndarray, dt: float | None = None) -> None:
        began = thread_time()
        super().step(torque, dt)
        self.spent += thread_time() - began


def controller_of(robot: wbc.Robot, solver: str) -> wbc.TorqueController:
    start = robot.snapshot(robot.posture("standing"))
    trunk = TRUNKS.get(robot.name, "base")
    tasks = [
        wbc.ComTask(robot, start.com, weight=10.0),
        wbc.MomentumTask(robot, weight=0.1),
        wbc.InertiaTask(robot, start.inertia, weight=0.1),
        wbc.OrientationTask(robot, trunk, start.rotation(trunk)),
        wbc.PostureTask(robot, start.q, weight=0.1),
    ]
    return wbc.TorqueController(
        robot,
        tasks,
        contacts=wbc.support(start, "double"),
        limits=wbc.Limits(robot),
        dt=DT,
        solver=solver,
    )


def measure(name: str, solver: str, seconds: float) -> str:
    """Return one line of the table."""
    robot = wbc.Robot.load(name)
    plant, controller = TimedPlant(robot, dt=DT), controller_of(robot, solver)
    start = plant.snapshot()
    impulse = 0.3 * robot.mass * np.sqrt(9.81 * start.com[2]) * 0.1  # N s, a modest one
    plant.push("base", [10.0 * impulse, 0.0, 0.0], "com", duration=0.1, start=1.0)
    ticks, relaxed = [], 0
    wall, cpu = perf_counter(), thread_time()
    for now in simulate(controller, plant, seconds):
        ticks.append(now.cpu_seconds)
        relaxed += bool(now.tick.policy)
    wall, cpu = perf_counter() - wall, thread_time() - cpu
    scale, spent = 10.0 / plant.time, plant.spent
    times = (wall, cpu, spent, sum(ticks), cpu - spent - sum(ticks))
    row = [name, solver, *(f"{scale * time:.2f}" for time in times)]
    row += [f"{1e6 * np.median(ticks):.0f}", f"{1e6 * np.percentile(ticks, 99):.0f}"]
    return f"| {' | '.join(row)} | {relaxed} of {len(ticks)} | {now.verdict} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["g1", "talos", "hoap2_like"])
    parser.add_argument("--solvers", nargs="+", default=["daqp", "proxqp"])
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    print("Seconds for 10 simulated seconds; a tick with its snapshot in us.\n")
    print("| robot | solver | wall | CPU | physics | ticks | rest | median | p99 | relaxed | |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name in options.robots:
        for solver in options.solvers:
            print(measure(name, solver, options.seconds), flush=True)


if __name__ == "__main__":
    main()
