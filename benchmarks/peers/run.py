"""The same loop in this package, Pink, mink, PlaCo and TSID, in turns on one core: one table.

Each runs in its own environment's process (environments.sh) and runs a block of ticks in turn, so
that the machine's drift affects all alike. The time is thread CPU time of the whole loop: targets
are set, the command is computed and integrated; and of its tick alone, from the state to the
command (Pink, mink and PlaCo integrate in there). The job: a G1 on both feet, held exactly, follows
its CoM and the orientation of its trunk, with a posture task, position and velocity limits, dt 5
ms; the same with 25 pairs of spheres kept 10 mm apart, a row for each in every tick; and with slow
joints, a dozen of them at their limits, where in all other loops no bound is active. Equal work is
checked: CoM error, drift of the feet, velocities within their limits (mink exceeds active ones by
0.2 %), the nearest spheres. At the torque level the same with friction cones and torque bounds, dt
2 ms; the computed acceleration is integrated.

    bash benchmarks/peers/environments.sh
    python benchmarks/peers/run.py [--ticks 2000] [--output benchmarks/RESULTS.md]
"""

import argparse
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wbc.robot import Robot

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parent))  # the folder of benchmarks, which this one is called without

from qpbench.page import put_section  # noqa: E402
from qpbench.summary import machine  # noqa: E402

BUILD = HERE.parents[1] / "build" / "peers"
DT = {
    "velocity": 0.005, "velocity, 25 pairs": 0.005, "velocity, slow joints": 0.005, "torque": 0.002,
}  # fmt: skip
SLOW = 0.1  # of slow joints [rad/s]
WARM_UP, BLOCK = 200, 50
ROBOT = "g1"
FEET, TRUNK = ("left_ankle_roll_link", "right_ankle_roll_link"), "torso_link"
ARMS = ("elbow_link", "wrist_roll_link", "rubber_hand")
BODY = ("torso_link", "pelvis", "left_hip_roll_link", "right_hip_roll_link")
RADIUS, MARGIN = 0.06, 0.01  # of the spheres about the links' origins [m]
# Label, environment, script, arguments.
WBC = (("wbc active_set", "wbc", "wbc", ("active_set",)), ("wbc proxqp", "wbc", "wbc", ("proxqp",)))
INERTIA = ("wbc active_set, with inertia", "wbc", "wbc", ("active_set", "inertia"))
PLACO = ("PlaCo (C++)", "placo", "placo", ())
PEERS = (
    ("Pink daqp", "pink", "pink", ("daqp",)),
    ("Pink proxqp", "pink", "pink", ("proxqp",)),
    ("mink daqp", "mink", "mink", ("daqp",)),
    ("mink proxqp", "mink", "mink", ("proxqp",)),
    PLACO,
)
LOOPS = {
    "velocity": (
        *WBC,
        INERTIA,
        ("wbc proxqp, with inertia", "wbc", "wbc", ("proxqp", "inertia")),
        *PEERS,
    ),
    "velocity, 25 pairs": (*WBC, INERTIA, *PEERS),
    "velocity, slow joints": (*WBC, PLACO),
    "torque": (
        ("wbc active_set", "wbc", "wbc_torque", ("active_set",)),
        ("wbc proxqp", "wbc", "wbc_torque", ("proxqp",)),
        ("wbc active_set, with inertia", "wbc", "wbc_torque", ("active_set", "inertia")),
        ("PlaCo (C++)", "placo", "placo_torque", ()),
        ("TSID (C++)", "tsid", "tsid", ()),
    ),
}


