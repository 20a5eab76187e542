"""A program and planes between bodies, put together with their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from wbc.controllers.shaping.planes import PlaneRows
from wbc.controllers.shaping.program import Program


class Pieces(NamedTuple):
    """The parts of a program with their derivatives, as functions of x and p.

    Attributes
    ----------
    values:
        -> f, g, T.
    slopes:
        -> f, its gradient, g, its derivative, T, its derivative.
    curvature:
        (x, p, factor on f, multipliers of g, force on T) -> upper triangle of the second derivative
        of their sum.
    """

    values: ca.Function
    slopes: ca.Function
    curvature: ca.Function

    @classmethod
    def of(cls, program: Program, placements: ca.Function) -> Pieces:
        """Return the pieces of a program whose bodies' placements are given."""
        x = ca.SX.sym("x", program.lower.size)
        p = ca.SX.sym("p", program.functions.size1_in(1))
        f, g = program.functions(x, p)
        T = placements(x, p)
        factor, m = ca.SX.sym("factor"), ca.SX.sym("m", g.numel())
        force = ca.SX.sym("force", T.numel())
        total = factor * f + ca.dot(m, g) + ca.dot(force, T)
        return cls(
            ca.Function("values", [x, p], [f, g, T]),
            ca.Function(
                "slopes", [x, p], [f, ca.gradient(f, x), g, ca.jacobian(g, x), T, ca.jacobian(T, x)]
            ),
            ca.Function("bends", [x, p, factor, m, force], [ca.triu(ca.hessian(total, x)[0])]),
        )


def joined(pieces: Pieces, planes: PlaneRows) -> tuple[dict[str, ca.MX], dict[str, ca.Function]]:
    """Return a program with planes in CasADi's terms, unknowns x then y, and its derivatives.

    The derivatives are put together of those of the parts. Left to CasADi they take four times as
    long to evaluate; as one expression, a second to set up.
    """
    n, size = pieces.values.size1_in(0), planes.value.size1_in(1)
    rows = pieces.values.size1_out(1)
    z, p = ca.MX.sym("z", n + size), ca.MX.sym("p", pieces.values.size1_in(1))
    x, y = z[:n], z[n:]
    f, g, T = pieces.values(x, p)
    both = ca.vertcat(g, planes.value(T, y))
    _, f_x, _, g_x, _, T_x = pieces.slopes(x, p)
    by_t, by_y = planes.slopes(T, y)
    slope = ca.blockcat([[g_x, ca.MX(rows, size)], [ca.mtimes(by_t, T_x), by_y]])
    factor, m = ca.MX.sym("factor"), ca.MX.sym("m", both.numel())
    force, cross, own = planes.curvature(T, y, m[rows:])
    bent = pieces.curvature(x, p, factor, m[:rows], force)
    hessian = ca.blockcat([[bent, ca.mtimes(T_x.T, cross)], [ca.MX(size, n), own]])
    gradient = ca.vertcat(f_x, ca.MX.zeros(size))  # CasADi reads it as dense
    given = ["x", "p", "lam_f", "lam_g"]
    derivatives = {
        "grad_f": ca.Function("grad_f", [z, p], [f, gradient], given[:2], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [z, p], [both, slope], given[:2], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag", [z, p, factor, m], [hessian], given, ["hess_gamma_x_x"]
        ),
    }
    return {"x": z, "p": p, "f": f, "g": both}, derivatives
