"""From hanging to upright by the wheel alone: pump energy, then catch."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import FREE, LawBounds, PendulumCommand, check_law, refuse_torsion
from wbc.rmp.balance.lqr import riccati_gain
from wbc.rmp.planar import Held, PlanarRmp
from wbc.validate import Array, finite_vector, set_fields

# Part of the torque that is kept back, while pumping, from what could hold the leg level; and the
# part of what the catch can recover from at which it begins.
_PUMP, _CATCH = 0.5, 0.5
# Largest lean while the wheel is slowed down, as a part of what the torque could recover from [-],
# and in any case [rad].
_LEAN, _LEAN_ANGLE = 0.25, math.radians(0.7)
# Weights of the catch, by Bryson's rule: s and k that cost as much as all torque, as parts of it.
_UNSTABLE, _MOMENTUM = 1.0, 4.0
# At an end of the wheel's rate, the part of the rate over which torque fades.
_FADE_SHARE = 0.02
# Least torque ratio, as a multiple of (w dt)^2: what is lost between commands stays well below it.
_LEAST_RATIO = 3.0
# Leg upright within this [rad]: the phase is "hold".
_UPRIGHT = math.radians(1.0)


@dataclass(frozen=True, eq=False)
class SwingUp:
    """Swings a planar reaction wheel pendulum up and holds it, its foot bolted to a pivot.

    Length of the leg and radius of the masses are held by computed forces
    (:class:`~wbc.rmp.planar.Held`). With x = theta - pi/2, J = M r_l^2, w = sqrt(g/r_l),
    u = tau / (M g r_l) and k = k_G / (J w):

        x'' = w^2 (sin x - u),    k' = w u

    *Pump.* The energy e = (x'/w)^2 / 2 - (1 - cos x), zero at rest upright, has e' = -u x': torque
    against the leg's rate, whatever its size, raises it (Astrom and Furuta, Automatica 36, 2000;
    Spong, Corke and Lozano, Automatica 37, 2001, for this pendulum).

    *Catch.* e = s (s - 4 sin(x/2)) / 2 with s = x'/w + 2 sin(x/2). On s = 0 the leg comes up and
    just stops upright; elsewhere, exactly, not for small x only,

        s' = w (cos(x/2) s - u),    x' = w (s - 2 sin(x/2))

    so s is the one unstable part of the motion, and the catch can begin anywhere on the way up.
    There u = K_s s + K_k k, from the Riccati equation of (s, k) at x = 0, brings back leg and
    wheel. It is limited twice: all of u by the greatest torque u_max, and the share of the wheel's
    momentum to a part of it, d. **Region of attraction:** V = s^2 falls as long as |u| > |s| and u
    has its sign. That is so for d / (K_s - 1) < |s| < u_max, whatever k, and then x follows s. The
    catch begins at |s| < u_max / 2. The momentum is dumped by gravity: the leg leans by
    d / (K_s - 1), at most 0.7 degrees, until the wheel is at rest.

    In continuous time there is no least torque: every swing gains energy, some 2 pi u_max a period
    as the leg goes round. Held for ``dt``, forces that keep the length right at mid-step only let
    it give way by some 0.3 (w dt)^2 of itself in step with the swing, which costs energy in
    proportion; u_max must be 3 (w dt)^2 at least. Then the bands above are wide enough as well:
    s passes less than w dt u_max in a step.

    The bounds' ``wheel_torque`` (finite) and ``wheel_rate`` are respected; forces along the leg are
    not bounded, since the pivot pulls as well; the wheel may turn without end.

    Raises InvalidInputError: no gravity, no finite torque, a wheel that stops at an angle, a rate
    of the wheel that the swinging leg alone exceeds, or commands too rare for the torque; the
    message says by how much.
    """

    model: PlanarRmp  # its gravity must not be zero
    length: float  # of the leg [m]
    radius: float  # of the wheel [m]
    bounds: LawBounds
    dt: float = 1e-3  # time between commands [s]
    held: Held = field(init=False, repr=False)
    gain: tuple[float, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, PlanarRmp)
        refuse_torsion(self.bounds, self)
        held = Held(self.model, self.length, self.radius, self.dt)
        _require_means(held, self.bounds)
        set_fields(self, held=held)
        u = min(self.torque_ratio, 1.0)
        A, B = np.diag((1.0, 0.0)), np.array(((-1.0,), (1.0,)))
        K, _ = riccati_gain(A, B, u * np.array((_UNSTABLE, _MOMENTUM)), np.array((u,)))
        set_fields(self, gain=(float(-K[0, 0]), float(-K[0, 1])))

    @property
    def torque_ratio(self) -> float:
        """u_max = wheel_torque / (M g r_l): the sine of the largest lean that it can hold."""
        return self.bounds.wheel_torque / self.held.weight_torque

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """Return e, the leg's energy over M g r_l: -2 at rest hanging, 0 at rest upright."""
        x, rate = self._leg(finite_vector("q", q, 5), finite_vector("v", v, 5))
        return 0.5 * rate**2 - (1.0 - math.cos(x))

    def unstable_part(self, q: ArrayLike, v: ArrayLike) -> float:
        """Return s; the catch begins, and never fails, where |s| is below half ``torque_ratio``."""
        x, rate = self._leg(finite_vector("q", q, 5), finite_vector("v", v, 5))
        return rate + 2.0 * math.sin(x / 2.0)

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces; ``time`` does not matter."""
        q, v = finite_vector("q", q, 5), finite_vector("v", v, 5)
        (x, rate), s = self._leg(q, v), self.unstable_part(q, v)
        most = min(self.torque_ratio, 1.0)
        if abs(s) < _CATCH * most:
            k = (
                self.held.wheel_inertia
                * (v[1] + v[3])
                / (self.held.leg_inertia * self.held.frequency)
            )
            u, phase = self._catch(s, float(k), most), "catch" if abs(x) > _UPRIGHT else "hold"
        else:
            u, phase = self._pump(x, rate), "pump"
        wanted = u * self.held.weight_torque
        torque = self._within_rate(float(v[3]), wanted)
        note = ""
        if phase != "pump" and torque != wanted:
            note = f"the wheel is at its greatest rate, {self.bounds.wheel_rate:g} rad/s"
        return PendulumCommand(self.held.forces(q, v, torque), np.zeros(1), phase, not note, note)

    def _leg(self, q: Array, v: Array) -> tuple[float, float]:
        """Return x in [-pi, pi) and x' / w."""
        x = (float(q[1]) - math.pi / 2.0 + math.pi) % (2.0 * math.pi) - math.pi
        return x, float(v[1]) / self.held.frequency

    def _pump(self, x: float, rate: float) -> float:
        """Return u against the leg's rate if energy is missing, along with it if there is too much.

        At rest the leg hangs: it is pushed all the same.
        """
        missing = 0.5 * rate**2 - (1.0 - math.cos(x)) < 0.0
        against = -1.0 if rate >= 0.0 else 1.0
        return min(self.torque_ratio, _PUMP) * (against if missing else -against)

    def _catch(self, s: float, k: float, most: float) -> float:
        """Return u = K_s s + K_k k, both limited."""
        K_s, K_k = self.gain
        lean = min(_LEAN * most, _LEAN_ANGLE) * (K_s - 1.0)
        dump = min(max(K_k * k, -lean), lean)
        return min(max(K_s * s + dump, -most), most)

    def _within_rate(self, rate: float, torque: float) -> float:
        """Return the torque, faded out where it would drive the wheel beyond its greatest rate."""
        limit = self.bounds.wheel_rate
        if limit == FREE or rate * torque <= 0.0:
            return torque
        return torque * min(max((limit - abs(rate)) / (_FADE_SHARE * limit), 0.0), 1.0)


