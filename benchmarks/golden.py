"""A golden file: the answer of every tick, recorded by one code and compared by a later one.

    python benchmarks/golden.py record FILE [--ticks 20000]
    python benchmarks/golden.py compare FILE [--only plain "two priorities"] [--solver NAME]
    python benchmarks/golden.py show FILE EPISODE TICK     # the two answers of one tick

Six robots, both levels, and the categories of golden_categories.py: episodes of random tasks, half
of them out of reach. States are recorded, too: those of a closed loop, with jumps to other states
now and then, so that limits, margins and priorities act. A later code gets the same states,
whatever it answers, and is compared tick by tick; only the memory of an episode's controller (warm
starts, last forces) is its own. If a tick raises, the error's name is compared.

`compare` prints by category: ticks; the largest difference of a velocity [m/s, rad/s] and of a
torque (relative to the largest of that tick, or 1 N m); the same for the optima of the posed QPs
(answers refined at their active sets, since solvers stop short of them); the distance of answers
from these optima, before and now; how many answers are bitwise equal; and how many statuses,
policies and step scales differ. It exits with 1 if a status differs, if an answer differs by more
than the tolerance of its category and the distances from the optima, or if a category's answers are
off by more than ten times what they were, and the tolerance.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: sums in one order

import argparse
import json
import logging
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from golden_categories import CATEGORIES, ROBOTS, draft, thrown
from golden_episodes import Episode, Replay, replayed

import wbc
from wbc.validate import Array

FORMAT = "wbc golden 1"
LENGTH = 25  # ticks of an episode at most
THROWN = 0.15  # chance of a tick to begin somewhere else
FASTEST = 20.0  # m/s, rad/s: beyond, a closed loop is slowed down
NUMBERS = ("q", "v", "velocity", "torque", "exact_velocity", "exact_torque", "step_scale")
WORDS = ("status", "policy")


@cache
def robot_named(name: str) -> wbc.Robot:
    return wbc.Robot.load(name)


def cells() -> list[tuple[str, str, str]]:
    """Robot, category and level of every recorded episode."""
    return [
        (robot, category, level)
        for robot in ROBOTS
        for category, (_, levels, _) in CATEGORIES.items()
        for level in levels
    ]


def recorded(
    robot: wbc.Robot, category: str, level: str, ticks: int, seed: list[int]
) -> tuple[Episode, list[dict[str, Any]]]:
    """Return an episode and the states and answers of its closed loop."""
    rng = np.random.default_rng(seed)
    made = draft(robot, category, level, rng)
    episode = json.loads(json.dumps(made.episode))
    dt, found = episode["options"]["dt"], []
    q, v = thrown(made, made.here.q, np.zeros(robot.nv))
    answers = replayed(Replay(robot, episode), states(found))
    for _ in range(ticks):
        if rng.random() < THROWN:
            q, v = thrown(made, q, v)
        found.append({"q": q, "v": v})
        found[-1] |= next(answers)
        v = found[-1].get("velocity", np.zeros(robot.nv))
        v = v * min(1.0, FASTEST / max(float(np.abs(v).max()), 1e-9))
        q = robot.integrate(q, v, dt)
    return episode, found


def states(found: list[dict[str, Any]]) -> Iterator[tuple[Array, Array]]:
    """Yield the last appended state."""
    while True:
        yield found[-1]["q"], found[-1]["v"]


def record(path: Path, ticks: int, seed: int) -> None:
    """Write a file of at least this many ticks."""
    every = cells()
    share = -(-ticks // len(every))
    parts = -(-share // LENGTH)
    episodes, columns, total = [], {name: [] for name in (*NUMBERS, *WORDS)}, 0
    for cell, (name, category, level) in enumerate(every):
        robot = robot_named(name)
        for part in range(parts):
            length = share // parts + (part < share % parts)
            one, found = recorded(robot, category, level, length, [seed, cell, part])
            episodes.append({**one, "robot": name, "ticks": len(found)})
            total += len(found)
            velocity, torque = np.full(robot.nv, np.nan), np.full(robot.nv - 6, np.nan)
            nothing = {"velocity": velocity, "torque": torque}
            nothing |= {"exact_velocity": velocity, "exact_torque": torque}
            for answer in found:
                for column, values in columns.items():
                    values.append(answer.get(column, nothing.get(column)))
        if level == CATEGORIES[category][1][-1]:
            print(f"{name:12s}{category:18s}{total:7d} ticks", flush=True)
    flat = {n: np.concatenate([np.ravel(one) for one in columns[n]]) for n in NUMBERS}
    words = {n: np.array(columns[n]) for n in WORDS}
    header = np.array(json.dumps({"format": FORMAT, "episodes": episodes}))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        np.savez_compressed(file, header=header, **flat, **words)


@dataclass
class Golden:
    """A loaded file: episodes, and the rows of each one's ticks."""

    episodes: list[Episode]
    rows: list[dict[str, Array]]

    @classmethod
    def read(cls, path: Path) -> "Golden":
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays.pop("header")))
        if header["format"] != FORMAT:
            raise SystemExit(f"{path}: {header['format']!r} is not {FORMAT!r}; record it anew")
        rows, begin = [], dict.fromkeys(arrays, 0)
        for episode in header["episodes"]:
            robot, ticks = robot_named(episode["robot"]), episode["ticks"]
            widths = {"q": robot.nq, "v": robot.nv, "velocity": robot.nv, "torque": robot.nv - 6}
            widths |= {f"exact_{name}": widths[name] for name in ("velocity", "torque")}
            own = {}
            for name, values in arrays.items():
                width = widths.get(name, 1)
                end = begin[name] + ticks * width
                own[name] = values[begin[name] : end].reshape((ticks, width)[: 1 + (width > 1)])
                begin[name] = end
            rows.append(own)
        return cls(header["episodes"], rows)

    def answers(self, k: int, solver: str | None) -> Iterator[dict[str, Any]]:
        """Yield this code's answers in an episode."""
        episode, own = self.episodes[k], self.rows[k]
        replay = Replay(robot_named(episode["robot"]), episode, solver)
        yield from replayed(replay, zip(own["q"], own["v"], strict=True))


