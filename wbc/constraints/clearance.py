"""Rows that keep something apart, and how fast it may be approached.

A constraint measures gaps: how much room is left, and how that changes with the velocity,
``d(room)/dt = matrix v + rate``. One law turns gaps into rows, the same for bodies, obstacles, the
CoM over its support and boxes:

* braking: room x may be used up at u with ``u dt + u^2 / (2 a) <= x``, as a joint's range is
  (:mod:`wbc.constraints.limits`), and no faster than ``gain x / dt``: the end is met without
  oscillation;
* standing still is always allowed: a row never asks for more than ``C v >= 0``, so no state can
  make the QP infeasible. (Contacts that take back a drift may ask for a little less; then rows
  give way, see :func:`wbc.constraints.rows.giving_way`.) What more is wanted, the way out of a
  margin or of a moving obstacle's path, is asked for by a dominating cost, up to what limits and
  contacts leave;
* a row is linear and the truth is not. So the place where a command leads is looked at before it is
  given: where a margin is broken there, the row of that place is added and the QP solved again.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from wbc.braking import stopping_speed
from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds, Constraint, Gaps, Index, SeparatedPairs, SymbolicRows
from wbc.errors import InvalidInputError
from wbc.laws import Rows
from wbc.robot import Robot, Snapshot
from wbc.validate import Array, finite_number, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

# Rows keep this much more than the margin asked for [m], so that the margin itself is not broken
# by what a linear row does not see. Half of it may be used up by one tick.
SKIN = 1e-4
USED = 0.5 * SKIN
ROUNDING = 1e-7  # m: what is already lost may be lost again by this much
# What is being pushed out may lose ground at up to this speed [m/s], or at this part of the push:
# with twenty rows that allow rest and nothing else, solvers have no point to work from.
YIELD, PART = 1e-3, 0.01
REACH = 1.0  # m: levers on which joints carry points, for an estimate of curvature
SHARE = 0.5  # of the joints' acceleration that braking before a margin may count on


@dataclass(frozen=True)
class Approach:
    """How a margin is approached, and left.

    Attributes
    ----------
    braking:
        Deceleration to count on [m/s^2].
    gain:
        Largest fraction of the room left to use up in one tick, in (0, 1].
    recovery:
        Fraction of a violation to take back in one tick, in (0, 1].
    push:
        Largest speed at which a violation is taken back [m/s].
    """

    braking: float = 5.0
    gain: float = 0.5
    recovery: float = 0.2
    push: float = 0.1

    def __post_init__(self) -> None:
        for name in ("braking", "gain", "recovery", "push"):
            finite_number(f"approach, {name}", getattr(self, name), above=0.0)
        for name in ("gain", "recovery"):
            if getattr(self, name) > 1.0:
                raise InvalidInputError(f"approach, {name}: {getattr(self, name):g} is above 1")


class Clearance(Constraint):
    """A constraint made of gaps that must not close.

    Parameters
    ----------
    approach:
        How fast room may be used up.
    limits:
        If given, braking counts on no more than half of what the joints' accelerations give.
    """

    def __init__(
        self, robot: Robot, name: str, approach: Approach | None, limits: Limits | None = None
    ) -> None:
        if limits is not None and limits.robot is not robot:
            raise InvalidInputError(f"{name}: the limits were made for another robot object")
        self.robot = robot
        self.name = name
        self.approach = approach or Approach()
        self._strength = None if limits is None else np.minimum(SHARE * limits.acceleration, 1e9)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"

    @abstractmethod
    def gaps(self, snapshot: Snapshot, keys: Index | None = None) -> Gaps:
        """Return the gaps at ``snapshot``: those of ``keys``, or all that matter."""

    @abstractmethod
    def labels(self, gaps: Gaps) -> tuple[str, ...]:
        """Return the labels of gaps."""

    @abstractmethod
    def bend(self, gaps: Gaps, step: Array) -> Array:
        """Return how far (m,) rooms may end below their linear prediction over ``step`` (nv,)."""

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows | SeparatedPairs:
        """Return what a posture must respect, for searches over postures.

        Margins are kept with their skin, so that the QP can rest at what such a search finds.

        Raises
        ------
        InvalidInputError
            A kind of constraint that does not say what it asks of a posture.
        """
        raise InvalidInputError(
            f"global shaping: constraint {self.name!r} is a {type(self).__name__}, of which no rows"
            " in terms of the posture are known; leave it to the controller that moves there"
        )

    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return one row for each gap; see the module on how it is bounded."""
        gaps = self.gaps(snapshot)
        least = np.negative(self._speed(gaps, dt))
        inside = gaps.room.size > 0 and np.minimum.reduce(gaps.room) < 0.0
        if inside:
            law = self.approach
            lost = np.maximum(-SKIN - gaps.room, 0.0)  # less than the skin is no violation
            back = np.minimum(law.recovery / dt * lost, law.push)
            least = np.where(gaps.room < 0.0, back, least)
        push = None
        if gaps.rate is not None:
            least -= gaps.rate
        if inside or gaps.rate is not None:
            least, push = _asked(gaps, least)
        return Bounds(self.labels(gaps), gaps.matrix, least, _unbounded(least.size), push, gaps)

    def doubts(self, rows: Bounds, v: Array, dt: float) -> bool:
        """Whether some room might end below what a tick may use up."""
        gaps = rows.gaps
        if gaps is None:
            return False
        return bool((self._least(gaps, v, dt) < -USED).any())

    def cuts(self, there: Snapshot, v: Array, dt: float, rows: Bounds) -> Bounds | None:
        """Return the rows, linear about ``there``, of the gaps that are closed there.

        A gap may end half a skin inside; one that began further inside may not close further.
        """
        after = self.gaps(there, self._watched(rows, v, dt))
        start, drift = _matched(rows.gaps, after)
        room = after.room if after.rate is None else after.room + dt * after.rate
        floor = np.minimum(-USED, start + dt * np.minimum(drift, 0.0) - ROUNDING)
        closed = np.flatnonzero(room < floor)
        if not closed.size:
            return None
        lacking = np.minimum(0.0, start[closed]) - room[closed]
        matrix = after.matrix[closed]
        least = np.minimum(matrix @ v + lacking / dt, 0.0)
        labels = self.labels(after)
        chosen = tuple(labels[k] for k in closed)
        return Bounds(chosen, matrix, least, np.full(closed.size, np.inf))

    def _least(self, gaps: Gaps, v: Array, dt: float) -> Array:
        """Return an estimate (m,) from below of the rooms where ``v`` leads."""
        step = dt * v
        predicted = gaps.matrix @ step
        predicted += gaps.room
        if gaps.rate is not None:
            predicted += dt * gaps.rate
        predicted -= self.bend(gaps, step)
        return predicted

    def _watched(self, rows: Bounds, v: Array, dt: float) -> Index | None:
        """Return the keys of the gaps to be measured where ``v`` leads; None for all there are."""
        gaps = rows.gaps
        # Where others could have come nearer than the farthest of these, others are looked at too.
        if gaps is None or REACH * dt * float(np.abs(v).sum()) > np.maximum.reduce(gaps.room):
            return None
        return gaps.keys[self._least(gaps, v, dt) < -USED]

    def _speed(self, gaps: Gaps, dt: float) -> Array:
        """Return the speed (m,) at which rooms may be used up, 0 where there is none."""
        room = np.maximum(gaps.room, 0.0)
        law = self.approach
        braking: Array | float = law.braking
        if self._strength is not None:
            able = np.abs(gaps.matrix[:, 6:]) @ self._strength
            # Where joints hardly change the room, their limits do not matter to it either.
            braking = np.minimum(np.where(able > 1e-6, able, braking), braking)
        return np.minimum(stopping_speed(room, braking, dt), law.gain / dt * room)


