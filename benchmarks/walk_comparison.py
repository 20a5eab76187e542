"""The effect of angular momentum and inertia tasks on a walk: free, regulated, and as planned.

A robot walks, and is pushed at its trunk during a walk, by the same tasks except those about
angular momentum and inertia:

free         no task about either;
regulated    both to zero, the inertia to that at the start, about all axes as firmly as the CoM,
             and about the vertical as firmly as by default;
planned      the default: that of the swing leg is free, except about the vertical, where only
             friction holds a foot;
yaw 10, ...  as planned, with another weight about the vertical (``WalkingWeights.yaw``).

It reports how far the standing foot rotates in a step, by the simulation's true state, the largest
torque relative to its motor's bound, and the largest impulse survived, bisected. Every trial has
sensor noise of 1e-3 rad and 0.05 rad/s, 2 ms of delay and masses wrong by up to 10 %, by the seed.

    python benchmarks/walk_comparison.py [benchmarks/walk_comparison.jsonl] [--seeds 2]
        [--only walk push weight]

Each trial is a line of the journal, and is not run twice; the end reports how many lines are of
other code of this package.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import ARMATURE, DT, plant_of, robot_named
from sources import code_of

import wbc
from wbc.controllers import Controller
from wbc.gait import Walker, WalkingWeights
from wbc.gait.whole_body import heaviest_link
from wbc.journal import Journal
from wbc.robot import Snapshot
from wbc.simulation import SimulationError, SimulationTick, Terrain, simulate

JOURNAL = Path(__file__).with_suffix(".jsonl")
VARIANTS = ("free", "regulated", "planned")
FIRM, IGNORED = 30.0, 1e-9  # weights: of the CoM's rows, in M kg m/s; of free rows
YAW = (10.0, 60.0, 90.0, 180.0)  # weights tried
SPEED = {"g1": 0.8, "talos": 0.5, "hoap2_like": 0.15}  # m/s
TURN = 0.4  # rad/s, at half the speed
SLIPPERY = 0.4  # friction: on rougher ground no foot turns
STEPS, STEADY = 16, 4  # of a walk; before that nothing is measured
# A push: while a G1 walks at so many m/s, after so many steps and with so many to come.
PUSHED, BEFORE, AFTER, LASTING = 0.5, 6, 8, 0.2
DIRECTIONS = (0, 90, 180, 270)  # degrees, from ahead to the left
MOST, STEP = 96.0, 3.0  # N s
MADE_OF = {"dt": DT, "armature": ARMATURE, "push": (PUSHED, BEFORE, AFTER, LASTING), "steps": STEPS}


@dataclass(frozen=True)
class Trial:
    """One walk; ``push`` is (direction [deg], impulse [N s]) or None."""

    group: str
    robot: str
    variant: str
    seed: int
    command: tuple[float, float]  # m/s ahead, rad/s to the left
    friction: float = 0.8
    push: tuple[float, float] | None = None

    @property
    def key(self) -> str:
        v, turn = self.command
        push = "" if self.push is None else f"/{self.push[0]:g} deg, {self.push[1]:g} N s"
        return f"{self.group}/{self.robot}/{self.variant}/{v:g}, {turn:g}/{self.seed}{push}"


def walker_of(robot: wbc.Robot, variant: str) -> Walker:
    """Return the walker of a variant."""
    if variant == "free":
        return Walker(robot, weights=WalkingWeights(spin=IGNORED, yaw=IGNORED), dt=DT)
    if variant.startswith("yaw"):
        return Walker(robot, weights=WalkingWeights(yaw=float(variant.split()[1])), dt=DT)
    if variant == "planned":
        return Walker(robot, dt=DT)
    start = robot.snapshot(robot.posture("standing"))
    unit = FIRM / (robot.mass * float(start.com[2]) ** 2)
    inertia = wbc.InertiaTask(robot, start.inertia, kp=100.0, weight=unit)
    return Walker(robot, weights=WalkingWeights(spin=FIRM), tasks=[inertia], dt=DT)


class TurnOfFeet:
    """The true rotation of the supporting foot about the vertical, step by step [rad]."""

    def __init__(self, walker: Walker) -> None:
        self.walker = walker
        self.turned: list[float] = []
        self._step, self._foot, self._begin = 0, "", 0.0

    def look(self, now: SimulationTick) -> None:
        """Measure a tick."""
        foot = getattr(self.walker.phase, "support", "")
        if (self.walker.steps, foot) == (self._step, self._foot):
            return
        here = self.walker.robot.snapshot(*now.state)
        if self._foot and self._step >= STEADY:
            turn = math.remainder(_yaw(here, self._foot) - self._begin, math.tau)
            self.turned.append(abs(turn))
        self._step, self._foot = self.walker.steps, foot
        self._begin = _yaw(here, foot) if foot else 0.0


def _yaw(snapshot: Snapshot, foot: str) -> float:
    x = snapshot.rotation(snapshot.robot.feet[foot].frame)[:, 0]
    return math.atan2(x[1], x[0])


def run_trial(trial: Trial) -> dict[str, Any]:
    """Run a trial and return its results as plain data."""
    robot, ground = robot_named(trial.robot), Terrain(friction=trial.friction)
    plant = plant_of(robot, trial.seed, ground, robot.posture("standing"))
    walker = walker_of(robot, trial.variant)
    feet, torques, push = TurnOfFeet(walker), [], trial.push
    steps = STEPS if push is None else BEFORE + AFTER

    def lead(tick: int, snapshot: Snapshot) -> Controller | None:
        nonlocal push
        if walker.steps >= steps:
            return None
        if push is not None and walker.steps >= BEFORE:
            (angle, impulse), push = push, None
            way = np.array((math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0))
            plant.push(heaviest_link(robot), impulse / LASTING * way, duration=LASTING)
        if plant.time >= 0.2 and walker.wanted.at_rest:
            walker.command(trial.command[0], 0.0, trial.command[1])
        return walker.prepare(snapshot, plant.contact_forces)

    stood, reason = True, ""
    try:
        for now in simulate(walker.controller, plant, 30.0, update=lead):
            stood, reason = now.verdict.stood, now.verdict.reason
            feet.look(now)
            if walker.steps >= STEADY:
                torques.append(np.abs(now.tick.torque) / walker.controller.torque_bounds)
    except SimulationError as error:
        stood, reason = False, str(error)
    used = np.array(torques) if torques else np.zeros((1, 1))
    degrees = np.degrees(feet.turned) if feet.turned else np.zeros(1)
    return {
        "key": trial.key,
        **asdict(trial),
        "stood": stood and walker.steps >= steps,
        "reason": reason,
        "made": walker.steps,
        "turned": round(float(degrees.max()), 3),
        "mean_turned": round(float(degrees.mean()), 3),
        "torque": round(float(used.max()), 4),
        "torque_rms": round(float(np.sqrt(np.mean(np.square(used)))), 4),
    }


Run = Callable[[Trial], dict[str, Any]]


def walks(seeds: int) -> Iterator[Trial]:
    """Yield the walks by variant, on slippery ground."""
    for seed in range(seeds):
        for variant in VARIANTS:
            yield Trial("walk", "g1", variant, seed, (SPEED["g1"], 0.0), SLIPPERY)


def weights() -> Iterator[Trial]:
    """Yield the walks by weight about the vertical, ahead and turning, one seed."""
    for part, turn in ((1.0, 0.0), (0.5, TURN)):
        for robot, v in SPEED.items():
            for weight in YAW:
                yield Trial("weight", robot, f"yaw {weight:g}", 0, (part * v, turn), SLIPPERY)


def bisect(run: Run, variant: str, angle: int, seed: int) -> float:
    """Return the largest impulse survived [N s], to :data:`STEP`."""
    least, most = 0.0, MOST
    while most - least > STEP:
        impulse = STEP * round(0.5 * (least + most) / STEP)
        trial = Trial("push", "g1", variant, seed, (PUSHED, 0.0), push=(angle, impulse))
        if run(trial)["stood"]:
            least = impulse
        else:
            most = impulse
    return least


def survived(run: Run, seeds: int) -> dict[str, dict[int, list[float]]]:
    """Return impulses survived [N s], one for each seed, by variant and direction."""
    found: dict[str, dict[int, list[float]]] = {variant: {} for variant in VARIANTS}
    for seed in range(seeds):
        for angle in DIRECTIONS:
            for variant in VARIANTS:
                found[variant].setdefault(angle, []).append(bisect(run, variant, angle, seed))
    return found


def line(row: dict[str, Any]) -> str:
    """Return a walk in words."""
    v, turn = row["command"]
    return (
        f"{row['robot']:11} {row['variant']:10} seed {row['seed']}, {v:g} m/s, {turn:g} rad/s:"
        f" {'stood' if row['stood'] else row['reason'] or 'not all steps'}; foot turns by"
        f" {row['mean_turned']:.2f} deg, at most {row['turned']:.2f}; torque at most"
        f" {row['torque']:.2f} of its bound, rms {row['torque_rms']:.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("journal", type=Path, nargs="?", default=JOURNAL)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--only", nargs="+", default=["walk", "push", "weight"])
    given = parser.parse_args()
    with Journal(given.journal, MADE_OF) as journal:
        rows = {row["key"]: row for row in journal.entries}

        def run(trial: Trial) -> dict[str, Any]:
            if trial.key not in rows:
                rows[trial.key] = {**run_trial(trial), "code": code_of()}
                journal.add(rows[trial.key])
            return rows[trial.key]

        for trial in walks(given.seeds) if "walk" in given.only else ():
            print(line(run(trial)), flush=True)
        for trial in weights() if "weight" in given.only else ():
            print(line(run(trial)), flush=True)
        if "push" in given.only:
            for variant, found in survived(run, given.seeds).items():
                told = ", ".join(f"{angle} deg {np.mean(one):.1f}" for angle, one in found.items())
                mean = np.mean(list(found.values()))
                print(f"{variant:10} survives {told}: {mean:.1f} N s on average")
    other = sum(row.get("code") != code_of() for row in rows.values())
    if other:
        print(f"{other} of {len(rows)} trials are of other code")


if __name__ == "__main__":
    main()
