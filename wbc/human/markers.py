"""A recording of a human: marker positions over time, and force plates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wbc.errors import InvalidInputError, listed, shown
from wbc.human.anthropometry import check_build
from wbc.human.landmarks import Landmark
from wbc.kinds import one_of
from wbc.motion.recording import MIN_ROWS
from wbc.validate import Array, Bools, finite_array, read_only, real_array, set_fields

# Rotations that bring the vertical axis of a file to z, by its name.
_TO_Z = {
    "z": np.eye(3),
    "y": np.array(((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))),
    "x": np.array(((0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))),
}
_TO_Z |= {f"-{axis}": np.diag((1.0, -1.0, -1.0)) @ R for axis, R in _TO_Z.items()}
UPS = ("x", "y", "z", "-x", "-y", "-z")
MAX_DISTANCE = 1e3  # m between markers of a frame: beyond, it is another unit
# Readings of an unloaded plate: at most this [N] or this part of its largest vertical force, within
# a part of that of their median, for at least a time [s].
MAX_OFFSET, MAX_OFFSET_PART, STEADY_PART, MIN_UNLOADED = 30.0, 0.05, 0.2, 0.1
MAX_KNOWN_OFFSET = 200.0  # N, of a plate known to be unloaded: more is another load


@dataclass(frozen=True, eq=False)
class ForcePlate:
    """Measurements of one force plate: the ground's wrench on the human.

    Raises
    ------
    InvalidInputError
        Arrays of other shapes, or not finite.
    """

    name: str
    time: Array  # (k,) [s]
    force: Array  # (k, 3) [N], of the ground on the human
    moment: Array  # (k, 3) about the world's origin [N m]
    corners: Array | None = None  # (4, 3) of its surface [m]; None: not known

    def __post_init__(self) -> None:
        count = real_array(f"{self.name}: time", self.time).size
        time = finite_array(f"{self.name}: time", self.time, (count,))
        force = finite_array(f"{self.name}: force", self.force, (count, 3))
        moment = finite_array(f"{self.name}: moment", self.moment, (count, 3))
        if count < 2 or not (np.diff(time) > 0.0).all():
            raise InvalidInputError(f"{self.name}: times must increase, at least two of them")
        set_fields(self, time=read_only(time), force=read_only(force), moment=read_only(moment))
        if self.corners is not None:
            corners = finite_array(f"{self.name}: corners", self.corners, (4, 3))
            set_fields(self, corners=read_only(corners))

    def pushing(self) -> ForcePlate:
        """Return it with the sign for which the ground pushes up (z) rather than pulls.

        Squares decide: the small offset of an amplifier lasts longer than a step.
        """
        up = self.force[:, 2]
        sign = -1.0 if float((up * np.abs(up)).sum()) < 0.0 else 1.0
        return replace(self, force=sign * self.force, moment=sign * self.moment)

    def tared(self, away: Bools | None = None) -> tuple[ForcePlate, float]:
        """Return it without its offset, the wrench that it reads unloaded, and that force [N].

        Amplifiers drift, and few laboratories subtract it: 20 N and 10 N m shift the CoP by some
        cm. Z is up. A plate that is always loaded is unchanged, with 0 N.

        Parameters
        ----------
        away:
            Samples (k,) in which nobody is above it; they tell larger offsets.
        """
        up = self.force[:, 2]
        most = max(MAX_OFFSET, MAX_OFFSET_PART * float(np.abs(up).max()))
        level = float(np.median(up[away])) if away is not None and away.any() else 0.0
        light = np.abs(up - (level if most < abs(level) < MAX_KNOWN_OFFSET else 0.0)) < most
        middle = np.median(up[light]) if light.any() else np.inf
        steady = light & (np.abs(up - middle) < STEADY_PART * most)
        if steady.sum() * np.median(np.diff(self.time)) < MIN_UNLOADED:
            return self, 0.0
        force = np.median(self.force[steady], axis=0)
        moment = np.median(self.moment[steady], axis=0)
        plate = replace(self, force=self.force - force, moment=self.moment - moment)
        return plate, float(np.linalg.norm(force))

    def rotated(self, R: Array) -> ForcePlate:
        """Return it in world axes rotated by ``R`` (3, 3)."""
        corners = None if self.corners is None else self.corners @ R.T
        return ForcePlate(self.name, self.time, self.force @ R.T, self.moment @ R.T, corners)


@dataclass(frozen=True, eq=False)
class MarkerRecording:
    """Markers on a human over time; made by :func:`wbc.human.read_markers`, or from arrays.

    Attributes
    ----------
    time:
        (n,) [s], increasing.
    labels:
        Names of the markers (m).
    positions:
        (n, m, 3) [m]; NaN, or infinite, where a marker was not seen.
    plates:
        Force plates, in the same world and time.
    up:
        Vertical axis of the world: ``x``, ``y``, ``z``, ``-z`` where that points down, and so on;
        None: to be found from the markers.
    source:
        Its origin, for messages.
    notes:
        What was tolerated while reading.
    landmarks:
        Landmarks of markers, by label, where their names do not tell. As joints of a skeleton,
        these are never taken for swapped.
    mass:
        Of the human [kg], where its file tells; None: not known.

    Raises
    ------
    InvalidInputError
        Arrays of a wrong shape or in another unit than m, no row, times that do not increase, a
        label twice, a mass that no human has.
    """

    time: Array
    labels: tuple[str, ...]
    positions: Array
    plates: tuple[ForcePlate, ...] = ()
    up: str | None = None
    source: str = "markers"
    notes: tuple[str, ...] = ()
    landmarks: tuple[Landmark | None, ...] = ()
    mass: float | None = None

    def __repr__(self) -> str:
        seconds = self.time[-1] - self.time[0]
        return (
            f"MarkerRecording({len(self.labels)} markers, {len(self.time)} frames, {seconds:.4g} s)"
        )

    def __post_init__(self) -> None:
        source = self.source
        if isinstance(self.labels, str) or not isinstance(self.labels, Iterable):
            raise InvalidInputError(f"{source}: labels: expected names, got {shown(self.labels)}")
        labels = tuple(str(label) for label in self.labels)
        count = real_array(f"{source}: time", self.time).size
        if count < 1:
            raise InvalidInputError(f"{source}: it has no frames")
        time = finite_array(f"{source}: time", self.time, (count,))
        if not (np.diff(time) > 0.0).all():
            raise InvalidInputError(f"{source}: time must increase from frame to frame")
        if len(set(labels)) < len(labels):
            repeated = next(label for label in labels if labels.count(label) > 1)
            raise InvalidInputError(
                f"{source}: marker {repeated[:60]!r} is there twice; rename one"
            )
        positions = real_array(f"{source}: positions", self.positions)
        if positions.shape != (count, len(labels), 3):
            raise InvalidInputError(
                f"{source}: positions have shape {positions.shape}, expected"
                f" {(count, len(labels), 3)}"
            )
        positions[~np.isfinite(positions).all(axis=2)] = np.nan
        ends = (one.reduce(positions, axis=1, initial=np.nan) for one in (np.fmax, np.fmin))
        if (np.subtract(*ends) > MAX_DISTANCE).any():
            raise InvalidInputError(
                f"{source}: a marker is over {MAX_DISTANCE:g} m from the others; are its units"
                " right?"
            )
        if self.up is not None:
            one_of(f"axis that is up ({source})", self.up, UPS)
        if self.landmarks and len(self.landmarks) != len(labels):
            raise InvalidInputError(f"{source}: {len(self.landmarks)} landmarks for {len(labels)}")
        check_build(self.mass, None)
        set_fields(self, time=read_only(time), labels=labels, positions=read_only(positions))

    def check_moving(self) -> None:
        """Raise InvalidInputError if it has fewer than 8 frames, which tell no accelerations."""
        if len(self.time) < MIN_ROWS:
            raise InvalidInputError(
                f"{self.source}: {len(self.time)} frames; at least {MIN_ROWS} are needed, except"
                " for a static trial"
            )

    @property
    def rate(self) -> float:
        """Frames per second, by the median step [Hz]."""
        return 1.0 / float(np.median(np.diff(self.time)))

    def columns(self, names: Iterable[str]) -> list[int]:
        """Return the indices of those of some labels that it has."""
        return [self.labels.index(name) for name in names if name in self.labels]

    def with_plates(self, plates: tuple[ForcePlate, ...]) -> MarkerRecording:
        """Return the recording with other force plates."""
        return replace(self, plates=plates)

    def upright(self, up: str) -> MarkerRecording:
        """Return the recording in a world whose z axis is this one's ``up``."""
        if up not in UPS:
            raise InvalidInputError(f"up: expected {', '.join(UPS)}, got {up!r}")
        R = _TO_Z[up]
        plates = tuple(plate.rotated(R).pushing() for plate in self.plates)
        return replace(self, positions=self.positions @ R.T, plates=plates, up="z")


def without_copies(
    labels: Sequence[str], positions: Array
) -> tuple[tuple[str, ...], list[int], tuple[str, ...]]:
    """Return each label once, the column of its marker, and notes.

    Of several markers with one label the first is taken, unless it is seen less than half as often
    as a later one: files keep empty ones.

    ``positions``: (n, m, 3); NaN where a marker was not seen.
    """
    seen, taken = np.isfinite(positions).all(axis=2).sum(axis=0), dict[str, int]()
    for k, label in enumerate(labels):
        if seen[k] > 2 * seen[taken.setdefault(label, k)]:
            taken[label] = k
    repeated = listed([label for label in taken if labels.count(label) > 1], 8)
    what = f"several markers are called {repeated}: the first that is seen is taken"
    return tuple(taken), list(taken.values()), (what,) if repeated else ()
