"""How well the native core and Python agree, at both levels, on six robots.

velocity, torque: the QPs of random ticks. States around standing, from still to rushing, targets
that move, limits and torque bounds in reach, contacts of all kinds. Each tick that the core takes
is set up by Python too; printed is the largest difference of any entry of the two QPs, relative to
the largest entry of its field where that is above 1, and how many ticks the core handed over.

velocity-margin, torque-margin: whole ticks of one controller with limits and self-collision, in
closed loop with targets out of reach, thrown off its way now and then. Of each tick that the core
answers the Python tick must say the same: solved, nothing cut, the same labels (of pairs that are
equally near it may take others: then their clearances are compared); printed are the differences
of the QPs, of the commands, and in how many ticks pairs held the robot, were inside their margin,
and limits held it.

pairs: the 25 nearest pairs in Python, with coal. Distances of capsules and their Jacobians; of
hulls the distance, for which coal's tolerance is 1e-7 m.

    python benchmarks/native_agreement.py [--ticks 2000] [--robots g1 ...] [--seed 1]
        [--of velocity torque velocity-margin torque-margin pairs] [--state FILE.json]

The same with the core under sanitizers (GCC):

    CC="gcc -fsanitize=address,undefined -fno-sanitize-recover" ASAN_OPTIONS=detect_leaks=0 \\
    LD_PRELOAD="$(gcc -print-file-name=libasan.so) $(gcc -print-file-name=libubsan.so) \\
    $(gcc -print-file-name=libstdc++.so)" \\
    python benchmarks/native_agreement.py --ticks 500
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

import wbc
from wbc.controllers.controller import Controller
from wbc.native import VARIABLE
from wbc.qp.problem import QP
from wbc.robot.collision import Capsule, CollisionModel
from wbc.robot.names import BASE
from wbc.rotations import exp_rotation

ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")
FIELDS = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")
LEVELS = {"velocity": wbc.KinematicController, "torque": wbc.TorqueController}
WHAT = (*LEVELS, *(f"{level}-margin" for level in LEVELS), "pairs")
EPISODE = 50


@dataclass
class Found:
    """The largest difference of some ticks, and how many were compared and handed over."""

    compared: int = 0
    handed: int = 0
    worst: float = 0.0
    other: float = 0.0  # of commands [rad/s, m/s], relative where above 1; of hulls' distances [m]
    refuted: int = 0  # ticks of which Python says something else
    held: int = 0  # ticks with an active pair,
    inside: int = 0  # with a pair inside its margin by more than the skin,
    limited: int = 0  # and with a velocity at the limits' box

    @property
    def ticks(self) -> int:
        return self.compared + self.handed

    def add(self, difference: float | None) -> None:
        """Count one tick; None: the core handed it over."""
        one = Found(0, 1) if difference is None else Found(1, 0, difference)
        self.join(one)

    def join(self, other: "Found") -> None:
        """Count what others found."""
        self.compared += other.compared
        self.handed += other.handed
        self.worst = float(np.maximum(self.worst, other.worst))  # keeps NaN
        self.other = float(np.maximum(self.other, other.other))
        for name in ("refuted", "held", "inside", "limited"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


class Kept:
    """What was found, in a file if there is one."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        there = json.loads(path.read_text()) if path is not None and path.exists() else {}
        self._found = {key: Found(**one) for key, one in there.items()}

    def of(self, key: str) -> Found:
        """Return what was found under a key, to be counted on."""
        return self._found.setdefault(key, Found())

    def save(self) -> None:
        """Write all of it by one rename."""
        if self._path is not None:
            beside = self._path.with_suffix(".part")
            beside.write_text(json.dumps({key: asdict(one) for key, one in self._found.items()}))
            beside.replace(self._path)


def tasks_of(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Task]:
    """One of each kind that the core knows, targets moving."""
    robot, frames = here.robot, here.robot.frame_names
    frame = frames[rng.integers(len(frames))]
    turned = here.rotation(frame) @ exp_rotation(rng.uniform(-1.0, 1.0, 3))
    com, shape = wbc.ComTask(robot, here.com), wbc.InertiaTask(robot, here.inertia)
    turn = wbc.OrientationTask(robot, frame, turned, name="turn")
    posture = wbc.PostureTask(robot, here.q)
    com.set_target(here.com + 0.1 * rng.normal(size=3), *rng.normal(size=(2, 3)))
    shape.set_target(here.inertia * np.exp(0.3 * rng.normal()), 0.1 * here.inertia, here.inertia)
    turn.set_target(turned, *rng.normal(size=(2, 3)))
    posture.set_target(here.q, *rng.normal(size=(2, robot.nv)))
    local = wbc.InertiaTask(robot, here.inertia_in(BASE), frame=BASE, name="local")
    momentum = wbc.MomentumTask(robot, rng.normal(size=6))
    momentum.set_target(momentum.target, rng.normal(size=6))
    tasks = [com, shape, local, turn, posture, momentum]
    for task in tasks:
        task.weight = 10.0 ** rng.uniform(-2, 2)
    return tasks


