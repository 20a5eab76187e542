"""The constraints of the NLP besides the unknowns' bounds: contacts, CoM supports and boxes.

Bodies are kept apart by rows that are there only while they are needed: see :mod:`.apart`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.constraints.rows import SymbolicRows
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


def constraint_rows(
    problem: ShapingProblem, posture: SymbolicPosture, parts: Sequence[SymbolicRows]
) -> ConstraintRows:
    """Return the rows of contacts and constraints; the anchor is kept by construction."""
    closure = ca.vertcat(
        *(
            contact.symbolic_error(posture)
            for contact in problem.contacts
            if contact is not problem.anchor
        )
    )
    closures = closure.numel()
    still = np.zeros(closures)
    return ConstraintRows(
        ca.vertcat(closure, *(part.value for part in parts)),
        np.concatenate((still, *(part.lower for part in parts))),
        np.concatenate((still, *(part.upper for part in parts))),
        closures,
    )
