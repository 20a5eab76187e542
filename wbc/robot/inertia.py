"""How the composite-rigid-body (CRB) inertia changes with the joints: Jacobian and drift.

The paper differentiates the inertia link by link (eqs. 24-27). The same derivatives can be read off
the equations of motion. Lock all joints and spin the whole robot about its CoM at angular velocity
w: the kinetic energy is T = 1/2 w' I_c w, and Lagrange's equations say that joint j then needs the
*centrifugal torque*

    tau_j(w) = - dT/dq_j = - 1/2 w' (dI_c/dq_j) w.

So six spins, one for each entry of a symmetric matrix, give all columns of the Jacobian through
Pinocchio's recursive Newton-Euler pass: exact for every joint type, O(n), and no loop over the
links in Python. The derivative of the same torque along the motion gives the second derivative.

Everything here is seen from the base, where the inertia depends on the joints alone (paper 5.2.1);
:mod:`wbc.robot.state` adds how the base and other frames turn.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from wbc.robot.workspace import Workspace
from wbc.spatial import COLUMNS, FROBENIUS_WEIGHTS, ROWS, skew
from wbc.validate import Array

# Spin axes e_a for the diagonal entries and e_a + e_b for the off-diagonal ones, in vech order.
_SPINS = np.zeros((6, 3))
_SPINS[np.arange(6), ROWS] = 1.0
_SPINS[np.arange(6), COLUMNS] = 1.0
# Takes the six quadratic forms w' S w to vech(S).
_POLARISATION = np.linalg.inv(_SPINS[:, ROWS] * _SPINS[:, COLUMNS] * FROBENIUS_WEIGHTS)
_FROM_TORQUES = -2.0 * _POLARISATION


def joint_rates(work: Workspace, q: Array, com_in_base: Array, axes: Array) -> Array:
    """Return the derivative of the centroidal inertia by the joints, the base at rest.

    Parameters
    ----------
    q:
        Configuration (nq,).
    com_in_base:
        CoM relative to the base origin, in base axes (3,) [m].
    axes:
        Rotation (3, 3) from base axes to those in which the inertia is wanted.

    Returns
    -------
    (6, nv) rows xx, xy, xz, yy, yz, zz [kg m^2 per unit of joint velocity]; the base columns are 0.
    """
    spins, torques = work.spins, work.torques
    np.matmul(_SPINS, axes, out=spins[:, 3:6])
    np.matmul(spins[:, 3:6], skew(com_in_base).T, out=spins[:, :3])  # the base moves at c x w
    for k in range(6):
        torques[k] = pin.nonLinearEffects(work.weightless, work.scratch, q, spins[k])
    torques[:, :6] = 0.0  # what holds the spinning base: it turns the tensor, it does not shape it
    return _FROM_TORQUES @ torques


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