def _require_means(held: Held, bounds: LawBounds) -> None:
    if held.model.gravity == 0.0:
        raise InvalidInputError("model: without gravity there is no up to swing to")
    if bounds.wheel_torque == FREE:
        raise InvalidInputError("bounds: wheel_torque must be finite, in N m")
    if bounds.wheel_angle != FREE:
        raise InvalidInputError(
            f"bounds: a wheel that stops at {bounds.wheel_angle:g} rad cannot swing a leg up; it"
            " must turn without end"
        )
    # Swinging through at the bottom with the energy of the upright; the wheel does not follow.
    least = 2.0 * held.frequency
    if bounds.wheel_rate <= least:
        raise InvalidInputError(
            f"bounds: wheel_rate must exceed {least:.4g} rad/s, at which the leg itself swings"
            f" through; {bounds.wheel_rate:g} is {least - bounds.wheel_rate:.4g} too little"
        )
    lost = _LEAST_RATIO * (held.frequency * held.dt) ** 2
    if bounds.wheel_torque < lost * held.weight_torque:
        most = math.sqrt(bounds.wheel_torque / (_LEAST_RATIO * held.weight_torque)) / held.frequency
        raise InvalidInputError(
            f"dt: with commands every {held.dt:g} s the leg takes more energy than a wheel_torque"
            f" of {bounds.wheel_torque:g} N m brings; at most {most:.3g} s, or"
            f" {lost * held.weight_torque:.3g} N m at least"
        )
