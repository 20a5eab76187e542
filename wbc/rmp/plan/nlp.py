"""A nonlinear programme made of many small alike pieces, with exact derivatives, for IPOPT.

Each block is one small function of few variables and the places of its copies among all variables.
Its gradient, Jacobian and Hessian are derived once, symbolically, and added up into sparse ones:
no graph of the whole programme is ever differentiated, which is what makes a cold start quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from wbc.validate import Array

Indices = NDArray[np.int64]


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
class Nlp:
    """min f(w) subject to bounds on g(w); all Functions of (w, p), p empty, as IPOPT wants them."""

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
        given = {
            "grad_f": ca.Function(
                "plan_gradient", [self.w, p], [self.f, self.gradient], ["x", "p"], ["f", "grad_f_x"]
            ),
            "jac_g": ca.Function(
                "plan_jacobian", [self.w, p], [self.g, self.jacobian], ["x", "p"], ["g", "jac_g_x"]
            ),
            "hess_lag": ca.Function(
                "plan_hessian",
                [self.w, p, self.weight, self.multipliers],
                [self.hessian],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
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


def assemble(count: int, blocks: Sequence[Block], linear: sparse.csr_array) -> Nlp:
    """Return the programme in ``count`` variables: the blocks' rows in order, then linear ones."""
    w, weight = ca.MX.sym("w", count), ca.MX.sym("weight")
    rows = [b.piece.value.size1_out(1) * b.places.shape[1] for b in blocks]
    firsts = np.concatenate(([0], np.cumsum(rows, dtype=int)))
    multipliers = ca.MX.sym("multipliers", int(firsts[-1]) + linear.shape[0])
    f, g = ca.MX(0), []
    gradients, jacobians, hessians = [], [], []
    for block, first in zip(blocks, firsts, strict=False):
        nz, copies = block.places.shape
        z = ca.reshape(w[block.places.ravel(order="F").tolist()], nz, copies)
        cost, values = block.piece.value.map(copies)(z)
        f += ca.sum2(cost)
        g.append(ca.vec(values))
        slope = block.piece.gradient.map(copies)(z)
        spread = (block.places.ravel(order="F"), np.zeros(nz * copies, dtype=int))
        gradients.append((*spread, ca.vec(slope)))
        m = block.piece.value.size1_out(1)
        steep = block.piece.jacobian.map(copies)(z)
        jacobians.append((*_jacobian_places(block, int(first), m), _nonzeros(steep)))
        lam = ca.reshape(multipliers[int(first) : int(first) + m * copies], m, copies)
        bend = block.piece.hessian.map(copies)(z, ca.repmat(weight, 1, copies), lam)
        hessians.append((*_hessian_places(block), _nonzeros(bend)))
    constant = linear.tocoo()
    jacobians.append((constant.row + int(firsts[-1]), constant.col, ca.MX(ca.DM(constant.data))))
    return Nlp(
        w=w,
        f=f,
        g=ca.vertcat(*g, ca.mtimes(_dm(linear), w)),
        gradient=ca.densify(_summed(gradients, (count, 1))),
        jacobian=_summed(jacobians, (multipliers.numel(), count)),
        weight=weight,
        multipliers=multipliers,
        hessian=_summed(hessians, (count, count), upper=True),
    )


def elastic(nlp: Nlp, rows: Indices, price: float) -> Nlp:
    """Return the programme that may break some rows, at a price: for finding what is in the way.

    One free variable e a row is added, to it, for price * e^2. Squares, not sizes, because they
    regularise the very rows that contradict each other; sizes took IPOPT ten times as long.
    """
    count, slack = nlp.w.numel(), len(rows)
    w = ca.MX.sym("w", count + slack)
    shape = (nlp.g.numel(), slack)
    E = _dm(sparse.csr_array((np.ones(slack), (rows, np.arange(slack))), shape=shape))
    inputs, outputs = [nlp.w], [nlp.f, nlp.g, nlp.gradient, nlp.jacobian]
    f, g, gradient, jacobian = ca.Function("rigid", inputs, outputs)(w[:count])
    inputs += [nlp.weight, nlp.multipliers]
    bend = ca.Function("bend", inputs, [nlp.hessian])(w[:count], nlp.weight, nlp.multipliers)
    spent = w[count:]
    return Nlp(
        w=w,
        f=f + price * ca.sumsqr(spent),
        g=g + E @ spent,
        gradient=ca.vertcat(gradient, 2.0 * price * spent),
        jacobian=ca.horzcat(jacobian, E),
        weight=nlp.weight,
        multipliers=nlp.multipliers,
        hessian=ca.diagcat(bend, 2.0 * price * nlp.weight * ca.MX(ca.DM.eye(slack))),
    )


def _nonzeros(mapped: ca.MX) -> ca.MX:
    return ca.vertcat(*[mapped.nz[:]]) if mapped.nnz() else ca.MX(0, 1)


def _jacobian_places(block: Block, first: int, m: int) -> tuple[Indices, Indices]:
    """Return rows and columns, in all, of a block's nonzeros: copy after copy, by columns."""
    row, column = (np.array(x) for x in block.piece.jacobian.sparsity_out(0).get_triplet())
    copies = np.arange(block.places.shape[1])
    rows = first + row[:, None] + m * copies
    return rows.ravel(order="F"), block.places[column].ravel(order="F")


def _hessian_places(block: Block) -> tuple[Indices, Indices]:
    row, column = (np.array(x) for x in block.piece.hessian.sparsity_out(0).get_triplet())
    return block.places[row].ravel(order="F"), block.places[column].ravel(order="F")


def _summed(
    parts: Sequence[tuple[Indices, Indices, ca.MX]], shape: tuple[int, int], upper: bool = False
) -> ca.MX:
    """Return the sparse matrix of all entries, those in one place added; or its upper triangle."""
    rows = np.concatenate([part[0] for part in parts])
    columns = np.concatenate([part[1] for part in parts])
    entries = ca.vertcat(*(part[2] for part in parts))
    kept = np.flatnonzero(rows <= columns) if upper else np.arange(len(rows))
    flat, where = np.unique(columns[kept] * shape[0] + rows[kept], return_inverse=True)
    gather = sparse.csr_array((np.ones(len(kept)), (where, kept)), shape=(len(flat), len(rows)))
    pattern = ca.Sparsity.triplet(*shape, (flat % shape[0]).tolist(), (flat // shape[0]).tolist())
    return ca.MX(pattern, ca.mtimes(_dm(gather), entries))


def _dm(matrix: sparse.csr_array) -> ca.DM:
    coo = matrix.tocoo()
    rows, columns = coo.shape
    pattern = ca.Sparsity.triplet(rows, columns, coo.row.tolist(), coo.col.tolist())
    order = np.lexsort((coo.row, coo.col))
    return ca.DM(pattern, coo.data[order].tolist())


def values_of(w: ca.DM) -> Array:
    """Return a column of CasADi's as an array (n,)."""
    flat: Array = w.full().ravel()
    return flat
