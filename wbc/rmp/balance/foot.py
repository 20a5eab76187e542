"""What a foot that stays can give: limits on torques about it, and rows of a quadratic program.

Unknowns x of the program, of which all else is an affine function at a given state:

    c'' (3,) CoM,  tau (3,) torque on the masses in their axes,  r'' (3,) radii,  slacks

The ground pushes with f_r = M (c'' - g). By virtual work the generalised forces of the massless leg
are J^T f_r with J = dc/d(leg), and the CoP follows from f_r and k_G' = R tau (paper 8.1). So the
dynamics are substituted, exactly, and there are no equality rows. The foot stays where it is; what
its ankle gives beyond the hip's reaction is what moves the CoP away from the leg's end.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.placement import from_quaternion
from wbc.polygon import half_planes, inset
from wbc.rmp.balance.law import FREE, LawBounds, Pendulum
from wbc.rmp.functions import Evaluator
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp, quaternion_rate, rotation_vector
from wbc.validate import Array

# Least normal force, as a part of the weight: the CoP divides by it.
LEAST_PUSH = 0.05
# Part of a motor's torque that is assumed for braking; the rest is for coupling between the axes.
BRAKING_SHARE = 0.95
# Margin as a part of the wheel's angle: a slack at its limit is violated by some 1e-5.
ANGLE_MARGIN = 1e-3
# Factor on the brake demanded of a coordinate that cannot stop in time: the rest shows in the
# slack.
OVERDEMAND = 2.0
TORSION = "torsion "  # what labels of such rows begin with
# Corners of a rectangle are square to this part, and its sides equal to this [m].
SQUARE_TOLERANCE = 1e-6
# Deceleration that a leg is sure to have left, as a part of gravity.
LEG_BRAKE = 0.5


def require_support(model: Pendulum, bounds: LawBounds) -> None:
    """Raise InvalidInputError for a polygon of the other kind of pendulum; none is fine."""
    flat = isinstance(model, PlanarRmp)
    if bounds.polygon is not None and (np.ndim(bounds.polygon) == 1) != flat:
        want = "(least x, greatest x)" if flat else "corners (k, 2)"
        raise InvalidInputError(f"bounds: polygon of a {type(model).__name__} must be {want}")


class SupportFoot:
    """The support polygon of a foot that stays, as a limit on torques about the leg's foot.

    Raises InvalidInputError: bounds without a polygon, or with one of the other kind of pendulum.
    """

    def __init__(self, model: Pendulum, bounds: LawBounds) -> None:
        polygon = bounds.polygon
        if polygon is None:
            raise InvalidInputError(
                "bounds: a foot without extent gives no torque; give a polygon, or leave the foot"
                " out of the law"
            )
        require_support(model, bounds)
        if isinstance(model, PlanarRmp):
            low, high = np.asarray(polygon).tolist()
            self._normals, self._offsets = np.array(((1.0,), (-1.0,))), np.array((high, -low))
        else:
            self._normals, self._offsets = half_planes(polygon)
        self._margin = bounds.cop_margin
        self._pressure = Evaluator(_pressure(model))

    def cop_margin(self, q: Array, v: Array, force: Array) -> float:
        """Return how far inside the polygon the CoP is [m]; ``-inf`` if no ground pushes."""
        return self._least(*self._loads(q, v, force))

    def torque_scale(self, q: Array, v: Array, force: Array, torque: Array) -> tuple[float, float]:
        """Return the largest part s in [0, 1] of ``torque`` for which the CoP keeps its margin.

        Forces f = force + s torque (nf,). The CoP times the push of the ground is affine in f, so
        each edge of the polygon is a limit on s. If s = 0 is outside, some s is still sought that
        brings the CoP back; if there is none, s is 0. The second number is :meth:`cop_margin` at s.
        """
        start, push = self._loads(q, v, force)
        end, pushed = self._loads(q, v, force + torque)
        least, most = 0.0, 1.0
        for value, rate in zip(start.tolist(), (end - start).tolist(), strict=True):
            if rate > 0.0:
                most = min(most, -value / rate)
            elif rate < 0.0:
                least = max(least, -value / rate)
            elif value > 0.0:
                most = -1.0
        s = most if least <= most else 0.0
        return s, self._least(start + s * (end - start), push + s * (pushed - push))

    def _loads(self, q: Array, v: Array, force: Array) -> tuple[Array, float]:
        """Return (n . p - offset) f_z for each edge, not above 0 inside, and f_z."""
        pressure, push = self._pressure(q, v, force)
        f_z = float(push[0])
        return self._normals @ pressure - (self._offsets - self._margin) * f_z, f_z

    def _least(self, loads: Array, push: float) -> float:
        return float((-loads / push).min()) + self._margin if push > 0.0 else -np.inf


def ground_loads(model: Pendulum, x: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return c, f_r and k_G' at a state x = (q, v) under u = (CoP acceleration, f)."""
    q, v = x[: len(model.Q)], x[len(model.Q) :]
    rate = model.functions["state_rate"](x, u)
    push = model.functions["ground_reaction"](q, v, rate[len(model.Q) :])
    com, _ = model.functions["com"](q, v)
    k_G, _ = model.functions["momenta"](q, v)
    return com, push, ca.jtimes(k_G, x, rate)


