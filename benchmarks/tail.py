"""The slowest ticks of a long loop, whether memory grows, and ticks with cold caches.

The loop of tick.py, all of it timed in thread CPU time: targets, snapshot, tick, integration. It
alternates with a fixed piece of arithmetic of about the same length, whose slow runs show what the
machine alone does. All rounds are then run once more from the start, bit by bit the same: the
program's own slow rounds are slow both times, so the quicker time of each round is the program's.
Memory is read after a tenth of the ticks and at the end. Cold ticks come after touching 32 MB of
other memory.

    python benchmarks/tail.py [--ticks 1000000] [--robot g1] [--solver active_set] [--cold 500]
        [--realtime]  # before all other processes, as a robot's controller runs (SCHED_FIFO)
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import gc
import sys
from pathlib import Path
from time import thread_time

import numpy as np
from tick import DT, make_run

from wbc.robot import Robot

OTHER = 32 * 2**20  # bytes
PERCENTILES = (50.0, 99.0, 99.9, 99.99)


class Loop:
    """A closed loop with moving targets; ``body`` is one round of it."""

    def __init__(self, robot: Robot, solver: str) -> None:
        self.run = run = make_run(robot, solver)
        self.robot, self.q, self.v, self.failures = robot, run.q, run.v, 0

    def body(self, k: int) -> float:
        """Run a tick; return the thread's CPU time of it [s]."""
        targets = self.run.targets(k)
        begin = thread_time()
        self.run.aim(targets)
        tick = self.run.controller.step(self.robot.snapshot(self.q, self.v))
        self.v = tick.velocity
        self.q = self.robot.integrate(self.q, self.v, DT)
        spent = thread_time() - begin
        self.failures += not tick.ok
        return spent


class Work:
    """The same arithmetic every time: variations of its time are the machine's."""

    def __init__(self) -> None:
        self._matrix = np.random.default_rng(0).normal(size=(35, 35))

    def body(self) -> float:
        """Return its CPU time [s]."""
        begin, x = thread_time(), self._matrix
        for _ in range(8):
            x = self._matrix.dot(x)
            x *= 1.0 / abs(x[0, 0])
        return thread_time() - begin


class Rounds:
    """CPU times [s] of rounds of a loop, and of the fixed arithmetic in turns with them."""

    def __init__(self, loop: Loop, count: int) -> None:
        self.loop, self.early = loop, (0.0, 0)
        # Not zeros, so that the memory is allocated from the start.
        self.ticks, self.idle = np.ones((2, count))
        work, tenth, before = Work(), count // 10, 0
        for k in range(-200, count):
            spent, alone = loop.body(k), work.body()
            if k >= 0:
                self.ticks[k], self.idle[k] = spent, alone
            if k == 0:
                before = collections()
            if k == tenth:
                self.early = memory()
        # One of them was requested, to read the memory.
        self.collected = collections() - before - 1


def collections() -> int:
    """Return the number of Python's garbage collections."""
    return sum(one["collections"] for one in gc.get_stats())


def memory() -> tuple[float, int]:
    """Return resident memory [MB] and Python's allocated blocks."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20, sys.getallocatedblocks()


def row(label: str, seconds: np.ndarray) -> str:
    """Return one line of the table."""
    found = np.percentile(seconds, PERCENTILES) * 1e6
    cells = " | ".join(f"{one:.0f}" for one in found)
    return f"| {label} | {cells} | {1e6 * seconds.max():.0f} | {found[2] / found[0]:.2f} |"


def main() -> None:
    """Run the loop and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--robot", default="g1")
    parser.add_argument("--solver", default="active_set")
    parser.add_argument("--cold", type=int, default=500, help="ticks with cold caches")
    parser.add_argument("--realtime", action="store_true", help="before all other processes")
    options = parser.parse_args()
    if options.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    robot = Robot.load(options.robot)
    first = Rounds(Loop(robot, options.solver), options.ticks)
    loop, late = first.loop, memory()
    second = Rounds(Loop(robot, options.solver), options.ticks)
    same = np.array_equal(loop.q, second.loop.q)
    other, cold = np.zeros(OTHER // 8), np.zeros(options.cold)
    for k in range(options.cold):
        other += 1.0
        cold[k] = loop.body(options.ticks + k)
    heads = " | ".join(("median", *(f"p{one:g}" for one in PERCENTILES[1:]), "largest"))
    print(f"| CPU time [us] | {heads} | p99.9 / median |\n|---|---:|---:|---:|---:|---:|---:|")
    print(row(f"{options.robot}, {options.ticks} rounds of the loop", first.ticks))
    print(row("the same once more", second.ticks))
    print(row("of each round the quicker", np.minimum(first.ticks, second.ticks)))
    print(row("fixed arithmetic beside the first", first.idle))
    print(row("rounds with cold caches", cold))
    early, failures = first.early, loop.failures + second.loop.failures
    print(f"failed ticks: {failures}; both ended at the same bits: {'yes' if same else 'NO'}")
    print(f"Python looked for cycles {first.collected} times")
    print(f"resident memory {early[0]:.1f} MB after a tenth, {late[0]:.1f} MB after the first;")
    print(f"Python's blocks {early[1]} and {late[1]}")


if __name__ == "__main__":
    main()
