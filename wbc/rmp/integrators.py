"""Runge and Kutta's step through time, for both pendulums."""

from __future__ import annotations

import casadi as ca

from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.rmp.solid import SolidRmp
from wbc.validate import finite_number


def runge_kutta(model: ReactionMassPendulum, dt: float) -> ca.Function:
    """Return the classical explicit step of fourth order, a CasADi Function (x, u) -> x_next.

    x = (q, v); u = (CoP acceleration, generalised forces), constant through the step. Of SolidRmp's
    quaternion the norm is kept; of energy and momentum nothing.

    Raises InvalidInputError: ``dt`` is not positive.
    """
    dt = finite_number("dt", dt, above=0.0)
    x = ca.SX.sym("x", len(model.Q) + len(model.V))
    u = ca.SX.sym("u", len(model.V))
    rate = model.functions["state_rate"]
    k1 = rate(x, u)
    k2 = rate(x + dt / 2 * k1, u)
    k3 = rate(x + dt / 2 * k2, u)
    k4 = rate(x + dt * k3, u)
    after = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    if isinstance(model, SolidRmp):
        after[5:9] /= ca.norm_2(after[5:9])
    return ca.Function("runge_kutta", [x, u], [after], ["x", "u"], ["x_next"])
