"""From a force plate's channels to the ground's wrench in the world."""

from __future__ import annotations

import numpy as np

from wbc.errors import InvalidInputError
from wbc.validate import Array

SMALLEST = 1e-3  # m: sides of a plate


def plate_wrench(
    kind: int, values: Array, corners: Array, origin: Array, unit: float, arm: float
) -> tuple[Array, Array]:
    """Return force [N] and moment about the world's origin [N m], both (k, 3).

    As the C3D manual has the types (www.c3d.org): 1 gives force, its point and the free torque; 2
    and 4 force and moment at the sensor; 3 eight forces of sensors in the corners. A plate's x axis
    leads from corners 2, 3 to 1, 4, its y axis from 3, 4 to 1, 2. Whether it is the ground's or the
    foot's force differs from laboratory to laboratory; see :meth:`ForcePlate.pushing`.

    Parameters
    ----------
    kind:
        1 to 4.
    values:
        Channels (k, 6), or (k, 8) of type 3, in N and the unit of their moments.
    corners:
        (4, 3) in the world [m].
    origin:
        (3,) [m]: from the sensor to the middle of the surface in the plate's axes; of type 3 half
        the distances between sensors, and the same.
    unit, arm:
        Of points of type 1, and of moments, in m and N m.

    Raises
    ------
    InvalidInputError
        Another type, numbers that are not finite, or corners that span nothing.
    """
    if kind not in (1, 2, 3, 4):
        raise InvalidInputError(f"its type is {kind}; types 1 to 4 are read")
    if not (np.isfinite(values).all() and np.isfinite(corners).all() and np.isfinite(origin).all()):
        raise InvalidInputError("its numbers are not finite")
    x = 0.5 * (corners[0] + corners[3] - corners[1] - corners[2])
    y = 0.5 * (corners[0] + corners[1] - corners[2] - corners[3])
    z = np.cross(x, y)
    if min(np.linalg.norm(x), np.linalg.norm(y)) < SMALLEST or np.linalg.norm(z) < SMALLEST**2:
        raise InvalidInputError("its corners span no surface")
    x = x / np.linalg.norm(x)
    z = z / np.linalg.norm(z)
    R = np.column_stack((x, np.cross(z, x), z))
    # The sensor is below the surface and z points down: some files have the other sign.
    down = origin.copy()
    down[2] = -abs(down[2])
    sensor = corners.mean(axis=0) - R @ (down if kind in (2, 4) else np.zeros(3))
    if kind == 1:
        force = values[:, :3]
        point = np.column_stack((unit * values[:, 3:5], np.zeros(len(values))))
        free = np.column_stack((np.zeros((len(values), 2)), arm * values[:, 5]))
        moment = np.cross(point, force) + free
    elif kind == 3:
        force, moment = _of_corners(values, abs(origin[0]), abs(origin[1]))
        sensor = corners.mean(axis=0) - R @ np.array((0.0, 0.0, down[2]))
    else:
        force, moment = values[:, :3], arm * values[:, 3:6]
    force = force @ R.T
    moment = moment @ R.T + np.cross(sensor, force)
    return force, moment


def _of_corners(values: Array, a: float, b: float) -> tuple[Array, Array]:
    """Return force and moment (k, 3) of eight sensors: x12 x34 y14 y23 z1 z2 z3 z4."""
    x12, x34, y14, y23, z1, z2, z3, z4 = values.T
    force = np.column_stack((x12 + x34, y14 + y23, z1 + z2 + z3 + z4))
    moment = np.column_stack(
        (
            b * (z1 + z2 - z3 - z4),
            a * (-z1 + z2 + z3 - z4),
            b * (-x12 + x34) + a * (y14 - y23),
        )
    )
    return force, moment
