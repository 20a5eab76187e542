"""Every robot of example-robot-data: what loads, what stands, and margins checked by raw meshes.

1. A table of all files: feet, base, whether ``standing`` stands, or the error that refuses it.
2. Random ticks of every standing humanoid (targets mostly out of reach, four supports) with its
   bodies kept apart. After every tick Coal measures the *raw* shapes of all watched pairs, which
   the controller has as capsules and hulls only.

    python benchmarks/library_robots.py [--ticks 20000] [--only talos g1] [--pictures FOLDER]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import logging
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time

import numpy as np
from random_ticks import EPISODE, SUPPORTS, clear_posture, controller_of
from raw_shapes import RawShapes

from wbc.constraints import Contact, Limits, SelfCollision
from wbc.controllers.closed_loop import closed_loop
from wbc.errors import ModelError, WbcError
from wbc.robot import Robot
from wbc.robot.library import find_robot
from wbc.robot.postures import is_standing

MARGIN = 0.01
SIDES = {"left", "right"}


def folder() -> Path:
    """Return the folder of example-robot-data's robots."""
    return next(one for one in find_robot("g1").path.parents if one.name == "robots")


def loaded(path: Path) -> Robot | str:
    """Return the robot of a file, or the reason of its refusal."""
    try:
        return Robot.load(path)
    except WbcError as error:
        return str(error).removeprefix(f"{path}: ")


def is_humanoid(robot: Robot) -> bool:
    """Return whether it stands on two feet."""
    return set(robot.feet) == SIDES and is_standing(robot.model, robot.posture(), robot.feet)


def verdict(robot: Robot) -> str:
    """Return a robot's result, in a line."""
    if robot.fixed_base:
        return "fixed base"
    if not robot.feet:
        return next((note for note in robot.notes if "no feet" in note), "no feet")
    up = "stands" if is_standing(robot.model, robot.posture(), robot.feet) else "does not stand"
    feet = ", ".join(f"{foot.link} ({len(foot.polygon)})" for foot in robot.feet.values())
    return f"{up} on {feet}"


def draw(robot: Robot, target: Path) -> None:
    """Draw a robot as it stands."""
    from wbc.view import plot_robot

    plot_robot(robot, {"standing": robot.posture()}, target)


@dataclass
class Record:
    """Observations over the random ticks of one robot."""

    ticks: int = 0
    outside: float = 0.0  # rad or m
    slip: float = 0.0  # m
    broken: tuple[float, str] = (0.0, "")  # m
    statuses: Counter[str] = field(default_factory=Counter)


def episode(
    robot: Robot,
    margins: SelfCollision,
    raw: RawShapes,
    mode: str,
    rng: np.random.Generator,
    record: Record,
) -> None:
    """Run one set of random targets from a random posture."""
    q = clear_posture(robot, margins, rng)
    controller = controller_of(robot, q, mode, rng, limits=Limits(robot), constraints=[margins])
    for now in closed_loop(controller, q, EPISODE):
        record.ticks += 1
        record.statuses[now.tick.status.value] += 1
        record.outside = max(record.outside, -controller.limits.worst_margin(now.q)[0])
        record.broken = max(record.broken, raw.broken(now.q))
        there = robot.snapshot(now.q)
        slips = [held.slip(there) for held in controller.contacts if isinstance(held, Contact)]
        record.slip = max([record.slip, *slips])


def random_ticks(robot: Robot, ticks: int, seed: int) -> str:
    """Run random ticks and return the observations, in a line."""
    try:
        margins = SelfCollision(robot, margin=MARGIN)
    except ModelError as error:
        return str(error).removeprefix(f"{robot.path}: ")
    rng, record, raw = np.random.default_rng(seed), Record(), RawShapes(robot, margins)
    start = process_time()
    while record.ticks < ticks:
        for mode in SUPPORTS:
            episode(robot, margins, raw, mode, rng, record)
    broken, pair = record.broken
    return (
        f"{record.ticks} ticks, {len(raw.pairs)} raw pairs ({len(margins.in_contact)} in contact by"
        f" design): margin broken by {broken * 1e3:.4f} mm {pair}, limits by {record.outside:.1e},"
        f" feet slipped {record.slip * 1e3:.3f} mm, {dict(record.statuses)},"
        f" {process_time() - start:.0f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=20_000, help="of each humanoid")
    parser.add_argument("--only", nargs="+", default=[""], help="parts of file names")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of what stands")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    logging.disable(logging.WARNING)  # the table says it
    humanoids = []
    for path in sorted(folder().rglob("*.urdf")):
        if not any(part in str(path) for part in options.only):
            continue
        robot, name = loaded(path), path.stem
        if isinstance(robot, str):
            print(f"{name:28s} refused: {robot}")
            continue
        print(f"{name:28s} {robot.nv - 6:3d} joints {robot.mass:6.1f} kg  {verdict(robot)}")
        if options.pictures and robot.feet:
            draw(robot, options.pictures / f"{name}.png")
        if is_humanoid(robot):
            humanoids.append(robot)
    for robot in humanoids if options.ticks else ():
        print(
            f"{robot.path.stem:28s} {random_ticks(robot, options.ticks, options.seed)}", flush=True
        )


if __name__ == "__main__":
    main()
