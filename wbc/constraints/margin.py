"""Margins: distances that must not close, and how fast they may be approached.

A constraint measures distances: how much clearance is left, and how it changes with the velocity,
``d(clearance)/dt = jacobian v + rate``. One law turns them into rows, the same for bodies,
obstacles, the CoM over its support and boxes:

* braking: clearance x may shrink at a speed u with ``u dt + u^2 / (2 a) <= x``, as the distance of
  a joint from its limit (:mod:`wbc.constraints.limits`), and no faster than ``gain x / dt``: it
  comes to rest at the margin without oscillation;
* standing still is always allowed: a row never asks for more than ``C v >= 0``, so no state makes
  the QP infeasible. (Contacts that correct a drift may need slightly negative ``C v``; then rows
  are relaxed, see :func:`wbc.constraints.rows.relax_for_contacts`.) Recovery from inside a margin,
  or out of a moving obstacle's path, is a cost that outweighs the tasks, met as far as limits and
  contacts allow;
* rows are only first-order, so the margins are evaluated again at the integrated configuration:
  where one would be violated there, its linearisation there is added and the QP solved again (see
  :mod:`wbc.controllers.look_ahead`).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import asdict, dataclass, fields
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from wbc.attributes import DeclaredAttributes
from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds, Constraint, Distances, SeparatedPairs, SymbolicRows
from wbc.constraints.validation import curvature_of, distances_of
from wbc.errors import InvalidInputError
from wbc.kinds import check_kind, check_word
from wbc.laws import Rows
from wbc.native import doubles, ffi, lib, pointer
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot
from wbc.validate import Array, Index, finite_number, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

# Constants of the core's margins, see native/source/margin.c: the skin that rows add to a margin,
# and how much of it a tick may use up [m].
SKIN: float = lib.wbc_skin
USED: float = lib.wbc_skin_per_tick
JOINT_SHARE = 0.5  # of the joints' acceleration limits, assumed for braking


@dataclass(frozen=True)
class BrakingParameters:
    """How fast a margin may be approached, and recovered.

    Attributes
    ----------
    deceleration:
        To count on while braking [m/s^2].
    gain:
        Largest fraction of the clearance to use up in one tick, in (0, 1].
    recovery:
        Fraction of a violation to take back in one tick, in (0, 1].
    recovery_speed:
        Largest speed at which a violation is taken back [m/s].
    """

    deceleration: float = 5.0
    gain: float = 0.5
    recovery: float = 0.2
    recovery_speed: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            finite_number(f"braking, {field.name}", getattr(self, field.name), above=0.0)
        for name in ("gain", "recovery"):
            if getattr(self, name) > 1.0:
                raise InvalidInputError(f"braking, {name}: {getattr(self, name):g} is above 1")


class Margin(DeclaredAttributes, Constraint):
    """A constraint on distances that must not fall below a margin.

    Parameters
    ----------
    braking:
        How fast clearance may be used up.
    limits:
        If given, braking counts on no more than half of their joint accelerations, and on the least
        of these, a metre away, for what legs do to a floating base.

    Attributes
    ----------
    unit:
        Of its clearances; a class of angles says ``"rad"``.
    """

    braking: BrakingParameters
    unit: ClassVar[str] = "m"

    def __init__(
        self,
        robot: Robot,
        name: str,
        braking: BrakingParameters | None,
        limits: Limits | None = None,
    ) -> None:
        check_robot(name, robot)
        check_kind(f"{name}, limits", limits, Limits, "Limits(robot)", or_none=True)
        if limits is not None and limits.robot is not robot:
            raise InvalidInputError(f"{name}: the limits were made for another robot object")
        self.robot = robot
        self.name = name
        self.braking = BrakingParameters() if braking is None else braking
        self._braking_limits = limits
        self._counted_on: tuple[Array, Array] | None = None  # limits' accelerations, and what of it

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "braking":
            check_kind(f"{self.name}, braking", value, BrakingParameters)
        elif name == "name":
            check_word(f"{type(self).__name__}, name", value)
        elif name == "robot" and name in self.__dict__ and not self._takes_any:
            raise InvalidInputError(f"{self!r}: robot cannot be assigned; make another")
        super()._set_attribute(name, value)

    @property
    def _joint_acceleration(self) -> Array | None:
        """What braking counts on (nv - 6,): the same array until the limits' is assigned."""
        if self._braking_limits is None:
            return None
        given, known = self._braking_limits.acceleration, self._counted_on
        if known is None or known[0] is not given:
            self._counted_on = known = given, np.minimum(JOINT_SHARE * given, 1e9)
        return known[1]

    @abstractmethod
    def distances(self, snapshot: Snapshot, keys: Index | None = None) -> Distances:
        """Return the distances at ``snapshot``: those of ``keys``, or all that matter."""

    @abstractmethod
    def labels(self, distances: Distances) -> tuple[str, ...]:
        """Return the labels of distances."""

    @abstractmethod
    def curvature_bound(self, distances: Distances, step: Array) -> Array:
        """Bound how far (m,) clearances end below their linear prediction over ``step`` (nv,)."""

    def has_more(self, distances: Distances) -> bool:
        """Return whether there are more distances than these: farther away, without rows."""
        return False

    def symbolic_rows(self, posture: SymbolicPosture) -> SymbolicRows | SeparatedPairs:
        """Return the rows that a posture must meet, for searches over postures.

        Margins include their skin, so that the QP can rest at the posture found.

        Raises
        ------
        InvalidInputError
            A kind of constraint without rows on postures.
        """
        raise InvalidInputError(
            f"global shaping: constraint {self.name!r} is a {type(self).__name__}, of which no rows"
            " in terms of the posture are known; leave it to the controller that moves there"
        )

    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        """Return one row for each distance, bounded as the module says."""
        found = distances_of(self, self.distances(snapshot))
        return self._rows(found, dt)

    def _rows(self, distances: Distances, dt: float) -> Bounds:
        least = self._approach(distances, dt)
        if distances.rate is not None:
            least -= distances.rate
        least, push = _split_bounds_and_push(distances, least)
        labels, matrix = self.labels(distances), distances.jacobian
        return Bounds(labels, matrix, least, _unbounded(least.size), push, distances)

    def may_violate(self, rows: Bounds, v: Array, dt: float) -> bool:
        """Return whether some clearance, with a row or without, might end below the margin."""
        distances = rows.distances
        if distances is None:
            return False
        if self.has_more(distances) and _unlisted_may_violate(distances, v, dt):
            return True
        return bool((self._least_clearance(distances, v, dt) < -USED).any())

    def cutting_planes(self, there: Snapshot, v: Array, dt: float, rows: Bounds) -> Bounds | None:
        """Return the rows, linear about ``there``, of the distances that are violated there.

        A distance may end half a skin inside; one that began further inside may not shrink more.
        """
        after = distances_of(self, self.distances(there, self._keys_to_measure(rows, v, dt)))
        lacking = self._missing_clearance(after, rows, dt)
        violated = np.flatnonzero(lacking)
        if not violated.size:
            return None
        matrix = after.jacobian[violated]
        least = np.minimum(matrix @ v + lacking[violated] / dt, 0.0)
        labels = self.labels(after)
        chosen = tuple(labels[k] for k in violated)
        rate = None if after.rate is None else after.rate[violated]
        found = None if after.found is None else after.found.take(violated)
        which = Distances(after.keys[violated], after.clearance[violated], matrix, rate, found)
        return Bounds(chosen, matrix, least, np.full(violated.size, np.inf), distances=which)

    def _missing_clearance(self, after: Distances, rows: Bounds, dt: float) -> Array:
        """Return by how much clearances (m,) are too small at the end [m]; 0 if not violated."""
        start, drift = _clearance_before(rows.distances, after)
        clearance = after.clearance if after.rate is None else after.clearance + dt * after.rate
        floor = np.minimum(-USED, start + dt * np.minimum(drift, 0.0) - lib.wbc_rounding)
        return np.where(clearance < floor, np.minimum(0.0, start) - clearance, 0.0)

    def _least_clearance(self, distances: Distances, v: Array, dt: float) -> Array:
        """Return lower bounds (m,) on the clearances at the end of a step with ``v``."""
        step = dt * v
        predicted = distances.jacobian @ step
        predicted += distances.clearance
        if distances.rate is not None:
            predicted += dt * distances.rate
        bound = self.curvature_bound(distances, step)
        predicted -= curvature_of(self, bound, predicted.size)
        return predicted

    def _keys_to_measure(self, rows: Bounds, v: Array, dt: float) -> Index | None:
        """Return the keys of the distances to measure at the end of the step, or None for all."""
        distances = rows.distances
        if distances is None or _unlisted_may_violate(distances, v, dt):
            return None
        return distances.keys[self._least_clearance(distances, v, dt) < -USED]

    def _approach(self, distances: Distances, dt: float) -> Array:
        """Return least rates of the clearances (m,) [m/s]; positive if a clearance must grow."""
        law, rows = asdict(self.braking), np.ascontiguousarray(distances.jacobian, dtype=float)
        m, nv, least = len(rows), self.robot.nv, np.empty(len(rows))
        margin, acceleration = ffi.new("wbc_margin *", law), self._joint_acceleration
        clearance = np.ascontiguousarray(distances.clearance, dtype=float)
        if rows.shape != (m, nv) or clearance.shape != (m,):
            raise InvalidInputError(
                f"{self.name}: distances() must return clearances (m,) and their Jacobian"
                f" (m, {nv}); got {clearance.shape} and {rows.shape}"
            )
        if acceleration is not None:
            if not self.robot.fixed_base:
                # Legs brake the base as one more joint: a link near it, which its own joints hardly
                # move, would else brake for what is metres away.
                legs = lib.wbc_lever * acceleration.min(initial=np.inf)
                acceleration = np.append(acceleration, legs)
                rows, nv = np.column_stack((rows, np.abs(rows[:, :3]).sum(axis=1))), nv + 1
            margin.acceleration = pointer(acceleration)
        lib.wbc_approach(margin, nv, dt, m, *map(doubles, (rows, clearance, least)))
        return least


