"""How the composite-rigid-body (CRB) inertia changes with the joints: Jacobian, drift, Hessian.

All three follow from the composite inertias that Pinocchio keeps: a joint moves the bodies that it
carries as one (Jacobian: paper eqs. 24-27), and composites move with the joints before them
(Hessian, drift). Closed forms, exact for every joint, without a loop over the links.
"""

from __future__ import annotations

import numpy as np

from wbc.robot.workspace import CarriedColumns
from wbc.spatial import (
    COLUMNS,
    DIAGONAL,
    FROBENIUS_WEIGHTS,
    ROWS,
    commutator_matrix,
    skew,
    vech,
    vech_inverse,
)
from wbc.validate import Array


def _rates() -> Array:
    """Return (27, 6): from the products S_i w_j and u_i h_j to vech(tr(dS) 1 - dS)."""
    of_second = [commutator_matrix(vech_inverse(e)).T for e in np.eye(6)]  # (3, 6) each
    of_first = [vech(X + X.T) for X in np.eye(9).reshape(9, 3, 3)]
    to_inertia = -np.eye(6)
    to_inertia[np.ix_(DIAGONAL, DIAGONAL)] += 1.0
    return np.concatenate((*of_second, np.array(of_first))) @ to_inertia


_RATES = _rates()
# From Pinocchio's entries xx xy yy xz yz zz of an inertia I to vech of tr(I)/2 1 - I.
_SECOND_MOMENTS = -np.eye(6)[:, np.array([0, 1, 3, 2, 4, 5])]
_SECOND_MOMENTS[np.ix_(np.array([0, 2, 5]), DIAGONAL)] += 0.5


def inertia_rates(composites: Array, masses: Array, twists: Array, com: Array) -> Array:
    """Return the derivative of the centroidal inertia by v, world axes (paper eqs. 24-27).

    An entry of v moves the bodies that it carries as one: with their mass, first and second moment
    h, S about the robot's CoM, and the twist's angular part w and velocity u at that CoM,

        dS = [w] S - S [w] + u h' + h u',    dI = tr(dS) 1 - dS.

    Parameters
    ----------
    composites, masses:
        (nv, 9) and (nv,) as :class:`~wbc.robot.workspace.CompositeInertias` gives them.
    twists:
        (6, nv), the linear part that of the point at the world's origin.
    com:
        (3,) of the robot [m].

    Returns
    -------
    (6, nv) rows xx, xy, xz, yy, yz, zz [kg m^2 per unit of v].
    """
    arms = composites[:, :3] - com
    moments = masses[:, None] * arms
    second = composites[:, 3:] @ _SECOND_MOMENTS
    second += arms[:, ROWS] * moments[:, COLUMNS]
    angular = twists[3:]
    linear = twists[:3] - skew(com) @ angular
    products = np.empty((len(masses), 27))
    n = len(masses)
    np.multiply(second[:, :, None], angular.T[:, None], out=products[:, :18].reshape(n, 6, 3))
    np.multiply(linear.T[:, :, None], moments[:, None], out=products[:, 18:].reshape(n, 3, 3))
    return (products @ _RATES).T


def inertia_hessian(
    weights: Array,
    rates: Array,
    com_jacobian: Array,
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
        (6, nv) as :func:`inertia_rates` returns them.
    com_jacobian:
        (3, nv).
    twists:
        (6, nv), the linear part that of the point at the world's origin.
    mass:
        Of the robot [kg].
    orders:
        See :class:`~wbc.robot.workspace.CarriedColumns`.
    """
    K = _of_second_moments(weights)
    pulled = mass * (K @ com_jacobian)
    turned = (0.5 * FROBENIUS_WEIGHTS[:, None] * commutator_matrix(K)).T @ rates
    turned += skew(com) @ pulled
    carried = np.concatenate((pulled, turned)).T @ twists  # row j, column i
    carried *= orders
    second = carried + carried.T
    second -= 2.0 * (com_jacobian.T @ pulled)
    return second


def inertia_curvature(
    columns: CarriedColumns, composites: Array, masses: Array, twists: Array, com: Array, v: Array
) -> tuple[Array, Array]:
    """Return the first and second time derivative (3, 3) of the centroidal inertia at constant v.

    A body that moves by the twist W, as a 4x4 matrix, carries its pseudo-inertia
    P = integral of (x, 1)(x, 1)' dm along: P' = W P + P W'. Column k of v, with twist w_k v_k,
    moves all that it carries, P_k, so the robot's is

        P' = sum w_k P_k + (..)',   P'' = sum (w_k' P_k + w_k P_k') + (..)'
        w_k' = [W_k, w_k],          P_k' = W_k P_k + sum over columns below (w_j P_j) + (..)'

    with W_k the whole twist of the column's body. Sums over the columns below one, exchanged with
    that over the ones above, leave with V_k = W_k + (the twist of the body above k's)

        P'' = sum (V_k w_k P_k + w_k P_k V_k') + (..)'

    In axes through the robot's CoM; parameters as of :func:`inertia_rates`.
    """
    n, mass = len(masses), masses[0]
    arms = composites[:, :3] - com
    P = np.empty((n, 4, 4))
    P[:, :3, :3] = (composites[:, 3:] @ _SECOND_MOMENTS)[:, _MATRIX]
    P[:, :3, 3] = P[:, 3, :3] = masses[:, None] * arms
    P[:, :3, :3] += arms[:, :, None] * P[:, None, :3, 3]
    P[:, 3, 3] = masses
    angular = twists[3:] * v
    linear = twists[:3] * v - skew(com) @ angular
    w = (np.concatenate((linear, angular)).T @ _TWISTS).reshape(n, 4, 4)
    V = (columns.orders @ w.reshape(n, 16)).reshape(n, 4, 4)
    carried = w @ P
    first = np.add.reduce(carried)
    # Sums of products: one product of long matrices each.
    along, across = carried.transpose(1, 0, 2).reshape(4, -1), V.transpose(1, 0, 2).reshape(4, -1)
    second = across @ carried.reshape(-1, 4)
    second += along @ across.T
    velocity = first[:3, 3] / mass
    rate = first[:3, :3] + first[:3, :3].T
    curvature = second[:3, :3] + second[:3, :3].T
    curvature -= 2.0 * mass * velocity[:, None] * velocity
    return _of_second_moments(rate), _of_second_moments(curvature)


def _of_second_moments(S: Array) -> Array:
    """Return tr(S) 1 - S (3, 3)."""
    return float(S[0, 0] + S[1, 1] + S[2, 2]) * _ONE - S


# From vech to the (3, 3) matrix, and from a twist to its 4x4 matrix, flat (6, 16).
_MATRIX = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_ONE = np.eye(3)
_TWISTS = np.zeros((6, 16))
_TWISTS[np.arange(3), 4 * np.arange(3) + 3] = 1.0
_TWISTS.reshape(6, 4, 4)[3:, :3, :3] = [skew(axis) for axis in np.eye(3)]
