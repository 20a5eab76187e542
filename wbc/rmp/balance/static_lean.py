"""Static lean (paper 4.2): the CoM stays beyond the foot while the wheel gains speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import FREE, LawBounds, PendulumCommand, check_law, refuse_torsion
from wbc.rmp.planar import LENGTH_RATE, Held, PlanarRmp
from wbc.validate import Array, check_fields, finite_number, finite_vector, set_fields

# How near to its limit, as a fraction of it, the wheel counts as there: a step's rounding.
AT_LIMIT = 1e-9


@dataclass(frozen=True, eq=False)
class StaticLean:
    """Holds the leg at ``angle`` on a foot without extent, as long as the wheel can be sped up.

    With no torque at the foot, the row of theta (eq. 22) leaves the wheel's torque as the only
    means to turn a leg of constant length:

        tau = -M r_l (r_l theta''_d + 2 r_l' theta') - M g r_l cos(theta),
        theta''_d = -2 w theta' - w^2 (theta - angle)

    so that errors decay at the rate w while the mean torque is that of the paper's static lean,
    tau = -M g r_l cos(angle) (4.2, where r_l is misprinted as r). tau is k_G', so the wheel's rate
    grows without end: :meth:`time_left` says how long its limits last. From then on the phase is
    ``"saturated"``, ``ok`` is False, and the wheel is carried along at constant rate.

    Raises InvalidInputError: numbers that are no pendulum, a leg that does not stand, or a lean
    that takes more torque than there is; the message says by how much.
    """

    model: PlanarRmp
    angle: float  # theta to be held [rad], between 0 and pi
    length: float  # of the leg [m], held by computed forces
    radius: float  # of the wheel [m], likewise
    # Torque, rate and angle of the wheel (from alpha = 0), force along the leg; the torque is
    # clipped. Of the support only that the foot stays where it is.
    bounds: LawBounds = field(default_factory=LawBounds)
    rate: float = 10.0  # w, at which errors decay [1/s]
    held: Held = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, PlanarRmp)
        refuse_torsion(self.bounds, self)
        held = Held(self.model, self.length, self.radius)
        angle = finite_number("angle", self.angle)
        if not 0.0 < angle < math.pi:
            raise InvalidInputError(f"angle: the leg must stand, 0 < angle < pi, got {angle:g} rad")
        set_fields(self, angle=angle, held=held)
        check_fields(self, "", "rate", above=0.0)
        need, limit = abs(self.static_torque), self.bounds.wheel_torque
        if need > limit:
            raise InvalidInputError(
                f"angle: to lean at {math.degrees(angle):.4g} degrees takes {need:.4g} N m of the"
                f" wheel, {need - limit:.4g} more than its limit of {limit:g}"
            )

    @property
    def static_torque(self) -> float:
        """-M g r_l cos(angle) [N m]: the wheel's torque at rest."""
        return -self.held.weight_torque * math.cos(self.angle)

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces; ``time`` does not matter."""
        q, v = finite_vector("q", q, 5), finite_vector("v", v, 5)
        wanted = self._wanted_torque(q, v)
        why = self._saturated(q, v, wanted)
        limit = self.bounds.wheel_torque
        torque = min(max(self._carrying_torque(q) if why else wanted, -limit), limit)
        force = self.held.forces(q, v, torque)
        low, high = self.bounds.leg_force
        leg = force[1]
        force[1] = min(max(leg, low), high)
        if not why and force[1] != leg:
            why = f"the leg would have to push with {leg:.4g} N"
        elif not why and torque != wanted:
            why = f"the wheel would have to give {wanted:.4g} N m"
        phase = "saturated" if why.startswith("the wheel is") else "lean"
        return PendulumCommand(force, np.zeros(1), phase, ok=not why, note=why)

    def time_left(self, q: ArrayLike, v: ArrayLike) -> float:
        """Return how long the wheel can hold the lean from a state near it [s]; ``inf`` if forever.

        From k_P' = -M g r_l cos(theta), integrated once for the wheel's rate and twice for its
        angle. Errors e of the angle and d of the length decay by the law itself, so their
        integrals over all time are known:

            I alpha'(t) = k_P - M g (r_l cos(angle) t - r_l sin(angle) E_1 + cos(angle) D_1),
            E_1 = (e' + 2 w e) / w^2,  E_2 = integral of t e = (2 E_1 w - e) / w^2

        Exact but for squares of errors, and once they have decayed.

        Raises InvalidInputError: wrong sizes, not finite, or a configuration that the pendulum
        cannot have.
        """
        q, v = finite_vector("q", q, 5), finite_vector("v", v, 5)
        _, k_P = self.model.momenta(q, v)
        held, weight = self.held, self.model.mass * self.model.gravity
        sine, cosine = math.sin(self.angle), math.cos(self.angle)
        E_1, E_2 = _integrals(q[1] - self.angle, v[1], self.rate)
        D_1, D_2 = _integrals(q[2] - held.length, v[2], LENGTH_RATE)
        leaned = weight * (held.length * sine * E_1 - cosine * D_1)
        leaned_twice = -weight * (held.length * sine * E_2 - cosine * D_2)
        # alpha(t) = alpha + alpha_rate t + torque/I t^2 / 2, once the errors have gone.
        inertia = held.wheel_inertia
        turned = (held.leg_inertia + inertia) * (self.angle - q[1])
        alpha = float(q[3] + (leaned_twice - turned) / inertia)
        alpha_rate = float((k_P + leaned) / inertia)
        growth = self.static_torque / inertia
        times = [
            *_crossings((alpha_rate, growth, 0.0), self.bounds.wheel_rate),
            *_crossings((alpha, alpha_rate, growth / 2.0), self.bounds.wheel_angle),
        ]
        if abs(v[3]) >= self.bounds.wheel_rate or abs(q[3]) >= self.bounds.wheel_angle:
            return 0.0
        return min(times, default=math.inf)

    def _wanted_torque(self, q: Array, v: Array) -> float:
        theta, length = float(q[1]), float(q[2])
        wanted = -self.rate * (2.0 * v[1] + self.rate * (theta - self.angle))
        coriolis = 2.0 * v[2] * v[1]
        M, g = self.model.mass, self.model.gravity
        return float(-M * length * (length * wanted + coriolis + g * math.cos(theta)))

    def _carrying_torque(self, q: Array) -> float:
        """Return the torque at which alpha' stays: leg and wheel fall as one body."""
        inertia = self.model.mass * q[4] ** 2
        ratio = inertia / (inertia + self.model.mass * q[2] ** 2)
        return float(-ratio * self.model.mass * self.model.gravity * q[2] * math.cos(q[1]))

    def _saturated(self, q: Array, v: Array, torque: float) -> str:
        rate, angle = self.bounds.wheel_rate, self.bounds.wheel_angle
        if v[3] * math.copysign(1.0, torque) >= rate * (1.0 - AT_LIMIT):
            return f"the wheel is at its greatest rate, {rate:g} rad/s"
        if abs(q[3]) >= angle * (1.0 - AT_LIMIT):
            return f"the wheel is at its greatest angle, {angle:g} rad"
        return ""


def _integrals(error: float, rate: float, w: float) -> tuple[float, float]:
    """Return the integrals of e and of t e over all time for e'' + 2 w e' + w^2 e = 0."""
    first = (rate + 2.0 * w * error) / w**2
    return first, (2.0 * w * first - error) / w**2


def _crossings(polynomial: tuple[float, float, float], limit: float) -> list[float]:
    """Return the times t > 0 at which c0 + c1 t + c2 t^2 passes +-limit."""
    if limit == FREE:
        return []
    c0, c1, c2 = polynomial
    roots = [*_roots(c0 - limit, c1, c2), *_roots(c0 + limit, c1, c2)]
    return [root for root in roots if root > 0.0]


def _roots(c0: float, c1: float, c2: float) -> tuple[float, ...]:
    """Return the real roots of c0 + c1 t + c2 t^2, which may be a line, or constant."""
    square = c1 * c1 - 4.0 * c2 * c0
    if square < 0.0 or (c1 == 0.0 and c2 == 0.0):
        return ()
    # The sum of two numbers of one sign, so that nothing cancels.
    half = -0.5 * (c1 + math.copysign(math.sqrt(square), c1))
    if half == 0.0:
        return (0.0,)
    return (c0 / half,) if c2 == 0.0 else (c0 / half, half / c2)
