"""Inequality rows ``lower <= C v <= upper`` of the QP, and what gives them."""

from __future__ import annotations

import operator
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wbc.laws import Rows, stacked
from wbc.native import lib
from wbc.robot import Robot, Snapshot
from wbc.robot.collision import CollisionModel, PairDistances
from wbc.validate import Array, Floats, Index

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression

# Interior left to the solver by rows that are relaxed for contacts [m/s].
INTERIOR = 1e-4
# Hardest braking before a margin [m/s^2], and of one joint on the way out of it [rad/s^2].
MARGIN_BRAKING: float = lib.wbc_margin_braking
MARGIN_LEAVING: float = lib.wbc_margin_leaving
# Lever of the legs' joints [m], which alone move the base; larger ones of other joints count alone.
LEGS = 0.1


class Distances(NamedTuple):
    """The distances that a constraint measured at one snapshot.

    Attributes
    ----------
    keys:
        (m,) increasing numbers that name the same distance at every snapshot.
    clearance:
        (m,) distance less the margin and its skin [m]; negative inside.
    jacobian:
        (m, nv) derivative of the clearance by the velocity.
    rate:
        (m,) derivative of the clearance at v = 0 [m/s]; None if nothing but the robot moves.
    found:
        Pairs of bodies as measured, where the distances are between bodies; else None.
    beyond:
        A lower bound of all other clearances [m]; None: that of the farthest of these.
    """

    keys: Index
    clearance: Floats
    jacobian: Array
    rate: Floats | None
    found: PairDistances | None = None
    beyond: float | None = None


class Bounds(NamedTuple):
    """Labelled inequality rows of the QP, and the cost that goes with them.

    Attributes
    ----------
    labels:
        One for each row, in words.
    matrix:
        (m, nv), or (m, n) where rows speak of unknowns behind the velocity too.
    lower, upper:
        (m,) between which ``matrix x`` must lie; 0 does.
    push:
        Rows of a dominating cost, for what cannot be a bound; None for none.
    distances:
        What the rows were made of, if they come from distances.
    slack:
        (m,) weights of 1/2 slack^2 for rows that may give way, infinite for those that may not;
        None: none may.
    """

    labels: tuple[str, ...]
    matrix: Array
    lower: Array
    upper: Array
    push: Rows | None = None
    distances: Distances | None = None
    slack: Array | None = None


class SymbolicRows(NamedTuple):
    """Rows ``lower <= value <= upper`` of a program over postures; value (k, 1), bounds (k,)."""

    value: Expression
    lower: Array
    upper: Array


class SeparatedPairs(NamedTuple):
    """Pairs of bodies that postures must keep apart."""

    model: CollisionModel  # bodies and pairs
    distance: float | Array  # what every pair, or each of them (N,), keeps [m]
    # Rotation (3, 3) and origin (3,) of each body that does not hang on the robot, by index.
    places: Mapping[int, tuple[Array, Array]]


class Constraint(ABC):
    """Something that gives inequality rows on the velocity."""

    robot: Robot
    name: str
    _tested = True  # whether its return values are not checked; False for users' subclasses

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._tested = cls.__module__.startswith("wbc.")

    def __str__(self) -> str:
        return f"constraint {self.name!r}"

    @abstractmethod
    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return the rows for the next velocity, to be applied for ``dt``."""

    def braked_rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return the rows at the torque level, where velocities do not change at once.

        The same as :meth:`rows` by default.
        """
        return self.rows(snapshot, dt)

    def may_violate(self, rows: Bounds, v: Array, dt: float) -> bool:
        """Return whether ``v`` may violate a row, so that :meth:`cutting_planes` is needed."""
        return False

    def cutting_planes(self, there: Snapshot, v: Array, dt: float, rows: Bounds) -> Bounds | None:
        """Return further rows if ``there``, the end of a step by ``v``, violates; else None."""
        return None


def relax_for_contacts(bounds: Bounds, held: Rows) -> Bounds:
    """Return the rows, relaxed where they would forbid that contacts correct their drift.

    The least velocity that meets the contacts, ``v = A' (A A')^-1 b``, is then feasible, with a
    small interior, as v = 0 is. This amounts to micrometres in a tick. Rows that forbid v = 0,
    which are users' own, stay: giving them way would be to leave them out.
    """
    if not bounds.lower.size:
        return bounds
    A, b = held.matrix, held.target
    demanded = float(np.abs(b).max(initial=0.0))
    square = A @ A.T
    square.flat[:: len(b) + 1] += 1e-12 * square.trace()  # contacts may repeat each other
    needed = bounds.matrix @ (A.T @ np.linalg.solve(square, b))
    needed -= 0.1 * demanded + INTERIOR
    relaxed = np.minimum(bounds.lower, needed)
    return bounds._replace(lower=np.where(bounds.lower > 0.0, bounds.lower, relaxed))


def reachable_rows(bounds: Bounds, v: Array, dt: float, legs: float = LEGS) -> Bounds:
    """Return rows of margins relaxed to what is reachable from the velocity (nv,) now.

    At the velocity level a body inside a margin stops approaching in one tick. Motors cannot do
    that: such rows would contradict the torque bounds, and the tick would relax contacts instead.
    So at the torque level a fast approach is braked as hard as possible, not at once. Upper ends,
    which users' rows have, likewise. A violation is left slowly; the rate at which something comes
    (the push's ``-bias``) is to be had at once. ``legs``: 0 for a base that nothing moves.
    """
    if not bounds.lower.size:
        return bounds
    now, change, push = bounds.matrix @ v, MARGIN_BRAKING * dt, bounds.push
    lower, upper = np.minimum(bounds.lower, now + change), np.maximum(bounds.upper, now - change)
    if push is not None:
        rate, coming = push.matrix @ v, 0.0 if push.bias is None else -push.bias
        base, joints = (np.linalg.norm(part, axis=1) for part in np.split(push.matrix, [6], axis=1))
        leaving = MARGIN_LEAVING * dt * np.maximum(joints, legs * base)
        most = np.minimum(rate + change, np.maximum(rate, coming) + leaving)
        push = push._replace(target=np.maximum(np.minimum(push.target, most), rate - leaving))
    return bounds._replace(lower=lower, upper=upper, push=push)


def stack(parts: Sequence[Bounds]) -> Bounds:
    """Return several constraints' rows as one, as wide as the widest (columns behind are zero)."""
    if len(parts) == 1:
        return parts[0]
    widest = max(part.matrix.shape[1] for part in parts)
    pushes = [part.push for part in parts if part.push is not None]
    push = None
    if pushes:
        push = Rows(
            np.concatenate([rows.matrix for rows in pushes]),
            np.concatenate([rows.target for rows in pushes]),
            np.concatenate([rows.weight for rows in pushes]),
        )
    slack = None
    if any(part.slack is not None for part in parts):
        hard = [np.full(part.lower.size, np.inf) for part in parts]
        slacks = zip(parts, hard, strict=True)
        slack = np.concatenate([h if part.slack is None else part.slack for part, h in slacks])
    return Bounds(
        sum((part.labels for part in parts), ()),
        stacked([part.matrix for part in parts], widest),
        np.concatenate([part.lower for part in parts]),
        np.concatenate([part.upper for part in parts]),
        push,
        slack=slack,
    )


def take(names: Sequence[str], which: Index) -> tuple[str, ...]:
    """Return the names of some rows, in order."""
    if which.size < 2:
        return tuple(names[k] for k in which)
    return operator.itemgetter(*which.tolist())(names)
