"""How the composite-rigid-body (CRB) inertia changes with the joints: Jacobian, drift, Hessian.

All three follow from the composite inertias that Pinocchio keeps: a joint moves the bodies that it
carries as one (Jacobian: paper eqs. 24-27), and composites move with the joints before them
(Hessian, drift). Closed forms, exact for every joint, without a loop over the links.

With I = tr(S) 1 - S, S the second moment about the robot's CoM: an entry of v turns the bodies that
it carries at w and gives them a linear momentum p. With their second moment S_o about their own CoM
and the arm a from the robot's CoM to theirs, that changes S by

    C + C',    C = [w] S_o + p a'

What is bilinear in it is computed once (:func:`carried_moments`); constant matrices make the rest.
"""

from __future__ import annotations

import numpy as np

from wbc.spatial import FROBENIUS_WEIGHTS, commutator_matrix, skew, vech, vech_inverse
from wbc.validate import Array

_ONE = np.eye(3)
_BASIS = np.eye(9).reshape(9, 3, 3)
_TURNS: Array = np.array([skew(axis) for axis in _ONE])
# From the entries of S, flat, to those of tr(S) 1 - S (9, 9).
_INERTIA = np.array([np.trace(X) * _ONE - X for X in _BASIS]).reshape(9, 9)
# From Pinocchio's entries xx xy yy xz yz zz of an inertia I to tr(I)/2 1 - I (6, 3, 3).
_FULL = np.array([vech_inverse(e) for e in np.eye(6)])[[0, 1, 3, 2, 4, 5]]
_SECOND_MOMENTS = np.array([0.5 * np.trace(X) * _ONE - X for X in _FULL])
# From carried moments to C (27, 9), and to vech of what the inertia changes by (6, 27).
_CHANGES = np.concatenate(
    (np.einsum("wad,sdb->swab", _TURNS, _SECOND_MOMENTS).reshape(18, 9), np.eye(9))
)
_RATES = np.array([vech(C + C.T) for C in (_CHANGES @ _INERTIA).reshape(27, 3, 3)]).T.copy()
# From a matrix H, flat, to vech of what S'' = H + H' makes of the inertia (9, 6).
_TWICE = np.array([vech((X + X.T).ravel().dot(_INERTIA)) for X in _BASIS])
# From carried moments, summed for each axis w that bodies turn about, to the same of [w] (C + C').
_TURNED_CHANGES = np.array(
    [(turn @ (C + C.T)).ravel().dot(_TWICE) for turn in _TURNS for C in _CHANGES.reshape(27, 3, 3)]
)
# What is multiplied in carried moments: entries of composites, and of (w, p).
_ARMS = np.tile([0, 1, 2], 3)
_OF_BODIES = np.concatenate((np.repeat(np.arange(3, 9), 3), _ARMS))
_OF_MOTIONS = np.concatenate((np.tile([0, 1, 2], 6), np.repeat([3, 4, 5], 3)))
# From weights (3, 3), flat, to K = tr(G) 1 - G and to 1/2 of the commutator with K (9, 18), by
# which the inertia's change turns.
_TURNED = _INERTIA @ np.array(
    [(0.5 * FROBENIUS_WEIGHTS[:, None] * commutator_matrix(K)).T.ravel() for K in _BASIS]
)


def carried_moments(composites: Array, momenta: Array, twists: Array, com: Array) -> Array:
    """Return (27, nv): for each column of v, the entries of S_o times those of w, then p a'.

    Parameters
    ----------
    composites:
        (nv, 9) as :class:`~wbc.robot.workspace.CompositeInertias` gives them.
    momenta:
        (3, nv) linear momentum by v.
    twists:
        (6, nv), of which the angular part is used.
    com:
        (3,) of the robot [m].
    """
    carried = composites.T.take(_OF_BODIES, axis=0)
    carried[18:] -= com.take(_ARMS)[:, None]
    carried *= np.concatenate((twists[3:], momenta)).take(_OF_MOTIONS, axis=0)
    return carried


def inertia_rates(carried: Array) -> Array:
    """Return the derivative of the centroidal inertia by v, world axes (paper eqs. 24-27).

    Parameters
    ----------
    carried:
        (27, nv) of :func:`carried_moments`.

    Returns
    -------
    (6, nv) rows xx, xy, xz, yy, yz, zz [kg m^2 per unit of v].
    """
    return _RATES.dot(carried)


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
        (6, nv) as :func:`inertia_rates` returns them.
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


def inertia_curvature(
    orders: Array, carried: Array, momenta: Array, twists: Array, com: Array, mass: float, v: Array
) -> Array:
    """Return the second time derivative (6,) of vech of the centroidal inertia at constant v.

    Column k of v changes S by C_k v_k + (..)'. Itself C_k moves with the bodies that carry it and
    those that it carries; sums over the latter, exchanged with those over the former, leave

        S'' = sum over k of v_k ([W_k] C_k + C_k [W_k]' + p_k U_k') + (..)' - 2 M c' c''

    with W_k, U_k the twist of the column's body and of the one before it, together, at the robot's
    CoM, and c' its velocity (in the last term a column).

    Parameters
    ----------
    orders:
        See :class:`~wbc.robot.workspace.CarriedColumns`.
    carried:
        (27, nv) of :func:`carried_moments`.
    v:
        (nv,); the others as of :func:`inertia_hessian`.
    """
    whole = (twists * v).dot(orders.T)  # (6, nv): U at the world's origin, W
    moved = momenta * v
    turned = (whole[3:] * v).dot(carried.T).ravel()  # by axis of W
    by_twist = moved.dot(whole.T)
    velocity = momenta.dot(v)
    half = by_twist[:, 3:].dot(skew(com))
    half += by_twist[:, :3]
    half -= velocity[:, None] * (velocity / mass)
    curvature = turned.dot(_TURNED_CHANGES)
    curvature += half.ravel().dot(_TWICE)
    return curvature
