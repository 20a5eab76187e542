"""Balance on a point: the solid pendulum held upright by its reaction mass alone.

About a point contact only gravity has a moment, k_P' = c x (-M g e_z): k_P, the CoM and its rate
are a chain of integrators with the hip's torque at its end, whatever the angles (in the spirit of
Sanyal and Goswami, J. Dyn. Sys. Meas. Control 136(2), 2014). With the leg keeping the CoM's height
it is linear in each vertical plane, for large leans too:

    xi' = omega (xi - tau / f_z)      capture point from the foot; tau the hip's torque in the plane
    m'  = xi                          m = k_G / (M g) + xi / omega = (k_P + M g c / omega) / (M g)
    a'  = m                           a = I angle / (M g) + m / omega

(k_G' = tau, I angle' = k_G.) Only the first is unstable. As long as |xi| < tau_max / (M g) it can
be turned back, and at constant height no law can do more. So xi is driven with all torque there is,
to a small reference that brings m and a to zero; the reference is a nested saturation (Teel,
Systems and Control Letters 18(3), 1992), so that neither a fast wheel nor a far angle ever asks for
more lean than is safe.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.placement import from_quaternion
from wbc.rmp.balance.foot import LEAST_PUSH, FlatFoot
from wbc.rmp.balance.law import FREE, LawBounds, PendulumCommand, check_law, refuse_torsion
from wbc.rmp.functions import Evaluator
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, check_fields, finite_number, finite_vector, read_only, set_fields

# Least CoM height [m] in the law: a leg on the ground cannot be raised by a hip, and the law must
# still return numbers.
LEAST_HEIGHT = 1e-3


@dataclass(frozen=True)
class StabiliserGains:
    """Speeds of the stabiliser's loops; frequencies are natural ones, critically damped."""

    capture: float = 4.0  # k of cmp = xi + k (xi - xi_ref): xi follows at k omega
    wheel: float = 0.8  # at which m and a return, as a part of omega; well below ``capture``
    lean: float = 0.7  # largest reference for xi, as a part of the largest xi that can be caught
    height: float = 4.0  # [rad/s]
    yaw: float = 2.0  # [rad/s]
    radii: float = 8.0  # [rad/s]

    def __post_init__(self) -> None:
        names = (each.name for each in fields(self))
        check_fields(self, "gains: ", *names, above=0.0)
        if self.lean >= 1.0:
            raise InvalidInputError(f"gains: lean must be below 1, got {self.lean:g}")


