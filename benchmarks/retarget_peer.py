"""The same human on the same robot by per-frame IK on mink: a row for benchmarks/retarget.py.

It gets the human's pelvis, trunk and feet, lengths scaled by the legs' as GMR scales them, and
elbows and hands at the robot's arm lengths along the human's directions. Its result is checked as
our own.
"""

import os
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np

import wbc
from wbc.gait.legs import SIDES
from wbc.human import HumanMotion
from wbc.retargeting.pipeline import FRICTION, evaluate
from wbc.retargeting.robot_setup import robot_setup
from wbc.retargeting.source import human_frames
from wbc.robot.chains import leg_joints
from wbc.rotations import quaternion_from

PYTHON = Path(__file__).resolve().parents[1] / "build" / "peers" / "mink" / "bin" / "python"
LOOP = Path(__file__).resolve().parent / "peers" / "retarget_mink.py"
# Costs of places and rotations, of pelvis, trunk, feet, elbows and hands; first and second table.
COSTS = (
    ((0, 10), (0, 100), (50, 10), (5, 0), (5, 0)),
    ((100, 5), (0, 10), (50, 10), (10, 0), (10, 0)),
)


def by_mink(human: HumanMotion, found: wbc.Retargeted) -> tuple[wbc.Retargeted, float] | None:
    """Return mink's motion of the frames, and its CPU time; None: no environment."""
    python = Path(os.environ.get("WBC_PEERS", PYTHON.parents[2])) / "mink" / "bin" / "python"
    if not python.exists():
        return None
    robot, known = found.robot, robot_setup(found.robot, None, 0.01)
    body, scale = known.body, found.scale
    source = human_frames(human, found.rate * scale.time, human.cutoff)
    frames = [body.pelvis, body.trunk, *(robot.feet[side].frame for side in SIDES)]
    kinds = [0, 1, 2, 2]
    for arm in body.arms.values():
        frames += [arm.forearm, arm.hand]
        kinds += [3, 4]
    place, turn = _targets(source, robot, body, scale.length)
    with tempfile.TemporaryDirectory() as folder:
        job, out = Path(folder) / "job.npz", Path(folder) / "out.npz"
        q = robot.posture("standing").copy()
        q[:3] = place[0, 0]
        np.savez(
            job, xml=_xml(robot, frames), start=np.concatenate((q[:3], q[[6, 3, 4, 5]], q[7:])),
            sites=frames, joints=robot.joint_names, place=place, rotation=turn,
            costs=[[table[kind] for kind in kinds] for table in COSTS],
        )  # fmt: skip
        subprocess.run([python, LOOP, job, out], check=True)
        with np.load(out) as file:
            q = np.hstack((file["base"], file["joints"]))
            seconds, version = float(file["seconds"]), str(file["version"])
    notes = (f"mink {version}",)
    motion = evaluate(robot, known, found.source, scale, found.targets, q, FRICTION, notes)
    return motion, seconds


def _targets(source: Any, robot: wbc.Robot, body: Any, length: float) -> tuple[Any, Any]:
    """Return places (n, f, 3) and rotations (n, f, 3, 3) of the frames."""
    start = robot.snapshot(robot.postures["standing"])
    ground = source.series.ground_height
    pelvis = source.rotation["pelvis"] @ body.upright[body.pelvis]
    trunk = source.rotation["trunk"] @ body.upright[body.trunk]
    hips = length * (source.series.com + source.hips - [0.0, 0.0, ground])
    names = [str(robot.model.names[leg_joints(robot, side)[0]]) for side in SIDES]
    middle = np.mean([start.position(name) for name in names], axis=0)
    R0, p0 = start.rotation(body.pelvis), start.position(body.pelvis)
    places = [hips - pelvis @ (R0.T @ (middle - p0))]
    at_trunk = places[0] + pelvis @ (R0.T @ (start.position(body.trunk) - p0))
    rotations = [pelvis, trunk]
    places.append(at_trunk)
    for side in SIDES:
        sole = robot.feet[side].frame
        ankle = str(robot.model.names[leg_joints(robot, side)[-1]])
        off = start.rotation(sole).T @ (start.position(sole) - start.position(ankle))
        place, R = length * source.soles[side][0], source.sole_rotation[side]
        places.append(place + R @ [off[0], off[1], 0.0])
        rotations.append(R)
    T0, t0 = start.rotation(body.trunk), start.position(body.trunk)
    for side, arm in body.arms.items():
        at = at_trunk + trunk @ (T0.T @ (start.position(arm.upper_arm) - t0))
        ends = [start.position(one) for one in (arm.upper_arm, arm.forearm, arm.hand)]
        for part, size in zip(("upper_arm", "forearm"), np.diff(ends, axis=0), strict=True):
            at = at - np.linalg.norm(size) * source.rotation[f"{side}_{part}"][:, :, 2]
            places.append(at)
            rotations.append(np.broadcast_to(np.eye(3), (len(at), 3, 3)))
    return np.stack(places, axis=1), np.stack(rotations, axis=1)


def _xml(robot: wbc.Robot, frames: list[str]) -> str:
    """Return the kinematic tree for MuJoCo, with a site at each frame."""
    model, arrays = robot.model, robot.native.tree.arrays
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    bodies = {0: ET.SubElement(root, "worldbody")}
    for j in range(1, model.njoints):
        T = model.jointPlacements[j]
        quaternion = quaternion_from(T.rotation)[[3, 0, 1, 2]]
        body = ET.SubElement(bodies[int(model.parents[j]) if j > 1 else 0], "body", name=f"body{j}",
                             pos=_text(T.translation), quat=_text(quaternion))  # fmt: skip
        inertia = model.inertias[j]
        mass = max(float(inertia.mass), 1e-3)
        ET.SubElement(body, "inertial", pos=_text(inertia.lever), mass=f"{mass:.9g}",
                      diaginertia="1e-2 1e-2 1e-2")  # fmt: skip
        name = str(model.names[j])
        if j == 1:
            ET.SubElement(body, "freejoint", name=name)
        else:
            k = robot.joint_names.index(name)
            slides = model.joints[j].shortname().startswith("JointModelP")
            ET.SubElement(body, "joint", name=name, type="slide" if slides else "hinge",
                          axis=_text(arrays["axis"][j]),
                          range=_text([robot.limits.lower[k], robot.limits.upper[k]]))  # fmt: skip
        bodies[j] = body
    for frame in frames:
        one = robot.frame(frame)
        quaternion = quaternion_from(one.placement.rotation)[[3, 0, 1, 2]]
        ET.SubElement(bodies[int(one.parentJoint)], "site", name=frame,
                      pos=_text(one.placement.translation), quat=_text(quaternion))  # fmt: skip
    return ET.tostring(root, encoding="unicode")


def _text(values: Any) -> str:
    return " ".join(f"{value:.12g}" for value in values)
