"""Human motion on humanoids: what is kept, how near it comes, how fast, and in physics.

Recordings are not part of the project: any files that `wbc analyze` reads. Feet, limits and margins
are judged by other means than those that made the motion: margins by the shapes of the robot's
files (Coal), torques by inverse dynamics. Frames per second are of CPU time of one process, with
everything behind the fit of the human. With `--physics` the first recording's walk is walked in
MuJoCo, on its footsteps and with its arms, with noise, 2 ms of delay and masses that are wrong by
up to 10 % (benchmarks/disturbed.py), over seeds.

    python benchmarks/retarget.py walk.trc [more.bvh ...] [--forces walk_grf.mot]
        [--static static.trc] [--robots g1 talos ...] [--physics 10] [-o benchmarks/retarget.json]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from disturbed import DT, plant_of, robot_named
from human_walk import _rounded as rounded
from raw_shapes import RawShapes

import wbc
from wbc.constraints import SelfCollision
from wbc.gait import Walker
from wbc.gait.phases import Standing
from wbc.human import HumanMotion, human_motion, read_markers
from wbc.retargeting.smoothing import able_accelerations
from wbc.retargeting.steps import footsteps, posture_at
from wbc.simulation import FallLimits, FallWatch, Terrain
from wbc.tasks import PostureTask

ROBOTS = ("g1", "talos", "hoap2_like", "g1_27")
MARGIN = 0.01  # m
STEPS, MOST = 14, 20.0  # of the walk in physics, and s


def figures(found: wbc.Retargeted, seconds: float) -> dict[str, Any]:
    """Return what is judged of one motion."""
    robot, limits = found.robot, found.robot.limits
    raw = RawShapes(robot, SelfCollision(robot, margin=MARGIN))
    broken = max(raw.broken(q) for q in found.q)
    joints = np.array([robot.snapshot(q).joint_positions for q in found.q])
    past = np.maximum(limits.lower - joints, joints - limits.upper).max()
    able = able_accelerations(robot)
    reached = {one.task: {"rms": one.rms, "largest": one.largest} for one in found.reached}
    worst: dict[str, float] = {}
    for one in found.unbalanced:
        worst[one.what] = max(worst.get(one.what, 0.0), one.by)
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
        "reached": reached,
        "unbalanced": worst,
        "unbalanced_frames_percent": 100.0 * unbalanced_share(found),
        "length_scale": found.scale.length,
        "time_scale": found.scale.time,
        "notes": list(found.notes),
    }


def unbalanced_share(found: wbc.Retargeted) -> float:
    """Return the part of the frames in which something cannot be."""
    bad = np.zeros(len(found), dtype=bool)
    for one in found.unbalanced:
        bad |= (found.time >= one.start - 1e-9) & (found.time <= one.end + 1e-9)
    return float(bad.mean())


def retargeted(human: HumanMotion, name: str) -> tuple[wbc.Retargeted, float]:
    """Return a human's motion on a robot, and the CPU time that it took [s]."""
    robot = wbc.Robot.load(name)
    wbc.retarget(human, robot)  # shapes are fitted and cached
    begun = time.process_time()
    found = wbc.retarget(human, robot)
    return found, time.process_time() - begun


def walked(human: HumanMotion, name: str, seed: int) -> dict[str, Any]:
    """Return how a robot walks as the human does, in MuJoCo."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--forces", type=Path)
    parser.add_argument("--static", type=Path)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--physics", type=int, default=0, help="seeds of the walk in MuJoCo")
    parser.add_argument("--only-physics", action="store_true")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    known: dict[str, Any] = {}
    if options.output is not None and options.output.exists():
        known = json.loads(options.output.read_text())
    for number, path in enumerate(options.recordings):
        first = number == 0
        recording = read_markers(path, forces=options.forces if first else None)
        static = read_markers(options.static) if first and options.static else None
        human = human_motion(recording, static=static)
        table = known.setdefault(path.stem, {})
        for name in options.robots if not options.only_physics else []:
            found, seconds = retargeted(human, name)
            table[name] = rounded(figures(found, seconds))
            print(path.stem, name, json.dumps(table[name], indent=1), flush=True)
        if first and options.physics:
            rows = []
            for seed in range(options.physics):
                rows.append(rounded(walked(human, "g1", seed)))
                print(rows[-1], flush=True)
            table["g1 in physics"] = rows
        if options.output is not None:
            options.output.write_text(json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
