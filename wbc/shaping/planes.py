"""Separating planes between bodies: rows of the NLP with analytic derivatives.

Two convex bodies are at least r apart if and only if some n, |n| <= 1, and d have

    n . a - d >= r_a  for every corner a of one,   d - n . b >= r_b  for every corner b of the other

where r_a + r_b is r and their rounding radii (separating hyperplane; Boyd and Vandenberghe, Convex
Optimization, 2.5.1). With n and d as unknowns of the NLP everything is smooth, whereas the distance
has a kink wherever nearest points jump, and no derivative where bodies touch or overlap.

Corners move with joints: a = R v + p. So a row is a sum of ``coefficient * T[t] * y[u]``, with T
all placements and y all n, d, whose derivatives are explicit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from wbc.constraints.rows import SeparatedPairs
from wbc.robot import Robot
from wbc.robot.collision import Body, CollisionModel, HalfSpace
from wbc.robot.symbolic import SymbolicPosture
from wbc.sparse import matrix_of, summed
from wbc.validate import Array, Index

UNKNOWNS = 4  # of a plane: n, d
ENTRIES = 12  # of a placement, by columns: R, p
WORLD = 0  # the joint of bodies that are not attached to the robot


@dataclass(frozen=True, eq=False)
class Bodies:
    """Bodies of all collision constraints of a problem; can be sent to another process."""

    robot: Robot
    # Shapes in the frames of their joints; a robot's body is there once for each constraint.
    bodies: tuple[Body, ...]
    pairs: Index  # (N, 2) indices of bodies
    least: Array  # (N,) distance that each pair keeps [m]
    # Rotation (3, 3) and origin (3,) of each body that does not hang on the robot.
    places: Mapping[int, tuple[Array, Array]]

    @classmethod
    def of(cls, robot: Robot, parts: Sequence[SeparatedPairs]) -> Bodies | None:
        """Return the bodies of several constraints, None if there are no pairs."""
        bodies: list[Body] = []
        pairs, least = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
        places: dict[int, tuple[Array, Array]] = {}
        for one in parts:
            pairs.append(one.model.pairs + len(bodies))
            least.append(np.full(len(one.model.pairs), one.distance))
            places |= {len(bodies) + k: place for k, place in one.places.items()}
            bodies += one.model.bodies
        numbers = np.concatenate(pairs)
        if not numbers.size:
            return None
        return cls(robot, tuple(bodies), numbers, np.concatenate(least), places)

    def model(self) -> CollisionModel:
        """Return what measures distances, with the obstacles in place."""
        made = CollisionModel(self.robot, self.bodies, [(a, b) for a, b in self.pairs.tolist()])
        for k, place in self.places.items():
            made.place(k, *place)
        return made

    @property
    def joints(self) -> tuple[int, ...]:
        """Pinocchio's indices of the joints that carry bodies, increasing; 0 for the world."""
        return tuple(sorted({body.joint for body in self.bodies}))

    def placements(self, posture: SymbolicPosture) -> ca.SX:
        """Return where :attr:`joints` are in the base's frame (12 each, 1), by columns (R, p).

        So rows between the robot's own bodies do not depend on the base, and chains are short.
        """
        placed = [
            posture.base.inverse() if joint == WORLD else posture.local.joint(joint)
            for joint in self.joints
        ]
        return ca.densify(
            ca.vertcat(*(ca.vertcat(ca.vec(one.rotation), one.position) for one in placed))
        )

    def corners(self, body: int) -> Array:
        """Return the points (k, 3) whose rounded hull a body is, in its joint's frame [m]."""
        core = self.bodies[body].shape.core
        if body in self.places:
            R, p = self.places[body]
            return np.asarray(core @ R.T + p)
        return core[:1] if np.ptp(core, axis=0).max() == 0.0 else core

    def slot(self, pair: int, used: Corners) -> Slot:
        """Return a pair with a plane between its corners in use."""
        a, b = self.pairs[pair].tolist()
        half, joints = 0.5 * float(self.least[pair]), self.joints
        first, second = (
            Side(
                joints.index(self.bodies[k].joint),
                self.corners(k)[sorted(corners)],
                self.bodies[k].shape.radius + half,
            )
            for k, corners in ((a, used.first), (b, used.second))
        )
        return Slot(first, second, self._normal(b))

    def _normal(self, body: int) -> Array | None:
        """Return the outward normal (3,) of a half-space in its joint's frame, None of others."""
        shape = self.bodies[body].shape
        if not isinstance(shape, HalfSpace):
            return None
        return self.places[body][0] @ shape.normal if body in self.places else shape.normal


