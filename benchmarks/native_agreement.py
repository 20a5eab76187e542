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
Both take distances and normals of pairs from the core, as coal's of hulls are good to 1e-7 m only;
their Jacobians and all that follows are Python's own. Where the core leaves the nearest pairs to
coal, the tick is counted by itself, with the difference of its QP.

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import wbc
from wbc.constraints.margin import SKIN
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.native_tick import NativeController
from wbc.controllers.tick import ACTIVE, NEGLIGIBLE
from wbc.controllers.torque_tick import TorqueTick
from wbc.native import VARIABLE
from wbc.qp.problem import QP
from wbc.robot.collision import Capsule, CollisionModel
from wbc.robot.collision.distances import parts
from wbc.robot.collision.model import Index, PairDistances
from wbc.robot.names import BASE
from wbc.rotations import exp_rotation
from wbc.validate import Array

ROBOTS = ("g1", "g1_27", "talos", "icub", "romeo", "hoap2_like")
FIELDS = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")
LEVELS = {"velocity": wbc.KinematicController, "torque": wbc.TorqueController}
COMMANDS = {wbc.Tick: ("velocity",), TorqueTick: ("velocity", "torque")}
WHAT = (*LEVELS, *(f"{level}-margin" for level in LEVELS), "pairs")
EPISODE = 50


@dataclass
class Found:
    """The largest difference of some ticks, and how many were compared and handed over."""

    compared: int = 0
    handed: int = 0
    worst: float = 0.0
    other: float = 0.0  # of commands, relative where above 1; of hulls' distances [m]
    refuted: int = 0  # ticks of which Python says something else
    held: int = 0  # ticks with an active pair,
    inside: int = 0  # with a pair inside its margin by more than the skin,
    limited: int = 0  # and with a velocity at the limits' box
    by_coal: int = 0  # compared ticks of which Python has the pairs from coal,
    coal: float = 0.0  # and the largest difference of their QPs

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
        self.coal = float(np.maximum(self.coal, other.coal))
        for name in ("refuted", "held", "inside", "limited", "by_coal"):
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


def of_qps(one: QP, other: QP) -> float:
    """Return the largest difference of two QPs; infinity if other entries are infinite."""
    return max(apart(getattr(one, field), getattr(other, field)) for field in FIELDS)


def apart(ours: Array, theirs: Array) -> float:
    """Return the largest difference of two arrays, relative to their largest entry if above 1."""
    if ours.shape != theirs.shape:
        return np.inf
    size = np.abs(theirs)
    scale = size.max(initial=1.0)
    if scale < np.inf:
        gap = np.abs(ours - theirs)
    else:  # bounds: infinite ones must be the same
        finite = size < np.inf
        scale = size.max(initial=1.0, where=finite)
        gap = np.abs(np.subtract(ours, theirs, out=np.zeros(ours.shape), where=finite))
        gap[~finite & (ours != theirs)] = np.inf
    worst = float(gap.max(initial=0.0)) / scale
    return np.inf if np.isnan(worst) else worst


def compare(sides: "Sides", level: type[NativeController], rng: np.random.Generator) -> Found:
    """Compare the QPs of one episode."""
    limited, found, made = rng.random() < 0.8, Found(), []
    for side, chance in zip(sides, (rng, deepcopy(rng)), strict=True):
        robot = side.robot
        standing = robot.snapshot(robot.posture("standing"))
        contacts, tasks = contacts_of(standing, chance), tasks_of(standing, chance)
        limits = side.limits if limited else None
        made.append(level(robot, tasks, contacts=contacts, limits=limits, solver="daqp"))
    controller, plain = made
    native, robot = controller._native, sides.native.robot
    for _ in range(EPISODE):
        size = 10.0 ** rng.uniform(-4, -1)
        q = robot.integrate(robot.posture("standing"), size * rng.normal(size=robot.nv), 1.0)
        v = 10.0 ** rng.uniform(-1, 1) * size * rng.normal(size=robot.nv)
        ours = None if native is None else controller._native_problem(native, robot.snapshot(q, v))
        if ours is None:
            found.add(None)
            continue
        with without_core():
            theirs = plain.step(sides.plain.robot.snapshot(q, v))
        # By a policy it may be another QP than the first.
        found.add(0.0 if theirs.policy is not None else of_qps(ours.qp, theirs.qp))
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


def compare_ticks(sides: "Sides", level: type[NativeController], rng: np.random.Generator) -> Found:
    """Compare whole ticks of one episode in closed loop."""
    found, made = Found(), []
    support = str(rng.choice(["floating", "left", "right", "double"]))
    for side, chance in zip(sides, (rng, deepcopy(rng)), strict=True):
        here = side.robot.snapshot(side.robot.posture("standing"))
        kept = {"limits": side.limits, "constraints": [side.margin]}
        contacts = wbc.support(here, support)
        made.append(
            level(side.robot, reaching(here, chance), contacts=contacts, solver="daqp", **kept)
        )
    controller, plain = made
    robot = sides.native.robot
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    for _ in range(EPISODE):
        if rng.random() < 0.2:
            size = 10.0 ** rng.uniform(-6, -2)
            q = robot.integrate(q, size * rng.normal(size=robot.nv), 1.0)
            q = robot.limits.clamped(q)
            v = v + 10.0 * size * rng.normal(size=robot.nv)
        state = robot.snapshot(q, v)
        ours = answered(controller, state)
        if ours is None:
            found.add(None)
            v = controller.step(state).velocity
        else:
            pairs = sides.plain.margin.model
            pairs.by_coal = False
            with without_core():
                theirs = plain.step(sides.plain.robot.snapshot(q, v))
            one = compare_tick(controller, state, ours, theirs)
            if pairs.by_coal:
                one = replace(one, worst=0.0, other=0.0, by_coal=1, coal=one.worst)
            found.join(one)
            v = theirs.velocity
        q = robot.integrate(q, v, controller.dt)
    return found


