"""From markers to a human's motion: body, postures, contacts and quality of the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, listed
from wbc.human.anthropometry import MEAN_BODY_MASS_INDEX, check_build, check_sex
from wbc.human.body import HumanBody
from wbc.human.calibration import KEY_FRAMES, Calibration, calibrate, key_frames
from wbc.human.comparison import MIN_PLATE_FORCE, plates_mass
from wbc.human.contacts import cutoff_by_steps, feet_down, ground_and_soles, nearest_rows
from wbc.human.fit import (
    MarkerSet,
    bridge_untold,
    escape_local_minima,
    fit_poses,
    residuals,
    unwrap_joints,
    upright_trunk,
)
from wbc.human.gaps import (
    fill_gaps_by_fit,
    gaps_of,
    interpolate_gaps,
    longest_without_jump,
    remove_ghosts,
    swap_back,
    while_in_view,
    with_missing_frames,
)
from wbc.human.kinematics import Poses, forward_kinematics
from wbc.human.landmarks import identifies_trunk
from wbc.human.marker_identification import (
    Markers,
    identify_markers,
    rotate_z_up,
    static_trial_notes,
    with_labels_of,
)
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.human.residual_noise import ResidualNoise, residual_noise
from wbc.human.roll_over import SWAY, SWAY_WITHOUT_TRUNK, roll_over_correction
from wbc.human.skeleton import configurations, human_robot
from wbc.human.subjects import select_subject
from wbc.human.treadmill import belt_velocity, in_belt_frame
from wbc.kinds import check_kind
from wbc.motion.analysis import analyze
from wbc.motion.dropouts import Dropout, runs
from wbc.motion.filtering import low_pass
from wbc.motion.recording import LONGEST_GAP, Motion
from wbc.motion.series import RmpSeries
from wbc.motion.smoothing import even_grid, resample
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import sole_series
from wbc.validate import Array, Bools, finite_number

STATIC_FRAMES = 6  # of a static trial, which hardly differ
MIN_CUTOFF_PERIODS = 2.0  # in a recording that is low-passed
NOTED_OFFSET = 2.0  # N, of an unloaded plate
BESIDE, FAR = 0.2, 1e6  # m: who has no marker nearer to a plate is not on it; unseen ones are far
USUAL_MASS = (0.45, 2.2)  # by the mean at a stature: slim children, and body mass indices of 50
MASS_TOLERANCE = 0.05  # of the given mass; more difference of the plates' is noted
MAX_SPEED = 13.0  # m/s: somewhat above the fastest human
# A note is due where the ground pulls by more than this part of the weight in this part of frames.
MAX_PULL, PULL_QUANTILE = 1.0, 0.05
MIN_CUTOFF = 3.0  # Hz: with a lower one, of few frames a second, forces of steps are lost
MAX_RMS = 0.06  # m: a fit with more is not of a human


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
        Names and places of the fitted ones, in the order of ``residual``.
    residual:
        Fitted less observed marker positions (n, m, 3) [m]; NaN where not seen.
    down:
        Which feet touch the ground (n, f), by height and speed.
    cutoff:
        Low-pass for this motion [Hz]: 2.4 times its steps per second, 6 Hz without steps.
    ground_height:
        Height of the ground [m].
    noise:
        Uncertainty of the posture by markers and skin, for ``analyze(noise=...)``.
    notes:
        What was guessed, left out and tolerated.
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
        """The same by marker [m], without those that were never seen."""
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

    Markers are identified by their names (see :mod:`wbc.human.landmarks`). Dimensions, marker
    places and postures of key frames are calibrated together, then all frames are fitted.

    Parameters
    ----------
    static:
        A trial in which the same human stands, at least one frame; may have more markers
        (``read_markers(path, standing=True)``).
    subject:
        The human, where there are several: the part of its labels before the colon.
    mass:
        [kg]; None: as the force plates weigh it, or without them by the stature.
    stature:
        [m]; None: by the calibrated lengths.
    sex:
        ``male`` or ``female``: which table of segments is used.
    up:
        Vertical axis of the file, ``x``, ``y`` or ``z``, or ``-z`` where that points down; None:
        the recording's, or the one from feet to trunk.
    ground_height:
        [m]; None: 0, unless the feet contradict it.
    longest_gap:
        Longest gap [s] of a marker that is interpolated; in longer ones it follows the fit.
    by_steps:
        Whether the body is displaced by some mm so that its CoP rolls over the soles in steps; see
        :mod:`wbc.human.roll_over`.

    Raises
    ------
    RecordingError
        Markers that a fit needs are missing or have unknown names; several humans; no axis is up.
    UnknownNameError
        No subject of that name.
    InvalidInputError
        Numbers that are not positive, mass or stature that no human has, another sex or axis.
    """
    example = "read_markers(path)"
    check_kind("human_motion, recording", recording, MarkerRecording, example)
    check_kind("human_motion, static", static, MarkerRecording, example, or_none=True)
    sex = check_sex(sex)
    recording.check_moving()
    longest_gap = finite_number("longest_gap", longest_gap, least=0.0)
    mass, stature = check_build(mass, stature)
    recording, static, markers, notes = _prepare(recording, static, subject, up)
    standing = _static_frames(static, markers, up)
    fit = _fit_markers(recording, standing, markers, stature, longest_gap)
    found, poses, time = fit.calibration, fit.poses, recording.time
    body = HumanBody(found.markers.dimensions, 70.0 if mass is None else mass, found.stature, sex)
    frames = forward_kinematics(poses, body.dimensions)
    ground, soles, more = ground_and_soles(frames, time, body, ground_height)
    notes += found.notes + fit.notes + more
    robot = human_robot(body, soles)
    q = configurations(robot, poses)
    motion = _motion(robot, recording, q, fit.dropouts)
    down, cutoff = _contacts(motion, q, ground)
    weighed = None
    if cutoff * (time[-1] - time[0]) > MIN_CUTOFF_PERIODS:
        series = analyze(motion, cutoff=cutoff, noise=None, feet=None, ground_height=ground)
        contacts = down[nearest_rows(time, series.time)]
        weighed, more = plates_mass(series, recording.plates, contacts)
        notes += more + _force_notes(series, recording.rate, cutoff)
        if by_steps:
            sway = SWAY if fit.trunk else SWAY_WITHOUT_TRUNK
            shift, more = roll_over_correction(series, contacts, found.stature, sway)
            q[:, :2] += np.column_stack([np.interp(time, series.time, one) for one in shift.T])
            notes += more
    else:
        short = f"its {time[-1] - time[0]:.2g} s are too short to tell forces"
        notes += (f"{short}: plates do not weigh it, nor do its steps displace it",)
    if mass is None:
        usual = MEAN_BODY_MASS_INDEX[sex] * found.stature**2
        weight, more = _mass_without_one_given(weighed, usual, recording)
        notes += more
        body = replace(body, mass=weight)
        robot = human_robot(body, soles)
    elif weighed is not None and abs(weighed - mass) > MASS_TOLERANCE * mass:
        notes += (f"the force plates weighed {weighed:.1f} kg, {mass:g} kg was given",)
    motion = _motion(robot, recording, q, fit.dropouts)
    residual = fit.residual
    noise = residual_noise(time, poses, fit.observed, residual, found.markers, robot)
    human = HumanMotion(
        motion, body, recording, found.markers, residual, down, cutoff, ground, noise, notes
    )
    return replace(human, notes=notes + _fit_notes(human.rms, time, q[:, :3]))


