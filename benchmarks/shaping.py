"""Global inertia shaping against many independent L-BFGS-B searches, and against the local QP.

Targets are random but sensible: the standing robot's moments made tall and thin, flat, large or
small, alternating, in base axes while floating and in world axes on both feet. SciPy gets exact
gradients from the snapshot's Jacobians; on two feet its searches are augmented Lagrangians in the
joints, with the left sole as root. Both sides use the same number of processes; SciPy's are started
before its clock is.

For each target: the cost found by either side, wall time and CPU time of all processes, the
relative error |I - target| / |target| at the start, at the rest of the local QP, and at the end of
the global motion, and whether that motion satisfies every constraint.

    python benchmarks/shaping.py [--robots g1 icub] [--targets 20] [--scipy-starts 200]

On two cores 200 L-BFGS-B searches take 2 to 30 s for a floating target and 1 to 3 minutes for one
on both feet, the global search 0.4 to 5 s; all 100 targets take about two hours. Each target is a
line as soon as it is measured; with --output it is also written then, and the same command
continues after an interruption:

    nohup python benchmarks/shaping.py --output shaping.json > shaping.txt &

SciPy's part need not be repeated to try another search: its results and times are read from such a
file, or several; targets missing there are searched by SciPy as usual. Times compare only if both
were measured on the same idle machine; CPU times tell if it was not.

    python benchmarks/shaping.py --scipy-from shaping.json --output again.json

For a quick test:

    python benchmarks/shaping.py --robots hoap2_like g1 --targets 4 --scipy-starts 50
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import multiprocessing
import resource
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path
from time import perf_counter

import numpy as np
from shaping_scipy import Target, axes, scipy_search, targets

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import closed_loop
from wbc.robot import Robot
from wbc.shaping import GlobalShaping, ShapingMotion
from wbc.spatial import FROBENIUS_WEIGHTS
from wbc.tasks import InertiaTask

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")
WITHIN = 1.01  # of SciPy's best cost
MET = 1e-8  # of the cost at the start: both have met the target
GOALS = ("good", "faster", "cheaper", "arrived")
THEIRS = ("scipy_cost", "scipy_wall", "scipy_cpu")


def scipy_figures(target: Target, options: argparse.Namespace, pool) -> dict[str, float]:
    """Return the best of SciPy's searches and their times, measured now or earlier."""
    for row in earlier_rows(options):
        if target_entry(target).items() <= row.items():
            # Files without it are of an idle machine, whose cores SciPy kept busy.
            row.setdefault("scipy_cpu", options.workers * row["scipy_wall"])
            return {key: row[key] for key in THEIRS}
    pool.map(scipy_search, [(target, 1)] * options.workers, chunksize=1)  # loads robots
    jobs = [(target, seed) for seed in range(options.scipy_starts)]
    began = perf_counter()
    costs, cpu = zip(*pool.map(scipy_search, jobs, chunksize=1), strict=True)
    taken = perf_counter() - began
    return dict(zip(THEIRS, (min(costs), taken, sum(cpu)), strict=True))


def earlier_rows(options: argparse.Namespace) -> Iterator[dict]:
    """Yield the rows of files with as many searches by SciPy in as many processes."""
    for file in options.scipy_from:
        written = json.loads(file.read_text())
        for key in ("scipy_starts", "workers", "seed"):
            if written["settings"][key] != getattr(options, key):
                raise SystemExit(f"{file}: {key} is {written['settings'][key]} there")
        yield from written["rows"]


def target_entry(target: Target) -> dict:
    """Return a target as written to a file."""
    return json.loads(json.dumps(asdict(target)))


# --------------------------------------------------------------------------------- measurements


def relative_error(task: InertiaTask, robot: Robot, q) -> float:
    error = task.residual(robot.snapshot(q)).error
    wanted = np.sqrt(FROBENIUS_WEIGHTS) * task.target
    return float(np.linalg.norm(error) / np.linalg.norm(wanted))


def local_rest(robot: Robot, task: InertiaTask, contacts, q, seconds: float = 20.0):
    """Return the configuration where the QP comes to rest from ``q``."""
    controller = KinematicController(robot, [task], contacts=contacts, limits=Limits(robot))
    for now in closed_loop(controller, q, round(seconds / controller.dt)):
        if now.speed < 1e-5:
            break
    return now.q


