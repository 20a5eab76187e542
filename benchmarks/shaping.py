"""Global inertia shaping against many independent L-BFGS-B searches, and against the local QP.

Targets are random but sensible: the standing robot's moments made tall and thin, flat, large or
small, by turns in base axes while floating, and in world axes on both feet. SciPy gets exact
gradients from the snapshot's Jacobians; on two feet its searches are augmented Lagrangians in the
joints, the left sole being the root. Both sides use the same number of processes; SciPy's are
started before its clock is.

For each target: the cost found by either side, wall time and CPU time of all processes, the
relative error |I - target| / |target| at the start, where the local QP comes to rest, and at the
end of the global motion, and whether that motion keeps every constraint.

    python benchmarks/shaping.py [--robots g1 icub] [--targets 20] [--scipy-starts 200]

On two cores 200 L-BFGS-B searches take 2 to 30 s for a floating target and 1 to 3 minutes for one
on both feet, the global search 0.4 to 4 s; all 100 targets take about two hours. Each target is a
line as soon as it is measured; with --output it is also written then, and the same command goes on
where it was stopped:

    nohup python benchmarks/shaping.py --output shaping.json > shaping.txt &

For a look:

    python benchmarks/shaping.py --robots hoap2_like g1 --targets 4 --scipy-starts 50
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import multiprocessing
import resource
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.optimize import minimize

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.shaping import GlobalShaping, Motion
from wbc.robot import Robot
from wbc.robot.lie import log_rotation
from wbc.spatial import FROBENIUS_WEIGHTS, strung
from wbc.tasks import InertiaTask

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")
SHAPES = {  # factors on (xx, yy) and zz of the standing robot
    "tall": ((1.1, 1.6), (0.3, 0.7)),
    "flat": ((0.5, 0.8), (1.3, 2.2)),
    "large": ((1.2, 1.6), (1.2, 2.2)),
    "small": ((0.4, 0.8), (0.5, 0.8)),
}
WITHIN = 1.01  # of SciPy's best cost
MET = 1e-8  # of the cost at the start: both have met the target
GOALS = ("good", "faster", "arrived")


@dataclass(frozen=True)
class Target:
    """One problem: a robot, a wanted inertia (6,), and where it is wanted."""

    robot: str
    shape: str
    mode: str  # "floating" (base axes) or "double" (world axes)
    inertia: tuple[float, ...]


def targets(name: str, count: int, seed: int) -> list[Target]:
    """Return targets of a robot, shapes and modes by turns."""
    robot, rng = Robot.load(name), np.random.default_rng(seed)
    moments = np.diag(robot.snapshot(robot.posture()).inertia_in("base"))
    found = []
    for k in range(count):
        shape = list(SHAPES)[k % len(SHAPES)]
        across, upright = SHAPES[shape]
        wanted = moments * (*rng.uniform(*across, 2), rng.uniform(*upright))
        wanted[2] = min(wanted[2], 0.95 * (wanted[0] + wanted[1]))  # no body has more
        mode = ("floating", "double")[(k // len(SHAPES)) % 2]
        found.append(Target(name, shape, mode, tuple(strung(np.diag(wanted)).tolist())))
    return found


def axes(mode: str) -> str:
    return "base" if mode == "floating" else "world"


# ---------------------------------------------------------------------------------------- SciPy


class Search:
    """The cost of a target and its gradient by the joints, from snapshots; L-BFGS-B over them."""

    def __init__(self, target: Target) -> None:
        self.robot = Robot.load(target.robot)
        self.mode, self.wanted = target.mode, np.array(target.inertia)
        self.q = self.robot.posture()
        here = self.robot.snapshot(self.q)
        self.soles = [self.robot.feet[foot].frame for foot in ("left", "right")]
        self.anchors = [(here.position(f).copy(), here.rotation(f).copy()) for f in self.soles]
        self.scale = self.squared(here)
        limits = self.robot.limits
        self.lower = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
        self.upper = np.where(np.isfinite(limits.upper), limits.upper, np.pi)

    def squared(self, here) -> float:
        error = strung(here.inertia_in(axes(self.mode))) - self.wanted
        return float(FROBENIUS_WEIGHTS @ error**2)

    def snapshot(self, joints):
        """Return the snapshot; on two feet with the left sole where it was."""
        q = np.concatenate((self.q[:7], joints))
        if self.mode == "floating":
            return self.robot.snapshot(q)
        here = self.robot.snapshot(q)
        position, rotation = self.anchors[0]
        step = np.zeros(self.robot.nv)
        turn = rotation @ here.rotation(self.soles[0]).T
        R = here.rotation("base")
        step[3:6] = log_rotation(R.T @ turn @ R)
        q = self.robot.integrate(q, step, 1.0)
        moved = self.robot.snapshot(q)
        q[:3] += position - moved.position(self.soles[0])
        return self.robot.snapshot(q)

    def value(self, joints, multipliers, stiffness):
        """Return cost and gradient, with the other foot's closure as an augmented Lagrangian."""
        here = self.snapshot(joints)
        error = strung(here.inertia_in(axes(self.mode))) - self.wanted
        jacobian = here.inertia_jacobian_in(axes(self.mode))
        cost, slope = 0.5 * FROBENIUS_WEIGHTS @ error**2, FROBENIUS_WEIGHTS * error @ jacobian
        cost, slope = cost / self.scale, slope / self.scale
        if self.mode == "floating":
            return cost, slope[6:]
        gap, rows = self.gap(here)
        pull = multipliers + stiffness * gap
        cost += multipliers @ gap + 0.5 * stiffness * gap @ gap
        slope = slope + pull @ rows
        root = here.jacobian(self.soles[0])
        return cost, slope[6:] - np.linalg.solve(root[:, :6], root[:, 6:]).T @ slope[:6]

    def gap(self, here):
        position, rotation = self.anchors[1]
        R = here.rotation(self.soles[1])
        turn = R @ log_rotation(rotation.T @ R)
        return np.concatenate((here.position(self.soles[1]) - position, turn)), here.jacobian(
            self.soles[1]
        )

    def run(self, seed: int) -> float:
        """Return the cost relative to the start's that one search ends with; inf if not closed."""
        x = np.random.default_rng(seed).uniform(self.lower, self.upper)
        x = self.q[7:] if seed == 0 else x
        multipliers, rounds = np.zeros(6), 1 if self.mode == "floating" else 6
        bounds = list(zip(self.lower, self.upper, strict=True))
        options = {"maxiter": 5000, "maxfun": 20000, "ftol": 1e-12, "gtol": 1e-8}
        found = None
        for k in range(rounds):
            stiffness = 10.0 ** (k + 1)
            found = minimize(
                self.value, x, (multipliers, stiffness), "L-BFGS-B", True,
                bounds=bounds, options=options,
            )  # fmt: skip
            x = found.x
            if self.mode == "double":
                multipliers = multipliers + stiffness * self.gap(self.snapshot(x))[0]
        here = self.snapshot(x)
        closed = self.mode == "floating" or np.abs(self.gap(here)[0]).max() < 1e-5
        return self.squared(here) / self.scale if closed else np.inf


