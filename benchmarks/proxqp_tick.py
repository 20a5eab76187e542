"""Where a velocity tick with ProxQP goes: the round of the loop, and its solver by itself.

A G1 on both feet follows its CoM, trunk and inertia, as in benchmarks/peers. The QPs of the ticks
are recorded, and solved once more in the same order: by ProxQP alone, its update and its solve
apart, with the settings of this package and with its own, with and without the contacts' rows; and
by DAQP. Thread CPU time, medians and fifth percentiles in us.

    python benchmarks/proxqp_tick.py [--ticks 1000] [--plain]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections import defaultdict
from collections.abc import Callable, Sequence
from time import thread_time
from typing import Any

import numpy as np

import wbc
from wbc.qp import QP
from wbc.qp.daqp_memory import daqp_memory
from wbc.qp.elimination import eliminate
from wbc.qp.kkt import SolveCheck
from wbc.qp.native import DEFAULTS, Workspace
from wbc.qp.problem import check_qp
from wbc.rotations import exp_rotation

DT, WARM_UP, EPS = 0.005, 100, 1e-8
Times = dict[str, list[float]]


def rounds(ticks: int, inertia: bool, times: Times) -> list[QP]:
    """Run the loop, note how long its rounds take, and return its QPs."""
    robot = wbc.Robot.load("g1")
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    start = robot.snapshot(q)
    com, trunk = start.com, start.rotation("torso_link")
    tasks: list[Any] = [
        wbc.ComTask(robot, com, weight=10.0, gain=1.0),
        wbc.OrientationTask(robot, "torso_link", trunk, weight=1.0, gain=1.0),
        wbc.PostureTask(robot, q, weight=0.1, gain=1.0),
    ]
    if inertia:
        tasks.append(wbc.InertiaTask(robot, start.inertia, per_mass=True, gain=0.2))
    controller = wbc.KinematicController(
        robot,
        tasks,
        contacts=wbc.support(start, "double"),
        limits=wbc.Limits(robot),
        dt=DT,
        solver="proxqp",
    )
    qps = []
    for k in range(WARM_UP + ticks):
        t = k * DT
        wave = np.array([0.01, 0.02, -0.01]) * np.sin(2 * np.pi * np.array([0.5, 0.25, 0.4]) * t)
        turned = trunk @ exp_rotation(np.array([0.0, 0.1, 0.2]) * np.sin(t))
        shape = start.inertia * (1 + 0.05 * np.sin(np.pi * t))
        begin = thread_time()
        tasks[0].set_target(com + wave)
        tasks[1].set_target(turned)
        if inertia:
            tasks[3].set_target(shape)
        tick = controller.step(robot.snapshot(q, v))
        v = tick.velocity
        q = robot.integrate(q, v, DT)
        spent = thread_time() - begin
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
    """Note what is around the solver, and DAQP on the same QPs."""
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
        timed("DAQP", daqp_memory(qp, EPS, 1000).solve)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1000)
    parser.add_argument("--plain", action="store_true", help="without the inertia task")
    options = parser.parse_args()
    times: Times = defaultdict(list)
    qps = rounds(options.ticks, not options.plain, times)
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
