"""Feet as a filter sees them: in the air, bearing, standing still, slipping."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wbc.estimation.contact_filter import ContactFilter
from wbc.estimation.settings import GATES, EstimatorSettings
from wbc.validate import Array

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
    """

    bears: bool = False
    since: float = 0.0
    slips: bool = False
    strikes: int = 0

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
    k: int,
    name: str,
    watch: FootWatch,
    seen: FootSeen,
    time: float,
    settings: EstimatorSettings,
) -> FootOutcome:
    """Hold, correct by, or release one foot."""
    if not filter_.held[k]:
        settled = watch.bears and time - watch.since >= settings.settle - 1e-9
        if settled and seen.speed < settings.still:
            filter_.hold(k, seen.place, seen.noise)
            return FootOutcome(FootWatch(True, watch.since))
        return FootOutcome(watch)
    if not watch.bears:
        filter_.release(k)
        return FootOutcome(watch)
    rows = 6 if seen.flat else 3
    found = filter_.correct(k, seen.place, seen.noise, GATES[rows], seen.flat)
    if found.taken:
        return FootOutcome(replace(watch, strikes=0), found.squared, rows)
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
