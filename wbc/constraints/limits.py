"""Limits on joints and base, as a box on the next velocity.

Three facts shape the box of a joint at position q moving at v, with limits q_max, v_max, a_max:

* braking: from velocity u it can stop before q_max if ``u dt + u^2 / (2 a_max) <= q_max - q``. Once
  this holds it can hold at the next tick too, so a limit is met without overshoot or oscillation;
* speeding up is bounded by ``a_max dt`` per tick, but a joint may always stop at once, and speed up
  the other way from there: with several limits and closed kinematic chains, a hard bound on
  deceleration can contradict the contacts, and standing still must remain feasible (and a little
  more: a foot that touches down while moving corrects its drift). A joint that reverses changes its
  velocity by up to ``|v| + a_max dt`` in a tick: ``tick.braked`` names it. With ``braking:
  bounded`` slowing down is bounded by ``a_max dt`` as well, unless a limit of the joint itself
  needs more; if contacts or margins need more, the controller relaxes this box, see
  :mod:`wbc.controllers.braking`;
* outside its range a joint may only move back, and a soft row of high weight moves it back. That
  row is a cost, not a bound, so that no state can make the QP infeasible.
"""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import ArrayAttribute, DeclaredAttributes
from wbc.errors import InvalidInputError
from wbc.kinds import one_of, switch
from wbc.native import doubles, ffi, lib, pointer
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import joint_starts
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot, check_sizes
from wbc.robot.postures import STANDING
from wbc.validate import Array, finite_number, finite_vector, read_only, real_array

BASE_ROWS = ("base x", "base y", "base z", "base rx", "base ry", "base rz")
BRAKING = ("free", "bounded")
# Time in which a joint reaches full speed if no acceleration limit is given [s].
DEFAULT_RISE_TIME = 0.1
# Part of a joint's torque that is assumed for braking. With all of it, a waist reached its limit at
# full speed, and the tick had to choose between the limit and the feet.
TORQUE_SHARE = 0.5
Box = tuple[Array, Array]


