"""A G1 with two motors and two rods on each ankle, as it is built, against the serial one.

Rods are added to the URDF of example-robot-data: on each shank two motors turn cranks of 45 mm,
whose rods (universal joint, ball) drive pitch and roll; the ankle's own joints have no motor. Tick
times of both levels, and of a walk, in turns; and walks in MuJoCo at 1 m/s, with masses wrong by up
to 10 %, sensor noise and delay by the seed (disturbed.py).

    python benchmarks/parallel_ankles.py [--ticks 1000] [--seeds 10] [--steps 50]
        [--output benchmarks/RESULTS.md]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from time import thread_time

import features
import numpy as np
from disturbed import DT, plant_of
from qpbench.page import put_section
from qpbench.summary import machine
from qpbench.tables import Table

import wbc
from wbc.gait import Walker
from wbc.problem.provenance import versions
from wbc.robot.library import find_robot
from wbc.simulation import FallLimits, FallWatch, Terrain

CRANK = 0.045  # m
# Of both motors of an ankle: to the side, and above the pitch axis [m].
PLACES = {"in": (0.035, 0.22), "out": (-0.035, 0.16)}
TO_ANKLE, TO_ROLL = 0.30001, 0.017558  # m, of the file: from knee to pitch, from pitch to roll axis
EFFORT, ROTOR, LIGHT = 50.0, 0.01, 1e-4  # N m; kg m^2 of joints with and without a motor
JOINTS = {
    "*_hip_pitch_joint": -0.3,
    "*_knee_joint": 0.6,
    "*_ankle_pitch_joint": -0.3,
    "*_ankle_roll_joint": 0.0,
    "*_shoulder_pitch_joint": 0.2,
    "left_shoulder_roll_joint": 0.2,
    "right_shoulder_roll_joint": -0.2,
    "*_elbow_joint": 0.6,
}
WARM_UP, BLOCK, SPEED, MOST = 100, 50, 1.0, 60.0


def serial() -> wbc.Robot:
    """Return the file's G1."""
    return wbc.Robot.load("g1", armature={"*": ROTOR})


def parallel() -> wbc.Robot:
    """Return the G1 with rods on its ankles."""
    source = find_robot("g1")
    assert source.known is not None
    root = ET.parse(source.path).getroot()
    loops = {}
    for leg in ("left", "right"):
        for side, place in PLACES.items():
            loops[f"{leg} {side}"] = _add_rod(root, leg, f"{leg}_{side}", *place)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "g1_parallel.urdf"
        ET.ElementTree(root).write(path)
        return wbc.Robot.load(
            path,
            name="g1_parallel",
            package_dirs=[source.path.parents[3]],
            feet=source.known.feet,
            loops=loops,
            unactuated=["*_ankle_*_joint", "*_rod_?"],
            armature={"*": ROTOR, "*_rod_?": LIGHT, "*_ankle_*_joint": LIGHT},
        )


def _add_rod(root: ET.Element, leg: str, name: str, y: float, height: float) -> tuple[str, str]:
    """Add a motor with its crank and rod; return the rod's end and its place on the foot."""
    shank, foot, rod = f"{leg}_knee_link", f"{leg}_ankle_roll_link", height + TO_ROLL
    parts = [
        _link(f"{name}_crank", 0.08, (-0.5 * CRANK, 0, 0), 1e-5),
        _joint(f"{name}_motor", shank, f"{name}_crank", (0, y, height - TO_ANKLE), "0 1 0"),
        _link(f"{name}_cross", 0.005, (0, 0, 0), 1e-7),
        _joint(f"{name}_rod_y", f"{name}_crank", f"{name}_cross", (-CRANK, 0, 0), "0 1 0"),
        _link(f"{name}_rod", 0.05, (0, 0, -0.5 * rod), 1e-4),
        _joint(f"{name}_rod_x", f"{name}_cross", f"{name}_rod", (0, 0, 0), "1 0 0"),
        *_frame(f"{name}_end", f"{name}_rod", (0, 0, -rod)),
        *_frame(f"{name}_ball", foot, (-CRANK, y, 0)),
    ]
    root.extend(ET.fromstring(part) for part in parts)
    return f"{name}_end", f"{name}_ball"


def _link(name: str, mass: float, com: tuple[float, ...], size: float) -> str:
    moments = " ".join(f'i{axis}{axis}="{size}"' for axis in "xyz")
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(com)}"/><mass value="{mass}"/>'
        f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _joint(name: str, parent: str, child: str, at: tuple[float, ...], axis: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_text(at)}"/><axis xyz="{axis}"/>'
        f'<limit lower="-1.5" upper="1.5" velocity="20" effort="{EFFORT}"/></joint>'
    )


def _frame(name: str, parent: str, at: tuple[float, ...]) -> tuple[str, str]:
    return f'<link name="{name}"/>', (
        f'<joint name="{name}_joint" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{_text(at)}"/></joint>'
    )


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)