@dataclass
class Loop:
    """A process that runs blocks of ticks, and its answers."""

    label: str
    process: subprocess.Popen[str]
    versions: dict[str, str]
    times: list[float] = field(default_factory=list)
    ticks: list[float] = field(default_factory=list)
    last: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def start(
        cls, label: str, environment: str, loop: str, arguments: tuple[str, ...], job: Path
    ) -> "Loop":
        python = sys.executable if environment == "wbc" else BUILD / environment / "bin" / "python"
        script = HERE / f"loop_{loop}.py"
        variables = {**os.environ, "OMP_NUM_THREADS": "1"}
        if environment != "wbc":
            variables.pop("PYTHONPATH", None)
        process = subprocess.Popen(
            [str(python), str(script), str(job), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=variables,
        )
        return cls(label, process, cls._answer(label, process)["versions"])

    def run(self, ticks: int, warm: bool) -> None:
        """Let it run a block."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{ticks}\n")
        self.process.stdin.flush()
        self.last = self._answer(self.label, self.process)
        if warm:
            self.times += self.last["times"]
            self.ticks += self.last["ticks"]

    @staticmethod
    def _answer(label: str, process: "subprocess.Popen[str]") -> dict[str, Any]:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise SystemExit(f"{label} ended with exit code {process.wait()}")
        return json.loads(line)


def sphere_pairs() -> list[tuple[str, str]]:
    """Return 25 pairs of links: both arms and the body, and hand and hand."""
    arms = [f"{side}_{link}" for side in ("left", "right") for link in ARMS]
    return [(arm, link) for arm in arms for link in BODY] + [(arms[2], arms[5])]


def write_job(
    folder: Path, dt: float, pairs: Sequence[tuple[str, str]] = (), slow: bool = False
) -> Path:
    """Write the robot without meshes, as URDF and for MuJoCo, and its start.

    ``pairs`` are links to be kept apart, which get spheres; ``slow``: joints may not be fast.
    """
    robot = Robot.load(ROBOT)
    speeds = np.full(robot.nv - 6, SLOW) if slow else robot.limits.velocity
    folder.mkdir(parents=True, exist_ok=True)
    root = ET.parse(robot.path).getroot()
    for link in root.iter("link"):
        for part in [one for one in link if one.tag in ("visual", "collision")]:
            link.remove(part)
    for extra in [one for one in root if one.tag not in ("link", "joint")]:
        root.remove(extra)
    for link in root.iter("link"):
        if any(link.get("name") in pair for pair in pairs):
            sphere = ET.SubElement(link, "collision", name=f"{link.get('name')}_ball")
            ET.SubElement(ET.SubElement(sphere, "geometry"), "sphere", radius=f"{RADIUS}")
    for limit in root.iter("limit") if slow else ():
        limit.set("velocity", str(SLOW))
    urdf, mjcf = folder / "g1.urdf", folder / "g1_mujoco.urdf"
    ET.ElementTree(root).write(urdf)
    children = {joint.find("child").get("link") for joint in root.iter("joint")}
    base = next(link.get("name") for link in root.iter("link") if link.get("name") not in children)
    options = ET.SubElement(root, "mujoco")
    ET.SubElement(options, "compiler", fusestatic="false", discardvisual="false")
    ET.SubElement(root, "link", name="world")
    joint = ET.SubElement(root, "joint", name="floating_base", type="floating")
    ET.SubElement(joint, "parent", link="world")
    ET.SubElement(joint, "child", link=base)
    ET.ElementTree(root).write(mjcf)
    q = robot.posture("standing")
    positions = robot.limits.joint_positions(q)
    names = robot.joint_names
    told = {
        "robot": ROBOT, "urdf": str(urdf), "mjcf": str(mjcf),
        "dt": dt, "feet": FEET, "trunk": TRUNK,
        "pairs": [*pairs], "radius": RADIUS, "margin": MARGIN,
        "base": q[:7].tolist(), "joints": dict(zip(names, positions.tolist(), strict=True)),
        "velocities": dict(zip(names, speeds.tolist(), strict=True)),
        "corners": [corners(robot, q, foot) for foot in FEET],
        "efforts": dict(zip(names, robot.limits.effort.tolist(), strict=True)),
    }  # fmt: skip
    job = folder / "job.json"
    job.write_text(json.dumps(told), encoding="utf-8")
    return job


def corners(robot: Robot, q: np.ndarray, link: str) -> list[list[float]]:
    """Return the corners of a sole (k, 3) in the axes of its link."""
    foot = next(one for one in robot.feet.values() if one.link == link)
    here = robot.snapshot(q)
    flat = np.column_stack((foot.polygon, np.zeros(len(foot.polygon))))
    world = here.position(foot.frame) + flat @ here.rotation(foot.frame).T
    return ((world - here.position(link)) @ here.rotation(link)).tolist()


def rows(loops: list[Loop]) -> list[str]:
    """Return the table, and report unequal work."""
    plain = [one for one in loops if "inertia" not in one.label]
    middle = float(np.median([one.last["com_rms"] for one in plain]))
    reference = loops[-1]
    lines = [
        f"| loop | median [us] | p99 | to {reference.label} | its tick [us] | to {reference.label}"
        " | CoM RMS [mm] | feet drift [mm] | speed / limit |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    nearest = float(np.median([one.last.get("gap", np.inf) for one in plain]))
    for one in loops:
        p50, p99 = np.percentile(one.times, (50, 99))
        tick = np.median(one.ticks)
        told = one.last
        lines.append(
            f"| {one.label} | {1e6 * p50:.0f} | {1e6 * p99:.0f} |"
            f" {p50 / np.median(reference.times):.2f} |"
            f" {1e6 * tick:.0f} | {tick / np.median(reference.ticks):.2f} |"
            f" {1e3 * told['com_rms']:.3f} | {1e3 * told['drift']:.4f} | {told['speed']:.2f} |"
        )
        fair = abs(told["com_rms"] / middle - 1.0) < 0.05 or one not in plain
        gap = told.get("gap", np.inf)
        apart = gap > MARGIN and (one not in plain or gap == nearest or abs(gap - nearest) < 2e-3)
        fair = fair and apart
        if not fair or told["drift"] > 1e-4 or told["speed"] > 1.0 + 1e-6:
            print(f"UNEQUAL WORK: {one.label}: {told}", file=sys.stderr)
    return lines


def race(level: str, ticks: int, only: list[str] | None) -> tuple[list[str], dict[str, str]]:
    """Run the loops of a level in turns; return their table and versions."""
    pairs = sphere_pairs() if "pairs" in level else ()
    folder = BUILD / level.replace(", ", "_").replace(" ", "_")
    job = write_job(folder, DT[level], pairs, slow="slow" in level)
    chosen = [one for one in LOOPS[level] if not only or one[1] in only]
    missing = {one[1] for one in chosen if one[1] != "wbc" and not (BUILD / one[1]).is_dir()}
    loops = [Loop.start(*one, job) for one in chosen if one[1] not in missing]
    for block in range(-(-(WARM_UP + ticks) // BLOCK)):
        for loop in loops[block % len(loops) :] + loops[: block % len(loops)]:
            loop.run(BLOCK, warm=block * BLOCK >= WARM_UP)
    for loop in loops:
        loop.process.communicate()
    table = rows(loops)
    if missing:
        table += ["", f"Left out: {', '.join(sorted(missing))}; environments.sh makes them."]
    return table, {name: one for loop in loops for name, one in loop.versions.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2000, help="after 200 of warm-up")
    parser.add_argument("--only", nargs="+", help="environments, as in wbc placo")
    parser.add_argument("--output", type=Path, help="put the tables here, between its marks")
    options = parser.parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # and all that are started
    told, versions = [], {}
    for level in LOOPS:
        table, found = race(level, options.ticks, options.only)
        name, comma, more = level.partition(", ")
        told += [f"### The {name} level{comma}{more}", "", *table, ""]
        versions |= {f"{name} {one}": "" for name, one in found.items()}
    told.append(
        f"{options.ticks} ticks each, in turns of {BLOCK}, thread CPU time, on one core of"
        f" {machine()}; {', '.join(sorted(versions))}. Command:"
        f" `python benchmarks/peers/run.py --ticks {options.ticks}`."
    )
    print("\n".join(told))
    if options.output:
        put_section(options.output, "peers", "\n".join(told))


if __name__ == "__main__":
    main()