class Limits(DeclaredAttributes):
    """Position, velocity and acceleration limits of the joints, and of the base's twist.

    Parameters
    ----------
    position:
        Keep joints inside the model's position limits.
    margin:
        Distance kept from them [rad or m].
    velocity:
        Factor on the model's velocity limits, or None for no velocity limit.
    acceleration:
        One number or one per joint [rad/s^2 or m/s^2], used for braking and for speeding up; None
        takes the velocity limit divided by 0.1 s (no bound where there is no velocity limit); a
        torque controller then counts on no more than half of what the joint's torque gives it, see
        :meth:`within_torques`.
    speed_up:
        Likewise, for speeding up alone; None: the ``acceleration``. At the torque level torques
        bound that as well.
    braking:
        ``"free"``: a joint may stop in one tick if tasks ask for it, and speed up the other way in
        the same; ``tick.braked`` names those that change their velocity by more than the
        acceleration allows. ``"bounded"``: it slows down by no more than the acceleration, except
        where limits, contacts or margins leave nothing else. Far from their targets the tasks of a
        level then pull with lower gains, all by the same factor, so that no joint comes to its end
        faster than it can brake. A target that moves without telling its rate is followed at a
        distance from which joints could stop.
    base_twist:
        (6,) largest base velocity in base axes, linear [m/s] then angular [rad/s]; None: no limit.
    recovery:
        Fraction of a violation to take back in one tick, in (0, 1]; a torque controller takes it
        back with a time constant of 20 ms.

    Attributes
    ----------
    speed, acceleration, speed_up:
        Of each joint (nv - 6,), positive, read-only. Others can be assigned, one number too.
        ``speed_up`` may be None.

    Raises
    ------
    InvalidInputError
        A value out of range, or a margin that leaves a joint no range.
    UnknownNameError
        No such kind of braking.
    """

    _fixed = dict.fromkeys(("robot", "lower", "upper", "base_twist"), "make other Limits")

    def __repr__(self) -> str:
        return f"Limits({self.robot.name!r}, {self.robot.nv - 6} joints)"

    def _set_attribute(self, name: str, value: Any) -> None:
        if name in ("speed", "acceleration") or (name == "speed_up" and value is not None):
            value = _by_joint(f"limits, {name}", value, self.robot.nv - 6)
            if name == "acceleration":
                self.__dict__["by_default"] = False
        elif name == "braking":
            one_of("kind of braking", value, BRAKING)
        elif name == "recovery":
            value = finite_number("limits, recovery", value, above=0.0)
            if value > 1.0:
                raise InvalidInputError(f"limits, recovery: {value:g} is above 1 (all in one tick)")
        super()._set_attribute(name, value)
        self.__dict__["_changes"] = object()
        if not name.startswith("_"):
            for one in self.__dict__.get("_derived", ()):
                setattr(one, name, value)

    robot: Robot
    lower: Array
    upper: Array
    speed: ArrayAttribute
    acceleration: ArrayAttribute
    speed_up: Array | None
    by_default: bool  # whether the accelerations are: neither given nor assigned
    braking: str
    base_twist: Array
    recovery: float
    _changes: object  # replaced at each assignment: readers compare it by identity

    def __init__(
        self,
        robot: Robot,
        *,
        position: bool = True,
        margin: float = 0.0,
        velocity: float | None = 1.0,
        acceleration: ArrayLike | None = None,
        speed_up: ArrayLike | None = None,
        braking: str = "free",
        base_twist: ArrayLike | None = None,
        recovery: float = 0.2,
    ) -> None:
        check_robot("limits", robot)
        self.robot = robot
        self._derived: tuple[Limits, ...] = ()  # by within_torques(): assignments reach them too
        self.lower, self.upper = _position_bounds(robot, position, margin)
        self.speed = _speeds(robot, velocity)
        by_speed = self.speed / DEFAULT_RISE_TIME
        self.acceleration = by_speed if acceleration is None else acceleration
        self.by_default = acceleration is None
        self.speed_up = speed_up  # type: ignore[assignment]  # an array from here on
        self.braking = braking
        twist = np.full(6, np.inf) if base_twist is None else base_twist
        self.base_twist = _positive("limits, base_twist", twist, 6)
        self.recovery = recovery

    def within_torques(self, torques: Array) -> Limits:
        """Return limits whose default accelerations half the torques (joints,) [N m] can produce.

        Each joint alone moves what it carries in the standing posture; the other half is for
        gravity and for the other joints. A given ``acceleration`` is not changed. Later assignments
        to these limits are passed on to the returned ones.
        """
        if not self.by_default:
            return self
        q = self.robot.postures[STANDING]
        inertia = np.diagonal(self.robot.snapshot(q).mass_matrix)[BASE_NV:]
        limits = copy(self)
        limits._derived = ()
        able = TORQUE_SHARE * torques / inertia
        limits.acceleration = np.minimum(self.acceleration, able)
        limits.by_default = True
        self._derived += (limits,)
        return limits

    def box(self, snapshot: Snapshot, dt: float) -> Box:
        """Return lower and upper bounds (nv,), (nv,) on the next velocity."""
        return self._box(snapshot, dt, self.braking == "bounded")

    def emergency_braking_box(self, snapshot: Snapshot, dt: float) -> Box:
        """Return the bounds (nv,), (nv,) if joints may stop at once; 0 is always inside."""
        return self._box(snapshot, dt, bounded=False)

    def numbers(self, deceleration: Array | None = None) -> Array:
        """Return all limits as the core reads them (5 (nv - 6) + 12,): ``limit`` of source/core.h.

        ``deceleration`` (nv - 6,): assumed for braking; None: the acceleration.
        """
        slow = self.acceleration if deceleration is None else deceleration
        rise = self.acceleration if self.speed_up is None else self.speed_up
        joints = (self.lower, self.upper, self.speed, rise, slow)
        return np.concatenate((*joints, -self.base_twist, self.base_twist))

    def worst_margin(self, q: Array) -> tuple[float, str]:
        """Return the smallest distance [rad or m] to a position limit and the joint it is at.

        Negative when outside; the model's own limits count, without ``margin``.
        """
        limits = self.robot.limits
        if not self.robot.joint_names:
            return float("inf"), "no joint"
        position = limits.joint_positions(finite_vector("limits, q", q, self.robot.nq))
        margin = np.minimum(limits.upper - position, position - limits.lower)
        worst = int(np.argmin(margin))
        return float(margin[worst]), self.robot.joint_names[worst]

    def _box(self, snapshot: Snapshot, dt: float, bounded: bool) -> Box:
        check_sizes("limits", self.robot, snapshot)
        tree, box = self.robot.native.tree, np.empty((2, self.robot.nv))
        limit, start = self.numbers(), joint_starts(self.robot.limits)
        dt = finite_number("limits, dt", dt, above=0.0)
        at = {"tree": tree.struct, "limit": pointer(limit), "start": pointer(start)}
        plan = ffi.new("wbc_plan *", {**at, "dt": dt, "braked": bounded})
        lib.wbc_box(plan, *map(doubles, (snapshot.q, snapshot.v, box)))
        return box[0], box[1]


def _position_bounds(robot: Robot, position: bool, margin: float) -> tuple[Array, Array]:
    margin = finite_number("limits, margin", margin, least=0.0)
    if not switch("limits, position", position):
        if margin:
            raise InvalidInputError(
                f"limits: margin={margin:g} has no effect with position=False; leave one out"
            )
        free = np.full(robot.nv - 6, np.inf)
        return read_only(-free), read_only(free)
    lower, upper = robot.limits.lower + margin, robot.limits.upper - margin
    for k in np.flatnonzero(lower > upper):
        raise InvalidInputError(
            f"limits, margin: {margin:g} leaves no range for joint {robot.joint_names[k]!r} "
            f"[{robot.limits.lower[k]:g}, {robot.limits.upper[k]:g}]"
        )
    return read_only(lower), read_only(upper)


def _speeds(robot: Robot, velocity: float | None) -> Array:
    if velocity is None:
        return np.full(robot.nv - 6, np.inf)
    return finite_number("limits, velocity", velocity, above=0.0) * robot.limits.velocity


def _by_joint(what: str, given: ArrayLike, joints: int) -> Array:
    numbers = real_array(what, given)
    return _positive(what, np.full(joints, numbers) if numbers.ndim == 0 else numbers, joints)


def _positive(what: str, value: Any, size: int) -> Array:
    """Return (size,) positive numbers, infinity allowed (no limit)."""
    given = real_array(what, value)
    checked = finite_vector(what, np.where(np.isposinf(given), 1.0, given), size)
    if (checked <= 0.0).any():
        raise InvalidInputError(f"{what}: every entry must be positive, got {given.tolist()}")
    return read_only(np.where(np.isposinf(given), np.inf, checked))
