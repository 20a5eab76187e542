"""What a walking robot uses to recover from a push: angular momentum, and motors at their bounds.

A robot walks, is pushed as in walk_pushes.py, and walks on without a push in a second copy of its
process. Reported from the start of the push on:

momentum     the part of the push absorbed by angular momentum about the CoM: with kappa =
             (k_y, -k_x)/(M h) along it, above that of the walk without a push, the
             integral of exp(-omega t) kappa dt over the DCM's displacement per newton second [N s];
turn         its integral, by the locked inertia about that axis: largest and final [rad];
motors       those at their bounds, with their share of the ticks, in the first and second step;
landed       the distance of each landed foot from its footstep [m].

    python benchmarks/walk_spent.py [benchmarks/walk_spent.json] [--robot g1] [--seed 100]
        [--sides back right front left] [--phases 0] [--impulses back=45 right=30 ...]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import DELAY, DT
from walk_pushes import AFTER, BEFORE, PHASES, SIDES, SPEED, PushedWalk, run_in_copy

from wbc.gait import Walker
from wbc.gait.dcm import in_plane
from wbc.gait.footsteps import other
from wbc.gait.phases import SingleSupport
from wbc.gait.whole_body import heaviest_link
from wbc.simulation import SimulationError

FILE = Path(__file__).with_suffix(".json")
IMPULSES = {"back": 45.0, "right": 31.5, "front": 78.0, "left": 54.0}  # N s
WINDOW = 0.8  # s, over which momentum counts
OFTEN = 0.1  # share of a step's ticks from which on a motor is reported
STEPS = 2


def simulate_push(walk: PushedWalk, angle: float, impulse: float) -> dict[str, Any]:
    """Push, continue, and return kappa tick by tick [m/s] and the limiting factors of each step."""
    begin, first, walker = walk.plant.time, walk.walker.steps, walk.walker
    way = walk.push(angle, impulse)
    scale = walk.robot.mass * walker.gait.height
    kappa, held = list[float](), [Counter[str]() for _ in range(STEPS)]
    ticks, landed, aim, stood = [0] * STEPS, list[float](), None, True
    try:
        for now in walk.ticks:
            step, stood = walker.steps - first, now.verdict.stood
            here = walk.robot.snapshot(*now.state)
            if walk.plant.time - begin <= WINDOW:
                kx, ky = here.momentum[3:5] / scale
                kappa.append(float(ky * way[0] - kx * way[1]))
            if aim is not None and step > aim[0] and aim[0] < STEPS:
                place = in_plane(here.position(walk.robot.feet[aim[1]].frame))
                landed.append(round(abs(place - aim[2]), 3))
            phase = walker.phase
            aim = None
            if isinstance(phase, SingleSupport):
                aim = step, other(phase.support), phase.goal
            if step < STEPS:
                ticks[step] += 1
                held[step].update(name for name in now.tick.active if name.endswith(" torque"))
            if not stood or walker.steps >= BEFORE + AFTER:
                break
    except SimulationError:
        stood = False
    motors = [
        {
            name.removesuffix(" torque"): round(k / n, 2)
            for name, k in one.most_common()
            if k > OFTEN * n
        }
        for one, n in zip(held, ticks, strict=True)
    ]
    return {"stood": stood, "kappa": kappa, "motors": motors, "landed": landed}


def push_report(walk: PushedWalk, side: str, impulse: float) -> dict[str, Any]:
    """Return the report of a push that begins now, as plain data."""
    runs = (partial(simulate_push, walk, SIDES[side], J) for J in (0.0, impulse))
    free, pushed = map(run_in_copy, runs)
    count = min(len(free["kappa"]), len(pushed["kappa"]))
    more = np.array(pushed["kappa"][:count]) - free["kappa"][:count]
    start, gait = walk.robot.snapshot(walk.robot.posture("standing")), walk.walker.gait
    above = float((start.position(heaviest_link(walk.robot)) - start.com)[2])
    shove = (1.0 + above / gait.height) / (walk.robot.mass * gait.omega)
    time = DT * np.arange(1, count + 1)
    worth = float(np.sum(np.exp(-gait.omega * time) * more) * DT / shove)
    axis = 1 if side in ("back", "front") else 0
    turned = np.cumsum(more) * DT * walk.robot.mass * gait.height / start.inertia[axis, axis]
    return {
        "side": side,
        "impulse": impulse,
        "stood": pushed["stood"],
        "momentum": round(worth, 2),
        "turn": [round(float(turned.max()), 3), round(float(turned[-1]), 3)],
        "motors": pushed["motors"],
        "landed": pushed["landed"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, nargs="?", default=FILE)
    parser.add_argument("--robot", default="g1", choices=list(SPEED))
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--sides", nargs="+", default=list(SIDES), choices=list(SIDES))
    parser.add_argument("--phases", type=int, nargs="+", default=[0])
    parser.add_argument("--impulses", nargs="+", default=[], help="side=N s")
    given = parser.parse_args()
    impulses = IMPULSES | {s: float(j) for s, j in (one.split("=") for one in given.impulses)}
    walk = PushedWalk(given.robot, given.seed, DELAY, Walker)
    walk.until(lambda: walk.walker.steps >= BEFORE)
    begin, step = walk.plant.time, walk.walker.gait.times.total
    rows = []
    for phase in sorted(given.phases):
        at = begin + phase / PHASES * step
        walk.until(lambda at=at: walk.plant.time >= at - 1e-9)
        for side in given.sides:
            rows.append({"phase": phase, **push_report(walk, side, impulses[side])})
            print(json.dumps(rows[-1]), flush=True)
    made_of = {"robot": given.robot, "seed": given.seed, "window": WINDOW}
    given.file.write_text(json.dumps({**made_of, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
