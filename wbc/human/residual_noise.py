"""How uncertain a fitted posture and its derivatives are, from what markers leave unexplained.

Skin moves against bone: an error that is not white, and of which a fit sees only the part in which
markers contradict each other. Its size at each time scale is taken from the residuals themselves,
filtered and differentiated as the motion will be; how it reaches the posture from the fit's normal
matrix. What leaves no residual is taken for a part of that, and moves the body as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from wbc.human.fit import MarkerSet, normal_equations
from wbc.human.kinematics import DOFS, Poses, place, point_jacobian
from wbc.human.skeleton import hinge_order
from wbc.motion.filtering import low_passed
from wbc.motion.noise import Noise
from wbc.motion.smoothing import even_grid, on_grid
from wbc.robot import Robot
from wbc.validate import Array

# Markers of one segment also slide together (Barre et al. 2013, IEEE Trans. Biomed. Eng. 60, 3131:
# most of what skin does), and the body with them: along each axis by this part of what a marker
# does on its own. Without a residual, so chosen, as the next, so that bands of nine walks held what
# force plates measured; what it gives in others is in docs/howto/humans.md.
TOGETHER = 0.2
# By how much the times of markers and of what the motion is held against may differ, one standard
# deviation [s]: of 20 recordings' vertical forces, less than 2 ms in some and 14 ms in others.
LATE = 0.008
# The CoM's place in the body, one standard deviation [m] along each axis: tables of segments differ
# by some 10 mm in it (Dumas et al. 2007; Pearsall and Costigan 1999).
CENTRE = 0.010
MOST_FRAMES = 100  # of which the gains are averaged


@dataclass(frozen=True, eq=False)
class ResidualNoise:
    """Errors of a fitted posture, correlated among its coordinates and over time.

    Attributes
    ----------
    time:
        Of the frames (n,) [s].
    residual:
        Of the markers' coordinates (n, k) [m], without gaps and means.
    gain:
        (f, nv, k): from errors of the markers' coordinates to those of the posture in some frames:
        base along world axes [m], about its own axes [rad], joints [rad].
    constant:
        (nv, 3): errors that do not change over time, likewise.
    late:
        Of the times, one standard deviation [s].
    """

    time: Array
    residual: Array
    gain: Array
    constant: Array
    late: float = LATE

    def recorded(self) -> Noise:
        """Return the standard deviations of the channels, unfiltered."""
        root = self._root((self.residual**2).mean(axis=0))
        deviation = np.sqrt((root**2).sum(axis=1))
        return Noise(deviation[6:], deviation[:3], deviation[3:6], coloured=False)

    def filtered(self, cutoff: float | None) -> tuple[Array, Array]:
        """Return what is left after the low-pass [Hz]: a covariance (3, 3), and a root (nv, nv+3).

        The errors' accelerations are the root times independent ones of size 1; the covariance is
        that of value, velocity and acceleration of one of these.
        """
        grid, rate = even_grid(self.time)
        even = low_passed(on_grid(self.time, self.residual, grid), rate, cutoff)
        curve = make_interp_spline(grid, even, k=5)
        inner = slice(len(grid) // 20, len(grid) - len(grid) // 20)
        parts = np.stack([curve(grid, order)[inner] for order in range(3)])
        root = self._root((parts[2] ** 2).mean(axis=0))
        flat = parts.reshape(3, -1)
        covariance = flat @ flat.T
        size = covariance[2, 2]  # 0, as is the root, where no marker moves
        return np.asarray(covariance / size) if size > 0.0 else np.eye(3), root

    def _root(self, variances: Array) -> Array:
        """Return a root (nv, nv+3) of the posture's covariance by the markers' variances (k,)."""
        whole = ((self.gain * variances) @ np.swapaxes(self.gain, 1, 2)).mean(axis=0)
        values, vectors = np.linalg.eigh(whole)
        own = vectors * np.sqrt(np.maximum(values, 0.0))
        shared = TOGETHER * np.sqrt(variances.mean()) * np.eye(len(whole), 3)
        return np.hstack((own, shared))


def residual_noise(
    time: Array,
    poses: Poses,
    observed: Array,
    residual: Array,
    markers: MarkerSet,
    dimensions: Array,
    robot: Robot,
) -> ResidualNoise:
    """Return what a fit's residuals (n, m, 3) tell of its errors (White 1980, Econometrica).

    Each coordinate of a marker has an error of its own size, which is taken for its residual's.
    """
    seen = np.asarray(np.isfinite(residual).all(axis=2))
    share = seen.mean(axis=0)
    always = np.flatnonzero(share >= min(0.5, share.max()))
    rest = np.where(seen[:, always, None], residual[:, always], 0.0)
    frames = np.unique(np.linspace(0, len(poses) - 1, MOST_FRAMES).astype(int))
    some = poses[frames]
    placed = place(some, dimensions)
    H, _ = normal_equations(some, observed[frames], markers, dimensions)
    J = point_jacobian(placed, markers.segments[always], markers.at(placed)[:, always])
    J = J.reshape(len(frames), -1, DOFS)
    weight = np.repeat(markers.noise[always] ** -2, 3)
    gain = np.linalg.solve(H, np.swapaxes(J, 1, 2) * weight)
    # From steps of the fit to the robot's tangent: about the base's own axes, joints in its order.
    turned = np.swapaxes(some.rotation, 1, 2) @ gain[:, 3:6]
    gain = np.concatenate((gain[:, :3], turned, gain[:, 6:][:, hinge_order(robot)]), axis=1)
    own = rest.reshape(len(time), -1)
    own = own - own.mean(axis=0)  # what is constant, the calibration has taken in
    return ResidualNoise(time, own, gain, CENTRE * np.eye(DOFS, 3))
