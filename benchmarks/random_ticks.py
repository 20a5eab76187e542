"""Many random ticks: no joint limit exceeded, no failed QP, every command finite.

Robots x support modes x random targets, new ones every 100 ticks, most of them out of reach, so
that limits are always active. Counts limit violations, failed QPs, slipping feet, commands that are
not finite, and infeasible statuses.

    python benchmarks/random_ticks.py [--ticks 100000] [--solver proxqp] [--seed 1]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import closed_loop
from wbc.robot import Robot, Snapshot
from wbc.robot.postures import set_mimic_joints
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PositionTask, PostureTask, Task
from wbc.tasks.keywords import Gains

ROBOTS = ("hoap2_like", "g1", "g1_27", "talos", "icub", "romeo")
SUPPORTS = ("floating", "left", "right", "double")
DT = 0.005
EPISODE = 100


@dataclass
class Record:
    """Observations over all ticks of one robot and support."""

    ticks: int = 0
    worst_violation: float = 0.0
    worst_slip: float = 0.0
    worst_kkt: float = 0.0
    statuses: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)


def random_tasks(robot: Robot, rng: np.random.Generator, here: Snapshot) -> list[Task]:
    """Targets of inertia, CoM, base and some frame, mostly out of reach; weights of any size."""
    frame = robot.frame_names[rng.integers(len(robot.frame_names))]
    shape = np.diag(np.diag(here.inertia_in("base")) * np.exp(rng.normal(scale=0.5, size=3)))
    com = here.com + rng.normal(scale=0.1, size=3)
    place = here.position(frame) + rng.normal(scale=0.3, size=3) * 10 ** rng.uniform(-1, 1)

    def law() -> Gains:
        return {"weight": 10 ** rng.uniform(-2, 2), "gain": rng.uniform(0.02, 1)}

    second = bool(rng.integers(2))
    return [
        InertiaTask(robot, shape, frame="base", per_mass=True, second_order=second, **law()),
        ComTask(robot, com, **law()),
        OrientationTask(robot, "base", here.rotation("base"), **law()),
        PositionTask(robot, frame, place, priority=int(rng.integers(2)), **law()),
        PostureTask(robot, robot.posture("standing"), weight=0.01, gain=0.1),
    ]


def controller_of(
    robot: Robot, q: np.ndarray, mode: str, rng: np.random.Generator, **parts: Any
) -> KinematicController:
    """Return a controller with random tasks about a posture."""
    here = robot.snapshot(q)
    tasks, contacts = random_tasks(robot, rng, here), support(here, mode)
    return KinematicController(robot, tasks, contacts=contacts, dt=DT, **parts)


def episode(robot: Robot, mode: str, rng: np.random.Generator, solver: str, record: Record) -> None:
    """Run one set of random targets from a random posture."""
    q = random_posture(robot, rng, 0.3)
    limits = Limits(robot)
    controller = controller_of(robot, q, mode, rng, limits=limits, solver=solver)
    for now in closed_loop(controller, q, EPISODE):
        tick = now.tick
        record.ticks += 1
        record.statuses[tick.status.value] += 1
        if tick.ok:
            record.worst_kkt = max(record.worst_kkt, tick.solution.residuals.primal)
        elif len(record.examples) < 3:
            record.examples.append(tick.report())
        if not np.isfinite(tick.velocity).all():
            record.examples.append("command not finite")
        record.worst_violation = max(record.worst_violation, -limits.worst_margin(now.q)[0])
        here = robot.snapshot(now.q)
        for contact in controller.contacts:
            record.worst_slip = max(record.worst_slip, contact.slip(here))


def random_posture(robot: Robot, rng: np.random.Generator, scale: float) -> np.ndarray:
    """Return a random posture within the limits, at about this distance from standing [rad]."""
    step = np.concatenate((np.zeros(6), rng.normal(scale=scale, size=robot.nv - 6)))
    return robot.limits.clamped(robot.integrate(robot.posture("standing"), step, 1.0))


def clear_posture(robot: Robot, margins: SelfCollision, rng: np.random.Generator) -> np.ndarray:
    """Return a random posture in which no pair is inside its margin."""
    scale = 0.3
    while True:
        q = random_posture(robot, rng, scale)
        # Without it no velocity satisfies gears and limits.
        set_mimic_joints(robot.limits, q, robot.couplings)
        if (margins.model.nearest(robot.snapshot(q)).distance >= margins.margins).all():
            return q
        scale *= 0.9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--solver", default="proxqp")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    cases = [(Robot.load(name), mode) for name in options.robots for mode in SUPPORTS]
    share = -(-options.ticks // len(cases))
    columns = f"{'violation':>11s}{'slip mm':>9s}{'primal':>9s}  statuses"
    print(f"{'robot':12s}{'support':10s}{'ticks':>8s}" + columns)
    total = Counter()
    for robot, mode in cases:
        record = Record()
        while record.ticks < share:
            episode(robot, mode, rng, options.solver, record)
        total += record.statuses
        print(
            f"{robot.name:12s}{mode:10s}{record.ticks:8d}{max(record.worst_violation, 0):11.1e}"
            f"{record.worst_slip * 1e3:9.4f}{record.worst_kkt:9.1e}  {dict(record.statuses)}"
        )
        for example in record.examples:
            print("    ", example)
    print("total", dict(total))


if __name__ == "__main__":
    main()
