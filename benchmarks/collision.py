"""Margins between bodies: are they kept, at what cost, and without chattering?

1. Random ticks as in ``random_ticks.py`` (targets mostly out of reach, every support) with the
   robot's own bodies kept apart. Every pair of bodies is measured after every tick, not only the
   nearest that have rows.
2. Time of a tick of ``tick.py``'s job with and without, in turns.
3. Hands pressed against the body: a chattering command would change its sign.

    python benchmarks/collision.py [--ticks 100000] [--robots g1 talos] [--braking bounded]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from collections import Counter
from dataclasses import dataclass, field
from time import thread_time

import numpy as np
import tick as job
from random_ticks import DT, EPISODE, SUPPORTS, clear_posture, controller_of

from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import closed_loop
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel
from wbc.tasks import PositionTask, PostureTask

ROBOTS = ("hoap2_like", "g1", "talos", "icub", "romeo")
MARGIN = 0.01
PAIRS = 25


@dataclass
class Record:
    """Observations over all ticks of one robot and support."""

    ticks: int = 0
    near: int = 0  # ticks after which a pair was within a millimetre of its margin
    cut: int = 0  # ticks that were solved again because of where they led
    shared: int = 0  # ticks of which only a part was commanded
    broken: float = -np.inf  # m: margin minus the smallest distance of all pairs
    speeding: float = 0.0  # largest gain of a joint's speed in a tick, in parts of the declared one
    hard: int = 0  # ticks in which a joint brakes harder than declared
    hardest: float = 0.0  # largest change of a joint's velocity, in parts of the declared one
    statuses: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def row(self) -> str:
        return (
            f"{self.ticks:8d}{self.near:8d}{self.cut:7d}{self.shared:7d}{self.broken * 1e3:10.4f}"
            f"{self.speeding:10.4f}{100.0 * self.hard / self.ticks:8.2f}{self.hardest:9.1f}"
            f"  {dict(self.statuses)}"
        )


def clearances(margins: SelfCollision, snapshot: Snapshot) -> np.ndarray:
    """Return how far each pair is outside its margin [m]; close standing pairs have less."""
    return margins.model.nearest(snapshot).distance - margins.margins


def episode(
    robot: Robot,
    margins: SelfCollision,
    limits: Limits,
    mode: str,
    rng: np.random.Generator,
    solver: str,
    record: Record,
) -> None:
    """Run one set of random targets from a random posture."""
    q = clear_posture(robot, margins, rng)
    parts = {"limits": limits, "constraints": [margins], "solver": solver}
    controller = controller_of(robot, q, mode, rng, **parts)
    for now in closed_loop(controller, q, EPISODE):
        tick, v = now.tick, now.snapshot.v
        record.ticks += 1
        record.statuses[tick.status.value] += 1
        record.cut += len(tick.qp.l) > min(PAIRS, len(margins.model.pairs))
        record.shared += tick.step_scale < 1.0
        if not tick.ok and len(record.examples) < 3:
            record.examples.append(tick.report())
        gained = (np.abs(tick.velocity) - np.abs(v))[6:] / (limits.acceleration * DT)
        record.speeding = max(record.speeding, float(gained.max()))
        change = float((np.abs(tick.velocity - v)[6:] / (limits.acceleration * DT)).max())
        record.hard += change > 1.0 + 1e-6
        record.hardest = max(record.hardest, change)
        clearance = clearances(margins, robot.snapshot(now.q))
        k = int(clearance.argmin())
        broken = -float(clearance[k])
        record.near += broken > -1e-3
        if broken > max(record.broken, 1e-5) and len(record.examples) < 5:
            record.examples.append(f"{margins.model.labels[k]}: {broken * 1e3:.4f} mm inside")
        record.broken = max(record.broken, broken)


def random_ticks(options: argparse.Namespace) -> None:
    rng = np.random.default_rng(options.seed)
    share = -(-options.ticks // (len(options.robots) * len(SUPPORTS)))
    print(f"{'robot':12s}{'support':10s}{'ticks':>8s}{'near':>8s}{'cut':>7s}{'shared':>7s}", end="")
    print(f"{'broken mm':>10s}{'speeding':>10s}{'hard %':>8s}{'hardest':>9s}  statuses")
    total = Record()
    for name in options.robots:
        robot = Robot.load(name)
        limits = Limits(robot, braking=options.braking)
        margins = SelfCollision(robot, margin=MARGIN, pairs=PAIRS, fit=options.fit, limits=limits)
        for mode in SUPPORTS:
            record = Record()
            while record.ticks < share:
                episode(robot, margins, limits, mode, rng, options.solver, record)
            print(f"{name:12s}{mode:10s}{record.row()}", flush=True)
            for example in record.examples:
                print("    ", example)
            total.ticks += record.ticks
            total.statuses += record.statuses
            total.hard += record.hard
            total.hardest = max(total.hardest, record.hardest)
            total.broken = max(total.broken, record.broken)
    worst = f"{total.broken * 1e3:.4f} mm"
    hard = f"{100.0 * total.hard / total.ticks:.2f} % of them, {total.hardest:.1f} times at most"
    print(f"total {total.ticks} ticks, margin broken by {worst}, {dict(total.statuses)};")
    print(f"a joint changed its velocity by more than the acceleration allows in {hard}")


def watched(robot: Robot, fit: str, few: bool) -> SelfCollision:
    """Return margins for all pairs, or only for the 25 that are nearest when standing.

    Those that stand too near to keep the margin are not among the 25: they would be pushed apart.
    """
    margins = SelfCollision(robot, margin=MARGIN, pairs=PAIRS, fit=fit)
    if not few:
        return margins
    model = margins.model
    distance = model.nearest(robot.snapshot(robot.posture("standing"))).distance
    distance[margins.margins < MARGIN] = np.inf
    pairs = [(a, b) for a, b in model.pairs[np.sort(distance.argsort()[:PAIRS])].tolist()]
    only = CollisionModel(robot, model.bodies, pairs)
    return SelfCollision(robot, margin=MARGIN, pairs=PAIRS, model=only)


def times(solver: str, ticks: int) -> None:
    """Time the tick benchmark's job with and without margins in turns; medians in CPU time."""
    robot = Robot.load("g1")
    bare = job.make_run(robot, solver)
    bare.label = "none"
    runs = [bare]
    for fit in ("capsule", "hull"):
        for few in (True, False):
            margins = watched(robot, fit, few)
            run = job.make_run(robot, solver, constraints=[margins])
            run.label = f"{fit}, {PAIRS} of {len(margins.model.pairs)}"
            runs.append(run)
    turn = 10  # ticks: short turns, so that a change of the machine's pace hits all alike
    for _ in range(-(-(job.WARM_UP + ticks) // turn)):
        for run in runs:
            for _ in range(turn):
                run.advance()
    print(f"\ntick of g1 with {solver}; us of CPU time: median, tenth and last percentile")
    for run in runs:
        low, median, high = np.percentile(run.cpu, (10, 50, 99)) * 1e6
        # The k-th ticks of two runs lie milliseconds apart: their difference is the fairest.
        extra = np.median(np.subtract(run.cpu, bare.cpu)) * 1e6
        print(f"{run.label:20s}{median:7.0f}{low:7.0f}{high:7.0f}   extra {extra:5.0f}", end="   ")
        stages = np.median(np.array(run.stages), axis=0) * 1e6
        print(", ".join(f"{n} {t:.0f}" for n, t in zip(job.STAGES, stages, strict=True)))
    here = robot.snapshot(robot.posture("standing"))
    for run in runs[1:]:
        (margins,) = run.controller.constraints
        start = thread_time()
        for _ in range(1000):
            margins.rows(here, DT)
        print(f"rows alone, {run.label}: {(thread_time() - start) * 1e3:.0f} us")


def pressed(solver: str) -> None:
    """Pull both hands through the trunk, and count how often a joint's velocity changes sign."""
    print("\nhands pressed against the body, 1500 ticks; changes of sign above 1e-3 rad/s:")
    for name, left, right in (
        ("g1", "left_wrist_yaw_link", "right_wrist_yaw_link"),
        ("talos", "arm_left_7_link", "arm_right_7_link"),
        ("romeo", "l_wrist", "r_wrist"),
    ):
        robot = Robot.load(name)
        limits = Limits(robot)
        margins = SelfCollision(robot, margin=MARGIN, pairs=PAIRS, limits=limits)
        q = robot.posture("standing")
        here = robot.snapshot(q)
        tasks = [
            PositionTask(robot, hand, here.com + [0.0, 0.0, 0.1], weight=1.0, gain=0.1)
            for hand in (left, right)
        ]
        controller = KinematicController(
            robot,
            [*tasks, PostureTask(robot, q, weight=0.05, gain=0.05)],
            contacts=support(here, "double"),
            limits=limits,
            constraints=[margins],
            dt=DT,
            solver=solver,
        )
        history = list(closed_loop(controller, q, 1500))
        rates = np.array([one.tick.velocity[6:] for one in history])
        strong = np.minimum(np.abs(rates[1:]), np.abs(rates[:-1])) > 1e-3
        turns = (rates[1:] * rates[:-1] < 0.0) & strong
        # A joint that reverses twice within ten ticks chatters.
        recent = np.cumsum(np.vstack((np.zeros_like(rates[:1]), turns)), axis=0)
        trembles = int((recent[10:] - recent[:-10] > 1).any(axis=1).sum())
        late = float(np.abs(rates[-300:]).max())
        gap = clearances(margins, robot.snapshot(history[-1].q)).min()
        print(
            f"{name:8s} {int(turns.sum())} of {turns.shape[1]} joints, {trembles} ticks with two "
            f"turns within 10; largest late speed {late:.1e} rad/s, "
            f"least distance - margin {gap * 1e3:.4f} mm, held by {history[-1].tick.active[:2]}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=100_000)
    parser.add_argument("--timed", type=int, default=2000, help="ticks of the timing")
    parser.add_argument("--solver", default="proxqp")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fit", default="capsule")
    parser.add_argument("--braking", default="free", help="free or bounded, of the random ticks")
    parser.add_argument("--robots", nargs="+", default=ROBOTS)
    options = parser.parse_args()
    if options.ticks:
        random_ticks(options)
    if options.timed:
        times(options.solver, options.timed)
    pressed(options.solver)


if __name__ == "__main__":
    main()