def _prepare(
    recording: MarkerRecording, static: MarkerRecording | None, subject: str | None, up: str | None
) -> tuple[MarkerRecording, MarkerRecording | None, Markers, tuple[str, ...]]:
    """Return the recording of one human on ground at rest, z up, its markers, and notes."""
    recording, others = select_subject(recording, subject)
    if static is not None and any(":" in label for label in static.labels):
        static, _ = select_subject(static, subject)
    if static is not None:
        static = with_labels_of(static, recording)
    markers, notes = identify_markers(recording, static)
    if static is not None:
        notes += static_trial_notes(recording, static, markers)
    recording, view = while_in_view(recording, markers)
    recording, jumps = longest_without_jump(recording, markers)
    recording = with_missing_frames(recording)
    recording, axis = rotate_z_up(recording, markers, up)
    recording, offsets = _tare_plates(recording, markers)
    notes = (*recording.notes, *others, *notes, *view, *jumps, *offsets)
    belt = belt_velocity(recording, markers)
    if belt.any():
        recording = in_belt_frame(recording, belt)
        speed = float(np.linalg.norm(belt))
        notes += (f"feet that stand move at {speed:.2f} m/s: a treadmill, in its belt's frame",)
    return recording, static, markers, notes + axis


def _tare_plates(
    recording: MarkerRecording, markers: Markers
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording with the offsets of unloaded plates subtracted, and notes."""
    marks = recording.positions[:, recording.columns(markers), :2]
    tared = [plate.tared(_away(plate, recording.time, marks)) for plate in recording.plates]
    plates = tuple(plate for plate, _ in tared)
    offsets = [f"{plate.name} {force:.0f} N" for plate, force in tared if force > NOTED_OFFSET]
    notes = [f"offsets of unloaded plates subtracted: {listed(offsets, 8)}"] if offsets else []
    largest = sum(np.abs(plate.force).max(axis=0) for plate in plates)
    if plates and max(largest[:2]) > largest[2]:
        notes.append(
            "force plates push sideways more than up: their file has other axes than the markers'"
        )
    return recording.with_plates(plates), tuple(notes)


def _away(plate: ForcePlate, time: Array, marks: Array) -> Bools | None:
    """Return the samples (k,) of a plate above which no marker (n, m, 2) is; None: not known."""
    if plate.corners is None:
        return None
    above = polygon_margin(convex_hull(plate.corners[:, :2]), np.nan_to_num(marks, nan=FAR))
    near = np.asarray((above > -BESIDE).any(axis=1))
    return ~near[nearest_rows(time, plate.time)]


class _MarkerFit(NamedTuple):
    """Postures fitted to markers."""

    calibration: Calibration
    poses: Poses
    observed: Array  # (n, m, 3) [m], repaired
    residual: Array  # (n, m, 3) [m], NaN where not seen
    dropouts: tuple[Dropout, ...]
    trunk: bool  # whether markers tell its lean
    notes: tuple[str, ...]


def _fit_markers(
    recording: MarkerRecording, standing: Array, markers: Markers, stature: float | None,
    longest_gap: float,
) -> _MarkerFit:  # fmt: skip
    """Fit a human to the markers of a recording, z up, and to frames of a static trial."""
    time, names, marks = recording.time, tuple(markers), tuple(markers.values())
    columns = recording.columns(names)
    own = names[: len(columns)]
    given = recording.landmarks or (None,) * len(recording.labels)
    fixed = np.array([given[k] is not None for k in columns])
    observed, swaps = swap_back(time, recording.positions[:, columns], own, fixed)
    observed, gaps = interpolate_gaps(time, observed, own, longest_gap)
    extra = len(names) - len(columns)
    observed = np.concatenate((observed, np.full((len(time), extra, 3), np.nan)), axis=1)
    frames = key_frames(observed, KEY_FRAMES)
    found = calibrate(np.concatenate((standing, observed[frames])), names, marks, stature)
    poses = _fit_all_frames(found, len(standing), frames, observed)
    poses, untold = bridge_untold(time, poses, observed, found.markers)
    observed, more = _repair(time, observed, poses, found)
    if more:
        poses, _ = fit_poses(poses, observed, found.markers)
        poses = unwrap_joints(poses)
    residual = residuals(poses, observed, found.markers)
    trunk = identifies_trunk(marks[: len(columns)])
    if not trunk:
        poses = upright_trunk(poses)
    missing = ~np.isfinite(recording.positions[:, columns]).all(axis=2)
    residual[:, : len(columns)][missing] = np.nan
    dropouts = tuple(sorted((*swaps, *gaps, *more), key=lambda one: one.start))
    notes = _unseen_notes(time, untold)
    return _MarkerFit(found, poses, observed, residual, dropouts, trunk, notes)


def _unseen_notes(time: Array, untold: Bools) -> tuple[str, ...]:
    """Return a note on the frames in which markers do not tell where the pelvis is (n, 40)."""
    spans = [f"{time[a]:.2f} to {time[b - 1]:.2f} s" for a, b in runs(untold[:, 0])]
    what = "too few markers are seen: the body is interpolated there, its forces are uncertain"
    return (f"from {listed(spans, 4)} {what}",) if spans else ()


def _static_frames(static: MarkerRecording | None, markers: Markers, up: str | None) -> Array:
    """Return some frames (k, m, 3) of a static trial, z up; none without one."""
    if static is None:
        return np.zeros((0, len(markers), 3))
    standing, _ = rotate_z_up(static, markers, up)
    found = np.full((len(static.time), len(markers), 3), np.nan)
    there = [name in static.labels for name in markers]
    found[:, there] = standing.positions[:, static.columns(markers)]
    if not np.isfinite(found).any():
        raise InvalidInputError(f"{static.source}: it shares no marker with the recording")
    frames = key_frames(found, STATIC_FRAMES)
    return found[np.resize(frames, STATIC_FRAMES)]  # a single frame has the weight of six


def _fit_all_frames(
    found: Calibration, static_count: int, frames: NDArray[np.intp], observed: Array
) -> Poses:
    """Return the postures of all frames, with those of the nearest key frames as initial guess."""
    nearest = np.abs(frames[None] - np.arange(len(observed))[:, None]).argmin(axis=1)
    start = found.poses[static_count + nearest]
    poses, cost = fit_poses(start, observed, found.markers)
    poses = escape_local_minima(poses, cost, observed, found.markers)
    poses, _ = fit_poses(unwrap_joints(poses), observed, found.markers)
    return unwrap_joints(poses)


def _repair(
    time: Array, observed: Array, poses: Poses, found: Calibration
) -> tuple[Array, list[Dropout]]:
    """Return markers without ghosts and gaps, and which there were."""
    names = found.markers.names
    fitted = found.markers.positions(found.markers.frames(poses))
    gaps = gaps_of(time, observed, names)
    observed, ghosts = remove_ghosts(time, observed, fitted, names)
    return fill_gaps_by_fit(time, observed, fitted), [*ghosts, *gaps]


def _motion(
    robot: Robot, recording: MarkerRecording, q: Array, dropouts: tuple[Dropout, ...]
) -> Motion:
    return Motion(robot, recording.time, q[:, BASE_NQ:], q[:, :BASE_NQ], dropouts, recording.source)


def _contacts(motion: Motion, q: Array, ground: float) -> tuple[Bools, float]:
    """Return which feet are down (n, f), and the cutoff [Hz] by the steps."""
    grid, rate = even_grid(motion.time)
    values = resample(motion.time, q, grid)
    low = min(10.0, 0.4 * rate)
    if low * len(grid) > MIN_CUTOFF_PERIODS * rate:
        values = low_pass(values, rate, low)
    values[:, 3:BASE_NQ] /= np.linalg.norm(values[:, 3:BASE_NQ], axis=1)[:, None]
    down = feet_down(motion.robot, sole_series(motion.robot, values), grid, ground)
    return down[nearest_rows(grid, motion.time)], min(cutoff_by_steps(down, grid), 0.45 * rate)


def _force_notes(series: RmpSeries, rate: float, cutoff: float) -> tuple[str, ...]:
    pull = -float(np.quantile(series.ground_force[:, 2], PULL_QUANTILE)) / series.robot.weight
    pulls = f"the ground would have to pull by {pull:.1f} times the weight"
    shows = f"{rate:.3g} frames a second show nothing above {cutoff:.2g} Hz"
    return _due(
        (pull > MAX_PULL, f"{pulls}: are its times and lengths in the right units?"),
        (cutoff < MIN_CUTOFF, f"{shows}: forces too smooth"),
    )


def _fit_notes(rms: float, time: Array, position: Array) -> tuple[str, ...]:
    speed = float(np.median(np.linalg.norm(np.gradient(position, time, axis=0), axis=1)))
    off = f"markers are {1e3 * rms:.0f} mm off the fit"
    moves = f"it moves at {speed:.0f} m/s"
    return _due(
        (rms > MAX_RMS, f"{off}: they are not one human's, or their names mean other places"),
        (speed > MAX_SPEED, f"{moves}: are its lengths and times in the right units?"),
    )


def _due(*notes: tuple[bool, str]) -> tuple[str, ...]:
    return tuple(note for due, note in notes if due)


def _mass_without_one_given(
    weighed: float | None, usual: float, recording: MarkerRecording
) -> tuple[float, tuple[str, ...]]:
    """Return the mass [kg] by plates, file or stature, the first that is known, and notes."""
    told, plates = recording.mass, recording.plates
    if weighed is not None:
        least, most = (by * usual for by in USUAL_MASS)
        other = f", where {least:.0f} to {most:.0f} kg are usual: are their forces in N, and all?"
        unusual = other * (not least < weighed < most)
        by_plates = f"mass {weighed:.1f} kg, as weighed by the force plates{unusual}"
        contradicted = told is not None and abs(weighed - told) > MASS_TOLERANCE * told
        by_file = f"its file says that it has {told} kg: do plates measure all of the force?"
        return weighed, (by_plates, *_due((contradicted, by_file)))
    why = "there are no force plates"
    if plates:
        peak = max(float(plate.force[:, 2].max()) for plate in plates)
        none = f"force plates push by {peak:.3g} N at most: are their forces in N?"
        why = none if peak < MIN_PLATE_FORCE else "too few frames have all feet on force plates"
    if told is not None:
        return told, (f"mass {told:g} kg, as its file says ({why})",)
    guess = f"mass guessed by stature, {usual:.0f} kg ({why}): forces scale with it; give mass"
    return usual, (guess,)