def answered(controller: NativeController, state: wbc.Snapshot) -> NativeProblem | None:
    """Return the core's answer; None: it handed the tick over."""
    native = controller.native
    ours = None if native is None else controller._native_problem(native, state)
    return ours if ours is not None and ours.solved and native.margin is not None else None


def compare_tick(
    controller: NativeController, state: wbc.Snapshot, ours: NativeProblem, theirs: wbc.Tick
) -> Found:
    """Compare one tick of the core with Python's."""
    one = Found(compared=1)
    same = (theirs.status.value, theirs.policy, theirs.step_scale) == ("solved", None, 1.0)
    rows = ours.qp.labels.inequality, theirs.qp.labels.inequality
    if not same or len(rows[0]) != len(rows[1]):
        one.refuted = 1
        return one
    clearance = ours._answer.clearance
    if rows[0] != rows[1]:
        near = controller.constraints[0].distances(state).clearance
        one.worst = float(np.abs(np.sort(near) - np.sort(clearance)).max())
        return one
    one.worst = of_qps(ours.qp, theirs.qp)
    tick = controller._native_tick(ours, state, controller._deviations(ours, state))
    commands = [(getattr(tick, name), getattr(theirs, name)) for name in COMMANDS[type(tick)]]
    one.other = max(apart(*both) for both in commands)
    x, z, qp, nv = theirs.solution.x, theirs.solution.z, theirs.qp, state.v.size
    pull = np.abs(z)  # as Tick.active
    one.held = int(pull[-clearance.size :].max() > max(NEGLIGIBLE, ACTIVE * pull.max()))
    one.inside = int((clearance < -SKIN).any())
    bounded = np.minimum(x[:nv] - qp.lower[:nv], qp.upper[:nv] - x[:nv])
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


class SamePairs(CollisionModel):
    """Pairs on one robot, found and measured on another with the core."""

    def __init__(self, robot: wbc.Robot, other: CollisionModel) -> None:
        super().__init__(robot, other.bodies, other.pairs.tolist())
        self._other, self.by_coal = other, False

    def nearest(self, snapshot: wbc.Snapshot, count: int | None = None) -> PairDistances:
        there = self._other.robot.snapshot(snapshot.q)
        most = len(self.pairs) if count is None else min(count, len(self.pairs))
        measured = self._other.native.nearest(there.native_state, most)
        if measured is None:  # some bodies touch
            self.by_coal = True
            return self._other.nearest(there, count)._replace(snapshot=snapshot)
        distance, normal, point = parts(measured[1])
        return PairDistances(measured[0], distance, normal.T, point.T, snapshot)

    def measure(self, snapshot: wbc.Snapshot, pairs: Index) -> PairDistances:
        there = self._other.robot.snapshot(snapshot.q)
        return self._other.measure(there, pairs)._replace(snapshot=snapshot)


class Side(NamedTuple):
    """A robot and what it keeps."""

    robot: wbc.Robot
    limits: wbc.Limits
    margin: wbc.SelfCollision | None = None


class Sides(NamedTuple):
    """One robot with the core, and without."""

    native: Side
    plain: Side


@contextmanager
def without_core() -> Iterator[None]:
    """Have WBC_NATIVE=off meanwhile."""
    os.environ[VARIABLE] = "off"
    yield
    os.environ[VARIABLE] = "require"


@lru_cache(maxsize=1)
def sides_of(name: str, margin: bool) -> Sides:
    """Load a robot twice."""
    robot = wbc.Robot.load(name)
    with without_core():
        plain = wbc.Robot.load(name)
        assert plain.native is None  # it keeps what it found when it was first asked
    assert robot.native is not None
    limits, others = wbc.Limits(robot), wbc.Limits(plain)
    if not margin:
        return Sides(Side(robot, limits), Side(plain, others))
    kept = wbc.SelfCollision(robot, limits=limits)
    same = wbc.SelfCollision(plain, model=SamePairs(plain, kept.model), limits=others)
    same.margins, same._kept, same._closer = kept.margins, kept._kept, kept._closer
    return Sides(Side(robot, limits, kept), Side(plain, others, same))


def episodes_of(name: str, what: str) -> Callable[[np.random.Generator], Found] | None:
    """Return what compares one episode; None: the core takes none of them."""
    sides = sides_of(name, "margin" in what)
    if what in LEVELS:
        return partial(compare, sides, LEVELS[what])
    if what != "pairs":
        return partial(compare_ticks, sides, LEVELS[what.removesuffix("-margin")])
    ours = wbc.SelfCollision(sides.native.robot).model
    if ours.native is None:
        return None
    plain = CollisionModel(sides.plain.robot, ours.bodies, ours.pairs.tolist())
    return partial(compare_pairs, ours, plain)


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
    seen = f"{known.held} | {known.inside} | {known.limited} | {known.by_coal} | {known.coal:.1e}"
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
    print(" | inside | at limits | coal's pairs | QP |" + "\n" + 12 * "|---" + "|")
    for name in options.robots:
        for what in options.of:
            print(run(name, what, options.ticks, options.seed, kept), flush=True)


if __name__ == "__main__":
    main()
