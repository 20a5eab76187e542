"""Feet as a filter sees them: in the air, bearing, standing still, slipping."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from wbc.estimation.contact_filter import ContactFilter
from wbc.estimation.settings import GATES, EstimatorSettings
from wbc.validate import Array

RECENT = 0.9  # share of a foot's pace that is left after a message
CALMER = 3.0
STRIKES = 2  # places beyond the gate in a row that make a slip; one is an outlier


@dataclass(frozen=True)
class FootWatch:
    """What is remembered of one foot from message to message; not changed, replaced.

    Attributes
    ----------
    bears:
        Whether it is loaded.
    since:
        Since when it bears, or when it last slipped [s].
    slips:
        Whether it bears, but moved since it was last counted on.
    strikes:
        Places in a row that were beyond the gate.
    moves:
        Since when it moves too fast to stand [s]; infinity: it does not.
    """

    bears: bool = False
    since: float = 0.0
    slips: bool = False
    strikes: int = 0
    moves: float = math.inf

    def loaded(self, time: float, load: float, shares: tuple[float, float]) -> FootWatch:
        """Return it at a load, in parts of the robot's weight."""
        bears = load > (shares[0] if self.bears else shares[1])
        return self if bears == self.bears else FootWatch(bears, time)


@dataclass(frozen=True)
class FootSeen:
    """Where a foot is seen.

    Attributes
    ----------
    place, noise:
        (12,), (6, 6) as :meth:`~wbc.estimation.contact_filter.ContactFilter.correct` takes them.
    speed:
        Of its sole [m/s], by the velocities of IMU and joints.
    flat:
        Whether it has a sole, whose rotation says something.
    """

    place: Array
    noise: Array
    speed: float
    flat: bool


@dataclass(frozen=True)
class FootOutcome:
    """What came of a foot in one message: its watch, the innovation and its rows, a note."""

    watch: FootWatch
    squared: float = 0.0
    rows: int = 0
    note: str = ""


def track(
    filter_: ContactFilter,
    held: bool,
    k: int,
    name: str,
    watch: FootWatch,
    seen: FootSeen,
    time: float,
    settings: EstimatorSettings,
) -> FootOutcome:
    """Hold, correct by, or release one foot."""
    if not held:
        # One that slipped must be calmer, for longer: slipping on, it would drag the estimate.
        calm = CALMER if watch.slips else 1.0
        settled = watch.bears and time - watch.since >= calm * settings.settle - 1e-9
        if settled and seen.speed < settings.still / calm:
            filter_.hold(k, seen.place, seen.noise)
            return FootOutcome(FootWatch(True, watch.since))
        return FootOutcome(watch)
    if not watch.bears:
        filter_.release(k)
        return FootOutcome(watch)
    if seen.speed <= settings.slides:
        watch = watch if watch.moves == math.inf else replace(watch, moves=math.inf)
    elif watch.moves == math.inf:
        watch = replace(watch, moves=time)
    elif time - watch.moves >= settings.sliding - 1e-9:
        filter_.release(k)
        note = f"{name} foot slips at {seen.speed:.2f} m/s; not counted on until it is still"
        return FootOutcome(FootWatch(True, time, slips=True), note=note)
    rows = 6 if seen.flat else 3
    found = filter_.correct(k, seen.place, seen.noise, GATES[rows], seen.flat)
    if found.taken:
        watch = replace(watch, strikes=0) if watch.strikes else watch
        return FootOutcome(watch, found.squared, rows)
    if seen.flat:  # a foot that rolls over an edge may still stand on it, for once
        found = filter_.correct(k, seen.place, seen.noise, GATES[3], rotation=False)
        if found.taken:
            note = f"{name} foot turns by {1e3 * np.linalg.norm(found.residual[3:]):.0f} mrad"
            if watch.strikes + 1 < STRIKES:
                watch = replace(watch, strikes=watch.strikes + 1)
                return FootOutcome(watch, found.squared, 3, note)
            filter_.release(k)
            note = f"{note}; not counted on until it is still"
            return FootOutcome(FootWatch(True, time, slips=True), found.squared, 3, note)
    off = 1e3 * float(np.linalg.norm(found.residual[:3]))
    if watch.strikes + 1 < STRIKES:
        note = f"{name} foot seen {off:.1f} mm off: an outlier, not used"
        return FootOutcome(replace(watch, strikes=watch.strikes + 1), note=note)
    filter_.release(k)
    note = f"{name} foot slips: seen {off:.1f} mm off; not counted on until it is still"
    return FootOutcome(FootWatch(True, time, slips=True), note=note)


@dataclass(frozen=True)
class FeetApart:
    """How far feet that stand are from each other: the joints know, whatever the base does.

    A slip that is too slow to be seen as a speed is seen here. Not changed, replaced.

    Attributes
    ----------
    distances:
        By pairs of feet, since both are counted on [m].
    paces:
        Speeds of the feet of late [m/s].
    """

    distances: Mapping[tuple[int, int], float]
    paces: tuple[float, ...]

    def seen(
        self, held: Sequence[bool], places: Array, speeds: Sequence[float], most: float
    ) -> tuple[FeetApart, int | None, float]:
        """Return it now, which foot slipped, if any, and by how much [m].

        Parameters
        ----------
        places:
            (feet, 3) in the IMU's axes [m].
        most:
            The change that is no slip [m].
        """
        paces = tuple(
            RECENT * old + (1.0 - RECENT) * new for old, new in zip(self.paces, speeds, strict=True)
        )
        distances, points = dict[tuple[int, int], float](), places.tolist()
        for i, j in combinations([k for k, one in enumerate(held) if one], 2):
            now = math.dist(points[i], points[j])
            first = self.distances.get((i, j), now)
            if abs(now - first) > most:
                slipped = i if paces[i] > paces[j] else j
                return FeetApart({}, paces), slipped, abs(now - first)
            distances[i, j] = first
        return FeetApart(distances, paces), None, 0.0
