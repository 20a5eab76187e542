"""The largest impulse that a walk survives: from four sides, at four phases of the step.

A robot walks ahead and is pushed at its trunk for 0.2 s. It walks once for each seed. At each phase
its process is copied (``fork``) for each trial push, so that all pushes begin from the same state.
The largest impulse survived is searched on a grid. Every trial has sensor noise of 1e-3 rad and
0.05 rad/s, delay, and masses wrong by up to 10 %, by the seed.

    python benchmarks/walk_pushes.py [benchmarks/results/walk_pushes.jsonl] [--robot g1]
        [--seeds 0 1 2] [--sides back right front left] [--phases 0 1 2 3] [--grid 1.5]
        [--delay 0.002 [--late] [--known]]

Each side, phase and seed is a line of the journal, with the code that it was measured with, and is
not run twice. A journal of other settings or other code is refused.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
import math
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import ARMATURE, DELAY, DT, plant_of, robot_named
from sources import code_of

from wbc.controllers import Controller
from wbc.gait import Walker
from wbc.gait.whole_body import heaviest_link
from wbc.journal import Journal
from wbc.robot import Snapshot
from wbc.simulation import Plant, SimulationError, Terrain, simulate
from wbc.validate import Array

JOURNAL = Path(__file__).parent / "results" / "walk_pushes.jsonl"
# Where a push comes from, and where its force points to: degrees, from ahead to the left.
SIDES = {"back": 0.0, "right": 90.0, "front": 180.0, "left": 270.0}
PHASES = 4
SPEED = {"g1": 0.5, "talos": 0.4}  # m/s
BEFORE, AFTER, LASTING = 6, 8, 0.2  # steps before the push, and after it; s
GUESS = {"g1": 45.0, "talos": 105.0}  # where a search begins [N s]
LONGEST = 30.0  # s


class PushedWalk:
    """One walk, in simulated time; copies of its process continue with a push each."""

    def __init__(
        self,
        robot: str,
        seed: int,
        delay: float,
        make: Callable[..., Walker],
        late: bool = False,
        known: bool = False,
    ) -> None:
        self.robot = robot_named(robot)
        self.plant: Plant = plant_of(
            self.robot, seed, Terrain(), self.robot.posture("standing"), delay=delay
        )
        self.walker = make(self.robot, dt=DT, delay=delay if known else 0.0)
        self.felt = deque[dict[str, Array]](maxlen=1 + (round(delay / DT) if late else 0))
        self.speed, self.name = SPEED[robot], robot
        self.ticks = simulate(self.walker.controller, self.plant, LONGEST, update=self._lead)
        self.steps = BEFORE + AFTER
        self.verdict = True, ""

    def _lead(self, tick: int, snapshot: Snapshot) -> Controller | None:
        if self.walker.steps >= self.steps:
            return None
        if self.plant.time >= 0.2 and self.walker.wanted.at_rest:
            self.walker.command(self.speed)
        self.felt.append(self.plant.contact_forces)
        return self.walker.prepare(snapshot, self.felt[0])

    def until(self, over: Callable[[], bool]) -> bool:
        """Continue until then, or the last step; return whether the robot stands."""
        try:
            while not over():
                now = next(self.ticks, None)
                if now is None:
                    return self.walker.steps >= self.steps
                if not now.verdict.stood:
                    return False
        except SimulationError:
            return False
        return True

    def push(self, angle: float, impulse: float) -> Array:
        """Push now, at this angle from ahead to the left [deg, N s]; return its direction."""
        a = math.radians(angle)
        way = np.array((math.cos(a), math.sin(a), 0.0))
        self.plant.push(heaviest_link(self.robot), impulse / LASTING * way, duration=LASTING)
        return way

    def survives(self, angle: float, impulse: float) -> bool:
        """Return whether a copy of this walk survives a push that begins now."""

        def stands() -> bool:
            self.push(angle, impulse)
            return self.until(lambda: False)

        return bool(run_in_copy(stands))


def run_in_copy(call: Callable[[], Any]) -> Any:
    """Return the result, as plain data, of a function called in a copy of this process."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            with os.fdopen(writer, "w") as pipe:
                json.dump(call(), pipe)
            status = 0
        except BaseException:
            traceback.print_exc()
        os._exit(status)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        told = pipe.read()
    if os.waitpid(child, 0)[1] != 0:
        raise RuntimeError("a pushed walk ended without an answer; see above")
    return json.loads(told)


