"""A robot of your own from a URDF: a quadruped of twelve joints, its trunk moved over its feet.

The example writes its own URDF; yours comes from CAD.
"""

import tempfile
from pathlib import Path

import numpy as np

import wbc

LINK = """<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{leg}_{name}" type="revolute"><parent link="{parent}"/>
<child link="{leg}_{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>
<limit lower="{lower}" upper="{upper}" velocity="8" effort="40"/></joint>"""
FOOT = """<link name="{leg}_foot"/><joint name="{leg}_tip" type="fixed">
<parent link="{leg}_shank"/><child link="{leg}_foot"/><origin xyz="0 0 -0.2"/></joint>"""


def quadruped() -> str:
    """Return the URDF: a trunk, and on each leg a hip roll, a hip pitch and a knee."""
    parts = [LINK.format(name="trunk", z=0, mass=6, i=0.1)]
    for leg, (x, y) in {"FL": (1, 1), "FR": (1, -1), "RL": (-1, 1), "RR": (-1, -1)}.items():
        chain = (
            ("roll", "trunk", "hip", f"{0.2 * x} {0.08 * y} 0", "1 0 0", (-0.8, 0.8)),
            ("pitch", f"{leg}_hip", "thigh", "0 0 0", "0 1 0", (-1.5, 1.5)),
            ("knee", f"{leg}_thigh", "shank", "0 0 -0.2", "0 1 0", (-2.6, 0.0)),
        )
        for name, parent, child, xyz, axis, (lower, upper) in chain:
            names = {"leg": leg, "name": name, "parent": parent, "child": child}
            limits = {"lower": lower, "upper": upper}
            parts.append(LINK.format(name=f"{leg}_{child}", z=-0.1, mass=0.6, i=0.002))
            parts.append(JOINT.format(**names, **limits, xyz=xyz, axis=axis))
        parts.append(FOOT.format(leg=leg))
    return '<robot name="dog">' + "".join(parts) + "</robot>"


with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "dog.urdf"
    path.write_text(quadruped(), encoding="utf-8")
    robot = wbc.Robot.load(path, feet={}, base="floating")  # the feet are points, not soles

q, v, dt = robot.posture("neutral", joints={"*_pitch": 0.8, "*_knee": -1.6}), None, 0.005
start = robot.snapshot(q)
tips = [f"{leg}_foot" for leg in ("FL", "FR", "RL", "RR")]
trunk = wbc.PoseTask(
    robot,
    "trunk",
    start.position("trunk") + [0.03, 0.02, -0.04],
    start.rotation("trunk"),
    name="trunk",
    gain=0.05,
)
contacts = [wbc.PointContact.hold(start, tip) for tip in tips]
controller = wbc.KinematicController(
    robot,
    [trunk, wbc.PostureTask(robot, q, weight=0.001)],
    contacts=contacts,
    limits=wbc.Limits(robot),
    dt=dt,
)
for _ in range(400):
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
slip = max(contact.slip(robot.snapshot(q)) for contact in contacts)
off = np.linalg.norm(tick.errors["trunk"][:3])
print(
    f"{robot.name}: {robot.nv - 6} joints, {robot.mass:.1f} kg; trunk off by {1e3 * off:.3f} mm, "
    f"feet moved {1e3 * slip:.3f} mm"
)