def contacts_of(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Contact]:
    """Feet, and now and then a grip or a point."""
    frames = here.robot.frame_names
    contacts = list(wbc.support(here, str(rng.choice(["floating", "left", "right", "double"]))))
    held = {contact.frame for contact in contacts}
    name = frames[rng.integers(len(frames))]
    if rng.random() < 0.3 and name not in held:
        kind = wbc.PointContact if rng.random() < 0.5 else wbc.Contact
        contacts.append(kind.hold(here, name, friction=None))
    return contacts


def difference(controller: Controller, here: wbc.Snapshot) -> float | None:
    """Return the largest difference of the two QPs; None if the core handed the tick over."""
    native = controller._native
    found = None if native is None else controller._native_problem(native, here)
    if found is None:
        return None
    tick = Controller._step(controller, here)
    if tick.policy is not None:  # another QP than the first
        return 0.0
    return of_qps(found.qp, tick.qp)


def of_qps(one: QP, other: QP) -> float:
    """Return the largest difference of two QPs."""
    worst = 0.0
    for field in FIELDS:
        ours, theirs = getattr(one, field), getattr(other, field)
        finite = np.isfinite(theirs)
        if ours.shape != theirs.shape or not np.array_equal(ours[~finite], theirs[~finite]):
            return np.inf
        scale = max(1.0, np.abs(theirs[finite]).max(initial=0.0))
        worst = max(worst, np.abs(ours[finite] - theirs[finite]).max(initial=0.0) / scale)
    return float(worst)


def compare(robot: wbc.Robot, level: type[Controller], rng: np.random.Generator) -> Found:
    """Compare the QPs of one episode."""
    standing, found = robot.snapshot(robot.posture("standing")), Found()
    limits = wbc.Limits(robot) if rng.random() < 0.8 else None
    contacts, tasks = contacts_of(standing, rng), tasks_of(standing, rng)
    controller = level(robot, tasks, contacts=contacts, limits=limits, solver="daqp")
    for _ in range(EPISODE):
        size = 10.0 ** rng.uniform(-4, -1)
        q = robot.integrate(standing.q, size * rng.normal(size=robot.nv), 1.0)
        here = robot.snapshot(q, 10.0 ** rng.uniform(-1, 1) * size * rng.normal(size=robot.nv))
        found.add(difference(controller, here))
    return found


def reaching(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Task]:
    """Tasks that push bodies into each other and joints to their ends: frames go anywhere."""
    robot, names = here.robot, here.robot.frame_names
    tasks: list[wbc.Task] = [wbc.PostureTask(robot, here.q, weight=0.1)]
    tasks.append(wbc.ComTask(robot, here.com + 0.05 * rng.normal(size=3), weight=3.0))
    tasks.append(wbc.InertiaTask(robot, here.inertia * np.exp(0.5 * rng.normal()), per_mass=True))
    for frame in rng.choice(names, size=3, replace=False).tolist():
        target = here.com + 0.4 * rng.normal(size=3)
        tasks.append(wbc.PositionTask(robot, frame, target, name=f"to {frame}", gain=0.3))
    return tasks


def compare_ticks(
    robot: wbc.Robot,
    level: type[Controller],
    limits: wbc.Limits,
    margin: wbc.SelfCollision,
    rng: np.random.Generator,
) -> Found:
    """Compare whole ticks of one episode in closed loop."""
    here, found = robot.snapshot(robot.posture("standing")), Found()
    contacts = wbc.support(here, str(rng.choice(["floating", "left", "right", "double"])))
    tasks = reaching(here, rng)
    controller = level(
        robot, tasks, contacts=contacts, limits=limits, constraints=[margin], solver="daqp"
    )
    q, v = here.q, np.zeros(robot.nv)
    for _ in range(EPISODE):
        if rng.random() < 0.2:
            size = 10.0 ** rng.uniform(-6, -2)
            q = robot.integrate(q, size * rng.normal(size=robot.nv), 1.0)
            q = robot.limits.clamped(q)
            v = v + 10.0 * size * rng.normal(size=robot.nv)
        state = robot.snapshot(q, v)
        found.join(compare_tick(controller, state))
        v = controller.step(state).velocity
        q = robot.integrate(q, v, controller.dt)
    return found


