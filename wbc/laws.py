"""Laws: from a task's residual to least-squares rows on the velocity at the end of the tick.

The unknown of both control levels begins with that velocity v+, so a task is written once and its
law says what v+ should do for it: :class:`VelocityLaw` (first order, for the velocity level) or
:class:`AccelerationLaw` (second order, for the torque level).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.kinds import switch
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import Array, Floats, finite_number, read_only

# Entries of v, each once.
Columns = slice | NDArray[np.int64]


def columns_of(entries: Sequence[int]) -> Columns:
    """Return entries as a slice where they follow each other: NumPy reads it in half the time."""
    first, end = min(entries), max(entries) + 1
    return slice(first, end) if [*entries] == [*range(first, end)] else np.array(entries)


@cache
def zero_rate(shape: tuple[int, ...]) -> Array:
    """Return the rate of a fixed target: shared zeros, which laws recognise and do not add."""
    return read_only(np.zeros(shape))


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
        A bound on that sum where it is not given, by which the law damps: a number on its norm, or
        (nv,) numbers that make a diagonal matrix above it, such as the sums of its rows' sizes. Or
        a function that returns it: only the velocity level asks for it.
    """

    error: Floats
    jacobian: Array
    bias: Floats
    curvature: Array | None = None
    curvature_bound: float | Array | Callable[[], float | Array] = 0.0

    def rate(self, v: Array) -> Array:
        """Return the time derivative (k,) of the error at velocity ``v``."""
        return self.jacobian @ v + self.bias


class Rows(NamedTuple):
    """Rows ``matrix @ x = target`` to be met by the unknown x as well as ``weight`` asks."""

    matrix: Array  # (k, nv), or (k, n) where rows speak of unknowns behind the velocity too
    target: Array  # (k,)
    weight: Array  # (k,) factors applied before squaring
    # Singular values of matrix below which the target is reduced; 0 for never.
    singular_threshold: float = 0.0
    # rate and bias: the target is -rate * error - bias, in [1/s] and (k,); 0 and None for rows
    # that are not of this form.
    rate: float = 0.0
    bias: Array | None = None


def stacked(matrices: Sequence[Array], n: int) -> Array:
    """Return matrices one below the other as a fresh (k, n) array, columns behind v+ zero."""
    for matrix in matrices:
        if matrix.shape[1] != n:
            break
    else:
        return np.concatenate(matrices)
    rows, begin = np.zeros((sum(map(len, matrices)), n)), 0
    for matrix in matrices:
        end = begin + len(matrix)
        rows[begin:end, : matrix.shape[1]] = matrix
        begin = end
    return rows


