"""Soak: closed loops under random faults, with every invariant of a tick checked independently.

Robots x QP backends x random tasks, weights over twelve decades, priorities, limits, margins;
contacts and targets switch, and every so often a fault is injected: NaN and infinities, wrong
sizes, complex or huge numbers, states outside the limits. It fails on an exception other than
WbcError, an accepted bad input, a command that is not finite or outside the limits' box, an
infeasible status of a QP that a linear program (HiGHS) finds feasible, a tick (snapshot and step)
of the default backend above 5 ms of CPU time, or growing resident memory.

An episode with slow ticks is run again, up to four times in all, and the least time of each tick
counts, since other processes share caches and cores. Python's garbage is collected between episodes
(40 ms).

    python benchmarks/soak.py [--ticks 1000000] [--seed 1] [--fresh]
    python benchmarks/soak.py --episode 123          # one episode again, printing all violations

Counts are saved in benchmarks/results/soak_SEED.json after every few episodes: a killed run
continues from there, and a finished run can be extended, by the same code. Seed and number
determine an episode.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise

import argparse
import gc
import json
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from time import monotonic, thread_time
from typing import Any

import numpy as np
from conflict_judge import can_hold
from sources import code_of

from wbc import (
    AxisTask,
    ComSupport,
    ComTask,
    DampingTask,
    DistanceTask,
    InertiaTask,
    KinematicController,
    Limits,
    MomentumTask,
    Obstacle,
    Obstacles,
    OrientationTask,
    PointContact,
    PoseTask,
    PositionBox,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    RelativePoseTask,
    SelfCollision,
    Tick,
    WbcError,
    support,
)
from wbc.constraints.contact import Contact
from wbc.qp.backend import installed_solvers
from wbc.qp.solution import Status
from wbc.robot import Robot, Snapshot
from wbc.tasks import Task

ROBOTS = ("g1", "hoap2_like", "talos", "icub", "romeo")
BACKENDS = ("proxqp", "active_set", "clarabel", "piqp", "osqp", "proxqp_cold")
# The default gets most of the ticks. OSQP takes 80 ms for one: at a hundredth of the ticks it would
# take a fifth of the time.
SHARES = (0.448, 0.15, 0.15, 0.15, 0.002, 0.1)
LENGTH = 100  # ticks of an episode
BOX_TOLERANCE = 1e-6  # a command may exceed its box by this [rad/s or m/s]
SLOW_TICK = 5e-3  # CPU time of a tick [s]
MAX_RUNS = 4  # at most, of an episode with slow ticks
WARM_UP, EVERY = 5_000, 250  # ticks of a process before its memory counts, and between samples
BLOCKS = 20  # of samples
GROWTH = 10.0  # MB per million ticks that are no growth
SAVE = 15.0  # between saves [s]
RESULTS = Path(__file__).parent / "results"
Rng = np.random.Generator


# ---------------------------------------------------------------------- what is counted


@dataclass
class Record:
    """All counts so far, and the code that made them; written to disk as it is."""

    seed: int
    code: str = field(default_factory=code_of)
    episodes: int = 0
    ticks: int = 0
    seconds: float = 0.0
    statuses: Counter[str] = field(default_factory=Counter)  # "backend status"
    faults: Counter[str] = field(default_factory=Counter)  # injected, by what came of them
    failures: Counter[str] = field(default_factory=Counter)
    examples: list[dict[str, Any]] = field(default_factory=list)
    slowest: list[list[Any]] = field(default_factory=list)  # ms, episode, tick, what
    times: Counter[str] = field(default_factory=Counter)  # "backend tenths of a millisecond"
    memory: list[list[list[float]]] = field(default_factory=list)  # per process: ticks, MB
    pending: list[list[Any]] = field(
        default_factory=list
    )  # of this episode: s, episode, tick, what

    def fail(self, kind: str, episode: int, tick: int, text: str) -> None:
        """Count a failure and keep the first of its kind."""
        self.failures[kind] += 1
        if self.failures[kind] <= 5:
            example = {"kind": kind, "episode": episode, "tick": tick, "text": text[-1500:]}
            self.examples.append(example)

    def took(self, seconds: float, episode: int, tick: int, what: str) -> None:
        """Note the CPU time of a tick; :meth:`book` counts it."""
        self.pending.append([seconds, episode, tick, what])

    def is_slow(self) -> bool:
        """Whether the episode has slow ticks."""
        return any(seconds > SLOW_TICK for seconds, *_ in self.pending)

    def run_again(self, other: "Record") -> None:
        """Take the lesser times of ``other``, a repetition of the same episode."""
        for own, again in zip(self.pending, other.pending, strict=True):
            own[0] = min(own[0], again[0])

    def book(self) -> None:
        """Count the times of the episode."""
        for seconds, episode, tick, what in self.pending:
            ms = 1e3 * seconds
            self.times[f"{what.split()[1]} {int(10.0 * ms)}"] += 1
            if seconds > SLOW_TICK:
                kind = "slow" if _by_default(what) else "slow, other backends (not a failure)"
                self.fail(kind, episode, tick, f"{ms:.1f} ms: {what}")
            self.slowest = sorted([*self.slowest, [ms, episode, tick, what]], reverse=True)[:10]
        self.pending = []

    @classmethod
    def read(cls, path: Path, seed: int) -> "Record":
        """Return the record of an earlier run, or a new one."""
        if not path.exists():
            return cls(seed)
        stored = {"code": "", **json.loads(path.read_text())}
        for name in ("statuses", "faults", "failures", "times"):
            stored[name] = Counter(stored[name])
        return cls(**stored)

    def write(self, path: Path) -> None:
        """Write in one step: a kill leaves this record or the one before."""
        path.parent.mkdir(exist_ok=True)
        draft = path.with_suffix(".new")
        draft.write_text(json.dumps(vars(self)))
        draft.replace(path)

    def percentile(self, share: float, backend: str = "") -> float:
        """Return this percentile of tick times [ms], of all ticks or of a backend's."""
        times: Counter[int] = Counter()
        for key, n in self.times.items():
            name, tenths = key.split()
            if backend in ("", name):
                times[int(tenths)] += n
        total, seen = times.total(), 0
        for tenth in sorted(times):
            seen += times[tenth]
            if seen >= share * total:
                return 0.1 * (tenth + 1)
        return 0.0

    def slow_share(self, backend: str) -> float:
        """Return the share of a backend's ticks that took more than 5 ms."""
        own = {int(key.split()[1]): n for key, n in self.times.items() if key.split()[0] == backend}
        return sum(n for tenth, n in own.items() if tenth >= 1e4 * SLOW_TICK) / max(
            sum(own.values()), 1
        )

    def report(self) -> str:
        """Return all counts in words."""
        lines = [f"{self.ticks} ticks in {self.episodes} episodes, {self.seconds:.0f} s"]
        names = sorted({key.split()[0] for key in self.statuses})
        for name in names:
            counts = {
                key.split()[1]: n
                for key, n in sorted(self.statuses.items())
                if key.split()[0] == name
            }
            lines.append(f"  {name:12s}" + "  ".join(f"{key} {n}" for key, n in counts.items()))
            p50, p99, most = (self.percentile(p, name) for p in (0.5, 0.99, 1.0))
            slow = f"{self.slow_share(name):.3%} above {1e3 * SLOW_TICK:g} ms"
            lines.append(f"    CPU time [ms]: 50% {p50:.1f}  99% {p99:.1f}  all {most:.1f}; {slow}")
        lines += [f"  injected: {key}: {n}" for key, n in sorted(self.faults.items())]
        times = "  ".join(f"{100 * p:g}% {self.percentile(p):.1f}" for p in (0.5, 0.99, 0.9999))
        lines.append(f"CPU time of a tick [ms]: {times}")
        lines += [f"  {ms:.1f} ms, episode {e} tick {t}: {w}" for ms, e, t, w in self.slowest[:5]]
        growth = self.growth()
        lines.append(
            "memory: too few ticks in one process to tell"
            if growth is None
            else f"memory: {growth[0]:+.1f} +- {growth[1]:.1f} MB per million ticks"
        )
        lines += [f"FAILED {kind}: {n}" for kind, n in sorted(self.failures.items())]
        for example in self.examples:
            lines.append("  {kind}, episode {episode} tick {tick}: {text}".format(**example))
        return "\n".join(lines)

    def growth(self) -> tuple[float, float] | None:
        """Return the slope of memory [MB per million ticks] after warm-up, and its uncertainty.

        The median increase from one block of samples of the longest process to the next: a leak
        shows in every block, a shape that is loaded late is a step in one of them.
        """
        series = [np.array(one) for one in self.memory if one]
        if not series:
            return None
        longest = max(series, key=len)
        ticks, size = longest[longest[:, 0] >= WARM_UP].T
        if ticks.size < 5 * BLOCKS:
            return None
        when = np.array([block.mean() for block in np.array_split(ticks * 1e-6, BLOCKS)])
        level = np.array([np.median(block) for block in np.array_split(size, BLOCKS)])
        slopes = np.diff(level) / np.diff(when)
        slope = float(np.median(slopes))
        return slope, float(3.7 * np.median(np.abs(slopes - slope)) / np.sqrt(BLOCKS))

    def failed(self) -> bool:
        """Whether a rule was broken, or memory grows significantly."""
        found = self.growth()
        grows = found is not None and found[0] - found[1] > GROWTH
        return grows or any("not a failure" not in kind for kind in self.failures)


