"""The constraints of the NLP besides the box: contacts, support and capsules, by name."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.constraints import PointContact
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.robot.symbolic import SymbolicPosture, rotation_log
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
            _closure(posture, contact.frame, contact.position, contact.rotation)
            if not isinstance(contact, PointContact)
            else posture.position(contact.frame) - ca.DM(contact.position)
            for contact in problem.contacts
            if contact is not problem.anchor
        )
    )
    closures = closure.numel()
    values = [ca.SX(closure)]
    lower: list[Array] = [np.zeros(closures)]
    upper: list[Array] = [np.zeros(closures)]
    if problem.support is not None:
        normals, reach = problem.support[:, :2], problem.support[:, 2]
        values.append(ca.mtimes(ca.DM(normals), posture.com[:2]))
        lower.append(np.full(reach.size, -np.inf))
        upper.append(reach)
    if problem.capsules:
        excess = [pair.symbolic_excess(posture) for pair in problem.capsules]
        values.append(ca.vertcat(*excess))
        lower.append(np.zeros(len(excess)))
        upper.append(np.full(len(excess), np.inf))
    return ConstraintRows(
        ca.vertcat(*values), np.concatenate(lower), np.concatenate(upper), closures
    )


def _closure(posture: SymbolicPosture, frame: str, position: Array, rotation: Array) -> ca.SX:
    """Return how far a frame is from its anchor (6, 1), [m] above [rad]."""
    relative = ca.mtimes(ca.DM(rotation).T, posture.rotation(frame))
    return ca.vertcat(posture.position(frame) - ca.DM(position), rotation_log(relative))
