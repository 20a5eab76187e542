"""A human's motion against force plates: where they have all of the ground's force, and how near.

From the motion alone; the plates tell nothing but the body's mass, where it is not given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, binary_opening

from wbc.human.contacts import Bools, nearest_rows
from wbc.human.markers import ForcePlate
from wbc.motion.ground import sole_corners
from wbc.motion.series import RmpSeries
from wbc.motion.smoothing import smooth_forces
from wbc.motion.uncertainty import BAND
from wbc.polygon import convex_hull, polygon_margin
from wbc.rmp.ground import centre_of_pressure
from wbc.robot.series import sole_series
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import Array

LOADED = 20.0  # N: a plate that is pushed less is empty
BESIDE = 0.15  # m: how far a plate's CoP may be from a sole that stands on it
BEYOND = 0.02  # m: a sole that reaches farther over the plates' edge stands beside them in part
STANDS = 0.5  # s: for so long the CoP is not under one foot of two that stand on a plate
LATE = 0.06  # s: how much a foot's landing on a plate and its landing by the motion may differ
SMEARED = 0.4  # of the low-pass' period: how far a force that no plate has reaches into others
LEAST_FRAMES = 5
ASTRAY = 0.25  # of the frames in which plates push: where no foot is, that is told
PRESSED = 0.3  # of the weight: below it neither CoP means much
CHANGES = 0.1  # of its peak: a vertical force that changes by less tells nothing of clocks


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
        By how much the plates' vertical force comes later than the motion's [s], by least squares;
        NaN where it hardly changes, as of who stands still.
    held:
        Parts of the frames in which the plates are within the motion's 95 % bands, by ``force x``,
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
        level = np.linalg.norm(self.force[:, :2], axis=1).max()
        return float(_rms(np.linalg.norm(self.force_error[:, :2], axis=1)) / level)

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
    """Return a series against force plates, or None if they never have all of the force.

    Parameters
    ----------
    down:
        Which feet are down (n, f) at times ``time`` (n,) [s].
    """
    if not plates:
        return None
    feet = down[nearest_rows(time, series.time)]
    whole, force, moment, _ = _complete(plates, series, feet)
    whole &= force[:, 2] > PRESSED * series.robot.weight
    if whole.sum() < LEAST_FRAMES:
        return None
    force, moment = force[whole], moment[whole]
    cop = centre_of_pressure(np.zeros_like(force), force, moment, series.ground_height)
    rate = np.gradient(series.ground_force[:, 2], series.time)[whole]
    error, off = series.ground_force[whole] - force, series.cop[whole] - cop
    changes = np.ptp(force[:, 2]) > CHANGES * force[:, 2].max()
    return Comparison(
        time=series.time[whole],
        force=force,
        cop=cop[:, :2],
        force_error=error,
        cop_error=off[:, :2],
        single=feet[whole].sum(axis=1) == 1,
        late=float(error[:, 2] @ rate / (rate @ rate)) if changes else float("nan"),
        held=_held(series, whole, error, off),
    )


def plates_mass(
    series: RmpSeries, plates: tuple[ForcePlate, ...], down: Bools
) -> tuple[float | None, tuple[str, ...]]:
    """Return a human's mass [kg]: the plates' vertical force by g + c'', both summed over time.

    None if the plates never have all of the force. And a note if one of them often pushes where no
    foot is.

    Parameters
    ----------
    down:
        Which feet are down (n, f) in the series' frames.
    """
    if not plates:
        return None, ()
    whole, force, _, stray = _complete(plates, series, down)
    pushed = force[:, 2] > LOADED
    part = float((stray & pushed).sum() / max(1, pushed.sum()))
    what = f"force plates push where no foot is in {100 * part:.0f} % of the frames"
    why = "their origin, axes or clock are not the markers', or something else pushes"
    told = (f"{what}: {why}",) if part > ASTRAY else ()
    whole &= pushed
    if whole.sum() < LEAST_FRAMES:
        return None, told
    needed = STANDARD_GRAVITY + series.com_acceleration[whole, 2]
    return float(force[whole, 2].sum() / needed.sum()), told


def _beyond(plates: tuple[ForcePlate, ...], corners: Array) -> Bools:
    """Return which feet (n, f), of corners (n, f, k, 2), reach beyond the plates, if those say."""
    beyond = np.ones(corners.shape[:-1], dtype=bool)
    for plate in plates:
        if plate.corners is None:
            return np.zeros(corners.shape[:2], dtype=bool)
        beyond &= polygon_margin(convex_hull(plate.corners[:, :2]), corners) < -BEYOND
    return np.asarray(beyond.any(axis=2))


def _complete(
    plates: tuple[ForcePlate, ...], series: RmpSeries, down: Bools
) -> tuple[Bools, Array, Array, Bools]:
    """Return in which frames the plates have all of the force, the force and its moment (n, 3).

    And in which frames one of them pushes where no foot is.
    """
    time = series.time
    step = float(time[1] - time[0])
    placed = sole_series(series.robot, series.q)
    soles = np.stack([placed[foot][:, :2, 3] for foot in series.robot.feet], axis=1)
    beyond = _beyond(plates, sole_corners(series.robot, placed)[..., :2])
    on, carried = np.zeros((2, *down.shape), dtype=bool)
    force, moment = np.zeros((2, len(time), 3))
    inside = np.ones(len(time), dtype=bool)
    stray = np.zeros(len(time), dtype=bool)
    for plate in plates:
        f, m = _at(plate, time, series.cutoff)
        force, moment = force + f, moment + m
        inside &= (time >= plate.time[0]) & (time <= plate.time[-1])
        raw, turning = _at(plate, time, None)
        loaded = raw[:, 2] > LOADED
        lift = np.where(loaded, raw[:, 2], 1.0)
        spot = np.column_stack((-turning[:, 1], turning[:, 0])) / lift[:, None]
        spot += raw[:, :2] / lift[:, None] * series.ground_height
        reach = 0.5 * max(np.ptp(foot.polygon, axis=0).max() for foot in series.robot.feet.values())
        near = np.linalg.norm(soles - spot[:, None], axis=2) < reach + BESIDE
        under = _under(series, placed, spot)
        on |= near & loaded[:, None]
        carried |= near & loaded[:, None] & (under | ~under.any(axis=1, keepdims=True))
        stray |= loaded & ~near.any(axis=1)
    for_long = np.ones((max(1, round(STANDS / step)), 1), dtype=bool)
    on &= ~binary_opening(on & down & ~carried, for_long)
    late = max(1, round(LATE / step))
    around = np.ones((2 * late + 1, 1), dtype=bool)
    covered = binary_dilation(on, around) | ~down
    whole = covered.all(axis=1) & (on & down).any(axis=1) & inside & ~stray
    whole &= ~(beyond & down).any(axis=1)
    apart = late + (0 if series.cutoff is None else round(SMEARED / series.cutoff / step))
    whole = np.asarray(binary_erosion(whole, np.ones(2 * apart + 1, dtype=bool)))
    return whole, force, moment, stray


def _under(series: RmpSeries, placed: Mapping[str, Array], spot: Array) -> Bools:
    """Return which soles (n, f) points (n, 2) of the ground [m] are under.

    A foot that has the CoP of a plate under it for long, and not only in a step, is what stands
    there: the other one, if it is down, stands beside.
    """
    found = []
    for name, foot in series.robot.feet.items():
        arm = spot - placed[name][:, :2, 3]
        local = (np.swapaxes(placed[name][:, :2, :2], 1, 2) @ arm[..., None])[..., 0]
        found.append(polygon_margin(foot.polygon, local) > 0.0)
    return np.stack(found, axis=1)


def _at(plate: ForcePlate, time: Array, cutoff: float | None) -> tuple[Array, Array]:
    """Return force and moment (n, 3) of a plate at some times, low-passed."""
    values = np.hstack((plate.force, plate.moment))
    found = smooth_forces(plate.time, values, time, cutoff)
    return found[:, :3], found[:, 3:]


def _held(series: RmpSeries, whole: Bools, force: Array, cop: Array) -> dict[str, float]:
    if series.uncertainty is None:
        return {}
    bands = {"force": series.uncertainty.momentum_rate, "cop": series.uncertainty.cop}
    errors = {"force": force, "cop": cop}
    return {
        f"{name} {axis}": float((np.abs(errors[name][:, k]) <= BAND * bands[name][whole, k]).mean())
        for name, axes in (("force", "xyz"), ("cop", "xy"))
        for k, axis in enumerate(axes)
    }
