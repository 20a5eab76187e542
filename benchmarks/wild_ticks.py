"""Wild ticks of both levels and every backend, each checked by independent solvers.

States far from a stance, fast joints, feet with wrong anchors, a second anchor for a foot, motors
too weak for the stance; self-collision at the velocity level. Every answer is a claim, which is
checked:

- solved: no row is violated, and the optimum of Clarabel (active-set, if the backend is Clarabel)
  costs no less;
- conflict: by HiGHS, the named rows cannot all hold, and can without any one of them;
- infeasible, with no rows named: by HiGHS, all rows together cannot hold;
- relaxed (torques): a conflict was named, which is checked; or a deadline was over, and there is no
  conflict; else it is relaxed without a certificate, and HiGHS says whether relaxing was necessary;
- failed: no answer and no certificate; HiGHS says whether there is a solution.

    python benchmarks/wild_ticks.py [--ticks 10000] [--levels velocity torque]
        [--backends proxqp ...] [--robots g1 ...] [--seed 1] [--output benchmarks/RESULTS.md]

A wrong claim gives exit code 1.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import logging
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from conflict_judge import conflict_error, worst_miss
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table

import wbc
from wbc.qp import QP, Status, make_backend

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")
BACKENDS = ("proxqp", "active_set", "daqp", "clarabel", "piqp", "osqp")
LEVELS = {"velocity": wbc.KinematicController, "torque": wbc.TorqueController}
EPISODE = 5  # ticks of one controller
MISSED = 1e-9  # by rows of unit length [m/s, rad/s]: less can be met
COSTS = 1e-5  # of an optimum, relative: what solvers leave at residuals of 1e-6
LEAVES = 1e-5  # of a row, relative to it: the residual that a backend may leave
CLAIMS = (
    "solved", "conflict named", "infeasible", "relaxed: certificate", "relaxed: none", "failed",
)  # fmt: skip


def episode(
    robot: wbc.Robot, level: str, backend: str, rng: np.random.Generator
) -> Iterator[tuple]:
    """Yield ticks of one controller, with their inputs."""
    start = robot.snapshot(robot.posture("standing"))
    spread = 10.0 ** rng.uniform(-3.0, -0.5)
    here = perturbed_state(robot, start, spread, rng)
    feet = list(wbc.support(start if rng.random() < 0.5 else here, "double"))
    if rng.random() < 0.2:  # a second anchor for a foot
        frame = next(iter(robot.feet.values())).link
        away = here.position(frame) + 0.05 * rng.normal(size=3)
        feet.append(wbc.Contact(robot, frame, away, here.rotation(frame), friction=None))
    tasks = [
        wbc.ComTask(robot, here.com + 0.1 * rng.normal(size=3), weight=10.0),
        wbc.InertiaTask(robot, 1.5 * here.inertia_in("base"), frame="base", per_mass=True),
        wbc.PostureTask(robot, start.q, weight=0.1),
    ]
    options = {"torque_limits": 10.0 ** rng.uniform(-1.0, 0.0)} if level == "torque" else {}
    apart = (
        level == "velocity" and rng.random() < 0.3
    )  # a relaxed tick does not tell its margins' rows
    margins = [wbc.SelfCollision(robot, margin=0.01)] if apart else []
    controller = LEVELS[level](
        robot, tasks, contacts=feet, limits=wbc.Limits(robot), constraints=margins,
        solver=backend, **options,
    )  # fmt: skip
    for _ in range(EPISODE):
        snapshot = perturbed_state(robot, here, 0.1 * spread, rng)
        yield controller, snapshot, controller.step(snapshot)


def perturbed_state(robot: wbc.Robot, here: wbc.Snapshot, size: float, rng: np.random.Generator):
    """Return a state far from another one, at any speed."""
    away = np.concatenate((0.1 * size * rng.normal(size=6), size * rng.normal(size=robot.nv - 6)))
    q = robot.integrate(here.q, away, 1.0)
    return robot.snapshot(q, 10.0 ** rng.uniform(-2.0, 0.3) * rng.normal(size=robot.nv))


def largest_violation(qp: QP, x: np.ndarray) -> float:
    """Return the largest violation of a row, relative to the row's bound where above 1."""
    rows = np.concatenate((qp.A, qp.C, np.eye(qp.g.size))) @ x
    lower = np.concatenate((qp.b, qp.l, qp.lower))
    upper = np.concatenate((qp.b, qp.u, qp.upper))
    below = (lower - rows) / np.maximum(1.0, np.abs(np.where(np.isfinite(lower), lower, 1.0)))
    above = (rows - upper) / np.maximum(1.0, np.abs(np.where(np.isfinite(upper), upper, 1.0)))
    return float(max(below.max(), above.max(), 0.0))


