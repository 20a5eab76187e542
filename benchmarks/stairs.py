"""Stairs and stepping stones on footsteps with given heights and tilts: runs that stand.

Runs problems/stairs_g1.yaml and problems/stones_g1.yaml over seeds of their noise, each with
another mass wrong by up to 10 %. Other robots do the same with their own sizes and times: stairs of
3 cm for a small humanoid.

    python benchmarks/stairs.py [--seeds 10] [--first 0] [--robots g1 hoap2_like] [--only stairs]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from pathlib import Path
from typing import Any, NamedTuple

from disturbed import mass_of, robot_named

from wbc.problem import Problem, load_problem
from wbc.simulation import SimulationError

PROBLEMS = Path(__file__).parents[1] / "problems"


class Size(NamedTuple):
    """A G1's lengths, widths, heights and times are multiplied by these for another robot."""

    long: float
    wide: float
    high: float
    slow: float


SIZES = {"g1": Size(1.0, 1.0, 1.0, 1.0), "hoap2_like": Size(0.43, 0.42, 0.2, 1.1)}


def problem_of(kind: str, name: str, seed: int) -> Problem:
    """Return stairs or stones for a robot."""
    path = PROBLEMS / f"{kind}_g1.yaml"
    changes: dict[str, Any] = {
        "simulation.sensors.seed": seed,
        "simulation.model_error.mass": mass_of(seed),
    }
    if name != "g1":
        changes |= {"robot.model": name, "simulation.falls": {}, "constraints": {}}
        changes |= scale_problem(path, name)
    problem = load_problem(path, changes)
    assert isinstance(problem, Problem)
    return problem


def scale_problem(path: Path, name: str) -> dict[str, Any]:
    """Return footsteps and terrain for another robot, from its standing feet on."""
    long, wide, high, slow = SIZES[name]
    starts = [
        robot.snapshot(robot.posture("standing")).position(robot.feet["left"].frame)[0]
        for robot in (robot_named("g1"), robot_named(name))
    ]
    plain = load_problem(path)
    assert isinstance(plain, Problem)
    data = plain.source.data
    steps = [dict(one) for one in data["gait"]["footsteps"]]
    for step in steps:
        step["x"] = starts[1] + long * (step["x"] - starts[0])
        step["y"], step["z"] = wide * step["y"], high * step["z"]
        step["duration"] *= slow
    boxes = [dict(one) for one in data["simulation"]["terrain"]["steps"]]
    for box in boxes:
        x, y, z = box["centre"]
        box["centre"] = [starts[1] + long * (x - starts[0]), wide * y, high * z]
        length, width, height = box["size"]
        box["size"] = [long * length, wide * width, high * height]
    return {"gait.footsteps": steps, "simulation.terrain.steps": boxes}


def measure(kind: str, name: str, seed: int) -> tuple[bool, str]:
    """Return whether the robot stands in the end with all footsteps done, and a line."""
    told = f"{kind:7} {name:11} seed {seed:2}"
    try:
        problem = problem_of(kind, name, seed)
        result = problem.simulate()
    except SimulationError as error:
        return False, f"{told} {error}"
    steps = next((note for note in result.notes if note.startswith("footsteps")), "")
    relaxed = f"{100 * result.relaxed:.2f} % of ticks relaxed"
    return result.verdict.stood, f"{told} {result.verdict.reason}; {steps}; {relaxed}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=["g1"], choices=SIZES)
    parser.add_argument("--only", nargs="+", default=["stairs", "stones"])
    given = parser.parse_args()
    for name in given.robots:
        for kind in given.only:
            stood = 0
            for seed in range(given.first, given.first + given.seeds):
                stands, line = measure(kind, name, seed)
                stood += stands
                print(line, flush=True)
            print(f"{kind:7} {name:11} {stood}/{given.seeds} stood", flush=True)


if __name__ == "__main__":
    main()