def _unlisted_may_violate(distances: Distances, v: Array, dt: float) -> bool:
    """Return whether a distance without a row, beyond the farthest with one, may be violated."""
    left = distances.beyond
    if left is None:
        left = float(np.maximum.reduce(distances.clearance, initial=-np.inf))  # of none: anywhere
    return lib.wbc_lever * dt * float(np.abs(v).sum()) > left


def point_curvature_bound(distances: Distances, step: Array) -> Array:
    """Bound how far (m,) a point a metre away ends from its linear prediction."""
    size = np.abs(step)
    slide, angle = float(size[:3].sum()), float(size[3:].sum())
    # A base that turns while it translates moves on a curve itself, whatever the lever.
    return np.full(distances.clearance.size, 0.5 * (lib.wbc_lever * angle + slide) * angle)


def _split_bounds_and_push(distances: Distances, least: Array) -> tuple[Array, Rows | None]:
    """Return ``least`` (m,) as bounds that allow rest, and the cost that pushes beyond these."""
    wanted = least > 0.0
    if not wanted.any():
        return least, None
    rate = None if distances.rate is None else np.asarray(distances.rate[wanted], dtype=float)
    matrix, target = distances.jacobian[wanted], least[wanted]
    push = Rows(matrix, target, np.ones(target.size), bias=rate)
    interior = np.minimum(lib.wbc_interior_speed, lib.wbc_interior_share * least)
    return np.where(wanted, -interior, least), push


@cache
def _unbounded(size: int) -> Array:
    return read_only(np.full(size, np.inf))


def _clearance_before(before: Distances | None, after: Distances) -> tuple[Array, Array]:
    """Return earlier clearances and rates (m,), (m,) of ``after``'s keys; infinity, 0 if new."""
    far, none = np.full(after.keys.size, np.inf), np.zeros(after.keys.size)
    if before is None or not before.keys.size:
        return far, none
    place = np.minimum(np.searchsorted(before.keys, after.keys), before.keys.size - 1)
    same = before.keys[place] == after.keys
    clearance = np.where(same, before.clearance[place], far)
    return clearance, none if before.rate is None else np.where(same, before.rate[place], none)