def compare_tick(controller: Controller, state: wbc.Snapshot) -> Found:
    """Compare one tick that the core answers by itself."""
    native = controller._native
    ours = None if native is None else controller._native_problem(native, state)
    if ours is None or native.margin is None or not ours.solved:
        return Found(handed=1)
    theirs = Controller._step(controller, state)
    one = Found(compared=1)
    same = (theirs.status.value, theirs.policy, theirs.step_scale) == ("solved", None, 1.0)
    rows = ours.qp.labels.inequality, theirs.qp.labels.inequality
    if not same or len(rows[0]) != len(rows[1]):
        one.refuted = 1
        return one
    if rows[0] != rows[1]:
        near = controller.constraints[0].distances(state).clearance, ours._answer.clearance
        one.worst = float(np.abs(np.sort(near[0]) - np.sort(near[1])).max())
        return one
    one.worst = of_qps(ours.qp, theirs.qp)
    x, y = ours.solution.x[: state.v.size], theirs.solution.x[: state.v.size]
    one.other = float(np.abs(x - y).max() / max(1.0, np.abs(y).max()))
    one.held = int(any(" vs " in name for name in theirs.active))
    one.inside = int((controller.constraints[0].distances(state).clearance < -1e-4).any())
    bounded = np.minimum(y - theirs.qp.lower[: y.size], theirs.qp.upper[: y.size] - y)
    one.limited = int((bounded < 1e-9).any())
    return one


def compare_pairs(ours: CollisionModel, theirs: CollisionModel, rng: np.random.Generator) -> Found:
    """Compare the nearest pairs of one episode, their distances and the Jacobians of these."""
    robot, plain, found = ours.robot, theirs.robot, Found()
    capsule = np.array([isinstance(body.shape, Capsule) for body in ours.bodies])[ours.pairs]
    for _ in range(EPISODE):
        step = 10.0 ** rng.uniform(-3, 0.5) * rng.normal(size=robot.nv)
        q = robot.integrate(robot.posture("standing"), step, 1.0)
        here, there = robot.snapshot(q), plain.snapshot(q)
        measured = ours._native.nearest(here.native_state, min(25, len(ours.pairs)))
        if measured is None:
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


def episodes_of(name: str, what: str) -> Callable[[np.random.Generator], Found] | None:
    """Return what compares one episode; None: the core takes none of them."""
    robot = wbc.Robot.load(name)
    if what in LEVELS:
        return partial(compare, robot, LEVELS[what])
    if what != "pairs":
        limits = wbc.Limits(robot)
        margin = wbc.SelfCollision(robot, limits=limits)
        return partial(compare_ticks, robot, LEVELS[what.removesuffix("-margin")], limits, margin)
    ours = wbc.SelfCollision(robot).model
    if ours.native is None:
        return None
    os.environ[VARIABLE] = "off"
    plain = wbc.Robot.load(name)
    assert plain.native is None  # it keeps what it found when it was first asked
    os.environ[VARIABLE] = "require"
    return partial(compare_pairs, ours, CollisionModel(plain, ours.bodies, ours.pairs.tolist()))


def run(name: str, what: str, ticks: int, seed: int, kept: Kept) -> str:
    """Return one line of the table; goes on where it was ended."""
    known = kept.of(f"{name} {what} {seed}")
    episode = None if known.ticks >= ticks else episodes_of(name, what)
    while episode is not None and known.ticks < ticks:
        number = known.ticks // EPISODE
        rng = np.random.default_rng([seed, sum(f"{name} {what}".encode()), number])
        known.join(episode(rng))
        if number % 20 == 0 or known.ticks >= ticks:
            kept.save()
    counts = f"{known.compared} | {known.handed} | {known.refuted} | {known.worst:.1e}"
    seen = f"{known.held} | {known.inside} | {known.limited}"
    return f"| {name} | {what} | {counts} | {known.other:.1e} | {seen} |"


def main() -> None:
    """Compare each robot at each level, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2000, help="per robot, of each")
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--of", nargs="+", default=list(WHAT), choices=WHAT)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--state", type=Path, help="kept here, to go on after an end")
    options = parser.parse_args()
    os.environ[VARIABLE] = "require"
    kept = Kept(options.state)
    print(
        "| robot | of | compared | handed over | refuted | QP | command, hulls | pair holds", end=""
    )
    print(" | inside | at limits |\n|---|---|---|---|---|---|---|---|---|---|")
    for name in options.robots:
        for what in options.of:
            print(run(name, what, options.ticks, options.seed, kept), flush=True)


if __name__ == "__main__":
    main()
