"""The constraints of the NLP besides the unknowns' bounds: contacts, CoM supports and boxes.

Bodies are kept apart by rows that are there only while they are needed: see :mod:`.apart`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.constraints import ComSupport, PositionBox
from wbc.constraints.clearance import SKIN
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.robot.symbolic import SymbolicPosture
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Rows ``lower <= value <= upper``.

    Attributes
    ----------
    value:
        (k, 1) SX.
    lower, upper:
        (k,).
    closures:
        How many rows, the first ones, are contacts: equalities with 0.
    """

    value: ca.SX
    lower: Array
    upper: Array
    closures: int


def constraint_rows(problem: ShapingProblem, posture: SymbolicPosture) -> ConstraintRows:
    """Return the rows of a problem; the anchor is kept by construction and has none."""
    closure = ca.vertcat(
        *(
            contact.symbolic_error(posture)
            for contact in problem.contacts
            if contact is not problem.anchor
        )
    )
    closures = closure.numel()
    values = [ca.SX(closure)]
    lower: list[Array] = [np.zeros(closures)]
    upper: list[Array] = [np.zeros(closures)]
    for one in problem.constraints:
        if isinstance(one, ComSupport):
            planes = half_planes(one.corners)
            values.append(ca.mtimes(ca.DM(planes[:, :2]), posture.com[:2]))
            lower.append(np.full(len(planes), -np.inf))
            upper.append(planes[:, 2] - one.margin - SKIN)
        elif isinstance(one, PositionBox):
            used = np.flatnonzero(np.isfinite(one.lower) | np.isfinite(one.upper))
            values.append(posture.position(one.frame)[used.tolist()])
            lower.append(one.lower[used] + SKIN)
            upper.append(one.upper[used] - SKIN)
    return ConstraintRows(
        ca.vertcat(*values), np.concatenate(lower), np.concatenate(upper), closures
    )


def half_planes(corners: Array) -> Array:
    """Return the half-planes (k, 3) of a polygon (k, 2), counter-clockwise.

    Rows (n_x, n_y, d), n outwards: inside, n . x <= d.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack((edges[:, 1], -edges[:, 0]))
    normals = normals / np.linalg.norm(edges, axis=1)[:, None]
    return np.column_stack((normals, np.einsum("ij,ij->i", normals, corners)))
