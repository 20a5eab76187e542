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

from wbc.gait.dcm import shift_gain
from wbc.qp.active_set import ActiveSet
from wbc.qp.core import FlatForm, FlatQP
from wbc.qp.problem import Labels

NAMES = ("u x", "u y", "sigma", "b x", "b y", "w x", "w y")
SIDES = ("x most", "y most", "x least", "y least")
ROWS = (*(f"w {side}" for side in SIDES), *(f"reach {side}" for side in SIDES))
FORM = FlatForm(Labels(("dcm x", "dcm y"), ROWS, NAMES))
FREE = (math.inf,) * 4  # b and w are not bounded
NO_LEAST = (-math.inf,) * 8  # nor are rows from below
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


Pair = tuple[float, float]


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

    place: Pair
    rate: Pair
    acceleration: float

    def least_time(self, lower: Pair, upper: Pair) -> float:
        """Return the time [s] from which on the foot can be at rest between the corners (2,)."""
        k, (x, y), (vx, vy) = FAR * self.acceleration, self.place, self.rate
        missing_by = lower[0] - x, lower[1] - y, x - upper[0], y - upper[1]
        least = STOP * max(abs(vx), abs(vy)) / self.acceleration
        for missing, rate in zip(missing_by, (vx, vy, -vx, -vy), strict=True):
            b = 0.5 * rate
            inside = b * b + 4.0 * k * missing  # k T^2 + b T >= missing, always if this is negative
            if inside > 0.0:
                least = max(least, (math.sqrt(inside) - b) / (2.0 * k))
        return least

    def rows(self, time: float) -> tuple[list[float], list[float]]:
        """Return h (4,), c (4,) of (u, -u) <= h T + c, the tangent of its parabola at ``time``."""
        k, (x, y), (vx, vy) = FAR * self.acceleration, self.place, self.rate
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

    lower: Pair
    upper: Pair
    least: float
    most: float
    sole: Pair
    reach: Reach
    about: float


class StepWeights(NamedTuple):
    """Squared costs: of the place [1/m^2], of time by its growth factor, of offset and VRP."""

    place: float = 1.0
    time: float = 0.05
    offset: float = 1e3
    vrp: float = 0.1


WEIGHTS = StepWeights()
Multipliers = tuple[list[float], list[float]]


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

    place: Pair
    left: float
    offset: Pair
    vrp: Pair
    adapted: bool = True
    multipliers: Multipliers | None = None


def step_qp(
    dcm: Pair,
    nominal: StepPlan,
    bounds: StepBounds,
    omega: float,
    double: float,
    weights: StepWeights,
) -> FlatQP:
    """Return the QP in x = (u, sigma / sigma_0, b, w).

    Parameters
    ----------
    dcm:
        (2,) from the standing foot, in its axes [m].
    nominal:
        What is wanted; its ``vrp`` too.
    """
    sigma, grow = math.exp(omega * nominal.left), math.exp(omega * double)
    gain, (dx, dy), (sx, sy) = shift_gain(omega, double), dcm, bounds.sole
    place, time, offset, vrp = weights
    vrp /= (sigma - 1.0) ** 2
    cost = place, place, time, offset, offset, vrp, vrp
    (px, py), (bx, by), (zx, zy) = nominal.place, nominal.offset, nominal.vrp
    wanted = px, py, 1.0, bx, by, (sigma - 1.0) * zx, (sigma - 1.0) * zy
    P = [0.0] * 49
    P[::8] = cost
    A = (
        *(gain, 0.0, -grow * sigma * dx, 1.0, 0.0, grow, 0.0),
        *(0.0, gain, -grow * sigma * dy, 0.0, 1.0, 0.0, grow),
    )
    speed, far = bounds.reach.rows(bounds.about)
    a, b, c, d = speed
    # T = about + (sigma / sigma(about) - 1) / omega, to first order
    early = -math.exp(omega * (nominal.left - bounds.about)) / omega
    C = (
        *(0.0, 0.0, -sigma * sx, 0.0, 0.0, 1.0, 0.0),
        *(0.0, 0.0, -sigma * sy, 0.0, 0.0, 0.0, 1.0),
        *(0.0, 0.0, -sigma * sx, 0.0, 0.0, -1.0, 0.0),
        *(0.0, 0.0, -sigma * sy, 0.0, 0.0, 0.0, -1.0),
        *(1.0, 0.0, early * a, 0.0, 0.0, 0.0, 0.0),
        *(0.0, 1.0, early * b, 0.0, 0.0, 0.0, 0.0),
        *(-1.0, 0.0, early * c, 0.0, 0.0, 0.0, 0.0),
        *(0.0, -1.0, early * d, 0.0, 0.0, 0.0, 0.0),
    )
    ahead = bounds.about - 1.0 / omega
    reached = [c + h * ahead for h, c in zip(speed, far, strict=True)]
    g = [-one * goal for one, goal in zip(cost, wanted, strict=True)]
    least, longest = math.exp(omega * bounds.least) / sigma, math.exp(omega * bounds.most) / sigma
    lower = *bounds.lower, least, *NO_LEAST[:4]
    upper = *bounds.upper, longest, *FREE
    u = -sx, -sy, -sx, -sy, *reached
    return FlatQP([*P, *A, *C, *g, *lower, *upper, 0.0, 0.0, *NO_LEAST, *u], FORM)


def adapt_step(
    dcm: Pair,
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
    found = SOLVER.solve_flat(step_qp(dcm, nominal, bounds, omega, double, weights))
    if found is None:
        (x, y), low, high = nominal.place, bounds.lower, bounds.upper
        place = min(max(x, low[0]), high[0]), min(max(y, low[1]), high[1])
        left = min(max(nominal.left, bounds.least), bounds.most)
        return StepPlan(place, left, nominal.offset, nominal.vrp, adapted=False)
    (ux, uy, grown, bx, by, wx, wy), z, z_box = found
    sigma = max(grown * math.exp(omega * nominal.left), 1e-9)
    left = min(max(math.log(sigma) / omega, bounds.least), bounds.most)
    grows = math.expm1(omega * left)
    return StepPlan((ux, uy), left, (bx, by), (wx / grows, wy / grows), multipliers=(z, z_box))


def held_back_by(multipliers: Multipliers | None, sign: float) -> tuple[str, ...]:
    """Return what holds a footstep back, in words, the strongest first.

    Parameters
    ----------
    sign:
        Of y on the side of the foot in the air.
    """
    if multipliers is None:
        return ()
    rows, box = multipliers
    pull = list(zip(ROWS_HOLD, map(abs, rows), strict=True))
    for names, size, way in zip(BOUNDS, box[:3], (1.0, -sign, 1.0), strict=True):
        pull.append((names[size * way > 0.0], abs(size)))
    strongest = sorted(pull, key=lambda one: -one[1])
    return tuple(dict.fromkeys(name for name, size in strongest if size > NEGLIGIBLE))
