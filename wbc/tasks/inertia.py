"""The composite-rigid-body inertia as a task: what the paper calls inertia shaping (5.3).

:class:`InertiaTask` drives entries of the inertia matrix (or its trace) about the CoM, a frame's
origin or a point, in chosen axes;
:mod:`wbc.tasks.principal_inertia` drives the principal moments, whatever the axes.
Errors are in kg m^2, or, with ``per_mass``, in m^2 (divided by the robot's mass), which makes one
weight mean the same on a small and on a large robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.kinds import switch
from wbc.laws import Residual
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_sizes
from wbc.robot.names import BASE, COM, WORLD
from wbc.spatial import COMPONENTS, DIAGONAL, FROBENIUS_WEIGHTS, vech, vech_inverse
from wbc.tasks.keywords import Gains
from wbc.tasks.task import Task
from wbc.validate import Array, finite_array, names_of, plain_copy, read_only, real_array

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

ALL = COMPONENTS
DIAGONAL_COMPONENTS = ("xx", "yy", "zz")
OFF_DIAGONAL = ("xy", "xz", "yz")  # entries that stand twice in the matrix
TRACE = ("trace",)

# Rows of the task as rows of vech of the inertia. Off-diagonal entries stand twice in the matrix:
# sqrt(2) makes the norm of the error the Frobenius norm of the difference of the two matrices.
FROBENIUS_ROWS = np.diag(np.sqrt(FROBENIUS_WEIGHTS))
_TRACE_ROW = np.zeros((1, 6))
_TRACE_ROW[0, DIAGONAL] = 1.0
# An off-diagonal entry of the vech vector stands for two entries of the matrix.
_HALF_OFF_DIAGONAL = 1.0 / FROBENIUS_WEIGHTS


class InertiaTask(Task):
    """Bring entries of the CRB inertia to those of ``target``.

    Parameters
    ----------
    target:
        (3, 3) symmetric matrix, or (6,) entries xx xy xz yy yz zz, or (3,) diagonal entries when
        only those are controlled, or one number for the trace [kg m^2].
    components:
        Names among ``xx xy xz yy yz zz``, or ``("trace",)``.
    frame:
        Whose axes: ``"world"``, ``"base"`` (the joints alone then decide: the local shape of paper
        5.2.1) or any frame of the robot.
    about:
        The point that it is about: ``"com"``; ``"world"`` for the world's origin, as the paper's
        spatial inertia is; a frame for its origin, moving with it; or a point (3,) fixed in the
        world [m]. About other points than the CoM its distance counts too, by M times its square.
    per_mass:
        Divide error and Jacobian by the robot's mass; weights are then in 1/(m^2/s).
    second_order:
        Add the curvature of the inertia to the cost. With a target out of reach the error stays
        large and Gauss-Newton leaves curvature out; damping by the sums of its rows prevents
        chattering. With this the task converges like Newton's method, at the cost of an eigenvalue
        decomposition per tick. The rotation of a named frame is left out, and that of the base
        about a point of the world.

    Notes
    -----
    The rows are entries of the matrix, off-diagonal ones times sqrt(2), so that the norm of the
    error over all six is the Frobenius norm of ``actual - target``.
    """

    frame: str
    about: str | tuple[float, ...]
    per_mass: bool
    second_order: bool

    _fixed = Task._fixed | {"per_mass": "make another task"}

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike,
        *,
        components: Sequence[str] = ALL,
        frame: str = WORLD,
        about: str | ArrayLike = COM,
        per_mass: bool = False,
        second_order: bool = False,
        name: str = "inertia",
        **law: Unpack[Gains],
    ) -> None:
        components = names_of("inertia task, components", components)
        super().__init__(robot, name, components, **law)
        self.second_order = second_order
        if not isinstance(frame, str) or frame != WORLD:
            robot.frame_id(frame)
        self.frame = frame
        self.about = self._point(about)
        self.per_mass = switch(f"{self}, per_mass", per_mass)
        scale = 1.0 / robot.mass if self.per_mass else 1.0
        self._wanted: Array
        self._selection = read_only(scale * _selection(components))
        self._entries, self._factors = tuple(range(len(components))), self._selection.ravel()
        self.set_target(target)

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "second_order":
            value = switch(f"{self}, second_order", value)
        elif name == "about":
            value = self._point(value)
        super()._set_attribute(name, value)

    @property
    def selection(self) -> Array:
        """Matrix (k, 6), read-only: the error is selection @ (actual - target), both as vech."""
        return self._selection

    def set_target(
        self,
        target: ArrayLike,
        rate: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """Set the wanted inertia [kg m^2] and, if it moves, rate and acceleration in that form."""
        full = plain_copy(target, (3, 3))  # in every tick: no words unless they are needed
        if full is not None and _is_symmetric(full):
            goal = vech(full)
        else:
            goal = vech_target(f"{self}, target", target, self.rows)
        wanted = self._selection.dot(goal)
        for row, entry in zip(self.rows, wanted.tolist(), strict=True):
            if entry < 0.0 and row not in OFF_DIAGONAL:
                raise InvalidInputError(f"{self}, target: {row} is negative, which no inertia is")
        if rate is not None:
            rate = vech_target(f"{self}, target rate", rate, self.rows)
        if acceleration is not None:
            acceleration = vech_target(f"{self}, target acceleration", acceleration, self.rows)
        if self._set_rates((6,), rate, acceleration):
            bias = -self._selection @ self.target_rate
            drift = -self._selection @ self.target_acceleration
            self._assign(_bias=read_only(bias), _drift=read_only(drift))
        self._assign(_goal=read_only(goal), _wanted=wanted)

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return the selected entries of actual minus target inertia and their Jacobian."""
        check_sizes(self, self.robot, snapshot)
        error = self._selection.dot(vech(snapshot.inertia_in(self.frame, self.about)))
        error -= self._wanted
        jacobian = self._selection.dot(snapshot.inertia_jacobian_in(self.frame, self.about))
        if self.second_order:
            curvature = self._curvature(snapshot, self._cost_gradient(error))
            return Residual(error, jacobian, self._bias, curvature)
        bound = partial(self._curvature_bound, snapshot, error)
        return Residual(error, jacobian, self._bias, curvature_bound=bound)

    def native(self) -> tuple[NativeRows, ...] | None:
        """Return the rows about the CoM in axes of the world or the base."""
        if self.frame not in (WORLD, BASE) or self.about != COM:
            return None
        frame = None if self.frame == WORLD else BASE
        rates, numbers = (self._bias, self._drift), (self._factors, self._wanted)
        moving = "_bias", "_drift", "", "_wanted"
        return (NativeRows(Kind.INERTIA, frame, self._entries, *rates, numbers, moving=moving),)

    @property
    def reported_rows(self) -> tuple[str, ...]:
        """Entries of the matrix, those that stand twice in it times sqrt(2)."""
        return tuple(f"sqrt(2) {row}" if row in OFF_DIAGONAL else row for row in self.rows)

    @property
    def units(self) -> tuple[str, ...]:
        """Of inertia, or of inertia by mass."""
        return ("m^2" if self.per_mass else "kg m^2",) * len(self.rows)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return the second derivative of the selected entries at v' = 0, less the target's."""
        check_sizes(self, self.robot, snapshot)
        drift = self._selection.dot(snapshot.inertia_drift_in(self.frame, self.about))
        drift += self._drift
        return drift

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the selected entries of actual minus target inertia."""
        # The trace is the same in all axes; in the base's it is an expression of the joints alone.
        frame = BASE if self.rows == TRACE else self.frame
        target = vech_inverse(self.target)
        return posture.inertia_error(self._selection, target, frame, self.about)

    def _cost_gradient(self, error: Array) -> Array:
        """Return the cost's slope (6,) by the entries of the inertia."""
        return self._gradient(error).dot(self._selection)

    def _curvature(self, snapshot: Snapshot, gradient: Array) -> Array:
        """Return the second derivative of <G, I>, G the cost's derivative by the inertia, fixed."""
        G = vech_inverse(gradient * _HALF_OFF_DIAGONAL)
        if self.frame == WORLD:
            return snapshot.inertia_hessian(G, self.about)
        S = snapshot.rotation(self.frame).T @ snapshot.rotation(BASE)
        return snapshot.base_inertia_hessian(S.T @ G @ S, self.about)

    def _curvature_bound(self, snapshot: Snapshot, error: Array) -> Array:
        """Return numbers (nv,) that make a diagonal matrix above the curvature."""
        gradient = self._cost_gradient(error)
        bound: Array = np.add.reduce(np.abs(self._curvature(snapshot, gradient)), axis=0)
        fixed = self.about == WORLD or not isinstance(self.about, str)
        if self.frame != WORLD and (self.frame != BASE or fixed):  # its turning is not in it
            bound += curvature_bound(gradient, snapshot.inertia_in(WORLD, self.about))
        return bound

    def _point(self, about: str | ArrayLike) -> str | tuple[float, ...]:
        """Return the point that the inertia is about, checked: a word, or three numbers."""
        if not isinstance(about, str):
            return tuple(finite_array(f"{self}, about", about, (3,)).tolist())
        if about not in (COM, WORLD):
            self.robot.frame_id(about)
        return about


