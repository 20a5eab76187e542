"""Motions of problem files, with noise, delay and wrong masses: falls, slips and errors.

For each file, exact and with this many seeds of joint noise 1e-3 rad and 0.05 rad/s (and as much on
the base), 2 ms of delay, and masses 10 % off: its end; the motion of feet while held, true and
measured; the largest error of CoM and raised feet; the CoP's distance from the planned one (99 % of
the ticks, and the largest; a landing foot makes spikes of some milliseconds); the largest ground
force of a step of the physics, of a mean over 10 ms and over 50 ms (in weights of the simulated
robot, with its wrong masses); and the relaxed ticks. Errors are of the true states; without a task
there is none ("-"). A foot counts if all rows of its position have weight whenever any has, which
is not so in a fall.

    python benchmarks/motions.py problems/shiko_torque_hoap2.yaml [...] [--seeds 10]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import NOISE

from wbc.problem import Problem, load_problem
from wbc.run import Stop
from wbc.simulation import FallLimits, Plant, SimulationResult, run_trial

MM = 1e3


def disturbed(seed: int) -> dict[str, Any]:
    """Return the overrides of a seed: masses 10 % too small or too large by turns."""
    return {
        "simulation.sensors": {**NOISE, "seed": seed},
        "simulation.model_error": {"mass": 1.1 if seed % 2 else 0.9, "seed": seed},
    }


def simulated(problem: Problem) -> tuple[SimulationResult, np.ndarray]:
    """Return a simulation and the ground force (n, 3) [N] in every step of its physics."""
    plant = problem.plant()
    forces = record_every_step(plant)
    result = run_trial(
        problem.supervisor(plant),
        plant,
        Stop(**problem.spec.whole_stop.model_dump()),
        falls=FallLimits(**problem.spec.simulation.falls),
    )
    return result, np.array(forces)


def record_every_step(plant: Plant) -> list[np.ndarray]:
    """Make a plant advance by single physics steps; return the list of their forces."""
    forces, step = list[np.ndarray](), plant.step

    def step_by_step(torque: np.ndarray, dt: float | None = None) -> None:
        for _ in range(round((plant.dt if dt is None else dt) / plant.physics_dt)):
            step(torque, plant.physics_dt)
            forces.append(plant.contacts.forces.sum(axis=0))

    plant.step = step_by_step  # type: ignore[method-assign]
    return forces


def largest_mean(force: np.ndarray, steps: int) -> float:
    """Return the largest mean over so many neighbours of a force's size (n,)."""
    return float(np.convolve(force, np.full(steps, 1.0 / steps), "valid").max())


def largest_slip(problem: Problem, result: SimulationResult) -> float:
    """Return the largest true slip of a foot from its place at the start of holding [m]."""
    robot, support = problem.parts.robot, result.run.history.support
    true = [robot.snapshot(q) for q in result.arrays["q"][: len(support)]]
    worst = 0.0
    for name, foot in robot.feet.items():
        held = [name in one.split(",") for one in support]
        for k, on in enumerate(held):
            if not on:
                continue
            position = true[k].position(foot.frame)
            if k == 0 or not held[k - 1]:
                anchor = position
            worst = max(worst, float(np.linalg.norm(position - anchor)))
    return worst


def figures(problem: Problem, result: SimulationResult, forces: np.ndarray) -> dict[str, float]:
    """Return a simulation's figures, lengths in mm, forces in weights."""
    arrays, robot = result.arrays, problem.parts.robot
    errors = result.run.history.errors
    measured = [robot.snapshot(q) for q in result.run.history.q]
    true = [robot.snapshot(q) for q in arrays["q"][: len(measured)]]
    feet = []
    for name in robot.feet:
        if f"{name} foot" in errors and has_full_weight(problem, f"{name} foot"):
            off = [s.position(robot.feet[name].frame) for s in true]
            off = np.array(off) - [s.position(robot.feet[name].frame) for s in measured]
            feet.append(errors[f"{name} foot"][:, :3] + off)
    com = np.array([s.com for s in true]) - [s.com for s in measured]
    com = com + errors["com"] if errors.get("com", np.empty((0, 0))).shape[1] == 3 else None
    cop = np.linalg.norm(arrays["cop"][1:, :2] - arrays["planned_cop"][1:, :2], axis=1)
    weight = robot.weight * float(problem.spec.simulation.model_error.get("mass", 1.0))
    force = np.linalg.norm(forces, axis=1) / weight
    window = 0.01 / problem.spec.simulation.physics_dt
    slip = result.run.slip
    return {
        "slip": MM * largest_slip(problem, result),
        "measured": MM * (slip.value if slip is not None else np.nan),
        "com": MM * largest(com),
        "feet": MM * max((largest(one) for one in feet), default=np.nan),
        "cop 99": MM * float(np.nanpercentile(cop, 99)) if np.isfinite(cop).any() else np.nan,
        "cop max": MM * float(np.nanmax(cop)) if np.isfinite(cop).any() else np.nan,
        "force": float(force.max()),
        "10 ms": largest_mean(force, round(window)),
        "50 ms": largest_mean(force, round(5 * window)),
        "relaxed": 100.0 * result.relaxed,
    }


def has_full_weight(problem: Problem, task: str) -> bool:
    """Return whether all rows of a foot's position have weight in each phase in which any has."""
    weights = [phase.changes[task].weight for phase in problem.parts.phases]
    return all(weight is None or bool((weight[:3] > 0.0).all()) for weight in weights)


def largest(errors: np.ndarray | None) -> float:
    """Return the largest norm of a row; NaN where a task was off."""
    if errors is None or not np.isfinite(errors).any():
        return float("nan")
    return float(np.nanmax(np.linalg.norm(errors, axis=1)))


def main(paths: list[Path], seeds: int) -> None:
    for path in paths:
        print(f"{path.name}: mm, forces in weights, relaxed ticks in %")
        for seed in range(seeds + 1):
            problem = load_problem(path, disturbed(seed) if seed else None)
            assert isinstance(problem, Problem)
            result, forces = simulated(problem)
            found = figures(problem, result, forces)
            told = "  ".join(
                f"{name} {value:6.2f}" if np.isfinite(value) else f"{name}      -"
                for name, value in found.items()
            )
            name = f"seed {seed}" if seed else "exact"
            print(f"  {name:8} {told}  {result.status.value}: {result.reason}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problems", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    main(given.problems, given.seeds)
