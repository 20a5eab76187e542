"""The result of planning: the motion at any time, also in the coordinates of the pendulums."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import accumulate

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.kinds import whole_number
from wbc.placement import from_mrp
from wbc.rmp.plan.layout import PlanLayout, lay_out, units_of
from wbc.rmp.plan.motion import body_rate, motion, principal_moments, quaternion, reference_axes
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, finite_array, read_only, real_array, set_fields

# How far a time may lie outside the plan by rounding, as a fraction of its length.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion at n times; vectors in world axes unless stated otherwise. Read-only."""

    time: Array  # (n,) [s]
    phase: NDArray[np.int64]  # (n,) indices in the schedule
    com: Array  # c (n, 3) [m]
    com_velocity: Array  # c' (n, 3) [m/s]
    com_acceleration: Array  # c'' (n, 3) [m/s^2]
    orientation: Array  # of the masses' axes: quaternions (n, 4), x y z w
    angular_velocity: Array  # of the masses' axes (n, 3) [rad/s]
    momentum: Array  # k_G (n, 3) [kg m^2/s]
    momentum_rate: Array  # k_G' (n, 3) [N m]
    radii: Array  # r (n, 3) [m]
    radii_rates: Array  # r' (n, 3) [m/s]
    radii_accelerations: Array  # r'' (n, 3) [m/s^2]
    inertia: Array  # principal moments about the masses' axes (n, 3) [kg m^2]
    force: Array  # of the ground (n, 3) [N]; zero in flight
    cop: Array  # p on the ground (n, 2) [m]; NaN in flight, where there is none
    cop_velocity: Array  # p' (n, 2) [m/s]; NaN in flight
    moment: Array  # about the vertical through the CoP (n,) [N m]

    def __post_init__(self) -> None:
        for each in fields(self):
            getattr(self, each.name).flags.writeable = False