def curvature_bound(gradient: Array, inertia: Array) -> float:
    """Return an estimate of the norm of the Hessian of ``gradient @ vech(I)`` by the joints.

    Second derivatives of the inertia are second moments of subtrees, at most tr(I) or so.
    """
    return math.sqrt(gradient.dot(gradient)) * float(inertia[0, 0] + inertia[1, 1] + inertia[2, 2])


def _selection(components: Sequence[str]) -> Array:
    """Return the (k, 6) matrix from vech of the inertia to the rows of the task."""
    if tuple(components) == TRACE:
        return _TRACE_ROW
    for component in components:
        if component not in COMPONENTS:
            raise UnknownNameError("inertia component", component, COMPONENTS + TRACE)
    return FROBENIUS_ROWS[[COMPONENTS.index(component) for component in components]]


def _is_symmetric(full: Array) -> bool:
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = full.tolist()
    largest = max(map(abs, (xx, xy, xz, yx, yy, yz, zx, zy, zz)))
    return max(abs(xy - yx), abs(xz - zx), abs(yz - zy)) <= 1e-9 * largest


def vech_target(what: str, value: ArrayLike, components: Sequence[str]) -> Array:
    """Return a wanted inertia, given in any accepted form, as (6,) entries [kg m^2]."""
    value = real_array(what, value)
    shape = value.shape
    if shape == (3, 3):
        full = finite_array(what, value, (3, 3))
        if not _is_symmetric(full):
            raise InvalidInputError(f"{what}: an inertia matrix is symmetric, this one is not")
        return vech(full)
    if shape == (6,):
        return finite_array(what, value, (6,))
    entries = np.zeros(6)
    if shape == (3,) and set(components) <= {*DIAGONAL_COMPONENTS, *TRACE}:
        entries[DIAGONAL] = finite_array(what, value, (3,))
        return entries
    if shape == () and tuple(components) == TRACE:
        entries[DIAGONAL] = float(finite_array(what, value, ())) / 3.0
        return entries
    raise InvalidInputError(
        f"{what}: expected a symmetric (3, 3) matrix or 6 entries xx xy xz yy yz zz (or the 3 "
        f"diagonal entries or the trace if only those are controlled), got shape {shape}"
    )
