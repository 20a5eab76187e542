"""Comparison of a human's ground forces with force plates, where these measure all of the force.

The forces are of the motion alone; of the plates it takes only the mass, where that is not given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, binary_opening

from wbc.human.contacts import nearest_rows
from wbc.human.markers import ForcePlate
from wbc.motion.dropouts import runs
from wbc.motion.ground import sole_corners
from wbc.motion.series import RmpSeries
from wbc.motion.smoothing import smooth_forces
from wbc.motion.uncertainty import BAND
from wbc.polygon import convex_hull, polygon_margin
from wbc.rmp.ground import centre_of_pressure
from wbc.robot.series import sole_series
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import Array, Bools

MIN_PLATE_FORCE = 20.0  # N: a plate with less is unloaded
LOAD_CUTOFF = 20.0  # Hz, of the forces by which it is: above is the noise of amplifiers
MAX_COP_DISTANCE = 0.15  # m, of a plate's CoP from a sole that stands on it
MAX_OVERHANG = 0.02  # m: a sole farther over the plates' edge stands partly beside them
MIN_EXCLUSIVE = 0.5  # s of the CoP under only one foot: then the other is not on that plate
TOUCHDOWN_TOLERANCE = 0.06  # s between a touchdown on a plate and by the motion
FILTER_REACH = 0.4  # of the low-pass' period: reach of an unmeasured force into other frames
MIN_FRAMES = 5
# Standard deviation of the weighed mass over frames, by the mass: 0.02 to 0.05 in walks, 0.08 in
# runs. With more something else carries the human in some frames.
MAX_MASS_SPREAD = 0.1
MAX_STRAY = 0.25  # of the frames with plate forces; more away from feet are noted
MIN_LOAD = 0.3  # of the weight: with less both CoPs are ill-defined
MIN_FORCE_CHANGE = 0.1  # of its peak: a vertical force that changes less tells no delay


@dataclass(frozen=True, eq=False)
class Comparison:
    """A motion's ground force and CoP less those of force plates, in m frames.

    Attributes
    ----------
    time:
        (m,) [s]: frames in which every foot that is down stands on a plate.
    force, cop:
        Of the plates (m, 3) [N], (m, 2) [m], low-passed as the motion is.
    force_error, cop_error:
        Of the motion, less those.
    single:
        Whether one foot is down (m,), rather than two.
    late:
        Delay of the plates' vertical force after the motion's [s], by least squares; NaN where it
        hardly changes, as in standing.
    held:
        Parts of the frames with the plates inside the motion's 95 % bands, by ``force x``,
        ``force y``, ``force z``, ``cop x``, ``cop y``; empty without bands.
    """

    time: Array
    force: Array
    cop: Array
    force_error: Array
    cop_error: Array
    single: Bools
    late: float
    held: dict[str, float]

    @property
    def vertical(self) -> float:
        """Rms error of the vertical force, as a part of its peak."""
        return float(_rms(self.force_error[:, 2]) / self.force[:, 2].max())

    @property
    def horizontal(self) -> float:
        """Rms error of the horizontal force, a vector, as a part of its peak."""
        peak = np.linalg.norm(self.force[:, :2], axis=1).max()
        return float(_rms(np.linalg.norm(self.force_error[:, :2], axis=1)) / peak)

    def cop_rms(self, single: bool) -> float:
        """Rms distance of the CoPs in single or double support [m]; NaN without such frames."""
        frames = self.single == single
        if not frames.any():
            return float("nan")
        return _rms(np.linalg.norm(self.cop_error[frames], axis=1))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def compared(
    series: RmpSeries, plates: tuple[ForcePlate, ...], down: Bools, time: Array
) -> Comparison | None:
    """Return a comparison with force plates, or None if these never measure all of the force.

    Parameters
    ----------
    down:
        Which feet are down (n, f) at times ``time`` (n,) [s].
    """
    if not plates:
        return None
    feet = down[nearest_rows(time, series.time)]
    complete, force, moment, _ = _measured(plates, series, feet)
    complete &= force[:, 2] > MIN_LOAD * series.robot.weight
    if complete.sum() < MIN_FRAMES:
        return None
    force, moment = force[complete], moment[complete]
    cop = centre_of_pressure(np.zeros_like(force), force, moment, series.ground_height)
    rate = np.gradient(series.ground_force[:, 2], series.time)[complete]
    error, cop_error = series.ground_force[complete] - force, series.cop[complete] - cop
    changes = np.ptp(force[:, 2]) > MIN_FORCE_CHANGE * force[:, 2].max()
    return Comparison(
        time=series.time[complete],
        force=force,
        cop=cop[:, :2],
        force_error=error,
        cop_error=cop_error[:, :2],
        single=feet[complete].sum(axis=1) == 1,
        late=float(error[:, 2] @ rate / (rate @ rate)) if changes else float("nan"),
        held=_within_bands(series, complete, error, cop_error),
    )


def plates_mass(
    series: RmpSeries, plates: tuple[ForcePlate, ...], down: Bools
) -> tuple[float | None, tuple[str, ...]]:
    """Return a human's mass [kg]: the plates' vertical force by g + c'', both summed over time.

    None if the plates never measure all of the force. And notes: if a plate often pushes away from
    the feet, and if the mass varies, as of a human who sits at times; then it is the median.

    ``down``: which feet are down (n, f) in the series' frames.
    """
    if not plates:
        return None, ()
    complete, force, _, stray = _measured(plates, series, down)
    pushed = force[:, 2] > MIN_PLATE_FORCE
    part = float((stray & pushed).sum() / max(1, pushed.sum()))
    what = f"force plates push where no foot is in {100 * part:.0f} % of the frames"
    why = "their origin, axes or clock are not the markers', or something else pushes"
    notes = (f"{what}: {why}",) if part > MAX_STRAY else ()
    complete &= pushed
    if complete.sum() < MIN_FRAMES:
        return None, notes
    per_mass = STANDARD_GRAVITY + series.com_acceleration[complete, 2]
    up = force[complete, 2]
    each = up / np.maximum(per_mass, MIN_LOAD * STANDARD_GRAVITY)
    if each.std() < MAX_MASS_SPREAD * each.mean():
        return float(up.sum() / per_mass.sum()), notes
    least, mass, most = np.quantile(each, (0.05, 0.5, 0.95))
    return float(mass), (
        *notes,
        f"force plates carry {least:.0f} to {most:.0f} kg: something else, as a seat, carries the"
        " human at times, or their clock is not the markers'; the median is taken, give mass",
    )


def _over_the_edge(plates: tuple[ForcePlate, ...], corners: Array) -> Bools:
    """Return which feet (n, f), of corners (n, f, k, 2), overhang plates with known corners."""
    outside = np.ones(corners.shape[:-1], dtype=bool)
    for plate in plates:
        if plate.corners is None:
            return np.zeros(corners.shape[:2], dtype=bool)
        outside &= polygon_margin(convex_hull(plate.corners[:, :2]), corners) < -MAX_OVERHANG
    return np.asarray(outside.any(axis=2))


def _measured(
    plates: tuple[ForcePlate, ...], series: RmpSeries, down: Bools
) -> tuple[Bools, Array, Array, Bools]:
    """Return in which frames the plates measure all of the force, the force and moment (n, 3).

    And in which frames one of them pushes away from the feet.
    """
    time = series.time
    dt = float(time[1] - time[0])
    placed = sole_series(series.robot, series.q)
    soles = np.stack([placed[foot][:, :2, 3] for foot in series.robot.feet], axis=1)
    overhanging = _over_the_edge(plates, sole_corners(series.robot, placed)[..., :2])
    on, carried = np.zeros((2, *down.shape), dtype=bool)
    force, moment = np.zeros((2, len(time), 3))
    inside, stray = np.ones(len(time), dtype=bool), np.zeros(len(time), dtype=bool)
    for plate in plates:
        f, m = _resampled(plate, time, series.cutoff)
        force, moment = force + f, moment + m
        inside &= (time >= plate.time[0]) & (time <= plate.time[-1])
        rate = 1.0 / float(np.median(np.diff(plate.time)))
        raw, raw_moment = _resampled(plate, time, min(LOAD_CUTOFF, 0.45 * rate))
        loaded = raw[:, 2] > MIN_PLATE_FORCE
        vertical = np.where(loaded, raw[:, 2], 1.0)[:, None]
        cop = np.column_stack((-raw_moment[:, 1], raw_moment[:, 0])) / vertical
        cop += raw[:, :2] / vertical * series.ground_height
        reach = 0.5 * max(np.ptp(foot.polygon, axis=0).max() for foot in series.robot.feet.values())
        near = np.linalg.norm(soles - cop[:, None], axis=2) < reach + MAX_COP_DISTANCE
        under = _inside_soles(series, placed, cop)
        carries = near & (under | ~under.any(axis=1, keepdims=True))
        # A CoP between the feet, under neither of them, is of both, while they stand there.
        between = loaded & ~near.any(axis=1) & _is_between(soles, cop)
        for first, end in runs(np.asarray(down.all(axis=1))):
            if between[first:end].any():
                near[first:end] = carries[first:end] = True
        on |= near & loaded[:, None]
        carried |= carries & loaded[:, None]
        stray |= loaded & ~near.any(axis=1)
    # If the CoP of a plate is under one foot for longer than a step takes, the other stands beside.
    exclusive = np.ones((max(1, round(MIN_EXCLUSIVE / dt)), 1), dtype=bool)
    on &= ~binary_opening(on & down & ~carried, exclusive)
    tolerance = max(1, round(TOUCHDOWN_TOLERANCE / dt))
    around = np.ones((2 * tolerance + 1, 1), dtype=bool)
    measured = binary_dilation(on, around) | ~down
    complete = measured.all(axis=1) & (on & down).any(axis=1) & inside & ~stray
    complete &= ~(overhanging & down).any(axis=1)
    margin = tolerance + (0 if series.cutoff is None else round(FILTER_REACH / series.cutoff / dt))
    complete = np.asarray(binary_erosion(complete, np.ones(2 * margin + 1, dtype=bool)))
    return complete, force, moment, stray


def _is_between(soles: Array, points: Array) -> Bools:
    """Return which points (n, 2) are near the lines between two soles (n, 2, 2) [m]."""
    start, way = soles[:, 0], soles[:, 1] - soles[:, 0]
    along = ((points - start) * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-12)
    off = points - start - np.clip(along, 0.0, 1.0)[:, None] * way
    return np.asarray(np.linalg.norm(off, axis=1) < MAX_COP_DISTANCE)


def _inside_soles(series: RmpSeries, placed: Mapping[str, Array], points: Array) -> Bools:
    """Return which soles (n, f) cover points (n, 2) of the ground [m]."""
    found = []
    for name, foot in series.robot.feet.items():
        arm = points - placed[name][:, :2, 3]
        local = (np.swapaxes(placed[name][:, :2, :2], 1, 2) @ arm[..., None])[..., 0]
        found.append(polygon_margin(foot.polygon, local) > 0.0)
    return np.stack(found, axis=1)


def _resampled(plate: ForcePlate, time: Array, cutoff: float | None) -> tuple[Array, Array]:
    """Return force and moment (n, 3) of a plate at some times, low-passed."""
    values = np.hstack((plate.force, plate.moment))
    found = smooth_forces(plate.time, values, time, cutoff)
    return found[:, :3], found[:, 3:]


def _within_bands(series: RmpSeries, frames: Bools, force: Array, cop: Array) -> dict[str, float]:
    noise = series.uncertainty
    if noise is None:
        return {}
    parts = ("force", "xyz", force, noise.momentum_rate), ("cop", "xy", cop, noise.cop)
    return {
        f"{name} {axis}": float((np.abs(error[:, k]) <= BAND * deviation[frames, k]).mean())
        for name, axes, error, deviation in parts
        for k, axis in enumerate(axes)
    }
