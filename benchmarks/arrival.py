"""Arrival times of an inertia task at targets, most of them out of reach; by kind of step.

For each target: the seconds of motion until the error stays within 1 % of its final value (found by
continuing for longer), the final error relative to the start's, and the CPU time of a tick.

    python benchmarks/arrival.py [--robots g1 hoap2_like talos] [--targets 12] [--solver active_set]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from time import thread_time

import numpy as np
from shaping_scipy import Target, axes, targets

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import closed_loop
from wbc.robot import Robot
from wbc.spatial import vech
from wbc.tasks import InertiaTask

DT = 0.005
SECONDS, LONGER = 5.0, 7.5
# Factors on the standing robot's moments that no posture comes near.
FAR = ((3.0, 3.0, 3.0), (0.05, 0.05, 3.0), (3.0, 3.0, 0.05), (0.3, 0.3, 0.3))
STEPS = {"damped": False, "second order": True}


def far_targets(robot: Robot) -> list[Target]:
    """Return targets that are far out of reach, floating and on both feet."""
    moments = np.diag(robot.snapshot(robot.posture()).inertia_in("base"))
    found = []
    for mode in ("floating", "double"):
        for factors in FAR:
            base = moments if factors[0] == factors[2] else np.full(3, moments.max())
            wanted = vech(np.diag(base * factors)).tolist()
            shape = f"x {factors[0]:g}, {factors[2]:g}"
            found.append(Target(robot.name, shape, mode, tuple(wanted)))
    return found


def errors(
    robot: Robot, target: Target, second_order: bool, solver: str
) -> tuple[np.ndarray, float]:
    """Return the norm of the error after each tick, and the CPU time of a tick [s]."""
    q = robot.posture()
    task = InertiaTask(robot, target.inertia, frame=axes(target.mode), second_order=second_order)
    contacts = support(robot.snapshot(q), target.mode)
    controller = KinematicController(
        robot, [task], contacts=contacts, limits=Limits(robot), dt=DT, solver=solver
    )
    start, ticks = thread_time(), closed_loop(controller, q, round((SECONDS + LONGER) / DT))
    norms = [float(np.linalg.norm(one.tick.errors[task.name])) for one in ticks]
    return np.array(norms), (thread_time() - start) / len(norms)


def arrival(norms: np.ndarray) -> float:
    """Return when the error is within 1 % of its end for good [s]."""
    away = np.flatnonzero(norms > 1.01 * norms.min() + 1e-6 * norms[0])
    return DT * float(away[-1] + 1) if away.size else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=["g1", "hoap2_like", "talos"])
    parser.add_argument("--targets", type=int, default=12, help="besides eight far out of reach")
    parser.add_argument("--solver", default="active_set")
    options = parser.parse_args()
    for name in options.robots:
        robot = Robot.load(name)
        times: dict[str, list[float]] = {step: [] for step in STEPS}
        for target in [*targets(name, options.targets, 0), *far_targets(robot)]:
            line = f"{name:12s}{target.mode:10s}{target.shape:10s}"
            for step, second_order in STEPS.items():
                norms, tick = errors(robot, target, second_order, options.solver)
                times[step].append(arrival(norms))
                end = norms.min() / norms[0]
                line += f"  {step}: {times[step][-1]:6.3f} s, {end:.4f}, {tick * 1e6:4.0f} us"
            print(line, flush=True)
        for step, found in times.items():
            late = sum(time > SECONDS for time in found)
            print(
                f"{name}, {step}: median {np.median(found):.2f} s, longest {max(found):.2f} s,"
                f" {late} of {len(found)} later than {SECONDS:g} s"
            )


if __name__ == "__main__":
    main()
