"""How the composite-rigid-body (CRB) inertia changes with the joints: Jacobian and drift.

The Jacobian (paper eqs. 24-27) follows from the composite inertias that Pinocchio keeps: a joint
moves the bodies that it carries as one. The second derivative is read off the equations of motion.
Lock all joints and spin the whole robot about its CoM at angular velocity w: the kinetic energy is
T = 1/2 w' I_c w, and Lagrange's equations say that joint j then needs the *centrifugal torque*

    tau_j(w) = - dT/dq_j = - 1/2 w' (dI_c/dq_j) w.

So six spins, one for each entry of a symmetric matrix, give the Jacobian too (the tests' oracle),
and the derivative of these torques along the motion gives the second derivative: exact for every
joint type, O(n), and no loop over the links in Python. That part is seen from the base, where the
inertia depends on the joints alone (paper 5.2.1); :mod:`wbc.robot.state` adds how the base and
other frames turn.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from wbc.robot.workspace import Workspace
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

# Spin axes e_a for the diagonal entries and e_a + e_b for the off-diagonal ones, in vech order.
_SPINS = np.zeros((6, 3))
_SPINS[np.arange(6), ROWS] = 1.0
_SPINS[np.arange(6), COLUMNS] = 1.0
# Takes the six quadratic forms w' S w to vech(S).
_POLARISATION = np.linalg.inv(_SPINS[:, ROWS] * _SPINS[:, COLUMNS] * FROBENIUS_WEIGHTS)


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


def joint_hessian(
    work: Workspace, q: Array, com_in_base: Array, com_jacobian: Array, axis: Array
) -> Array:
    """Return the Hessian (nv, nv) of ``axis' I_base axis`` by the joints; base rows are 0.

    The centrifugal torque differentiated once more. The spin goes through the CoM, so it moves with
    the joints as the CoM does: ``com_jacobian`` (3, nv) is that of the CoM relative to the base
    origin, in base axes (its base columns are not used).
    """
    spin = np.zeros(work.model.nv)
    spin[:3], spin[3:6] = np.cross(com_in_base, axis), axis
    by_q, by_v, _ = pin.computeRNEADerivatives(work.weightless, work.scratch, q, spin, work.at_rest)
    hessian = by_q + by_v[:, :3] @ (skew(axis).T @ com_jacobian)
    hessian *= -2.0
    hessian[:6] = 0.0
    hessian[:, :6] = 0.0
    return hessian


def joint_curvature(
    work: Workspace, q: Array, v: Array, com_in_base: Array, com_jacobian: Array
) -> Array:
    """Return the second time derivative (6,) of the base-frame inertia at constant joint rates."""
    forms = [v @ joint_hessian(work, q, com_in_base, com_jacobian, axis) @ v for axis in _SPINS]
    return _POLARISATION @ np.array(forms)
