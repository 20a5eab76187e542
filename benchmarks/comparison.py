"""What angular momentum and inertia are worth: let go, regulated, and as planned.

A G1 is pushed and walks, three times by the same tasks but for what these say of angular momentum
and inertia:

free         no task about either;
regulated    angular momentum to zero and the inertia to that at the start, as firmly as the CoM is
             led, or so many times as firmly ("--firmness"): pushes are left to the ankles;
planned      as the files that ship have it: pushes may spend angular momentum up to the trunk's
             range and get it back; a walk lets that of the swinging leg go and regulates it about
             the vertical, where only friction holds a foot. The walk also with a sixth of the
             weight on that ("loose yaw").

Told are the pushes survived while standing (`problems/push_g1.yaml`), and of the walk how far the
foot that stands turns in a step, and the largest torques, by the motors' limits.

    python benchmarks/comparison.py [--output comparison.json] [--only standing walking]

An output that exists keeps what is not measured anew.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import wbc
from wbc.controllers import Controller
from wbc.gait import Walker, WalkingWeights
from wbc.problem import load_problem
from wbc.problem.pushing import PushedProblem, PushSettings
from wbc.robot import Snapshot
from wbc.simulation import Plant, SimulationError, Terrain, simulate
from wbc.simulation.campaign import PushGrid, run_campaign

PROBLEM = Path(__file__).parents[1] / "problems" / "push_g1.yaml"
RATIOS = [0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9]
DT, SPEED, STEPS = 0.002, 0.8, 16
GROUND = 0.4  # friction: on rougher ground no foot turns
STEADY = 4  # steps, before which nothing is measured
FIRM = 30.0  # weight of the CoM's rows, in M kg m/s; by M h^2 that of what is regulated
IGNORED = 1e-9  # weight of what is let go
VARIANTS = ("free", "regulated", "planned")
LOOSE_YAW = 10.0  # weight of the angular momentum about the vertical; six times that by default


def standing_tasks(robot: wbc.Robot, height: float, firmness: float) -> dict[str, dict[str, Any]]:
    """Return what replaces values of the problem file, by variant.

    ``firmness``: of what is regulated, by that of the CoM.
    """
    unit = firmness * FIRM / (robot.mass * height**2)
    inertia = {"type": "inertia", "target": "start", "kp": 100, "weight": unit}
    return {
        "free": {"tasks.spin.weight": 0.0},
        "regulated": {"tasks.spin.weight": unit * height, "tasks.inertia": inertia},
        "planned": {},
    }


def survived_standing(overrides: Mapping[str, Any], directions: int) -> dict[str, list[float]]:
    """Return impulses survived, by direction, in parts of M omega d and in N s."""
    problem = load_problem(PROBLEM, overrides)
    pushed = PushedProblem(problem, PushSettings())
    grid = PushGrid(directions, RATIOS, failures=1)
    outcomes = run_campaign(grid, lambda: pushed)
    parts = [
        max((one.ratio for one in outcomes if one.angle == angle and one.survived), default=0.0)
        for angle in grid.angles.tolist()
    ]
    impulses = [part * pushed.unit(a) for part, a in zip(parts, grid.angles, strict=True)]
    return {"parts": parts, "impulses": impulses}


def walker_of(robot: wbc.Robot, variant: str) -> Walker:
    """Return what walks, with what it does of momentum and inertia."""
    weights, tasks = WalkingWeights(), []
    if variant == "free":
        weights = WalkingWeights(spin=IGNORED, yaw=IGNORED)
    elif variant == "loose yaw":
        weights = WalkingWeights(yaw=LOOSE_YAW)
    elif variant == "regulated":
        start = robot.snapshot(robot.posture("standing"))
        unit = FIRM / (robot.mass * float(start.com[2]) ** 2)
        tasks = [wbc.InertiaTask(robot, start.inertia, kp=100.0, weight=unit)]
        weights = WalkingWeights(spin=FIRM, yaw=FIRM)
    return Walker(robot, weights=weights, tasks=tasks, dt=DT)


def walked(robot: wbc.Robot, variant: str) -> dict[str, Any]:
    """Walk ahead."""
    walker, plant = walker_of(robot, variant), Plant(robot, dt=DT, terrain=Terrain(friction=GROUND))
    plant.reset(robot.posture("standing"))
    frames = {foot: sole.frame for foot, sole in robot.feet.items()}
    yaw_begin: dict[str, float] = {}
    turned, torques, momenta = [], [], []
    step, support = 0, ""

    def lead(tick: int, snapshot: Snapshot) -> Controller | None:
        if walker.steps >= STEPS:
            return None
        walker.command(SPEED if plant.time >= 0.2 else 0.0)
        return walker.prepare(snapshot, plant.contact_forces)

    stood, reason = True, ""
    try:
        for now in simulate(walker.controller, plant, 20.0, update=lead):
            stood, reason = now.verdict.stood, now.verdict.reason
            here = now.snapshot
            bearing = getattr(walker.phase, "support", "")
            if (walker.steps, bearing) != (step, support):  # another foot bears from now on
                if support in yaw_begin and step >= STEADY:
                    turned.append(_turn(here, frames[support], yaw_begin[support]))
                step, support = walker.steps, bearing
                if support:
                    yaw_begin[support] = _yaw(here, frames[support])
            if walker.steps >= STEADY:
                torques.append(np.abs(now.tick.torque) / walker.controller.torque_bounds)
                momenta.append(float(here.momentum[5]))
    except SimulationError as error:
        stood, reason = False, str(error)
    most = np.array(torques) if torques else np.full((1, 1), np.nan)
    return {
        "stood": stood,
        "reason": reason,
        "steps": walker.steps,
        "turned": float(np.degrees(max(turned, default=np.nan))),
        "mean_turned": float(np.degrees(np.mean(turned))) if turned else math.nan,
        "torque": float(most.max()),
        "torque_rms": float(np.sqrt(np.mean(np.square(most)))),
        "yaw_momentum": float(np.abs(momenta).max(initial=0.0)),
    }


def report_walk(robot: wbc.Robot, variant: str) -> dict[str, Any]:
    """Walk, print what came of it and return it."""
    walk = walked(robot, variant)
    print(
        f"{variant:9} walking: {'stood' if walk['stood'] else walk['reason']}; foot turns"
        f" by {walk['mean_turned']:.2f} deg in a step, at most {walk['turned']:.2f}; torque"
        f" at most {walk['torque']:.2f} of its bound, rms {walk['torque_rms']:.3f};"
        f" momentum about z at most {walk['yaw_momentum']:.2f} kg m^2/s",
        flush=True,
    )
    return walk


def _yaw(snapshot: Snapshot, frame: str) -> float:
    x = snapshot.rotation(frame)[:, 0]
    return math.atan2(x[1], x[0])


def _turn(snapshot: Snapshot, frame: str, begin: float) -> float:
    """Return by how much a frame has turned about the vertical since ``begin`` [rad]."""
    return abs(math.remainder(_yaw(snapshot, frame) - begin, 2.0 * math.pi))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="write all figures as JSON")
    parser.add_argument("--only", nargs="+", default=["standing", "walking"])
    parser.add_argument("--directions", type=int, default=8, help="of pushes while standing")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=VARIANTS)
    parser.add_argument(
        "--firmness", type=float, default=1.0, help="of regulation while standing, by the CoM's"
    )
    given = parser.parse_args()
    robot = wbc.Robot.load("g1", armature=0.003)
    height = float(robot.snapshot(robot.posture("standing")).com[2])
    overrides = standing_tasks(robot, height, given.firmness)
    rows: dict[str, dict[str, Any]] = {}
    if given.output is not None and given.output.exists():
        rows = json.loads(given.output.read_text())
    for variant in given.variants:
        row = rows.setdefault(variant, {})
        if "standing" in given.only:
            row["standing"] = survived_standing(overrides[variant], given.directions)
            parts = row["standing"]["parts"]
            print(
                f"{variant:9} standing: survives {min(parts):.2f} M omega d at least,"
                f" {np.mean(parts):.2f} on average, {np.mean(row['standing']['impulses']):.1f} N s",
                flush=True,
            )
        if "walking" in given.only:
            row["walking"] = report_walk(robot, variant)
            if variant == "planned":
                row["loose yaw"] = report_walk(robot, "loose yaw")
    if given.output is not None:
        given.output.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
