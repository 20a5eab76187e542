"""How robots walk in MuJoCo: speeds, directions, pushes and ground, over seeds of noise and mass.

Every trial has sensor noise of 1e-3 rad and 0.05 rad/s on joints and base, 2 ms of delay, and
masses wrong by up to 10 % (by the seed). Trials run in processes; each is a line of a journal, and
is not run twice. A journal of other settings or other code of this package is refused.

The group ``meshes`` measures distances between the shapes of the robot's files every 20 ms, with
and without a ``SelfCollision`` constraint. It reports the least distance of pairs that are more
than 2 cm apart when the robot stands.

The group ``sideways`` pushes every robot to both sides with an impulse that equals 12 N s for a G1
in units of M omega d of the stance: through the CoM, and at the origin of the trunk, which is
higher by a fifth (G1) to a half (Romeo) of the CoM's height, so that the same impulse moves the
capture point farther.

With ``--speeds`` robots only walk ahead, at these speeds.

With ``--estimated`` the state is estimated from IMU, encoders and motor torques alone
(``sensed_plant_of``), and contacts are detected from the torques.

    python benchmarks/walking.py JOURNAL.jsonl [--only speed push sideways ground schedule meshes]
        [--robots g1] [--walks back left "turn 360"] [--speeds 1.2] [--seeds 10] [--workers 2]
        [--estimated]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import ARMATURE, DT, mass_of, plant_of, robot_named, sensed_plant_of
from raw_shapes import RawShapes
from sources import code_of

import wbc
from wbc.constraints import BrakingParameters, SelfCollision
from wbc.controllers import Controller
from wbc.gait import Velocity, Walker
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand
from wbc.gait.whole_body import heaviest_link
from wbc.journal import Journal
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.robot import Snapshot
from wbc.simulation import SensedPlant, SimulationError, Step, Terrain, capture_impulse, simulate
from wbc.workers import Workers

SPEED = {"g1": 0.8, "talos": 0.5, "hoap2_like": 0.15, "g1_27": 0.3, "icub": 0.2, "romeo": 0.15}
STEPS = 50
MOST = 60.0  # s
# G1 is pushed while it walks at this speed [m/s], at its trunk, by 100 N for 0.2 s.
PUSHED, FORCE, LASTING = 0.5, 100.0, 0.2
SIDEWAYS = 12.0  # N s on a G1, and its part of M omega d on others, at as slow a walk
MARGIN = 5e-3  # m, of the constraint
# Braking before its margins: deceleration of joints [rad/s^2], fraction of the clearance per tick.
# The default deceleration of 5 m/s^2 is too much for an upper arm that rotates 2 cm from the trunk.
BRAKES, GAIN = 40.0, 0.1
# Settings and sources that trials depend on.
MADE_OF = {
    "wbc": wbc.__version__,
    "code": code_of(),
    "dt": DT,
    "armature": ARMATURE,
    "push": (FORCE, LASTING, SIDEWAYS),
    "margin": (MARGIN, BRAKES, GAIN),
}
MOMENT = 1.0  # s to wait for the result of a trial
# Ticks between measurements of raw shapes, and the least standing distance of pairs that count [m].
MEASURED, STANDS = 10, 0.02
GROUPS = ("speed", "push", "sideways", "ground", "schedule", "meshes")


@dataclass(frozen=True)
class Trial:
    """One walk.

    Attributes
    ----------
    commands:
        (at [s], vx, vy, yaw_rate).
    push:
        (angle [rad], part of the step in which it begins), or None.
    through_com:
        Whether it is one through the CoM, not at the origin of the trunk.
    ground:
        ``level``, ``steps``, or slopes and friction: (along x, along y, friction).
    bodies:
        Whether they are kept apart by a constraint.
    estimated:
        Whether the state is estimated from devices.
    """

    group: str
    name: str
    robot: str
    seed: int
    commands: tuple[tuple[float, float, float, float], ...]
    steps: int | None = STEPS
    push: tuple[float, float] | None = None
    through_com: bool = False
    ground: tuple[float, float, float] | str = "level"
    bodies: bool = False  # kept apart
    estimated: bool = False

    @property
    def key(self) -> str:
        by = "/estimated" * self.estimated
        return f"{self.group}/{self.robot}/{self.name}/{self.seed}{by}"

    @property
    def kind(self) -> str:
        """The name in the table, of all phases of a push together."""
        return self.name.split(",")[0]


def trials(seeds: int) -> Iterator[Trial]:
    """Yield all trials, seed by seed."""
    for seed in range(seeds):
        for robot, v in SPEED.items():
            ways = {"ahead": (v, 0.0), "back": (-v / 3, 0.0), "left": (0.0, v / 3)}
            for name, (vx, vy) in ways.items():
                steps = STEPS if name == "ahead" else 20
                yield Trial("speed", name, robot, seed, ((0.2, vx, vy, 0.0),), steps)
            turn = ((0.2, 0.0, 0.0, 0.5), (0.2 + 2 * math.pi / 0.5, 0.0, 0.0, 0.0))
            yield Trial("speed", "turn 360", robot, seed, turn, None)
        yield Trial("speed", "ahead at 1.0", "g1", seed, ((0.2, 1.0, 0.0, 0.0),))
        for k in range(8):
            for phase in range(4):
                push = (k * math.pi / 4, phase / 4)
                name = f"{45 * k} deg, phase {phase}"
                yield Trial("push", name, "g1", seed, ((0.2, PUSHED, 0.0, 0.0),), 14, push)
        walk = ((0.2, 0.4, 0.0, 0.0),)
        for robot, v in SPEED.items():
            for side, angle in (("left", 0.5 * math.pi), ("right", -0.5 * math.pi)):
                for phase, through in itertools.product((0, 2), (False, True)):
                    name = f"{side}{' through CoM' * through}, phase {phase}"
                    slow = ((0.2, v * PUSHED / SPEED["g1"], 0.0, 0.0),)
                    push = angle, phase / 4
                    yield Trial("sideways", name, robot, seed, slow, 14, push, through)
        for name, ground in GROUND.items():
            yield Trial("ground", name, "g1", seed, walk, 20, ground=ground)
        yield Trial("schedule", "60 s", "g1", seed, SCHEDULE, None)
        for robot in MESHES:
            for bodies in (False, True):
                walk = ((0.2, SPEED[robot], 0.0, 0.0),)
                name = "kept apart" if bodies else "not kept apart"
                yield Trial("meshes", name, robot, seed, walk, 10, bodies=bodies)


def walks_ahead(seeds: int, robots: Sequence[str], speeds: Sequence[float]) -> Iterator[Trial]:
    """Yield walks of robots ahead at these speeds [m/s], seed by seed."""
    for seed, robot, v in itertools.product(range(seeds), robots, speeds):
        yield Trial("speed", f"ahead at {v:g}", robot, seed, ((0.2, v, 0.0, 0.0),))


MESHES = ("g1", "talos", "hoap2_like")
TILT = math.tan(math.radians(6.0))
GROUND: dict[str, tuple[float, float, float] | str] = {
    "up 6 deg": (TILT, 0.0, 0.8),
    "down 6 deg": (-TILT, 0.0, 0.8),
    "across 6 deg": (0.0, TILT, 0.8),
    "friction 0.4": (0.0, 0.0, 0.4),
    "+-2 cm steps": "steps",
}
SCHEDULE = (
    (0.2, 0.5, 0.0, 0.0),
    (8.0, 0.0, 0.0, 0.0),
    (12.0, 0.0, 0.0, 0.6),
    (17.0, 0.4, 0.1, 0.0),
    (24.0, 0.0, -0.2, 0.0),
    (30.0, -0.2, 0.0, 0.0),
    (36.0, 0.6, 0.0, 0.3),
    (44.0, 0.0, 0.0, 0.0),
    (47.0, 0.3, 0.0, -0.5),
    (54.0, 0.5, 0.0, 0.0),
    (57.0, 0.0, 0.0, 0.0),
)


def terrain_of(ground: tuple[float, float, float] | str, seed: int) -> Terrain:
    """Return the ground; ``steps`` has boards of 0 and 2 cm, each 0.6 m deep."""
    if ground == "steps":
        rng = np.random.default_rng(seed)
        boards, height = [], 0.0
        for k in range(12):
            height = min(max(height + float(rng.choice((-0.02, 0.02))), 0.0), 0.06)
            if height > 0.0:
                centre = (0.8 + 0.6 * k, 0.0, height)
                boards.append(Step(centre=np.array(centre), size=np.array((0.6, 4.0, height))))
        return Terrain(steps=tuple(boards))
    if isinstance(ground, str):
        return Terrain()
    return Terrain(friction=ground[2], slope=ground[:2])


def force_on(trial: Trial) -> float:
    """Return the force of a trial's push [N]."""
    if trial.group == "push":
        return FORCE
    own, known = (
        capture_impulse(robot.snapshot(robot.posture("standing")), robot.feet, (0.0, 1.0))
        for robot in (robot_named(trial.robot), robot_named("g1"))
    )
    return SIDEWAYS / LASTING * own / known


