"""The result of planning: the motion at knots and at any time, and how it was found."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import accumulate

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError
from wbc.rmp.plan.layout import Layout, lay_out, units_of
from wbc.rmp.plan.motion import (
    body_rate,
    motion,
    principal_moments,
    quaternion,
    reference_axes,
    rotation,
)
from wbc.rmp.plan.problem import PlanProblem
from wbc.validate import Array, finite_array, read_only

# How far a time may lie outside the plan by rounding, as a fraction of its length.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion at n moments; vectors in world axes unless said otherwise. Read-only.

    Attributes
    ----------
    time:
        [s] (n,).
    phase:
        Places in the schedule (n,).
    com, com_velocity, com_acceleration:
        c, c', c'' (n, 3) [m, m/s, m/s^2].
    orientation:
        Of the masses' axes: quaternions (n, 4), x y z w.
    angular_velocity:
        Of the masses' axes (n, 3) [rad/s].
    momentum, momentum_rate:
        k_G and k_G' (n, 3) [kg m^2/s, N m].
    radii, radii_rates, radii_accelerations:
        r, r', r'' (n, 3).
    inertia:
        Principal moments about the masses' axes (n, 3) [kg m^2].
    force:
        Of the ground (n, 3) [N]; zero in flight.
    cop, cop_velocity:
        p and p' on the ground (n, 2) [m, m/s]; NaN in flight, where there is none.
    moment:
        About the vertical through the CoP (n,) [N m].
    """

    time: Array
    phase: NDArray[np.int64]
    com: Array
    com_velocity: Array
    com_acceleration: Array
    orientation: Array
    angular_velocity: Array
    momentum: Array
    momentum_rate: Array
    radii: Array
    radii_rates: Array
    radii_accelerations: Array
    inertia: Array
    force: Array
    cop: Array
    cop_velocity: Array
    moment: Array

    def __post_init__(self) -> None:
        for each in fields(self):
            getattr(self, each.name).flags.writeable = False


