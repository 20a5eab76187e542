"""How well a CoM can follow the human's within the limits of ground and soles: convex programs.

Independent of the motion's generation: over all paths of a CoM in the plane, at the human's scaled
height and with the human's scaled angular momentum, whose CoP

    p = c - h/(g + z'') c'' + n x k'/(m (g + z''))

is within the standing soles (and 1 mm of them), the one whose x, or y, correlates best with the
human's. A correlation is the cosine of an angle, so it is that of the least squares |c - s h|^2 for
some s. There is no constraint in the air, or where the ground hardly pushes.
"""

import clarabel
import numpy as np
from scipy import sparse
from scipy.spatial import ConvexHull

import wbc

SIZES = (0.6, 1.0)  # s
OTHER = 1e-3  # weight of the other axis
TOLERANCE = 1e-3  # m
LEAST = 2.0  # m/s^2: of the ground's push


def com_bound(found: wbc.Retargeted) -> list[float]:
    """Return the best correlations of x and y."""
    rows, most = _constraints(found)
    wanted = found.targets.human_com[:, :2]
    return [max(_followed(wanted, axis, s, rows, most) for s in SIZES) for axis in range(2)]


def _constraints(found: wbc.Retargeted) -> tuple[sparse.csc_matrix, np.ndarray]:
    """Return rows and bounds of G (x, y, mean) <= b: CoPs within the soles."""
    targets, robot = found.targets, found.robot
    count, dt = len(found), targets.dt
    com = targets.human_com
    up = robot.gravity + np.gradient(np.gradient(com[:, 2], dt), dt)
    k_rate = np.gradient(targets.angular_momentum, dt, axis=0)
    entries, bounds = [], []
    number = 0
    for stand in targets.feet.supports:
        points = np.concatenate([corners[:, :2] for _, corners in stand.feet])
        wide = TOLERANCE * np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
        hull = ConvexHull((points[:, None] + wide).reshape(-1, 2)).equations
        for k in stand.frames.tolist():
            if not 0 < k < count - 1 or up[k] < LEAST:
                continue
            square = com[k, 2] / up[k]
            moment = np.array((-k_rate[k, 1], k_rate[k, 0])) / (robot.mass * up[k])
            ways = (-square / dt**2, 1.0 + 2.0 * square / dt**2, -square / dt**2)
            for a, b, offset in hull:
                entries += [
                    (number, axis * count + k + m - 1, part * way)
                    for axis, part in enumerate((a, b))
                    for m, way in enumerate(ways)
                ]
                bounds.append(-offset - a * moment[0] - b * moment[1])
                number += 1
    if not entries:
        return sparse.csc_matrix((0, 2 * count + 1)), np.zeros(0)
    i, j, values = zip(*entries, strict=True)
    return sparse.csc_matrix((values, (i, j)), (number, 2 * count + 1)), np.array(bounds)


def _followed(
    wanted: np.ndarray, axis: int, size: float, rows: sparse.csc_matrix, most: np.ndarray
) -> float:
    """Return the correlation of one axis of the path nearest to ``size`` times the human's."""
    count = len(wanted)
    weights = np.full((2, 1), OTHER)
    weights[axis] = 1.0
    # |w (c - s h - mean)|^2, the mean free on this axis.
    A = sparse.lil_matrix((2 * count, 2 * count + 1))
    A.setdiag(np.repeat(weights[:, 0], count))
    A[axis * count : (axis + 1) * count, 2 * count] = -1.0
    centred = wanted - wanted.mean(axis=0)
    goal = wanted.T.copy()
    goal[axis] = size * centred[:, axis]
    target = (weights * goal).ravel()
    P = sparse.triu(A.T @ A + 1e-12 * sparse.eye(2 * count + 1)).tocsc()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.NonnegativeConeT(len(most))] if len(most) else []
    solver = clarabel.DefaultSolver(P, -(A.T @ target), rows, most, cones, settings)
    found = np.array(solver.solve().x)[:-1].reshape(2, count)[axis]
    if np.ptp(found) < 1e-9 or np.ptp(centred[:, axis]) < 1e-9:
        return 1.0
    return float(np.corrcoef(found, centred[:, axis])[0, 1])
