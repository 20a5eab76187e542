"""The recorded QPs: of problem files, and of standard jobs that scale in size and hardness.

A standard job is a robot that holds its feet (an arm: nothing) and follows targets for inertia,
CoM, trunk and posture. Smooth: they swing slowly, as in a usual controller. Hard: every twentieth
tick they jump out of reach, so that velocity limits, braking and margins are active. At the torque
level the computed acceleration is integrated, without physics.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from qpbench.sequence import QpSequence
from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError
from wbc.problem import Problem, load_problem
from wbc.problem.controller_spec import TorqueSpec
from wbc.qp import QP
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation
from wbc.tasks import ComTask, InertiaTask, OrientationTask, PostureTask
from wbc.validate import Array

DT = {"velocity": 0.005, "torque": 0.002}
JUMP = 20  # ticks between the jumps of hard targets
BENT = 0.4  # the joints of the arm at the start [rad]; straight it is singular
LONG = 62  # joints of the long robot


class NothingToRecordError(InvalidInputError):
    """A problem that solves no QPs."""


@dataclass(frozen=True)
class Job:
    """A standard job."""

    robot: str  # a name that Robot.load knows, arm, or long (62 joints)
    level: str
    hard: bool
    pairs: int = 0  # how many pairs of bodies are kept apart, the nearest

    @property
    def name(self) -> str:
        """The job's name in tables."""
        pairs = f" {self.pairs} pairs" if self.pairs else ""
        return f"{self.robot} {self.level} {'hard' if self.hard else 'smooth'}{pairs}"


STANDARD = (
    Job("arm", "velocity", False),
    Job("hoap2_like", "velocity", False),
    Job("g1", "velocity", False),
    Job("g1", "velocity", True),
    Job("g1", "velocity", False, 25),
    Job("g1", "velocity", True, 25),
    Job("g1", "velocity", False, 100),
    Job("g1", "velocity", True, 200),
    Job("talos", "velocity", True),
    Job("long", "velocity", False),
    Job("long", "velocity", True),
    Job("g1", "torque", False),
    Job("g1", "torque", True),
    Job("talos", "torque", False),
    Job("long", "torque", False),
)


def record(job: Job, ticks: int) -> QpSequence:
    """Run a standard job and return its QPs.

    Raises
    ------
    WbcError
        The robot's files are not installed: ``wbc[robots]``.
    """
    robot = _robot(job.robot)
    q = robot.posture("standing" if robot.feet else "neutral", joints=_bent(robot))
    start = robot.snapshot(q)
    targets = JobTargets.of(start)
    tasks = [targets.inertia, targets.com, targets.trunk, targets.posture]
    contacts = support(start, "double" if robot.feet else "floating")
    margins = [SelfCollision(robot, pairs=job.pairs)] if job.pairs else []
    parts: dict[str, Any] = {"contacts": contacts, "limits": Limits(robot), "constraints": margins}
    kind: Any = KinematicController if job.level == "velocity" else TorqueController
    dt = DT[job.level]
    controller = kind(robot, tasks, dt=dt, solver="active_set", **parts)
    rng = np.random.default_rng(0)
    v, qps = np.zeros(robot.nv), []
    for k in range(ticks):
        if not job.hard:
            targets.swing(k * dt)
        elif k % JUMP == 0:
            targets.jump(rng)
        tick = controller.step(robot.snapshot(q, v))
        qps.append(tick.qp)
        v = tick.velocity
        q = robot.integrate(q, v, dt)
    about = {"robot": robot.name, "joints": len(robot.joint_names), "level": job.level}
    return QpSequence(job.name, {**about, "hard": job.hard, "pairs": job.pairs}, tuple(qps))


def record_problem(path: Path, ticks: int) -> QpSequence:
    """Run a problem file, of the torque level in simulation, and return its first QPs.

    Raises
    ------
    NothingToRecordError
        A pendulum's problem.
    """
    problem = load_problem(path)
    if not isinstance(problem, Problem):
        raise NothingToRecordError(f"{path}: a pendulum's problem, which solves no QPs to record")
    torque = isinstance(problem.spec.controller, TorqueSpec)
    qps: list[QP] = []
    (problem.simulate if torque else problem.run)(
        cancelled=lambda: len(qps) >= ticks, show=lambda now, _: qps.append(now.tick.qp)
    )
    about = {"robot": problem.parts.robot.name, "joints": len(problem.parts.robot.joint_names)}
    return QpSequence(path.stem, {**about, "level": problem.spec.controller.level}, tuple(qps))