def apart(one: dict[str, Any], other: dict[str, Any], *kinds: str) -> tuple[float, float]:
    """Return the differences of velocities and torques, of two kinds; 0 for missing ones."""
    found = []
    for name in ("velocity", "torque"):
        a, b = (each.get(kind + name) for each, kind in zip((one, other), kinds, strict=True))
        if a is None or b is None or np.isnan(a).any() or np.isnan(b).any():
            found.append(0.0)
            continue
        scale = max(1.0, float(np.abs(a).max())) if name == "torque" else 1.0
        found.append(float(np.abs(a - b).max()) / scale)
    return found[0], found[1]


@dataclass
class Difference:
    """The differences in the ticks of a category and level."""

    tolerance: float
    ticks: int = 0
    answer: tuple[float, float] = (0.0, 0.0)  # velocity, torque
    optimum: tuple[float, float] = (0.0, 0.0)
    off: tuple[float, float] = (0.0, 0.0)  # before, now
    bitwise: int = 0
    words: int = 0
    beyond: int = 0
    worst: str = "-"
    examples: list[str] = field(default_factory=list)

    def add(self, before: dict[str, Any], now: dict[str, Any], where: str) -> None:
        """Count one tick."""
        self.ticks += 1
        keys = (*WORDS, "step_scale")
        if any(before[key] != now[key] for key in keys):
            self.words += 1
            both = (" ".join(str(one[key]) for key in keys) for one in (before, now))
            self.examples.append(f"{where}: {' -> '.join(both)}")
            return
        answer, optimum = apart(before, now, "", ""), apart(before, now, "exact_", "exact_")
        off = max(apart(before, before, "", "exact_")), max(apart(now, now, "", "exact_"))
        numbers = [name for name in ("velocity", "torque") if name in now]
        self.bitwise += all(np.array_equal(before[name], now[name]) for name in numbers)
        if max(answer) > max(self.answer):
            self.worst = where
        self.answer, self.optimum, self.off = (
            (max(a[0], b[0]), max(a[1], b[1]))
            for a, b in ((self.answer, answer), (self.optimum, optimum), (self.off, off))
        )
        self.beyond += not max(answer) <= self.tolerance + sum(off)

    @property
    def failed(self) -> bool:
        sloppier = self.off[1] > 10.0 * max(self.off[0], self.tolerance)
        return bool(self.words or self.beyond or sloppier)


def compare(path: Path, only: list[str], robots: list[str], solver: str | None) -> int:
    """Print the differences; return the exit code."""
    golden, found, order = Golden.read(path), {}, [*CATEGORIES]
    for k in range(len(golden.episodes)):
        episode, own = golden.episodes[k], golden.rows[k]
        category, level = episode["category"], episode["level"]
        if (only and category not in only) or (robots and episode["robot"] not in robots):
            continue
        one = found.setdefault((category, level), Difference(CATEGORIES[category][2]))
        for tick, now in enumerate(golden.answers(k, solver)):
            before = {name: values[tick] for name, values in own.items()}
            one.add(before, now, f"{k} {tick} ({episode['robot']})")
    print(f"{'':28s}{'':7s}{'answers':^18s}{'their optima':^18s}{'off these':^18s}")
    names = ("velocity", "torque", "velocity", "torque", "before", "now")
    columns = "".join(f"{name:>9s}" for name in (*names, "bitwise", "status", "beyond", "of"))
    print(f"{'category':18s}{'level':10s}{'ticks':>7s}{columns}  worst: episode, tick")
    for (category, level), one in sorted(found.items(), key=lambda each: order.index(each[0][0])):
        numbers = (*one.answer, *one.optimum, *one.off)
        figures = f"{one.ticks:7d}" + "".join(f"{number:9.1e}" for number in numbers)
        figures += f"{one.bitwise:9d}{one.words:9d}{one.beyond:9d}{one.tolerance:9.0e}"
        print(f"{category:18s}{level:10s}{figures}  {one.worst}{' FAILED' * one.failed}")
    for key, one in found.items():
        for example in one.examples[:3]:
            print(f"    {' '.join(key)}: episode {example}")
    return int(any(one.failed for one in found.values()))


def show(path: Path, k: int, tick: int, solver: str | None) -> None:
    """Print the two answers of one tick, and the episode."""
    golden = Golden.read(path)
    now = list(golden.answers(k, solver))[tick]
    print(json.dumps(golden.episodes[k], indent=1))
    for name in ("status", "policy", "step_scale", "velocity", "torque"):
        print(name, "recorded", golden.rows[k][name][tick], "now", now.get(name), sep="\n  ")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("record", "compare", "show"))
    parser.add_argument("file", type=Path)
    parser.add_argument("where", nargs="*", type=int, help="for show: episode and tick")
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=30)
    parser.add_argument("--only", nargs="+", default=[], choices=[*CATEGORIES])
    parser.add_argument("--robots", nargs="+", default=[], choices=ROBOTS)
    parser.add_argument("--solver", help="compare what another one answers")
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # floating on purpose, gains of the other level
    if options.command == "record":
        record(options.file, options.ticks, options.seed)
    elif options.command == "compare":
        sys.exit(compare(options.file, options.only, options.robots, options.solver))
    else:
        show(options.file, *options.where, options.solver)


if __name__ == "__main__":
    main()
