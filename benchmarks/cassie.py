"""Cassie of a public MJCF: stands on the lines of its feet by torques at its ten motors.

Its leaf springs are taken for rigid, or are joints that give way (``--free``); the ball ends of its
achilles rods are three hinges each; each foot is a capsule that lies on the ground, held at its two
ends. It is pushed ahead by 0.3 M omega d after a second, in our plant and in the file's own model
under raw MuJoCo, in which the springs give way.

Two things make it fall with free springs, which are 30 to 40 mrad from rest where they bear it: a
start with springs at rest, which drops, and a posture that holds springs and rods where they were.
So springs begin loaded, by statics, and the posture is that of joints with motors.

In the file's own model, whose loops and contacts give way too, it still falls after two seconds
with free springs: the ground's forces come through the springs alone, so that within a tick motors
act on what is asked for by the small inertia between them and the springs, and torques chatter by
20 N m. Ticks of 1 ms, forces without jumps, softer gains and damped springs do not mend that.

    python benchmarks/cassie.py agility_cassie/cassie.xml [--seconds 10] [--free] [--push 0.3]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import logging
from pathlib import Path
from typing import Any

import numpy as np
from foreign_reading import spec_of
from foreign_trial import AWAY, LASTING, LEAST_HEIGHT, MOST_TILT, RATIO, RawModel, add_ground

import wbc
from wbc.constraints.contact import PointContact
from wbc.simulation import Plant, capture_impulse, simulate

DT, PUSHED = 0.002, 1.0  # s
SPRINGS = {"*-shin": 0.0, "*-heel-spring": 0.0}
ROUNDS = 6  # of statics and deflections, each of which changes the other by a twentieth
SIDES, HALF = ("left", "right"), 0.08  # half the length of a foot that is on the ground [m]
ENDS = tuple(f"{side}_{name}" for side in SIDES for name in ("heel", "toe"))


def spec_with_ends(path: Path) -> Any:
    """Return the specification with sites at the ends of its feet."""
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
    return spec


def loaded(robot: wbc.Robot, path: Path) -> np.ndarray:
    """Return the standing configuration (nq,) with springs where they bear it.

    What they must give is what a robot asks for that has motors in their place.
    """
    q, springs = robot.posture(), robot.passive.springs
    if not springs:
        return q
    spec = spec_with_ends(path)
    for joint in spec.joints:
        if str(joint.name) in springs:
            joint.stiffness = np.zeros_like(joint.stiffness)
    rods = [name for name in robot.motorless if name not in springs]
    driven = wbc.Robot.load(spec, unactuated=rods)
    kept = [name for name in robot.joint_names if name not in rods]
    height = min(robot.snapshot(q).position(end)[2] for end in ENDS)
    for _ in range(ROUNDS):
        torque = controller_of(driven, q).step(driven.snapshot(q)).torque
        for name, spring in springs.items():
            given = float(torque[driven.joint_names.index(name)])
            robot.limits.set_joint(q, name, spring.rest - given / spring.stiffness)
        q = robot.closed(q, kept=kept)
        q[2] += height - min(robot.snapshot(q).position(end)[2] for end in ENDS)
    return q


def controller_of(robot: wbc.Robot, q: np.ndarray) -> wbc.TorqueController:
    start = robot.snapshot(q)
    tasks = [
        wbc.ComTask(robot, start.com),
        wbc.OrientationTask(robot, "base", start.rotation("base")),
        wbc.PostureTask(robot, q, joints=dict.fromkeys(robot.motorless, 0.0), weight=0.1),
    ]
    contacts = [PointContact.hold(start, end) for end in ENDS]
    return wbc.TorqueController(robot, tasks, contacts=contacts, dt=DT, solver="active_set")


def in_plant(robot: wbc.Robot, q: np.ndarray, seconds: float, push: np.ndarray) -> str:
    plant, controller, gap, relaxed = Plant(robot, dt=DT), controller_of(robot, q), 0.0, 0
    plant.reset(q)
    plant.push("base", push, "com", start=PUSHED, duration=LASTING)
    for now in simulate(controller, plant, seconds):
        gap = max(gap, *robot.gaps(plant.state()[0]).values())
        relaxed += bool(now.tick.relaxed)
    return (
        f"{now.verdict.reason}, loops open by {1e3 * gap:.3f} mm at most, CoM {plant.com.round(3)},"
        f" {relaxed} ticks relaxed"
    )


def in_its_own(
    robot: wbc.Robot, q: np.ndarray, path: Path, seconds: float, push: np.ndarray
) -> str:
    import mujoco

    spec, _ = spec_of(mujoco, path)
    add_ground(mujoco, spec)
    model: Any = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    raw, controller = RawModel.of(mujoco, model, robot), controller_of(robot, q)
    if raw is None:
        raise SystemExit(f"{path}: the root has no free joint")
    every = round(DT / model.opt.timestep)
    start = robot.snapshot(q)
    raw.write(q)
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
    parser.add_argument("--free", action="store_true", help="springs are joints, not rigid")
    parser.add_argument("--push", type=float, default=RATIO, help="of M omega d")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    locked = {} if options.free else SPRINGS
    robot = wbc.Robot.load(spec_with_ends(options.path), locked=locked)
    q = loaded(robot, options.path)
    start = robot.snapshot(q)
    impulse = options.push * capture_impulse(start, robot.feet, AWAY)
    push = impulse / LASTING * AWAY
    motors = len(robot.joint_names) - len(robot.motorless)
    print(
        f"{robot.name}: {robot.mass:.2f} kg, {motors} motors, {len(robot.loops)} loops, pushed by"
    )
    print(
        f"{impulse:.2f} N s. In our plant: {in_plant(robot, q, options.seconds, push)}", flush=True
    )
    print(
        f"Its own model, springs in it: {in_its_own(robot, q, options.path, options.seconds, push)}"
    )


if __name__ == "__main__":
    main()
