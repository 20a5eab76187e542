"""Bodies thrown at each other by torques: are margins kept, with rows for few pairs?

Random postures are asked for at a stiffness that no tick can follow, without contacts (all joints)
or standing (arms and waist). All pairs are measured after every tick: one is broken that ends in a
tick further inside its margin than it began.

    python benchmarks/thrown.py [--ticks 900] [--robots g1 talos] [--pairs 5 25] [--timed 2000]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from time import thread_time

import numpy as np

from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import TorqueController
from wbc.robot import Robot
from wbc.tasks import ComTask, PostureTask

DT, TURN = 0.002, 60  # s; ticks for each target
STIFFNESS, REACH = 2000.0, 3.0  # 1/s^2; rad
INSIDE, ROUNDING = 1.5e-4, 1e-7  # m
LEGS = ("hip", "knee", "ankle", "leg")


def controller_of(robot: Robot, stands: bool, margins: SelfCollision) -> TorqueController:
    """Return a controller whose last task is the posture that bodies are thrown by."""
    here = robot.snapshot(robot.posture("standing"))
    tasks = [ComTask(robot, here.com, weight=10.0)] if stands else []
    posture = PostureTask(robot, here.q, kp=STIFFNESS)
    contacts = support(here, "double") if stands else ()
    kept = {"limits": Limits(robot), "constraints": [margins]}
    options = {"contacts": contacts, "dt": DT, "solver": "daqp", **kept}
    return TorqueController(robot, [*tasks, posture], **options)


def thrown(name: str, stands: bool, pairs: int, ticks: int, seed: int) -> str:
    """Return what was seen of one robot."""
    robot, rng = Robot.load(name), np.random.default_rng(seed)
    margins = SelfCollision(robot, pairs=pairs)
    judge = SelfCollision(robot, pairs=len(margins.margins))
    controller = controller_of(robot, stands, margins)
    posture = controller.tasks[-1]
    lower, upper = (np.clip(end, -REACH, REACH) for end in (robot.limits.lower, robot.limits.upper))
    moved = np.array([not (stands and any(leg in j for leg in LEGS)) for j in robot.joint_names])
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    standing, began = q.copy(), judge.distances(robot.snapshot(q)).clearance
    broken = relaxed = larger = 0
    worst = fastest = away = 0.0
    for k in range(ticks):
        if k % TURN == 0:
            target = standing.copy()
            target[7:] = np.where(moved, rng.uniform(lower, upper), standing[7:])
            posture.set_target(target)
        tick = controller.step(robot.snapshot(q, v))
        relaxed += tick.policy is not None
        larger += sum(" vs " in label for label in tick.qp.labels.inequality) > pairs
        v = tick.velocity
        q = robot.integrate(q, v, DT)
        now = judge.distances(robot.snapshot(q)).clearance
        inside = (now < -INSIDE) & (now < began - ROUNDING)
        broken += int(inside.sum())
        worst = max(worst, -float(now[inside].min(initial=0.0)))
        fastest, began = max(fastest, float(np.abs(v[6:]).max())), now
        away = max(away, *tick.displaced.values(), 0.0)
    support_kind = "double" if stands else "none"
    return (
        f"{name:12s}{support_kind:8s}{pairs:5d} of{len(began):5d}{ticks:7d}{broken:8d}"
        f"{1e3 * worst:10.2f}{relaxed:9d}{larger:8d}{fastest:10.1f}{1e3 * away:9.2f}"
    )


def times(name: str, ticks: int) -> None:
    """Ticks of a robot that stands and moves its arms, with and without self-collision."""
    robot = Robot.load(name)
    q = robot.posture("standing")
    for speed in (0.0, 1.0):  # rad/s of all joints
        snapshot = [robot.snapshot(q, np.r_[np.zeros(6), speed * np.ones(robot.nv - 6)])] * ticks
        controller, spent = controller_of(robot, True, SelfCollision(robot)), []
        for here in snapshot:
            start = thread_time()
            controller.step(here)
            spent.append(thread_time() - start)
        low, median = np.percentile(spent, (10, 50)) * 1e6
        print(f"{name}, {speed:.0f} rad/s: tick {median:.1f} us, tenth percentile {low:.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=900)
    parser.add_argument("--timed", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=("g1", "talos", "hoap2_like"))
    parser.add_argument("--pairs", nargs="+", type=int, default=(5, 25))
    options = parser.parse_args()
    print(
        f"{'robot':12s}{'support':8s}{'pairs':>13s}{'ticks':>7s}{'broken':>8s}{'worst mm':>10s}",
        end="",
    )
    print(f"{'relaxed':>9s}{'larger':>8s}{'rad/s':>10s}{'feet mm':>9s}")
    for name in options.robots if options.ticks else ():
        for stands in (False, True):
            for pairs in options.pairs:
                print(thrown(name, stands, pairs, options.ticks, options.seed), flush=True)
    if options.timed:
        times("g1", options.timed)


if __name__ == "__main__":
    main()
