"""Where a velocity tick with ProxQP goes: the round of the loop, and its solver by itself.

A G1 on both feet follows its CoM, trunk and inertia, as in benchmarks/peers. The loop runs twice:
as it is, and with clocks around its functions, of which each is told what it takes without those
that it calls; what the clocks themselves take is measured and taken off. The QPs of the ticks are
recorded, and solved once more in the same order: by ProxQP alone, its update and its solve apart,
with the settings of this package and with its own, with and without the contacts' rows; and by
DAQP. Thread CPU time, medians and fifth percentiles in us.

ProxQP is only asked where a bound is active: with --speed no joint may be faster than that [rad/s].

    python benchmarks/proxqp_tick.py [--ticks 1000] [--plain] [--speed 0.1]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import cached_property
from inspect import getattr_static
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from wbc.controllers.native_memory import NativeMemory
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.native_tick import NativeController

import wbc
from wbc.qp import QP, ProxQP, native
from wbc.qp.active_set import ActiveSet
from wbc.qp.elimination import eliminate
from wbc.qp.kkt import SolveCheck
from wbc.qp.problem import check_qp
from wbc.qp.proxqp_workspace import DEFAULTS, Workspace
from wbc.rotations import exp_rotation

DT, WARM_UP, EPS = 0.005, 100, 1e-8
Times = dict[str, list[float]]
# Functions of a round, by what they are for.
WATCHED: tuple[tuple[str, Any, str], ...] = (
    ("targets set", wbc.ComTask, "set_target"),
    ("targets set", wbc.OrientationTask, "set_target"),
    ("targets set", wbc.InertiaTask, "set_target"),
    ("snapshot", wbc.Robot, "snapshot"),
    ("integration", wbc.Robot, "integrate"),
    ("whose snapshot, and which path", wbc.KinematicController, "step"),
    ("whose snapshot, and which path", NativeController, "_step"),
    ("what changed, written to the core", NativePlan, "_write"),
    ("what is asked of whom, and the answer as an object", NativePlan, "problem"),
    ("the core sets up the QP, contacts eliminated", NativeMemory, "call"),
    ("the core's arrays as a QP", NativeMemory, "reduced"),
    ("which workspace", ProxQP, "solve_for"),
    ("ProxQP: loaded and solved", native.Workspace, "run"),
    ("the core expands the answer and judges it", NativeMemory, "takes"),
    ("the tick as an object", NativeController, "_native_tick"),
)


class Clocks:
    """Clocks around functions; each function's own time, without those inside it.

    Attributes
    ----------
    own, calls, inside:
        By name, since :meth:`take`: time, calls, and calls of others from there.
    """

    def __init__(self) -> None:
        self._open = [("", 0.0)]
        self.own: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self.inside: dict[str, int] = defaultdict(int)
        # Of a call: what is told of it, and of who called it.
        self._told, self._caller = 0.0, 0.0
        self._calibrate()

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return ``function`` with a clock around it."""

        def timed(*given: Any, **named: Any) -> Any:
            self._open.append((name, 0.0))
            begin = thread_time()
            try:
                return function(*given, **named)
            finally:
                spent = thread_time() - begin
                _, within = self._open.pop()
                self.own[name] += spent - within
                self.calls[name] += 1
                caller, other = self._open[-1]
                self._open[-1] = caller, other + spent
                self.inside[caller] += 1

        return timed

    def take(self) -> dict[str, float]:
        """Return each name's own time less the clocks', and begin anew."""
        told = {
            name: own - self.calls[name] * self._told - self.inside[name] * self._caller
            for name, own in self.own.items()
        }
        for counted in (self.own, self.calls, self.inside):
            counted.clear()
        return told

    def _calibrate(self) -> None:
        nothing = self.around("nothing", lambda: None)
        every = self.around("every", lambda: [nothing() for _ in range(100)])
        found = []
        for _ in range(100):
            every()
            found.append((self.own["nothing"] / 100, self.own["every"] / 100))
            self.take()
        self._told, self._caller = np.median(found, axis=0).tolist()


class Job(NamedTuple):
    """Of a loop: its rounds, whether the inertia is a task, and how fast joints may be [rad/s]."""

    ticks: int
    inertia: bool
    speed: float | None  # None: as fast as they are


def watched(job: Job, times: Times) -> None:
    """Run the loop with clocks around its functions."""
    clocks = Clocks()
    before = [(label, owner, name, getattr_static(owner, name)) for label, owner, name in WATCHED]
    for label, owner, name, plain in before:
        if isinstance(plain, cached_property):
            made = cached_property(clocks.around(label, plain.func))
            made.__set_name__(owner, name)
            setattr(owner, name, made)
        else:
            setattr(owner, name, clocks.around(label, plain))
    parts: list[dict[str, float]] = []
    try:
        rounds(job, defaultdict(list), lambda: parts.append(clocks.take()))
    finally:
        for _, owner, name, plain in before:
            setattr(owner, name, plain)
    for label in dict.fromkeys(label for label, _, _ in WATCHED):
        times[f"  {label}"] = [part.get(label, 0.0) for part in parts[WARM_UP:]]