def _pressure(model: Pendulum) -> ca.Function:
    """Return (q, v, f) -> (CoP times f_z, f_z); the foot has no acceleration (theory, 7)."""
    sizes = zip("qvf", (model.Q, model.V, model.F), strict=True)
    q, v, f = (ca.SX.sym(name, len(entries)) for name, entries in sizes)
    u = ca.vertcat(ca.SX.zeros(model.COP), f)
    com, push, moment = ground_loads(model, ca.vertcat(q, v), u)
    # Planar momenta are about -y; in space m is crossed with the vertical.
    turned = moment if model.COP == 1 else ca.vertcat(-moment[1], moment[0])
    pressure = com[:-1] * push[-1] - com[-1] * push[:-1] + turned
    return ca.Function("pressure", [q, v, f], [ca.densify(pressure), ca.densify(push[-1])])


@dataclass(frozen=True, eq=False)
class AffineRow:
    """A row lower <= expression <= upper of a QP; the expression is affine in x."""

    label: str
    expression: ca.SX
    lower: ca.SX | float
    upper: ca.SX | float


class FlatFoot:
    """Symbols of the state and the unknowns, and what follows from them."""

    def __init__(self, model: SolidRmp) -> None:
        self.model = model
        self.q = q = ca.SX.sym("q", 12)
        self.v = v = ca.SX.sym("v", 11)
        self.x = x = ca.SX.sym("x", 13)
        quaternion, w, radii, slide = q[5:9], v[5:8], q[9:], v[8:]
        third = model.mass / 3.0
        self.com, self.com_rate = model.functions["com"](q, v)  # c, c' (3,)
        self.push = model.mass * (x[:3] + ca.vertcat(0.0, 0.0, model.gravity))  # f_r (3,)
        self.moment = from_quaternion(quaternion) @ x[3:6]  # k_G' (3,)
        # About the masses' axes (3,), and the torque (3,) without which their rate would change.
        self.inertia = third * (ca.sum1(radii**2) - radii**2)
        inertia_rate = 2 * third * (ca.dot(radii, slide) - radii * slide)
        self.gyroscopic = ca.cross(w, self.inertia * w) + inertia_rate * w
        # Rotation vector of the masses (3,) and its rates.
        turning = quaternion_rate(quaternion, w)
        spin = (x[3:6] - self.gyroscopic) / self.inertia
        self.angle = rotation_vector(quaternion)
        self.angle_rate = ca.jtimes(self.angle, quaternion, turning)
        self.angle_acceleration = ca.jtimes(self.angle_rate, quaternion, turning)
        self.angle_acceleration += ca.jtimes(self.angle_rate, w, spin)
        # r_l' and r_l'', from the foot, whose own motion is given and has no acceleration here.
        self.leg_rate = v[4]
        velocity = self.com_rate - ca.vertcat(v[:2], 0.0)
        along = ca.dot(ca.jacobian(self.com, q[4]), x[:3])
        self.leg_acceleration = along + (ca.sumsqr(velocity) - self.leg_rate**2) / q[4]
        # Generalised forces (9,).
        leg_force = ca.jacobian(self.com, q[2:5]).T @ self.push
        sliding = third * (x[6:9] - radii * (ca.sumsqr(w) - w**2))
        self.force = ca.vertcat(leg_force, x[3:6], sliding)