def cpu_seconds() -> float:
    """Return the CPU time of this process and of those it has waited for."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


def measure(target: Target, options: argparse.Namespace, pool) -> dict[str, object]:
    """Return the figures of one target."""
    robot = Robot.load(target.robot)
    q = robot.posture()
    mode = target.mode
    task = InertiaTask(robot, target.inertia, frame=axes(mode), second_order=True, gain=0.3)
    contacts = support(robot.snapshot(q), mode)
    start_cost = 0.5 * task.gain * float(np.sum(task.residual(robot.snapshot(q)).error ** 2))
    wall, cpu = perf_counter(), cpu_seconds()
    shaping = GlobalShaping(robot, [task], contacts)
    outcome = shaping.solve(q, options.starts, workers=options.workers, patience=options.patience)
    wall, cpu = perf_counter() - wall, cpu_seconds() - cpu
    motion: ShapingMotion = shaping.reach(q, outcome)
    theirs = scipy_figures(target, options, pool)
    ours = outcome.best.cost / start_cost
    return {
        "cost": ours,
        **theirs,
        "good": ours <= WITHIN * theirs["scipy_cost"] + MET,
        "wall": wall,
        "cpu": cpu,
        "faster": wall < theirs["scipy_wall"],
        "cheaper": cpu < theirs["scipy_cpu"],
        "searched": outcome.statistics.searched,
        "error_start": relative_error(task, robot, q),
        "error_local": relative_error(task, robot, local_rest(robot, task, contacts, q)),
        "error_global": relative_error(task, robot, motion.q[-1]),
        "arrived": motion.arrived,
        "attempts": [asdict(attempt) for attempt in motion.attempts],
        "slip": motion.kept.contact,
        "limit": motion.kept.limit,
        "candidates": len(outcome.candidates),
        "rejected": len(outcome.rejected),
    }


HEAD = (
    f"{'':26s}{'cost':>10s}{'SciPy':>10s}{'s':>7s}{'CPU s':>7s}{'SciPy s':>8s}{'CPU s':>8s}"
    f"{'starts':>7s}  relative error"
)


def line(row: dict) -> str:
    """Return the figures of one target as a line."""
    label = f"{row['robot']} {row['mode']} {row['shape']}"
    return (
        f"{label:26s}{row['cost']:10.3e}{row['scipy_cost']:10.3e}{row['wall']:7.2f}"
        f"{row['cpu']:7.2f}{row['scipy_wall']:8.2f}{row['scipy_cpu']:8.2f}{row['searched']:7d}"
        f"  {row['error_start']:.3f} local"
        f" {row['error_local']:.3f} global {row['error_global']:.3f}"
        f"{'' if row['good'] else '  WORSE'}{'' if row['faster'] else '  SLOWER'}"
        f"{'' if row['cheaper'] else '  DEARER'}"
        f"{'' if row['arrived'] else '  NOT REACHED'}"
    )


def tally(what: str, rows: list[dict]) -> str:
    """Return the numbers of targets by result, and the total times."""
    counts = (f"{sum(bool(row[key]) for row in rows)} {key}" for key in GOALS)
    keys = ("wall", "scipy_wall", "cpu", "scipy_cpu")
    wall, their_wall, cpu, their_cpu = (sum(row[key] for row in rows) for key in keys)
    return (
        f"{what}: of {len(rows)} targets {', '.join(counts)}; {wall:.0f} s, SciPy {their_wall:.0f}"
        f" s; CPU {cpu:.0f} s, SciPy {their_cpu:.0f} s"
    )


def resumed_rows(options: argparse.Namespace) -> list[dict]:
    """Return the results written by an earlier run with the same settings."""
    if options.output is None or not options.output.exists():
        return []
    earlier = json.loads(options.output.read_text())
    if earlier["settings"] != settings(options):
        raise SystemExit(f"{options.output}: was made with other settings: {earlier['settings']}")
    return earlier["rows"]


def settings(options: argparse.Namespace) -> dict[str, int]:
    keys = ("starts", "patience", "scipy_starts", "workers", "seed")
    return {key: getattr(options, key) for key in keys}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--targets", type=int, default=20)
    parser.add_argument("--starts", type=int, default=400)
    parser.add_argument("--patience", type=int, default=80)
    parser.add_argument("--scipy-starts", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, help="JSON, written after every target; resumed")
    parser.add_argument("--scipy-from", type=Path, nargs="+", default=[], help="earlier outputs")
    options = parser.parse_args()
    rows = resumed_rows(options)
    known = [{field.name: row[field.name] for field in fields(Target)} for row in rows]
    context = multiprocessing.get_context("spawn")
    print(HEAD, flush=True)
    with context.Pool(options.workers) as pool:
        for name in options.robots:
            for target in targets(name, options.targets, options.seed):
                if target_entry(target) in known:
                    continue
                rows.append({**target_entry(target), **measure(target, options, pool)})
                print(line(rows[-1]), flush=True)
                if options.output:
                    written = json.dumps({"settings": settings(options), "rows": rows}, indent=2)
                    options.output.write_text(written)
            print(tally(name, [row for row in rows if row["robot"] == name]), flush=True)
    print(tally("all", rows))


if __name__ == "__main__":
    main()
