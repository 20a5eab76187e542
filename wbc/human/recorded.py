"""From markers to a human's motion: who moves, how, and how well that fits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, listed
from wbc.human.anthropometry import MEAN_BODY_MASS_INDEX, check_build, check_sex
from wbc.human.body import HumanBody
from wbc.human.calibration import KEY_FRAMES, Calibration, calibrate, key_frames
from wbc.human.comparison import plates_mass
from wbc.human.contacts import Bools, chosen_cutoff, feet_down, nearest_rows
from wbc.human.fit import MarkerSet, continuous, fit_poses, residuals, unstuck, upright_trunk
from wbc.human.gaps import (
    filled_by_fit,
    filled_shortly,
    unswapped,
    while_shown,
    without_ghosts,
    without_leaps,
)
from wbc.human.kinematics import Poses, place
from wbc.human.known import known_markers, other_human, upright
from wbc.human.landmarks import Landmark, tells_trunk
from wbc.human.markers import MarkerRecording
from wbc.human.residual_noise import ResidualNoise, residual_noise
from wbc.human.rolling import SWAY, SWAY_OF_LEGS, moved_by_steps
from wbc.human.skeleton import configurations, human_robot
from wbc.human.soles import ground_and_soles
from wbc.human.subjects import of_subject
from wbc.human.treadmill import belt_velocity, from_the_belt
from wbc.kinds import check_kind
from wbc.motion.analysis import analyze
from wbc.motion.dropouts import Dropout
from wbc.motion.filtering import low_passed
from wbc.motion.recording import LONGEST_GAP, Motion
from wbc.motion.series import RmpSeries
from wbc.motion.smoothing import even_grid, on_grid
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import sole_series
from wbc.validate import Array, finite_number

STATIC_FRAMES = 6  # of a static trial, which hardly differ
LEAST_CUTOFF_PERIODS = 2.0
OFFSET = 2.0  # N: of an unloaded plate, that is told
HEAVIER = 0.05  # of the mass that was said: plates that weigh another one say so
FASTEST = 13.0  # m/s: of a human on its own feet, and some more
PULLS, SOMETIMES = 1.0, 0.05  # of the weight, in this part of the frames: no ground pulls
SLOWEST_CUTOFF = 3.0  # Hz: with a lower one, by few frames a second, forces of steps are lost
NO_HUMAN = 0.06  # m rms: a fit of which no figure is to be believed


@dataclass(frozen=True, eq=False)
class HumanMotion:
    """A human's motion, fitted to markers; made by :func:`wbc.human.human_motion`.

    Attributes
    ----------
    motion:
        For :func:`wbc.analyze`; its robot is the human.
    body:
        The human's dimensions, mass, stature and sex.
    recording:
        The markers, z up, gaps filled; and force plates.
    markers:
        Names and places of those that were fitted, in the order of ``residual``.
    residual:
        (n, m, 3) [m]: where the fit has markers less where they were seen; NaN where not seen.
    down:
        Which feet touch the ground (n, f), by height and speed.
    cutoff:
        Low-pass for this motion [Hz], 2.4 times its steps per second, 6 Hz without steps.
    ground_height:
        Height of the ground [m].
    noise:
        What markers and skin leave uncertain of the posture, for ``analyze(noise=...)``.
    notes:
        What was guessed, left out and tolerated, in words.
    """

    motion: Motion
    body: HumanBody
    recording: MarkerRecording
    markers: MarkerSet
    residual: Array
    down: Bools
    cutoff: float
    ground_height: float
    noise: ResidualNoise
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        span = f"{len(self.motion.time)} frames, {1e3 * self.rms:.1f} mm rms"
        return f"HumanMotion({self.body!r}, {span})"

    @property
    def rms(self) -> float:
        """Root mean square of all markers' residuals [m]."""
        return float(np.sqrt(np.nanmean((self.residual**2).sum(axis=2))))

    @property
    def rms_by_marker(self) -> dict[str, float]:
        """The same marker by marker [m], without those that were never seen."""
        squares = (self.residual**2).sum(axis=2)
        return {
            name: float(np.sqrt(np.nanmean(column)))
            for name, column in zip(self.markers.names, squares.T, strict=True)
            if np.isfinite(column).any()
        }


