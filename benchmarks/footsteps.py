"""Landing places against the given footsteps, by the simulation's true state.

Runs problems/footsteps_g1.yaml over seeds of its noise, each with another mass wrong by up to 10 %,
and once without noise; other robots take shorter steps, scaled by their legs, without
self-collision. A foot's place is measured in the middle of its next single support, the last one's
in the end.

    python benchmarks/footsteps.py [--seeds 10] [--robots g1 talos hoap2_like]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import mass_of

from wbc.gait import Footstep
from wbc.gait.phases import sole_poses
from wbc.gait.prescribed_steps import in_world
from wbc.problem import Problem, load_problem
from wbc.simulation import SimulationResult

PROBLEM = Path(__file__).parents[1] / "problems" / "footsteps_g1.yaml"
# Lengths of steps and widths of others, in parts of a G1's; their trunks are found by default.
SIZES = {"g1": (1.0, 1.0), "talos": (0.9, 0.85), "hoap2_like": (0.1, 0.42)}


def problem_of(name: str, seed: int | None) -> Problem:
    """Return the footsteps for a robot; no seed: without noise, delay and wrong masses."""
    changes: dict[str, Any] = {}
    if name != "g1":
        long, wide = SIZES[name]
        plain = load_problem(PROBLEM)
        assert isinstance(plain, Problem)
        steps = [dict(one) for one in plain.source.data["gait"]["footsteps"]]
        for step in steps:
            step["x"], step["y"] = long * step["x"], wide * step["y"]
        changes |= {"robot.model": name, "gait.footsteps": steps, "simulation.falls": {}}
        changes |= {"constraints": {}}  # a small humanoid's hips do not let it step as wide
    if seed is None:
        changes |= {"simulation.sensors": {}, "simulation.model_error": {}}
    else:
        changes |= {"simulation.sensors.seed": seed}
        changes |= {"simulation.model_error.mass": mass_of(seed)}
    problem = load_problem(PROBLEM, changes)
    assert isinstance(problem, Problem)
    return problem


def landing_poses(result: SimulationResult, count: int) -> list[np.ndarray]:
    """Return the true x, y, yaw (3,) of the landed feet, in order."""
    support = result.arrays["support"]
    edges = [0, *(np.flatnonzero(support[1:] != support[:-1]) + 1).tolist(), len(support)]
    alone = [(str(support[a]), a, b) for a, b in pairwise(edges) if support[a] in ("left", "right")]
    swings = [("right" if foot == "left" else "left") for foot, _, _ in alone]
    rows = [(a + b) // 2 for _, a, b in alone[1:]] + [len(support) - 1]
    found = []
    for foot, row in zip(swings[:count], rows, strict=False):
        here = result.robot.snapshot(result.arrays["q"][row])
        found.append(sole_poses(here)[foot])
    return found


def measure(name: str, seed: int | None) -> str:
    """Return a line of the table."""
    problem = problem_of(name, seed)
    gait = problem.spec.gait
    start = problem.parts.robot.snapshot(problem.parts.start)
    world = in_world([one.footstep for one in gait.footsteps], sole_poses(start))
    result = problem.simulate()
    places = landing_poses(result, len(world))
    way = [np.linalg.norm(p[:2] - s.place) for p, s in zip(places, world, strict=False)]
    turn = [abs(_turn(p, s)) for p, s in zip(places, world, strict=False)]
    return (
        f"{name:11} {'exact' if seed is None else f'seed {seed}':7} {result.reason}:"
        f" {len(places)} of {len(world)} made, {1e3 * max(way):.1f} mm and"
        f" {math.degrees(max(turn)):.1f} degrees off at most, {1e3 * float(np.mean(way)):.1f} mm"
        f" and {math.degrees(float(np.mean(turn))):.1f} degrees in the mean;"
        f" {100 * result.relaxed:.2f} % of ticks relaxed"
    )


def _turn(pose: np.ndarray, step: Footstep) -> float:
    return math.remainder(pose[2] - step.yaw, math.tau)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--robots", nargs="+", default=list(SIZES), choices=SIZES)
    given = parser.parse_args()
    for name in given.robots:
        for seed in (None, *range(given.seeds)):
            print(measure(name, seed), flush=True)


if __name__ == "__main__":
    main()
