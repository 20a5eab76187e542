"""Where and when the next foot lands, from the capture point as measured: one small QP.

Seen from the standing foot, with the DCM at d and the VRP moved by z within that foot, the single
support ends after ln(sigma)/omega and the double support begins with the DCM at z + sigma (d - z).
It must end where the next foot, at u, goes on from: at u + b (:func:`wbc.gait.dcm.shift_gain`):

    (1 + alpha) u + b = exp(omega T_double) (sigma d + (1 - sigma_0) z),

linear in u (2), sigma, b (2) and z (2) once sigma is its nominal value sigma_0 beside z. After
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

NAMES = ("u x", "u y", "sigma", "b x", "b y", "z x", "z y")


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
    """

    lower: Array
    upper: Array
    least: float
    most: float
    sole: Array


class StepWeights(NamedTuple):
    """Squared costs: of the place [1/m^2], of time by its growth factor, of offset and VRP."""

    place: float = 1.0
    time: float = 0.02
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
    """Return the QP in x = (u, sigma / sigma_0, b, z).

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
    wanted = np.array((*nominal.place, 1.0, *nominal.offset, *nominal.vrp))
    A = np.zeros((2, 7))
    A[:, :2] = shift_gain(omega, double) * np.eye(2)
    A[:, 2] = -grow * sigma * dcm
    A[:, 3:5] = np.eye(2)
    A[:, 5:] = grow * (sigma - 1.0) * np.eye(2)
    free = np.full(2, np.inf)
    times = [math.exp(omega * time) / sigma for time in (bounds.least, bounds.most)]
    return QP(
        np.diag(cost),
        -cost * wanted,
        A,
        np.zeros(2),
        np.zeros((0, 7)),
        np.zeros(0),
        np.zeros(0),
        np.array((*bounds.lower, times[0], *-free, *-bounds.sole)),
        np.array((*bounds.upper, times[1], *free, *bounds.sole)),
        Labels(("dcm x", "dcm y"), (), NAMES),
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
    sigma = x[2] * math.exp(omega * nominal.left)
    left = min(max(math.log(max(sigma, 1e-9)) / omega, bounds.least), bounds.most)
    return StepPlan(x[:2], left, x[3:5], x[5:7])
