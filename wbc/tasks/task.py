"""What every task is: an error that should vanish, and how it changes with the velocity.

A task is written once. At the velocity level :meth:`Task.residual` and :attr:`Task.law` are used;
at the torque level :meth:`Task.drift` and :attr:`Task.acceleration_law` too. A task met exactly
instead of by its weight is a contact: see :mod:`wbc.constraints.contact`.

With a(t) the actual value and a*(t) the target, the error is e = a - a*, and

    e'  = J v + bias            bias:  minus the target's rate          residual(), both levels
    e'' = J v' + drift          drift: J' v minus a*''                  drift(), torque level

so a target that moves is followed without lag when its rate and acceleration are given with it:
``set_target(target, rate, acceleration)``. What is left out is zero; assigning ``task.target``
gives the value alone, at rest.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from inspect import isfunction, signature
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.attributes import ArrayAttribute, DeclaredAttributes
from wbc.errors import InvalidInputError, UnknownNameError, WbcError, shown
from wbc.laws import AccelerationLaw, Columns, Residual, VelocityLaw, zero_rate
from wbc.native.rows import NativeRows
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot
from wbc.tasks.keywords import FIRST_ORDER, PRIORITY, SECOND_ORDER, WEIGHT, LawKeywords, spell_out
from wbc.tasks.weights import checked_weight, warn_if_lost
from wbc.validate import Array, finite_array, finite_number, names_of, plain_copy, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import Expression, SymbolicPosture


_LAWS: dict[str, type] = {"law": VelocityLaw, "acceleration_law": AccelerationLaw}
_MOTION = frozenset(("target_rate", "target_acceleration"))


class Aim(NamedTuple):
    """A point of the robot, and where a task wants it: (3,) each [m], world axes."""

    point: Array
    wanted: Array


class Task(DeclaredAttributes, ABC):
    """A quantity to be driven to its target.

    Subclasses define :meth:`residual`; for the torque level :meth:`drift` too.

    Parameters
    ----------
    robot:
        The robot whose snapshots it is evaluated on.
    name:
        Used in diagnostics and files; unique within a controller.
    rows:
        Names of the k entries of the error.
    weight:
        (k,) factors on the rows before squaring, or one for all. The cost is
        1/2 |weight * (rate - wanted)|^2, so a weight is in [cost^(1/2)] per unit of the error's
        rate: 1/(m/s) for a position, 1/(rad/s) for an angle, 1/(kg m^2/s) for an inertia,
        1/(kg m/s) for a momentum.
    priority:
        Level, 0 the most important: tasks of a level never give way to those of a later one.
        Within a level tasks are weighed against each other.
    law:
        ``gain`` or ``gain_per_second``, ``lm_damping``, ``singular_threshold``,
        ``curvature_damping`` and ``weighs_error`` of the :class:`~wbc.laws.VelocityLaw`; ``kp`` and
        ``kd`` of the :class:`~wbc.laws.AccelerationLaw`.

    Attributes
    ----------
    weight:
        (k,), read-only; assign one number or one per row.
    law:
        How the velocity level drives it.
    acceleration_law:
        How the torque level does.
    target_rate, target_acceleration:
        How the target moves, as last given to ``set_target``; zeros for a target at rest. Tasks
        without a target have none.

    Raises
    ------
    InvalidInputError
        A value out of range, or ``gain`` and ``gain_per_second`` both given.
    UnknownNameError
        A keyword that no law has.
    """

    robot: Robot
    name: str
    rows: tuple[str, ...]
    weight: ArrayAttribute  # a plain one, since it is read in every tick
    priority: int
    law: VelocityLaw
    acceleration_law: AccelerationLaw
    target_rate: Array
    target_acceleration: Array
    _goal: Array
    _bias: Array  # what rates of the rows are at rest: minus the target's
    _drift: Array  # and of their second derivatives
    # Others than they were once it was changed, and in more than its target: what was read of it
    # before may be old.
    _changes: object
    _remakes: object
    _fixed = dict.fromkeys(("robot", "rows"), "make another task")
    _kind = "task"  # as error messages call it
    _unused: ClassVar[frozenset[str]] = frozenset()  # keywords of laws without effect: refused
    _units: ClassVar[str | Mapping[str, str]] = ""  # of all reported entries, or each by its name
    _tested = True  # whether what it returns needs no look: set below for what is derived
    _may_rest = False  # whether a gain of 0 is meant: contacts that only do not move

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._tested = not cls._takes_any
        made_by = cls.__dict__.get("__init__")
        if isfunction(made_by):
            spell_out(made_by)

    @spell_out
    def __init__(
        self,
        robot: Robot,
        name: str,
        rows: Iterable[str],
        *,
        weight: ArrayLike = WEIGHT,
        priority: int = PRIORITY,
        **law: Unpack[LawKeywords],
    ) -> None:
        check_robot(type(self).__name__, robot)
        self.robot = robot
        self.name = name
        self.rows = names_of(f"{self}, rows", rows)
        if not self.rows:
            raise InvalidInputError(f"{self}: no row given; there is nothing to control")
        self.weight = weight
        self.priority = priority
        for key in law:
            if key not in FIRST_ORDER | SECOND_ORDER:
                own = signature(type(self)).parameters.values()  # such as a PositionTask's axes
                known = {one.name for one in own if one.kind is one.KEYWORD_ONLY}
                known |= {"weight", "priority", "name"} | FIRST_ORDER | SECOND_ORDER
                raise UnknownNameError(f"keyword of {self}", key, known)
        if law.get("gain_per_second") is not None and "gain" in law:
            raise InvalidInputError(f"{self}: give gain or gain_per_second, not both")
        self.law = VelocityLaw()
        self.acceleration_law = AccelerationLaw()
        self._set_law(**law)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, rows={len(self.rows)}, gain={self.gain:g})"

    def __str__(self) -> str:
        return f"{self._kind} {self.name!r}"

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "weight":
            value = checked_weight(str(self), value, len(self.rows))
            if "weight" in self.__dict__:
                warn_if_lost(str(self), self.weight, value)
        elif name == "priority":
            level = finite_number(f"{self}, priority", value, least=0)
            if level != int(level):
                raise InvalidInputError(f"{self}, priority: {level:g} is not a whole number")
            value = int(level)
        elif name == "name" and not (isinstance(value, str) and value):
            raise InvalidInputError(f"{type(self).__name__}, name: expected a word, got {value!r}")
        elif name in _LAWS and not isinstance(value, _LAWS[name]):
            wanted = _LAWS[name].__name__
            raise InvalidInputError(f"{self}, {name}: expected {wanted}, got {shown(value)}")
        elif name == "law" and not (value.fraction(1.0) or self._may_rest):
            raise InvalidInputError(f"{self}, gain: must be greater than 0, got 0")
        elif name in _MOTION:
            raise InvalidInputError(
                f"{self}, {name}: goes with the target: set_target(target, rate, acceleration)"
            )
        elif name in ("kp", "kd") and not self._takes_any:
            raise InvalidInputError(
                f"{self}, {name}: is of its law: acceleration_law = wbc.AccelerationLaw({name}=...)"
            )
        super()._set_attribute(name, value)
        self._remade()

    def switch_off(self) -> None:
        """Set the weight to 0 on purpose: the task does nothing until it is given one again."""
        self.__dict__["weight"] = read_only(np.zeros(len(self.rows)))
        self._remade()

    def _remade(self) -> None:
        own = self.__dict__
        own["_changes"] = own["_remakes"] = object()

    @property
    def target(self) -> Array:
        """What the task aims at; assigning calls ``set_target``: checked, and at rest from then."""
        return self._goal

    @target.setter
    def target(self, value: ArrayLike) -> None:
        set_target: Callable[[ArrayLike], None] | None = getattr(self, "set_target", None)
        if set_target is None:
            raise InvalidInputError(
                f"{self}: {type(self).__name__} has no set_target, which assigning "
                "a target calls; define it"
            )
        set_target(value)

    @property
    def gain(self) -> float:
        """Fraction of the error to remove in one tick."""
        return self.law.gain

    @gain.setter
    def gain(self, value: float) -> None:
        self._set_law(gain=value, gain_per_second=None)

    @property
    def lm_damping(self) -> float:
        """Levenberg-Marquardt damping; see :class:`~wbc.laws.VelocityLaw`."""
        return self.law.lm_damping

    @lm_damping.setter
    def lm_damping(self, value: float) -> None:
        self._set_law(lm_damping=value)

    @property
    def singular_threshold(self) -> float:
        """Singular values below this are singular; 0 for never."""
        return self.law.singular_threshold

    @singular_threshold.setter
    def singular_threshold(self, value: float) -> None:
        self._set_law(singular_threshold=value)

    @abstractmethod
    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the error and its first derivative at ``snapshot``."""

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the second time derivative (k,) of the error at zero acceleration of v.

        It includes that of a moving target: e'' = J v' + drift, so drift = J' v minus the target's
        acceleration (and for errors that are not differences, such as log(R*' R), all else that
        the target's motion adds).

        Raises
        ------
        InvalidInputError
            A task that does not define it; only the torque level asks for it.
        """
        raise InvalidInputError(
            f"{self}: a {type(self).__name__} does not define drift(), its error's "
            "second derivative at zero acceleration, which the torque level needs"
        )

    def native(self) -> Sequence[NativeRows] | None:
        """Return what the native core needs for the residual; None: it is asked in each tick.

        Not inherited: who derives a kind of task may have changed its residual.
        """
        return None

    def deviation(self, snapshot: Snapshot, residual: Residual) -> Array:
        """Return what diagnostics report as the error (k,), in the task's own units."""
        return residual.error  # type: ignore[return-value]  # a checked one

    @property
    def reported_rows(self) -> tuple[str, ...]:
        """Names of the entries of what :meth:`deviation` returns."""
        return self.rows

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the entries of what :meth:`deviation` returns; empty if it does not say."""
        known, rows = self._units, self.reported_rows
        return tuple(known if isinstance(known, str) else known[row] for row in rows)

    def aim(self, snapshot: Snapshot) -> Aim | None:
        """Return which point the task moves and where to, for pictures; None if it is no place."""
        return None

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the error (k, 1) as an expression of the posture, for searches over postures.

        Raises
        ------
        InvalidInputError
            A kind of task that does not say what its error is in terms of the posture.
        """
        raise InvalidInputError(
            f"global shaping: task {self.name!r} is a {type(self).__name__}, of which no error in"
            " terms of the posture is known; leave it to the controller"
        )

    def free_rotation(self, snapshot: Snapshot) -> Array | None:
        """Return a rotation (3, 3) that minimises the symbolic error at ``snapshot``.

        It is an unknown of the search, ``posture.free_rotations[self.name]``; None for none.
        """
        return None

    def _set_law(self, **changes: Any) -> None:
        """Replace entries of either law; errors name the task."""
        for key in sorted(changes.keys() & self._unused):
            raise InvalidInputError(
                f"{self}, {key}: has no effect, since a {type(self).__name__} has no error but a"
                " rate, which the velocity level meets at once; at the torque level it decays as"
                " exp(-kd t): give kd, or leave this out"
            )
        first = {key: value for key, value in changes.items() if key in FIRST_ORDER}
        second = {key: value for key, value in changes.items() if key in SECOND_ORDER}
        try:
            law = replace(self.law, **first)
            acceleration_law = replace(self.acceleration_law, **second)
        except WbcError as error:
            raise InvalidInputError(f"{self}, {error}") from error
        self.law, self.acceleration_law = law, acceleration_law

    def _target(self, value: ArrayLike, shape: tuple[int, ...], what: str = "target") -> Array:
        plain = plain_copy(value, shape)  # in every tick: no words unless they are needed
        if plain is None:
            plain = finite_array(f"{self}, {what}", value, shape)
        plain.setflags(False)  # type: ignore[call-arg]  # as read_only does
        return plain

    def _assign(self, **values: Any) -> None:
        """Set attributes of a target, without the check of names."""
        own = self.__dict__
        own.update(values)
        own["_changes"] = object()

    def _set_rates(
        self,
        shape: tuple[int, ...],
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> bool:
        """Check and set how the target moves; None is rest. Return False if it rests as before."""
        speed, push = self._rates(shape, rate, acceleration)
        if self._rests(speed, push):
            return False
        self._assign(target_rate=speed, target_acceleration=push)
        return True

    def _rates(
        self, shape: tuple[int, ...], rate: ArrayLike | None, acceleration: ArrayLike | None
    ) -> tuple[Array, Array]:
        """Return how the target moves, checked; None is rest."""
        speed = push = zero_rate(shape)
        if rate is not None:
            speed = self._target(rate, shape, "target rate")
        if acceleration is not None:
            push = self._target(acceleration, shape, "target acceleration")
        return speed, push

    def _rests(self, speed: Array, push: Array) -> bool:
        """Return whether a target that moves so rests as before."""
        own = self.__dict__
        return own.get("target_rate") is speed and own.get("target_acceleration") is push

    def _negative(self, motion: Array, rows: Columns) -> Array:
        """Return minus those entries of a target's rate or acceleration; zeros known as rest."""
        return self._zeros() if motion is zero_rate(motion.shape) else read_only(-motion[rows])

    def _gradient(self, error: Array) -> Array:
        """Return weight^2 * error (k,): the gradient of the task's cost by its error."""
        gradient = self.weight * error
        gradient *= self.weight
        return gradient

    def _zeros(self) -> Array:
        return zero_rate((len(self.rows),))