_SEARCHES: dict[Target, Search] = {}


def scipy_search(job: tuple[Target, int]) -> float:
    target, seed = job
    if target not in _SEARCHES:
        _SEARCHES[target] = Search(target)
    return _SEARCHES[target].run(seed)


# --------------------------------------------------------------------------------- measurements


def relative_error(task: InertiaTask, robot: Robot, q) -> float:
    error = task.residual(robot.snapshot(q)).error
    wanted = np.sqrt(FROBENIUS_WEIGHTS) * task.target
    return float(np.linalg.norm(error) / np.linalg.norm(wanted))


def local_rest(robot: Robot, task: InertiaTask, contacts, q, seconds: float = 20.0):
    """Return where the QP comes to rest from ``q``."""
    controller = KinematicController(robot, [task], contacts=contacts, limits=Limits(robot))
    v = np.zeros(robot.nv)
    for _ in range(round(seconds / controller.dt)):
        v = controller.step(robot.snapshot(q, v)).velocity
        q = robot.integrate(q, v, controller.dt)
        if np.abs(v).max() < 1e-5:
            break
    return q


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
    outcome = shaping.solve(q, options.starts, workers=options.workers)
    wall, cpu = perf_counter() - wall, cpu_seconds() - cpu
    motion: Motion = shaping.reach(q, outcome)
    jobs = [(target, seed) for seed in range(options.scipy_starts)]
    scipy_wall = perf_counter()
    costs = pool.map(scipy_search, jobs, chunksize=1)
    scipy_wall = perf_counter() - scipy_wall
    ours, theirs = outcome.best.cost / start_cost, min(costs)
    return {
        "cost": ours,
        "scipy_cost": theirs,
        "good": ours <= WITHIN * theirs + MET,
        "wall": wall,
        "cpu": cpu,
        "scipy_wall": scipy_wall,
        "faster": wall < scipy_wall,
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


HEAD = f"{'':26s}{'cost':>10s}{'SciPy':>10s}{'s':>7s}{'CPU s':>7s}{'SciPy s':>8s}  relative error"


def line(row: dict) -> str:
    """Return the figures of one target as a line."""
    label = f"{row['robot']} {row['mode']} {row['shape']}"
    return (
        f"{label:26s}{row['cost']:10.3e}{row['scipy_cost']:10.3e}{row['wall']:7.2f}"
        f"{row['cpu']:7.2f}{row['scipy_wall']:8.2f}  {row['error_start']:.3f} local"
        f" {row['error_local']:.3f} global {row['error_global']:.3f}"
        f"{'' if row['good'] else '  WORSE'}{'' if row['faster'] else '  SLOWER'}"
        f"{'' if row['arrived'] else '  NOT REACHED'}"
    )


def tally(what: str, rows: list[dict]) -> str:
    """Return how many targets went well, and the times in all."""
    counts = (f"{sum(bool(row[key]) for row in rows)} {key}" for key in GOALS)
    ours, theirs = (sum(row[key] for row in rows) for key in ("wall", "scipy_wall"))
    return f"{what}: of {len(rows)} targets {', '.join(counts)}; {ours:.0f} s, SciPy {theirs:.0f} s"


def resumed(options: argparse.Namespace) -> list[dict]:
    """Return what an earlier run with the same settings has written so far."""
    if options.output is None or not options.output.exists():
        return []
    earlier = json.loads(options.output.read_text())
    if earlier["settings"] != settings(options):
        raise SystemExit(f"{options.output}: was made with other settings: {earlier['settings']}")
    return earlier["rows"]


def settings(options: argparse.Namespace) -> dict[str, int]:
    return {key: getattr(options, key) for key in ("starts", "scipy_starts", "workers", "seed")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--targets", type=int, default=20)
    parser.add_argument("--starts", type=int, default=96)
    parser.add_argument("--scipy-starts", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, help="JSON, written after every target; resumed")
    options = parser.parse_args()
    rows = resumed(options)
    known = [{field.name: row[field.name] for field in fields(Target)} for row in rows]
    context = multiprocessing.get_context("spawn")
    print(HEAD, flush=True)
    with context.Pool(options.workers) as pool:
        for name in options.robots:
            for target in targets(name, options.targets, options.seed):
                described = json.loads(json.dumps(asdict(target)))
                if described in known:
                    continue
                pool.map(scipy_search, [(target, 1)] * options.workers, chunksize=1)  # loads robots
                rows.append({**described, **measure(target, options, pool)})
                print(line(rows[-1]), flush=True)
                if options.output:
                    written = json.dumps({"settings": settings(options), "rows": rows}, indent=2)
                    options.output.write_text(written)
            print(tally(name, [row for row in rows if row["robot"] == name]), flush=True)
    print(tally("all", rows))


if __name__ == "__main__":
    main()
