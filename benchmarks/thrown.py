"""Limbs thrown at each other, or at obstacles, by torques: do margins hold with few rows?

Random target postures at a stiffness that no tick can follow, without contacts (all joints),
standing (arms and waist), or standing among balls within reach of the arms. All pairs are measured
after every tick: a margin counts as broken if its violation grew in a tick.

    python benchmarks/thrown.py [--ticks 900] [--robots g1] [--among balls] [--pairs 5 25]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from time import thread_time

import numpy as np

from wbc.constraints import Limits, Obstacles, SelfCollision, support
from wbc.constraints.margin import Margin
from wbc.controllers import TorqueController
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel, Obstacle
from wbc.tasks import ComTask, PostureTask
from wbc.validate import Array

DT, TURN = 0.002, 60  # s; ticks for each target
STIFFNESS, REACH = 2000.0, 3.0  # 1/s^2; rad
INSIDE, ROUNDING = 1.5e-4, 1e-7  # m
LEGS = ("hip", "knee", "ankle", "leg")
AMONG = ("nothing", "feet", "balls")
BALLS, RADIUS, ROOM = 20, 0.05, 0.08  # m: of balls, and round them at the start


def balls_of(robot: Robot, rng: np.random.Generator) -> list[Obstacle]:
    """Return balls within reach of the arms, none of them near the standing robot."""
    q = robot.posture("standing")
    here, model = robot.snapshot(q), SelfCollision(robot).model
    found: list[Obstacle] = []
    while len(found) < BALLS:
        there = middles_of(model, robot.snapshot(random_posture(robot, q, rng, True)))
        moved = np.flatnonzero(np.abs(there - middles_of(model, here)).max(axis=1) > ROOM)
        ball = Obstacle.sphere(f"ball {len(found)}", there[rng.choice(moved)], RADIUS)
        if Obstacles(robot, [ball], margin=ROOM).distances(here).clearance.min() > 0.0:
            found.append(ball)
    return found


def middles_of(model: CollisionModel, here: Snapshot) -> Array:
    """Return the middles of all bodies (bodies, 3) [m], world axes."""
    R, p = here.joint_placements
    return np.array([R[one.joint] @ one.bounding_ball[0] + p[one.joint] for one in model.bodies])


def random_posture(robot: Robot, q: Array, rng: np.random.Generator, stands: bool) -> Array:
    """Return a random posture; for a standing robot only arms and waist are random."""
    target = q.copy()
    lower, upper = (np.clip(end, -REACH, REACH) for end in (robot.limits.lower, robot.limits.upper))
    moved = np.array([not (stands and any(leg in j for leg in LEGS)) for j in robot.joint_names])
    target[7:] = np.where(moved, rng.uniform(lower, upper), q[7:])
    return target


def margins_of(robot: Robot, among: str, pairs: int, seed: int) -> tuple[Margin, Margin]:
    """Return the margins with rows for this many pairs, and those that measure all pairs."""
    if among != "balls":
        return SelfCollision(robot, pairs=pairs), SelfCollision(robot, pairs=10_000)
    balls = balls_of(robot, np.random.default_rng(seed))
    return Obstacles(robot, balls, pairs=pairs), Obstacles(robot, balls, pairs=100_000)


def controller_of(robot: Robot, stands: bool, margins: Margin) -> TorqueController:
    """Return a controller whose last task is the random posture."""
    here = robot.snapshot(robot.posture("standing"))
    tasks = [ComTask(robot, here.com, weight=10.0)] if stands else []
    posture = PostureTask(robot, here.q, kp=STIFFNESS)
    contacts = support(here, "double") if stands else ()
    kept = {"limits": Limits(robot), "constraints": [margins]}
    options = {"contacts": contacts, "dt": DT, "solver": "active_set", **kept}
    return TorqueController(robot, [*tasks, posture], **options)


def thrown(name: str, among: str, pairs: int, ticks: int, seed: int) -> str:
    """Return the results of one robot, among "nothing", on its "feet" alone or among "balls"."""
    robot, rng = Robot.load(name), np.random.default_rng(seed)
    stands, margins, judge = among != "nothing", *margins_of(robot, among, pairs, seed)
    controller = controller_of(robot, stands, margins)
    posture = controller.tasks[-1]
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    standing, began = q.copy(), judge.distances(robot.snapshot(q)).clearance
    broken = relaxed = larger = 0
    worst = fastest = away = 0.0
    for k in range(ticks):
        if k % TURN == 0:
            posture.set_target(random_posture(robot, standing, rng, stands))
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
    return (
        f"{name:12s}{among:8s}{pairs:5d} of{len(began):5d}{ticks:7d}{broken:8d}"
        f"{1e3 * worst:10.2f}{relaxed:9d}{larger:8d}{fastest:10.1f}{1e3 * away:9.2f}"
    )


def times(name: str, ticks: int) -> None:
    """Time ticks of a standing robot that moves its arms, with and without self-collision."""
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
    parser.add_argument("--among", nargs="+", choices=AMONG, default=AMONG)
    parser.add_argument("--pairs", nargs="+", type=int, default=(5, 25))
    options = parser.parse_args()
    print(
        f"{'robot':12s}{'among':8s}{'pairs':>13s}{'ticks':>7s}{'broken':>8s}{'worst mm':>10s}",
        end="",
    )
    print(f"{'relaxed':>9s}{'larger':>8s}{'rad/s':>10s}{'feet mm':>9s}")
    for name in options.robots if options.ticks else ():
        for among in options.among:
            for pairs in options.pairs:
                print(thrown(name, among, pairs, options.ticks, options.seed), flush=True)
    if options.timed:
        times("g1", options.timed)


if __name__ == "__main__":
    main()
