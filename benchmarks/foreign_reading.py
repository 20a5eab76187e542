"""A second reading of robot files, by readers that share nothing with the package's.

A URDF is read here, from its XML, into NumPy: poses of links and the mass matrix of the joints by
the links' Jacobians. An MJCF is what MuJoCo compiles. Both are asked for the same joint positions
as the loaded robot, by name.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from wbc import Robot

Array = np.ndarray[Any, np.dtype[np.float64]]
FORGOTTEN = r' sensornoise="\w*"'
NO_LIMIT = 1e10  # a limit from here on stands for none
MOVING = ("revolute", "continuous", "prismatic")


class Reading(Protocol):
    """A file as read by another reader."""

    mass: float
    ranges: Mapping[str, tuple[float, float]]  # of the joints that have one

    def at(self, joints: Mapping[str, float]) -> Placed:
        """Return the robot at joint positions by name."""


class Placed(NamedTuple):
    """A robot in one configuration."""

    frames: Mapping[str, Array]  # (4, 4) in some common frame, by name
    names: tuple[str, ...]  # of the joints, as in the rows of the mass matrix
    mass_matrix: Array  # (n, n) of the joints


class Disagreement(NamedTuple):
    """Largest differences: of frames [m, or of a rotation's entries], the others relative."""

    frames: float
    mass: float
    mass_matrix: float
    ranges: float
    compared: int  # frames

    @property
    def worst(self) -> float:
        return max(self.frames, self.mass, self.mass_matrix, self.ranges)


def compare(robot: Robot, other: Reading, seed: int, postures: int = 3) -> Disagreement:
    """Return the differences between a robot and the other reader's model."""
    rng, limits = np.random.default_rng(seed), robot.limits
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    frames = matrix = 0.0
    compared = 0
    for _ in range(postures):
        q = robot.posture("neutral", on_ground=False)
        values = rng.uniform(lower, upper)
        for k, name in enumerate(robot.joint_names):
            limits.set_joint(q, name, float(values[k]))
        there = other.at(dict(zip(robot.joint_names, values.tolist(), strict=True)))
        here = robot.snapshot(q)
        common = [name for name in there.frames if name in robot.frame_names]
        if common:
            compared = len(common)
            poses = {name: _pose(*here.placement(name)) for name in common}
            first, its = np.linalg.inv(poses[common[0]]), np.linalg.inv(there.frames[common[0]])
            for name in common:
                apart = first @ poses[name] - its @ there.frames[name]
                frames = max(frames, float(np.abs(apart).max()))
        rows = [robot.joint_index(name) for name in there.names if name in robot.joint_names]
        theirs = [k for k, name in enumerate(there.names) if name in robot.joint_names]
        if rows:
            M = here.mass_matrix[np.ix_(rows, rows)]
            off = np.abs(M - there.mass_matrix[np.ix_(theirs, theirs)]).max()
            matrix = max(matrix, float(off / np.abs(M).max()))
    return Disagreement(
        frames, abs(robot.mass / other.mass - 1.0), matrix, _ranges(robot, other), compared
    )


def _ranges(robot: Robot, other: Reading) -> float:
    worst = 0.0
    for k, name in enumerate(robot.joint_names):
        ours = robot.limits.lower[k], robot.limits.upper[k]
        for own, its in zip(ours, other.ranges.get(name, (-np.inf, np.inf)), strict=True):
            if np.isfinite(own) or np.isfinite(its):
                worst = max(worst, abs(own - its) / max(1.0, abs(its)))
    return worst if worst == worst else np.inf


def _pose(position: Array, rotation: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, position
    return T


class _Link(NamedTuple):
    name: str
    mass: float
    com: Array  # (4,) with a 1 behind
    inertia: Array  # (3, 3) about it, link axes


class _Joint(NamedTuple):
    name: str
    kind: str
    parent: str
    child: str
    origin: Array  # (4, 4)
    axis: Array  # (3,)


class UrdfReading:
    """A URDF by textbook formulas: poses along the tree, M = sum of J' diag(m, I) J."""

    def __init__(self, path: Path) -> None:
        root = ET.parse(path).getroot()
        self.links = {link.get("name", ""): _link(link) for link in root.findall("link")}
        found = [joint for joint in root.findall("joint") if joint.find("parent") is not None]
        self.joints = [_joint(joint) for joint in found]
        self.mass = sum(link.mass for link in self.links.values())
        self.ranges = {}
        for joint in root.findall("joint"):
            found = _range(joint)
            if found is not None:
                self.ranges[joint.get("name", "")] = found
        self.names = tuple(joint.name for joint in self.joints if joint.kind in MOVING)

    def at(self, joints: Mapping[str, float]) -> Placed:
        """See :class:`Reading`; joints that are not given are at 0."""
        children = {joint.child for joint in self.joints}
        named = [*self.links, *(joint.parent for joint in self.joints)]  # Drake's world is no link
        poses = {name: np.eye(4) for name in named if name not in children}
        above: dict[str, list[tuple[int, bool, Array, Array]]] = {name: [] for name in poses}
        left = list(self.joints)
        while left:
            ready = [joint for joint in left if joint.parent in poses]
            if not ready:
                raise ValueError("links hang on nothing")
            for joint in ready:
                value = joints.get(joint.name, 0.0)
                at = poses[joint.parent] @ joint.origin
                poses[joint.child] = at @ _moved(joint, value)
                moving = []
                if joint.kind in MOVING:
                    axis = at[:3, :3] @ joint.axis
                    turns = joint.kind != "prismatic"
                    moving = [(self.names.index(joint.name), turns, axis, at[:3, 3])]
                above[joint.child] = above[joint.parent] + moving
            left = [joint for joint in left if joint not in ready]
        M = np.zeros((len(self.names), len(self.names)))
        for name, link in self.links.items():
            R = poses[name][:3, :3]
            com, inertia = (poses[name] @ link.com)[:3], R @ link.inertia @ R.T
            J = np.zeros((6, len(self.names)))
            for k, turns, axis, origin in above[name]:
                J[:3, k] = np.cross(axis, com - origin) if turns else axis
                J[3:, k] = axis if turns else 0.0
            M += link.mass * J[:3].T @ J[:3] + J[3:].T @ inertia @ J[3:]
        return Placed(poses, self.names, M)


def _numbers(element: ET.Element | None, key: str, default: str) -> Array:
    return np.array(
        default.split() if element is None else element.get(key, default).split(), float
    )


def _origin(element: ET.Element | None) -> Array:
    """Return the (4, 4) of an <origin>: rpy turns about x, y, z of the outer axes, in turn."""
    origin = None if element is None else element.find("origin")
    roll, pitch, yaw = _numbers(origin, "rpy", "0 0 0")
    T = np.eye(4)
    T[:3, :3] = _turn((0, 0, 1), yaw) @ _turn((0, 1, 0), pitch) @ _turn((1, 0, 0), roll)
    T[:3, 3] = _numbers(origin, "xyz", "0 0 0")
    return T


def _turn(axis: Any, angle: float) -> Array:
    x, y, z = np.asarray(axis, float)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def _link(link: ET.Element) -> _Link:
    inertial = link.find("inertial")
    T = _origin(inertial)
    if inertial is None:
        return _Link(link.get("name", ""), 0.0, T[:, 3], np.zeros((3, 3)))
    moments = inertial.find("inertia")
    xx, xy, xz, yy, yz, zz = (
        float(_numbers(moments, key, "0")[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    mass = float(_numbers(inertial.find("mass"), "value", "0")[0])
    return _Link(link.get("name", ""), mass, T[:, 3], T[:3, :3] @ inertia @ T[:3, :3].T)


def _joint(joint: ET.Element) -> _Joint:
    ends = [joint.find(tag) for tag in ("parent", "child")]
    parent, child = ("" if end is None else end.get("link", "") for end in ends)
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
    length = float(np.linalg.norm(axis))
    axis = axis / length if length else axis
    kind = joint.get("type", "")
    return _Joint(joint.get("name", ""), kind, parent, child, _origin(joint), axis)


def _range(joint: ET.Element) -> tuple[float, float] | None:
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in ("revolute", "prismatic"):
        return None
    keys = [key for key in ("lower", "upper", "effort", "velocity") if key in limit.attrib]
    values = {key: float(limit.get(key, "0")) for key in keys}
    if not {"lower", "upper"} & set(values):
        return None
    if len(values) == 4 and not any(values.values()):  # were not entered
        return None
    low, high = values.get("lower", 0.0), values.get("upper", 0.0)
    return (-np.inf if low <= -NO_LIMIT else low), (np.inf if high >= NO_LIMIT else high)


def _moved(joint: _Joint, value: float) -> Array:
    T = np.eye(4)
    if joint.kind == "prismatic":
        T[:3, 3] = value * joint.axis
    elif joint.kind in MOVING:
        T[:3, :3] = _turn(joint.axis, value)
    return T


def spec_of(mujoco: Any, path: Path) -> tuple[Any, str]:
    """Return MuJoCo's specification of a file that compiles, and what was removed, in words.

    Meshes whose files are missing are left out with all meshes, and attributes of older files that
    MuJoCo knows no more.
    """
    without, text = [], path.read_text(encoding="utf-8", errors="replace")
    for attribute in re.findall(FORGOTTEN, text):
        text = text.replace(attribute, "")
        without.append(attribute.strip())
    text = "" if not without else text

    def read() -> Any:
        if not text:
            return mujoco.MjSpec.from_file(str(path))
        spec = mujoco.MjSpec.from_string(text)
        spec.modelfiledir = str(path.parent)
        return spec

    def without_pairs(spec: Any) -> list[str]:
        """Remove contact pairs with geoms of a scene that is not here."""
        known = {str(geom.name) for geom in spec.geoms}
        gone = [one for one in spec.pairs if not {one.geomname1, one.geomname2} <= known]
        for pair in gone:
            spec.delete(pair)
        return ["pairs with a scene"] if gone else []

    mesh = int(mujoco.mjtGeom.mjGEOM_MESH)
    for gone in ((), ("textures",), ("textures", "meshes")):
        spec = read()
        elsewhere = without_pairs(spec)
        if gone:
            for part in [*spec.geoms, *spec.sites]:
                part.material = ""
            for part in [*spec.materials, *spec.textures, *spec.skins]:
                spec.delete(part)
        if "meshes" in gone:
            for part in [geom for geom in spec.geoms if int(geom.type) == mesh] + list(spec.meshes):
                spec.delete(part)
        try:
            spec.copy().compile()
        except ValueError as error:
            if "opening file" not in str(error) or "meshes" in gone:
                raise
            continue
        break
    return spec, ", ".join([*without, *elsewhere, *gone])


def joint_names(model: Any) -> list[str]:
    """Return the joints' names, of nameless ones BODY_joint, numbered from the second on."""
    names = [model.joint(j).name for j in range(model.njnt)]
    for j in range(model.njnt):
        wanted = f"{model.body(int(model.jnt_bodyid[j])).name}_joint"
        several = [wanted, *(f"{wanted}_{k}" for k in range(2, model.njnt + 2))]
        names[j] = names[j] or next(name for name in several if name not in names)
    return names


class MjcfReading:
    """What MuJoCo compiles, of the tree that the robot's joints are in."""

    def __init__(self, path: Path, robot: Robot) -> None:
        import mujoco

        self.mujoco = mujoco
        self.model = model = spec_of(mujoco, path)[0].compile()
        self.data = mujoco.MjData(model)
        self.called = joint_names(model)
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
        single = [j for j in range(model.njnt) if int(model.jnt_type[j]) in kinds]
        self.joints = {self.called[j]: j for j in single}
        ball = int(mujoco.mjtJoint.mjJNT_BALL)
        every = range(model.njnt)
        self.balls = {self.called[j]: j for j in every if int(model.jnt_type[j]) == ball}
        mine = [j for name, j in self.joints.items() if name in robot.joint_names]
        names = {b: model.body(b).name or f"body_{b}" for b in range(1, model.nbody)}
        named = [b for b, name in names.items() if name in robot.frame_names]
        roots = {int(model.body_rootid[model.jnt_bodyid[j]]) for j in mine}
        roots = roots or {int(model.body_rootid[b]) for b in named}  # one that has no joints
        self.bodies = [b for b in range(1, model.nbody) if int(model.body_rootid[b]) in roots]
        self.mass = float(model.body_mass[self.bodies].sum())
        self.ranges = {}
        for name, j in self.joints.items():
            if model.jnt_limited[j]:
                low, high = model.jnt_range[j].tolist()
                self.ranges[name] = (
                    -np.inf if low <= -NO_LIMIT else low, np.inf if high >= NO_LIMIT else high
                )  # fmt: skip

    def at(self, joints: Mapping[str, float]) -> Placed:
        """See :class:`Reading`; joints that are not given are where an equality holds them."""
        model, data, mujoco = self.model, self.data, self.mujoco
        data.qpos[:] = model.qpos0
        for k in range(model.neq):
            kind, joint = int(model.eq_type[k]), int(mujoco.mjtEq.mjEQ_JOINT)
            alone = kind == joint and model.eq_obj2id[k] < 0
            if alone and model.eq_active0[k]:
                address = model.jnt_qposadr[model.eq_obj1id[k]]
                data.qpos[address] = model.qpos0[address] + model.eq_data[k, 0]
        for name, value in joints.items():
            if name in self.joints:
                data.qpos[model.jnt_qposadr[self.joints[name]]] = value
        for name, j in self.balls.items():  # hinges about x, y and z in turn
            if f"{name}:x" in joints:
                R = np.eye(3)
                for letter, axis in zip("xyz", np.eye(3), strict=True):
                    R = R @ _turn(axis, joints[f"{name}:{letter}"])
                place = int(model.jnt_qposadr[j])
                mujoco.mju_mat2Quat(data.qpos[place : place + 4], R.ravel())
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        full = np.zeros((model.nv, model.nv))
        for row, unit in zip(full, np.eye(model.nv), strict=True):  # mj_fullM differs by version
            mujoco.mj_mulM(model, data, row, unit)
        places = [int(model.jnt_dofadr[j]) for j in self.joints.values()]
        frames = {
            model.body(b).name: _pose(data.xpos[b], data.xmat[b].reshape(3, 3)) for b in self.bodies
        }
        frames = {name: pose for name, pose in frames.items() if name}
        return Placed(frames, tuple(self.joints), full[np.ix_(places, places)])


def reading_of(path: Path, robot: Robot) -> Reading:
    """Return another reading of a file."""
    return UrdfReading(path) if path.suffix == ".urdf" else MjcfReading(path, robot)
