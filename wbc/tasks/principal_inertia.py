"""The principal moments of inertia as a task."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import switch
from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.robot.names import BASE
from wbc.spatial import congruence, vech, vech_inverse
from wbc.tasks.inertia import ALL, FROBENIUS_ROWS, curvature_bound
from wbc.tasks.keywords import Gains
from wbc.tasks.task import Task
from wbc.validate import Array, finite_array, read_only

if TYPE_CHECKING:  # CasADi is loaded only if expressions are needed
    from wbc.robot.symbolic import Expression, SymbolicPosture

MOMENTS = ("smallest", "middle", "largest")
# Moments closer than this fraction of the largest are taken as equal: their axes are arbitrary.
EQUAL = 1e-9


class PrincipalInertiaTask(Task):
    """Bring the principal moments to ``target`` (3,), smallest first, whatever their axes.

    The error is I - N, with N the nearest matrix (Frobenius norm) that has the wanted principal
    moments: it shares the eigenvectors of I (Hoffman and Wielandt). Unlike three separate
    eigenvalues, whose derivatives jump where two cross, this stays well behaved where two moments
    are equal: the error also has rows for the block in which the eigenvectors are arbitrary. It is
    expressed in base axes, where the inertia depends on the joints alone.

    The Jacobian is that of the error unless two wanted moments lie farther apart than the actual
    ones: there the rate of N's axes is unbounded, and is limited to that of I (see
    :func:`turning_ratios`).
    """

    per_mass: bool

    _fixed = Task._fixed | {"per_mass": "make another task"}

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        per_mass: bool = False,
        name: str = "principal inertia",
        **law: Unpack[Gains],
    ) -> None:
        super().__init__(robot, name, ALL, **law)
        self.per_mass = switch(f"task {name!r}, per_mass", per_mass)
        self._selection = read_only((1.0 / robot.mass if self.per_mass else 1.0) * FROBENIUS_ROWS)
        self.set_target(target)

    @property
    def selection(self) -> Array:
        """Matrix (6, 6), read-only: the error is selection @ vech(I - N)."""
        return self._selection

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the target moments (3,) [kg m^2] and, if it moves, its derivatives; all are sorted.

        ``rate`` and ``acceleration`` (3,) are sorted as the moments are.
        """
        moments = finite_array(f"{self}, target", target, (3,))
        if moments.min() < 0.0:
            raise InvalidInputError(
                f"{self}, target: {moments.min():g} is negative, which no inertia is"
            )
        self._set_rates((3,), rate, acceleration)
        order = np.argsort(moments, kind="stable")
        self._assign(
            _goal=read_only(moments[order]),
            target_rate=read_only(self.target_rate[order]),
            target_acceleration=read_only(self.target_acceleration[order]),
        )

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return vech(I - N) with off-diagonal entries times sqrt(2), and its Jacobian."""
        moments, V = np.linalg.eigh(snapshot.inertia_in(BASE))
        error = (V * (moments - self.target)) @ V.T
        # dN = V (c o (V' dI V)) V' off the diagonal, 0 on it: the eigenvectors turn.
        kept = 1.0 - turning_ratios(moments, self.target)
        reshaped = (congruence(V) * vech(kept)) @ congruence(V.T)  # (6, 6)
        jacobian = reshaped @ snapshot.base_inertia_jacobian
        error_rows = self._selection @ vech(error)
        pull = self._selection.T @ self._gradient(error_rows)
        bound = curvature_bound(pull, snapshot.inertia)
        bias = -(self._selection @ vech((V * self.target_rate) @ V.T))
        return Residual(error_rows, self._selection @ jacobian, bias, curvature_bound=bound)

    @property
    def reported_rows(self) -> tuple[str, ...]:
        """Names of the principal moments."""
        return MOMENTS

    @property
    def units(self) -> tuple[str, ...]:
        """Units of inertia, or of inertia per mass."""
        return ("m^2" if self.per_mass else "kg m^2",) * 3

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the second derivative of the error at v' = 0, including the target's motion.

        The rate of N's axes is limited as in the Jacobian: see :func:`turning_ratios`.
        """
        moments, V = np.linalg.eigh(snapshot.inertia_in(BASE))
        rate = V.T @ vech_inverse(snapshot.base_inertia_jacobian @ snapshot.v) @ V
        curvature = V.T @ vech_inverse(snapshot.inertia_drift_in(BASE)) @ V
        spin, spin_rate = eigenvector_spin(moments, rate, curvature, self.target)
        S, S_rate = np.diag(self.target), np.diag(self.target_rate)
        turned = spin @ S - S @ spin + 2.0 * S_rate
        nearest = spin @ turned - turned @ spin + spin_rate @ S - S @ spin_rate
        nearest += np.diag(self.target_acceleration)
        return self._selection @ vech(V @ (curvature - nearest) @ V.T)

    def deviation(self, snapshot: Snapshot, residual: Residual) -> Array:
        """Return actual minus target principal moments (3,), in increasing order."""
        moments = np.linalg.eigvalsh(snapshot.inertia)
        return (moments - self.target) * self._selection[0, 0]

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return I - N for the wanted moments of N, with its axes as free variables.

        The nearest such N is what the error is measured from (Hoffman and Wielandt): minimising
        over the axes too gives the same cost, with no eigenvalues that cross.

        Raises
        ------
        InvalidInputError
            Rows of different weights, whose cost would depend on the axes.
        """
        if np.ptp(self.weight):
            raise InvalidInputError(
                f"global shaping: task {self.name!r} weighs its six rows differently; give one"
                " weight"
            )
        R = posture.free_rotations[self.name]
        nearest = R @ np.diag(self.target) @ R.T
        return posture.inertia_error(self._selection, nearest, BASE)

    def free_rotation(self, snapshot: Snapshot) -> Array:
        """Return the principal axes (3, 3) in base axes."""
        axes = np.linalg.eigh(snapshot.inertia_in(BASE))[1]
        axes[:, 0] *= np.linalg.det(axes)  # a rotation; a mirrored axis is the same axis
        return axes


def turning_ratios(moments: Array, wanted: Array) -> Array:
    """Return c (3, 3): as I changes by dI, N changes by c_ij dI_ij off the diagonal (eigenbasis).

    c_ij = (wanted_i - wanted_j) / (moments_i - moments_j), limited to 1. The limit acts where the
    wanted moments lie further apart than the actual ones: there the axes that N borrows from I may
    turn faster than I changes, without bound at equal moments, and following them would lock the
    robot. Equal wanted moments give 0: the whole block is then driven to a multiple of the
    identity.
    """
    wanted_gap = np.abs(wanted[:, None] - wanted)
    gap = np.maximum(np.abs(moments[:, None] - moments), wanted_gap)
    return np.divide(wanted_gap, gap, out=np.zeros((3, 3)), where=gap > 0.0)


def eigenvector_spin(
    moments: Array, rate: Array, curvature: Array, wanted: Array
) -> tuple[Array, Array]:
    """Return Omega and its rate (3, 3) with V' = V Omega for the eigenvectors V of I.

    ``rate`` and ``curvature`` are V' dI/dt V and V' d2I/dt2 V, ``moments`` and ``wanted`` increase.
    Where wanted moments lie further apart than the actual ones their distance is divided by, as in
    :func:`turning_ratios`: the limit of what N is made to follow. Pairs of equal moments get 0.
    """
    gap = moments[:, None] - moments
    wanted_gap = wanted[:, None] - wanted
    gap = np.where(np.abs(wanted_gap) > np.abs(gap), wanted_gap, gap)
    distinct = np.abs(gap) > EQUAL * np.abs(moments).max()
    none = np.zeros((3, 3))
    spin = np.divide(-rate, gap, out=none.copy(), where=distinct)
    change = np.diag(rate)
    total = curvature + rate @ spin - spin @ rate + (change[:, None] - change) * spin
    return spin, np.divide(-total, gap, out=none, where=distinct)
