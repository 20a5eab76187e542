"""Tracking errors of simulated humanoids on the pendulum's plans: squat, lean, push; G1 and TALOS.

Each plan is solved from the robot's own pendulum and followed by torques (problems/track_*.yaml).
Reported, while the plan lasts: error of the CoM (root mean square, worst), of the CoP, and of the
angular momentum, the last relative to the plan's peak; and relaxed ticks.

    python benchmarks/plans.py [--problems problems/track_squat_g1.yaml ...] [--set PATH=VALUE ...]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wbc.problem import Problem, load_problem
from wbc.problem.overrides import parse_override

PROBLEMS = Path(__file__).parents[1] / "problems"
HEAD = (
    f"{'':18} {'CoM [mm]':>14} {'CoP [mm]':>14} {'angular momentum [% of peak]':>29} {'relaxed':>9}"
)


def follow(path: Path, overrides: Mapping[str, Any]) -> str:
    """Return one line of the table."""
    problem = load_problem(path, overrides)
    if not isinstance(problem, Problem):
        raise SystemExit(f"{path}: a pendulum's problem; give one of a robot that follows a plan")
    result = problem.simulate()
    found = result.tracking
    if found is None:
        raise SystemExit(f"{path}: no task has target: {{plan: ...}}")
    k = found.momentum
    return (
        f"{path.stem.removeprefix('track_'):18}"
        f" {1e3 * found.com.rms:6.2f} {1e3 * found.com.worst:7.2f}"
        f" {1e3 * found.cop.rms:6.2f} {1e3 * found.cop.worst:7.1f}"
        f" {100 * k.rms / k.peak:6.1f} {100 * k.worst / k.peak:7.1f} of {k.peak:8.2f}"
        f" {100 * result.relaxed:7.2f} %  {result.verdict.reason}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    shipped = sorted(PROBLEMS.glob("track_*.yaml"))
    parser.add_argument("--problems", nargs="+", type=Path, default=shipped)
    parser.add_argument("--set", nargs="*", default=[], dest="assigned")
    given = parser.parse_args()
    print(HEAD)
    for one in given.problems:
        print(follow(one, dict(map(parse_override, given.assigned))), flush=True)
