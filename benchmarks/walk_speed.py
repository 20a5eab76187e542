"""How fast a robot walks by default settings: 50 steps at a speed, over seeds.

Every walk has sensor noise of 1e-3 rad and 0.05 rad/s, 2 ms of delay and masses wrong by up to
10 %, by the seed. Told are the speed from the eighth step on and the share of ticks that were
relaxed.

    python benchmarks/walk_speed.py [benchmarks/results/walk_speed.jsonl] [--robot g1]
        [--speeds 1.2] [--seeds 0 1 2] [--steps 50]

Each walk is a line of the journal, with the code that it was measured with.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import ARMATURE, DT, plant_of, robot_named
from sources import code_of

from wbc.controllers import Controller
from wbc.gait import Walker
from wbc.journal import Journal
from wbc.robot import Snapshot
from wbc.simulation import SimulationError, Terrain, simulate

JOURNAL = Path(__file__).parent / "results" / "walk_speed.jsonl"
STEADY = 8  # steps, before which the speed is not measured
LONGEST = 90.0  # s


def walked(name: str, seed: int, speed: float, steps: int) -> dict[str, Any]:
    """Walk; return what came of it, as plain data."""
    robot = robot_named(name)
    plant = plant_of(robot, seed, Terrain(), robot.posture("standing"))
    walker = Walker(robot, dt=DT)
    admitted = walker.command(speed)
    begun: tuple[float, np.ndarray] | None = None
    ticks = relaxed = 0

    def lead(tick: int, snapshot: Snapshot) -> Controller | None:
        if walker.steps >= steps:
            return None
        return walker.prepare(snapshot, plant.contact_forces)

    stood, reason = True, ""
    try:
        for now in simulate(walker.controller, plant, LONGEST, update=lead):
            stood, reason = now.verdict.stood, now.verdict.reason
            ticks, relaxed = ticks + 1, relaxed + bool(now.tick.policy)
            if begun is None and walker.steps >= STEADY:
                begun = plant.time, plant.com
    except SimulationError as error:
        stood, reason = False, str(error)
    way = 0.0 if begun is None else float(np.linalg.norm((plant.com - begun[1])[:2]))
    time = DT if begun is None else max(plant.time - begun[0], DT)
    return {
        "key": f"{name}/{speed:g}/{steps}/{seed}",
        "admitted": round(admitted.velocity.vx, 3),
        "stood": stood and walker.steps >= steps,
        "reason": reason,
        "made": walker.steps,
        "speed": round(way / time, 3),
        "relaxed": round(relaxed / max(ticks, 1), 5),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("journal", type=Path, nargs="?", default=JOURNAL)
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.2])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--steps", type=int, default=50)
    given = parser.parse_args()
    given.journal.parent.mkdir(parents=True, exist_ok=True)
    with Journal(given.journal, {"armature": ARMATURE, "dt": DT, "code": code_of()}) as journal:
        rows = {row["key"]: row for row in journal.entries}
        for speed in given.speeds:
            for seed in given.seeds:
                key = f"{given.robot}/{speed:g}/{given.steps}/{seed}"
                if key not in rows:
                    rows[key] = walked(given.robot, seed, speed, given.steps)
                    journal.add(rows[key])
                print(rows[key], flush=True)
            begins = f"{given.robot}/{speed:g}/{given.steps}/"
            found = [row for key, row in rows.items() if key.startswith(begins)]
            stood = sum(row["stood"] for row in found)
            mean = np.mean([row["speed"] for row in found])
            print(f"{given.robot} at {speed:g} m/s: {stood} of {len(found)} stand, {mean:.2f} m/s")


if __name__ == "__main__":
    main()
