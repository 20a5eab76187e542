"""A recorded motion reduced to its reaction mass pendulum, all frames at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.motion.forces import ground_wrench
from wbc.motion.ground import feet_to_check, ground_reaction, standing_feet
from wbc.motion.noise import CorrelatedNoise, Noise
from wbc.motion.planted_base import AUTO
from wbc.motion.recording import Motion
from wbc.motion.series import RmpSeries
from wbc.motion.smoothing import smooth_forces, smooth_trajectory
from wbc.motion.uncertainty import propagate_noise
from wbc.rmp.axes import GAP, TrackedAxes, track, turning_rate
from wbc.robot.limits import BASE_NV
from wbc.robot.series import CentroidalSeries, Progress, centroidal_series
from wbc.robot.tree import refuse_loops
from wbc.spatial import COLUMNS, ROWS
from wbc.validate import Array, finite_array, finite_number

CUTOFF = 10.0  # Hz
ESTIMATED = "estimated"


def analyze(
    motion: Motion,
    *,
    rate: float | None = None,
    cutoff: float | str | None = CUTOFF,
    planted: str | None = None,
    feet: str | Iterable[str] | None = AUTO,
    ground_height: float = 0.0,
    gap: float = GAP,
    noise: Noise | CorrelatedNoise | str | None = ESTIMATED,
    progress: Progress | None = None,
) -> RmpSeries:
    """Return the reaction mass pendulum of a recorded motion, frame by frame.

    The motion is resampled evenly, filtered without delay and differentiated (see
    :mod:`wbc.motion.smoothing`); each frame is then reduced as by :func:`wbc.reduce`, from its
    state and acceleration. The ground's force is that of the soles' sensors if the recording has
    it. Memory: linear in the frames, at its peak some 3.5 kB for each with 25 joints.

    Parameters
    ----------
    rate:
        Frames per second of the series [Hz]; by default those of the recording.
    cutoff:
        Of the low-pass [Hz], for joints and base; None: unfiltered; ``residual``: by residual
        analysis, see :mod:`wbc.motion.smoothing`.
    planted:
        Foot that stands flat, or ``auto`` for the lower one, if the base was not recorded; see
        :func:`wbc.motion.planted_base.planted_base`.
    feet:
        Feet that stand all the time, for the support polygon; or ``auto`` for those of which
        corners are within 1 cm of the ground and do not slide, and the planted one. None: the CoP
        is not checked.
    ground_height:
        Height of the ground [m].
    gap:
        Axes with second moments closer than this fraction of the largest are undefined.
    noise:
        Of the recording, for the series' ``uncertainty``; ``estimated``: from the recording itself,
        see :mod:`wbc.motion.noise`; that of a human's fit (``HumanMotion.noise``); None: no noise,
        and no uncertainty.
    progress:
        Called with frames done and frames in all, every 500 frames; twice with a planted foot.

    Raises
    ------
    InvalidInputError
        Both a recorded base and a planted foot, or neither; a cutoff that is not below half the
        recording's rate, or whose period is longer than the recording; a rate that gives one frame
        or over a million; a number that is not positive; no feet, or a CoM at the CoP.
    UnknownNameError
        A foot that the robot does not have.
    """
    if not isinstance(motion, Motion):
        raise InvalidInputError(
            f"analyze: expected a motion, as read_motion(path, robot) returns it, got"
            f" {shown(motion)}"
        )
    height = finite_number("ground_height", ground_height)
    gap = finite_number("gap", gap, above=0.0)
    robot = motion.robot
    refuse_loops("analyze", robot)
    names = feet_to_check(robot, feet)
    estimated = isinstance(noise, str) and noise == ESTIMATED
    correlated = hasattr(noise, "filtered") and motion.base is not None
    if not (noise is None or estimated or isinstance(noise, Noise) or correlated):
        raise InvalidInputError(
            f"noise: expected a Noise, {ESTIMATED!r} or None, got {shown(noise)}"
        )
    if isinstance(noise, Noise):
        finite_array("noise: joints", noise.joints, (robot.nv - BASE_NV,))
    frames = smooth_trajectory(motion, rate, cutoff, planted, height, noise, progress)
    whole = centroidal_series(robot, frames.q, frames.v, frames.acceleration, progress)
    axes = track(whole.inertia, gap=gap)
    measured = None
    if motion.forces is not None:
        forces = motion.forces
        wrenches = {
            foot: smooth_forces(forces.time, wrench, frames.time, frames.cutoff)
            for foot, wrench in forces.wrenches.items()
        }
        measured = ground_wrench(wrenches, whole)
    reaction = ground_reaction(robot, whole, height, measured)
    fixed = not (isinstance(feet, str) and feet == AUTO)
    standing, margin = standing_feet(
        robot, whole.soles, names, fixed, frames.planted, reaction["flight"],
        reaction["cop"], height, frames.time,
    )  # fmt: skip
    angular_velocity = np.linalg.solve(whole.inertia, whole.momentum[:, 3:, None])[..., 0]
    series = RmpSeries(
        robot=robot,
        source=motion.source,
        dropouts=motion.dropouts,
        ground_height=height,
        measured=measured is not None,
        cutoff=frames.cutoff,
        uncertainty=None,
        time=frames.time,
        q=frames.q,
        v=frames.v,
        acceleration=frames.acceleration,
        com=whole.com,
        com_velocity=whole.momentum[:, :3] / robot.mass,
        com_acceleration=whole.momentum_rate[:, :3] / robot.mass,
        momentum=whole.momentum,
        momentum_rate=whole.momentum_rate,
        **reaction,
        feet=names,
        standing=standing,
        cop_margin=None if margin is None else margin.margin,
        inertia=whole.inertia[:, ROWS, COLUMNS],
        second_moments=axes.second_moments,
        semi_axes=np.sqrt(5.0 / robot.mass * axes.second_moments),
        radii=np.sqrt(3.0 / robot.mass * axes.second_moments),
        axes=axes.axes,
        axes_defined=axes.defined,
        average_angular_velocity=np.asarray(angular_velocity, float),
        axes_angular_velocity=_axes_rate(whole, axes),
    )
    if frames.noise is None:
        return series
    uncertainty = propagate_noise(series, whole, margin, frames, frames.noise)
    return replace(series, uncertainty=uncertainty)


def _axes_rate(whole: CentroidalSeries, axes: TrackedAxes) -> Array:
    """Return the angular velocity of the axes (n, 3), NaN where one is undefined."""
    rate = np.full((len(axes.axes), 3), np.nan)
    defined = axes.defined.all(axis=1)
    rate[defined] = turning_rate(
        whole.inertia[defined], whole.inertia_rate[defined], axes.axes[defined]
    )
    return rate
