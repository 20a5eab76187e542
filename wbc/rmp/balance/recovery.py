"""Pushed, and back at rest within all bounds? One push, or the largest in each direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import Command
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import unit_directions
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.region import rest_error
from wbc.rmp.balance.simulate import Push, simulate
from wbc.validate import Array, finite_array, finite_number, finite_vector

# How near to rest, as :func:`wbc.rmp.balance.region.rest_error` measures it.
NEAR = 0.02


@dataclass(frozen=True, eq=False)
class Recovery:
    """What became of a push.

    Attributes
    ----------
    impulse:
        Level (2,) [N s].
    survived:
        It came to rest upright, the masses where they were, and no bound was broken on the way.
    settled_at:
        When it was at rest [s]; the end of the run if it was not.
    broken:
        Names of the bounds that were broken; see :meth:`Simulation.broken`.
    simulation:
        The motion.
    """

    impulse: Array
    survived: bool
    settled_at: float
    broken: tuple[str, ...]
    simulation: Simulation


def standing(law: MomentumQp) -> tuple[Array, Array]:
    """Return (q, v) at rest, the leg upright below the CoM's place of rest."""
    x, y, height = np.asarray(law.com).tolist()
    turned = (0.0, 0.0, 0.0, 1.0)
    q = np.array((x, y, np.pi / 2, 0.0, height, *turned, *np.asarray(law.radii)))
    return q, np.zeros(11)


def recover(law: MomentumQp, impulse: ArrayLike, *, duration: float = 8.0) -> Recovery:
    """Push a pendulum at rest at time zero and watch it, for as long as it takes.

    The law is asked every ``law.dt``.

    Parameters
    ----------
    impulse:
        Level, at the CoM (2,) [N s].
    duration:
        Longest run [s].

    Raises
    ------
    InvalidInputError
        Wrong sizes, not finite, or not positive.
    """
    level = finite_vector("impulse", impulse, 2)
    start, still = standing(law)

    def settled(time: float, q: Array, v: Array, command: Command) -> bool:
        return time > 0.0 and _error(q, v, start) <= NEAR

    run = simulate(
        law,
        start,
        still,
        duration,
        dt=law.dt,
        bounds=law.bounds,
        pushes=[Push(0.0, (*level, 0.0))],
        stop=settled,
    )
    broken = tuple(run.broken())
    back = run.ending is Ending.COMPLETE and _error(run.q[-1], run.v[-1], start) <= NEAR
    return Recovery(level, back and not broken, run.ended_at, broken, run)


def largest_impulses(
    law: MomentumQp, directions: ArrayLike, bracket: ArrayLike, *, resolution: float = 0.1
) -> Array:
    """Return the largest impulses survived (n,) [N s], by bisection, each to ``resolution``.

    Bisection sees one border only; :func:`recover` on a grid of impulses tells whether there are
    holes below it.

    Parameters
    ----------
    directions:
        (n, 2), of any length but zero.
    bracket:
        An impulse that is survived and one that is not, for each direction (n, 2) [N s]. An end
        that turns out on the wrong side is returned as it is.
    resolution:
        [N s].

    Raises
    ------
    InvalidInputError
        Wrong sizes, not finite, a bracket the wrong way round.
    """
    along = unit_directions(directions)
    ends = finite_array("bracket", bracket, (len(along), 2))
    if (ends[:, 0] >= ends[:, 1]).any():
        raise InvalidInputError("bracket: each must be (survived, not survived), growing")
    resolution = finite_number("resolution", resolution, above=0.0)
    return np.array(
        [
            _bisected(law, e, low, high, resolution)
            for e, (low, high) in zip(along, ends.tolist(), strict=True)
        ]
    )


def _bisected(
    law: MomentumQp, direction: Array, low: float, high: float, resolution: float
) -> float:
    while high - low > resolution:
        middle = (low + high) / 2
        if recover(law, middle * direction).survived:
            low = middle
        else:
            high = middle
    return low


def _error(q: Array, v: Array, rest: Array) -> float:
    return float(rest_error(np.concatenate((q, v))[None], rest)[0])
