"""Time of one control tick by stages, on one core.

The job: a humanoid on both feet follows moving targets for its inertia, CoM and torso orientation,
with a posture task, position and velocity limits, dt = 5 ms; 2,000 ticks after 200 of warm-up. The
neighbours' published figures for the same job without an inertia task are in docs/figures.md.

Solvers and formulations are interleaved, block by block, so that a drift of the machine's speed
hits all alike. Medians are wall time; p99 is thread CPU time, which other processes do not disturb.

    python benchmarks/tick.py [--robot g1] [--ticks 2000] [--solvers proxqp daqp]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import platform
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, thread_time

import numpy as np

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.controller import Controller
from wbc.qp.backend import installed_solvers
from wbc.robot import Robot
from wbc.rotations import exp_rotation
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PostureTask

DT = 0.005
WARM_UP = 200
BLOCK = 100
STAGES = ("snapshot", "tasks", "assembly", "solve", "rest")


@dataclass
class Run:
    """One controller with its state and the times of its ticks [s]."""

    label: str
    robot: Robot
    controller: Controller
    q: np.ndarray
    v: np.ndarray
    start: tuple[np.ndarray, np.ndarray, np.ndarray]
    ticks: int = 0
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stages: list[tuple[float, ...]] = field(default_factory=list)
    com_error: list[float] = field(default_factory=list)
    failures: int = 0

    def advance(self) -> None:
        """Move the targets, run one tick, integrate; only snapshot and step are timed."""
        inertia, com, torso, *_ = self.controller.tasks
        t = self.ticks * DT
        start_com, start_inertia, start_torso = self.start
        wave = np.array([0.01, 0.02, -0.01]) * np.sin(2 * np.pi * np.array([0.5, 0.25, 0.4]) * t)
        inertia.set_target(start_inertia * (1 + 0.05 * np.sin(np.pi * t)))
        com.set_target(start_com + wave)
        torso.set_target(start_torso @ exp_rotation(np.array([0, 0.1, 0.2]) * np.sin(t)))
        cpu, wall = thread_time(), perf_counter()
        snapshot = self.robot.snapshot(self.q, self.v)
        ready = perf_counter()
        tick = self.controller.step(snapshot)
        done = perf_counter()
        if self.ticks >= WARM_UP:
            self.wall.append(done - wall)
            self.cpu.append(thread_time() - cpu)
            parts = (ready - wall, tick.times.tasks, tick.times.assembly, tick.times.solve)
            self.stages.append((*parts, done - wall - sum(parts)))
            self.com_error.append(float(np.linalg.norm(tick.errors["com"])))
        self.failures += not tick.ok
        self.v = tick.velocity
        self.q = self.robot.integrate(self.q, self.v, DT)
        self.ticks += 1

    def summary(self) -> dict[str, float]:
        """Return medians and tails [us], failures, and errors [mm] as a check of the work."""
        stages = np.median(np.array(self.stages), axis=0) * 1e6
        return {
            "median": float(np.median(self.wall) * 1e6),
            "p99 (cpu)": float(np.percentile(self.cpu, 99) * 1e6),
            **dict(zip(STAGES, stages.tolist(), strict=True)),
            "com rms mm": float(np.sqrt(np.mean(np.square(self.com_error))) * 1e3),
            "foot slip mm": 1e3
            * max(c.slip(self.robot.snapshot(self.q)) for c in self.controller.contacts),
            "failures": self.failures,
        }


def make_run(robot: Robot, solver: str, formulation: str) -> Run:
    q = robot.posture("standing")
    here = robot.snapshot(q)
    torso = torso_frame(robot)
    start = (here.com.copy(), here.inertia.copy(), here.rotation(torso).copy())
    tasks = [
        InertiaTask(robot, start[1], per_mass=True, weight=10.0, gain=0.2),
        ComTask(robot, start[0], weight=10.0, gain=0.5),
        OrientationTask(robot, torso, start[2], weight=1.0, gain=0.5),
        PostureTask(robot, q, weight=0.1, gain=0.1),
    ]
    controller = KinematicController(
        robot,
        tasks,
        contacts=support(here, "double"),
        limits=Limits(robot),
        dt=DT,
        solver=solver,
        formulation=formulation,
    )
    return Run(f"{solver} {formulation}", robot, controller, q, np.zeros(robot.nv), start)


def torso_frame(robot: Robot) -> str:
    """Return the link that carries the arms, or the base."""
    names = [
        name
        for name in ("torso_link", "torso_2_link", "torso", "chest")
        if name in robot.frame_names
    ]
    return names[0] if names else "base"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--ticks", type=int, default=2000)
    parser.add_argument("--solvers", nargs="+", default=["proxqp", "daqp"])
    parser.add_argument("--output", type=Path, help="write the figures as JSON")
    options = parser.parse_args()
    robot = Robot.load(options.robot)
    solvers = [name for name in options.solvers if name in installed_solvers()]
    runs = [make_run(robot, s, f) for s in solvers for f in ("equality", "reduced")]
    for _ in range(-(-(WARM_UP + options.ticks) // BLOCK)):
        for run in runs:
            for _ in range(BLOCK):
                run.advance()
    rows = {run.label: run.summary() for run in runs}
    print(f"{robot.name}, nv {robot.nv}, double support; us per tick, {platform.machine()}")
    columns = list(next(iter(rows.values())))
    print(f"{'':20s}" + "".join(f"{name:>13s}" for name in columns))
    for label, row in rows.items():
        print(f"{label:20s}" + "".join(f"{row[name]:13.3g}" for name in columns))
    if options.output:
        options.output.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