@dataclass(frozen=True)
class Stats:
    """Size of the programme and what IPOPT did with it.

    Attributes
    ----------
    seconds:
        CPU time [s] of setting up and solving.
    status:
        IPOPT's verdict.
    warm:
        True if an earlier plan was the start.
    """

    variables: int
    constraints: int
    iterations: int
    seconds: float
    cost: float
    status: str
    warm: bool


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned motion.

    Attributes
    ----------
    solution:
        The programme's variables (n,), scaled.
    duals:
        Multipliers of bounds on variables (n,) and of rows (m,), for a warm start.
    stats:
        How it was found.
    """

    problem: PlanProblem
    solution: Array
    duals: tuple[Array, Array]
    stats: Stats
    layout: Layout = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "layout", lay_out(self.problem))
        for array in (self.solution, *self.duals):
            read_only(array)

    @property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases in order."""
        return tuple(phase.name for phase in self.problem.schedule)

    @cached_property
    def durations(self) -> Array:
        """Of the phases [s] (phases,)."""
        unit = units_of(self.problem)["time"]
        places = [phase.duration for phase in self.layout.phases]
        return read_only(self.solution[places] * unit)

    @cached_property
    def starts(self) -> Array:
        """When each phase begins, and last the end of the plan [s] (phases + 1,)."""
        return read_only(np.array(list(accumulate(self.durations.tolist(), initial=0.0))))

    @property
    def duration(self) -> float:
        """Of the whole plan [s]."""
        return float(self.starts[-1])

    @cached_property
    def knots(self) -> Trajectory:
        """The motion at the knots.

        Where a phase ends, the first knot of the next one follows: this time is there twice, before
        and after forces jump.
        """
        return self.refined(1)

    def refined(self, factor: int) -> Trajectory:
        """Return the motion at ``factor`` equal parts of each interval; as :attr:`knots`.

        Raises
        ------
        InvalidInputError
            A factor below 1.
        """
        if factor < 1:
            raise InvalidInputError(f"plan: factor must be 1 at least, got {factor}")
        phases, intervals, parts, times = [], [], [], []
        for k, phase in enumerate(self.problem.schedule):
            count = phase.intervals * factor
            step = np.arange(count + 1)
            interval = np.minimum(step // factor, phase.intervals - 1)
            phases.append(np.full(count + 1, k))
            intervals.append(interval)
            parts.append((step - interval * factor) / factor)
            times.append(self.starts[k] + self.durations[k] * (step / count))
        return self._sampled(*(np.concatenate(x) for x in (times, phases, intervals, parts)))

    def at(self, time: ArrayLike) -> Trajectory:
        """Return the motion at times (n,) or one time, as a trajectory of n or one moments.

        Where a phase ends, the next one counts.

        Raises
        ------
        InvalidInputError
            A time before the plan's start or after its end.
        """
        flat = np.atleast_1d(np.asarray(time, dtype=float))
        t = finite_array("time", flat, (flat.size,))
        margin = ROUNDING * self.duration
        if t.size and (t.min() < -margin or t.max() > self.duration + margin):
            raise InvalidInputError(
                f"plan: times from {t.min():g} to {t.max():g} s are not all within the plan, 0 to"
                f" {self.duration:g} s"
            )
        t = np.clip(t, 0.0, self.duration)
        phases = np.searchsorted(self.starts[1:-1], t, side="right")
        counts = np.array([phase.intervals for phase in self.problem.schedule])[phases]
        within = (t - self.starts[phases]) / self.durations[phases] * counts
        intervals = np.clip(within.astype(int), 0, counts - 1)
        return self._sampled(t, phases, intervals, within - intervals)

    @cached_property
    def _samplers(self) -> list[ca.Function]:
        return [_sampler(self.problem, k) for k in range(len(self.phases))]

    def _sampled(
        self, time: Array, phase: NDArray[np.int64], interval: NDArray[np.int64], part: Array
    ) -> Trajectory:
        """Return the motion at parts 0..1 of intervals of phases."""
        columns = np.empty((sum(_SAMPLED.values()), len(time)))
        for k, sample in enumerate(self._samplers):
            chosen = np.flatnonzero(phase == k)
            if chosen.size:
                z = self.solution[self.layout.phases[k].intervals[:, interval[chosen]]]
                columns[:, chosen] = sample.map(chosen.size)(z, part[chosen][None]).full()
        ends = np.cumsum(list(_SAMPLED.values()))[:-1]
        parts = {
            name: np.array(rows[0] if len(rows) == 1 else rows.T)
            for name, rows in zip(_SAMPLED, np.split(columns, ends), strict=True)
        }
        return Trajectory(time=time, phase=phase, **parts)


# What a sampler returns, in its order, with sizes.
_SAMPLED = {
    each.name: {"orientation": 4, "cop": 2, "cop_velocity": 2, "moment": 1}.get(each.name, 3)
    for each in fields(Trajectory)
    if each.name not in ("time", "phase")
}


def _sampler(problem: PlanProblem, phase: int) -> ca.Function:
    """Return the Function (interval's scaled variables, s in 0..1) -> all quantities in a column.

    Positions, velocities, momenta, radii and forces are exact; the orientation is the collocation
    polynomial's.
    """
    of = problem.schedule[phase]
    m = motion(problem, units_of(problem), of.flies, of.intervals)
    s = ca.SX.sym("s")
    at = {name: p(s) for name, p in (m.states | m.controls).items()}
    at |= {"com_acceleration": m.acceleration(s), "momentum_rate": m.torque(s)}
    if of.flies:
        at |= {"force": ca.SX.zeros(3), "moment": ca.SX.zeros(1)}
        at |= {"cop": ca.SX.nan(2), "cop_velocity": ca.SX.nan(2)}
    else:
        at["cop_velocity"] = m.controls["cop"].coefficients[1] / m.duration
    sigma = at["orientation"]
    rate = body_rate(problem, sigma, at["momentum"], at["radii"])
    at["orientation"] = quaternion(problem, sigma)
    at["angular_velocity"] = reference_axes(problem) @ (rotation(sigma) @ rate)
    at["inertia"] = principal_moments(problem.mass, at["radii"])
    column = ca.vertcat(*(ca.densify(at[name]) for name in _SAMPLED))
    return ca.Function("sample", [m.z, s], [column])
