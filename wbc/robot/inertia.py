"""The second derivative of the composite-rigid-body (CRB) inertia by the joints: its Hessian.

It follows from the composite inertias: a joint moves the bodies that it carries as one (Jacobian:
paper eqs. 24-27, in the core), and composites move with the joints before them. A closed form,
exact for every joint, without a loop over the links.

With I = tr(S) 1 - S, S the second moment about the robot's CoM.
"""

from __future__ import annotations

import numpy as np

from wbc.spatial import FROBENIUS_WEIGHTS, commutator_matrix, skew
from wbc.validate import Array

_ONE = np.eye(3)
_BASIS = np.eye(9).reshape(9, 3, 3)
# From the entries of S, flat, to those of tr(S) 1 - S (9, 9).
_INERTIA = np.array([np.trace(X) * _ONE - X for X in _BASIS]).reshape(9, 9)
# From weights (3, 3), flat, to K = tr(G) 1 - G and to 1/2 of the commutator with K (9, 18), by
# which the inertia's change turns.
_TURNED = _INERTIA @ np.array(
    [(0.5 * FROBENIUS_WEIGHTS[:, None] * commutator_matrix(K)).T.ravel() for K in _BASIS]
)


def inertia_hessian(
    weights: Array,
    rates: Array,
    momenta: Array,
    twists: Array,
    com: Array,
    mass: float,
    orders: Array,
) -> Array:
    """Return the second derivative (nv, nv) of the sum of weights_ab I_ab by v, world axes.

    A column i of v that carries all that column j does moves the rate P_j of the pseudo-inertia,
    with S_j and h_j its second and first moments about the CoM, by [W_i] P_j + (..)', hence

        d2S / (dv_i dv_j) = [w_i] S_j + u_i h_j' - h_i h_j' / M + (..)'

    of which the last term is the CoM's own motion; it alone is left where neither carries the
    other. Rotations of the base do not commute: of both orders the mean is taken. The joints' part
    is a Hessian.

    Parameters
    ----------
    weights:
        (3, 3) symmetric.
    rates:
        (6, nv) d vech(I)/dv, world axes.
    momenta:
        (3, nv) linear momentum by v, mass times the CoM's Jacobian.
    twists:
        (6, nv), the linear part that of the point at the world's origin.
    mass:
        Of the robot [kg].
    orders:
        See :class:`~wbc.robot.workspace.CarriedColumns`.
    """
    flat = weights.ravel()
    pulls = np.empty((6, rates.shape[1]))  # linear, then angular about the world's origin
    pulled = np.dot(flat.dot(_INERTIA).reshape(3, 3), momenta, out=pulls[:3])
    pulls[3:] = flat.dot(_TURNED).reshape(3, 6).dot(rates)
    pulls[3:] += skew(com).dot(pulled)
    half = pulls.T.dot(twists)  # row j, column i
    half *= orders
    half -= (momenta / mass).T.dot(pulled)
    return half + half.T
