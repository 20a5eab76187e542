"""Recorded people who stay on both feet, on robots in MuJoCo: which stand, and with what error.

Recordings are not part of the project: any files that `wbc retarget` reads. Each is retargeted and
tracked at the torque level in MuJoCo, with noise, 2 ms of delay and masses wrong by up to 10 %
(benchmarks/disturbed.py), over seeds: as it is, or with `:SLOWER` and `:SLOWER:LEAN` behind the
file's name. Errors are of the true states, during the motion. The infeasible share is of the motion
before the simulation, eased in and out.

    python benchmarks/standing_motions.py bow.bvh:2:0.01 call.bvh [...] [--robots g1] [--seeds 10]
        [-o benchmarks/standing_motions.json] [--page benchmarks/RESULTS.md]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import NOISE, mass_of, robot_named
from human_walk import rounded
from qpbench.page import put_section

import wbc
from wbc.human import human_motion, read_markers
from wbc.problem import Problem, load_problem
from wbc.problem.standing_problem import standing_problem
from wbc.retargeting import body_map
from wbc.retargeting.reference import MotionReference
from wbc.retargeting.standing import StandingMotion


def track(path: Path, seed: int) -> dict[str, Any]:
    """Return a robot's results with one seed."""
    problem = load_problem(
        path,
        {
            "simulation.sensors": {**NOISE, "seed": seed},
            "simulation.model_error": {"mass": mass_of(seed), "seed": seed},
        },
    )
    assert isinstance(problem, Problem)
    result = problem.simulate()
    found = result.tracking
    assert found is not None and found.joints is not None
    return {
        "seed": seed,
        "stood": result.verdict.stood,
        "verdict": result.verdict.reason,
        "com_mm": [1e3 * found.com.rms, 1e3 * found.com.worst],
        "joints_rad": [found.joints.rms, found.joints.worst],
        "momentum_of_peak": found.momentum.rms / found.momentum.peak,
        "slip_mm": None if result.run.slip is None else 1e3 * result.run.slip.value,
        "relaxed_percent": 100.0 * result.relaxed,
        "torque_by_limit": next(iter(result.torque_use.values())),
        "at_bound_percent": 100.0 * max(result.saturated.values(), default=0.0),
    }


def figures(path: Path, name: str, slower: float, lean: float | None, seeds: int) -> dict[str, Any]:
    """Return a recording's figures on a robot."""
    robot = robot_named(name)
    with tempfile.TemporaryDirectory() as folder:
        motion, problem = Path(folder) / "motion.npz", Path(folder) / "problem.yaml"
        human = human_motion(read_markers(path), by_steps=False)
        wbc.retarget(human, robot, roll=0.0).save(motion)
        standing = StandingMotion.read(motion, robot)
        trunk = body_map(robot).trunk
        text = standing_problem(
            standing, motion.name, model=name, trunk=trunk, slower=slower, lean=lean
        )
        problem.write_text(text)
        reference = MotionReference(standing, slower=slower, lean=lean)
        unbalanced = sorted(reference.unbalanced, key=lambda one: one.by)
        rows = []
        for seed in range(seeds):
            rows.append(rounded(track(problem, seed)))
            print(path.stem, name, rows[-1], flush=True)
    return {
        "slower": slower,
        "lean_m": lean,
        "seconds": reference.duration,
        "com_moves_mm": 1e3 * float(np.ptp(standing_com(reference), axis=0).max()),
        "led_mm": 1e3 * reference.led,
        "unbalanced": {one.what: one.by for one in unbalanced},
        "seeds": rows,
    }


def standing_com(reference: MotionReference) -> np.ndarray:
    """Return the CoM's path (n, 3) [m]."""
    times = np.linspace(reference.begins, reference.ends, 500)
    return np.asarray(reference.at(times).com)


def section(known: dict[str, Any]) -> str:
    """Return the table of a page."""
    heads = (
        "recording, robot", "slower, lean mm", "s", "stood", "CoM rms mm", "worst mm",
        "CoM moves mm", "joints rms rad", "slip mm", "torque by limit", "gave way %",
        "asked: CoP outside mm", "friction lacking", "torque above %",
    )  # fmt: skip
    lines = ["## Standing people on humanoids, in physics", ""]
    lines += [f"| {' | '.join(heads)} |", "| --- |" + " ---: |" * (len(heads) - 1)]
    for name, one in known.items():
        rows, asked = one["seeds"], one["unbalanced"]
        lean = "-" if one["lean_m"] is None else f"{1e3 * one['lean_m']:.0f}"
        stood = sum(bool(row["stood"]) for row in rows)
        cells = (
            name, f"{one['slower']:g}, {lean}", f"{one['seconds']:.1f}", f"{stood} of {len(rows)}",
            f"{np.mean([row['com_mm'][0] for row in rows]):.1f}",
            f"{max(row['com_mm'][1] for row in rows):.1f}",
            f"{one['com_moves_mm']:.0f}",
            f"{np.mean([row['joints_rad'][0] for row in rows]):.3f}",
            f"{max(row['slip_mm'] or 0.0 for row in rows):.1f}",
            f"{max(row['torque_by_limit'] for row in rows):.2f}",
            f"{np.mean([row['relaxed_percent'] for row in rows]):.1f}",
            f"{1e3 * asked.get('CoP outside the feet', 0.0):.0f}",
            f"{asked.get('friction above the cone', 0.0):.1f}",
            f"{100.0 * asked.get('torque above the limit', 0.0):.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    lines += [
        "",
        "With noise, 2 ms of delay and masses wrong by up to 10 %. CoM and joints: true ones from"
        " the motion's, rms in the mean of the seeds, worst of all. Asked: what the motion itself"
        " would need, at worst, where the ground and the joints do not have it. Command: `python"
        " benchmarks/standing_motions.py RECORDING[:SLOWER[:LEAN]] ... -o"
        " benchmarks/standing_motions.json --page benchmarks/RESULTS.md`.",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recordings", nargs="*", help="FILE[:SLOWER[:LEAN]]; none: only --page")
    parser.add_argument("--robots", nargs="+", default=["g1"])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--page", type=Path, help="page to write a section into, of the output")
    options = parser.parse_args()
    known: dict[str, Any] = {}
    if options.output is not None and options.output.exists():
        known = json.loads(options.output.read_text())
    for given in options.recordings:
        file, *more = given.split(":")
        slower, lean = float(more[0]) if more else 1.0, float(more[1]) if len(more) > 1 else None
        for name in options.robots:
            key = f"{Path(file).stem}, {name}"
            found = figures(Path(file), name, slower, lean, options.seeds)
            known[key] = rounded({k: v for k, v in found.items() if k != "seeds"})
            known[key]["seeds"] = found["seeds"]
            if options.output is not None:
                lines = (f"{json.dumps(k)}: {json.dumps(v)}" for k, v in known.items())
                options.output.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    if options.page is not None:
        put_section(options.page, "standing motions", section(known))


if __name__ == "__main__":
    main()
