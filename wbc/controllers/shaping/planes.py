"""Planes between bodies: rows that keep them apart, with derivatives of every order.

Two convex bodies are at least r apart if and only if some n, |n| <= 1, and d have

    n . a - d >= r_a  for every corner a of one,   d - n . b >= r_b  for every corner b of the other

where r_a + r_b is r and their rounding radii (separating hyperplane; Boyd and Vandenberghe, Convex
Optimization, 2.5.1). With n and d as unknowns of the NLP nothing has a kink, where the distance
itself has one wherever nearest points jump, and none where bodies touch or overlap.

Corners move with joints: a = R v + p. So a row is a sum of ``coefficient * T[t] * y[u]``, with T
all placements and y all n, d: its derivatives are written down instead of derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from wbc.constraints.rows import Index
from wbc.validate import Array

UNKNOWNS = 4  # of a plane: n, d
ENTRIES = 12  # of a placement, by columns: R, p


class Side(NamedTuple):
    """A body on one side of a plane.

    Attributes
    ----------
    block:
        Which placement is that of its joint.
    corners:
        (k, 3) in that joint's frame [m].
    away:
        How far the corners are to be from the plane [m].
    """

    block: int
    corners: Array
    away: float


class Slot(NamedTuple):
    """Two bodies with a plane between them.

    Attributes
    ----------
    normal:
        If the second body is a half-space, its normal (3,), which the plane's then is.
    """

    first: Side
    second: Side
    normal: Array | None


class PlaneRows(NamedTuple):
    """Rows as functions of placements T and planes y, with (a, b) the derivative of a by b.

    Attributes
    ----------
    value:
        (T, y) -> rows.
    slopes:
        (T, y) -> (rows, T), (rows, y).
    curvature:
        (T, y, multipliers) -> force on T (T, 1), (force, y), and the upper triangle of (y, y).
    lower, upper:
        Bounds on the rows.
    """

    value: ca.Function
    slopes: ca.Function
    curvature: ca.Function
    lower: Array
    upper: Array


class _Terms(NamedTuple):
    """Terms ``coefficient * T[t] * y[u]`` of rows; T and y have a 1 behind their last entries."""

    row: Index
    t: Index
    u: Index
    coefficient: Array


def plane_rows(slots: Sequence[Slot], size: int) -> PlaneRows:
    """Return the rows of ``slots``, with ``size`` entries in T."""
    planes = UNKNOWNS * len(slots)
    terms, bounds, units = _collected(slots, size)
    count = len(bounds)
    T, y, m = ca.MX.sym("T", size), ca.MX.sym("y", planes), ca.MX.sym("m", count)
    at_t = ca.vertcat(T, 1.0)[terms.t.tolist()]
    at_u = ca.vertcat(y, 1.0)[terms.u.tolist()]
    c = ca.DM(terms.coefficient)
    # |n|^2 of each plane that has a length to keep.
    places = (UNKNOWNS * units[:, 1:] + np.arange(3)).ravel()
    squares = np.repeat(units[:, 0], 3)
    n = y[places.tolist()]
    value = _gathered(terms.row, c * at_t * at_u, count) + _gathered(squares, n**2, count)
    by_t = _matrix(terms.row, terms.t, c * at_u, (count, size))
    by_y = _matrix(terms.row, terms.u, c * at_t, (count, planes))
    by_y += _matrix(squares, places, 2.0 * n, (count, planes))
    force = ca.mtimes(by_t.T, m)
    pulled = c * m[terms.row.tolist()]
    cross = _matrix(terms.t, terms.u, pulled, (size, planes))
    own = _matrix(places, places, 2.0 * m[squares.tolist()], (planes, planes))
    return PlaneRows(
        ca.Function("rows", [T, y], [value]),
        ca.Function("slopes", [T, y], [by_t, by_y]),
        ca.Function("curvature", [T, y, m], [force, cross, own]),
        bounds[:, 0],
        bounds[:, 1],
    )


def _collected(slots: Sequence[Slot], size: int) -> tuple[_Terms, Array, Index]:
    """Return the terms, the rows' bounds (k, 2), and the rows of |n|^2 with their slots (m, 2)."""
    one_t, one_u = size, UNKNOWNS * len(slots)  # where the 1 is
    found: list[tuple[int, int, int, float]] = []
    bounds: list[tuple[float, float]] = []
    units: list[tuple[int, int]] = []
    for k, slot in enumerate(slots):
        y = UNKNOWNS * k
        for side, sign in ((slot.first, 1.0), (slot.second, -1.0)):
            for corner in side.corners:
                row = len(bounds)
                for column, h in enumerate((*corner, 1.0)):
                    t = ENTRIES * side.block + 3 * column
                    found += [(row, t + i, y + i, sign * h) for i in range(3)]
                found.append((row, one_t, y + 3, -sign))
                bounds.append((side.away, np.inf))
        if slot.normal is None:
            units.append((len(bounds), k))
            bounds.append((-np.inf, 1.0))
            continue
        for i in range(3):  # n is the half-space's normal, turned as its joint is
            row, t = len(bounds), ENTRIES * slot.second.block + i
            found += [(row, t + 3 * column, one_u, -h) for column, h in enumerate(slot.normal)]
            found.append((row, one_t, y + i, 1.0))
            bounds.append((0.0, 0.0))
    row_of, t_of, u_of, coefficient = (np.array(part) for part in zip(*found, strict=True))
    terms = _Terms(row_of, t_of, u_of, coefficient)
    return terms, np.array(bounds), np.array(units, dtype=np.int64).reshape(-1, 2)


def _gathered(places: Index, values: ca.MX, size: int) -> ca.MX:
    """Return the vector (size, 1) of sums of values by place."""
    count = len(places)
    add = ca.DM.triplet(places.tolist(), list(range(count)), ca.DM.ones(count), size, count)
    return ca.mtimes(add, values)


def _matrix(row: Index, column: Index, values: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """Return the sparse matrix of values at places, sums where places are the same.

    Places outside are left out: those are factors 1.
    """
    inside = np.flatnonzero((row < shape[0]) & (column < shape[1]))
    if not inside.size:
        return ca.MX(*shape)
    keys, order = np.unique(column[inside] * shape[0] + row[inside], return_inverse=True)
    pattern = ca.Sparsity.triplet(
        *shape, (keys % shape[0]).tolist(), (keys // shape[0]).tolist()
    )  # by columns, as CasADi stores it
    return ca.MX(pattern, _gathered(order, values[inside.tolist()], keys.size))
