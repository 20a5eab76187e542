"""Uncertainty of a motion's pendulum by the recording's noise, frame by frame."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from wbc.motion.ground import SupportMargin
from wbc.motion.noise import FilteredNoise
from wbc.motion.sensitivity import COM, INERTIA, MOMENTUM, RATE, SOLES, covariances
from wbc.motion.series import RmpSeries, Uncertainty
from wbc.motion.smoothing import SmoothMotion
from wbc.rmp.ground import centre_of_pressure, centroidal_moment_pivot, leg_of
from wbc.robot.series import CentroidalSeries
from wbc.spatial import COLUMNS, DIAGONAL, FROBENIUS_WEIGHTS, ROWS
from wbc.validate import Array

COVERAGE = 0.95  # of a band, in each frame
BAND = float(ndtri(0.5 + 0.5 * COVERAGE))  # standard deviations on each side
RISK = 0.05  # of a false verdict by noise alone, in the whole recording
MOMENTUM_TO_INERTIA = slice(MOMENTUM.start, INERTIA.stop)
STEP = 1e-6  # of finite differences, in m and by the weight


def beyond_noise(seconds: float, bandwidth: float) -> float:
    """Return the standard deviations that noise exceeds in the recording with probability 5 %.

    Gaussian noise of at most ``bandwidth`` [Hz] crosses a level u upwards at most bandwidth
    exp(-u^2 / 2) times a second (Rice 1945, eq. 3.3-11).
    """
    return float(np.sqrt(2.0 * np.log(max(1.0, seconds * bandwidth) / RISK)))


def propagate_noise(
    series: RmpSeries,
    whole: CentroidalSeries,
    margin: SupportMargin | None,
    moving: SmoothMotion,
    noise: FilteredNoise,
) -> Uncertainty:
    """Return the uncertainty of a trajectory's pendulum by its filtered noise.

    ``margin``: of the CoP, by the series' feet.
    """
    every, arrays = [field.name for field in fields(Uncertainty)], series.arrays()
    found = {name: np.full(arrays[name].shape, np.nan) for name in every if name in arrays}
    found |= {name: np.full((len(series), 2), np.nan) for name in ("cop", "cmp")}  # at one height
    pushing = ~series.flight & (not series.measured)  # a measured force has no band
    clock = _clock_errors(series, whole, noise.late)
    for frames, noisy in covariances(series.robot, moving, noise):
        covariance = noisy + clock[frames, :, None] * clock[frames, None]
        for name, rows in (("com", COM), ("momentum", MOMENTUM), ("momentum_rate", RATE)):
            found[name][frames] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, rows])
        found["second_moments"][frames] = _deviations(
            _second_moment_jacobian(series.axes[frames]), covariance[:, INERTIA, INERTIA]
        )
        w = series.average_angular_velocity[frames]
        found["average_angular_velocity"][frames] = _deviations(
            _angular_velocity_jacobian(whole.inertia[frames], w),
            covariance[:, MOMENTUM_TO_INERTIA, MOMENTUM_TO_INERTIA],
        )
        inner = frames.start + np.flatnonzero(pushing[frames])
        if len(inner):
            pushed = covariance[inner - frames.start]
            jacobian = _ground_jacobian(series, inner, covariance.shape[1])
            values = _deviations(jacobian, pushed)
            found["cop"][inner], found["cmp"][inner] = values[:, 0:2], values[:, 2:4]
            found["leg_length"][inner], found["leg_angles"][inner] = values[:, 4], values[:, 5:7]
            if margin is not None:
                inward = _margin_jacobian(series, margin, inner, jacobian[:, :2])
                found["cop_margin"][inner] = _deviations(inward, pushed)[:, 0]
    # The derivative of sqrt(c lambda / M) by lambda is sqrt(c) times this.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = 0.5 * found["second_moments"] / np.sqrt(series.second_moments * series.robot.mass)
    found["semi_axes"], found["radii"] = np.sqrt(5.0) * root, np.sqrt(3.0) * root
    beyond = beyond_noise(float(series.time[-1] - series.time[0]), moving.bandwidth)
    inside = found.pop("cop_margin", None)
    return Uncertainty(noise=noise.recorded, beyond=beyond, cop_margin=inside, **found)


def _clock_errors(series: RmpSeries, whole: CentroidalSeries, late: float) -> Array:
    """Return the changes (n, r) of all rows in ``late`` seconds."""
    soles = [whole.soles[foot][:, :2, 3] for foot in series.robot.feet]
    if late == 0.0:
        return np.zeros((len(series), SOLES + 2 * len(soles)))
    rows = np.hstack((series.com, series.momentum, series.momentum_rate, series.inertia, *soles))
    return np.asarray(late * np.gradient(rows, series.time, axis=0))


def _deviations(jacobian: Array, covariance: Array) -> Array:
    """Return the standard deviations (m, k) of quantities with Jacobians (m, k, r)."""
    variance = ((jacobian @ covariance) * jacobian).sum(axis=2)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _second_moment_jacobian(axes: Array) -> Array:
    """Return the Jacobian (m, 3, 6) of the second moments tr I / 2 - e_k' I e_k by vech I."""
    about = np.swapaxes(axes[:, ROWS] * axes[:, COLUMNS], 1, 2) * FROBENIUS_WEIGHTS
    jacobian = -about
    jacobian[:, :, DIAGONAL] += 0.5
    return np.asarray(jacobian)