def rounds(job: Job, times: Times, after: Callable[[], None] = lambda: None) -> list[QP]:
    """Run the loop, note how long its rounds take, and return its QPs.

    ``after`` is called after each round.
    """
    robot = wbc.Robot.load("g1")
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    start = robot.snapshot(q)
    com, trunk = start.com, start.rotation("torso_link")
    tasks: list[Any] = [
        wbc.ComTask(robot, com, weight=10.0, gain=1.0),
        wbc.OrientationTask(robot, "torso_link", trunk, weight=1.0, gain=1.0),
        wbc.PostureTask(robot, q, weight=0.1, gain=1.0),
    ]
    if job.inertia:
        tasks.append(wbc.InertiaTask(robot, start.inertia, per_mass=True, gain=0.2))
    limits = wbc.Limits(robot)
    if job.speed is not None:
        limits.speed = job.speed
    controller = wbc.KinematicController(
        robot,
        tasks,
        contacts=wbc.support(start, "double"),
        limits=limits,
        dt=DT,
        solver="proxqp",
    )
    qps = []
    for k in range(WARM_UP + job.ticks):
        t = k * DT
        wave = np.array([0.01, 0.02, -0.01]) * np.sin(2 * np.pi * np.array([0.5, 0.25, 0.4]) * t)
        turned = trunk @ exp_rotation(np.array([0.0, 0.1, 0.2]) * np.sin(t))
        shape = start.inertia * (1 + 0.05 * np.sin(np.pi * t))
        begin = thread_time()
        tasks[0].set_target(com + wave)
        tasks[1].set_target(turned)
        if job.inertia:
            tasks[3].set_target(shape)
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity
        q = robot.integrate(q, v, DT)
        spent = thread_time() - begin
        after()
        if k >= WARM_UP:
            times["round"].append(spent)
            qps.append(tick.qp)
    return qps


def bare(qps: Sequence[QP], name: str, times: Times, **settings: Any) -> None:
    """Solve by ProxQP alone, warm from the last QP, and note update, solve and its iterations."""
    work = Workspace.create(qps[0], EPS, 20, **settings)
    work.solve_cold()
    native, scale = work.native, work.scale
    for qp in qps[1:]:
        P, g = scale * qp.P, scale * qp.g
        begin = thread_time()
        native.update(P, g, qp.A, qp.b, qp.C, qp.l, qp.u, qp.lower, qp.upper, False)
        middle = thread_time()
        native.solve()
        end = thread_time()
        times[f"{name}: update"].append(middle - begin)
        times[f"{name}: solve"].append(end - middle)


def parts(qps: Sequence[QP], times: Times) -> None:
    """Note what is around the solver, and the active-set method on the same QPs."""
    work = Workspace.create(qps[0], EPS, 20)
    work.solve_cold()
    check = SolveCheck("proxqp", EPS, 0.0)

    def timed(name: str, call: Callable[..., Any], *given: Any) -> Any:
        begin = thread_time()
        found = call(*given)
        times[name].append(thread_time() - begin)
        return found

    for qp in qps[1:]:
        timed("check of the QP", check_qp, qp)
        raw = timed("update, solve, and results read", work.solve_warm, qp)
        timed("residuals and verdict", check.accept, qp, raw)
        timed("the core's active-set method", ActiveSet(EPS).solve, qp)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1000)
    parser.add_argument("--plain", action="store_true", help="without the inertia task")
    parser.add_argument("--speed", type=float, help="of joints [rad/s]; else as fast as they are")
    options = parser.parse_args()
    times: Times = defaultdict(list)
    job = Job(options.ticks, not options.plain, options.speed)
    qps = rounds(job, times)
    watched(job, times)
    reduced = [eliminate(qp).reduced for qp in qps]
    qps = [qp for qp, less in zip(qps, reduced, strict=True) if less.g.size == reduced[0].g.size]
    parts(qps, times)
    bare(qps, "ProxQP", times)
    bare(qps, "ProxQP, its own settings", times, **DEFAULTS)
    bare(reduced, "ProxQP, contacts eliminated", times)
    print(f"{qps[0]}; eliminated: {reduced[0]}")
    for name, spent in times.items():
        p5, p50 = np.percentile(spent, (5, 50)) * 1e6
        print(f"{name:40s} {p50:7.1f} {p5:7.1f}")


if __name__ == "__main__":
    main()
