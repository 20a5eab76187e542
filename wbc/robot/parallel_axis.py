"""The parallel-axis term of the CRB inertia about another point than the CoM, and derivatives.

With the arm r from the point to the CoM it is M (|r|^2 1 - r r'): it and its derivatives depend on
the arm alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wbc.robot.names import COM, WORLD
from wbc.spatial import skew, vech
from wbc.validate import Array


def is_com(about: str | ArrayLike) -> bool:
    """Whether what an inertia is taken about is the CoM."""
    return isinstance(about, str) and about == COM


def moving_frame(about: str | ArrayLike) -> str | None:
    """Return the robot's frame that an inertia is taken about; None if it is no frame."""
    return about if isinstance(about, str) and about not in (COM, WORLD) else None


def parallel_axis(mass: float, arm: Array) -> Array:
    """Return M (|r|^2 1 - r r') (3, 3) [kg m^2] for the arm r (3,) [m]."""
    return mass * _row_crosses(np.outer(arm, arm))


def parallel_axis_rates(mass: float, arm: Array) -> Array:
    """Return the derivative (6, 3) of vech of :func:`parallel_axis` by the arm [kg m]."""
    x, y, z = (mass * arm).tolist()
    return np.array(
        (
            (0.0, 2 * y, 2 * z),
            (-y, -x, 0.0),
            (-z, 0.0, -x),
            (2 * x, 0.0, 2 * z),
            (0.0, -z, -y),
            (2 * x, 2 * y, 0.0),
        )
    )


def parallel_axis_curvature(mass: float, arm: Array, velocity: Array, acceleration: Array) -> Array:
    """Return the second time derivative (6,) of vech of :func:`parallel_axis`.

    ``arm``, ``velocity``, ``acceleration``: (3,) each, of the arm.
    """
    second: Array = parallel_axis_rates(mass, arm).dot(acceleration)
    second += 2.0 * mass * vech(_row_crosses(np.outer(velocity, velocity)))
    return second


def parallel_axis_hessian(
    weights: Array, mass: float, arm: Array, jacobian: Array, twists: Array, orders: Array
) -> Array:
    """Return the second derivative (nv, nv) of the sum of weights_ab times those entries by v.

    The sum is M r' K r, with K = tr(G) 1 - G. The arm's own second derivative is that of points of
    bodies: w_i x J_j where column i of v carries all that column j does.

    ``weights``: G (3, 3) symmetric.
    ``jacobian``: (3, nv) of the arm.
    ``twists``: (6, nv), the linear part that of the point at the world's origin.
    ``orders``: see :attr:`wbc.robot.tree.KinematicTree.carried`.
    """
    K = _row_crosses(weights)
    pull = mass * K.dot(arm)
    half = (skew(pull).dot(jacobian).T @ twists[3:]) * -orders  # row j, column i
    half += mass * jacobian.T @ K @ jacobian
    return half + half.T


def _row_crosses(S: Array) -> Array:
    return np.trace(S) * np.eye(3) - S