def _angular_velocity_jacobian(inertia: Array, w: Array) -> Array:
    """Return the Jacobian (m, 3, 18) of w = I^-1 k by k, its rate and vech I: I dw = dk - dI w."""
    jacobian = np.zeros((len(w), 3, 18))
    jacobian[:, [0, 1, 2], [3, 4, 5]] = 1.0
    for entry, (row, column) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        jacobian[:, row, 12 + entry] -= w[:, column]
        if row != column:
            jacobian[:, column, 12 + entry] -= w[:, row]
    return np.asarray(np.linalg.solve(inertia, jacobian))


def _ground_jacobian(series: RmpSeries, frames: NDArray[np.intp], size: int) -> Array:
    """Return the Jacobian (m, 7, r) of CoP, CMP, leg length and angles, by differences."""
    parts = series.com, series.ground_force, series.momentum_rate[:, 3:]
    state = np.hstack([part[frames] for part in parts])
    weight = series.robot.weight
    jacobian = np.zeros((len(frames), 7, size))
    columns = (*range(COM.start, COM.stop), *range(RATE.start, RATE.stop))
    for k, column in enumerate(columns):
        step = np.zeros(9)
        step[k] = STEP if k < 3 else STEP * weight
        ahead, behind = (_ground(state + sign * step, series.ground_height) for sign in (1.0, -1.0))
        jacobian[:, :, column] = (ahead - behind) / (2.0 * step[k])
    return jacobian


def _ground(state: Array, height: float) -> Array:
    com, force, moment = np.split(state, 3, axis=1)
    cop = centre_of_pressure(com, force, moment, height)
    cmp = centroidal_moment_pivot(com, force, height)
    length, _, angles = leg_of(com, cop)
    return np.column_stack((cop[:, :2], cmp[:, :2], length, angles))


def _margin_jacobian(
    series: RmpSeries, margin: SupportMargin, frames: NDArray[np.intp], cop: Array
) -> Array:
    """Return the Jacobian (m, 1, r) of the margin, from that of the CoP (m, 2, r).

    The margin changes with the CoP relative to the edge's nearest point, which is between soles.
    """
    relative = cop.copy()
    for k, name in enumerate(series.feet):
        first = SOLES + 2 * list(series.robot.feet).index(name)
        for xy in range(2):
            relative[:, xy, first + xy] -= margin.weights[frames, k]
    return np.asarray(margin.gradient[frames, None] @ relative)
