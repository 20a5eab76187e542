"""Time of the closed loop in MuJoCo: ten simulated seconds of standing, on one core.

The job: a humanoid on both feet under the torque controller at 500 Hz with CoM, momentum, inertia,
torso and posture tasks, friction cones, torque bounds and joint limits; 1 ms physics; pushed once.
Times are thread CPU time, which other processes disturb least; the physics' time is that of
``Plant.step``. With --walk the robot walks instead: footsteps and goals, the tick, and the physics,
per tick.

    python benchmarks/simulation.py [--robots g1 talos] [--solvers active_set proxqp] [--seconds 10]
        [--walk]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from time import perf_counter, thread_time

import numpy as np

import wbc
from wbc.gait import Walker
from wbc.simulation import Plant, simulate

DT = 0.002
TRUNKS = {"g1": "torso_link", "g1_27": "torso_link", "talos": "torso_2_link"}


class TimedPlant(Plant):
    """A plant that sums the time of its steps."""

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


def walked(name: str, seconds: float) -> str:
    """Return one line of the table of walks, at a third of the speed that the legs admit."""
    robot = wbc.Robot.load(name)
    plant, walker = Plant(robot, dt=DT), Walker(robot, dt=DT)
    walker.command(walker.limits.forwards / 3.0)
    times, native = [], 0
    while plant.time < seconds:
        snapshot, forces = plant.snapshot(), plant.contact_forces
        clock = [thread_time()]
        controller = walker.prepare(snapshot, forces)
        clock.append(thread_time())
        tick = controller.step(snapshot)
        clock.append(thread_time())
        plant.step(tick.torque)
        times.append(np.diff([*clock, thread_time()]))
        native += tick.solution.solver in ("cholesky", "active_set")
    medians = (f"{1e6 * one:.0f}" for one in np.median(times, axis=0))
    worst = f"{1e6 * np.percentile(np.sum(times, axis=1), 99):.0f}"
    return f"| {name} | {' | '.join(medians)} | {worst} | {native} of {len(times)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["g1", "talos", "hoap2_like"])
    parser.add_argument("--solvers", nargs="+", default=["active_set", "proxqp"])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--walk", action="store_true", help="walk in place of standing")
    options = parser.parse_args()
    if options.walk:
        print("us of a tick of a walk, medians; p99 of all three.\n")
        print("| robot | footsteps and goals | tick | physics | p99 | plans of the core |")
        print("|---|---|---|---|---|---|")
        for name in options.robots:
            print(walked(name, options.seconds), flush=True)
        return
    print("Seconds for 10 simulated seconds; a tick with its snapshot in us.\n")
    print("| robot | solver | wall | CPU | physics | ticks | rest | median | p99 | relaxed | |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for name in options.robots:
        for solver in options.solvers:
            print(measure(name, solver, options.seconds), flush=True)


if __name__ == "__main__":
    main()