def human_motion(
    recording: MarkerRecording,
    *,
    static: MarkerRecording | None = None,
    subject: str | None = None,
    mass: float | None = None,
    stature: float | None = None,
    sex: str = "male",
    up: str | None = None,
    ground_height: float | None = None,
    longest_gap: float = LONGEST_GAP,
    by_steps: bool = True,
) -> HumanMotion:
    """Fit a human of rigid segments to markers.

    Which marker is where is known by its name (see :mod:`wbc.human.landmarks`). Dimensions, places
    of markers and postures of some frames are adjusted together, then all frames are fitted.

    Parameters
    ----------
    static:
        A trial in which the human stands, of the same body, one frame or more; may have more
        markers (``read_markers(path, standing=True)``).
    subject:
        Whose markers, where there are several humans': what stands before the colon of its labels.
    mass:
        [kg]; None: what the force plates weighed, or without them by the stature.
    stature:
        [m]; None: by the lengths found.
    sex:
        ``male`` or ``female``, which table of segments is taken.
    up:
        Vertical axis of the file, ``x``, ``y`` or ``z``; None: the recording's, or the one from
        feet to trunk.
    ground_height:
        [m]; None: 0, unless the feet say otherwise.
    longest_gap:
        Longest time [s] over which a marker that was not seen is interpolated; over longer ones it
        follows the fit.
    by_steps:
        Whether the body is moved by some mm to where its CoP rolls over the soles in steps; see
        :mod:`wbc.human.rolling`.

    Raises
    ------
    RecordingError
        Markers that a fit cannot do without are not there by any name known; several humans; no
        axis is up.
    UnknownNameError
        No subject of that name.
    InvalidInputError
        Numbers that are not positive, mass or stature of no human, another sex or axis.
    """
    example = "read_markers(path)"
    check_kind("human_motion, recording", recording, MarkerRecording, example)
    check_kind("human_motion, static", static, MarkerRecording, example, or_none=True)
    check_sex(sex)
    recording.check_moving()
    longest_gap = finite_number("longest_gap", longest_gap, least=0.0)
    mass, stature = check_build(mass, stature)
    recording, static, names, marks, notes = _known(recording, static, subject, up)
    still = _static(static, names, up, marks)
    seen = _followed(recording, still, names, marks, stature, longest_gap)
    found, poses, time = seen.found, seen.poses, recording.time
    body = HumanBody(found.dimensions, 70.0 if mass is None else mass, found.stature, sex)
    ground, soles, told = ground_and_soles(place(poses, body.dimensions), time, body, ground_height)
    notes += found.notes + told
    robot = human_robot(body, soles)
    q = configurations(robot, poses)
    motion = _motion(robot, recording, q, seen.dropouts)
    down, cutoff = _contacts(motion, q, ground)
    weighed = None
    if cutoff * (time[-1] - time[0]) > LEAST_CUTOFF_PERIODS:
        series = analyze(motion, cutoff=cutoff, noise=None, feet=None, ground_height=ground)
        standing = down[nearest_rows(time, series.time)]
        weighed, told = plates_mass(series, recording.plates, standing)
        notes += told + _pull_note(series) + _rate_note(recording.rate, cutoff)
        if by_steps:
            sway = SWAY if seen.trunk else SWAY_OF_LEGS
            moves, told = moved_by_steps(series, standing, found.stature, sway)
            q[:, :2] += np.column_stack([np.interp(time, series.time, one) for one in moves.T])
            notes += told
    if mass is None:
        guess = MEAN_BODY_MASS_INDEX[sex] * found.stature**2
        notes += _mass_note(weighed, guess, bool(recording.plates))
        body = replace(body, mass=guess if weighed is None else weighed)
        robot = human_robot(body, soles)
    elif weighed is not None and abs(weighed - mass) > HEAVIER * mass:
        notes += (f"the force plates weighed {weighed:.1f} kg, {mass:g} kg was said",)
    motion = _motion(robot, recording, q, seen.dropouts)
    fit = seen.residual
    notes += _fit_note(fit) + _speed_note(time, q[:, :3])
    noise = residual_noise(time, poses, seen.observed, fit, found.markers, found.dimensions, robot)
    return HumanMotion(
        motion, body, recording, found.markers, fit, down, cutoff, ground, noise, notes
    )


