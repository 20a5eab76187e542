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
from wbc.qp.daqp import Daqp
from wbc.qp.problem import QP, Labels
from wbc.validate import Array

NAMES = ("u x", "u y", "sigma", "b x", "b y", "w x", "w y")
SIDES = ("x most", "y most", "x least", "y least")
ROWS = (*(f"w {side}" for side in SIDES), *(f"reach {side}" for side in SIDES))
BOTH = np.vstack((np.eye(2), -np.eye(2)))
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
        k, b = FAR * self.acceleration, BOTH @ (0.5 * self.rate)
        missing = np.concatenate((lower - self.place, self.place - upper))
        inside = b * b + 4.0 * k * missing  # k T^2 + b T >= missing, always if this is negative
        times = np.where(inside < 0.0, 0.0, np.sqrt(np.maximum(inside, 0.0)) - b) / (2.0 * k)
        stop = STOP * float(np.abs(self.rate).max()) / self.acceleration
        return max(float(times.max()), stop)

    def rows(self, time: float) -> tuple[Array, Array]:
        """Return h (4,), c (4,) of (u, -u) <= h T + c, the tangent of its parabola at ``time``."""
        k = FAR * self.acceleration
        h = BOTH @ (0.5 * self.rate) + 2.0 * k * time
        return h, BOTH @ self.place - k * time**2


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
    """

    place: Array
    left: float
    offset: Array
    vrp: Array


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
    sigma = math.exp(omega * nominal.left)
    grow = math.exp(omega * double)
    cost = np.repeat(weights, 2)[[0, 1, 2, 4, 5, 6, 7]]
    cost[5:] /= (sigma - 1.0) ** 2
    wanted = np.array((*nominal.place, 1.0, *nominal.offset, *(sigma - 1.0) * nominal.vrp))
    A = np.zeros((2, 7))
    A[:, :2] = shift_gain(omega, double) * np.eye(2)
    A[:, 2] = -grow * sigma * dcm
    A[:, 3:5] = np.eye(2)
    A[:, 5:] = grow * np.eye(2)
    C = np.zeros((8, 7))
    C[:4, 2] = -sigma * np.tile(bounds.sole, 2)
    C[:4, 5:] = BOTH
    speed, most = bounds.reach.rows(bounds.about)
    C[4:, :2] = BOTH
    # T = about + (sigma / sigma(about) - 1) / omega, to first order
    C[4:, 2] = -speed / omega * math.exp(omega * (nominal.left - bounds.about))
    most += speed * (bounds.about - 1.0 / omega)
    free = np.full(8, np.inf)
    times = [math.exp(omega * time) / sigma for time in (bounds.least, bounds.most)]
    return QP(
        np.diag(cost),
        -cost * wanted,
        A,
        np.zeros(2),
        C,
        -free,
        np.concatenate((-np.tile(bounds.sole, 2), most)),
        np.array((*bounds.lower, times[0], *-free[:4])),
        np.array((*bounds.upper, times[1], *free[:4])),
        Labels(("dcm x", "dcm y"), ROWS, NAMES),
    )


def adapt_step(
    dcm: Array,
    nominal: StepPlan,
    bounds: StepBounds,
    omega: float,
    double: float,
    weights: StepWeights = WEIGHTS,
) -> StepPlan:
    """Return the footstep nearest to ``nominal`` from which the walk goes on."""
    qp = step_qp(dcm, nominal, bounds, omega, double, weights)
    x = Daqp().solve(qp, quick=True).x
    sigma = max(x[2] * math.exp(omega * nominal.left), 1e-9)
    left = min(max(math.log(sigma) / omega, bounds.least), bounds.most)
    return StepPlan(x[:2], left, x[3:5], x[5:7] / math.expm1(omega * left))
