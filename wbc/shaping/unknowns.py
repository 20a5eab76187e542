"""The unknowns of the NLP, and the map between them and configurations.

All of them are plain numbers without constraints of their own:

* joint positions, continuous joints as angles; mimic joints follow theirs and are no unknowns;
* the base's position and rotation, unless a contact holds a frame entirely: the base then follows
  from the joints, which saves twelve rows and columns and keeps that contact exactly;
* a rotation for each task that leaves one free.

Rotations are modified Rodrigues parameters from a reference that belongs to the start: every search
begins in the middle of its chart, far from where that has a singularity (a full turn).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from wbc.constraints import Contact, Limits
from wbc.errors import InvalidInputError
from wbc.placement import Placement, from_mrp
from wbc.robot import Robot
from wbc.robot.chains import followers
from wbc.robot.names import BASE
from wbc.robot.symbolic import LocalRobot, SymbolicPosture, angle_turns
from wbc.shaping.problem import ShapingProblem
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknowns x and parameters p of a shaping problem.

    ``x`` is joints (nv-6), base position (3) and rotation (3), then a rotation (3) for each task
    that leaves one free. ``p`` is the reference (9, by columns) of each rotation.
    """

    problem: ShapingProblem
    x: ca.SX
    p: ca.SX
    posture: SymbolicPosture  # the robot in terms of them
    lower: Array  # bounds on x
    upper: Array

    @classmethod
    def of(cls, problem: ShapingProblem) -> Unknowns:
        """Return the unknowns of a problem."""
        robot, n = problem.robot, problem.robot.nv - 6
        neutral = robot.snapshot(robot.postures["neutral"])
        free = [task.name for task in problem.tasks if task.free_rotation(neutral) is not None]
        count = 1 + len(free)
        x = ca.SX.sym("x", n + 3 + 3 * count)
        p = ca.SX.sym("p", 9 * count)
        rotations = [
            ca.mtimes(
                ca.reshape(p[9 * k : 9 * k + 9], 3, 3), from_mrp(x[n + 3 + 3 * k : n + 6 + 3 * k])
            )
            for k in range(count)
        ]
        joints = ca.SX(x[:n])
        for follower, driver, coupling in followers(robot):
            joints[follower] = coupling.ratio * x[driver] + coupling.offset
        lower, upper = _joint_bounds(robot, problem.limits)
        local = LocalRobot(robot, angle_turns(robot, joints))
        base = Placement(rotations[0], x[n : n + 3])
        if problem.anchor is not None:
            held = Placement.constant(problem.anchor.rotation, problem.anchor.position)
            base = held @ local.frame(problem.anchor.frame).inverse()
        unbounded = np.full(3 + 3 * count, np.inf)
        return cls(
            problem,
            x,
            p,
            SymbolicPosture(local, base, joints, dict(zip(free, rotations[1:], strict=True))),
            np.concatenate((lower, -unbounded)),
            np.concatenate((upper, unbounded)),
        )

    def values(self, q: Array) -> tuple[Array, Array]:
        """Return x and p at a configuration; joints outside their limits are moved inside."""
        problem, snapshot = self.problem, self.problem.robot.snapshot(q)
        joints = problem.robot.limits.joint_positions(snapshot.q)
        n = joints.size
        x = np.zeros(self.x.numel())
        x[:n] = np.clip(joints, self.lower[:n], self.upper[:n])
        x[n : n + 3] = snapshot.q[:3]
        free = [task.free_rotation(snapshot) for task in problem.tasks]
        references = [snapshot.rotation(BASE), *(R for R in free if R is not None)]
        return x, np.concatenate([R.ravel(order="F") for R in references])

    def map(self, kept: tuple[int, ...]) -> ConfigurationMap:
        """Return the map to configurations if only the unknowns ``kept`` are free."""
        return ConfigurationMap(self.problem.robot, self.problem.anchor, kept, self.x.numel())


@dataclass(frozen=True, eq=False)
class ConfigurationMap:
    """The map from unknowns to configurations, without expressions."""

    robot: Robot
    anchor: Contact | None  # the contact that the base follows from, or None
    kept: tuple[int, ...]  # indices of the unknowns that are free
    size: int  # how many there are in all: the last entries of p are all their values at the start

    def configuration(self, x: Array, p: Array) -> Array:
        """Return the configuration q (nq,) of free unknowns x and parameters p."""
        full = p[-self.size :].copy()
        full[list(self.kept)] = x
        n = self.robot.nv - 6
        q = with_joints(self.robot, full[:n])
        if self.anchor is not None:
            return _anchored(self.robot, q, self.anchor)
        q[:3] = full[n : n + 3]
        # Rotation.as_quat is (x, y, z, w), as q is.
        turn = Rotation.from_mrp(full[n + 3 : n + 6])
        q[3:7] = (Rotation.from_matrix(p[:9].reshape(3, 3, order="F")) * turn).as_quat()
        return q


def _joint_bounds(robot: Robot, limits: Limits) -> tuple[Array, Array]:
    """Return the bounds (nv-6,) on the joints: those of a driver leave its followers in range.

    Raises InvalidInputError: a driver that no position leaves all its followers in range.
    """
    lower, upper = limits.lower.copy(), limits.upper.copy()
    for follower, driver, coupling in followers(robot):
        if coupling.ratio == 0.0:
            continue
        ends = (np.array((limits.lower[follower], limits.upper[follower])) - coupling.offset) / (
            coupling.ratio
        )
        lower[driver] = max(lower[driver], ends.min())
        upper[driver] = min(upper[driver], ends.max())
        if lower[driver] > upper[driver]:
            names = robot.joint_names
            raise InvalidInputError(
                f"global shaping: no position of joint {names[driver]!r} leaves"
                f" {names[follower]!r}, which follows it, within its limits"
            )
    return lower, upper


def with_joints(robot: Robot, positions: Array) -> Array:
    """Return the configuration with these joint positions (nv-6,) and the base at the origin.

    Mimic joints are where their drivers put them.
    """
    positions = positions.copy()
    for follower, driver, coupling in followers(robot):
        positions[follower] = coupling.ratio * positions[driver] + coupling.offset
    q = robot.postures["neutral"].copy()
    q[:7] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    starts = np.array(robot.limits.starts, dtype=int)
    q[starts] = positions
    free = list(robot.limits.unbounded)
    q[starts[free]], q[starts[free] + 1] = np.cos(positions[free]), np.sin(positions[free])
    return q


def _anchored(robot: Robot, q: Array, contact: Contact) -> Array:
    """Return ``q`` with the base moved so that the held frame is at its anchor."""
    here = robot.snapshot(q)
    turn = contact.rotation @ here.rotation(contact.frame).T
    q = here.q.copy()
    q[3:7] = Rotation.from_matrix(turn @ here.rotation(BASE)).as_quat()
    q[:3] = contact.position + turn @ (here.position(BASE) - here.position(contact.frame))
    return q