def physical_rows(
    foot: FlatFoot, bounds: LawBounds, normals: Array, offsets: Array
) -> list[AffineRow]:
    """Return what no command may break: CoP in the polygon, friction, force along the leg.

    Forces are in parts of the weight, so that all rows are of one size. The friction cone is
    replaced by the pyramid inside it. What friction gives about the vertical: :func:`torsion_rows`.
    """
    rows, weight = list[AffineRow](), foot.model.mass * foot.model.gravity
    f, moment, height = foot.push / weight, foot.moment / weight, foot.com[2]
    # The CoP times f_z, so that it is affine.
    cop = foot.com[:2] * f[2] - height * f[:2] + ca.vertcat(-moment[1], moment[0])
    for k, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        inside = ca.dot(ca.DM(normal), cop) - float(offset) * f[2]
        rows.append(AffineRow(f"CoP inside edge {k}", inside, -ca.inf, 0.0))
    if bounds.friction < FREE:
        slope = bounds.friction / np.sqrt(2.0)
        for axis, name in enumerate("xy"):
            for sign in (1.0, -1.0):
                label = f"friction {'+' if sign > 0 else '-'}{name}"
                rows.append(AffineRow(label, sign * f[axis] - slope * f[2], -ca.inf, 0.0))
        rows += torsion_rows(foot, bounds, slope) if bounds.torsion else []
    low, high = bounds.leg_force
    return [
        *rows,
        AffineRow("force along the leg", foot.force[2] / weight, low / weight, high / weight),
    ]


def torsion_rows(foot: FlatFoot, bounds: LawBounds, slope: float) -> list[AffineRow]:
    """Return the torques about the vertical that friction holds; none for soles of other shapes.

    With the CoP at a corner there is none: a sole that is not looked after turns about it and is
    lost. A rectangle of half sides X, Y with pyramids of slope mu holds a torque t about its centre
    while

        |t_z| <= mu (X + Y) f_z - |Y f_x +- mu t_x| - |X f_y +- mu t_y|,    + for t_z > 0

    (Caron, Pham and Nakamura, ICRA 2015), in the axes of its sides.
    """
    corners = inset(np.asarray(bounds.polygon), bounds.cop_margin)
    sides = 0.5 * (np.roll(corners, -1, axis=0) - corners)
    square = len(corners) == 4 and abs(sides[0] @ sides[1]) < SQUARE_TOLERANCE * np.prod(
        _lengths(sides[:2])
    )
    if not square or not np.allclose(sides[:2], -sides[2:], atol=SQUARE_TOLERANCE):
        return []
    half = _lengths(sides[:2])
    axes = sides[:2] / half[:, None]  # the second is to the left of the first
    weight = foot.model.mass * foot.model.gravity
    f, centre = foot.push / weight, np.append(corners.mean(axis=0), 0.0)
    torque = ca.cross(foot.com - ca.DM(centre), f) + foot.moment / weight
    along, about = ca.DM(axes) @ f[:2], ca.DM(axes) @ torque[:2]
    most = slope * float(half.sum()) * f[2]
    rows = []
    for turn, first, second in product((1.0, -1.0), repeat=3):
        used = turn * torque[2]
        used += first * (half[1] * along[0] + turn * slope * about[0])
        used += second * (half[0] * along[1] + turn * slope * about[1])
        label = TORSION + "".join("-+"[sign > 0.0] for sign in (turn, first, second))
        rows.append(AffineRow(label, used - most, -ca.inf, 0.0))
    return rows


def _lengths(vectors: Array) -> Array:
    lengths: Array = np.linalg.norm(vectors, axis=1)
    return lengths