def _by_default(what: str) -> bool:
    return BACKENDS[0] in what.split()


def resident() -> float:
    """Return the resident memory of this process [MB]; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") * 1e-6


# ---------------------------------------------------------------------- what is checked


def tick_violations(tick: Tick, box: tuple[np.ndarray, np.ndarray] | None) -> list[tuple[str, str]]:
    """Return the violations of a tick: kind and text."""
    wrong, v = [], tick.velocity
    if not np.isfinite(v).all():
        wrong.append(("not finite", f"{tick.report()}: {v}"))
    elif box is not None:
        excess = np.maximum(box[0] - v, v - box[1])
        if excess.max() > BOX_TOLERANCE:
            text = f"entry {excess.argmax()} by {excess.max():.3g}; {tick.report()}"
            wrong.append(("outside limits", text))
    if tick.status is Status.INFEASIBLE and can_hold(tick.qp):
        wrong.append(("feasible after all", tick.report()))
    return wrong


# ---------------------------------------------------------------------- random parts


@cache
def robot_named(name: str) -> Robot:
    return Robot.load(name)


@cache
def collision_of(name: str) -> SelfCollision:
    return SelfCollision(robot_named(name))


@cache
def ball_of(name: str) -> tuple[Obstacles, Obstacle]:
    ball = Obstacle.sphere("ball", np.zeros(3), 0.1)
    return Obstacles(robot_named(name), [ball]), ball


def decades(rng: Rng, low: float, high: float) -> float:
    """Return a number uniform in its logarithm, 10^low to 10^high."""
    return float(10.0 ** rng.uniform(low, high))


def unit(rng: Rng, size: int = 3) -> np.ndarray:
    v = rng.standard_normal(size)
    return v / np.linalg.norm(v)


def rotation(rng: Rng) -> np.ndarray:
    Q, R = np.linalg.qr(rng.standard_normal((3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q if np.linalg.det(Q) > 0.0 else -Q


def random_target(task: Task, here: Snapshot, rng: Rng) -> tuple[Any, ...]:
    """Return the arguments of ``task.set_target``: near, far or unreachable."""
    robot, away = here.robot, decades(rng, -3, 1)
    match task:
        case ComTask():
            return (
                here.com + away * unit(rng),
                away * unit(rng) if rng.random() < 0.2 else 0 * unit(rng),
            )
        case PositionTask():
            return (here.position(task.frame) + away * unit(rng),)
        case OrientationTask():
            return (rotation(rng),)
        case PoseTask():
            return here.position(task.frame) + away * unit(rng), rotation(rng)
        case RelativePoseTask():
            return away * unit(rng), rotation(rng)
        case AxisTask():
            return (away * unit(rng),)
        case InertiaTask():
            shape = np.diag(np.diag(here.inertia_in("base")) * np.exp(rng.normal(size=3)))
            return (shape,)
        case PrincipalInertiaTask():
            return (np.linalg.eigvalsh(here.inertia) * np.exp(rng.normal(scale=0.3, size=3)),)
        case MomentumTask():
            return (away * rng.standard_normal(6),)
        case DistanceTask():
            return (away,)
        case PostureTask():
            step = rng.standard_normal(robot.nv) * (np.arange(robot.nv) >= 6)
            return (robot.integrate(robot.posture("standing"), step, 1.0),)
    return ()


def random_task(kind: int, here: Snapshot, rng: Rng) -> Task:
    robot = here.robot
    frames = robot.frame_names
    frame, other = (frames[k] for k in rng.choice(len(frames), 2, replace=False))
    law: dict[str, Any] = {"weight": decades(rng, -6, 6) if rng.random() < 0.5 else 1.0}
    law |= {"gain": decades(rng, -3, 0), "priority": int(rng.choice(3, p=(0.7, 0.2, 0.1)))}
    if rng.random() < 0.2:
        law["lm_damping"] = decades(rng, -6, 2)
    if rng.random() < 0.2:
        law["singular_threshold"] = decades(rng, -4, 0)
    without_gain = {key: law[key] for key in law if key not in ("gain", "lm_damping")}
    eye, zero = np.eye(3), np.zeros(3)
    shape = here.inertia_in("base")
    makers: tuple[Callable[[], Task], ...] = (
        lambda: ComTask(robot, here.com, **law),
        lambda: PositionTask(robot, frame, zero, **law),
        lambda: OrientationTask(robot, frame, eye, **law),
        lambda: PoseTask(robot, frame, zero, eye, **law),
        lambda: RelativePoseTask(robot, frame, other, zero, eye, **law),
        lambda: AxisTask(robot, frame, (0, 0, 1), **law),
        lambda: InertiaTask(robot, shape, frame="base", second_order=bool(rng.integers(2)), **law),
        lambda: PrincipalInertiaTask(robot, np.linalg.eigvalsh(shape), **law),
        lambda: MomentumTask(robot, **without_gain),
        lambda: DistanceTask(robot, frame, other, 0.1, **law),
        lambda: PostureTask(robot, robot.posture("standing"), **law),
        lambda: DampingTask(robot, weight=law["weight"], priority=law["priority"]),
    )
    task = makers[kind]()
    target = random_target(task, here, rng)
    if target:
        task.set_target(*target)
    return task


def random_contacts(here: Snapshot, rng: Rng) -> tuple[Contact, ...]:
    robot = here.robot
    held = support(
        here, str(rng.choice(("floating", "left", "right", "double"), p=(0.2, 0.2, 0.2, 0.4)))
    )
    if rng.random() < 0.15:
        frame = str(rng.choice([name for name in robot.frame_names if "sole" not in name]))
        if all(contact.frame != frame for contact in held):
            kind = PointContact if rng.random() < 0.5 else Contact
            held = (*held, kind.hold(here, frame))
    return held


def random_limits(robot: Robot, rng: Rng) -> Limits | None:
    if rng.random() < 0.05:
        return None
    return Limits(
        robot,
        velocity=decades(rng, -1, 0.5) if rng.random() < 0.3 else 1.0,
        acceleration=decades(rng, 0, 2) if rng.random() < 0.3 else None,
        braking="bounded" if rng.random() < 0.25 else "free",
        base_twist=np.full(6, decades(rng, -1, 1)) if rng.random() < 0.3 else None,
        recovery=float(rng.uniform(0.05, 1.0)),
    )


def random_state(robot: Robot, rng: Rng, spread: float = 0.3) -> np.ndarray:
    """Return a configuration (nq,) around standing, mostly inside the limits."""
    step = np.zeros(robot.nv)
    step[6:] = spread * rng.standard_normal(robot.nv - 6)
    q = robot.integrate(robot.posture("standing"), step, 1.0)
    return q if rng.random() < 0.1 else robot.limits.clamped(q)


class Episode:
    """One closed loop, determined by the seed and the number."""

    def __init__(self, record: Record, seed: int, number: int, aloud: bool = False) -> None:
        self.record, self.number, self.aloud = record, number, aloud
        self.rng = rng = np.random.default_rng((seed, number))
        self.robot = robot = robot_named(str(rng.choice(ROBOTS)))
        self.solver = str(rng.choice(BACKENDS, p=SHARES))
        self.q, self.v = random_state(robot, rng), np.zeros(robot.nv)
        here = robot.snapshot(self.q)
        kinds = rng.choice(12, size=int(rng.integers(1, 6)), replace=False)
        self.tasks = [random_task(int(kind), here, rng) for kind in kinds]
        self.tasks.append(
            DampingTask(
                robot, name="rest", weight=decades(rng, -4, 0), priority=int(rng.integers(2))
            )
        )
        contacts = random_contacts(here, rng)
        self.limits = random_limits(robot, rng)
        self.ball = None
        constraints: list[Any] = []
        if rng.random() < 0.3:
            constraints.append(collision_of(robot.name))
        if rng.random() < 0.15:
            obstacles, self.ball = ball_of(robot.name)
            self.ball.move(np.eye(3), (1.0, 0.0, 1.0))  # another episode left it elsewhere
            constraints.append(obstacles)
        if rng.random() < 0.2:
            constraints.append(ComSupport.over(here))
        if rng.random() < 0.2:
            size = decades(rng, -2, 0)
            middle = here.position("base") + 0.5 * size * unit(rng)
            constraints.append(PositionBox(robot, "base", middle - size, middle + size))
        slack = {part.name: decades(rng, -2, 6) for part in constraints if rng.random() < 0.15}
        slack |= {contact.name: decades(rng, -2, 6) for contact in contacts if rng.random() < 0.1}
        self.soft = set(slack)
        self.dt = decades(rng, -3.3, -1.5)
        self.controller = KinematicController(
            robot,
            self.tasks,
            contacts=contacts,
            limits=self.limits,
            constraints=constraints,
            slack=slack,
            dt=self.dt,
            solver=self.solver,
            damping=decades(rng, -8, -2) if rng.random() < 0.3 else 1e-6,
            joint_weights={"*": decades(rng, -2, 2)} if rng.random() < 0.2 else None,
            on_failure=str(rng.choice(("hold", "damp", "closest"))),
        )

    def run(self, ticks: int = LENGTH) -> None:
        """Run the loop."""
        for k in range(ticks):
            self.k = k
            if self.rng.random() < 0.03:
                self._switch()
            if self.rng.random() < 0.05:
                self._retarget()
            if self.rng.random() < 0.05:
                self._fault()
            self._tick()
        self.record.episodes += 1

    def _what(self) -> str:
        return f"{self.robot.name} {self.solver}"

    def _fail(self, kind: str, text: str) -> None:
        if self.aloud:
            print(f"tick {self.k} of {self._what()}: {kind}: {text}")
        self.record.fail(kind, self.number, self.k, f"{self._what()}: {text}")

    def _tick(self) -> None:
        robot, record = self.robot, self.record
        start = thread_time()
        try:
            here = robot.snapshot(self.q, self.v)
            tick = self.controller.step(here)
        except WbcError as error:
            record.statuses[f"{self.solver} refused"] += 1
            self._fail("state refused", f"{type(error).__name__}: {error}")
            self._restart()
            return
        except Exception:
            self._fail("untyped", traceback.format_exc())
            self._restart()
            return
        spent = thread_time() - start
        record.ticks += 1
        status = tick.status.value
        record.statuses[f"{self.solver} {status}"] += 1
        if tick.left_out:
            record.statuses[f"{self.solver} something_left_out"] += 1
        what = f"{self._what()} {status}, {len(self.controller.plan.levels)} levels, "
        what += f"{len(tick.qp.l)} rows, attempts {tick.solution.attempts}"
        what += f", solver {1e3 * tick.times.solve:.1f} ms wall"
        record.took(spent, self.number, self.k, what)
        if self.aloud and (spent > SLOW_TICK or not tick.ok):
            print(f"tick {self.k}: {1e3 * spent:.1f} ms, {what}: {tick.report()}")
        limits = self.limits
        box = None if limits is None else limits.emergency_braking_box(here, self.dt)
        if limits is not None and limits.braking == "free":
            box = limits.box(here, self.dt)
        for kind, text in tick_violations(tick, box):
            self._fail(kind, text)
        v = tick.velocity
        if not np.isfinite(v).all() or np.abs(v).max() > 1e3:  # no limits, huge weights
            self._restart()
            return
        self.q, self.v = robot.integrate(self.q, v, self.dt), v

    def _restart(self) -> None:
        self.q, self.v = random_state(self.robot, self.rng), np.zeros(self.robot.nv)
        self._switch(all_of_it=True)

    def _switch(self, all_of_it: bool = False) -> None:
        """Hold other frames, at their current poses."""
        here = self.robot.snapshot(self.q)
        contacts = random_contacts(here, self.rng)
        known = {contact.name for contact in self.controller.contacts}
        if self.soft & known:  # slacks name contacts: these stay, and are held where they are
            contacts = tuple(type(one).hold(here, one.frame) for one in self.controller.contacts)
        try:
            self.controller.set_contacts(contacts)
        except Exception:
            self._fail("untyped", traceback.format_exc())

    def _retarget(self) -> None:
        here = self.robot.snapshot(self.q)
        task = self.tasks[int(self.rng.integers(len(self.tasks)))]
        target = random_target(task, here, self.rng)
        if target:
            task.set_target(*target)
        if self.rng.random() < 0.3:
            task.weight = decades(self.rng, -6, 6)
        if self.ball is not None:
            place = here.com + decades(self.rng, -1.5, 0.5) * unit(self.rng)
            self.ball.move(np.eye(3), place, self.rng.standard_normal(3))

    # ------------------------------------------------------------------ faults

    def _fault(self) -> None:
        """Inject a bad input and check the result."""
        faults = (self._bad_state, self._bad_target, self._bad_part, self._far_state)
        fault = faults[int(self.rng.choice(4, p=(0.4, 0.3, 0.1, 0.2)))]
        fault()

    def _expect_refusal(self, name: str, deed: Callable[[], Any], value: Any) -> None:
        """Expect a WbcError, or a sound result if the value is only large."""
        try:
            deed()
        except WbcError:
            self.record.faults[f"{name}, refused"] += 1
        except Exception:
            self._fail("untyped", f"{name}, {value!r}: {traceback.format_exc()}")
        else:
            self.record.faults[f"{name}, accepted"] += 1
            if not is_valid(value):
                self._fail("accepted", f"{name}: {value!r}")

    def _bad_state(self) -> None:
        rng = self.rng
        q, v = self.q.copy(), self.v.copy()
        if rng.random() < 0.5:
            bad = corrupted(q, rng, entries=(0, 1, 2, *range(7, q.size)))
            self._expect_refusal("configuration", lambda: self._step(bad, v), bad)
        else:
            bad = corrupted(v, rng)
            self._expect_refusal("velocity", lambda: self._step(q, bad), bad)

    def _step(self, q: Any, v: Any) -> None:
        """Take one tick outside the loop and check its result."""
        here = self.robot.snapshot(q, v)
        tick = self.controller.step(here)
        box = None if self.limits is None else self.limits.emergency_braking_box(here, self.dt)
        for kind, text in tick_violations(tick, box):
            self._fail(kind, f"after a fault: {text}")

    def _bad_target(self) -> None:
        task = self.tasks[int(self.rng.integers(len(self.tasks)))]
        target = random_target(task, self.robot.snapshot(self.q), self.rng)
        place = int(self.rng.integers(len(target) + 1))
        if place == len(target):
            before = task.weight
            bad = corrupted(before, self.rng)
            self._expect_refusal("weight", lambda: self._with_weight(task, bad), bad)
            task.weight = before
            return
        bad = corrupted(np.asarray(target[place], dtype=float), self.rng)
        given = [*target[:place], bad, *target[place + 1 :]]
        self._expect_refusal("target", lambda: self._with_target(task, given), bad)
        task.set_target(*target)

    def _with_weight(self, task: Task, bad: Any) -> None:
        task.weight = bad
        self._step(self.q, self.v)

    def _with_target(self, task: Task, given: list[Any]) -> None:
        task.set_target(*given)
        self._step(self.q, self.v)

    def _bad_part(self) -> None:
        rng, controller = self.rng, self.controller
        junk = (None, "double", 1.0, [None], ["left"], np.zeros(3), controller.limits, object())
        one = junk[int(rng.integers(len(junk)))]
        if rng.random() < 0.5:
            self._expect_refusal("contacts", lambda: controller.set_contacts(one), one)
        else:
            self._expect_refusal("snapshot", lambda: controller.step(one), one)

    def _far_state(self) -> None:
        """Continue from a state outside the limits, or moving fast."""
        robot, rng = self.robot, self.rng
        step = np.zeros(robot.nv)
        some = 6 + rng.choice(robot.nv - 6, size=int(rng.integers(1, 5)), replace=False)
        step[some] = decades(rng, -4, 0.3) * rng.standard_normal(some.size)
        if rng.random() < 0.5:
            self.q = robot.integrate(self.q, step, 1.0)
        if rng.random() < 0.5:
            self.v = self.v + decades(rng, -2, 1.5) * rng.standard_normal(robot.nv)
        self.record.faults["state outside limits, gone on from"] += 1


def corrupted(good: np.ndarray, rng: Rng, entries: tuple[int, ...] | None = None) -> Any:
    """Return a corrupted version of ``good``."""
    values = (np.nan, np.inf, -np.inf, 1e12, 1e60, -1e60, 1e140, 1e160, 1e300)
    kind = int(rng.integers(8))
    if kind < 4 and good.size:
        bad = np.array(good, dtype=float)
        flat = bad.reshape(-1)
        flat[int(rng.choice(np.arange(good.size) if entries is None else np.array(entries)))] = (
            values[int(rng.integers(len(values)))]
        )
        return bad
    every = (
        lambda: good.astype(complex) + 1e-3j,
        (good + 0j).tolist,
        lambda: np.concatenate((np.ravel(good), (0.0,))),
        lambda: np.ravel(good)[:-1],
        lambda: np.array([str(x) + "?" for x in np.ravel(good)]),
        lambda: "x",
        lambda: [[1.0], [2.0, 3.0]],
        lambda: np.array([None] * max(good.size, 1)),
        dict,
        object,
        lambda: np.full((2, 2, 2), 1.0),
        lambda: 10**400,
    )
    return every[int(rng.integers(len(every)))]()


def is_valid(value: Any) -> bool:
    """Whether ``value`` is valid after all: real, finite numbers."""
    if not isinstance(value, np.ndarray):
        return False
    array = np.asarray(value)
    return array.dtype.kind == "f" and bool(np.isfinite(array).all())


# ---------------------------------------------------------------------- the run


def run_episode(record: Record, number: int, ticks: int, aloud: bool = False) -> None:
    """Run an episode, repeat it while ticks are slow, and count it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Episode(record, record.seed, number, aloud).run(ticks)
        for _ in range(MAX_RUNS - 1):
            if not record.is_slow():
                break
            again = Record(record.seed)
            gc.collect()
            Episode(again, record.seed, number).run(ticks)
            record.run_again(again)
    record.book()
    gc.collect()