def self_collision_of(robot: wbc.Robot) -> SelfCollision:
    """Return the self-collision constraint of a robot."""
    limits = wbc.Limits(robot, acceleration=BRAKES)
    braking = BrakingParameters(gain=GAIN)
    return SelfCollision(robot, margin=MARGIN, braking=braking, limits=limits)


def run_trial(trial: Trial) -> dict[str, Any]:
    """Run a trial and return its results as plain data."""
    robot = robot_named(trial.robot)
    terrain = terrain_of(trial.ground, trial.seed)
    flat = rotated_to_plane(
        robot.posture("standing"), terrain.normal
    )  # soles lie flat on the ground
    made = sensed_plant_of if trial.estimated else plant_of
    plant = made(robot, trial.seed, terrain, flat)
    margins = [self_collision_of(robot)] if trial.bodies else []
    walker = Walker(robot, constraints=margins, dt=DT)
    nearest = Nearest(robot) if trial.group == "meshes" else None
    commands = [TimedCommand(at, Velocity(*velocity)) for at, *velocity in trial.commands]
    walk = ScheduledWalk(walker, commands, lambda: plant.felt_forces)
    end = commands[-1].at + 3.0 if trial.steps is None else MOST
    begin = plant.com.copy()
    ticks = relaxed = 0
    push = trial.push

    def lead(tick: int, snapshot: Snapshot) -> Controller | None:
        nonlocal push
        if trial.steps is not None and walker.steps >= trial.steps:
            return None
        if push is not None and walker.steps >= 6:
            (angle, part), push = push, None
            start = plant.time + part * walker.gait.times.total
            force = force_on(trial) * np.array((math.cos(angle), math.sin(angle), 0.0))
            point = "com" if trial.through_com else None
            plant.push(heaviest_link(robot), force, point, start=start, duration=LASTING)
        return walk.update(tick, snapshot)

    try:
        for now in simulate(walker.controller, plant, end, update=lead):
            ticks, relaxed = ticks + 1, relaxed + bool(now.tick.policy)
            if nearest is not None and ticks % MEASURED == 0:
                nearest.look(plant.state()[0])
        stood, reason = now.verdict.stood, now.verdict.reason
    except SimulationError as error:
        stood, reason = False, str(error)
    way = plant.com - begin
    return {
        "key": trial.key,
        **asdict(trial),
        "mass": mass_of(trial.seed),
        "stood": stood,
        "reason": reason,
        "made": walker.steps,
        "time": plant.time,
        "speed": float(np.linalg.norm(way[:2])) / max(plant.time, DT),
        "heading": walker.heading,
        **({"estimate": str(plant.errors)} if isinstance(plant, SensedPlant) else {}),
        "relaxed": relaxed / max(ticks, 1),
        **({} if nearest is None else {"nearest": nearest.least[0], "pair": nearest.least[1]}),
    }


