"""The largest push towards a wall that a standing robot survives, with and without a hand on it.

Measured as by `wbc push`: noise, a delay of 2 ms and masses wrong by up to 10 %, by the seed; a
push of 0.1 s at the pelvis, growing by 0.1 M omega d; the limit is the largest up to which all were
survived. Without the hand twice: without the wall, and next to it, where touching it is a fall (as
for any link but hands and forearms). For the first push that is not survived with the hand: the
reason, and the motors at their bounds from the reach on. Settings were tuned on seeds 0, 1, 10 and
20.

    python benchmarks/wall.py [--seeds 30 31] [--distances 0.5] [--output FILE]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import NOISE, mass_of

from wbc.problem import load_problem
from wbc.problem.problem import Problem
from wbc.problem.pushed_problem import PushedProblem, PushSettings
from wbc.simulation import FallLimits, SimulationError, simulate

ROOT = Path(__file__).parents[1]
PROBLEM = ROOT / "problems" / "wall_g1.yaml"
TOWARDS = 0.5 * np.pi  # rad
FIRST, STEP, MOST = 1.0, 0.1, 4.0  # M omega d
SETTINGS = PushSettings(at=0.2)
VARIANTS = {"no wall": (False, False), "wall": (True, False), "wall and hand": (True, True)}
DURATION = 3.0  # s
BINDING = 4  # motors that are named


@dataclass(frozen=True)
class Limit:
    """The largest push survived by one variant."""

    variant: str
    distance: float  # of the wall from the middle of the robot [m]
    seed: int
    ratio: float  # in M omega d; 0: not the first of the grid
    impulse: float  # N s
    ends: str  # result of the next one


def problem_of(
    distance: float, seed: int, wall: bool, hand: bool, more: Mapping[str, Any]
) -> Problem:
    """Return the shipped problem with the wall at a distance [m], and the disturbances of a seed.

    ``more`` replaces other values of the file, by key path.
    """
    plate = {"point": [0.0, distance, 0.9], "normal": [0, -1, 0], "size": [1.6, 1.8]}
    values: dict[str, Any] = {
        "simulation.terrain.walls": [plate | {"friction": 0.8}] if wall else [],
        "simulation.sensors": NOISE | {"seed": seed},
        "simulation.model_error": {"mass": mass_of(seed)},
        "simulation.duration": DURATION,
        **more,
    }
    if not hand:
        values = {k: v for k, v in values.items() if not k.startswith("hands")} | {"hands": None}
    found = load_problem(PROBLEM, values)
    assert isinstance(found, Problem)
    return found


def limit_of(problem: Problem, variant: str, distance: float, seed: int) -> Limit:
    """Return the largest push up to which all of the grid were survived."""
    pushed = PushedProblem(problem, SETTINGS)
    survived, ends = 0.0, ""
    for ratio in np.arange(FIRST, MOST, STEP).round(6).tolist():
        outcome = pushed(TOWARDS, ratio)
        if not outcome.survived:
            ends = outcome.reason
            break
        survived = ratio
    return Limit(variant, distance, seed, survived, survived * pushed.unit(TOWARDS), ends)


def traced(problem: Problem, ratio: float) -> dict[str, Any]:
    """Return the hands' events under a push, their force, and the motors at their bounds."""
    plant, falls = problem.plant(), FallLimits(**problem.spec.simulation.falls)
    unit = PushedProblem(problem, SETTINGS).unit(TOWARDS)
    plant.pushes = []
    plant.push(
        SETTINGS.body, (0.0, ratio * unit / SETTINGS.duration, 0.0), "com",
        start=SETTINGS.at, duration=SETTINGS.duration,
    )  # fmt: skip
    led = problem.supervisor(plant)
    bound, ticks, most, sum_of = Counter[str](), 0, 0.0, 0.0
    try:
        for now in simulate(led.controller, plant, 2.0, update=led.update, falls=falls):
            forces = [plant.contacts.force_at(hand.frame) for hand in plant.hands]
            push = max((float(np.linalg.norm(force)) for force in forces), default=0.0)
            most, sum_of = max(most, push), sum_of + push * plant.dt
            if led.notes:
                ticks += 1
                bound.update(name for name in now.tick.active if name.endswith(" torque"))
    except SimulationError as error:
        print("the physics blew up:", error)
    motors = {name: round(count / ticks, 3) for name, count in bound.most_common(BINDING)}
    return {"ratio": ratio, "notes": list(led.notes), "largest force on hand [N]": round(most, 1),
            "impulse by hand [N s]": round(sum_of, 2), "at bound": motors}  # fmt: skip


def summary(limits: Sequence[Limit]) -> dict[str, Any]:
    """Return the hand's gain: impulses relative to those of the same seed without it."""
    by = {(one.variant, one.distance, one.seed): one.impulse for one in limits}
    found: dict[str, Any] = {}
    for other in list(VARIANTS)[:2]:
        gains = [
            impulse / by[other, distance, seed]
            for (variant, distance, seed), impulse in by.items()
            if variant == "wall and hand" and by.get((other, distance, seed), 0.0) > 0.0
        ]
        if gains:
            means = round(float(np.mean(gains)), 3), round(min(gains), 3)
            found[f"by that with {other}"] = dict(zip(("mean", "least"), means, strict=True))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[30, 31])
    parser.add_argument("--distances", type=float, nargs="+", default=[0.5])
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=list(VARIANTS))
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=NUMBER", dest="more")
    parser.add_argument("--output", type=Path, help="write the figures as JSON")
    options = parser.parse_args()
    more = {key: float(value) for key, value in (one.split("=") for one in options.more)}
    limits, traces, known = list[Limit](), list[dict[str, Any]](), dict[int, Limit]()

    def write() -> None:
        told = {"limits": [vars(one) for one in limits], "traces": traces, "hand": summary(limits)}
        if options.output:
            options.output.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")

    for distance in options.distances:
        for seed in options.seeds:
            for variant in options.variants:
                wall, hand = VARIANTS[variant]
                problem = problem_of(distance, seed, wall, hand, more)
                if wall or seed not in known:
                    one = limit_of(problem, variant, distance, seed)
                else:  # no distance without a wall
                    one = Limit(**known[seed].__dict__ | {"distance": distance})
                known.setdefault(seed, one) if not wall else None
                limits.append(one)
                print(
                    f"{variant:14} {distance:.2f} m, seed {seed}: {one.ratio:.1f} M omega d,"
                    f" {one.impulse:.1f} N s; then {one.ends}",
                    flush=True,
                )
                if hand:
                    for ratio in (one.ratio, one.ratio + STEP):
                        trace = traced(problem, round(ratio, 6))
                        traces.append({"distance": distance, "seed": seed, **trace})
                        print("   ", trace, flush=True)
            write()
    print(summary(limits))


if __name__ == "__main__":
    main()