def soak(record: Record, ticks: int, save: Callable[[], None] = lambda: None) -> None:
    """Run episodes up to this number of ticks."""
    samples: list[list[float]] = []
    record.memory.append(samples)
    began, before, own = monotonic(), record.seconds, record.ticks
    saved = began
    gc.disable()
    try:
        while record.ticks < ticks:
            run_episode(record, record.episodes, min(LENGTH, ticks - record.ticks))
            if not samples or record.ticks - own - samples[-1][0] >= EVERY:
                samples.append([record.ticks - own, resident()])
            record.seconds = before + monotonic() - began
            if monotonic() - saved > SAVE:
                saved = monotonic()
                save()
    finally:
        gc.enable()
    save()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fresh", action="store_true", help="forget what was counted before")
    parser.add_argument("--episode", type=int, help="run only this one, and say what is wrong")
    options = parser.parse_args()
    missing = [name for name in BACKENDS if name not in installed_solvers()]
    if missing:
        sys.exit(f"not installed: {', '.join(missing)}; pip install 'wbc[bench]'")
    if options.episode is not None:
        record = Record(options.seed)
        gc.disable()
        run_episode(record, options.episode, LENGTH, aloud=True)
        print(record.report())
        sys.exit(record.failed())
    path = RESULTS / f"soak_{options.seed}.json"
    record = Record(options.seed) if options.fresh else Record.read(path, options.seed)
    if record.code != code_of():
        sys.exit(f"{path} was counted with other code; --fresh forgets it")
    if record.ticks:
        print(f"going on after {record.ticks} ticks, as {path} says")
    soak(record, options.ticks, lambda: record.write(path))
    print(record.report())
    sys.exit(record.failed())


if __name__ == "__main__":
    main()
