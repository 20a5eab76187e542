"""What the native core saves: the same loop with it and without, interleaved, on one core.

A humanoid on both feet follows moving targets, as in tick.py; ``--pairs`` adds self-collision with
its margins, ``--torque`` takes the torque level, with a momentum task. Thread CPU time of snapshot
and step in us: the fifth percentile, which other processes hardly disturb, the median and the 99th
percentile.

    python benchmarks/native.py [--robot g1] [--ticks 2000] [--solvers active_set proxqp] [--pairs]
        [--torque]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse

import numpy as np
from tick import BLOCK, WARM_UP, Run, make_run

from wbc.constraints import SelfCollision
from wbc.controllers import KinematicController, TorqueController
from wbc.native import VARIABLE, status
from wbc.robot import Robot
from wbc.tasks import MomentumTask

MODES = ("off", "auto")


def runs_of(
    robot_name: str, solvers: list[str], pairs: bool, torque: bool = False
) -> dict[tuple[str, str], Run]:
    """Return one loop for each solver and mode."""
    runs = {}
    for mode in MODES:
        os.environ[VARIABLE] = mode  # a robot keeps what it found when it was first asked
        robot = Robot.load(robot_name)
        margins = [SelfCollision(robot)] if pairs else []
        for solver in solvers:
            run = make_run(robot, solver, "equality")
            if margins or torque:
                old = run.controller
                level = TorqueController if torque else KinematicController
                further = [MomentumTask(robot, weight=0.1)] if torque else []
                run.controller = level(
                    robot,
                    [*old.tasks, *further],
                    contacts=old.contacts,
                    limits=old.limits,
                    constraints=margins,
                    dt=old.dt,
                    solver=solver,
                )
            runs[solver, mode] = run
    return runs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--ticks", type=int, default=2000)
    parser.add_argument("--solvers", nargs="+", default=["active_set", "proxqp"])
    parser.add_argument("--pairs", action="store_true", help="with self-collision")
    parser.add_argument("--torque", action="store_true", help="the torque level")
    options = parser.parse_args()
    os.environ[VARIABLE] = "auto"
    print(f"native core: {status().reason}")
    runs = runs_of(options.robot, options.solvers, options.pairs, options.torque)
    for _ in range(-(-(WARM_UP + options.ticks) // BLOCK)):
        for run in runs.values():
            for _ in range(BLOCK):
                run.advance()
    more = ", with pairs" if options.pairs else ""
    print(f"{options.robot}: us of CPU a {'torque' if options.torque else 'velocity'} tick{more}")
    print(f"{'':20s}{'p5':>8s}{'median':>8s}{'p99':>8s}  failures")
    for (solver, mode), run in runs.items():
        p5, median, p99 = np.percentile(run.cpu, (5, 50, 99)) * 1e6
        label = f"{solver} {VARIABLE}={mode}"
        print(f"{label:20s}{p5:8.1f}{median:8.1f}{p99:8.1f}  {run.failures}")
    for solver in options.solvers:
        off, on = (np.median(runs[solver, mode].cpu) for mode in MODES)
        print(f"{solver}: {off / on:.2f} times as fast with the core")


if __name__ == "__main__":
    main()
