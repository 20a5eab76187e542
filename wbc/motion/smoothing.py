"""From a recording to configurations, velocities and accelerations at even times.

A recording is put on an even grid at its own rate (cubic spline, only if it is uneven), filtered
forward and backward, and made a quintic spline, of which values, velocities and accelerations are
read at the rate that is wanted. So nothing is filtered twice: a Savitzky-Golay derivative would be
a second low-pass, with a passband that hangs on its window, whereas the quintic spline's second
derivative is right to (w h)^4 / 360 for a sine of w rad/s sampled every h s (4e-6 at 1 Hz, 200 Hz).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from wbc.errors import InvalidInputError
from wbc.motion.dropouts import check_count, unwrap
from wbc.motion.forces import MeasuredForces
from wbc.motion.planted import planted_base
from wbc.motion.recording import Motion
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.series import Progress
from wbc.rotations import rotations_from
from wbc.validate import Array, finite_number

ORDER = 4  # of the Butterworth filter; run both ways it falls by 48 dB per octave
UNEVEN = 1e-3  # of a step: times less off than this are even, but for rounding
EDGE = 3.0  # periods of the cutoff by which a series is continued beyond its ends,
TERMS = 6  # by a polynomial of so many terms


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A smooth motion at even times."""

    time: Array  # (n,) [s]
    # q, v and acceleration: configurations (n, nq), velocities and their rates (n, nv); the
    # base's in base axes.
    q: Array
    v: Array
    acceleration: Array
    # Planted foot (n,), index among robot.feet; None if the base was recorded.
    planted: NDArray[np.intp] | None


def smooth_trajectory(
    motion: Motion,
    rate: float | None,
    cutoff: float | None,
    planted: str | None,
    height: float,
    progress: Progress | None = None,
) -> Trajectory:
    """Return the trajectory of a recorded motion; see :func:`wbc.motion.analyse`."""
    if (motion.base is None) == (planted is None):
        raise InvalidInputError(
            f"{motion.source}: the base was not recorded; say which foot is planted: left, right or"
            " auto"
            if motion.base is None
            else f"{motion.source}: the base was recorded; leave planted out"
        )
    grid = even_grid(motion.time)
    own_rate = (len(grid) - 1) / float(grid[-1] - grid[0])
    joints = motion.joints.copy()
    base: Array = np.empty((len(motion.time), BASE_NQ))
    base[:] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0) if motion.base is None else motion.base
    unwrap(motion.robot, joints, base[:, 3:])
    rows = np.hstack((base, joints))
    smooth = low_passed(on_grid(motion.time, rows, grid), own_rate, cutoff)
    foot = None
    if planted is not None:
        q = _configurations(motion.robot, smooth)
        found = planted_base(motion.robot, grid, q, planted, height, progress)
        # Where feet take over the base turns a corner, which the joints' filter has not rounded.
        base = low_passed(found.base, own_rate, cutoff) if found.changes else found.base
        smooth, foot = np.hstack((base, smooth[:, BASE_NQ:])), found.foot
    smooth[:, 3:BASE_NQ] /= np.linalg.norm(smooth[:, 3:BASE_NQ], axis=1)[:, None]
    time = grid if rate is None else sampled(grid, finite_number("rate", rate, above=0.0))
    nearest = np.minimum(np.rint((time - grid[0]) * own_rate).astype(int), len(grid) - 1)
    q, v, acceleration = _read_off(motion.robot, grid, smooth, time)
    return Trajectory(time, q, v, acceleration, None if foot is None else foot[nearest])


def smooth_wrenches(forces: MeasuredForces, time: Array, cutoff: float | None) -> dict[str, Array]:
    """Return measured wrenches (m, 6) by foot at some times [s], filtered as the motion is.

    Between rows they are interpolated linearly: forces jump where feet land.
    """
    grid, found = even_grid(forces.time), {}
    rate = (len(grid) - 1) / float(grid[-1] - grid[0])
    for foot, wrench in forces.wrenches.items():
        even = low_passed(_linearly(forces.time, wrench, grid), rate, cutoff)
        found[foot] = _linearly(grid, even, time)
    return found


def _linearly(time: Array, values: Array, at: Array) -> Array:
    """Return values (n, k) at other times (m,), interpolated: (m, k)."""
    return np.column_stack([np.interp(at, time, column) for column in values.T])


def _configurations(robot: Robot, rows: Array) -> Array:
    """Return configurations q (n, nq) of rows (n, nv+1) of base and joint angles."""
    limits = robot.limits
    q = np.empty((len(rows), robot.nq))
    q[:, :BASE_NQ] = rows[:, :BASE_NQ]
    q[:, list(limits.starts)] = rows[:, BASE_NQ:]
    for k in limits.unbounded:
        start, angle = limits.starts[k], rows[:, BASE_NQ + k]
        q[:, start], q[:, start + 1] = np.cos(angle), np.sin(angle)
    return q


def _read_off(robot: Robot, grid: Array, rows: Array, time: Array) -> tuple[Array, Array, Array]:
    """Return q, v and the rate of v at some times, by the spline through rows (m, nv+1)."""
    curve = make_interp_spline(grid, rows, k=5)
    values, first, second = (curve(time, order) for order in range(3))
    quaternion = values[:, 3:BASE_NQ]
    spin, spin_rate = turning(quaternion, first[:, 3:BASE_NQ], second[:, 3:BASE_NQ])
    values[:, 3:BASE_NQ] = quaternion / np.linalg.norm(quaternion, axis=1)[:, None]
    inward = np.swapaxes(rotations_from(values[:, 3:BASE_NQ]), 1, 2)  # from world to base axes
    v, acceleration = np.empty((len(time), robot.nv)), np.empty((len(time), robot.nv))
    v[:, :3] = (inward @ first[:, :3, None])[..., 0]
    v[:, 3:6], v[:, BASE_NV:] = spin, first[:, BASE_NQ:]
    # The axes turn with the base, hence the second term.
    acceleration[:, :3] = (inward @ second[:, :3, None])[..., 0] - np.cross(spin, v[:, :3])
    acceleration[:, 3:6], acceleration[:, BASE_NV:] = spin_rate, second[:, BASE_NQ:]
    return _configurations(robot, values), v, acceleration