def point_bend(gaps: Gaps, step: Array) -> Array:
    """Return how far (m,) a point may end beside its linear prediction, on levers of a metre."""
    size = np.abs(step)
    slide, angle = float(size[:3].sum()), float(size[3:].sum())
    # A base that turns while it slides bends its own way, on no lever.
    return np.full(gaps.room.size, 0.5 * (REACH * angle + slide) * angle)


def _asked(gaps: Gaps, least: Array) -> tuple[Array, Rows | None]:
    """Return the part of what is wanted that is a bound (m,), and the part that is a cost."""
    wanted = least > 0.0
    if not wanted.any():
        return least, None
    push = Rows(gaps.matrix[wanted], least[wanted], np.ones(int(np.count_nonzero(wanted))))
    return np.where(wanted, -np.minimum(YIELD, PART * least), least), push


@cache
def _unbounded(size: int) -> Array:
    return read_only(np.full(size, np.inf))


def _matched(before: Gaps | None, after: Gaps) -> tuple[Array, Array]:
    """Return room and rate (m,), (m,) that the gaps of ``after`` had before; or plenty, and 0."""
    plenty, none = np.full(after.keys.size, np.inf), np.zeros(after.keys.size)
    if before is None or not before.keys.size:
        return plenty, none
    place = np.minimum(np.searchsorted(before.keys, after.keys), before.keys.size - 1)
    same = before.keys[place] == after.keys
    room = np.where(same, before.room[place], plenty)
    return room, none if before.rate is None else np.where(same, before.rate[place], none)
