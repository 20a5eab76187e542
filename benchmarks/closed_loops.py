"""Bipeds with closed loops in their MJCF, Cassie and Digit: standing by torques at motors alone.

Leaf springs are rigid, or compliant joints (``--free``) that begin at rest; the ball ends of rods
are three hinges each. The robots are pushed ahead by 0.3 M omega d after a second, in our plant and
in the file's own model under raw MuJoCo, with compliant springs and slightly compliant loops and
contacts.

The posture target is that of joints with motors: under load they are 30 to 40 mrad from their rest
position.

    python benchmarks/closed_loops.py cassie.xml [--seconds 10] [--free] [--push 0.3]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import logging
from pathlib import Path
from typing import Any

import numpy as np
from foreign_reading import spec_of
from foreign_trial import AWAY, DT, LASTING, RATIO, RawModel, add_ground, controller_of

import wbc
from wbc.simulation import Plant, capture_impulse, simulate

PUSHED = 1.0  # s
POSTURE = 0.1  # weight


def in_plant(robot: wbc.Robot, seconds: float, push: np.ndarray) -> str:
    plant, controller = Plant(robot, dt=DT), controller_of(robot, posture=POSTURE)
    gap, relaxed = 0.0, 0
    plant.push("base", push, "com", start=PUSHED, duration=LASTING)
    for now in simulate(controller, plant, seconds):
        gap = max(gap, *robot.gaps(plant.state()[0]).values())
        relaxed += bool(now.tick.relaxed)
    return (
        f"{now.verdict.reason}, loops open by {1e3 * gap:.3f} mm at most, CoM {plant.com.round(3)},"
        f" {relaxed} ticks relaxed"
    )


def in_its_own(robot: wbc.Robot, path: Path, seconds: float, push: np.ndarray) -> str:
    import mujoco

    spec, _ = spec_of(mujoco, path)
    add_ground(mujoco, spec)
    model: Any = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    raw = RawModel.of(mujoco, model, robot)
    if raw is None:
        raise SystemExit(f"{path}: the root has no free joint")
    every = round(DT / model.opt.timestep)
    controller = controller_of(robot, posture=POSTURE)
    stood, now = raw.stand(controller, every, seconds, push, PUSHED)
    if not stood:
        return f"fell after {raw.data.time:.2f} s"
    return f"stood for {seconds:g} s, CoM {now.com.round(3)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--free", action="store_true", help="springs are joints, not rigid")
    parser.add_argument("--push", type=float, default=RATIO, help="of M omega d")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    robot = wbc.Robot.load(options.path)
    if not options.free:
        rigid = {name: spring.rest for name, spring in robot.passive.springs.items()}
        robot = wbc.Robot.load(options.path, locked=rigid)
    start = robot.snapshot(robot.posture())
    impulse = options.push * capture_impulse(start, robot.feet, AWAY)
    push = impulse / LASTING * AWAY
    motors = len(robot.joint_names) - len(robot.motorless)
    print(
        f"{robot.name}: {robot.mass:.2f} kg, {motors} motors, {len(robot.loops)} loops, pushed by"
    )
    print(f"{impulse:.2f} N s. In our plant: {in_plant(robot, options.seconds, push)}", flush=True)
    print(f"Its own model, springs in it: {in_its_own(robot, options.path, options.seconds, push)}")


if __name__ == "__main__":
    main()
