"""The ground reaction: centre of pressure, centroidal moment pivot, support polygon.

The ground is flat, at height z0, with the normal n = +z. Its push on the robot is given as the
force f_r and its moment about the CoM, which is the rate of the centroidal angular momentum k'_c if
nothing else but gravity acts (paper 8.1). Arrays may carry leading axes, such as one over frames.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.validate import Array, finite_array

# A ground reaction below this fraction of the weight counts as flight: the CoP divides by it, and
# would consist of rounding and measurement errors.
FLIGHT = 0.01
# The leg angle theta is undefined where the leg lies along y: within this, as a cosine.
SINGULAR = 1e-6

Wrench = tuple[ArrayLike, ArrayLike]


def in_contact(force: Array, weight: float) -> Array:
    """Return where there is contact (...,), bool: n . f_r is above ``FLIGHT`` M g.

    False means flight, or a motion that would need a pulling ground (n . f_r < 0). The force is f_r
    (..., 3) [N], the weight M g that of the robot, under its own gravity [N].
    """
    return np.asarray(force[..., 2] > FLIGHT * weight)


def centre_of_pressure(com: Array, force: Array, moment: Array, height: float = 0.0) -> Array:
    """Return the CoP (..., 3) [m]: the point of the ground about which f_r only turns about n.

    p = n x (k'_c + c x f_r) / (n . f_r), heights measured from the ground. It may lie outside the
    support polygon: then the motion is infeasible.

    ``com``: CoM c (..., 3) [m].
    ``force``: ground reaction force f_r (..., 3) [N], pushing in every frame (see
    :func:`in_contact`).
    ``moment``: its moment about the CoM, k'_c (..., 3) [N m].
    ``height``: height z0 of the ground [m].

    Raises InvalidInputError: the ground does not push somewhere: there is no CoP in flight.
    """
    p = centroidal_moment_pivot(com, force, height)
    p[..., 0] -= moment[..., 1] / force[..., 2]
    p[..., 1] += moment[..., 0] / force[..., 2]
    return p


def centroidal_moment_pivot(com: Array, force: Array, height: float = 0.0) -> Array:
    """Return the CMP (..., 3) [m]: where the line through the CoM along f_r meets the ground.

    CMP - CoP is n x k'_c / -(n . f_r), so it measures the rate of the angular momentum.
    Parameters and errors as of :func:`centre_of_pressure`.
    """
    normal = force[..., 2:]
    if not (normal > 0.0).all():
        raise InvalidInputError(
            "ground reaction: the ground does not push up, so there is neither CoP nor CMP; leave"
            " out the frames that are in flight"
        )
    point = np.array(com - force * ((com[..., 2:] - height) / normal))
    point[..., 2] = height
    return point


def normal_moment(com: Array, force: Array, moment: Array, point: Array) -> Array:
    """Return n . m_r (...,) [N m]: the moment about n through a point of the ground.

    n . (k'_c + (c - p) x f_r), paper 8.1 as corrected; at the CoP p it is all of the moment.
    """
    x, y = com[..., 0] - point[..., 0], com[..., 1] - point[..., 1]
    return np.asarray(moment[..., 2] + x * force[..., 1] - y * force[..., 0])


def leg_of(com: Array, cop: Array) -> tuple[Array, Array, Array]:
    """Return the pendulum's leg from the CoP to the CoM.

    ``com``, ``cop``: (..., 3) [m].

    Returns
    -------
    length:
        (...,) [m].
    direction:
        Unit vector n (..., 3).
    angles:
        (theta, phi) (..., 2) [rad], n = (cos theta cos phi, sin phi, sin theta cos phi): phi in
        [-pi/2, pi/2], theta negative below the horizon; NaN where the leg lies along y.
    """
    leg = com - cop
    length = np.linalg.norm(leg, axis=-1)
    if not np.all(length > 0.0):
        raise InvalidInputError(
            "the CoM is at the CoP, on the ground: the pendulum's leg has no length; is"
            " ground_height right?"
        )
    direction = leg / length[..., None]
    x, y, z = np.moveaxis(direction, -1, 0)
    across = np.hypot(x, z)
    angles = np.stack((np.arctan2(z, x), np.arctan2(y, across)), axis=-1)
    angles[across < SINGULAR] = np.nan
    return length, direction, angles


def total_wrench(wrenches: Iterable[Wrench], about: Array) -> tuple[Array, Array]:
    """Return the sum of contact wrenches: force (3,) [N] and moment (3,) [N m] about a point (3,).

    Each is a pair (position (3,), wrench (6,)): force and moment about that position, world axes.
    """
    force, moment = np.zeros(3), np.zeros(3)
    if not isinstance(wrenches, Iterable):
        raise InvalidInputError(
            f"wrenches: expected pairs (position (3,), wrench (6,)), got {shown(wrenches)}"
        )
    for k, pair in enumerate(wrenches):
        try:
            position, wrench = pair
        except (TypeError, ValueError) as error:
            raise InvalidInputError(
                f"wrenches[{k}]: expected a pair (position (3,), wrench (6,)), got {pair!r}"
            ) from error
        p = finite_array(f"wrenches[{k}], position", position, (3,))
        w = finite_array(f"wrenches[{k}], wrench", wrench, (6,))
        force += w[:3]
        moment += w[3:] + np.cross(p - about, w[:3])
    return force, moment
