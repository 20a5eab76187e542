"""The effect of angular momentum and inertia tasks in standing: free, regulated, as planned.

A G1 is pushed, three times with the same tasks except those about angular momentum and inertia; for
walks see walk_comparison.py:

free         no task about either;
regulated    angular momentum to zero and the inertia to that at the start, as firmly as the CoM, or
             by another factor ("--firmness"): pushes are left to the ankles;
planned      as the shipped file has it: pushes may use angular momentum up to the trunk's range.

It reports the pushes survived (`problems/push_g1.yaml`).

    python benchmarks/comparison.py [--output comparison.json]

An existing output keeps values that are not measured again.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import wbc
from wbc.problem import load_problem
from wbc.problem.pushed_problem import PushedProblem, PushSettings
from wbc.simulation.campaign import PushGrid, run_campaign

PROBLEM = Path(__file__).parents[1] / "problems" / "push_g1.yaml"
RATIOS = [0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9]
FIRM = 30.0  # weight of the CoM's rows, in M kg m/s; by M h^2 that of what is regulated
VARIANTS = ("free", "regulated", "planned")


def standing_tasks(robot: wbc.Robot, height: float, firmness: float) -> dict[str, dict[str, Any]]:
    """Return the overrides of the problem file, by variant.

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, help="write all figures as JSON")
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
        row["standing"] = survived_standing(overrides[variant], given.directions)
        parts = row["standing"]["parts"]
        print(
            f"{variant:9} standing: survives {min(parts):.2f} M omega d at least,"
            f" {np.mean(parts):.2f} on average, {np.mean(row['standing']['impulses']):.1f} N s",
            flush=True,
        )
    if given.output is not None:
        given.output.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
