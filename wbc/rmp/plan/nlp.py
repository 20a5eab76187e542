"""Sparse nonlinear programme from repeated small blocks, with exact derivatives, for IPOPT.

Each block is one small function of few variables and the places of its copies among all variables.
Its gradient, Jacobian and Hessian are derived once, symbolically, and scattered into sparse ones:
no graph of the whole programme is ever differentiated, which makes a cold start fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from wbc.rmp.plan.layout import Indices
from wbc.sparse import matrix_of

# Rows, columns and values of entries of a sparse matrix, in one order.
_Entry = tuple[Indices, Indices, ca.MX]


@dataclass(frozen=True, eq=False)
class Piece:
    """Cost and rows of one block, as functions of its own variables."""

    value: ca.Function  # z -> cost, rows
    gradient: ca.Function  # z -> d cost/dz
    jacobian: ca.Function  # z -> d rows/dz
    hessian: ca.Function  # z, weight of cost, multipliers -> both triangles


@dataclass(frozen=True, eq=False)
class Block:
    """Copies of a piece: column c of ``places`` (nz, copies) holds the variables of copy c."""

    piece: Piece
    places: Indices


@dataclass(frozen=True, eq=False)
class PlanNlp:
    """min f(w) subject to bounds on g(w); all Functions of (w, p), p empty, as IPOPT expects."""

    w: ca.MX
    f: ca.MX
    g: ca.MX
    gradient: ca.MX
    jacobian: ca.MX
    weight: ca.MX
    multipliers: ca.MX
    hessian: ca.MX

    def solver(self, options: dict[str, Any]) -> ca.Function:
        """Return CasADi's NLP solver with IPOPT and these derivatives."""
        p = ca.MX.sym("p", 0)
        at, names = [self.w, p], ["x", "p"]
        f, g = [self.f, self.gradient], [self.g, self.jacobian]
        dual, dual_names = [*at, self.weight, self.multipliers], [*names, "lam_f", "lam_g"]
        given = {
            "grad_f": ca.Function("gradient", at, f, names, ["f", "grad_f_x"]),
            "jac_g": ca.Function("jacobian", at, g, names, ["g", "jac_g_x"]),
            "hess_lag": ca.Function(
                "hessian", dual, [self.hessian], dual_names, ["triu_hess_gamma_x_x"]
            ),
        }
        problem = {"x": self.w, "p": p, "f": self.f, "g": self.g}
        return ca.nlpsol("plan", "ipopt", problem, options | given)


def piece(name: str, z: ca.SX, cost: ca.SX, rows: ca.SX) -> Piece:
    """Return a piece with its derivatives."""
    weight, multipliers = ca.SX.sym("weight"), ca.SX.sym("multipliers", rows.numel())
    hessian, _ = ca.hessian(weight * cost + ca.dot(multipliers, rows), z)
    return Piece(
        value=ca.Function(f"{name}_value", [z], [cost, ca.densify(rows)]),
        gradient=ca.Function(f"{name}_gradient", [z], [ca.densify(ca.gradient(cost, z))]),
        jacobian=ca.Function(f"{name}_jacobian", [z], [ca.jacobian(rows, z)]),
        hessian=ca.Function(f"{name}_hessian", [z, weight, multipliers], [hessian]),
    )


def assemble(count: int, blocks: Sequence[Block], linear: ca.DM) -> PlanNlp:
    """Return the programme in ``count`` variables: the blocks' rows in order, then linear ones.

    ``linear`` (rows, count) is their matrix.
    """
    w, weight = ca.MX.sym("w", count), ca.MX.sym("weight")
    rows = [b.piece.value.size1_out(1) * b.places.shape[1] for b in blocks]
    firsts = np.concatenate(([0], np.cumsum(rows, dtype=int))).tolist()
    multipliers = ca.MX.sym("multipliers", firsts[-1] + linear.shape[0])
    f, g = ca.MX(0), list[ca.MX]()
    gradients, jacobians, hessians = list[_Entry](), list[_Entry](), list[_Entry]()
    for block, first in zip(blocks, firsts, strict=False):
        of, places = block.piece, block.places
        nz, copies = places.shape
        m = of.value.size1_out(1)
        z = ca.reshape(w[places.ravel(order="F").tolist()], nz, copies)
        lam = ca.reshape(multipliers[first : first + m * copies], m, copies)
        cost, values = of.value.map(copies)(z)
        f += ca.sum2(cost)
        g.append(ca.vec(values))
        row, column = (np.array(x) for x in of.jacobian.sparsity_out(0).get_triplet())
        at = first + row[:, None] + m * np.arange(copies)
        zeros = np.zeros(places.shape, dtype=int)
        gradients.append((places, zeros, of.gradient.map(copies)(z)))
        jacobians.append((at, places[column], of.jacobian.map(copies)(z)))
        row, column = (np.array(x) for x in of.hessian.sparsity_out(0).get_triplet())
        hessian = of.hessian.map(copies)(z, ca.repmat(weight, 1, copies), lam)
        hessians.append((places[row], places[column], hessian))
    row, column = (np.array(x, dtype=int) for x in linear.sparsity().get_triplet())
    jacobians.append((firsts[-1] + row, column, ca.MX(linear)))
    return PlanNlp(
        w=w,
        f=f,
        g=ca.vertcat(*g, linear @ w),
        gradient=ca.densify(_matrix(gradients, (count, 1))),
        jacobian=_matrix(jacobians, (multipliers.numel(), count)),
        weight=weight,
        multipliers=multipliers,
        hessian=ca.triu(_matrix(hessians, (count, count))),
    )


def elastic(nlp: PlanNlp, rows: Indices, price: float) -> PlanNlp:
    """Return the programme with a slack e in some rows, for price * e^2: to find conflicting ones.

    Squares, not absolute values, because they regularise the very rows that contradict each other;
    absolute values took IPOPT ten times as long.
    """
    count, slack = nlp.w.numel(), len(rows)
    w = ca.MX.sym("w", count + slack)
    E = ca.DM.triplet(rows.tolist(), list(range(slack)), ca.DM.ones(slack), nlp.g.numel(), slack)
    outputs = [nlp.f, nlp.g, nlp.gradient, nlp.jacobian]
    f, g, gradient, jacobian = ca.Function("rigid", [nlp.w], outputs)(w[:count])
    inputs = [nlp.w, nlp.weight, nlp.multipliers]
    hessian = ca.Function("hessian", inputs, [nlp.hessian])(w[:count], *inputs[1:])
    e = w[count:]
    return PlanNlp(
        w=w,
        f=f + price * ca.sumsqr(e),
        g=g + E @ e,
        gradient=ca.vertcat(gradient, 2.0 * price * e),
        jacobian=ca.horzcat(jacobian, E),
        weight=nlp.weight,
        multipliers=nlp.multipliers,
        hessian=ca.diagcat(hessian, 2.0 * price * nlp.weight * ca.MX(ca.DM.eye(slack))),
    )


def _matrix(entries: Sequence[_Entry], shape: tuple[int, int]) -> ca.MX:
    """Return the sparse matrix of all entries; those at one index are added."""
    rows = np.concatenate([row.ravel(order="F") for row, _, _ in entries])
    columns = np.concatenate([column.ravel(order="F") for _, column, _ in entries])
    values = ca.vertcat(*(part[2].nz[:] for part in entries if part[2].nnz()))
    return matrix_of(rows, columns, values, shape)