class Loop(features.Loop):
    """A loop of ``features.py`` from a stance, and the largest error of its closed loops [m]."""

    def __init__(self, robot: wbc.Robot, torque: bool) -> None:
        super().__init__(robot, "torques" if torque else "plain", robot.posture("standing", JOINTS))
        self.gap = 0.0

    def advance(self, ticks: int) -> None:
        """Move the target, time snapshot and step, integrate."""
        super().advance(ticks)
        if self.robot.loops:
            self.gap = max(self.gap, *self.robot.gaps(self.q).values())


class Walk:
    """A walk in MuJoCo, the times of its ticks [s], and the largest error of its loops [m]."""

    def __init__(self, robot: wbc.Robot, seed: int) -> None:
        posture = robot.posture("standing", JOINTS)
        self.robot, self.walker = robot, Walker(robot, posture=posture, dt=DT)
        self.plant = plant_of(robot, seed, Terrain(), posture)
        self.watch, self.times = FallWatch(self.plant, FallLimits()), list[float]()
        self.gap, self.relaxed, self.unsolved = 0.0, 0, 0

    def advance(self, ticks: int) -> None:
        """Time snapshot and step, with footsteps and goals; advance MuJoCo."""
        robot, plant = self.robot, self.plant
        for _ in range(ticks):
            if len(self.times) == BLOCK:
                self.walker.command(SPEED)
            seen = plant.measure() or plant.state()
            forces, begun = plant.contact_forces, thread_time()
            tick = self.walker.step(robot.snapshot(*seen), forces)
            self.times.append(thread_time() - begun)
            plant.step(tick.torque)
            self.relaxed += bool(tick.relaxed)
            self.unsolved += not (tick.ok or tick.relaxed)
            if robot.loops and len(self.times) % BLOCK == 0:
                self.gap = max(self.gap, *robot.gaps(plant.state()[0]).values())


def measured(ticks: int) -> list[list[str]]:
    """Return the rows of a table: both robots at both levels and walking, in turns."""
    robots = {"serial": serial(), "parallel": parallel()}
    loops: dict[tuple[str, str], Loop | Walk] = {
        (level, name): Loop(robot, level == "torque")
        for level in ("velocity", "torque")
        for name, robot in robots.items()
    }
    loops |= {("walking", name): Walk(robot, 0) for name, robot in robots.items()}
    for _ in range(0, ticks + WARM_UP, BLOCK):
        for loop in loops.values():
            loop.advance(BLOCK)
    rows = []
    for (level, name), loop in loops.items():
        plain = float(np.median(loops[level, "serial"].times))
        median, late = np.median(loop.times), np.percentile(loop.times, 99)
        rows.append(
            [
                f"{level}, {name}",
                str(loop.robot.nv),
                f"{1e6 * median:.1f}",
                f"{1e6 * late:.1f}",
                f"{median / plain:.2f}",
                f"{loop.gap:.1e}" if loop.robot.loops else "",
                str(loop.unsolved),
            ]
        )
    return rows


def walked(seed: int, steps: int) -> list[str]:
    """Return the row of one walk."""
    walk = Walk(parallel(), seed)
    while walk.plant.time < MOST and walk.walker.steps < steps and walk.watch.verdict().stood:
        walk.advance(1)
    stood, ahead = walk.watch.verdict().stood, float(walk.plant.com[0])
    return [
        str(seed),
        str(walk.walker.steps),
        "walks" if stood and walk.walker.steps >= steps else "falls",
        f"{ahead:.2f}",
        f"{ahead / walk.plant.time:.2f}",
        f"{1e3 * walk.gap:.4f}",
        f"{walk.relaxed} of {len(walk.times)}",
    ]


def main() -> None:
    """Time ticks, walk, and print or write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--output", type=Path, help="page to write a section into")
    options = parser.parse_args()
    told = ", ".join(f"{name} {one}" for name, one in versions().items())
    header = ["tick", "nv", "median us", "p99 us", "by serial", "gap m", "not solved"]
    walk = ["seed", "steps", "", "m ahead", "m/s", "gap mm", "relaxed"]
    rows = []
    for seed in range(options.seeds):
        rows.append(walked(seed, options.steps))
        print(*rows[-1], flush=True)
    text = "\n\n".join(
        [
            "## Closed loops",
            Table("g1, rods on its ankles", header, measured(options.ticks)).markdown(),
            Table(f"walks at {SPEED:g} m/s, {options.steps} steps", walk, rows).markdown(),
            f"Thread CPU time, {options.ticks} ticks each, in turns of {BLOCK}, on {machine()};"
            f" {told}. Command: `python benchmarks/parallel_ankles.py --ticks {options.ticks}"
            f" --seeds {options.seeds} --steps {options.steps}"
            " --output benchmarks/RESULTS.md`.",
        ]
    )
    print(text)
    if options.output:
        put_section(options.output, "parallel ankles", text)


if __name__ == "__main__":
    main()