def elastic_rows(foot: FlatFoot, bounds: LawBounds, dt: float) -> list[AffineRow]:
    """Return the leg's length and the wheel's angle, by braking; each row has its own slack."""
    slack, g = foot.x[9:], foot.model.gravity
    low, high = acceleration_range(
        foot.q[4], foot.leg_rate, bounds.leg_length, (LEG_BRAKE * g, LEG_BRAKE * g), dt, OVERDEMAND
    )
    length = (foot.leg_acceleration - slack[0]) / g
    rows = [AffineRow("length of the leg", length, low / g, high / g)]
    if bounds.wheel_angle < FREE:
        strength = BRAKING_SHARE * bounds.wheel_torque / foot.inertia
        edge = (1.0 - ANGLE_MARGIN) * bounds.wheel_angle
        low, high = acceleration_range(
            foot.angle, foot.angle_rate, (-edge, edge), (strength, strength), dt, OVERDEMAND
        )
        # In the torque's own units, so that a heavy wheel's rows weigh what a light one's do.
        scale = foot.inertia / bounds.wheel_torque
        for k, axis in enumerate("123"):
            turn = (foot.angle_acceleration[k] - slack[1 + k]) * scale[k]
            label = f"angle of the masses {axis}"
            rows.append(AffineRow(label, turn, low[k] * scale[k], high[k] * scale[k]))
    return rows


def box(foot: FlatFoot, bounds: LawBounds, dt: float) -> tuple[ca.SX, ca.SX]:
    """Return lower and upper bounds (13,) of x: torque, rate of the masses, strokes, slacks."""
    g = foot.model.gravity
    most = bounds.wheel_torque
    torque = (ca.SX(-most * ca.DM.ones(3)), ca.SX(most * ca.DM.ones(3)))
    if bounds.wheel_rate < FREE:
        w = foot.v[5:8]
        # Never more than the motor gives: a wheel that is too fast is braked as it can.
        ends = [
            ca.fmax(-most, ca.fmin(most, foot.inertia * (rate - w) / dt + foot.gyroscopic))
            for rate in (-bounds.wheel_rate, bounds.wheel_rate)
        ]
        torque = (ends[0], ends[1])
    stroke = acceleration_range(foot.q[9:], foot.v[8:], bounds.radius, (g, g), dt)
    fall = -(1.0 - LEAST_PUSH) * g
    free = ca.SX(ca.inf * ca.DM.ones(4))
    return (
        ca.vertcat(-ca.inf, -ca.inf, fall, torque[0], stroke[0], -free),
        ca.vertcat(ca.inf, ca.inf, ca.inf, torque[1], stroke[1], free),
    )


def acceleration_range(
    position: ca.SX,
    rate: ca.SX,
    limits: tuple[float, float],
    strength: tuple[ca.SX | float, ca.SX | float],
    dt: float,
    overdemand: float = 1.0,
) -> tuple[ca.SX, ca.SX]:
    """Return the (least, greatest) acceleration for the coming ``dt``, each of ``position``'s size.

    After ``dt`` at the greatest, braking with all strength stops the coordinate at its upper limit.
    With the rate r1 after ``dt`` that is (rate + r1) dt/2 + r1^2 / (2 strength) = room: along the
    limit the motion is full speed, then full brake. A coordinate already out of its limits, or too
    fast for them, is brought back with ``overdemand`` times the strength, not in one tick.

    ``position``, ``rate``: (n,), of any unit and its rate.
    ``limits``: (lower, upper); an infinite one does not limit.
    ``strength``: greatest deceleration of a motion (downward, upward), > 0, (n,) or a number.
    ``overdemand``: 1 for limits that must be within reach; more where a slack shows what the brake
    lacks.
    """
    (lower, upper), (down, up) = limits, strength
    greatest = (
        _most_acceleration(upper - position, rate, up, dt, overdemand) if upper < ca.inf else ca.inf
    )
    least = (
        -_most_acceleration(position - lower, -rate, down, dt, overdemand)
        if lower > -ca.inf
        else -ca.inf
    )
    # Limits less than a tick's way apart would cross.
    ones = ca.SX.ones(position.shape)
    return ones * ca.fmin(least, greatest), ones * greatest


def _most_acceleration(
    room: ca.SX, rate: ca.SX, strength: ca.SX | float, dt: float, overdemand: float
) -> ca.SX:
    """Return the greatest acceleration (n,) from which ``strength`` stops within ``room``."""
    left = room - rate * dt / 2
    # r1^2 / (2 s) + r1 dt / 2 = left; the fmax keeps the root real where the other branch holds.
    stopping = ca.sqrt((strength * dt / 2) ** 2 + 2 * strength * ca.fmax(left, 0.0))
    # Out of room: back to the limit within dt, as far as is insisted.
    after = ca.if_else(left > 0.0, stopping - strength * dt / 2, 2 * left / dt)
    return ca.fmax((after - rate) / dt, -overdemand * strength)
