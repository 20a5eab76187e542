"""How well the native core and Python agree, at both levels, on six robots.

Two robots are loaded from one file, with WBC_NATIVE=require and off, and get the same tasks: what
is said of the second is Pinocchio, NumPy and DAQP called from Python, with nothing of the core.

velocity, torque: the QPs of random ticks. States around standing, from still to rushing, targets
that move, limits and torque bounds in reach, contacts of all kinds. Each tick that the core takes
is set up by Python too; printed is the largest difference of any entry of the two QPs, relative to
the largest entry of its field where that is above 1, and how many ticks the core handed over.

velocity-margin, torque-margin: whole ticks with limits and self-collision, in closed loop with
targets out of reach, thrown off its way now and then. Of each tick that the core answers the Python
tick must say the same: solved, nothing cut, the same labels (of pairs that are equally near it may
take others: then their clearances are compared); printed are the differences of the QPs, of the
commands, and in how many ticks pairs held the robot, were inside their margin, and limits held it.
Where a difference of commands comes from: how far the core's are from the optimum of its QP, and
the optima of the two QPs from each other, which is what the rounding of their numbers does; the
rest is Python's solver's. Each answer is refined at its active set for that.
Both take distances and normals of pairs from the core, as coal's of hulls are good to 1e-7 m only;
their Jacobians and all that follows are Python's own. Where the core leaves the nearest pairs to
coal, the tick is counted by itself, with the difference of its QP.

pairs: the 25 nearest pairs in Python, with coal. Distances of capsules and their Jacobians; of
hulls the distance, for which coal's tolerance is 1e-7 m.

    python benchmarks/native_agreement.py [--ticks 2000] [--robots g1 ...] [--seed 1]
        [--of velocity torque velocity-margin torque-margin pairs] [--state FILE.json]
        [--solver proxqp]  # for ticks: the core hands QPs to ProxQP; Python's are solved by DAQP

The same with the core under sanitizers (GCC):

    CC="gcc -fsanitize=address,undefined -fno-sanitize-recover" ASAN_OPTIONS=detect_leaks=0 \\
    LD_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so) \\
    $(gcc -print-file-name=libstdc++.so)" \\
    python benchmarks/native_agreement.py --ticks 500
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from native_agreement_found import Found, Kept
from native_agreement_sides import sides_of
from native_agreement_ticks import EPISODE, compare, compare_ticks
from sources import code_of

import wbc
from wbc.native import VARIABLE
from wbc.qp import pause
from wbc.robot.collision import Capsule, CollisionModel

ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")
LEVELS = {"velocity": wbc.KinematicController, "torque": wbc.TorqueController}
WHAT = (*LEVELS, *(f"{level}-margin" for level in LEVELS), "pairs")


def compare_pairs(ours: CollisionModel, theirs: CollisionModel, rng: np.random.Generator) -> Found:
    """Compare the nearest pairs of one episode, their distances and the Jacobians of these."""
    robot, plain, found = ours.robot, theirs.robot, Found()
    capsule = np.array([isinstance(body.shape, Capsule) for body in ours.bodies])[ours.pairs]
    for _ in range(EPISODE):
        step = 10.0 ** rng.uniform(-3, 0.5) * rng.normal(size=robot.nv)
        q = robot.integrate(robot.posture("standing"), step, 1.0)
        here, there = robot.snapshot(q), plain.snapshot(q)
        measured = ours.native.nearest(here.native_state, min(25, len(ours.pairs)))
        if measured is None or np.isneginf(measured[1][0]).any():  # some bodies touch
            found.add(None)
            continue
        a, b = ours.nearest(here, 25), theirs.nearest(there, 25)
        if not np.array_equal(a.pairs, b.pairs):  # ties: one of two that are as near
            apart = np.abs(np.sort(a.distance) - np.sort(b.distance)).max()
            found.join(Found(1, other=float(apart)))
            continue
        exact = capsule[a.pairs].all(axis=1)
        apart = np.abs(a.distance - b.distance)
        rows = np.abs(ours.rows(here, a) - theirs.rows(there, b))[exact].max(initial=0.0)
        worst = max(apart[exact].max(initial=0.0), rows)
        found.join(Found(1, worst=float(worst), other=float(apart[~exact].max(initial=0.0))))
    return found


def episodes_of(name: str, what: str, solver: str) -> Callable[[np.random.Generator], Found] | None:
    """Return what compares one episode; None: the core takes none of them."""
    sides = sides_of(name, "margin" in what)
    if what in LEVELS:
        return partial(compare, sides, LEVELS[what])
    if what != "pairs":
        return partial(compare_ticks, sides, LEVELS[what.removesuffix("-margin")], solver)
    ours = wbc.SelfCollision(sides.native.robot).model
    if ours.native is None:
        return None
    plain = CollisionModel(sides.plain.robot, ours.bodies, ours.pairs.tolist())
    return partial(compare_pairs, ours, plain)


def run(name: str, what: str, solver: str, ticks: int, seed: int, kept: Kept) -> str:
    """Return one line of the table; goes on where it was ended."""
    known = kept.of(f"{name} {what} {solver} {seed} {code_of()}")
    episode = None if known.ticks >= ticks else episodes_of(name, what, solver)
    while episode is not None and known.ticks < ticks:
        number = known.ticks // EPISODE
        rng = np.random.default_rng([seed, sum(f"{name} {what}".encode()), number])
        known.join(episode(rng))
        if number % 20 == 0 or known.ticks >= ticks:
            kept.save()
    counts = f"{known.compared} | {known.handed} | {known.refuted} | {known.worst:.1e}"
    seen = f"{known.held} | {known.inside} | {known.limited} | {known.by_coal} | {known.coal:.1e}"
    commands = " | ".join(f"{one:.1e}" for one in (known.other, known.exact, known.optima))
    return f"| {name} | {what} | {counts} | {commands} | {seen} |"


def main() -> None:
    """Compare each robot at each level, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2000, help="per robot, of each")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--of", nargs="+", default=list(WHAT), choices=WHAT)
    parser.add_argument(
        "--solver", choices=("active_set", "proxqp"), default="active_set", help="the core's"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--state", type=Path, help="kept here, to go on with the same code")
    options = parser.parse_args()
    os.environ[VARIABLE] = "require"
    pause.FIRST = 0  # asked in every tick, stalled or not
    kept = Kept(options.state)
    columns = "robot | of | compared | handed over | refuted | QP | command, hulls | core | optima"
    columns += " | pair holds | inside | at limits | coal's pairs | QP"
    print(f"| {columns} |\n" + 14 * "|---" + "|")
    for name in options.robots:
        for what in options.of:
            row = run(name, what, options.solver, options.ticks, options.seed, kept)
            print(row, flush=True)


if __name__ == "__main__":
    main()
