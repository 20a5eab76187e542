"""Where and when the next foot lands, from the capture point as measured: one small QP.

Seen from the standing foot, with the DCM at d and the VRP moved by z within that foot, the single
support ends after ln(sigma)/omega and the double support begins with the DCM at z + sigma (d - z).
It must end where the next foot, at u, goes on from: at u + b (:func:`wbc.gait.dcm.shift_gain`):

    (1 + alpha) u + b = exp(omega T_double) (sigma d + (1 - sigma) z),

linear in u (2), sigma, b (2) and w = (sigma - 1) z (2), of which |w| <= (sigma - 1) times the half
size of the sole: what the sole can still do shrinks with the time left. After
Khadiv, Herzog, Moosavian & Righetti, "Walking control based on step timing adaptation", IEEE
Trans. Robotics 36(3), 2020, to which a double support and a foot of finite size are added.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wbc.gait.dcm import shift_gain
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Status
from wbc.validate import Array

NAMES = ("u x", "u y", "sigma", "b x", "b y", "w x", "w y")
SIDES = ("x most", "y most", "x least", "y least")
ROWS = (*(f"w {side}" for side in SIDES), *(f"reach {side}" for side in SIDES))
LABELS = Labels(("dcm x", "dcm y"), ROWS, NAMES)
BOTH = np.vstack((np.eye(2), -np.eye(2)))
FREE = np.full(8, np.inf)
# Of the rows what does not change: b; w, and u of the reach.
EQUAL = np.zeros((2, 7))
EQUAL[:, 3:5] = np.eye(2)
PARTS = np.zeros((8, 7))
PARTS[:4, 5:] = PARTS[4:, :2] = BOTH
NONE = np.zeros(2)
SOLVER = ActiveSet()
# What holds a footstep back, by the bounds on u and sigma (below, above) and by the rows.
BOUNDS = (
    ("reach of the legs behind", "reach of the legs ahead"),
    ("reach of the legs aside", "the other foot"),
    ("least time in the air", "longest time in the air"),
)
ROWS_HOLD = ("the sole",) * 4 + ("acceleration of the foot",) * 4
# Multipliers below this hold nothing back: a step could be 1 mm nearer for 1e-3 in the cost.
NEGLIGIBLE = 1e-3
# Of a foot that comes to rest on a curve of least jerk within T: how far from T/2 times its rate,
# in units of a T^2, and in what time, in units of rate by a, if it takes no more acceleration than
# a. (The extremes of 60 s - 180 s^2 + 120 s^3 and of 6 s - 6 s^2.)
FAR, STOP = 0.1 * math.sqrt(3.0), 1.5


class Reach(NamedTuple):
    """Where the foot in the air can be at rest after a time T: within ``acceleration`` of its way.

    Axis by axis that is from place + T/2 rate as far as a T^2 sqrt(3)/10, either way.

    Attributes
    ----------
    place, rate:
        (2,) of the foot now, in the standing foot's axes [m, m/s].
    acceleration:
        Largest, on each axis [m/s^2].
    """

    place: Array
    rate: Array
    acceleration: float

    def least_time(self, lower: Array, upper: Array) -> float:
        """Return the time [s] from which on the foot can be at rest between the corners (2,)."""
        k, (vx, vy) = FAR * self.acceleration, self.rate.tolist()
        below, above = (lower - self.place).tolist(), (self.place - upper).tolist()
        least = STOP * max(abs(vx), abs(vy)) / self.acceleration
        for missing, rate in zip(below + above, (vx, vy, -vx, -vy), strict=True):
            b = 0.5 * rate
            inside = b * b + 4.0 * k * missing  # k T^2 + b T >= missing, always if this is negative
            if inside > 0.0:
                least = max(least, (math.sqrt(inside) - b) / (2.0 * k))
        return least

    def rows(self, time: float) -> tuple[list[float], list[float]]:
        """Return h (4,), c (4,) of (u, -u) <= h T + c, the tangent of its parabola at ``time``."""
        k, (x, y), (vx, vy) = FAR * self.acceleration, self.place.tolist(), self.rate.tolist()
        steep, bend = 2.0 * k * time, k * time**2
        h = [steep + 0.5 * rate for rate in (vx, vy, -vx, -vy)]
        return h, [place - bend for place in (x, y, -x, -y)]


class StepBounds(NamedTuple):
    """What the next footstep may be, in the standing foot's axes.

    Attributes
    ----------
    lower, upper:
        (2,) of the next foot's place [m].
    least, most:
        Of the time left in the air [s].
    sole:
        (2,) how far the VRP may be moved within the standing foot, either way [m].
    reach:
        Of the foot in the air.
    about:
        The time left that was planned before, by which the reach is linear [s].
    """

    lower: Array
    upper: Array
    least: float
    most: float
    sole: Array
    reach: Reach
    about: float


class StepWeights(NamedTuple):
    """Squared costs: of the place [1/m^2], of time by its growth factor, of offset and VRP."""

    place: float = 1.0
    time: float = 0.05
    offset: float = 1e3
    vrp: float = 0.1


WEIGHTS = StepWeights()


class StepPlan(NamedTuple):
    """The next footstep.

    Attributes
    ----------
    place:
        (2,) from the standing foot, in its axes [m].
    left:
        Time in the air from now on [s].
    offset:
        (2,) of the DCM from the next foot when that alone begins to bear [m].
    vrp:
        (2,) how far the VRP should be from the standing foot until then [m].
    adapted:
        Whether the QP gave it; else it is what was wanted, as far as the bounds let it.
    multipliers:
        Of the rows (8,) and of the bounds (7,), positive at the upper ones; see
        :func:`held_back_by`.
    """

    place: Array
    left: float
    offset: Array
    vrp: Array
    adapted: bool = True
    multipliers: tuple[Array, Array] | None = None


def step_qp(
    dcm: Array,
    nominal: StepPlan,
    bounds: StepBounds,
    omega: float,
    double: float,
    weights: StepWeights,
) -> QP:
    """Return the QP in x = (u, sigma / sigma_0, b, w).

    Parameters
    ----------
    dcm:
        (2,) from the standing foot, in its axes [m].
    nominal:
        What is wanted; its ``vrp`` too.
    """
    sigma, grow = math.exp(omega * nominal.left), math.exp(omega * double)
    place, time, offset, vrp = weights
    vrp /= (sigma - 1.0) ** 2
    cost = np.array((place, place, time, offset, offset, vrp, vrp))
    moved = ((sigma - 1.0) * nominal.vrp).tolist()
    wanted = np.array((*nominal.place.tolist(), 1.0, *nominal.offset.tolist(), *moved))
    P, A, C = np.zeros((7, 7)), EQUAL.copy(), PARTS.copy()
    P.flat[::8] = cost
    A[0, 0] = A[1, 1] = shift_gain(omega, double)
    A[:, 2] = -grow * sigma * dcm
    A[0, 5] = A[1, 6] = grow
    sole = bounds.sole.tolist() * 2
    speed, most = bounds.reach.rows(bounds.about)
    # T = about + (sigma / sigma(about) - 1) / omega, to first order
    early = -math.exp(omega * (nominal.left - bounds.about)) / omega
    C[:, 2] = [-sigma * half for half in sole] + [early * one for one in speed]
    ahead = bounds.about - 1.0 / omega
    upper = [-half for half in sole] + [c + h * ahead for h, c in zip(speed, most, strict=True)]
    least, longest = (math.exp(omega * time) / sigma for time in (bounds.least, bounds.most))
    free = (math.inf,) * 4
    return QP(
        P,
        -cost * wanted,
        A,
        NONE,
        C,
        -FREE,
        np.array(upper),
        -np.array((*(-bounds.lower).tolist(), -least, *free)),
        np.array((*bounds.upper.tolist(), longest, *free)),
        LABELS,
    )


def adapt_step(
    dcm: Array,
    nominal: StepPlan,
    bounds: StepBounds,
    omega: float,
    double: float,
    weights: StepWeights = WEIGHTS,
) -> StepPlan:
    """Return the footstep nearest to ``nominal`` from which the walk goes on.

    Where the QP is not solved (a time at which only one place is in reach is none to a solver), the
    nominal one within its bounds, without a claim to catch the robot: ``adapted`` says so.
    """
    qp = step_qp(dcm, nominal, bounds, omega, double, weights)
    solution = SOLVER.solve(qp, quick=True)
    if solution.status is not Status.SOLVED:
        place = np.clip(nominal.place, bounds.lower, bounds.upper)
        left = min(max(nominal.left, bounds.least), bounds.most)
        return StepPlan(place, left, nominal.offset, nominal.vrp, adapted=False)
    x = solution.x
    sigma = max(x[2] * math.exp(omega * nominal.left), 1e-9)
    left = min(max(math.log(sigma) / omega, bounds.least), bounds.most)
    vrp = x[5:7] / math.expm1(omega * left)
    return StepPlan(x[:2], left, x[3:5], vrp, multipliers=(solution.z, solution.z_box))


def held_back_by(multipliers: tuple[Array, Array] | None, sign: float) -> tuple[str, ...]:
    """Return what holds a footstep back, in words, the strongest first.

    Parameters
    ----------
    sign:
        Of y on the side of the foot in the air.
    """
    if multipliers is None:
        return ()
    rows, box = multipliers
    pull = list(zip(ROWS_HOLD, np.abs(rows).tolist(), strict=True))
    for names, size, way in zip(BOUNDS, box[:3].tolist(), (1.0, -sign, 1.0), strict=True):
        pull.append((names[size * way > 0.0], abs(size)))
    strongest = sorted(pull, key=lambda one: -one[1])
    return tuple(dict.fromkeys(name for name, size in strongest if size > NEGLIGIBLE))
