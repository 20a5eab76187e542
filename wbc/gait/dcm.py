"""The divergent component of motion (capture point) under a piecewise linear VRP, in closed form.

With omega^2 = g / h the DCM xi = c + c'/omega of a body whose virtual repellent point is at r obeys
xi' = omega (xi - r) (Englsberger, Ott & Albu-Schaeffer, IEEE Trans. Robotics 31(2), 2015). Under a
VRP that moves at a constant rate s,

    xi(t) = r(t) + s/omega + exp(omega (t - T)) (xi(T) - r(T) - s/omega),

which is stable backwards in time: a walk is planned from its last footstep to the present one.
Points of the horizontal plane are complex numbers x + i y [m].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from wbc.validate import Array


class VrpSegment(NamedTuple):
    """A VRP that moves at a constant rate: from ``start`` to ``end`` in ``duration`` [s]."""

    start: complex
    end: complex
    duration: float

    def at(self, time: float) -> complex:
        """Return where the VRP is ``time`` after the beginning."""
        return self.start + (time / self.duration) * (self.end - self.start)

    def dcm_before(self, last: complex, left: float, omega: float) -> complex:
        """Return the DCM ``left`` seconds before the end, if it ends at ``last``."""
        lead = (self.end - self.start) / (self.duration * omega)
        here = self.at(self.duration - left)
        return here + lead + math.exp(-omega * left) * (last - self.end - lead)


class StepTimes(NamedTuple):
    """How long a step takes on one foot, and then on both [s]."""

    single: float
    double: float

    @property
    def total(self) -> float:
        """From one touch-down to the next [s]."""
        return self.single + self.double


def shift_gain(omega: float, double: float) -> float:
    """Return 1 + alpha, the gain of a footstep d on the DCM that leaves the foot.

    The VRP stays at p for the single support and then moves by d to the next foot in ``double``
    seconds. A DCM that is at p + a when it begins to move ends at

        p + d + b  with  (1 + alpha) d + b = exp(omega double) a,
        1 + alpha = (exp(omega double) - 1) / (omega double).
    """
    x = omega * double
    return math.expm1(x) / x if x > 1e-9 else 1.0


def dcm_offsets(
    steps: Sequence[complex],
    times: StepTimes | Sequence[StepTimes],
    omega: float,
    last: complex = 0.0,
) -> list[complex]:
    """Return k + 1 offsets b: the DCM relative to each foot when it alone begins to bear.

    Parameters
    ----------
    steps:
        k displacements from each foot to the next [m].
    times:
        Of all steps, or of each of k: the single support before it, and the double support.
    last:
        The offset after the last step; 0: the DCM is over that foot.
    """
    step_times = [times] * len(steps) if isinstance(times, StepTimes) else times
    offsets = [last]
    for step, time in zip(reversed(steps), reversed(step_times), strict=True):
        gain, decay = shift_gain(omega, time.double), math.exp(-omega * time.total)
        offsets.append(decay * (gain * step + offsets[-1]))
    return offsets[::-1]


def in_plane(point: Array) -> complex:
    """Return x + i y of a point (2,) or (3,)."""
    x, y, *_ = point.tolist()
    return complex(x, y)
