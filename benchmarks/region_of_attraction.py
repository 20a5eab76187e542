"""The leans from which a law brings the pendulum back, measured on a grid, all runs in one call."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wbc.rmp.balance.simulate import FALLEN
from wbc.rmp.integrators import runge_kutta
from wbc.rmp.solid import SolidRmp
from wbc.rotations import conjugate_product
from wbc.validate import Array

# How near to rest counts as attracted: angles [rad] and rates [rad/s], lengths relative to the leg.
NEAR = 0.02
# Time between checks for fallen and settled runs [s].
LOOK = 0.1


class SymbolicLaw(Protocol):
    """A law that is a CasADi Function, so that many runs go through one call."""

    @property
    def model(self) -> SolidRmp:
        """The pendulum that it controls."""

    @property
    def function(self) -> ca.Function:
        """(q, v) -> f (9,), the foot at rest."""


class Region(NamedTuple):
    """The result of each start."""

    starts: Array  # (q, v) (n, 23)
    attracted: NDArray[np.bool_]  # whether it came to rest (n,)
    settling: Array  # when [s] (n,), to the next check; NaN if it did not
    error: Array  # distance from rest when last looked at (n,), see rest_error


def lean_grid(rest: Array, x_leans: Array, y_leans: Array) -> Array:
    """Return starts (nx * ny, 23) at rest with the leg leaning, x slowest.

    The leg keeps its length and leans by the rotation vector (0, lean x, 0) + (-lean y, 0, 0), so
    toward +x and +y. The masses keep their orientation.

    Parameters
    ----------
    rest:
        Configuration (12,) with the leg upright.
    x_leans, y_leans:
        [rad], less than a right angle together.
    """
    x, y = (part.ravel() for part in np.meshgrid(x_leans, y_leans, indexing="ij"))
    lean = np.hypot(x, y)
    # sin(lean) / lean, finite at zero.
    across = np.sinc(lean / np.pi)
    n = np.column_stack((across * x, across * y, np.cos(lean)))
    starts = np.tile(np.concatenate((rest, np.zeros(11))), (len(x), 1))
    starts[:, 2] = np.arctan2(n[:, 2], n[:, 0])
    starts[:, 3] = np.arcsin(n[:, 1])
    return starts


def rest_error(states: Array, rest: Array) -> Array:
    """Return the distance of states (n, 23) from rest at (12,), as one number (n,).

    The largest of: the angles of leg and masses [rad], their rates [rad/s], the leg's length and
    the radii relative to the leg, and their rates per second.
    """
    leg = rest[4]
    turned = 2.0 * np.linalg.norm(conjugate_product(states[:, 5:9], rest[None, 5:9]), axis=1)
    off = np.abs(states[:, 2:5] - rest[2:5]) / (1.0, 1.0, leg)
    slid = np.abs(states[:, 9:12] - rest[9:12]) / leg
    rates = np.abs(states[:, 14:]) / (1.0, 1.0, leg, 1.0, 1.0, 1.0, leg, leg, leg)
    return np.asarray(np.column_stack((turned, off, slid, rates)).max(axis=1))


def region_of_attraction(
    law: SymbolicLaw, rest: Array, starts: Array, duration: float = 8.0, dt: float = 2e-3
) -> Region:
    """Return which starts (n, 23) a law brings to rest; some 3 us for each start and step.

    The full equations of motion are integrated, the command held over each ``dt``. A run is over
    when it has come within ``NEAR`` of rest, or when its leg is lower than in
    :func:`~wbc.rmp.balance.simulate.simulate`. Its own limits are all that limit the law's command.
    """
    per_look = max(1, round(LOOK / dt))
    many, x, n = _closed_loop(law, dt).fold(per_look), starts.copy(), len(starts)
    attracted, going = np.zeros(n, dtype=bool), np.arange(n)
    settling, last = np.full(n, np.nan), np.full(n, np.nan)
    for k in range(round(duration / (per_look * dt)) + 1):
        if k:
            x[going] = many.map(len(going))(x[going].T).full().T
        seen = x[going]
        last[going] = error = rest_error(seen, rest)
        settled = going[error <= NEAR]
        attracted[settled], settling[settled] = True, k * per_look * dt
        elevation = np.sin(seen[:, 2]) * np.cos(seen[:, 3])
        # NaN compares false, and so ends here.
        stands = (elevation >= np.sin(FALLEN)) & (seen[:, 4] > 0.0) & (error > NEAR)
        going = going[stands]
        if not len(going):
            break
    return Region(starts, attracted, settling, last)


def _closed_loop(law: SymbolicLaw, dt: float) -> ca.Function:
    x = ca.SX.sym("x", 23)
    u = ca.vertcat(ca.SX.zeros(2), law.function(x[:12], x[12:]))
    return ca.Function("closed_loop", [x], [ca.densify(runge_kutta(law.model, dt)(x, u))])
