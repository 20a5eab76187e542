"""Uncertainty of a motion's pendulum by the recording's noise, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from wbc.motion.filtered_noise import FilteredNoise
from wbc.motion.ground import GroundReaction, SupportMargin
from wbc.motion.noise import Noise
from wbc.motion.sensitivity import COM, INERTIA, MOMENTUM, RATE, SOLES, covariances
from wbc.motion.smoothing import SmoothMotion
from wbc.rmp.axes import TrackedAxes
from wbc.rmp.ground import centre_of_pressure, centroidal_moment_pivot, leg_of
from wbc.robot import Robot
from wbc.robot.series import CentroidalSeries
from wbc.spatial import COLUMNS, DIAGONAL, FROBENIUS_WEIGHTS, ROWS, STANDARD_GRAVITY
from wbc.validate import Array, read_only

COVERAGE = 0.95  # of a band, in each frame
BAND = float(norm.ppf(0.5 + 0.5 * COVERAGE))  # standard deviations on each side
RISK = 0.05  # of a false verdict by noise alone, in the whole recording
MOMENTUM_TO_INERTIA = slice(MOMENTUM.start, INERTIA.stop)
STEP = 1e-6  # of finite differences, in m and by the weight


@dataclass(frozen=True, eq=False)
class ReadOnlyArrays:
    """Base class that makes all array fields read-only."""

    def __post_init__(self) -> None:
        for array in self.arrays().values():
            read_only(array)

    def arrays(self) -> dict[str, Array]:
        """Return every array by its name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True, eq=False)
class Uncertainty(ReadOnlyArrays):
    """Standard deviations of a pendulum's quantities in n frames, from its recording's noise.

    To first order in the noise. A 95 % band is ``BAND`` = 1.96 of them on each side. Quantities of
    the ground's force are NaN where the ground does not push.

    Attributes
    ----------
    noise:
        Of the recording.
    beyond:
        Number of standard deviations that noise alone does not exceed anywhere in the recording,
        with a probability of 95 %.
    com:
        (n, 3) [m]; with a planted foot, as all positions, relative to it.
    momentum, momentum_rate:
        (n, 6) [kg m/s, kg m^2/s; N, N m]; the latter's first half is also the ground's force.
    cop, cmp:
        Along x and y (n, 2) [m].
    cop_margin:
        (n,) [m]; None without feet.
    leg_length, leg_angles:
        (n,) [m], (n, 2) [rad]. The length of a leg near the vertical is quadratic in the CoP's
        error: there its deviation is too large.
    second_moments, semi_axes, radii:
        (n, 3) [kg m^2, m, m].
    average_angular_velocity:
        (n, 3) [rad/s].
    """

    noise: Noise
    beyond: float
    com: Array
    momentum: Array
    momentum_rate: Array
    cop: Array
    cmp: Array
    cop_margin: Array | None
    leg_length: Array
    leg_angles: Array
    second_moments: Array
    semi_axes: Array
    radii: Array
    average_angular_velocity: Array


def beyond_noise(seconds: float, bandwidth: float) -> float:
    """Return the standard deviations that noise exceeds in the recording with probability 5 %.

    Gaussian noise of at most ``bandwidth`` [Hz] crosses a level u upwards at most bandwidth
    exp(-u^2 / 2) times a second (Rice 1945, eq. 3.3-11).
    """
    return float(np.sqrt(2.0 * np.log(max(1.0, seconds * bandwidth) / RISK)))


@dataclass(frozen=True, eq=False)
class Pendulum:
    """A motion's pendulum, named as in RmpSeries, to which the noise is propagated."""

    robot: Robot
    whole: CentroidalSeries
    axes: TrackedAxes
    reaction: GroundReaction
    feet: tuple[str, ...]
    margin: SupportMargin | None  # of the CoP, by these feet
    ground_height: float
    measured: bool  # whether the ground's force is, so that it has no band


