"""Checks on the return values of users' constraints in each tick: shapes, types, finite numbers.

The package's own constraints are not checked.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from wbc.constraints.rows import Bounds, Constraint, Distances
from wbc.errors import InvalidInputError, shown
from wbc.laws import Rows
from wbc.robot import Snapshot
from wbc.validate import Array, answer_of, real_array, returned_array

FAR = 1e9  # m: clearances beyond it are as good as infinite, and can be subtracted


def bounds_of(constraint: Constraint, snapshot: Snapshot, dt: float, braked: bool) -> Bounds:
    """Return the rows of a constraint; ``braked``: those for the torque level.

    Raises InvalidInputError: a user's constraint returns something else, or shapes that do not
    match its labels and the robot's nv; the message names constraint and field.
    """
    method = "braked_rows" if braked else "rows"
    found: Bounds = answer_of(constraint, method, getattr(constraint, method), snapshot, dt)
    return found if constraint._tested else _checked(constraint, method, found)


def cutting_planes_of(
    constraint: Constraint, there: Snapshot, v: Array, dt: float, rows: Bounds
) -> Bounds | None:
    """Return the cutting planes at the end of a step by ``v``, or None; see :class:`Constraint`."""
    planes = constraint.cutting_planes
    found: Bounds | None = answer_of(constraint, "cutting_planes", planes, there, v, dt, rows)
    if constraint._tested or found is None:
        return found
    return _checked(constraint, "cutting_planes", found)


def check_rows(constraint: Constraint, snapshot: Snapshot, dt: float) -> None:
    """Evaluate a constraint again and check its rows.

    Raises InvalidInputError: as :func:`bounds_of` does; also of constraints of this package.
    """
    _checked(constraint, "rows", answer_of(constraint, "rows", constraint.rows, snapshot, dt))


def distances_of(constraint: Constraint, found: object) -> Distances:
    """Return what a margin's ``distances()`` returned, in arrays of its own if it is a user's.

    Those may be filled anew at the end of the step. Clearances may be infinite: nothing is near.
    """
    if constraint._tested:
        return cast(Distances, found)
    nv, what = constraint.robot.nv, f"{constraint}: distances()"
    if not isinstance(found, Distances):
        raise InvalidInputError(
            f"{what} must return Distances with keys (m,), clearance (m,), jacobian (m, {nv}) and"
            f" rate (m,) or None; got {shown(found)}"
        )
    keys = np.asarray(found.keys)
    whole = keys.dtype.kind in "iu" or not keys.size
    if keys.ndim != 1 or not whole or (np.diff(keys) <= 0).any():
        raise InvalidInputError(
            f"{what}, keys: expected increasing whole numbers (m,), got {shown(found.keys)}"
        )
    m, rate = keys.size, found.rate
    clearance = np.minimum(_ends(f"{what}, clearance", found.clearance, m), FAR)
    return found._replace(
        keys=keys.astype(np.int64),
        clearance=returned_array(f"{what}, clearance", clearance, (m,)),
        jacobian=returned_array(f"{what}, jacobian", found.jacobian, (m, nv)),
        rate=None if rate is None else returned_array(f"{what}, rate", rate, (m,)),
    )


def curvature_of(constraint: Constraint, bound: object, m: int) -> Array:
    """Return what a margin's ``curvature_bound()`` returned; a user's are checked.

    With NaN or less than 0 in it, look-ahead would be left out.
    """
    if constraint._tested:
        return cast(Array, bound)
    what = f"{constraint}: curvature_bound()"
    numbers = real_array(what, bound)
    if numbers.shape not in ((m,), ()) or not (numbers >= 0.0).all():
        raise InvalidInputError(
            f"{what}: expected ({m},) numbers of at least 0, got {shown(bound)}"
        )
    return numbers


def _checked(constraint: Constraint, method: str, found: object) -> Bounds:
    """Return rows with all fields checked, and converted to arrays."""
    nv = constraint.robot.nv
    what = f"{constraint}: {method}()"
    if not isinstance(found, Bounds):
        raise InvalidInputError(
            f"{what} must return Bounds with labels, matrix (m, {nv}), lower (m,) and upper (m,);"
            f" got {shown(found)}"
        )
    labels, matrix, lower, upper, push, distances, slack = found
    if not isinstance(labels, tuple | list) or not all(isinstance(name, str) for name in labels):
        raise InvalidInputError(f"{what}, labels: expected a tuple of words, got {shown(labels)}")
    labels, m = tuple(labels), len(labels)
    matrix = returned_array(f"{what}, matrix", matrix, (m, nv))
    lower, upper = _ends(f"{what}, lower", lower, m), _ends(f"{what}, upper", upper, m)
    for k in np.flatnonzero(lower > upper)[:1]:
        raise InvalidInputError(
            f"{what}: lower is above upper in row {labels[k]!r}; nothing is allowed"
        )
    for k in np.flatnonzero((lower == np.inf) | (upper == -np.inf))[:1]:
        raise InvalidInputError(
            f"{what}: row {labels[k]!r} must lie between {lower[k]:g} and {upper[k]:g}, which no"
            " number does"
        )
    if slack is not None:
        slack = _ends(f"{what}, slack", slack, m)
        if (slack <= 0.0).any():
            raise InvalidInputError(f"{what}, slack: weights must be positive, got {shown(slack)}")
    for name, part, kind in (("push", push, Rows), ("distances", distances, Distances)):
        if part is not None and not isinstance(part, kind):
            raise InvalidInputError(
                f"{what}, {name}: expected {kind.__name__} or None, got {shown(part)}"
            )
    if push is not None:
        push = _push(what, push, nv)
    return Bounds(labels, matrix, lower, upper, push, distances, slack)


def _ends(what: str, given: Any, m: int) -> Array:
    """Return (m,) numbers, infinity allowed."""
    numbers = real_array(what, given)
    if numbers.shape != (m,):
        raise InvalidInputError(f"{what}: expected shape ({m},), got {numbers.shape}")
    for k in np.flatnonzero(np.isnan(numbers))[:1]:
        raise InvalidInputError(f"{what}: NaN in row {k}")
    return numbers


def _push(what: str, push: Rows, nv: int) -> Rows:
    """Return the rows of a dominating cost, (p, nv), target and weight (p,)."""
    p, bias = len(np.atleast_1d(push.target)), push.bias
    return push._replace(
        matrix=returned_array(f"{what}, push, matrix", push.matrix, (p, nv)),
        target=returned_array(f"{what}, push, target", push.target, (p,)),
        weight=returned_array(f"{what}, push, weight", push.weight, (p,)),
        bias=None if bias is None else returned_array(f"{what}, push, bias", bias, (p,)),
    )
