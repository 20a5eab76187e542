"""Cassie of a public MJCF: stands on the lines of its feet by torques at its ten motors.

Its leaf springs are stiff and taken for rigid; the ball ends of its achilles rods are three hinges
each; each foot is a capsule that lies on the ground, held at its two ends. It is pushed ahead by
0.3 M omega d after a second, in our plant and in the file's own model under raw MuJoCo, in which
the springs give way.

    python benchmarks/cassie.py agility_cassie/cassie.xml [--seconds 10]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import logging
from pathlib import Path
from typing import Any

import numpy as np
from foreign_reading import spec_of
from foreign_trial import AWAY, LASTING, LEAST_HEIGHT, MOST_TILT, RATIO, RawModel

import wbc
from wbc.constraints.contact import PointContact
from wbc.simulation import Plant, capture_impulse, simulate

DT, PUSHED = 0.002, 1.0  # s
SPRINGS = {"*-shin": 0.0, "*-heel-spring": 0.0}
SIDES, HALF = ("left", "right"), 0.08  # half the length of a foot that is on the ground [m]


def cassie_of(path: Path) -> wbc.Robot:
    """Return the robot with sites at the ends of its feet, springs rigid."""
    import mujoco

    found = wbc.Robot.load(path)
    here = found.snapshot(found.posture())
    spec = mujoco.MjSpec.from_file(str(path))
    for side in SIDES:
        link, sole = f"{side}-foot", found.feet[side].frame
        origin, R = here.position(link), here.rotation(link)
        for name, along in (("heel", -HALF), ("toe", HALF)):
            place = here.position(sole) + along * here.rotation(sole)[:, 0]
            spec.body(link).add_site(name=f"{side}_{name}", pos=R.T @ (place - origin))
    return wbc.Robot.load(spec, locked=SPRINGS)


def controller_of(robot: wbc.Robot) -> wbc.TorqueController:
    start = robot.snapshot(robot.posture())
    tasks = [
        wbc.ComTask(robot, start.com),
        wbc.OrientationTask(robot, "base", start.rotation("base")),
        wbc.PostureTask(robot, start.q),
    ]
    ends = [f"{side}_{name}" for side in SIDES for name in ("heel", "toe")]
    contacts = [PointContact.hold(start, end) for end in ends]
    return wbc.TorqueController(robot, tasks, contacts=contacts, dt=DT, solver="active_set")


def in_plant(robot: wbc.Robot, seconds: float, push: np.ndarray) -> str:
    plant, controller, gap, relaxed = Plant(robot, dt=DT), controller_of(robot), 0.0, 0
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
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50.0, 50.0, 1.0])
    model: Any = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    raw, controller = RawModel.of(mujoco, model, robot), controller_of(robot)
    if raw is None:
        raise SystemExit(f"{path}: the root has no free joint")
    every = round(DT / model.opt.timestep)
    start = robot.snapshot(robot.posture())
    raw.write(start.q)
    for _ in range(round(seconds / DT)):
        now = robot.snapshot(*raw.state())
        tilt = float(np.arccos(np.clip(now.rotation("base")[2, 2], -1.0, 1.0)))
        if now.com[2] < LEAST_HEIGHT * start.com[2] or tilt > MOST_TILT:
            return f"fell after {raw.data.time:.2f} s"
        acts = PUSHED <= raw.data.time < PUSHED + LASTING
        raw.step(controller.step(now).torque, every, push if acts else None, now.com)
    return f"stood for {seconds:g} s, CoM {now.com.round(3)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    robot = cassie_of(options.path)
    start = robot.snapshot(robot.posture())
    impulse = RATIO * capture_impulse(start, robot.feet, AWAY)
    push = impulse / LASTING * AWAY
    motors = len(robot.joint_names) - len(robot.motorless)
    print(
        f"{robot.name}: {robot.mass:.2f} kg, {motors} motors, {len(robot.loops)} loops, pushed by"
    )
    print(f"{impulse:.2f} N s. In our plant: {in_plant(robot, options.seconds, push)}", flush=True)
    print(f"Its own model, springs in it: {in_its_own(robot, options.path, options.seconds, push)}")


if __name__ == "__main__":
    main()