class Corners(NamedTuple):
    """Which corners of the two bodies of a pair are in the program."""

    first: frozenset[int]
    second: frozenset[int]


class Side(NamedTuple):
    """A body on one side of a plane."""

    block: int  # which placement is that of its joint
    corners: Array  # (k, 3) in that joint's frame [m]
    distance: float  # how far the corners are to be from the plane [m]


class Slot(NamedTuple):
    """Two bodies with a plane between them."""

    first: Side
    second: Side
    normal: Array | None  # (3,) the plane's, if the second body is a half-space


class PlaneRows(NamedTuple):
    """Rows as functions of placements T and planes y, with (a, b) the derivative of a by b."""

    value: ca.Function  # (T, y) -> rows
    jacobian: ca.Function  # (T, y) -> (rows, T), (rows, y)
    # (T, y, multipliers) -> gradient by T (T, 1), (gradient, y), upper triangle of (y, y)
    hessian: ca.Function
    lower: Array  # bounds on the rows
    upper: Array


class _Terms(NamedTuple):
    """Terms ``coefficient * T[t] * y[u]`` of rows; T and y have a 1 behind their last entries."""

    row: Index
    t: Index
    u: Index
    coefficient: Array


def plane_rows(slots: Sequence[Slot], size: int) -> PlaneRows:
    """Return the rows of ``slots``, with ``size`` entries in T."""
    planes = UNKNOWNS * len(slots)
    terms, bounds, units = _collect_terms(slots, size)
    count = len(bounds)
    T, y, m = ca.MX.sym("T", size), ca.MX.sym("y", planes), ca.MX.sym("m", count)
    at_t = ca.vertcat(T, 1.0)[terms.t.tolist()]
    at_u = ca.vertcat(y, 1.0)[terms.u.tolist()]
    c = ca.DM(terms.coefficient)
    # |n|^2 of each plane that has a length to keep.
    places = (UNKNOWNS * units[:, 1:] + np.arange(3)).ravel()
    squares = np.repeat(units[:, 0], 3)
    n = y[places.tolist()]
    value = summed(terms.row, c * at_t * at_u, count) + summed(squares, n**2, count)
    # What is outside, and left out, are factors 1.
    by_t = matrix_of(terms.row, terms.t, c * at_u, (count, size))
    by_y = matrix_of(terms.row, terms.u, c * at_t, (count, planes))
    by_y += matrix_of(squares, places, 2.0 * n, (count, planes))
    gradient = ca.mtimes(by_t.T, m)
    cross = matrix_of(terms.t, terms.u, c * m[terms.row.tolist()], (size, planes))
    own = matrix_of(places, places, 2.0 * m[squares.tolist()], (planes, planes))
    return PlaneRows(
        ca.Function("rows", [T, y], [value]),
        ca.Function("jacobian", [T, y], [by_t, by_y]),
        ca.Function("hessian", [T, y, m], [gradient, cross, own]),
        bounds[:, 0],
        bounds[:, 1],
    )


def _collect_terms(slots: Sequence[Slot], size: int) -> tuple[_Terms, Array, Index]:
    """Return the terms, the rows' bounds (k, 2), and the rows of |n|^2 with their slots (m, 2)."""
    one_t, one_u = size, UNKNOWNS * len(slots)  # where the 1 is
    found: list[tuple[int, int, int, float]] = []
    bounds: list[tuple[float, float]] = []
    units: list[tuple[int, int]] = []
    for k, slot in enumerate(slots):
        y = UNKNOWNS * k
        for side, sign in ((slot.first, 1.0), (slot.second, -1.0)):
            for corner in side.corners:
                row = len(bounds)
                for column, h in enumerate((*corner, 1.0)):
                    t = ENTRIES * side.block + 3 * column
                    found += [(row, t + i, y + i, sign * h) for i in range(3)]
                found.append((row, one_t, y + 3, -sign))
                bounds.append((side.distance, np.inf))
        if slot.normal is None:
            units.append((len(bounds), k))
            bounds.append((-np.inf, 1.0))
            continue
        for i in range(3):  # n is the half-space's normal, turned as its joint is
            row, t = len(bounds), ENTRIES * slot.second.block + i
            found += [(row, t + 3 * column, one_u, -h) for column, h in enumerate(slot.normal)]
            found.append((row, one_t, y + i, 1.0))
            bounds.append((0.0, 0.0))
    row_of, t_of, u_of, coefficient = (np.array(part) for part in zip(*found, strict=True))
    terms = _Terms(row_of, t_of, u_of, coefficient)
    return terms, np.array(bounds), np.array(units, dtype=np.int64).reshape(-1, 2)
