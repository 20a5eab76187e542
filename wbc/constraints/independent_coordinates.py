"""The paper's independent coordinates of a support (5.2), and its inertia shaping step (eq. 38).

Held feet make entries of v dependent. The paper chooses independent entries and expresses the rest
by them: floating all of v; on one foot the joints, the base by eqs. 32-35; on both feet the joints
of the left leg and of the trunk, q_l and q_t, base and right leg by eqs. 36-37. The choice matters:
eq. 38 minimises the norm of the independent entries only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lstsq, qr

from wbc.constraints.contact import Contact
from wbc.constraints.limits import BASE_ROWS
from wbc.constraints.mechanics import mechanics_of
from wbc.constraints.support_modes import support
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.validate import Array, finite_array, finite_number, read_only, real_array

# Singular values of a task's Jacobian in independent coordinates below this share of the largest
# are rounding.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class IndependentCoordinates:
    """Independent entries of v under a support, and the others as functions of them (paper 5.2).

    Make it with :meth:`of`. It holds at one configuration, as a Jacobian does.

    Attributes
    ----------
    names:
        (k,) of the independent entries: joints, and ``base x`` to ``base rz`` while floating.
    independent:
        (k,) their places in v, increasing.
    basis:
        (nv, k), read-only: ``v == basis @ v[independent]`` for all v that the support allows.
    """

    names: tuple[str, ...]
    independent: np.ndarray
    basis: Array

    @classmethod
    def of(
        cls, snapshot: Snapshot, mode: str | Sequence[str] = "floating", tolerance: float = 1e-5
    ) -> IndependentCoordinates:
        """Return the coordinates of a support at a snapshot.

        Eliminated are the base, mimic joints, and then joints of the legs, those of the foot that
        is named first (of ``"double"`` the left) last. Where J_r* loses rank, as at a straight
        knee, the paper's inverse does not exist: as many of the right leg's joints are eliminated
        as can be (by QR with column pivoting), then of the other leg and the rest, and rows that
        repeat others tie nothing.

        Parameters
        ----------
        mode:
            As :func:`~wbc.constraints.support` takes it. A fixed base is held too.
        tolerance:
            Of the largest column of the support's rows: what is left of a column below this is
            taken for dependent on those before it. By default the inverse is taken until the knee
            is straight to some 1e-4 rad (files round angles to 1e-6); near there dependent joints
            move up to 1e5 times as far as independent ones.

        Raises
        ------
        UnknownNameError
            A mode, foot or frame that does not exist.
        InvalidInputError
            No snapshot, no mode, or a tolerance outside (0, 1).
        """
        held = support(snapshot, mode)
        tolerance = finite_number("independent coordinates, tolerance", tolerance, above=0.0)
        if tolerance >= 1.0:
            raise InvalidInputError(
                f"independent coordinates, tolerance: must be below 1, got {tolerance:g}"
            )
        robot = snapshot.robot
        rows = [one.residual(snapshot).jacobian for one in mechanics_of(robot, held)]
        A = np.concatenate(rows) if rows else np.zeros((0, robot.nv))
        dependent = _dependent(A, _groups(robot, held), tolerance)
        independent = np.setdiff1d(np.arange(robot.nv), dependent)
        basis = np.zeros((robot.nv, independent.size))
        basis[independent, np.arange(independent.size)] = 1.0
        if dependent:
            follows, *_ = np.linalg.lstsq(A[:, dependent], A[:, independent], rcond=None)
            basis[dependent] = -follows
        names = BASE_ROWS + robot.joint_names
        return cls(tuple(names[k] for k in independent), read_only(independent), read_only(basis))

    def jacobian(self, rows: ArrayLike) -> Array:
        """Return a Jacobian (m, nv) by v as one (m, k) by the independent entries (eqs. 30-37)."""
        given, nv = real_array("independent coordinates, rows", rows), len(self.basis)
        if given.ndim != 2 or not len(given):
            raise InvalidInputError(
                f"independent coordinates, rows: expected (m, {nv}), got shape {given.shape}"
            )
        shape = len(given), nv
        return finite_array("independent coordinates, rows", given, shape) @ self.basis

    def step(self, rows: ArrayLike, change: ArrayLike, damping: float = 0.0) -> Array:
        """Return the step of eq. 38 (nv,): the least one, in independent entries, to a change.

        J^+ change in the independent coordinates, J^+ = J' (J J' + damping 1)^-1, and the dependent
        entries that follow. It ignores limits and margins. For inertia shaping
        ``residual = task.residual(snapshot)`` gives ``rows = residual.jacobian`` and
        ``change = -residual.error``.

        Parameters
        ----------
        rows:
            Jacobian (m, nv) by v.
        change:
            (m,) wanted, as I_d - I. If it cannot be met, the nearest one is.
        damping:
            Of the squares, in the rows' units squared; 0 as in the paper, where rows that nearly
            lose rank move joints by radians.

        Returns
        -------
        (nv,) to move along for a unit of time: ``robot.integrate(q, step, 1.0)``.

        Raises
        ------
        InvalidInputError
            Wrong shapes, numbers that are not finite, or negative damping.
        """
        J = self.jacobian(rows)
        wanted = finite_array("independent coordinates, change", change, (len(J),))
        damping = finite_number("independent coordinates, damping", damping, least=0.0)
        if damping:
            k = J.shape[1]
            J = np.concatenate((J, np.sqrt(damping) * np.eye(k)))
            wanted = np.concatenate((wanted, np.zeros(k)))
        return self.basis @ lstsq(J, wanted, ROUNDING, lapack_driver="gelsy")[0]


def _groups(robot: Robot, held: Sequence[Contact]) -> Iterator[list[int]]:
    """Yield indices in v in the order of their elimination; some more than once."""
    model = robot.model
    yield list(range(BASE_NV))
    yield [robot.joint_index(joint) for joint in robot.motorless]
    chains = [
        {int(model.idx_vs[j]) for j in model.supports[robot.frame(one.frame).parentJoint] if j > 1}
        for one in held
    ]
    for k in reversed(range(len(chains))):  # joints that move this foot only
        others = set().union(*chains[:k], *chains[k + 1 :])
        yield sorted(chains[k] - others)
    yield list(range(BASE_NV, robot.nv))


def _dependent(A: Array, groups: Iterator[list[int]], tolerance: float) -> list[int]:
    """Return columns of A (me, n) that span its range, preferring those of the first groups."""
    dependent = list[int]()
    if not len(A):
        return dependent
    least = tolerance * float(np.linalg.norm(A, axis=0).max())
    left = A.copy()
    for group in groups:
        columns = [k for k in group if k not in dependent]
        if not columns:
            continue
        Q, R, pivots = qr(left[:, columns], mode="economic", pivoting=True)
        rank = int(np.count_nonzero(np.abs(np.diagonal(R)) > least))
        dependent += [columns[k] for k in pivots[:rank]]
        left -= Q[:, :rank] @ (Q[:, :rank].T @ left)
    return dependent
