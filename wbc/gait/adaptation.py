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
from wbc.native import lib
from wbc.qp.active_set import ActiveSet
from wbc.qp.core import FlatForm, FlatQP
from wbc.qp.problem import Labels

VARIABLES = ("u x", "u y", "sigma", "b x", "b y", "w x", "w y")
SIDES = ("x most", "y most", "x least", "y least")
ROW_LABELS = (*(f"w {side}" for side in SIDES), *(f"reach {side}" for side in SIDES))
FORM = FlatForm(Labels(("dcm x", "dcm y"), ROW_LABELS, VARIABLES))
SOLVER = ActiveSet()
# What limits a footstep, named by active bounds on u and sigma (lower, upper) and active rows.
BINDING_BOUNDS = (
    ("reach of the legs behind", "reach of the legs ahead"),
    ("reach of the legs aside", "the other foot"),
    ("least time in the air", "longest time in the air"),
)
BINDING_ROWS = ("the sole",) * 4 + ("acceleration of the foot",) * 4
# Smaller multipliers are not reported: 1e-3 in the cost is 1 mm of a step.
NEGLIGIBLE = 1e-3


REST_RANGE: float = lib.wbc_rest_range
Pair = tuple[float, float]


class Reach(NamedTuple):
    """Where the swing foot can come to rest within a time T, at a limited acceleration a.

    On each axis that is place + T/2 rate +- a T^2 sqrt(3)/10.

    Attributes
    ----------
    place, rate:
        (2,) position and velocity of the swing foot, in the stance foot's axes [m, m/s].
    acceleration:
        Largest on each axis [m/s^2].
    """

    place: Pair
    rate: Pair
    acceleration: float

    def min_time(self, lower: Pair, upper: Pair) -> float:
        """Return the shortest time [s] to come to rest in the box of corners (2,)."""
        pairs = tuple(self.place), tuple(self.rate), tuple(lower), tuple(upper)
        return float(lib.wbc_rest_time(self.acceleration, *pairs))

    def rows(self, time: float) -> tuple[list[float], list[float]]:
        """Return h (4,), c (4,) of (u, -u) <= h T + c: the reach linearised at T = ``time``."""
        k, (x, y), (vx, vy) = REST_RANGE * self.acceleration, self.place, self.rate
        slope, offset = 2.0 * k * time, k * time**2
        h = [slope + 0.5 * rate for rate in (vx, vy, -vx, -vy)]
        return h, [place - offset for place in (x, y, -x, -y)]


class StepBounds(NamedTuple):
    """Bounds of the next footstep, in the stance foot's axes.

    Attributes
    ----------
    lower, upper:
        (2,) of the next foot's place [m].
    min_time, max_time:
        Of the remaining swing time [s].
    sole:
        (2,) how far the VRP may move within the stance foot, either way [m].
    reach:
        Of the swing foot.
    about:
        The remaining swing time at which the reach is linearised: as planned last [s].
    """

    lower: Pair
    upper: Pair
    min_time: float
    max_time: float
    sole: Pair
    reach: Reach
    about: float


class StepWeights(NamedTuple):
    """Quadratic costs of place [1/m^2], growth factor of the time, DCM offset and VRP [1/m^2]."""

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
        (2,) from the stance foot, in its axes [m].
    left:
        Remaining swing time [s].
    offset:
        (2,) of the DCM from the next foot at the beginning of its single support [m].
    vrp:
        (2,) of the VRP from the stance foot until then [m].
    adapted:
        Whether the QP was solved; else this is the nominal plan clipped to its bounds.
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
    """Return the QP in x = (u, sigma / sigma_0, b, w), as source/footstep.c writes it.

    Parameters
    ----------
    dcm:
        (2,) from the stance foot, in its axes [m].
    nominal:
        The plan whose deviation is the cost; its ``vrp`` too.
    """
    slopes, offsets = bounds.reach.rows(bounds.about)
    step = *dcm, *nominal.place, nominal.left, *nominal.offset, *nominal.vrp
    times, sole = (bounds.min_time, bounds.max_time), bounds.sole
    box = *bounds.lower, *bounds.upper, *times, *sole, *slopes, *offsets, bounds.about
    pendulum = omega, double, shift_gain(omega, double)
    numbers = FORM.memory()
    lib.wbc_footstep((*step, *box, *pendulum, *weights), numbers)
    return FlatQP(numbers, FORM)


def adapt_step(
    dcm: Pair,
    nominal: StepPlan,
    bounds: StepBounds,
    omega: float,
    double: float,
    weights: StepWeights = WEIGHTS,
) -> StepPlan:
    """Return the footstep nearest to ``nominal`` that captures the DCM.

    Where the QP is not solved (its feasible set may be a single point), return the nominal one
    clipped to its bounds, with ``adapted=False``: it need not catch the robot.
    """
    solution = SOLVER.solve_flat(step_qp(dcm, nominal, bounds, omega, double, weights))
    if solution is None:
        (x, y), low, high = nominal.place, bounds.lower, bounds.upper
        place = min(max(x, low[0]), high[0]), min(max(y, low[1]), high[1])
        left = min(max(nominal.left, bounds.min_time), bounds.max_time)
        return StepPlan(place, left, nominal.offset, nominal.vrp, adapted=False)
    (ux, uy, growth, bx, by, wx, wy), z, z_box = solution
    sigma = max(growth * math.exp(omega * nominal.left), 1e-9)
    left = min(max(math.log(sigma) / omega, bounds.min_time), bounds.max_time)
    scale = math.expm1(omega * left)
    return StepPlan((ux, uy), left, (bx, by), (wx / scale, wy / scale), multipliers=(z, z_box))


def held_back_by(multipliers: Multipliers | None, sign: float) -> tuple[str, ...]:
    """Return the names of the active bounds of a footstep, the strongest first.

    Parameters
    ----------
    sign:
        Of y on the side of the swing foot.
    """
    if multipliers is None:
        return ()
    rows, box = multipliers
    strengths = list(zip(BINDING_ROWS, map(abs, rows), strict=True))
    for names, size, side in zip(BINDING_BOUNDS, box[:3], (1.0, -sign, 1.0), strict=True):
        strengths.append((names[size * side > 0.0], abs(size)))
    strongest = sorted(strengths, key=lambda entry: -entry[1])
    return tuple(dict.fromkeys(name for name, size in strongest if size > NEGLIGIBLE))
