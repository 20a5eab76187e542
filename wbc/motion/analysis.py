"""A recorded motion reduced to its reaction mass pendulum, all frames at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wbc.motion.ground_push import GroundPush, chosen_feet, ground_push, judged
from wbc.motion.planted import AUTO
from wbc.motion.recording import Motion
from wbc.motion.series import RmpSeries
from wbc.motion.trajectory import Trajectory, smooth_trajectory
from wbc.rmp.axes import GAP, Bools, TrackedAxes, track, turning_rate
from wbc.robot.series import CentroidalSeries, Progress, centroidal_series
from wbc.spatial import COLUMNS, ROWS
from wbc.validate import Array, finite_number

CUTOFF = 10.0  # Hz


def analyse(
    motion: Motion,
    *,
    rate: float | None = None,
    cutoff: float | None = CUTOFF,
    planted: str | None = None,
    feet: str | Iterable[str] | None = AUTO,
    ground_height: float = 0.0,
    gap: float = GAP,
    progress: Progress | None = None,
) -> RmpSeries:
    """Return the reaction mass pendulum of a recorded motion, frame by frame.

    The motion is sampled evenly, filtered without delay and differentiated (see
    :mod:`wbc.motion.smoothing`); each frame is then what :func:`wbc.reduce` makes of its state and
    acceleration. Memory: linear in the frames, at its peak some 3 kB for each with 25 joints.

    Parameters
    ----------
    rate:
        Frames per second of the series [Hz]; by default those of the recording.
    cutoff:
        Of the low-pass [Hz], for joints and base; None leaves the motion unfiltered.
    planted:
        Foot that stands flat, or ``auto`` for the lower one, if the base was not recorded; see
        :func:`wbc.motion.planted.planted_base`.
    feet:
        Feet that stand all the time, for the support polygon; or ``auto`` for those whose sole is
        within 1 cm of the ground, and the planted one. None: the CoP is not judged.
    ground_height:
        Height of the ground [m].
    gap:
        Axes with second moments closer than this fraction of the largest are undefined.
    progress:
        Called with frames done and frames in all, every 500 frames; with a planted foot twice over.

    Raises
    ------
    InvalidInputError
        Both a recorded base and a planted foot, or neither; a cutoff that is not below half the
        recording's rate, or whose period is longer than the recording; a rate that gives one frame
        or over a million; a number that is not positive; no feet, or a CoM at the CoP.
    UnknownNameError
        A foot that the robot does not have.
    """
    height = finite_number("ground_height", ground_height)
    gap = finite_number("gap", gap, above=0.0)
    robot = motion.robot
    names = chosen_feet(robot, feet)
    frames = smooth_trajectory(motion, rate, cutoff, planted, height, progress)
    whole = centroidal_series(robot, frames.q, frames.v, frames.acceleration, progress)
    axes = track(whole.inertia, gap=gap)
    push = ground_push(robot, whole, height)
    standing, margin = judged(robot, whole, names, feet != AUTO, frames.planted, push, height)
    return _series(motion, frames, whole, axes, push, _Support(names, standing, margin), height)


@dataclass(frozen=True, eq=False)
class _Support:
    """Feet that are judged, which of them stand (n, f), and the CoP's margin (n,) or None."""

    feet: tuple[str, ...]
    standing: Bools
    margin: Array | None


def _series(
    motion: Motion,
    frames: Trajectory,
    whole: CentroidalSeries,
    axes: TrackedAxes,
    push: GroundPush,
    support: _Support,
    height: float,
) -> RmpSeries:
    """Return all of it under the names that RmpState uses."""
    robot = motion.robot
    spin = np.linalg.solve(whole.inertia, whole.momentum[:, 3:, None])[..., 0]
    return RmpSeries(
        robot=robot,
        source=motion.source,
        dropouts=motion.dropouts,
        ground_height=height,
        time=frames.time,
        q=frames.q,
        v=frames.v,
        acceleration=frames.acceleration,
        com=whole.com,
        com_velocity=whole.momentum[:, :3] / robot.mass,
        com_acceleration=whole.momentum_rate[:, :3] / robot.mass,
        momentum=whole.momentum,
        momentum_rate=whole.momentum_rate,
        ground_force=push.force,
        ground_moment=push.moment,
        cop=push.cop,
        cmp=push.cmp,
        flight=push.flight,
        feet=support.feet,
        standing=support.standing,
        cop_margin=support.margin,
        leg_length=push.leg_length,
        leg_direction=push.leg_direction,
        leg_angles=push.leg_angles,
        inertia=whole.inertia[:, ROWS, COLUMNS],
        second_moments=axes.second_moments,
        semi_axes=np.sqrt(5.0 / robot.mass * axes.second_moments),
        radii=np.sqrt(3.0 / robot.mass * axes.second_moments),
        axes=axes.axes,
        axes_defined=axes.defined,
        average_angular_velocity=spin,
        axes_angular_velocity=_axes_rate(whole, axes),
    )


def _axes_rate(whole: CentroidalSeries, axes: TrackedAxes) -> Array:
    """Return the angular velocity of the axes (n, 3), NaN where one is undefined."""
    rate = np.full((len(axes.axes), 3), np.nan)
    clear = axes.defined.all(axis=1)
    rate[clear] = turning_rate(whole.inertia[clear], whole.inertia_rate[clear], axes.axes[clear])
    return rate