@dataclass(frozen=True)
class JobTargets:
    """The tasks of a standard job, and their initial targets."""

    start: Snapshot
    inertia: InertiaTask
    com: ComTask
    trunk: OrientationTask
    posture: PostureTask

    @classmethod
    def of(cls, start: Snapshot) -> JobTargets:
        """Return the tasks of a robot at its start."""
        robot = start.robot
        trunk = "torso" if "torso" in robot.frame_names else robot.frame_names[-1]
        return cls(
            start,
            InertiaTask(robot, start.inertia, per_mass=True, weight=10.0, gain=0.2),
            ComTask(robot, start.com, weight=10.0, gain=0.5),
            OrientationTask(robot, trunk, start.rotation(trunk), weight=1.0, gain=0.5),
            PostureTask(robot, start.q, weight=0.1, gain=0.1),
        )

    def swing(self, t: float) -> None:
        """Move the targets to their places at a time [s]."""
        wave = np.sin(2 * np.pi * np.array([0.5, 0.25, 0.4]) * t)
        scale, turn = 1 + 0.05 * np.sin(np.pi * t), np.array([0, 0.1, 0.2]) * np.sin(t)
        self._set(scale, np.array([0.01, 0.02, -0.01]) * wave, turn)

    def jump(self, rng: np.random.Generator) -> None:
        """Move the targets at once, farther than the robot can follow."""
        shift, turn = rng.uniform(-0.15, 0.05, 3), rng.uniform(-0.8, 0.8, 3)
        self._set(rng.uniform(0.7, 1.5), shift, turn)

    def _set(self, scale: float, shift: Array, turn: Array) -> None:
        start = self.start
        self.inertia.set_target(start.inertia * scale)
        self.com.set_target(start.com + shift)
        self.trunk.set_target(start.rotation(self.trunk.frame) @ exp_rotation(turn))


def _robot(name: str) -> Robot:
    if name == "arm":
        return _arm()
    return _long() if name == "long" else Robot.load(name)


def _bent(robot: Robot) -> dict[str, float]:
    """Return a start with bent joints, since a straight arm is singular."""
    return {} if robot.feet else dict.fromkeys(robot.joint_names, BENT)


def _arm() -> Robot:
    """Return an arm of six joints on a fixed base."""
    root = ET.Element("robot", name="arm")
    _link(root, "base", 4.0)
    _chain(root, "base", "arm", 6)
    return _built(root, base="fixed")


def _long() -> Robot:
    """Return the small humanoid with a chain at each hand."""
    small = Robot.load("hoap2_like")
    root = ET.parse(small.path).getroot()
    more = LONG - len(small.joint_names)
    _chain(root, "left_hand_link", "left_chain", more // 2)
    _chain(root, "right_hand_link", "right_chain", more - more // 2)
    return _built(root)


def _chain(root: ET.Element, parent: str, name: str, count: int) -> None:
    """Add a chain of links of 0.1 kg and 5 cm, turning about x, y and z in turn."""
    for k in range(count):
        link = f"{name}_{k}"
        _link(root, link, 0.1)
        joint = ET.SubElement(root, "joint", name=f"{link}_joint", type="revolute")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=link)
        ET.SubElement(joint, "origin", xyz="0 0 0.05")
        ET.SubElement(joint, "axis", xyz=("1 0 0", "0 1 0", "0 0 1")[k % 3])
        ET.SubElement(joint, "limit", lower="-1.5", upper="1.5", velocity="6", effort="20")
        parent = link


def _link(root: ET.Element, name: str, mass: float) -> None:
    inertial = ET.SubElement(ET.SubElement(root, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz="0 0 0.025")
    ET.SubElement(inertial, "mass", value=str(mass))
    moment = str(1e-3 * mass)
    ET.SubElement(
        inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0"
    )


def _built(root: ET.Element, **options: Any) -> Robot:
    with TemporaryDirectory(prefix="wbc-") as folder:
        path = Path(folder) / f"{root.get('name')}.urdf"
        ET.ElementTree(root).write(path)
        return Robot.load(path, **options)
