"""From which starts does a law bring the pendulum back? Measured, on a grid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import BalanceLaw
from wbc.rmp.balance.record import Ending
from wbc.rmp.balance.simulate import FALLEN, simulate
from wbc.rmp.integrators import runge_kutta
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, finite_array, finite_number, finite_vector, read_only

Progress = Callable[[float], None]
Bools = NDArray[np.bool_]

# How near to rest counts as attracted: angles [rad] and rates [rad/s], lengths relative to the leg.
NEAR = 0.02
# Time between looks at who has fallen and who has settled [s].
LOOK = 0.1


class SymbolicLaw(Protocol):
    """A law that is a CasADi Function, so that many runs of it go through one."""

    @property
    def model(self) -> SolidRmp:
        """The pendulum that it controls."""

    @property
    def function(self) -> ca.Function:
        """(q, v) -> f (9,), the foot at rest."""


@dataclass(frozen=True, eq=False)
class Region:
    """What became of each start.

    Attributes
    ----------
    starts:
        States (q, v) (n, 23).
    attracted:
        Whether it came to rest (n,).
    settling:
        When [s] (n,), to the next look; NaN where it did not.
    error:
        Distance from rest when last looked at (n,), see :func:`rest_error`; NaN where the state
        was not finite any more.
    """

    starts: Array
    attracted: Bools
    settling: Array
    error: Array

    @property
    def share(self) -> float:
        """Part of the starts that were attracted."""
        return float(self.attracted.mean())


def lean_grid(rest: ArrayLike, x_leans: ArrayLike, y_leans: ArrayLike) -> Array:
    """Return starts (nx * ny, 23) at rest with the leg leaning, x slowest.

    The leg keeps its length and leans by the rotation vector (0, lean x, 0) + (-lean y, 0, 0), so
    toward +x and +y. The masses keep their orientation.

    Parameters
    ----------
    rest:
        Configuration (12,) with the leg upright.
    x_leans, y_leans:
        [rad], less than a right angle together.

    Raises
    ------
    InvalidInputError
        Wrong sizes or not finite, or a leg that would lie on the ground.
    """
    q, x, y = _leaning(rest, x_leans, y_leans)
    lean = np.hypot(x, y)
    if lean.max(initial=0.0) >= np.pi / 2:
        raise InvalidInputError(f"leans: up to {lean.max():.3g} rad; the leg would not stand")
    # sin(lean) / lean, finite at zero.
    across = np.sinc(lean / np.pi)
    n = np.column_stack((across * x, across * y, np.cos(lean)))
    starts = np.tile(np.concatenate((q, np.zeros(11))), (len(x), 1))
    starts[:, 2] = np.arctan2(n[:, 2], n[:, 0])
    starts[:, 3] = np.arcsin(n[:, 1])
    return starts


def lean_rate_grid(rest: ArrayLike, leans: ArrayLike, rates: ArrayLike) -> Array:
    """Return starts (n * m, 23) that lean and fall along x, leans [rad] slowest, rates [rad/s].

    Raises
    ------
    InvalidInputError
        Wrong sizes or not finite.
    """
    q, lean, rate = _leaning(rest, leans, rates)
    starts = np.tile(np.concatenate((q, np.zeros(11))), (len(lean), 1))
    # theta is measured from the x axis upward.
    starts[:, 2] -= lean
    starts[:, 12 + 2] = -rate
    return starts


def rest_error(states: Array, rest: Array) -> Array:
    """Return how far states (n, 23) are from rest at the configuration (12,), as one number (n,).

    The largest of: the angles of leg and masses [rad], their rates [rad/s], the leg's length and
    the radii relative to the leg, and their rates per second.
    """
    leg = rest[4]
    turned = 2.0 * np.linalg.norm(_relative(states[:, 5:9], rest[5:9]), axis=1)
    off = np.abs(states[:, 2:5] - rest[2:5]) / (1.0, 1.0, leg)
    slid = np.abs(states[:, 9:12] - rest[9:12]) / leg
    rates = np.abs(states[:, 14:]) / (1.0, 1.0, leg, 1.0, 1.0, 1.0, leg, leg, leg)
    return np.asarray(np.column_stack((turned, off, slid, rates)).max(axis=1))


def region_of_attraction(
    law: SymbolicLaw,
    rest: ArrayLike,
    starts: ArrayLike,
    *,
    duration: float = 8.0,
    dt: float = 2e-3,
    near: float = NEAR,
    progress: Progress | None = None,
) -> Region:
    """Return which starts a law brings to rest, all in one go; some 3 us for each start and step.

    The full equations of motion are integrated, the command held over each ``dt``. A run is over
    when it has come within ``near`` of rest, or when its leg is lower than in
    :func:`~wbc.rmp.balance.simulate.simulate`.

    Parameters
    ----------
    law:
        Its own limits are all that limit its command.
    rest:
        The configuration (12,) that the law holds.
    starts:
        States (n, 23).
    duration, dt:
        Longest run, and time between commands [s].
    near:
        See :func:`rest_error`.
    progress:
        Called with the part of the duration reached, now and then.

    Raises
    ------
    InvalidInputError
        Wrong sizes, not finite or not positive.
    """
    at, x, dt, near = _checked(rest, starts, dt, near)
    per_look = max(1, round(LOOK / dt))
    looks = max(1, round(finite_number("duration", duration, above=0.0) / (per_look * dt)))
    many = _closed_loop(law, dt).fold(per_look)
    tally = _Tally.of(x)
    tally.look(0.0, x, at, near)
    for k in range(looks):
        going = tally.going
        if not len(going):
            break
        x = x.copy()
        x[going] = many.map(len(going))(x[going].T).full().T
        tally.look((k + 1) * per_look * dt, x, at, near)
        if progress is not None:
            progress((k + 1) / looks)
    return tally.region()


def region_by_simulation(
    law: BalanceLaw,
    rest: ArrayLike,
    starts: ArrayLike,
    *,
    duration: float = 8.0,
    dt: float = 2e-3,
    near: float = NEAR,
    progress: Progress | None = None,
) -> Region:
    """Return the same for any law, one simulation after the other; see there for the parameters.

    Settling is told to the tick.
    """
    at, x, dt, near = _checked(rest, starts, dt, near)
    tally = _Tally.of(x)
    for k, start in enumerate(x):

        def settled(time: float, q: Array, v: Array, command: object) -> bool:
            return float(rest_error(np.concatenate((q, v))[None], at)[0]) <= near

        run = simulate(law, start[:12], start[12:], duration, dt=dt, stop=settled)
        last = np.concatenate((run.q[-1], run.v[-1]))
        tally.error[k] = rest_error(last[None], at)[0]
        tally.attracted[k] = run.ending is Ending.COMPLETE and tally.error[k] <= near
        tally.settling[k] = run.ended_at if tally.attracted[k] else np.nan
        if progress is not None:
            progress((k + 1) / len(x))
    return tally.region()


@dataclass(eq=False)
class _Tally:
    """Who is still going, and what became of the others."""

    starts: Array
    attracted: Bools
    settling: Array
    error: Array
    going: NDArray[np.intp]

    @classmethod
    def of(cls, starts: Array) -> _Tally:
        n = len(starts)
        unknown = np.full(n, np.nan)
        return cls(starts, np.zeros(n, dtype=bool), unknown, unknown.copy(), np.arange(n))

    def look(self, time: float, states: Array, rest: Array, near: float) -> None:
        """Strike out those that have settled or fallen."""
        seen = states[self.going]
        error = rest_error(seen, rest)
        self.error[self.going] = error
        settled = error <= near
        self.attracted[self.going[settled]] = True
        self.settling[self.going[settled]] = time
        elevation = np.sin(seen[:, 2]) * np.cos(seen[:, 3])
        # NaN compares false, and so ends here.
        stands = (elevation >= np.sin(FALLEN)) & (seen[:, 4] > 0.0) & np.isfinite(error)
        self.going = self.going[stands & ~settled]

    def region(self) -> Region:
        error = np.where(np.isfinite(self.error), self.error, np.nan)
        self.attracted.flags.writeable = False
        return Region(
            read_only(self.starts), self.attracted, read_only(self.settling), read_only(error)
        )


def _closed_loop(law: SymbolicLaw, dt: float) -> ca.Function:
    x = ca.SX.sym("x", 23)
    u = ca.vertcat(ca.SX.zeros(2), law.function(x[:12], x[12:]))
    after, _ = runge_kutta(law.model, dt)(x, u)
    return ca.Function("closed_loop", [x], [ca.densify(after)])


def _relative(quaternions: Array, rest: Array) -> Array:
    """Return the vector parts (n, 3) of the rotations from ``rest``."""
    u, s = quaternions[:, :3], quaternions[:, 3:]
    return np.asarray(rest[3] * u - s * rest[:3] - np.cross(rest[:3], u))


def _leaning(rest: ArrayLike, first: ArrayLike, second: ArrayLike) -> tuple[Array, Array, Array]:
    q = finite_vector("rest", rest, 12)
    axes = [finite_vector("grid", axis, np.size(axis)) for axis in (first, second)]
    a, b = np.meshgrid(*axes, indexing="ij")
    return q, a.ravel(), b.ravel()


def _checked(
    rest: ArrayLike, starts: ArrayLike, dt: float, near: float
) -> tuple[Array, Array, float, float]:
    x = finite_array("starts", starts, (len(np.atleast_2d(starts)), 23))
    return (
        finite_vector("rest", rest, 12),
        x,
        finite_number("dt", dt, above=0.0),
        finite_number("near", near, above=0.0),
    )
