"""Robots in MJCF for tests, and their agreement with MuJoCo's own model of the same text."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from wbc.robot import Robot, Snapshot

mujoco = pytest.importorskip("mujoco")
INERTIAL = '<inertial pos="0.01 0 .1" mass="{0}" diaginertia=".01 .02 .015"/>'
TRUNK = '<body name="trunk" pos=".2 .1 1" euler="0 .2 .3"><freejoint/>' + INERTIAL.format(5)


def text(bodies: str, *, root: str = TRUNK, head: str = "", tail: str = "") -> str:
    return (
        f'<mujoco model="two"><compiler angle="radian"/>{head}<worldbody>{root}{bodies}</body>'
        f"</worldbody>{tail}</mujoco>"
    )


def arm(joint: str = "", rest: str = "", name: str = "arm") -> str:
    hinge = f'<joint name="j1" axis="0 1 0" range="-1 1" {joint}/>'
    return f'<body name="{name}" pos="0 .1 .2">{hinge}{INERTIAL.format(1)}{rest}</body>'


def load(content: str, **options: Any) -> tuple[Robot, Any]:
    return Robot.load(content, feet={}, **options), mujoco.MjModel.from_xml_string(content)


def forward(model: Any, key: int | None = None) -> Any:
    """Return MuJoCo's data of a model where it is drawn, or in a key frame."""
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def assert_placed(s: Snapshot, data: Any, *bodies: str, atol: float = 1e-12) -> None:
    """Bodies are where MuJoCo has them, turned as there."""
    for name in bodies:
        found = data.body(name)
        np.testing.assert_allclose(s.position(name), found.xpos, atol=atol)
        np.testing.assert_allclose(s.rotation(name), found.xmat.reshape(3, 3), atol=atol)


def assert_agree(robot: Robot, model: Any, seed: int = 0, root: str = "trunk") -> None:
    """Frames, mass, CoM and the joints' mass matrix at random joint positions."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(model)
    joints = [model.joint(name) for name in robot.joint_names]
    for _ in range(3):
        values = rng.uniform(-1, 1, len(joints))
        q = robot.postures["neutral"].copy()
        for k, (joint, value) in enumerate(zip(joints, values, strict=True)):
            data.qpos[int(joint.qposadr[0])] = q[robot.limits.starts[k]] = value
        mujoco.mj_forward(model, data)
        s = robot.snapshot(q)
        names = (model.body(body).name for body in range(1, model.nbody))
        assert_placed(s, data, *filter(None, names))
        for site in range(model.nsite):
            there = s.position(model.site(site).name)
            np.testing.assert_allclose(there, data.site_xpos[site], atol=1e-12)
        body = model.body(root).id
        np.testing.assert_allclose(s.com, data.subtree_com[body], atol=1e-12)
        dofs = [int(joint.dofadr[0]) for joint in joints]
        np.testing.assert_allclose(s.mass_matrix[6:, 6:], mass_of(model, data, dofs), atol=1e-12)
    assert robot.mass == pytest.approx(float(model.body_subtreemass[body]), rel=1e-12)
    lower = [j.range[0] if model.jnt_limited[j.id] else -np.inf for j in joints]
    upper = [j.range[1] if model.jnt_limited[j.id] else np.inf for j in joints]
    np.testing.assert_array_equal(robot.limits.lower, lower)
    np.testing.assert_array_equal(robot.limits.upper, upper)


def mass_of(model: Any, data: Any, dofs: Sequence[int]) -> np.ndarray:
    rows = np.zeros((model.nv, model.nv))
    for row, unit in zip(rows, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    return rows[np.ix_(dofs, dofs)]


LEGS = "".join(
    f'<body name="{side}_foot" pos="0 {y} -.7"><joint name="{side}_hip" axis="0 1 0" range="-1 1"/>'
    f'{INERTIAL.format(1)}<geom type="box" size=".1 .05 .02"/></body>'
    for side, y in (("left", 0.2), ("right", -0.2))
)