def largest(survives: Callable[[float], bool], guess: float, grid: float) -> float:
    """Return the largest multiple of ``grid`` that is survived, next to one that is not."""
    least, most, reach = 0, None, 1
    k = max(1, round(guess / grid))
    while most is None or most - least > 1:
        if survives(k * grid):
            least = k
        else:
            most = k
        if most is None:
            k, reach = k + reach, 2 * reach
        elif least == 0:
            k, reach = max(1, most - reach), 2 * reach
            if most == 1:
                return 0.0
        else:
            k = (least + most) // 2
    return least * grid


def measured(
    given: argparse.Namespace,
    make: Callable[..., Walker],
    known: dict[str, dict[str, Any]],
    guessed: Mapping[str, float] | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield missing rows, seed by seed; searches begin at the guesses."""
    guesses: dict[tuple[str, int], list[float]] = {}
    for row in known.values():
        guesses.setdefault((row["side"], row["phase"]), []).append(row["impulse"])
    for seed in given.seeds:
        keys = {(s, p): f"{seed}/{s}/{p}" for p in given.phases for s in given.sides}
        if all(key in known for key in keys.values()):
            continue
        walk = PushedWalk(given.robot, seed, given.delay, make, given.late, given.known)
        stood = walk.until(lambda walk=walk: walk.walker.steps >= BEFORE)
        begin, step = walk.plant.time, walk.walker.gait.times.total
        for phase in sorted(given.phases):
            at = begin + phase / PHASES * step
            stood = stood and walk.until(lambda at=at, walk=walk: walk.plant.time >= at - 1e-9)
            for side in given.sides:
                if keys[side, phase] in known:
                    continue
                found = guesses.setdefault((side, phase), [])
                guess = float(np.mean(found)) if found else GUESS[given.robot]
                guess = (guessed or {}).get(keys[side, phase], guess)

                def survives(impulse: float, walk: PushedWalk = walk, side: str = side) -> bool:
                    return walk.survives(SIDES[side], impulse)

                impulse = largest(survives, guess, given.grid) if stood else 0.0
                found.append(impulse)
                yield {
                    "key": keys[side, phase],
                    "side": side,
                    "phase": phase,
                    "seed": seed,
                    "impulse": impulse,
                }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the means over seeds, with the least, by side and phase."""
    lines = [f"{'phase':6}" + "".join(f"{side:>22}" for side in SIDES)]
    for phase in sorted({row["phase"] for row in rows}):
        line = f"{phase}/{PHASES}   "
        for side in SIDES:
            found = [r["impulse"] for r in rows if (r["side"], r["phase"]) == (side, phase)]
            told = "-"
            if found:
                told = f"{np.mean(found):.1f} ({min(found):.1f} to {max(found):.1f})"
            line += f"{told:>22}"
        lines.append(line)
    seeds = sorted({row["seed"] for row in rows})
    mean = np.mean([row["impulse"] for row in rows])
    lines.append(f"{mean:.2f} N s on average; seeds {seeds}")
    return "\n".join(lines)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    made.add_argument("journal", type=Path, nargs="?", default=JOURNAL)
    made.add_argument("--robot", default="g1", choices=list(SPEED))
    made.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    made.add_argument("--sides", nargs="+", default=list(SIDES), choices=list(SIDES))
    made.add_argument("--phases", type=int, nargs="+", default=list(range(PHASES)))
    made.add_argument("--grid", type=float, default=1.5)
    made.add_argument("--delay", type=float, default=DELAY, help="of the state measured [s]")
    made.add_argument("--late", action="store_true", help="forces felt are as old, too")
    made.add_argument("--known", action="store_true", help="the walker is told the delay")
    return made


def run(given: argparse.Namespace, make: Callable[..., Walker] = Walker, note: str = "") -> None:
    """Measure what is missing, and print the table."""
    made_of = {
        "robot": given.robot,
        "grid": given.grid,
        "delay": (given.delay, given.late, given.known),
        "push": (SPEED[given.robot], BEFORE, AFTER, LASTING),
        "armature": ARMATURE,
        "code": code_of() + note,
    }
    given.journal.parent.mkdir(parents=True, exist_ok=True)
    with Journal(given.journal, made_of) as journal:
        known = {row["key"]: row for row in journal.entries}
        for row in measured(given, make, dict(known)):
            journal.add(row)
            known[row["key"]] = row
            print(json.dumps(row), flush=True)
    print(table(list(known.values())))


if __name__ == "__main__":
    run(parser().parse_args())
