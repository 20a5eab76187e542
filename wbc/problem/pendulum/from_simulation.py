"""From a simulated pendulum to its history in space."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.problem.pendulum.history import PendulumHistory, Support
from wbc.rmp.balance.record import Simulation
from wbc.rmp.ground import centroidal_moment_pivot
from wbc.rmp.planar import PlanarRmp
from wbc.validate import Array

# The phase of a run that ended before its first step.
UNSTARTED = "start"


def simulation_history(simulation: Simulation) -> PendulumHistory:
    """Return a simulation's motion in space, its start and its end included."""
    n = len(simulation.time)
    flat = isinstance(simulation.model, PlanarRmp)
    q = simulation.q
    com, velocity = (_in_space(each) for each in simulation.com())
    force = _in_space(simulation.ground_force)
    # One for each step, from its beginning: the end has none.
    pushed = np.flatnonzero(~np.isnan(simulation.cop[:, 0]))
    cop, cmp = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    cop[pushed] = 0.0
    cop[pushed, : simulation.cop.shape[1]] = simulation.cop[pushed]
    cmp[pushed] = centroidal_moment_pivot(com[pushed], force[pushed])
    foot = np.zeros((n, 3))
    foot[:, : 1 if flat else 2] = q[:, : 1 if flat else 2]
    return PendulumHistory(
        flat=flat,
        time=simulation.time,
        phase=(*simulation.phase, simulation.phase[-1] if simulation.phase else UNSTARTED),
        com=com,
        com_velocity=velocity,
        foot=foot,
        cop=cop,
        cmp=cmp,
        radii=np.column_stack((q[:, 4], np.zeros((n, 2)))) if flat else q[:, 9:12],
        axes=_turned(q[:, 1] + q[:, 3]) if flat else Rotation.from_quat(q[:, 5:9]).as_matrix(),
        momentum=_momentum(simulation.momentum()),
        supports=_supports(simulation),
    )


def _in_space(points: Array) -> Array:
    """Return (n, 3) points of a plane (n, 2), (x, z), or of space as they are."""
    if points.shape[1] == 3:
        return points
    return np.column_stack((points[:, 0], np.zeros(len(points)), points[:, 1]))


def _turned(angle: Array) -> Array:
    """Return rotations (n, 3, 3) about -y, which turn x to z."""
    return Rotation.from_rotvec(np.outer(angle, (0.0, -1.0, 0.0))).as_matrix()


def _momentum(k_G: Array) -> Array:
    return k_G if k_G.shape[1] == 3 else np.outer(k_G[:, 0], (0.0, -1.0, 0.0))


def _supports(simulation: Simulation) -> tuple[Support, ...]:
    polygon = simulation.bounds.polygon
    if polygon is None:
        return ()
    corners = np.asarray(polygon)
    if corners.ndim == 1:
        corners = np.column_stack((corners, np.zeros(2)))
    return (Support(float(simulation.time[0]), float(simulation.time[-1]), corners),)
