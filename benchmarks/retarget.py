"""Human motion on humanoids: constraints, accuracy, speed, and simulated walks.

Recordings are not part of the project: any files that `wbc analyze` reads. Feet, limits and margins
are checked independently of the retargeting: margins by the shapes of the robot's files (Coal),
torques by inverse dynamics. Frames per second are of CPU time of one process, including everything
after the fit of the human. A first run pays for what is found out about a robot once: names,
limits, and trees of the meshes of bodies that come near each other. With `--peer` per-frame IK on
mink gets the same frames (benchmarks/retarget_peer.py). With `--physics` the first recording's walk
is simulated in MuJoCo, on its footsteps and with its arms, with noise, 2 ms of delay and masses
wrong by up to 10 % (benchmarks/disturbed.py), over seeds.

    python benchmarks/retarget.py walk.trc [more.bvh ...] [--forces walk_grf.mot]
        [--static static.trc] [--robots g1 talos ...] [--physics 10] [-o benchmarks/retarget.json]
        [--peer] [--page benchmarks/RESULTS.md] [--plot docs/pictures/retarget_g1.png]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import json
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from com_bound import com_bound
from disturbed import DT, plant_of, robot_named
from human_walk import rounded
from qpbench.page import put_section
from raw_shapes import RawShapes
from retarget_peer import by_mink

import wbc
from wbc.constraints import SelfCollision
from wbc.gait import Walker
from wbc.gait.phases import Standing
from wbc.human import HumanMotion, human_motion, read_markers
from wbc.retargeting.steps import footsteps, posture_at
from wbc.retargeting.trajectory_problem import max_accelerations
from wbc.robot import Robot
from wbc.simulation import FallLimits, FallWatch, Terrain
from wbc.tasks import PostureTask

ROBOTS = ("g1", "talos", "hoap2_like", "g1_27")
MARGIN = 0.01  # m
KINDS = ("speed_by_limit", "acceleration_by_motor", "torque_by_limit")
MOMENTS, HALF = 5, 640  # in a picture, and how wide a half of it is [pixels]
STEPS, MOST = 14, 20.0  # of the walk in physics, and s


def figures(found: wbc.Retargeted, seconds: float) -> dict[str, Any]:
    """Return the figures of one motion."""
    robot, limits = found.robot, found.robot.limits
    raw = RawShapes(robot, SelfCollision(robot, margin=MARGIN))
    broken = max(raw.broken(q) for q in found.q)
    joints = np.array([robot.snapshot(q).joint_positions for q in found.q])
    past = np.maximum(limits.lower - joints, joints - limits.upper).max()
    able = max_accelerations(robot)
    reached = {one.task: {"rms": one.rms, "largest": one.largest} for one in found.reached}
    worst = {one.what: one.by for one in sorted(found.unbalanced, key=lambda one: one.by)}
    return {
        "frames": len(found),
        "rate_hz": found.rate,
        "frames_per_second": len(found) / seconds,
        "slide_mm": 1e3 * found.slide,
        "margin_broken_mm": 1e3 * broken[0],
        "pair": broken[1],
        "past_limits_rad": max(0.0, float(past)),
        "speed_by_limit": float((np.abs(found.v[:, 6:]) / limits.velocity).max()),
        "acceleration_by_motor": float((np.abs(found.acceleration[:, 6:]) / able).max()),
        "torque_by_limit": float((np.abs(found.torque) / limits.effort).max()),
        "com_correlation": found.com_correlation.tolist(),
        "angular_momentum_correlation": found.angular_momentum_correlation.tolist(),
        "angular_momentum_together": together(found),
        "reached": reached,
        "unbalanced": worst,
        "unbalanced_frames_percent": 100.0 * unbalanced_share(found),
        "length_scale": found.scale.length,
        "time_scale": found.scale.time,
        "told_broken": [str(one) for one in found.broken],
        "notes": list(found.notes),
    }


def together(found: wbc.Retargeted) -> float:
    """Return the correlation of all three components of the angular momentum at once."""
    both = found.whole.momentum[:, 3:].ravel(), found.targets.angular_momentum.ravel()
    return float(np.corrcoef(*both)[0, 1])


def unbalanced_share(found: wbc.Retargeted) -> float:
    """Return the share of the frames with an infeasible quantity."""
    bad = np.zeros(len(found), dtype=bool)
    for one in found.unbalanced:
        bad |= (found.time >= one.start - 1e-9) & (found.time <= one.end + 1e-9)
    return float(bad.mean())


@cache
def cached_robot(name: str) -> Robot:
    """Return a robot, cached with the data that is the same for all motions."""
    return Robot.load(name)


def timed_retarget(human: HumanMotion, name: str) -> tuple[wbc.Retargeted, float]:
    """Return a human's motion on a robot, and the CPU time of the second run [s].

    In the first one meshes of bodies that come near each other are read.
    """
    robot = cached_robot(name)
    wbc.retarget(human, robot)
    begun = time.process_time()
    found = wbc.retarget(human, robot)
    return found, time.process_time() - begun


def simulate_walk(human: HumanMotion, name: str, seed: int) -> dict[str, Any]:
    """Return the results of a robot that walks as the human does, in MuJoCo."""
    robot = robot_named(name)
    found = wbc.retarget(human, robot)
    arms = [n for n in robot.joint_names if any(p in n for p in ("shoulder", "elbow"))]
    start = robot.postures["standing"].copy()
    swing = PostureTask(robot, start, joints={"*": 0.0} | dict.fromkeys(arms, 1.0), name="arms",
                        weight=0.5, kp=30.0)  # fmt: skip
    walker = Walker(robot, dt=DT, tasks=[swing], delay=0.002)
    plant = plant_of(robot, seed, Terrain(), start)
    watch = FallWatch(plant, FallLimits())
    steps = footsteps(found, STEPS)
    asked = 0.3
    begun = False
    while plant.time < MOST and watch.verdict().stood:
        snapshot = plant.snapshot()
        if not begun and plant.time >= asked:
            walker.follow(steps, snapshot, relative=True)
            begun = True
        if begun and walker.steps < STEPS:
            swing.set_target(posture_at(found, plant.time - asked))
        elif begun and isinstance(walker.phase, Standing):
            break
        plant.step(walker.step(snapshot, plant.contact_forces).torque)
    off = [1e3 * one.distance for one in walker.landings]
    return {
        "seed": seed,
        "stood": bool(watch.verdict().stood),
        "verdict": str(watch.verdict()),
        "steps": walker.steps,
        "seconds": plant.time,
        "ahead_m": float(plant.com[0]),
        "landings_off_mm": [float(np.mean(off)), float(np.max(off))] if off else [],
    }


def picture(human: HumanMotion, found: wbc.Retargeted, path: Path) -> None:
    """Draw the human and the robot at the same moments, side by side."""
    from exposures import exposures_figure
    from PIL import Image

    from wbc.view.style import save

    targets = found.targets
    joints, base = human.motion.joints, human.motion.base
    assert base is not None
    q, begun = (
        np.hstack((base, joints)),
        float(human.motion.time[0]),
    )  # the result's time begins later
    rows = np.linspace(0, len(found) - 1, MOMENTS).round().astype(int)
    # Both ends of the recording are left out of the result.
    lost = 0.5 * (float(human.motion.time[-1]) - begun - found.time[-1] / found.scale.time)
    moments = begun + lost + found.time[rows] / found.scale.time
    at = np.abs(human.motion.time[None] - moments[:, None]).argmin(axis=1)
    parts = []
    for robot, configurations, way in (
        (human.motion.robot, q[at], np.zeros((0, 3))),
        (found.robot, found.q[rows], targets.com),
    ):
        named = {f"{found.time[k]:.1f} s": one for k, one in zip(rows, configurations, strict=True)}
        save(exposures_figure(robot, named, path_of_com=way), path)
        with Image.open(path) as image:
            parts.append(image.convert("RGB"))
    parts = [p.resize((HALF, round(p.height * HALF / p.width))) for p in parts]
    sheet = Image.new("RGB", (2 * HALF, max(p.height for p in parts)), "white")
    for n, part in enumerate(parts):
        sheet.paste(part, (n * HALF, 0))
    sheet.quantize(128).save(path, optimize=True)


def section(known: dict[str, Any]) -> str:
    """Return the tables of a page."""
    lines = ["## Human motion on humanoids", ""]
    heads = (
        "recording, robot", "frames", "per s", "slide mm", "margin broken mm", "past limits rad",
        "speed", "acceleration", "torque", "CoM x y z", "x y at best", "angular momentum x y z",
        "all of it", "long axis deg", "unbalanced frames %", "CoP outside mm", "time",
    )  # fmt: skip
    lines += [f"| {' | '.join(heads)} |", "| --- |" + " ---: |" * (len(heads) - 1)]
    walks = list[list[dict[str, Any]]]()
    for name, table in known.items():
        rows = {robot: one for robot, one in table.items() if isinstance(one, dict)}
        for robot, one in rows.items():
            axis = one["reached"].get("principal axis 1", {}).get("largest", float("nan"))
            cells = (
                f"{name}, {robot}", one["frames"], f"{one['frames_per_second']:.0f}",
                f"{one['slide_mm']:.2f}",
                f"{one['margin_broken_mm']:.1f}", f"{one['past_limits_rad']:.0e}",
                *(f"{one[k]:.2f}" for k in KINDS),
                " ".join(f"{v:.2f}" for v in one["com_correlation"]),
                " ".join(f"{v:.2f}" for v in one.get("com_bound", ())),
                " ".join(f"{v:.2f}" for v in one["angular_momentum_correlation"]),
                f"{one['angular_momentum_together']:.2f}",
                f"{axis:.1f}", f"{one['unbalanced_frames_percent']:.0f}",
                f"{1e3 * one['unbalanced'].get('CoP outside the feet', 0.0):.0f}",
                f"{one['time_scale']:.2f}",
            )  # fmt: skip
            lines.append("| " + " | ".join(map(str, cells)) + " |")
        walks += [one for one in table.values() if isinstance(one, list)]
    for walk in walks:
        stood = sum(bool(one["stood"]) for one in walk)
        off = [one["landings_off_mm"] for one in walk if one["landings_off_mm"]]
        lines += [
            "",
            f"In physics: a G1 stands in {stood} of {len(walk)} walks of"
            f" {max(one['steps'] for one in walk)} steps; feet land"
            f" {np.mean([a for a, _ in off]):.1f} mm from their footsteps in the mean,"
            f" {max(b for _, b in off):.1f} mm at most.",
        ]
    lines.append("")
    lines.append(
        "Speeds, accelerations and torques by what joints and motors can; correlations with the"
        " human's, scaled; x y at best: of any CoM at the human's height and with its momentum"
        " whose CoP is within the robot's soles (benchmarks/com_bound.py); long axis: from the"
        " human's at most; time: by the human's. Frames per second of CPU time on a machine that"
        " much other work shared. Command: `python"
        " benchmarks/retarget.py RECORDING ... -o benchmarks/retarget.json --page"
        " benchmarks/RESULTS.md`."
    )
    return "\n".join(lines)


def _text(known: dict[str, Any]) -> str:
    """Return JSON with a line for each robot on each recording."""
    tables = (
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f" {json.dumps(key)}: {json.dumps(row)}" for key, row in table.items())
        + "\n}"
        for name, table in known.items()
    )
    return "{\n" + ",\n".join(tables) + "\n}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="*", help="none: only --page")
    parser.add_argument("--forces", type=Path)
    parser.add_argument("--static", type=Path)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--physics", type=int, default=0, help="seeds of the walk in MuJoCo")
    parser.add_argument("--only-physics", action="store_true")
    parser.add_argument("--peer", action="store_true", help="per-frame IK on mink beside the first")
    parser.add_argument("--plot", type=Path, help="only draw the first robot beside the human")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--page", type=Path, help="page to write a section into, of the output")
    options = parser.parse_args()
    known: dict[str, Any] = {}
    if options.output is not None and options.output.exists():
        known = json.loads(options.output.read_text())
    for number, path in enumerate(options.recordings):
        first = number == 0
        recording = read_markers(path, forces=options.forces if first else None)
        static = read_markers(options.static) if first and options.static else None
        human = human_motion(recording, static=static, by_steps=False)
        if options.plot is not None:
            picture(human, timed_retarget(human, options.robots[0])[0], options.plot)
            break
        table = known.setdefault(path.stem, {})
        for name in options.robots if not options.only_physics else []:
            found, seconds = timed_retarget(human, name)
            table[name] = rounded({**figures(found, seconds), "com_bound": com_bound(found)})
            print(path.stem, name, json.dumps(table[name]), flush=True)
            if options.peer and name == options.robots[0]:
                other = by_mink(human, found)
                if other is None:
                    parser.error("no environment of mink: benchmarks/peers/environments.sh mink")
                table[f"{name} by mink"] = rounded(figures(*other))
        if first and options.physics:
            rows = []
            for seed in range(options.physics):
                rows.append(rounded(simulate_walk(human, "g1", seed)))
                print(rows[-1], flush=True)
            table["g1 in physics"] = rows
        if options.output is not None:
            options.output.write_text(_text(known))
    if options.page is not None:
        put_section(options.page, "retarget", section(known))


if __name__ == "__main__":
    main()