@dataclass(frozen=True, slots=True)
class VelocityLaw:
    """First order: ``d(error)/dt = -gain/dt * error``.

    A Gauss-Newton step of length ``gain`` towards a target out of reach swings back and forth
    unless its Hessian is above gain/2 of the true one. Hence half of gain times what a task says
    of the curvature left out is added as damping, to each joint its own; it fades as the error
    does.

    Attributes
    ----------
    gain:
        Fraction of the error to remove in one tick, in (0, 1]; 0 only for contacts.
    gain_per_second:
        Instead of ``gain``: the rate k [1/s] of an exponential decay, whatever ``dt`` is. In one
        tick the fraction 1 - exp(-k dt) is removed.
    lm_damping:
        Levenberg-Marquardt damping: ``lm_damping * |weight * error|`` is added to the diagonal of
        the cost. Keeps a task with an unreachable target from chattering round its optimum.
    singular_threshold:
        Singular values of the Jacobian below this are singular: along their directions the task
        asks for less, by (value / this)^2, so that no joint rate above |wanted rate / this| is
        needed. In the error's unit/s per rad/s; counted are the motions that contacts and more
        important tasks leave, and that the joints' weights choose. 0 for never. An error that grows
        meanwhile is asked for when its direction comes back; out of an exactly singular posture
        only other tasks lead. See :mod:`wbc.controllers.singular`.
    curvature_damping:
        Whether the curvature that Gauss-Newton leaves out is damped; False is the plain step of
        the paper's eq. 38.
    weighs_error:
        Whether a task's weight is that of its error, whatever the gain: tasks that cannot all be
        met come to rest where the sum of 1/2 |weight * error|^2 is least. By default it is that of
        the rate, whose gradient at rest is weight^2 * gain * error; so it is divided by the root
        of the gain.
    """

    gain: float = 0.5
    lm_damping: float = 0.0
    singular_threshold: float = 0.0
    gain_per_second: float | None = None
    curvature_damping: bool = True
    weighs_error: bool = False

    def __post_init__(self) -> None:
        finite_number("gain", self.gain, least=0.0)
        if self.gain > 1.0:
            raise InvalidInputError(f"gain: {self.gain:g} is above 1 (the whole error in one tick)")
        if self.gain_per_second is not None:
            finite_number("gain_per_second", self.gain_per_second, above=0.0)
        finite_number("lm_damping", self.lm_damping, least=0.0)
        switch("curvature_damping", self.curvature_damping)
        switch("weighs_error", self.weighs_error)
        finite_number("singular_threshold", self.singular_threshold, least=0.0)

    def fraction(self, dt: float) -> float:
        """Return the fraction of the error that one tick of ``dt`` [s] removes."""
        if self.gain_per_second is None:
            return self.gain
        return -math.expm1(-self.gain_per_second * dt)

    def factor(self, dt: float) -> float:
        """Return the factor on a task's weights: see ``weighs_error``."""
        gain = self.fraction(dt)
        return 1.0 / math.sqrt(gain) if self.weighs_error and gain > 0.0 else 1.0


@dataclass(frozen=True, slots=True)
class AccelerationLaw:
    """Second order: ``e'' = -kp e - kd e'``, as rows on the velocity at the end of the tick.

    With e'' = J (v+ - v)/dt + drift the rows are ``J v+ = J v + dt (-kp e - kd e' - drift)``; the
    drift has the target's acceleration in it, the rate e' its rate. A task about a rate (momentum,
    damping) has e = 0 and is of first order: e'' = -kd e', so e' decays as exp(-kd t).

    Attributes
    ----------
    kp:
        Stiffness [1/s^2].
    kd:
        Damping [1/s]; None for the critical 2 sqrt(kp).
    """

    kp: float = 100.0
    kd: float | None = None

    def __post_init__(self) -> None:
        finite_number("kp", self.kp, least=0.0)
        if self.kd is not None:
            finite_number("kd", self.kd, least=0.0)

    @classmethod
    def capture_point(
        cls, height: float, gain: float = 2.0, gravity: float = STANDARD_GRAVITY
    ) -> AccelerationLaw:
        """Return the law of a CoM over level ground that brings its capture point to the target.

        With omega^2 = gravity / height the capture point is xi = c + c'/omega, and with its error
        e_xi the law puts the centroidal moment pivot at xi + gain e_xi: for a target at rest,
        c'' = omega^2 (c - xi - gain e_xi). Hence kp = gain omega^2 and kd = (1 + gain) omega; e_xi
        decays as exp(-gain omega t). For the axes x and y of a :class:`~wbc.tasks.ComTask`.

        Parameters
        ----------
        height:
            Of the CoM above the ground [m].
        gain:
            How far beyond the capture point the pivot goes, by its error.
        gravity:
            [m/s^2].
        """
        finite_number("capture point, height", height, above=0.0)
        finite_number("capture point, gain", gain, above=0.0)
        finite_number("capture point, gravity", gravity, above=0.0)
        omega = math.sqrt(gravity / height)
        return cls(kp=gain * omega**2, kd=(1.0 + gain) * omega)

    @property
    def velocity_gain(self) -> float:
        """``kd``, or the critical one."""
        return 2.0 * math.sqrt(self.kp) if self.kd is None else self.kd
