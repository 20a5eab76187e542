"""Ablation of a pushed walk: momentum, inertia and a firm foot, with theoretical bounds.

The largest impulse survived from four sides at phases of the step, measured as in walk_pushes.py,
by variants of one walker with the same seeds:

free         no task about angular momentum or inertia;
regulated    both to zero and to the start's, as firmly as the CoM (walk_comparison.py);
soft foot    the default, with a third of the weight of the swing foot's height;
planned      the default.

    python benchmarks/walk_ablation.py [benchmarks/walk_ablation.jsonl] [--robot g1]
        [--seeds 100 101] [--phases 0 3] [--grid 3] [--variants free regulated ...]

Each variant, side, phase and seed is a line of the journal, and is not run twice. The table has the
means over seeds and, if its file exists, the bounds of walk_bounds.py for a pendulum.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import ARMATURE, DELAY, DT
from sources import code_of
from walk_bounds import FILE as BOUNDS
from walk_comparison import walker_of
from walk_pushes import AFTER, BEFORE, LASTING, PHASES, SIDES, SPEED, measured

import wbc
from wbc.gait import Walker, WalkingWeights
from wbc.journal import Journal

JOURNAL = Path(__file__).with_suffix(".jsonl")
SOFT = WalkingWeights().lift / 3.0
VARIANTS = ("free", "regulated", "soft foot", "planned")
BASE = "regulated"  # reference of the means


def walker_factory(variant: str) -> Any:
    """Return what makes the walker of a variant for walk_pushes.py."""

    def make(robot: wbc.Robot, dt: float, delay: float) -> Walker:
        if variant == "soft foot":
            return Walker(robot, weights=WalkingWeights(lift=SOFT), dt=DT)
        return walker_of(robot, variant)

    return make


def bounds_of(robot: str, file: Path = BOUNDS) -> dict[str, dict[tuple[str, int], float]]:
    """Return the bounds by name, side and phase [N s]; none if they are another robot's."""
    found: dict[str, dict[tuple[str, int], float]] = {}
    told = json.loads(file.read_text()) if file.exists() else {"robot": None}
    if told["robot"] == robot:
        for row in told["rows"]:
            found.setdefault(row["bound"], {})[row["side"], row["phase"]] = row["impulse"]
    return found


def means(rows: Sequence[dict[str, Any]]) -> dict[str, dict[tuple[str, int], float]]:
    """Return the means over seeds [N s], by variant, side and phase."""
    found: dict[str, dict[tuple[str, int], list[float]]] = {}
    for row in rows:
        one = found.setdefault(row["variant"], {})
        one.setdefault((row["side"], row["phase"]), []).append(row["impulse"])
    return {
        variant: {at: float(np.mean(each)) for at, each in one.items()}
        for variant, one in found.items()
    }


def table(rows: Sequence[dict[str, Any]], bounds: dict[str, dict[tuple[str, int], float]]) -> str:
    """Return a line for each side and phase, and means of those that all variants have."""
    survived = means(rows)
    columns = {**{v: survived[v] for v in VARIANTS if v in survived}, **bounds}
    lines = ["| pushed | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    places = [(side, phase) for phase in range(PHASES) for side in SIDES]
    places = [at for at in places if all(at in survived[v] for v in survived)]
    for side, phase in places:
        told = " | ".join(f"{one.get((side, phase), np.nan):.1f}" for one in columns.values())
        lines.append(f"| {side}, {phase}/{PHASES} | {told} |")
    mean = {name: float(np.mean([one[at] for at in places])) for name, one in columns.items()}
    lines.append("| mean | " + " | ".join(f"{one:.1f}" for one in mean.values()) + " |")
    if BASE in mean and mean[BASE] > 0.0:
        shares = " | ".join(f"{one / mean[BASE]:.2f}" for one in mean.values())
        lines.append(f"| by that of {BASE} | {shares} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("journal", type=Path, nargs="?", default=JOURNAL)
    parser.add_argument("--robot", default="g1", choices=list(SPEED))
    parser.add_argument("--seeds", type=int, nargs="+", default=[100, 101])
    parser.add_argument("--sides", nargs="+", default=list(SIDES), choices=list(SIDES))
    parser.add_argument("--phases", type=int, nargs="+", default=[0, 3])
    parser.add_argument("--grid", type=float, default=3.0)
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=list(VARIANTS))
    given = parser.parse_args()
    given.delay, given.late, given.known = DELAY, False, False
    logging.getLogger("wbc").setLevel(logging.ERROR)  # all walks give the same notes
    made_of = {
        "robot": given.robot,
        "grid": given.grid,
        "push": (SPEED[given.robot], BEFORE, AFTER, LASTING),
        "armature": ARMATURE,
        "code": code_of(),
    }
    with Journal(given.journal, made_of) as journal:
        rows = {row["key"]: row for row in journal.entries}
        for variant in given.variants:
            own = {
                r["trial"]: r | {"key": r["trial"]}
                for r in rows.values()
                if r["variant"] == variant
            }
            guessed = {r["trial"]: r["impulse"] for r in rows.values()}  # of other variants
            for found in measured(given, walker_factory(variant), own, guessed):
                row = found | {"variant": variant, "trial": found["key"]}
                row["key"] = f"{variant}/{found['key']}"
                rows[row["key"]] = row
                journal.add(row)
                print(json.dumps(row), flush=True)
    print(table(list(rows.values()), bounds_of(given.robot)))


if __name__ == "__main__":
    main()
