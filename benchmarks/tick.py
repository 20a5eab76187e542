"""Time of one control tick by stages, on one core.

The job: a humanoid on both feet follows moving targets for its inertia, CoM and torso orientation,
with a posture task, position and velocity limits, dt = 5 ms; 2,000 ticks after 200 of warm-up.
Figures of other packages for the same job without an inertia task are in docs/figures.md.

Solvers are interleaved, block by block, so that drift of the machine's speed
affects all alike. Medians are wall time; p99 is thread CPU time, which other processes do not
disturb. Every round is its own process, since the layout of memory is part of the noise.

    python benchmarks/tick.py [--robot g1] [--ticks 2000] [--solvers proxqp active_set]
        [--output benchmarks/RESULTS.md] [--history ticks.jsonl]

A history has a line of figures for each run; a run is compared with the last one before it of the
same robot and machine: see benchmarks/qpbench/compare.py. The exit code is 3 if a tick is slower.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import shlex
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any

import numpy as np
from qpbench.compare import SpeedVerdict
from qpbench.measure import reference_time
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table
from tick_history import FORMAT, NothingToCompareError, changes_since, last_like

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.controller import Controller
from wbc.problem.provenance import versions
from wbc.qp.backend import installed_solvers
from wbc.robot import Robot
from wbc.rotations import exp_rotation
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PostureTask

DT = 0.005
WARM_UP = 200
BLOCK = 100
STAGES = ("snapshot", "tasks", "assembly", "solve", "rest")
FREQUENCIES = 2 * np.pi * np.array([0.5, 0.25, 0.4])  # of the CoM [rad/s]


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
    units: list[float] = field(default_factory=list)  # of blocks, by the fixed computation around
    failures: int = 0

    def targets(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the targets of inertia, CoM and torso in a tick."""
        t, (com, inertia, torso) = k * DT, self.start
        wave = np.array([0.01, 0.02, -0.01]) * np.sin(FREQUENCIES * t)
        turn = exp_rotation(np.array([0, 0.1, 0.2]) * np.sin(t))
        return inertia * (1 + 0.05 * np.sin(np.pi * t)), com + wave, torso @ turn

    def aim(self, targets: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Give the tasks their targets."""
        for task, target in zip(self.controller.tasks, targets, strict=False):
            task.set_target(target)

    def advance(self) -> None:
        """Move the targets, run one tick, integrate; only snapshot and step are timed."""
        self.aim(self.targets(self.ticks))
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

    def told(self) -> dict[str, Any]:
        """Return all measurements."""
        slips = [one.slip(self.robot.snapshot(self.q)) for one in self.controller.contacts]
        names = ("wall", "cpu", "stages", "com_error", "units", "failures")
        return {name: getattr(self, name) for name in names} | {"slip": max(slips)}


def make_run(robot: Robot, solver: str, **parts: Any) -> Run:
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
        **parts,
    )
    return Run(solver, robot, controller, q, np.zeros(robot.nv), start)


def torso_frame(robot: Robot) -> str:
    """Return the link that carries the arms, or the base."""
    names = [
        name
        for name in ("torso_link", "torso_2_link", "torso", "chest")
        if name in robot.frame_names
    ]
    return names[0] if names else "base"


def run_round(robot: Robot, solvers: list[str], ticks: int) -> dict[str, Any]:
    """Return the measurements of this process, by kind of tick."""
    runs = [make_run(robot, solver) for solver in solvers]
    before = reference_time()
    for _ in range(-(-(WARM_UP + ticks) // BLOCK)):
        for run in runs:
            for _ in range(BLOCK):
                run.advance()
            after = reference_time()
            if run.cpu:
                run.units.append(2.0 * float(np.median(run.cpu[-BLOCK:])) / (before + after))
            before = after
    return {run.label: run.told() for run in runs}


def summary(rounds: list[dict[str, Any]], label: str) -> dict[str, Any]:
    """Return medians and tails [us], failures, and errors [mm] as a check of the work."""
    mine = [one[label] for one in rounds]
    wall, cpu, stages, error = (
        np.concatenate([one[name] for one in mine])
        for name in ("wall", "cpu", "stages", "com_error")
    )
    middle = 1e6 * np.median(stages, axis=0)
    return {
        "median": float(np.median(wall) * 1e6),
        "p99 (cpu)": float(np.percentile(cpu, 99) * 1e6),
        **dict(zip(STAGES, middle.tolist(), strict=True)),
        "com rms mm": float(np.sqrt(np.mean(np.square(error))) * 1e3),
        "foot slip mm": 1e3 * max(one["slip"] for one in mine),
        "failures": sum(one["failures"] for one in mine),
        "passes": [float(np.median(one["units"])) for one in mine],
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--ticks", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=10, help="processes that share the ticks")
    parser.add_argument("--solvers", nargs="+", default=["proxqp", "active_set"])
    parser.add_argument("--output", type=Path, help="put the table here, between its marks")
    parser.add_argument("--history", type=Path, help="compare with its last run, and add this one")
    parser.add_argument("--round", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    solvers = [name for name in options.solvers if name in installed_solvers()]
    robot = Robot.load(options.robot)
    share = -(-options.ticks // options.rounds)
    if options.round:
        print(json.dumps(run_round(robot, solvers, options.ticks)))
        return 0
    command = [sys.executable, __file__, "--round", "--robot", options.robot]
    command += ["--ticks", str(share), "--solvers", *solvers]
    rounds = []
    for _ in range(options.rounds):
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        rounds.append(json.loads(done.stdout))
    figures = {
        "format": FORMAT,
        "robot": robot.name,
        "machine": machine(),
        "versions": versions(),
        "command": shlex.join(["python", "benchmarks/tick.py", *sys.argv[1:]]),
        "rounds": options.rounds,
        "ticks": {label: summary(rounds, label) for label in rounds[0]},
    }
    text = section(figures, robot.nv, options.rounds * share)
    print(text)
    if options.output:
        put_section(options.output, "ticks", text)
    return add_to_history(options.history, figures) if options.history else 0


def section(figures: dict[str, Any], nv: int, ticks: int) -> str:
    """Return the figures as a section of a page."""
    rows = {
        label: {name: value for name, value in one.items() if name != "passes"}
        for label, one in figures["ticks"].items()
    }
    header = ["us per tick", *next(iter(rows.values()))]
    cells = [[label, *(f"{one:.3g}" for one in row.values())] for label, row in rows.items()]
    told = ", ".join(f"{name} {one}" for name, one in figures["versions"].items())
    return "\n\n".join(
        [
            "## One tick by stages",
            Table(f"{figures['robot']}, nv {nv}, both feet held", header, cells).markdown(),
            f"{ticks} ticks each in {figures['rounds']} processes, in turns of {BLOCK}, on"
            f" {figures['machine']}; {told}. Command: `{figures['command']}`.",
        ]
    )


def add_to_history(path: Path, figures: dict[str, Any]) -> int:
    """Compare figures with the last of a history and add them; return 3 if a tick is slower."""
    changes = {}
    try:
        changes = changes_since(last_like(path, figures), figures)
    except NothingToCompareError as reason:
        print(f"\nnot compared: {reason}")
    for label, one in changes.items():
        print(
            f"{label}: {one.ratio:.2f} of the time before ({one.low:.2f} to {one.high:.2f}),"
            f" {one.verdict}"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(figures) + "\n")
    return 3 if any(one.verdict == SpeedVerdict.SLOWER for one in changes.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