@dataclass(frozen=True, eq=False)
class PointStabiliser:
    """Hold a pendulum upright on a contact without extent, and its masses at rest.

    The command is a hip's: ``tau_theta`` and ``tau_phi`` are the reaction of the torque on the
    masses (:meth:`~wbc.rmp.solid.SolidRmp.hip_torque`) and the CoP stays at the leg's end.

    The bounds' ``wheel_torque`` must be finite; ``leg_force`` is kept. A limit of the wheel's angle
    or rate is refused: on a point, speed of the wheel is what balance costs.

    Raises
    ------
    InvalidInputError
        Numbers that are unusable, and bounds as above.
    """

    model: SolidRmp
    bounds: LawBounds
    height: float  # of the CoM at rest [m]
    radii: ArrayLike  # distances of the masses at rest (3,) [m], > 0
    gains: StabiliserGains = field(default_factory=StabiliserGains)
    # (q, v) -> f (9,), for many runs at once and for planners.
    function: ca.Function = field(init=False, repr=False)
    _call: Evaluator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, SolidRmp)
        refuse_torsion(self.bounds, self)
        finite_number("gravity of the model", self.model.gravity, above=0.0)
        height = finite_number("height", self.height, above=0.0)
        radii = finite_vector("radii", self.radii, 3)
        if radii.min() <= 0.0:
            raise InvalidInputError(f"radii: must be positive, got {radii} m")
        if self.bounds.wheel_torque == FREE:
            raise InvalidInputError("bounds: PointStabiliser needs a finite wheel_torque")
        if min(self.bounds.wheel_angle, self.bounds.wheel_rate) < FREE:
            raise InvalidInputError(
                "bounds: PointStabiliser cannot keep the wheel's angle or rate within limits; leave"
                " them free, or stand on a foot with MomentumQp"
            )
        foot = FlatFoot(self.model)
        force = ca.densify(_force(foot, self.bounds, height, radii, self.gains))
        function = ca.Function("stabiliser", [foot.q, foot.v], [force], ["q", "v"], ["f"])
        set_fields(self, height=height, radii=read_only(radii))
        set_fields(self, function=function, _call=Evaluator(function))

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces wanted at q (12,), v (11,); ``time`` plays no part."""
        q, v = finite_vector("q", q, 12), finite_vector("v", v, 11)
        return PendulumCommand(self._call(q, v)[0], np.zeros(2), "balance")


def _force(
    foot: FlatFoot, bounds: LawBounds, height: float, radii: Array, gains: StabiliserGains
) -> ca.SX:
    """Return the generalised forces (9,)."""
    model, most = foot.model, bounds.wheel_torque
    weight = model.mass * model.gravity
    place = foot.com - ca.vertcat(foot.q[:2], 0.0)
    omega = ca.sqrt(model.gravity / ca.fmax(place[2], LEAST_HEIGHT))
    xi = place[:2] + (foot.com_rate[:2] - foot.v[:2]) / omega
    cmp = _wanted_cmp(foot, xi, omega, most / weight, gains)
    lift = gains.height**2 * (height - place[2]) - 2 * gains.height * foot.com_rate[2]
    # To push up harder makes a torque reach less far: no rising while all of the reach is needed.
    spare = ca.fmax(0.0, ca.fmin(1.0, 2.0 * (1.0 - ca.norm_2(xi) * weight / most)))
    lift = ca.fmin(lift, spare * ca.fmax(lift, 0.0))
    pressure = model.mass * ca.fmax(model.gravity + lift, LEAST_PUSH * model.gravity)
    R = from_quaternion(foot.q[5:9])
    level = R.T @ ca.vertcat(-pressure * cmp[1], pressure * cmp[0], 0.0)
    # Scaled, not clipped: clipped about axes that have turned, it would point elsewhere.
    level *= ca.fmin(1.0, most / ca.fmax(ca.norm_inf(level), most))
    k_G, _ = model.functions["momenta"](foot.q, foot.v)
    yaw = -(gains.yaw**2 * foot.inertia[2] * foot.angle[2] + 2 * gains.yaw * k_G[2])
    torque = level + _within_torque(R.T @ ca.vertcat(0.0, 0.0, yaw), level, most)
    push = _push(place, R @ torque, pressure, bounds.leg_force)
    slide = gains.radii**2 * (ca.DM(radii) - foot.q[9:]) - 2 * gains.radii * foot.v[8:]
    acceleration = push / model.mass - ca.vertcat(0.0, 0.0, model.gravity)
    x = ca.vertcat(acceleration, torque, slide, ca.SX.zeros(4))
    return ca.substitute(foot.force, foot.x, x)


def _wanted_cmp(
    foot: FlatFoot, xi: ca.SX, omega: ca.SX, reach: float, gains: StabiliserGains
) -> ca.SX:
    """Return the CMP (2,) wanted, from the foot [m]; ``reach`` is the furthest one [m]."""
    model = foot.model
    weight = model.mass * model.gravity
    k_G, _ = model.functions["momenta"](foot.q, foot.v)
    # A torque about y moves the CMP along x, one about x moves it back along y.
    spun = ca.vertcat(k_G[1], -k_G[0]) / weight
    turned = from_quaternion(foot.q[5:9]) @ (foot.inertia * foot.angle) / weight
    m = spun + xi / omega
    a = ca.vertcat(turned[1], -turned[0]) + m / omega
    slow = gains.wheel * omega
    lean = gains.lean * reach
    reference = -_saturated(2 * slow * m + _saturated(slow**2 * a, lean / 2), lean)
    return xi + gains.capture * (xi - reference)


def _push(place: ca.SX, moment: ca.SX, pressure: ca.SX, leg_force: tuple[float, float]) -> ca.SX:
    """Return f_r (3,) with its CoP at the foot and k_G' = moment about the level axes.

    ``place`` is the CoM from the foot; f_z is ``pressure`` if the force along the leg allows it.
    """
    x, y, z = place[0], place[1], ca.fmax(place[2], LEAST_HEIGHT)
    # (-place) x f_r = moment. Along the leg that is f_l = (r_l^2 f_z + turning) / (r_l z).
    length = ca.norm_2(place)
    turning = y * moment[0] - x * moment[1]
    low, high = ((length * z * f - turning) / length**2 for f in leg_force)
    f_z = ca.fmax(low, pressure if leg_force[1] == FREE else ca.fmin(pressure, high))
    return ca.vertcat((x * f_z - moment[1]) / z, (y * f_z + moment[0]) / z, f_z)


def _within_torque(more: ca.SX, torque: ca.SX, most: float) -> ca.SX:
    """Return as much of ``more`` (3,) as leaves its sum with ``torque`` within the limit."""
    room = most - ca.sign(more) * torque
    parts = room / ca.fmax(ca.fabs(more), 1e-12 * most)
    return ca.fmin(1.0, ca.mmin(parts)) * more


def _saturated(x: ca.SX, limit: float) -> ca.SX:
    """Return x (2,), shortened to the given length where it is longer."""
    return x * (limit / ca.fmax(ca.norm_2(x), limit))
