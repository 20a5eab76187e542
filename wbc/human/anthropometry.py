"""Segments of the human body: masses, centres and gyration radii, and the usual proportions.

Masses, centres and radii are those of de Leva (1996, J. Biomech. 29, 1223-1230), Table 4; lengths
are the means of the same table. De Leva has centres on the long axes; the offsets of trunk and
legs behind them are those of Dumas, Cheze and Verriest (2007).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from wbc.errors import InvalidInputError
from wbc.validate import finite_number

SEXES = ("female", "male")
# Mean stature [m] and body mass index [kg/m^2] of de Leva's subjects.
MEAN_STATURE = {"female": 1.735, "male": 1.741}
MEAN_BODY_MASS_INDEX = {"female": 20.6, "male": 24.1}


@dataclass(frozen=True)
class SegmentInertia:
    """One row of de Leva's Table 4."""

    mass: float  # part of the body's mass
    centre: float  # from the proximal (or cranial) end, as a part of the length
    # gyration radii about the sagittal (forward), transverse (sideways) and longitudinal axis
    # through the centre, as parts of the length
    radii: tuple[float, float, float]
    length: float  # mean length [m]


def _row(mass: float, centre: float, s: float, t: float, l: float, mm: float) -> SegmentInertia:  # noqa: E741
    return SegmentInertia(mass / 100, centre / 100, (s / 100, t / 100, l / 100), mm / 1000)


# Ends: head vertex to C7; upper trunk C7 to xiphoid; middle trunk to navel; lower trunk to the
# middle of the hips; hand wrist to third knuckle; shank knee to lateral malleolus; foot heel to
# toe.
DE_LEVA: Mapping[str, Mapping[str, SegmentInertia]] = {
    "female": {
        "head": _row(6.68, 48.41, 27.1, 29.5, 26.1, 243.7),
        "upper_trunk": _row(15.45, 50.50, 46.6, 31.4, 44.9, 228.0),
        "middle_trunk": _row(14.65, 45.12, 43.3, 35.4, 41.5, 205.3),
        "lower_trunk": _row(12.47, 49.20, 43.3, 40.2, 44.4, 181.5),
        "upper_arm": _row(2.55, 57.54, 27.8, 26.0, 14.8, 275.1),
        "forearm": _row(1.38, 45.59, 26.1, 25.7, 9.4, 264.3),
        "hand": _row(0.56, 74.74, 53.1, 45.4, 33.5, 78.0),
        "thigh": _row(14.78, 36.12, 36.9, 36.4, 16.2, 368.5),
        "shank": _row(4.81, 44.16, 27.1, 26.7, 9.3, 432.3),
        "foot": _row(1.29, 40.14, 29.9, 27.9, 13.9, 228.3),
    },
    "male": {
        "head": _row(6.94, 50.02, 30.3, 31.5, 26.1, 242.9),
        "upper_trunk": _row(15.96, 50.66, 50.5, 32.0, 46.5, 242.1),
        "middle_trunk": _row(16.33, 45.02, 48.2, 38.3, 46.8, 215.5),
        "lower_trunk": _row(11.17, 61.15, 61.5, 55.1, 58.7, 145.7),
        "upper_arm": _row(2.71, 57.72, 28.5, 26.9, 15.8, 281.7),
        "forearm": _row(1.62, 45.74, 27.6, 26.5, 12.1, 268.9),
        "hand": _row(0.61, 79.00, 62.8, 51.3, 40.1, 86.2),
        "thigh": _row(14.16, 40.95, 32.9, 32.9, 14.9, 422.2),
        "shank": _row(4.33, 44.59, 25.5, 24.9, 10.3, 434.0),
        "foot": _row(1.37, 44.15, 25.7, 24.5, 12.4, 258.1),
    },
}
# Offset of the centre behind the long axis, by the length: Dumas, Cheze and Verriest (2007, J.
# Biomech. 40, 543-553), Table 2.
BEHIND: Mapping[str, Mapping[str, float]] = {
    "female": {"trunk": 0.016, "thigh": 0.077, "shank": 0.049},
    "male": {"trunk": 0.036, "thigh": 0.041, "shank": 0.048},
}
STATURES, MASSES = (0.4, 2.8), (3.0, 400.0)  # m, kg: smallest and largest of a human
PAIRED = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


def check_sex(sex: str) -> str:
    """Return the sex in lower case."""
    if not isinstance(sex, str) or sex.lower() not in SEXES:
        raise InvalidInputError(f"sex: expected {' or '.join(SEXES)}, got {sex!r}")
    return sex.lower()


def check_build(mass: Any, stature: Any) -> tuple[float | None, float | None]:
    """Return mass [kg] and stature [m] as numbers, or None."""

    def checked(what: str, value: Any, least: float, most: float, unit: str) -> float | None:
        number = None if value is None else finite_number(what, value, above=0.0)
        if number is not None and not least <= number <= most:
            raise InvalidInputError(
                f"{what}: {number:g} {unit} is no human's, {least:g} to {most:g} {unit}; give it in"
                f" {unit}"
            )
        return number

    return checked("mass", mass, *MASSES, "kg"), checked("stature", stature, *STATURES, "m")


def segment_table(sex: str) -> Mapping[str, SegmentInertia]:
    """Return de Leva's rows for a sex by segment, masses scaled so that all of them sum to 1.

    The published parts are rounded to a hundredth of a percent and sum to 0.9999 or 1.0001.
    """
    rows = DE_LEVA[sex]
    total = sum(row.mass * (2.0 if name in PAIRED else 1.0) for name, row in rows.items())
    return {name: replace(row, mass=row.mass / total) for name, row in rows.items()}