# ---------------------------------------------------------------------- sampling and filter


def even_grid(time: Array) -> Array:
    """Return times (m,) in even steps from the first on, at the series' own rate.

    If ``time`` (n,) is even but for rounding, m = n; else the steps are its median step, and the
    last time is left out unless a step hits it.
    """
    count = len(time) - 1
    step = float(time[-1] - time[0]) / count
    even = time[0] + step * np.arange(count + 1)
    if np.abs(time - even).max() <= UNEVEN * step:
        return np.asarray(even)
    return sampled(time, 1.0 / float(np.median(np.diff(time))))


def sampled(time: Array, rate: float) -> Array:
    """Return the times (m,) within ``time`` (n,) at ``rate`` [Hz], from its first on.

    Raises
    ------
    InvalidInputError
        A rate that gives fewer than two frames, or more than can be handled.
    """
    seconds = float(time[-1] - time[0])
    if seconds * rate < 1.0 - 1e-9:
        raise InvalidInputError(
            f"rate: {rate:g} Hz gives but one frame in {seconds:.4g} s; choose a higher one"
        )
    check_count(f"rate: {rate:g} Hz", seconds, 1.0 / rate)
    count = int(np.floor((time[-1] - time[0]) * rate * (1.0 + 1e-12) + 1e-9))
    return np.minimum(time[0] + np.arange(count + 1) / rate, time[-1])


def on_grid(time: Array, values: Array, grid: Array) -> Array:
    """Return values (m, k) at the times of a grid, by a cubic spline through (n, k)."""
    if len(grid) == len(time):
        return values
    return np.asarray(make_interp_spline(time, values, k=3)(grid))


def low_passed(values: Array, rate: float, cutoff: float | None) -> Array:
    """Return values (n, k) after a low-pass at ``cutoff`` [Hz], without delay.

    Butterworth of order 4, run forward and backward: no phase. Its own cutoff is set higher, so
    that both runs together let 1/sqrt(2) of the amplitude at ``cutoff`` pass. Within about a period
    of the cutoff from both ends the values rest on a continuation: the polynomial that fits best
    there, which keeps velocity and acceleration (to 0.5% for a sine of 0.7 Hz at a cutoff of 10 Hz,
    but to 25% for 2 Hz), and the rest mirrored through the last point.

    Raises
    ------
    InvalidInputError
        A cutoff that is not below half the rate, or whose period is longer than the series.
    """
    if cutoff is None:
        return values
    cutoff = finite_number("cutoff", cutoff, above=0.0)
    if cutoff >= 0.5 * rate:
        raise InvalidInputError(
            f"cutoff: {cutoff:g} Hz is not below half the recording's {rate:.6g} Hz; choose a lower"
            " one, or none; or are its times not in s?"
        )
    if cutoff * len(values) < rate:
        raise InvalidInputError(
            f"cutoff: the recording's {len(values) / rate:.4g} s are less than a period of"
            f" {cutoff:g} Hz; choose a higher one, or none"
        )
    # In the bilinear transform's frequency tan(pi f / rate) the digital filter is the analog one.
    warped = np.tan(np.pi * cutoff / rate) / (np.sqrt(2.0) - 1.0) ** (0.5 / ORDER)
    sections = butter(ORDER, 2.0 * np.arctan(warped) / np.pi, output="sos")
    edge = min(len(values) - 1, int(np.ceil(EDGE * rate / cutoff)))
    before, after = _continued(values, edge), _continued(values[::-1], edge)[::-1]
    longer = np.concatenate((before, values, after))
    # Mirrored once more, so that the filter has forgotten how it started when it gets here.
    filtered = sosfiltfilt(sections, longer, axis=0, padtype="odd", padlen=edge)
    return np.asarray(filtered[edge : edge + len(values)])


def _continued(values: Array, count: int) -> Array:
    """Return what might come before values (n, k): (count, k), in order of time."""
    t = np.arange(count + 1) / count
    terms = min(TERMS, count // 2 + 1)
    head, powers = values[: count + 1], np.vander(t, terms)
    trend = np.linalg.lstsq(powers, head, rcond=None)[0]
    rest = head - powers @ trend
    before = np.vander(-t[1:], terms) @ trend + 2.0 * rest[0] - rest[1:]
    return np.asarray(before[::-1])


def turning(quaternion: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Return angular velocity and acceleration (n, 3) in body axes [rad/s, rad/s^2].

    Of the rotation p / |p|, given p and its derivatives (n, 4), xyzw: with conjugate p* and vector
    part [.], w = 2 [p* p'] / |p|^2 and w' = 2 [p* p''] / |p|^2 - w (|p|^2)' / |p|^2.
    """
    square = (quaternion * quaternion).sum(axis=1)[:, None]
    growth = 2.0 * (quaternion * first).sum(axis=1)[:, None]
    w = 2.0 * _conjugate_product(quaternion, first) / square
    return w, 2.0 * _conjugate_product(quaternion, second) / square - w * growth / square


def _conjugate_product(p: Array, r: Array) -> Array:
    """Return the vector part (n, 3) of p* r, quaternions (n, 4) xyzw."""
    a, b = p[:, :3], r[:, :3]
    return p[:, 3:] * b - r[:, 3:] * a - np.cross(a, b)