@dataclass(frozen=True)
class Stats:
    """Size of the programme, and IPOPT's statistics."""

    variables: int
    constraints: int
    iterations: int
    seconds: float  # CPU time [s] of setting up and solving
    cost: float
    status: str  # IPOPT's status
    warm: bool  # whether an earlier plan was the start


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned motion."""

    problem: PlanProblem
    solution: Array  # the programme's variables (n,), scaled
    duals: tuple[Array, Array]  # multipliers of bounds (n,) and rows (m,), for a warm start
    stats: Stats
    layout: PlanLayout = field(init=False, repr=False)

    def __post_init__(self) -> None:
        set_fields(self, layout=lay_out(self.problem))
        for array in (self.solution, *self.duals):
            read_only(array)

    @property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases in order."""
        return tuple(phase.name for phase in self.problem.schedule)

    @cached_property
    def durations(self) -> Array:
        """Durations of the phases [s] (phases,)."""
        unit = units_of(self.problem)["time"]
        places = [phase.duration for phase in self.layout.phases]
        return read_only(self.solution[places] * unit)

    @cached_property
    def starts(self) -> Array:
        """Start times of the phases, then the end of the plan [s] (phases + 1,)."""
        return read_only(np.array(list(accumulate(self.durations.tolist(), initial=0.0))))

    @property
    def duration(self) -> float:
        """Duration of the whole plan [s]."""
        return float(self.starts[-1])

    @cached_property
    def knots(self) -> Trajectory:
        """The motion at the knots.

        The end of a phase and the start of the next are two knots at one time, before and after
        forces jump.
        """
        return self.refined(1)

    def refined(self, factor: int) -> Trajectory:
        """Return the motion at ``factor`` equal parts of each interval, as in :attr:`knots`.

        Raises
        ------
        InvalidInputError
            A factor below 1.
        """
        factor = whole_number("plan: factor", factor, least=1)
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

        At the end of a phase it is that of the next one.

        Raises
        ------
        InvalidInputError
            A time before the plan's start or after its end.
        """
        flat = np.atleast_1d(real_array("time", time))
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
        """Return the motion at fractions 0..1 of intervals of phases."""
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


# Outputs of a sampler in order, with their sizes.
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
    at["angular_velocity"] = reference_axes(problem) @ (from_mrp(sigma) @ rate)
    at["inertia"] = principal_moments(problem.mass, at["radii"])
    column = ca.vertcat(*(ca.densify(at[name]) for name in _SAMPLED))
    return ca.Function("sample", [m.z, s], [column])


# ------------------------------------------------------------------ coordinates of the pendulums


@dataclass(frozen=True, eq=False)
class Generalised:
    """Motion of a pendulum at n moments in stance, in the order of its Q, V and F."""

    q: Array  # (n, nq)
    v: Array  # (n, nv)
    a: Array  # (n, nv); the CoP's acceleration, the first, is zero between knots
    forces: Array  # (n, nf): of the ground, of the torque on the masses, and along the rails

    def __post_init__(self) -> None:
        for array in (self.q, self.v, self.a, self.forces):
            read_only(array)


def generalised(plan: Plan, motion: Trajectory) -> Generalised:
    """Return a plan's motion in the coordinates of its own pendulum.

    Raises
    ------
    InvalidInputError
        A moment in flight: without ground there is no CoP, and so no leg.
    """
    flies = np.array([phase.flies for phase in plan.problem.schedule])[motion.phase]
    if flies.any():
        raise InvalidInputError(
            f"generalised: at {motion.time[flies][0]:g} s the plan is in flight, where the pendulum"
            " has no CoP to stand on; leave such moments out"
        )
    pendulum = plan.problem.pendulum
    if isinstance(pendulum, PlanarRmp):
        return _in_planar_coordinates(pendulum, motion)
    return _in_solid_coordinates(pendulum, motion)


def _in_solid_coordinates(pendulum: SolidRmp, m: Trajectory) -> Generalised:
    angles, rates, accelerations, push = _leg(m)
    R = Rotation.from_quat(m.orientation).as_matrix()
    torque = np.einsum("nji,nj->ni", R, m.momentum_rate)
    w = np.einsum("nji,nj->ni", R, m.angular_velocity)
    # Euler: torque = I w' + I' w + w x I w.
    products = m.radii * m.radii_rates
    inertia_rate = pendulum.mass * 2.0 / 3.0 * (products.sum(axis=1)[:, None] - products)
    w_rate = (torque - inertia_rate * w - np.cross(w, m.inertia * w)) / m.inertia
    q = np.hstack((m.cop, angles, m.orientation, m.radii))
    forces = np.array([pendulum.hip_torque(*each) for each in zip(q, torque, strict=True)])
    forces[:, 2] = push
    squares = w**2
    outward = m.radii * (squares.sum(axis=1)[:, None] - squares)
    forces[:, 6:] = pendulum.mass / 3.0 * (m.radii_accelerations - outward)
    return Generalised(
        q=q,
        v=np.hstack((m.cop_velocity, rates, w, m.radii_rates)),
        a=np.hstack((np.zeros((len(q), 2)), accelerations, w_rate, m.radii_accelerations)),
        forces=forces,
    )


def _in_planar_coordinates(pendulum: PlanarRmp, m: Trajectory) -> Generalised:
    """Return the slice: angles from x to z, which is about -y; M r^2 is the inertia about y."""
    (theta, _, length), (theta_v, _, length_v), (theta_a, _, length_a), push = (
        x.T for x in _leg(m)
    )
    # sqrt(2/3) of the solid's r_1.
    r, r_v, r_a = (
        np.sqrt(2.0 / 3.0) * x[:, 0] for x in (m.radii, m.radii_rates, m.radii_accelerations)
    )
    w, torque, zero = -m.angular_velocity[:, 1], -m.momentum_rate[:, 1], np.zeros(len(m.time))
    w_rate = (torque - 2.0 * pendulum.mass * r * r_v * w) / m.inertia[:, 1]
    # The wheel's angle in space, continued over time; half angles of unit quaternions about y.
    wheel = -np.unwrap(2.0 * np.arctan2(m.orientation[:, 1], m.orientation[:, 3]))
    rail = pendulum.mass * (r_a - r * w**2)
    return Generalised(
        q=np.column_stack((m.cop[:, 0], theta, length, wheel - theta, r)),
        v=np.column_stack((m.cop_velocity[:, 0], theta_v, length_v, w - theta_v, r_v)),
        a=np.column_stack((zero, theta_a, length_a, w_rate - theta_a, r_a)),
        # No torque about a true CoP: tau_theta is zero.
        forces=np.column_stack((zero, push, torque, rail)),
    )


def _leg(m: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return (theta, phi, r_l), its rates and accelerations (n, 3); the push along it (n,)."""
    leg, leg_v = np.array(m.com), np.array(m.com_velocity)
    leg[:, :2] -= m.cop
    leg_v[:, :2] -= m.cop_velocity
    (x, y, z), (vx, vy, vz), (ax, ay, az) = leg.T, leg_v.T, m.com_acceleration.T
    flat, length = np.hypot(x, z), np.linalg.norm(leg, axis=1)
    flat_v = (x * vx + z * vz) / flat
    flat_a = (vx**2 + vz**2 + x * ax + z * az - flat_v**2) / flat
    length_v = (x * vx + y * vy + z * vz) / length
    length_a = (vx**2 + vy**2 + vz**2 + x * ax + y * ay + z * az - length_v**2) / length
    theta_v = (x * vz - z * vx) / flat**2
    theta_a = (x * az - z * ax) / flat**2 - 2.0 * theta_v * flat_v / flat
    phi_v = (flat * vy - y * flat_v) / length**2
    phi_a = (flat * ay - y * flat_a) / length**2 - 2.0 * phi_v * length_v / length
    return (
        np.column_stack((np.arctan2(z, x), np.arctan2(y, flat), length)),
        np.column_stack((theta_v, phi_v, length_v)),
        np.column_stack((theta_a, phi_a, length_a)),
        (leg * m.force).sum(axis=1) / length,
    )
