"""Torque soak: from whatever state, an answer that motors can give.

Robots x solvers x random states: joints beyond their limits, feet off the ground, contradictory
contacts (two anchors for one foot), joints rushing, pushes that change the velocity between ticks,
contacts that come and go, and numbers that are none. Counted: commands that are not finite or
outside the torque bounds, ticks that gave way (relaxed) or fell back (damped), exceptions that are
no WbcError, bad input that was accepted; and the slowest tick against the median in CPU time.

A virtual machine charges a thread with what its host does meanwhile: of the same 10,000 ticks the
slowest took 7 times the median in one run and 25 times in the next, another tick. So an episode
with a tick that took four times the median so far is run again, from the same random numbers, up to
``--runs`` times while it does so again, and a tick is as slow as in its quickest run; what first
runs alone show is told beside it. Runs that come out otherwise are counted as wrong.

Ticks come in parts, each from random numbers of its own. With ``--state`` every part is kept in a
file as it ends, and those of an earlier call are not run again: a long soak may be ended any time.
Parts that were run with other code of this package are left aside, and said to be.

    python benchmarks/torque_soak.py [--ticks 10000] [--robots g1 ...] [--solver active_set]
        [--runs 4] [--state FILE.jsonl]
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise

import argparse
import gc
import json
import sys
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from sources import code_of

from wbc import (
    ComTask,
    Contact,
    InertiaTask,
    Limits,
    LoadShareTask,
    MomentumTask,
    OrientationTask,
    PostureTask,
    Robot,
    SelfCollision,
    Snapshot,
    Task,
    TorqueController,
    TorqueTask,
    WbcError,
    support,
)

ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")
SOLVERS = ("active_set", "proxqp")
PART = 1000  # ticks
EPISODE = 100
FAULTS = 0.01
SLOW = 4.0  # times the median: worth another run


class Timed(NamedTuple):
    """A tick: its CPU time [s] and what it was."""

    seconds: float
    what: str


@dataclass
class Record:
    """What was seen of one robot and solver, or of an episode of it."""

    ticks: int = 0
    bad: int = 0
    faults: int = 0
    policies: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)
    timed: list[Timed] = field(default_factory=list)
    once: list[float] = field(default_factory=list)

    def wrong(self, what: str) -> None:
        """Count something that must not be, and keep an example."""
        self.bad += 1
        if len(self.examples) < 5:
            self.examples.append(what)

    def add(self, runs: list[Record]) -> None:
        """Add an episode that was run several times."""
        first = runs[0]
        self.ticks += first.ticks
        self.bad += first.bad
        self.faults += first.faults
        self.policies += first.policies
        self.examples = (self.examples + first.examples)[:5]
        if len({len(run.timed) for run in runs}) > 1:
            ends = (" ".join(run.examples) or "to its end" for run in runs)
            self.wrong("runs differ in where they end: " + "; ".join(ends))
        for ticks in zip(*(run.timed for run in runs), strict=False):
            if len({tick.what for tick in ticks}) > 1:
                self.wrong("runs differ: " + "; ".join(tick.what for tick in ticks))
            self.timed.append(min(ticks))
            self.once.append(ticks[0].seconds)

    def join(self, other: Record) -> None:
        """Add another part."""
        self.ticks += other.ticks
        self.bad += other.bad
        self.faults += other.faults
        self.policies += other.policies
        self.examples = (self.examples + other.examples)[:5]
        self.timed += other.timed
        self.once += other.once

    @classmethod
    def read(cls, kept: dict[str, Any]) -> Record:
        """Return a part as :func:`keep` wrote it."""
        timed = [Timed(*one) for one in kept["timed"]]
        return cls(**{**kept, "policies": Counter(kept["policies"]), "timed": timed})

    def is_slow(self, runs: list[Record]) -> bool:
        """Whether a tick of an episode was slow in all of its runs so far."""
        times = [min(ticks).seconds for ticks in zip(*(run.timed for run in runs), strict=False)]
        known = [tick.seconds for tick in self.timed] or times
        return bool(times) and max(times) > SLOW * float(np.median(known))

    def slowest(self, count: int) -> list[Timed]:
        """Return the ticks that were slow in all runs, the slowest first."""
        return sorted(self.timed, reverse=True)[:count]

    def line(self) -> str:
        """Return the figures in one line."""
        times = 1e3 * np.array([tick.seconds for tick in self.timed])
        middle, worst, once = np.median(times), times.max(), 1e3 * np.array(self.once)
        share = {name: f"{100 * n / self.ticks:.2f}%" for name, n in sorted(self.policies.items())}
        return (
            f"{self.ticks} ticks, {self.bad} wrong, {self.faults} faults refused, {share},"
            f" median {middle:.2f} ms, p99.9 {np.percentile(times, 99.9):.2f}, slowest {worst:.2f}"
            f" ({worst / middle:.1f} x); by one run {once.max():.2f}"
            f" ({once.max() / np.median(once):.1f} x)"
        )


def tasks_of(here: Snapshot, rng: np.random.Generator) -> list[Task]:
    """The usual tasks with weights over some decades, and now and then tasks about forces."""
    robot = here.robot
    tasks: list[Task] = [
        ComTask(robot, here.com + 0.1 * rng.normal(size=3), weight=10 ** rng.uniform(-1, 2)),
        OrientationTask(robot, "base", here.rotation("base"), weight=10 ** rng.uniform(-1, 1)),
        PostureTask(robot, here.q, weight=10 ** rng.uniform(-1.5, 0)),
        MomentumTask(robot, weight=10 ** rng.uniform(-2, 0)),
    ]
    if rng.random() < 0.5:
        shape = here.inertia * np.exp(0.3 * rng.normal())
        tasks.append(InertiaTask(robot, shape, weight=10 ** rng.uniform(-1, 1)))
    if rng.random() < 0.3:
        frames = [foot.frame for foot in robot.feet.values()]
        tasks.append(LoadShareTask(robot, dict(zip(frames, (1.0, 2.0), strict=True))))
        tasks.append(TorqueTask(robot))
    return tasks


def contacts_of(here: Snapshot, rng: np.random.Generator) -> list[Contact]:
    """Feet of some mode, their anchors where they are or off; now and then contradictory."""
    mode = str(rng.choice(["double", "double", "left", "right", "floating"]))
    contacts: list[Contact] = list(support(here, mode))
    if contacts and rng.random() < 0.2:  # two anchors for one foot
        one = contacts[-1]
        link = here.robot.model.frames[here.robot.frame_id(one.frame)].parentJoint
        names = [
            frame.name
            for frame in here.robot.model.frames
            if frame.parentJoint == link and frame.name in here.robot.frame_names
        ]
        other = next((name for name in names if name != one.frame), None)
        if other is not None:
            away = here.position(other) + 0.05 * rng.normal(size=3)
            contacts.append(
                Contact(
                    here.robot,
                    other,
                    away,
                    here.rotation(other),
                    corners=[[0.02, 0.02], [0.02, -0.02], [-0.02, 0.0]],
                )
            )
    return contacts


def disturbed(here: Snapshot, rng: np.random.Generator) -> Snapshot:
    """A state about one that stands: from nearly there to anywhere."""
    robot = here.robot
    size = 10 ** rng.uniform(-3, 0)
    q = robot.integrate(here.q, size * rng.normal(size=robot.nv), 1.0)
    return robot.snapshot(q, 10 ** rng.uniform(-1, 1) * size * rng.normal(size=robot.nv))


def refused(robot: Robot, controller: TorqueController, rng: np.random.Generator) -> bool:
    """Whether a state that is none is refused by a WbcError."""
    q, v = robot.posture("standing").copy(), np.zeros(robot.nv)
    which = rng.integers(4)
    if which < 2:
        (q, v)[which][rng.integers((q, v)[which].size)] = rng.choice([np.nan, np.inf])
    try:
        if which == 2:
            controller.step(None)  # type: ignore[arg-type]
        else:
            controller.step(robot.snapshot(q, v[:-1] if which == 3 else v))
    except WbcError:
        return True
    return False


def episode(
    robot: Robot,
    margins: SelfCollision,
    solver: str,
    rng: np.random.Generator,
    record: Record,
) -> None:
    """Run one controller: random states, or its own motion with pushes."""
    standing = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    there = disturbed(standing, rng)
    constraints = [margins] if rng.random() < 0.5 else []
    dt = float(rng.choice([0.001, 0.002, 0.005]))
    controller = TorqueController(
        robot,
        tasks_of(standing, rng),
        contacts=contacts_of(standing if rng.random() < 0.5 else there, rng),
        limits=Limits(robot),
        constraints=constraints,
        dt=dt,
        solver=solver,
    )
    closed = rng.random() < 0.5
    for k in range(EPISODE):
        if rng.random() < FAULTS:
            if refused(robot, controller, rng):
                record.faults += 1
            else:
                record.wrong("a state that is none was accepted")
        if rng.random() < 0.02:
            controller.set_contacts(contacts_of(there, rng), ramp=float(rng.choice([0.0, 0.05])))
        if not closed:
            there = disturbed(standing, rng)
        began = thread_time()
        tick = controller.step(there)
        spent = thread_time() - began
        torque, most = tick.torque, controller.torque_bounds
        record.ticks += 1
        record.policies[tick.policy or "solved"] += 1
        if k > 2:  # the first are about loading and planning
            qp = tick.qp
            size = f"{qp.g.size} unknowns, {qp.b.size} + {qp.u.size} rows"
            what = f"{tick.policy or 'solved'}, {size}, {tick.solution.iterations} iterations"
            record.timed.append(Timed(spent, what))
        if not (np.isfinite(torque).all() and np.isfinite(tick.velocity).all()):
            record.wrong("a command that is not finite: " + tick.report())
        elif (np.abs(torque) > most).any():
            record.wrong("a torque outside its bounds: " + tick.report())
        elif tick.policy == "damp" and len(record.examples) < 5:
            record.examples.append("damped: " + tick.report())
        if closed:
            v = tick.velocity + (rng.random() < 0.02) * rng.normal(size=robot.nv)
            v = np.clip(v, -50.0, 50.0)
            there = robot.snapshot(robot.integrate(there.q, v, dt), v)


def soak(name: str, solver: str, ticks: int, seed: list[int], runs: int) -> Record:
    """Run episodes until there are so many ticks, slow ones up to ``runs`` times."""
    robot, record = Robot.load(name), Record()
    margins = SelfCollision(robot, margin=0.01)
    rng = np.random.default_rng([*seed, sum(name.encode()), SOLVERS.index(solver)])
    while record.ticks < ticks:
        began = rng.bit_generator.state
        episodes: list[Record] = []
        while not episodes or (len(episodes) < runs and record.is_slow(episodes)):
            rng.bit_generator.state = began
            one = Record()
            try:
                episode(robot, margins, solver, rng, one)
            except WbcError as error:
                one.wrong(f"refused: {error}")
                one.ticks += 1
            except Exception:  # counted: that none comes is what is tested
                one.wrong(traceback.format_exc())
                one.ticks += 1
            gc.collect()
            episodes.append(one)
        record.add(episodes)
    return record


def parts_of(path: Path | None) -> Iterator[tuple[list[Any], Record]]:
    """Yield what a file keeps, by what each part is of; a line that was not ended is none."""
    lines = path.read_text().splitlines(keepends=True) if path and path.exists() else []
    for line in lines:
        if line.endswith("\n"):
            part, kept = json.loads(line)
            yield part, Record.read(kept)


def keep(path: Path, part: list[Any], record: Record) -> None:
    """Add a part to a file, on a line of its own whatever was cut off before."""
    data = path.read_bytes() if path.exists() else b""
    whole = data.rfind(b"\n") + 1
    if whole < len(data):
        path.write_bytes(data[:whole])
    with path.open("a") as file:
        file.write(json.dumps([part, vars(record)]) + "\n")


def main() -> None:
    """Soak each robot with each solver, and print what was seen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=10_000, help="per robot and solver")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--solver", nargs="+", default=list(SOLVERS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=4, help="of an episode, at most")
    parser.add_argument("--state", type=Path, help="parts are kept here, to go on after an end")
    options = parser.parse_args()
    gc.disable()  # between episodes only: a collection is no part of a tick
    kept, code = {tuple(part): record for part, record in parts_of(options.state)}, code_of()
    if others := sum(part[-1] != code for part in kept):
        print(f"{others} parts of {options.state} are of other code: left aside", file=sys.stderr)
    for name in options.robots:
        for solver in options.solver:
            record = Record()
            for k in range(-(-options.ticks // PART)):
                part = [name, solver, min(PART, options.ticks - k * PART), options.seed, k]
                part += [options.runs, code]
                one = kept.get(tuple(part))
                if one is None:
                    one = soak(name, solver, part[2], [options.seed, k], options.runs)
                    if options.state:
                        keep(options.state, part, one)
                    print(f"{name} {solver} {k}: {one.line()}", file=sys.stderr, flush=True)
                record.join(one)
            print(f"{name} {solver}: {record.line()}", flush=True)
            for example in record.examples:
                print(f"  {example}", flush=True)
            for tick in record.slowest(5):
                print(f"  {1e3 * tick.seconds:.2f} ms: {tick.what}", flush=True)


if __name__ == "__main__":
    main()
