"""What every task is: an error that should vanish, and how it changes with the velocity.

A task is written once. At the velocity level only :meth:`Task.residual` is used; at the
acceleration level :meth:`Task.drift` is added. :mod:`wbc.laws` turns either into rows of the QP.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.validate import Array, finite_array, finite_number, finite_vector, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class Residual(NamedTuple):
    """Error of a task at one state and its first derivative: ``rate == jacobian @ v + bias``.

    A named tuple rather than a frozen dataclass: a tick makes a dozen, at a third of the cost.

    Attributes
    ----------
    error:
        (k,) actual minus target.
    jacobian:
        (k, nv).
    bias:
        (k,) what the error changes by at v = 0: minus the rate of a moving target.
    curvature:
        (nv, nv) sum over the rows of weight^2 * error * second derivative of the error, or None:
        what Gauss-Newton leaves out of the cost's Hessian. Few tasks give it.
    curvature_bound:
        A bound on the norm of that sum where it is not given; the law damps by it.
    """

    error: Array
    jacobian: Array
    bias: Array
    curvature: Array | None = None
    curvature_bound: float = 0.0

    def rate(self, v: Array) -> Array:
        """Return the time derivative (k,) of the error at velocity ``v``."""
        return self.jacobian @ v + self.bias


class Law(TypedDict, total=False):
    """How a task pulls: keywords that every task hands on to :class:`Task`, which explains them."""

    weight: ArrayLike
    gain: float
    lm_damping: float
    singular_below: float
    priority: int


class Task(ABC):
    """A quantity to be driven to its target.

    Attributes
    ----------
    robot:
        The robot whose snapshots it is evaluated on.
    name:
        Used in diagnostics and files; unique within a controller.
    rows:
        Names of the k entries of the error.
    weight:
        (k,) factors on the rows before squaring. The cost is 1/2 |weight * (rate - wanted)|^2, so
        a weight is in [cost^(1/2)] per unit of the error's rate: 1/(m/s) for a position,
        1/(rad/s) for an angle, 1/(kg m^2/s) for an inertia, 1/(kg m/s) for a momentum.
    gain:
        Fraction of the error to remove in one tick, in (0, 1].
    lm_damping:
        Levenberg-Marquardt damping: ``lm_damping * |weight * error|`` is added to the diagonal of
        the cost. Keeps a task with an unreachable target from chattering round its optimum.
    singular_below:
        Singular values of the Jacobian below this are singular: along their directions the task
        asks for less, by (value / this)^2, so that no joint rate above |wanted rate / this| is
        needed. In the error's unit/s per rad/s; counted are the motions that contacts and more
        important tasks leave, and that the joints' weights choose. 0 for never. An error that grows
        meanwhile is asked for when its direction comes back; out of an exactly singular posture
        only other tasks lead. See :mod:`wbc.controllers.singular`.
    priority:
        Level, 0 the most important: tasks of a level never give way to those of a later one.
        Within a level tasks are weighed against each other.
    """

    _goal: Array

    def __init__(
        self,
        robot: Robot,
        name: str,
        rows: Iterable[str],
        *,
        weight: ArrayLike = 1.0,
        gain: float = 0.5,
        lm_damping: float = 0.0,
        singular_below: float = 0.0,
        priority: int = 0,
    ) -> None:
        self.robot = robot
        self.name = name
        self.rows = tuple(rows)
        if not self.rows:
            raise InvalidInputError(f"task {name!r}: no row given; there is nothing to control")
        self.weight = weight
        self.gain = gain
        self.lm_damping = finite_number(f"task {name!r}, lm_damping", lm_damping, least=0.0)
        self.singular_below = singular_below
        self.priority = int(finite_number(f"task {name!r}, priority", priority, least=0))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, rows={len(self.rows)}, gain={self.gain:g})"

    @property
    def target(self) -> Array:
        """What the task aims at; assigning calls ``set_target``, with its checks."""
        return self._goal

    @target.setter
    def target(self, value: ArrayLike) -> None:
        set_target: Callable[[ArrayLike], None] = getattr(self, "set_target")  # noqa: B009
        set_target(value)

    @property
    def weight(self) -> Array:
        """Factors (k,) on the rows; assign one number or one per row."""
        return self._weight

    @weight.setter
    def weight(self, value: ArrayLike) -> None:
        self._weight = self._checked_weight(value)

    @property
    def gain(self) -> float:
        """Fraction of the error to remove in one tick."""
        return self._gain

    @gain.setter
    def gain(self, value: float) -> None:
        gain = finite_number(f"task {self.name!r}, gain", value, above=0.0)
        if gain > 1.0:
            raise InvalidInputError(
                f"task {self.name!r}, gain: {gain:g} is above 1 (the whole error in one tick)"
            )
        self._gain = gain

    @property
    def singular_below(self) -> float:
        """Singular values below this are singular; 0 for never."""
        return self._singular_below

    @singular_below.setter
    def singular_below(self, value: float) -> None:
        what = f"task {self.name!r}, singular_below"
        self._singular_below = finite_number(what, value, least=0.0)

    @abstractmethod
    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the error and its first derivative at ``snapshot``."""

    @abstractmethod
    def drift(self, snapshot: Snapshot) -> Array:
        """Return the second time derivative (k,) of the error at zero acceleration of v."""

    def deviation(self, snapshot: Snapshot, residual: Residual) -> Array:
        """Return what diagnostics report as the error (k,), in the task's own units."""
        return residual.error

    @property
    def reported_rows(self) -> tuple[str, ...]:
        """Names of the entries of what :meth:`deviation` returns."""
        return self.rows

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the entries of what :meth:`deviation` returns; empty if it does not say."""
        return ("",) * len(self.reported_rows)

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

    def _checked_weight(self, weight: ArrayLike) -> Array:
        what = f"task {self.name!r}, weight"
        size = len(self.rows)
        vector = finite_vector(
            what, np.full(size, weight) if np.ndim(weight) == 0 else weight, size
        )
        if (vector < 0.0).any():
            raise InvalidInputError(f"{what}: must not be negative, got {weight!r}")
        return read_only(vector)

    def _target(self, value: ArrayLike, shape: tuple[int, ...], what: str = "target") -> Array:
        return read_only(finite_array(f"task {self.name!r}, {what}", value, shape))

    def _pull(self, error: Array) -> Array:
        """Return weight^2 * error (k,): the slope of the task's cost by its error."""
        pull = self._weight * error
        pull *= self._weight
        return pull

    def _zeros(self) -> Array:
        return read_only(np.zeros(len(self.rows)))
