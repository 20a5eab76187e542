"""Deliberate contradictions: the command, and whether the report names the right rows.

Families of generated problems on several robots, each without any solution: feet held too far
apart, contacts that drifted farther than joint speeds can correct, margins and contacts against a
demand, a demand beyond all joint speeds. Every verdict is checked by a linear program (HiGHS), the
command against all limits, and each named row by leaving it out: the others must then have a
solution.

    python benchmarks/infeasible.py [--count 200] [--seed 0]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from collections import Counter
from collections.abc import Sequence
from time import perf_counter

import numpy as np
from conflict_judge import can_hold, conflict_error

from wbc.constraints import Constraint, Contact, Limits, SelfCollision, support
from wbc.constraints.rows import Bounds
from wbc.controllers import KinematicController, Tick
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")


class Demand(Constraint):
    """A user's own constraint: points of the robot move at given velocities."""

    name = "demand"

    def __init__(self, robot: Robot, frames: Sequence[str], velocities: np.ndarray) -> None:
        self.robot, self._frames, self._velocities = robot, tuple(frames), velocities

    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        matrix = np.concatenate([snapshot.jacobian(frame)[:3] for frame in self._frames])
        wanted = self._velocities.ravel()
        labels = tuple(f"{frame} {axis}" for frame in self._frames for axis in "xyz")
        return Bounds(labels, matrix, wanted - 1e-3, wanted + 1e-3)


def feet_apart(robot: Robot, here: Snapshot, rng: np.random.Generator) -> dict:
    """Both feet held, one at a place out of reach of the legs."""
    left, right = support(here, "double")
    moved = left.position + rng.uniform(0.5, 2.0) * _unit(rng)
    return {"contacts": (Contact(robot, left.frame, moved, left.rotation), right)}


def drifted(robot: Robot, here: Snapshot, rng: np.random.Generator) -> dict:
    """Both feet held, rotated against each other by more than joint speeds can correct."""
    left, right = support(here, "double")
    angle = rng.uniform(0.5, 1.5)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    return {"contacts": (Contact(robot, left.frame, left.position, turn @ left.rotation), right)}


def hand_through_body(robot: Robot, here: Snapshot, rng: np.random.Generator) -> dict:
    """A foot must both stay and move away: margins, contacts and a demand."""
    contacts = support(here, "double")
    frame = contacts[int(rng.integers(2))].frame
    demand = Demand(robot, [frame], rng.uniform(0.1, 1.0) * _unit(rng)[None])
    return {"contacts": contacts, "constraints": (SelfCollision(robot), demand)}


def too_fast(robot: Robot, here: Snapshot, rng: np.random.Generator) -> dict:
    """A foot must move faster than the joints' limits allow, the other one is held."""
    left, right = (robot.feet[side].frame for side in ("left", "right"))
    demand = Demand(robot, [left], rng.uniform(30.0, 100.0) * _unit(rng)[None])
    return {"contacts": support(here, [right]), "constraints": (demand,)}


FAMILIES = (feet_apart, drifted, hand_through_body, too_fast)


def contradictory(
    robot: Robot, family, rng: np.random.Generator
) -> tuple[KinematicController, Snapshot, Limits]:
    """Return a controller without a solution at the snapshot."""
    q = robot.posture("standing")
    step = np.concatenate((np.zeros(6), 0.1 * rng.standard_normal(robot.nv - 6)))
    low, high = robot.limits.lower, robot.limits.upper
    moved = robot.integrate(q, step, 1.0)
    positions = robot.limits.joint_positions(moved)
    if ((positions < low) | (positions > high)).any():
        moved = q
    here = robot.snapshot(moved, np.zeros(robot.nv))
    limits = Limits(robot)
    tasks = [ComTask(robot, here.com), PostureTask(robot, q, weight=0.1)]
    parts = family(robot, here, rng)
    return (
        KinematicController(robot, tasks, limits=limits, on_failure="closest", **parts),
        here,
        limits,
    )


def check_answer(tick: Tick, box: tuple[np.ndarray, np.ndarray]) -> list[str]:
    """Return the errors of the answer to a contradiction."""
    faults = []
    n = tick.velocity.size
    if can_hold(tick.qp):
        return ["not a contradiction"] if not tick.ok else []
    if tick.ok:
        return ["solved without a solution"]
    if not np.isfinite(tick.velocity).all():
        faults.append("not finite")
    if (tick.velocity < box[0][:n]).any() or (tick.velocity > box[1][:n]).any():
        faults.append("outside the limits")
    conflict = tick.conflict
    if conflict is None or not conflict.rows:
        return [*faults, "no row named"]
    return faults + conflict_error(tick.qp, conflict)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    robots = [Robot.load(name) for name in ROBOTS]
    statuses, faults, sizes, times = Counter(), Counter(), [], []
    k = 0
    while sum(statuses.values()) < options.count:
        family = FAMILIES[k % len(FAMILIES)]
        robot = robots[(k // len(FAMILIES)) % len(robots)]
        k += 1
        controller, here, limits = contradictory(robot, family, rng)
        start = perf_counter()
        tick = controller.step(here)
        seconds = perf_counter() - start
        if tick.ok and can_hold(tick.qp):
            continue  # no contradiction after all
        times.append(seconds)
        statuses[f"{family.__name__}: {tick.status.value}"] += 1
        for fault in check_answer(tick, limits.emergency_braking_box(here, controller.dt)):
            faults[f"{family.__name__}: {fault}"] += 1
        if not tick.ok and tick.conflict is not None:
            sizes.append(len(tick.conflict.rows))
    print(f"{options.count} contradictions of {k} problems, {len(ROBOTS)} robots")
    for name, count in sorted(statuses.items()):
        print(f"  {name:40} {count}")
    print("faults:", dict(faults) or "none")
    print(f"named rows: median {np.median(sizes):.0f}, largest {max(sizes)}")
    print(f"tick with the closest command: median {1e3 * np.median(times):.1f} ms")


def _unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)


if __name__ == "__main__":
    main()
