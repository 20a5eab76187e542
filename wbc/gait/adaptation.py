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

from typing import Any, NamedTuple

import numpy as np

from wbc.gait.dcm import shift_gain
from wbc.native import ffi, lib
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Status

VARIABLES = ("u x", "u y", "sigma", "b x", "b y", "w x", "w y")
SIDES = ("x most", "y most", "x least", "y least")
ROW_LABELS = (*(f"w {side}" for side in SIDES), *(f"reach {side}" for side in SIDES))
LABELS = Labels(("dcm x", "dcm y"), ROW_LABELS, VARIABLES)
A_FOOTSTEP = ffi.typeof("wbc_footstep *")
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


Pair = tuple[float, float]


class StepBounds(NamedTuple):
    """Bounds of the next footstep, in the stance foot's axes.

    Attributes
    ----------
    lower, upper:
        (2,) of the next foot's place [m].
    min_time, max_time:
        Of the remaining swing time; later if the swing foot cannot be there so soon [s].
    sole:
        (2,) how far the VRP may move within the stance foot, either way [m].
    foot, rate, acceleration:
        (2,) where the swing foot is, and its velocity, and the largest acceleration on each axis:
        within T it can come to rest at foot + T/2 rate +- acceleration T^2 sqrt(3)/10 [m, m/s,
        m/s^2].
    about:
        The remaining swing time at which that is linearised: as planned last [s].
    """

    lower: Pair
    upper: Pair
    min_time: float
    max_time: float
    sole: Pair
    foot: Pair
    rate: Pair
    acceleration: float
    about: float


class StepWeights(NamedTuple):
    """Quadratic costs of place [1/m^2], growth factor of the time, DCM offset and VRP [1/m^2]."""

    place: float = 1.0
    time: float = 0.05
    offset: float = 1e3
    vrp: float = 0.1


WEIGHTS = StepWeights()
Multipliers = list[float]


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
        Of the rows (8) and then of the bounds (7), positive at the upper ones; see
        :func:`held_back_by`.
    """

    place: Pair
    left: float
    offset: Pair
    vrp: Pair
    adapted: bool = True
    multipliers: Multipliers | None = None


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
    clipped to its bounds, with ``adapted=False``: it need not catch the robot. See
    source/footstep.c.

    Parameters
    ----------
    dcm:
        (2,) from the stance foot, in its axes [m].
    """
    pendulum = omega, double, shift_gain(omega, double)
    step = ffi.new(A_FOOTSTEP, (dcm, *nominal[:4], *bounds, *pendulum, weights))
    adapted = solve_step(step)
    plan = tuple(step.place), step.left, tuple(step.offset), tuple(step.vrp)
    return StepPlan(*plan, adapted, list(step.multipliers) if adapted else None)


def solve_step(step: Any) -> bool:
    """Plan a ``wbc_footstep``; return whether its QP was solved."""
    if lib.wbc_solve_footstep(step, SOLVER.eps, SOLVER.max_iterations) == lib.DONE:
        return True
    # Again, to the accuracy that its numbers let have.
    found = SOLVER.solve(qp_of(step), quick=True)
    solved = found.status is Status.SOLVED
    if solved:
        step.x, step.multipliers = found.x.tolist(), [*found.z.tolist(), *found.z_box.tolist()]
    lib.wbc_place_footstep(step, solved)
    return solved


def qp_of(step: Any) -> QP:
    """Return the QP of a ``wbc_footstep``, in x = (u, sigma / sigma_0, b, w)."""
    names = {"lower": "low", "upper": "high"}  # what bounds the step itself are the others
    sides = ("g", "lower", "upper", "b", "l", "u")
    parts = {
        name: np.frombuffer(ffi.buffer(getattr(step, names.get(name, name))))
        for name in ("P", "A", "C", *sides)
    }
    rows = {name: parts[name].reshape(-1, len(VARIABLES)) for name in ("P", "A", "C")}
    return QP(**parts | rows, labels=LABELS)


def held_back_by(multipliers: Multipliers | None, sign: float) -> tuple[str, ...]:
    """Return the names of the active bounds of a footstep, the strongest first.

    Parameters
    ----------
    sign:
        Of y on the side of the swing foot.
    """
    if multipliers is None:
        return ()
    rows, box = multipliers[: len(BINDING_ROWS)], multipliers[len(BINDING_ROWS) :]
    strengths = list(zip(BINDING_ROWS, map(abs, rows), strict=True))
    for names, size, side in zip(BINDING_BOUNDS, box[:3], (1.0, -sign, 1.0), strict=True):
        strengths.append((names[size * side > 0.0], abs(size)))
    strongest = sorted(strengths, key=lambda entry: -entry[1])
    return tuple(dict.fromkeys(name for name, size in strongest if size > NEGLIGIBLE))
