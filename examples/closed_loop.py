"""A closed loop, which URDF cannot describe: a four-bar that one motor swings and holds up.

The tree is open: crank and coupler in series on the base, the rocker next to them. Two frames mark
the pin; `loops=` makes them coincide, `unactuated=` names the joints without a motor.
"""

import tempfile
from pathlib import Path

import numpy as np

import wbc

LINK = """<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="0.5"/>
<inertia ixx="0.002" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{at}"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" velocity="5" effort="20"/></joint>"""
FRAME = """<link name="{name}"/><joint name="{name}_joint" type="fixed">
<parent link="{parent}"/><child link="{name}"/><origin xyz="{at}"/></joint>"""
PARTS = [
    *(LINK.format(name=name, x=x) for name, x in (("base", 0), ("crank", 0.05))),
    *(LINK.format(name=name, x=x) for name, x in (("coupler", 0.1), ("rocker", 0.04))),
    JOINT.format(name="motor", parent="base", child="crank", at="0 0 0"),
    JOINT.format(name="b", parent="crank", child="coupler", at="0.1 0 0"),
    JOINT.format(name="d", parent="base", child="rocker", at="0.22 0 -0.05"),
    FRAME.format(name="coupler_end", parent="coupler", at="0.2 0 0"),
    FRAME.format(name="rocker_end", parent="rocker", at="0.08 0 0.05"),
]

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "four_bar.urdf"
    path.write_text(f'<robot name="four_bar">{"".join(PARTS)}</robot>', encoding="utf-8")
    robot = wbc.Robot.load(
        path, base="fixed", loops={"pin": ("coupler_end", "rocker_end")}, unactuated=["b", "d"]
    )

q, dt = robot.posture("standing", {"motor": 0.4}), 0.005  # b, d follow
v = robot.snapshot(q).v
end = robot.posture("standing", {"motor": -0.6})
posture = wbc.PostureTask(robot, end, gain=0.05)
controller = wbc.KinematicController(robot, [posture], limits=wbc.Limits(robot), dt=dt)
gap = 0.0
for _ in range(300):
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
    gap = max(gap, *robot.gaps(q).values())
hold = wbc.TorqueController(robot, [wbc.PostureTask(robot, q)])
tick = hold.step(robot.snapshot(q))
torque = dict(zip(robot.joint_names, tick.torque, strict=True))
angle = dict(zip(robot.joint_names, q[7:], strict=True))["motor"]
force = np.linalg.norm(tick.forces["loop pin"])
print(
    f"motor at {angle:.3f} rad; the pin was open by {1e9 * gap:.3f} nm at most; held by"
    f" {torque['motor']:.3f} N m, {force:.2f} N in the pin, and {torque['b']:.0f} N m elsewhere"
)