def excess_cost(qp: QP, x: np.ndarray, backend: str) -> float | None:
    """Return the excess cost over another solver's optimum; None if that solver has none."""
    judge = make_backend("active_set" if backend == "clarabel" else "clarabel").solve(qp)
    if not judge.solved:
        return None
    cost, best = (0.5 * at @ qp.P @ at + qp.g @ at for at in (x, judge.x))
    return float((cost - best) / max(1.0, abs(best)))


def check_claim(controller: wbc.Controller, snapshot: wbc.Snapshot, tick: wbc.Tick, backend: str):
    """Return the claim of a tick, and its error if it is wrong."""
    if tick.ok and tick.policy is None:
        qp = tick.qp
        if (far := largest_violation(qp, tick.solution.x)) > LEAVES:
            return "solved", f"misses a row by {far:.1e}"
        more = excess_cost(qp, tick.solution.x, backend)
        if more is None:
            return "solved", ""  # unknown to the other solver; no row is violated
        return "solved", f"costs {more:.1e} more" if more > COSTS else ""
    hard = (
        tick.qp if tick.policy != "relax" else controller.core.tick(snapshot, solve=False).qp_of(0)
    )
    refuted = getattr(tick, "refuted", None)
    if tick.conflict is not None:
        claim = "conflict named" if refuted is None else "relaxed: certificate"
        return claim, "; ".join(conflict_error(hard, tick.conflict)[:1])
    if tick.status is Status.INFEASIBLE or (refuted and refuted.status is Status.INFEASIBLE):
        return "infeasible", "" if worst_miss(hard) > MISSED else "it can be met"
    claim = "relaxed: none" if tick.policy == "relax" else "failed"
    return claim, "it could all be kept" if worst_miss(hard) <= MISSED else "needlessly unproved"


def measured(level: str, backend: str, robots: list[wbc.Robot], ticks: int, seed: int):
    """Return counts of claims and of wrong ones, with examples."""
    claims, wrong, examples = Counter[str](), Counter[str](), list[str]()
    while sum(claims.values()) < ticks:
        number = sum(claims.values())
        robot = robots[number // EPISODE % len(robots)]
        rng = np.random.default_rng([seed, number, len(level), BACKENDS.index(backend)])
        for k, (controller, snapshot, tick) in enumerate(episode(robot, level, backend, rng)):
            claim, fault = check_claim(controller, snapshot, tick, backend)
            claims[claim] += 1
            if fault:
                wrong[claim] += 1
                examples.append(
                    f"{level}, {backend}, {robot.name}, tick {number + k}: {claim}: {fault}"
                )
    return claims, wrong, examples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=10_000, help="of each level and backend")
    parser.add_argument("--levels", nargs="+", default=list(LEVELS), choices=LEVELS)
    parser.add_argument("--backends", nargs="+", default=list(BACKENDS), choices=BACKENDS)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # backends say at which level they are weak
    robots = [wbc.Robot.load(name) for name in options.robots]
    rows, every, faults = [], list[str](), 0
    for level in options.levels:
        for backend in options.backends:
            found = measured(level, backend, robots, options.ticks, options.seed)
            claims, wrong, examples = found
            cells = [
                f"{claims[one]} ({wrong[one]} wrong)" if wrong[one] else str(claims[one])
                for one in CLAIMS
            ]
            rows.append((level, backend, *cells))
            faults += sum(wrong.values())
            every += examples[:3]
            print(" | ".join(rows[-1]), flush=True)
            for line in examples[:3]:
                print(f"    {line}", flush=True)
    title = f"{options.ticks} wild ticks of each level and backend, seed {options.seed}: what was"
    table = Table(f"{title} claimed, and how often wrongly", ("level", "backend", *CLAIMS), rows)
    if options.output is not None:
        command = f"Command: python {' '.join(sys.argv)}\n\n{machine()}"
        notes = "\n".join(f"- {line}" for line in every)
        put_section(options.output, "wild", f"{command}\n\n{table.markdown()}\n\n{notes}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
