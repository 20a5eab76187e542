"""Uncertainty of a fitted posture and its derivatives, from the residuals of the markers.

Skin moves against bone: an error that is not white, and of which a fit sees only the part in which
markers contradict each other. Its size at each time scale is taken from the residuals, filtered and
differentiated as the motion will be; the fit's normal matrix propagates it to the posture. The part
that leaves no residual is assumed proportional, and moves the body as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from wbc.human.fit import MarkerSet, normal_equations
from wbc.human.kinematics import DOFS, Poses, point_jacobian
from wbc.human.skeleton import hinge_order
from wbc.motion.filtering import low_pass
from wbc.motion.noise import Noise
from wbc.motion.smoothing import even_grid, resample
from wbc.robot import Robot
from wbc.validate import Array

# Markers of one segment also slide together (Barre et al. 2013, IEEE Trans. Biomed. Eng. 60, 3131:
# most of the skin's motion), and the body with them: along each axis by this part of a marker's own
# deviation. It leaves no residual. This and the next are chosen so that the bands of nine walks
# contained what force plates measured; docs/howto/humans.md has the results of others.
COMMON_PART = 0.2
# Standard deviation [s] of the clock of markers by that of force plates: by the vertical forces of
# 20 recordings, less than 2 ms in some and 14 ms in others.
LATE = 0.008
# Standard deviation [m] of the CoM in the body along each axis: tables of segments differ by some
# 10 mm in it (Dumas et al. 2007; Pearsall and Costigan 1999).
CENTRE_DEVIATION = 0.010
GAIN_FRAMES = 100  # over which the gains are averaged


@dataclass(frozen=True, eq=False)
class ResidualNoise:
    """Errors of a fitted posture, correlated among its coordinates and over time."""

    time: Array  # of the frames (n,) [s]
    residual: Array  # of the markers' coordinates (n, k) [m], without gaps and means
    # (f, nv, k): from errors of the markers' coordinates to those of the posture in some frames:
    # base along world axes [m], about its own axes [rad], joints [rad]
    gain: Array
    constant: Array  # (nv, 3): a root of the covariance of constant errors, likewise
    late: float = LATE  # standard deviation of the clock [s]

    def recorded(self) -> Noise:
        """Return the standard deviations of the channels, unfiltered."""
        root = self._root((self.residual**2).mean(axis=0))
        deviation = np.sqrt((root**2).sum(axis=1))
        return Noise(deviation[6:], deviation[:3], deviation[3:6], coloured=False)

    def filtered(self, cutoff: float | None) -> tuple[Array, Array]:
        """Return a covariance (3, 3) and a root (nv, nv+3) of the errors after the low-pass [Hz].

        The errors' accelerations are the root times independent ones of variance 1; the covariance
        is that of value, velocity and acceleration of one of these.
        """
        grid, rate = even_grid(self.time)
        values = low_pass(resample(self.time, self.residual, grid), rate, cutoff)
        curve = make_interp_spline(grid, values, k=5)
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
        shared = COMMON_PART * np.sqrt(variances.mean()) * np.eye(len(whole), 3)
        return np.hstack((own, shared))


def residual_noise(
    time: Array, poses: Poses, observed: Array, residual: Array, markers: MarkerSet, robot: Robot
) -> ResidualNoise:
    """Return the errors of a fit by its residuals (n, m, 3) (White 1980, Econometrica).

    Each coordinate of a marker has an error of its own variance, that of its residual.
    """
    seen = np.asarray(np.isfinite(residual).all(axis=2))
    share = seen.mean(axis=0)
    always = np.flatnonzero(share >= min(0.5, share.max()))
    residual = np.where(seen[:, always, None], residual[:, always], 0.0)
    frames = np.unique(np.linspace(0, len(poses) - 1, GAIN_FRAMES).astype(int))
    some = poses[frames]
    segment_frames = markers.frames(some)
    H, _ = normal_equations(some, observed[frames], markers)
    positions = markers.positions(segment_frames)[:, always]
    J = point_jacobian(segment_frames, markers.segments[always], positions)
    J = J.reshape(len(frames), -1, DOFS)
    weight = np.repeat(markers.noise[always] ** -2, 3)
    gain = np.linalg.solve(H, np.swapaxes(J, 1, 2) * weight)
    # From the fit's steps to the robot's tangent space: axes of the base, order of its joints.
    angular = np.swapaxes(some.rotation, 1, 2) @ gain[:, 3:6]
    gain = np.concatenate((gain[:, :3], angular, gain[:, 6:][:, hinge_order(robot)]), axis=1)
    values = residual.reshape(len(time), -1)
    values = values - values.mean(axis=0)  # the calibration contains constant errors
    return ResidualNoise(time, values, np.asarray(gain, float), CENTRE_DEVIATION * np.eye(DOFS, 3))
