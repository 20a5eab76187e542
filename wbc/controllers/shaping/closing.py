"""Brings a posture onto the contacts before a search begins there."""

from __future__ import annotations

import casadi as ca
import numpy as np

from wbc.controllers.shaping.nlp import BuiltNlp, Start
from wbc.validate import Array

CLOSED = 1e-3  # m, rad: near enough to the contacts to begin from; IPOPT does the rest
NEWTON_STEPS = 40
LONGEST_STEP = 0.5  # rad


class Closing:
    """Brings unknowns onto the contacts by Gauss-Newton steps within the bounds."""

    def __init__(self, built: BuiltNlp) -> None:
        nlp = built.nlp
        x, p = ca.SX.sym("x", nlp.lower.size), ca.SX.sym("p", nlp.functions.size1_in(1))
        gap = nlp.functions(x, p)[1][: nlp.closures]
        self._gap = ca.Function("gap", [x, p], [gap, ca.jacobian(gap, x)])
        self._lower, self._upper = nlp.lower, nlp.upper

    def closed(self, start: Start) -> tuple[Start, float]:
        """Return the start on the contacts, and how far off them its worst row still is.

        Unknowns that a step takes beyond a bound are put on it and left out of the next step.
        """
        x, free = start.x, np.ones(start.x.size, dtype=bool)
        gap, slope = self._evaluate(x, start.p)
        for _ in range(NEWTON_STEPS):
            if np.abs(gap).max() < 0.01 * CLOSED:
                break
            step = np.zeros(x.size)
            step[free] = -np.linalg.lstsq(slope[:, free], gap, rcond=1e-6)[0]
            step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
            moved = np.clip(x + step, self._lower, self._upper)
            free = np.isclose(moved, x + step, rtol=0.0, atol=1e-12)
            x = moved
            gap, slope = self._evaluate(x, start.p)
        return start._replace(x=x), float(np.abs(gap).max())

    def _evaluate(self, x: Array, p: Array) -> tuple[Array, Array]:
        gap, slope = self._gap(x, p)
        return np.array(gap, dtype=float).ravel(), np.array(slope, dtype=float)
