"""Time and memory of `wbc analyze` on a long recording, on one core.

The job: squats with arms swinging, 20,000 frames of a 25-joint robot as CSV without a base; read,
base found from the lower foot, filtered, reduced; then saved. Thread CPU time, the best of three,
after imports and loading the robot.

    python benchmarks/analyze.py [--robot hoap2_like] [--frames 20000]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import platform
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from time import thread_time

import numpy as np

from wbc.motion import analyze, read_motion
from wbc.robot import Robot

RATE, REPEATS = 200.0, 3
SWING = {"*_hip_pitch*": -0.5, "*_knee*": 1.0, "*_ankle_pitch*": -0.5, "*_shoulder_pitch*": -0.8}


def write_squats(robot: Robot, frames: int, path: Path) -> None:
    """Write a recording in which both legs bend and stretch every three seconds."""
    time = np.arange(frames) / RATE
    bend = np.sin(np.pi * time / 3.0) ** 2
    joints = np.tile(robot.limits.joint_positions(robot.postures["standing"]), (frames, 1))
    for pattern, size in SWING.items():
        for k in robot.joint_indices(pattern):
            joints[:, k - 6] += size * bend
    header = ",".join(("time", *robot.joint_names))
    rows = np.column_stack((time, joints))
    np.savetxt(path, rows, delimiter=",", fmt="%.9g", header=header, comments="")


def best(job: Callable[[], object]) -> float:
    """Return the least CPU time of three runs [s]."""
    times = []
    for _ in range(REPEATS):
        began = thread_time()
        job()
        times.append(thread_time() - began)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="hoap2_like")
    parser.add_argument("--frames", type=int, default=20_000)
    options = parser.parse_args()
    robot = Robot.load(options.robot)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "squats.csv"
        write_squats(robot, options.frames, path)
        motion = read_motion(path, robot)
        series = analyze(motion, planted="auto")
        times = {
            "read CSV": best(lambda: read_motion(path, robot)),
            "analyze": best(lambda: analyze(motion, planted="auto")),
            "no bands": best(lambda: analyze(motion, planted="auto", noise=None)),
            "save .npz": best(lambda: series.save(Path(folder) / "s.npz")),
            "save .csv": best(lambda: series.save(Path(folder) / "s.csv")),
        }
    tracemalloc.start()
    analyze(motion, planted="auto")
    peak = tracemalloc.get_traced_memory()[1]
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    print(f"{robot!r}, {len(robot.joint_names)} joints, {len(series)} frames")
    for name, seconds in times.items():
        print(f"{name:10} {seconds:6.3f} s CPU  {1e6 * seconds / len(series):6.1f} us a frame")
    print(f"memory     {peak / len(series):6.0f} bytes a frame at its peak, while analysing")


if __name__ == "__main__":
    main()