class Nearest:
    """The least distance of a robot's bodies over a walk, by the shapes of its files."""

    def __init__(self, robot: wbc.Robot) -> None:
        self.raw = RawShapes(robot, SelfCollision(robot, margin=MARGIN))
        self.apart = self.raw.distances(robot.posture("standing")) > STANDS
        self.least = math.inf, ""

    def look(self, q: np.ndarray) -> None:
        """Measure a configuration."""
        self.least = min(self.least, self.raw.nearest(q, self.apart))


def walk_in_processes(wanted: Sequence[Trial], size: int) -> Iterator[dict[str, Any]]:
    """Yield results of the trials as they arrive."""
    ahead, left = iter(wanted), len(wanted)
    with Workers(_walking, size) as workers:
        while left:
            while workers.room and (trial := next(ahead, None)) is not None:
                workers.submit(trial.key, trial)
            for answer in workers.results(MOMENT):
                if answer.error is not None:
                    raise answer.error
                left -= 1
                yield answer.value


def _walking() -> Callable[[Trial], dict[str, Any]]:
    return run_trial


def table(rows: list[dict[str, Any]]) -> str:
    """Return the results, one line for each robot and kind."""
    lines = [f"{'group':9} {'robot':11} {'walk':20} {'stood':>9} {'m/s':>6} {'relaxed':>9}"]
    kinds: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        name = row["name"].split(",")[0]
        kinds.setdefault((row["group"], row["robot"], name), []).append(row)
    for (group, robot, name), found in sorted(kinds.items()):
        stood = sum(row["stood"] for row in found)
        speed = float(np.mean([row["speed"] for row in found]))
        relaxed = float(np.mean([row["relaxed"] for row in found]))
        share = f"{stood}/{len(found)}"
        near = min((row["nearest"], row["pair"]) for row in found) if group == "meshes" else None
        told = "" if near is None else f"  nearest {1e3 * near[0]:.1f} mm: {near[1]}"
        lines.append(
            f"{group:9} {robot:11} {name:20} {share:>9} {speed:6.2f} {100 * relaxed:8.3f}%{told}"
        )
    for group in dict.fromkeys(key[0] for key in sorted(kinds)):
        found = [row for row in rows if row["group"] == group]
        most = max((row["relaxed"] for row in found if row["stood"]), default=0.0)
        stood = sum(row["stood"] for row in found)
        lines.append(f"{group}: {stood} of {len(found)} stood, {100 * most:.3f} % relaxed at most")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("journal", type=Path)
    parser.add_argument("--only", nargs="+", default=list(GROUPS), choices=GROUPS)
    parser.add_argument("--robots", nargs="+", default=list(SPEED))
    parser.add_argument("--walks", nargs="+", help="only walks of these names, as in the table")
    parser.add_argument("--speeds", nargs="+", type=float, default=[], help="only ahead, at these")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--estimated", action="store_true", help="no true state, no foot forces")
    given = parser.parse_args()
    asked = list(trials(given.seeds))
    if given.speeds:
        asked = list(walks_ahead(given.seeds, given.robots, given.speeds))
    names = {one.kind for one in asked}
    if unknown := set(given.walks or ()) - names:
        parser.error(f"no walks named {sorted(unknown)}; there are {sorted(names)}")
    with Journal(given.journal, MADE_OF) as journal:
        rows = list(journal.entries)
        known = {row["key"] for row in rows}
        wanted = [
            one
            for one in (replace(each, estimated=given.estimated) for each in asked)
            if one.group in given.only
            and one.robot in given.robots
            and (given.walks is None or one.kind in given.walks)
            and one.key not in known
        ]
        for row in walk_in_processes(wanted, given.workers):
            journal.add(row)
            rows.append(row)
    shown = [
        row
        for row in rows
        if row["group"] in given.only
        and row["robot"] in given.robots
        and row.get("estimated", False) == given.estimated
    ]
    print(table(shown))


if __name__ == "__main__":
    main()