def propagate_noise(pendulum: Pendulum, moving: SmoothMotion, noise: FilteredNoise) -> Uncertainty:
    """Return the uncertainty of a trajectory's pendulum by its filtered noise."""
    robot, axes, reaction = pendulum.robot, pendulum.axes, pendulum.reaction
    count = len(moving.time)
    widths = {"com": 3, "momentum": 6, "momentum_rate": 6, "second_moments": 3, "spin": 3}
    widths |= {"cop": 2, "cmp": 2, "leg": 3, "margin": 1}
    found = {name: np.full((count, width), np.nan) for name, width in widths.items()}
    pushing = ~reaction.flight & (not pendulum.measured)
    clock = _clock_errors(pendulum, moving.time, noise.late)
    for frames, noisy in covariances(robot, moving, noise):
        covariance = noisy + clock[frames, :, None] * clock[frames, None]
        for name, rows in (("com", COM), ("momentum", MOMENTUM), ("momentum_rate", RATE)):
            found[name][frames] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, rows])
        inertia = covariance[:, INERTIA, INERTIA]
        found["second_moments"][frames] = _deviations(
            _second_moment_jacobian(axes.axes[frames]), inertia
        )
        found["spin"][frames] = _deviations(
            _angular_velocity_jacobian(pendulum.whole, frames),
            covariance[:, MOMENTUM_TO_INERTIA, MOMENTUM_TO_INERTIA],
        )
        inner = frames.start + np.flatnonzero(pushing[frames])
        if len(inner):
            pushed = covariance[inner - frames.start]
            jacobian = _ground_jacobian(pendulum, inner, covariance.shape[1])
            values = _deviations(jacobian, pushed)
            for name, columns in (("cop", slice(0, 2)), ("cmp", slice(2, 4)), ("leg", slice(4, 7))):
                found[name][inner] = values[:, columns]
            if pendulum.margin is not None:
                inward = _margin_jacobian(pendulum, pendulum.margin, inner, jacobian[:, :2])
                found["margin"][inner] = _deviations(inward, pushed)
    # The derivative of sqrt(c lambda / M) by lambda is sqrt(c) times this.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = 0.5 * found["second_moments"] / np.sqrt(axes.second_moments * robot.mass)
    return Uncertainty(
        noise=noise.recorded,
        beyond=beyond_noise(float(moving.time[-1] - moving.time[0]), moving.bandwidth),
        com=found["com"],
        momentum=found["momentum"],
        momentum_rate=found["momentum_rate"],
        cop=found["cop"],
        cmp=found["cmp"],
        cop_margin=None if pendulum.margin is None else found["margin"][:, 0],
        leg_length=found["leg"][:, 0],
        leg_angles=found["leg"][:, 1:],
        second_moments=found["second_moments"],
        semi_axes=np.sqrt(5.0) * root,
        radii=np.sqrt(3.0) * root,
        average_angular_velocity=found["spin"],
    )


def _clock_errors(pendulum: Pendulum, time: Array, late: float) -> Array:
    """Return the changes (n, r) of all rows in ``late`` seconds."""
    whole, feet = pendulum.whole, pendulum.robot.feet
    if late == 0.0:
        return np.zeros((len(time), SOLES + 2 * len(feet)))
    soles = [whole.soles[foot][:, :2, 3] for foot in feet]
    inertia = whole.inertia[:, ROWS, COLUMNS]
    rows = np.hstack((whole.com, whole.momentum, whole.momentum_rate, inertia, *soles))
    return np.asarray(late * np.gradient(rows, time, axis=0))


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


def _angular_velocity_jacobian(whole: CentroidalSeries, frames: slice) -> Array:
    """Return the Jacobian (m, 3, 18) of w = I^-1 k by k, its rate and vech I: I dw = dk - dI w."""
    inertia, k = whole.inertia[frames], whole.momentum[frames, 3:]
    w = np.linalg.solve(inertia, k[:, :, None])[..., 0]
    jacobian = np.zeros((len(w), 3, 18))
    jacobian[:, [0, 1, 2], [3, 4, 5]] = 1.0
    for entry, (row, column) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        jacobian[:, row, 12 + entry] -= w[:, column]
        if row != column:
            jacobian[:, column, 12 + entry] -= w[:, row]
    return np.asarray(np.linalg.solve(inertia, jacobian))


def _ground_jacobian(pendulum: Pendulum, frames: NDArray[np.intp], size: int) -> Array:
    """Return the Jacobian (m, 7, r) of CoP, CMP, leg length and angles, by differences."""
    reaction, whole, height = pendulum.reaction, pendulum.whole, pendulum.ground_height
    state = np.hstack(
        (whole.com[frames], reaction.ground_force[frames], whole.momentum_rate[frames, 3:])
    )
    weight = pendulum.robot.mass * STANDARD_GRAVITY
    jacobian = np.zeros((len(frames), 7, size))
    columns = (*range(COM.start, COM.stop), *range(RATE.start, RATE.stop))
    for k, column in enumerate(columns):
        step = np.zeros(9)
        step[k] = STEP if k < 3 else STEP * weight
        ahead, behind = (_ground(state + sign * step, height) for sign in (1.0, -1.0))
        jacobian[:, :, column] = (ahead - behind) / (2.0 * step[k])
    return jacobian


def _ground(state: Array, height: float) -> Array:
    com, force, moment = np.split(state, 3, axis=1)
    cop = centre_of_pressure(com, force, moment, height)
    cmp = centroidal_moment_pivot(com, force, height)
    length, _, angles = leg_of(com, cop)
    return np.column_stack((cop[:, :2], cmp[:, :2], length, angles))


def _margin_jacobian(
    pendulum: Pendulum, margin: SupportMargin, frames: NDArray[np.intp], cop: Array
) -> Array:
    """Return the Jacobian (m, 1, r) of the margin, from that of the CoP (m, 2, r).

    The margin changes with the CoP relative to the edge's nearest point, which is between soles.
    """
    relative = cop.copy()
    for k, name in enumerate(pendulum.feet):
        first = SOLES + 2 * list(pendulum.robot.feet).index(name)
        for xy in range(2):
            relative[:, xy, first + xy] -= margin.weights[frames, k]
    return np.asarray(margin.gradient[frames, None] @ relative)