def _known(
    recording: MarkerRecording, static: MarkerRecording | None, subject: str | None, up: str | None
) -> tuple[
    MarkerRecording, MarkerRecording | None, tuple[str, ...], tuple[Landmark, ...], tuple[str, ...]
]:
    """Return the recording of one human on still ground, z up, its markers, and notes."""
    recording, told = of_subject(recording, subject)
    if static is not None and any(":" in label for label in static.labels):
        static, _ = of_subject(static, subject)
    names, marks, notes = known_markers(recording, static)
    if static is not None:
        notes += other_human(recording, static, names, marks)
    recording, shown = while_shown(recording, names)
    recording, leaps = without_leaps(recording, names)
    recording, axis = upright(recording, names, marks, up)
    recording, offsets = _tared(recording)
    notes = (*recording.notes, *told, *notes, *shown, *leaps, *offsets)
    belt = belt_velocity(recording, names, marks)
    if belt.any():
        recording = from_the_belt(recording, belt)
        speed = float(np.linalg.norm(belt))
        notes += (f"feet that stand move at {speed:.2f} m/s: a treadmill, seen from its belt",)
    return recording, static, names, marks, notes + axis


def _tared(recording: MarkerRecording) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording with plates that read nothing while nothing stands on them, notes."""
    tared = [plate.tared() for plate in recording.plates]
    plates = tuple(plate for plate, _ in tared)
    offsets = [f"{plate.name} {force:.0f} N" for plate, force in tared if force > OFFSET]
    notes = [f"taken off what unloaded plates read: {listed(offsets, 8)}"] if offsets else []
    largest = sum(np.abs(plate.force).max(axis=0) for plate in plates)
    if plates and max(largest[:2]) > largest[2]:
        notes.append(
            "force plates push sideways more than up: their file has other axes than the markers'"
        )
    return recording.with_plates(plates), tuple(notes)


class _Followed(NamedTuple):
    """Postures that follow markers, and what is left."""

    found: Calibration
    poses: Poses
    observed: Array  # (n, m, 3) [m], mended
    residual: Array  # (n, m, 3) [m], NaN where not seen
    dropouts: tuple[Dropout, ...]
    trunk: bool  # whether markers tell how it leans


def _followed(
    recording: MarkerRecording, still: Array, names: tuple[str, ...], marks: tuple[Landmark, ...],
    stature: float | None, longest_gap: float,
) -> _Followed:  # fmt: skip
    """Return what follows the markers of a recording, z up, with frames of a static trial."""
    time = recording.time
    columns = [recording.labels.index(n) for n in names if n in recording.labels]
    own = names[: len(columns)]
    given = recording.landmarks or (None,) * len(recording.labels)
    fixed = np.array([given[k] is not None for k in columns])
    observed, swaps = unswapped(time, recording.positions[:, columns], own, fixed)
    observed, gaps = filled_shortly(time, observed, own, longest_gap)
    extra = len(names) - len(columns)
    observed = np.concatenate((observed, np.full((len(time), extra, 3), np.nan)), axis=1)
    frames = key_frames(observed, KEY_FRAMES)
    found = calibrate(np.concatenate((still, observed[frames])), names, marks, stature)
    poses = _fitted(found, len(still), frames, observed)
    observed, more = _repaired(time, observed, poses, found)
    if more:
        poses, _ = fit_poses(poses, observed, found.markers, found.dimensions)
        poses = continuous(poses)
    fit = residuals(poses, observed, found.markers, found.dimensions)
    trunk = tells_trunk(marks[: len(columns)])
    if not trunk:
        poses = upright_trunk(poses)
    lost = ~np.isfinite(recording.positions[:, columns]).all(axis=2)
    fit[:, : len(columns)][lost] = np.nan
    dropouts = tuple(sorted((*swaps, *gaps, *more), key=lambda one: one.start))
    return _Followed(found, poses, observed, fit, dropouts, trunk)


def _static(
    static: MarkerRecording | None,
    names: tuple[str, ...],
    up: str | None,
    marks: tuple[Landmark, ...],
) -> Array:
    """Return frames (k, m, 3) of a static trial, z up; none without one."""
    if static is None:
        return np.zeros((0, len(names), 3))
    mine = tuple(name for name in names if name in static.labels)
    kinds = tuple(mark for name, mark in zip(names, marks, strict=True) if name in static.labels)
    standing, _ = upright(static, mine, kinds, up)
    found = np.full((len(static.time), len(names), 3), np.nan)
    for k, name in enumerate(names):
        if name in static.labels:
            found[:, k] = standing.positions[:, static.labels.index(name)]
    if not np.isfinite(found).any():
        raise InvalidInputError(f"{static.source}: it shares no marker with the recording")
    frames = key_frames(found, STATIC_FRAMES)
    return found[np.resize(frames, STATIC_FRAMES)]  # a single frame is as good as six


def _fitted(found: Calibration, still: int, frames: NDArray[np.intp], observed: Array) -> Poses:
    """Return the postures of all frames, begun from those of the nearest key frames."""
    nearest = np.abs(frames[None] - np.arange(len(observed))[:, None]).argmin(axis=1)
    start = found.poses[still + nearest]
    poses, cost = fit_poses(start, observed, found.markers, found.dimensions)
    poses = unstuck(poses, cost, observed, found.markers, found.dimensions)
    poses, _ = fit_poses(continuous(poses), observed, found.markers, found.dimensions)
    return continuous(poses)


def _repaired(
    time: Array, observed: Array, poses: Poses, found: Calibration
) -> tuple[Array, list[Dropout]]:
    """Return markers without ghosts, swaps and gaps, and what they were."""
    names = found.markers.names
    fitted = found.markers.at(place(poses, found.dimensions))
    observed, ghosts = without_ghosts(time, observed, fitted, names)
    observed, gaps = filled_by_fit(time, observed, fitted, names)
    told = [one for one in gaps if not any(one.columns == g.columns for g in ghosts)]
    return observed, [*ghosts, *told]


def _motion(
    robot: Robot, recording: MarkerRecording, q: Array, dropouts: tuple[Dropout, ...]
) -> Motion:
    return Motion(robot, recording.time, q[:, BASE_NQ:], q[:, :BASE_NQ], dropouts, recording.source)


def _contacts(motion: Motion, q: Array, ground: float) -> tuple[Bools, float]:
    """Return which feet are down (n, f), and the cutoff [Hz] that the steps ask for."""
    grid, rate = even_grid(motion.time)
    even = on_grid(motion.time, q, grid)
    low = min(10.0, 0.4 * rate)
    if low * len(grid) > LEAST_CUTOFF_PERIODS * rate:
        even = low_passed(even, rate, low)
    even[:, 3:BASE_NQ] /= np.linalg.norm(even[:, 3:BASE_NQ], axis=1)[:, None]
    down = feet_down(motion.robot, sole_series(motion.robot, even), grid, ground)
    return down[nearest_rows(grid, motion.time)], min(chosen_cutoff(down, grid), 0.45 * rate)


def _speed_note(time: Array, position: Array) -> tuple[str, ...]:
    speed = float(np.median(np.linalg.norm(np.gradient(position, time, axis=0), axis=1)))
    if speed <= FASTEST:
        return ()
    return (f"it moves at {speed:.0f} m/s: are its lengths and times in the right units?",)


def _pull_note(series: RmpSeries) -> tuple[str, ...]:
    pull = -float(np.quantile(series.ground_force[:, 2], SOMETIMES)) / series.robot.weight
    if pull <= PULLS:
        return ()
    told = f"the ground would have to pull by {pull:.1f} times the weight"
    return (f"{told}: are its times and lengths in the right units?",)


def _rate_note(rate: float, cutoff: float) -> tuple[str, ...]:
    if cutoff >= SLOWEST_CUTOFF:
        return ()
    return (f"{rate:.3g} frames a second show nothing above {cutoff:.2g} Hz: forces are too even",)


def _fit_note(fit: Array) -> tuple[str, ...]:
    off = float(np.sqrt(np.nanmean((fit**2).sum(axis=2))))
    if off <= NO_HUMAN:
        return ()
    return (
        f"markers are {1e3 * off:.0f} mm off the fit: they are not one human's, or their names"
        " mean other places",
    )


def _mass_note(weighed: float | None, guess: float, plates: bool) -> tuple[str, ...]:
    if weighed is not None:
        return (f"mass {weighed:.1f} kg, as the force plates weighed it",)
    why = "no frame has all feet on force plates" if plates else "there are no force plates"
    return (f"mass guessed by the stature, {guess:.0f} kg ({why}): forces scale with it; say mass",)
