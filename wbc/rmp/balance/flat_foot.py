"""The quadratic program of a solid pendulum on a flat foot, as a CasADi Function of its state.

Unknowns x, of which everything else is an affine function at a given state:

    c'' (3,) CoM,  tau (3,) torque on the masses in their axes,  r'' (3,) radii,  slacks

The ground pushes with f_r = M (c'' - g). By virtual work the generalised forces of the massless leg
are J^T f_r with J = dc/d(leg), and the CoP follows from f_r and k_G' = R tau (paper 8.1). So the
dynamics are substituted, exactly, and there are no equality rows. The foot stays where it is; what
its ankle gives beyond the hip's reaction is what moves the CoP away from the leg's end.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from wbc.rmp.balance.attitude import quaternion_rate, rotation, rotation_vector
from wbc.rmp.balance.bounds import FREE, Bounds
from wbc.rmp.balance.braking import acceleration_range
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

# Least push of the ground, as a part of the weight: the CoP divides by it.
LIGHTEST = 0.05
# Part of a motor's torque that braking counts on; the rest is for what couples the axes.
COUNTED = 0.95
# Part of the wheel's angle left as a margin: a slack at its limit gives way by some 1e-5.
ANGLE_SKIN = 1e-3
# How much more than the brake can do is asked of a coordinate that it cannot stop in time: what is
# lacking shows in the slack.
INSIST = 2.0
# Deceleration that a leg is sure to have left, as a part of gravity.
LEG_BRAKE = 0.5


@dataclass(eq=False)
class Rows:
    """Two-sided rows of a QP, gathered one after the other; expressions are affine in x."""

    expressions: list[ca.SX] = field(default_factory=list)
    lower: list[ca.SX] = field(default_factory=list)
    upper: list[ca.SX] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)

    def add(
        self, label: str, expression: ca.SX, lower: ca.SX | float, upper: ca.SX | float
    ) -> None:
        """Add a row lower <= expression <= upper."""
        self.expressions.append(expression)
        self.lower.append(ca.SX(lower))
        self.upper.append(ca.SX(upper))
        self.labels.append(label)


@dataclass(frozen=True, eq=False)
class FlatFoot:
    """Symbols of the state and the unknowns, and what follows from them."""

    model: SolidRmp
    q: ca.SX  # (12,)
    v: ca.SX  # (11,)
    x: ca.SX  # (13,)
    com: ca.SX  # c (3,)
    com_rate: ca.SX  # c' (3,)
    push: ca.SX  # f_r (3,)
    force: ca.SX  # generalised forces (9,)
    moment: ca.SX  # k_G' (3,)
    inertia: ca.SX  # about the masses' axes (3,)
    gyroscopic: ca.SX  # torque (3,) without which the body rate would change
    angle: ca.SX  # of the masses (3,)
    angle_rate: ca.SX  # (3,)
    angle_acceleration: ca.SX  # (3,)
    leg_rate: ca.SX  # r_l'
    leg_acceleration: ca.SX  # r_l''

    @classmethod
    def of(cls, model: SolidRmp) -> FlatFoot:
        """Return the symbols for a pendulum."""
        q, v, x = ca.SX.sym("q", 12), ca.SX.sym("v", 11), ca.SX.sym("x", 13)
        com, com_rate = model.functions["com"](q, v)
        push = model.mass * (x[:3] + ca.vertcat(0.0, 0.0, model.gravity))
        quaternion, w, radii, slide = q[5:9], v[5:8], q[9:], v[8:]
        third = model.mass / 3.0
        inertia = third * (ca.sum1(radii**2) - radii**2)
        inertia_rate = 2 * third * (ca.dot(radii, slide) - radii * slide)
        gyroscopic = ca.cross(w, inertia * w) + inertia_rate * w
        turning = quaternion_rate(quaternion, w)
        angle = rotation_vector(quaternion)
        angle_rate = ca.jtimes(angle, quaternion, turning)
        spin = (x[3:6] - gyroscopic) / inertia
        angle_acceleration = ca.jtimes(angle_rate, quaternion, turning)
        angle_acceleration += ca.jtimes(angle_rate, w, spin)
        sliding = third * (x[6:9] - radii * (ca.sumsqr(w) - w**2))
        # From the foot, whose own motion is given and has no acceleration here.
        leg_rate = v[4]
        pace = com_rate - ca.vertcat(v[:2], 0.0)
        along = ca.jacobian(com, q[4])
        leg_acceleration = ca.dot(along, x[:3]) + (ca.sumsqr(pace) - leg_rate**2) / q[4]
        leg_force = ca.jacobian(com, q[2:5]).T @ push
        return cls(
            model=model,
            q=q,
            v=v,
            x=x,
            com=com,
            com_rate=com_rate,
            push=push,
            force=ca.vertcat(leg_force, x[3:6], sliding),
            moment=rotation(quaternion) @ x[3:6],
            inertia=inertia,
            gyroscopic=gyroscopic,
            angle=angle,
            angle_rate=angle_rate,
            angle_acceleration=angle_acceleration,
            leg_rate=leg_rate,
            leg_acceleration=leg_acceleration,
        )


def physical_rows(foot: FlatFoot, bounds: Bounds, normals: Array, offsets: Array) -> Rows:
    """Return what no command may break: CoP in the polygon, friction, force along the leg.

    Forces are in parts of the weight, so that all rows are of one size. The friction cone is
    replaced by the pyramid inside it.
    """
    rows, weight = Rows(), foot.model.mass * foot.model.gravity
    f, height = foot.push / weight, foot.com[2]
    moment = foot.moment / weight
    # The CoP times f_z, so that it is affine.
    cop = foot.com[:2] * f[2] - height * f[:2] + ca.vertcat(-moment[1], moment[0])
    for k, (normal, offset) in enumerate(zip(normals, offsets, strict=True)):
        inside = ca.dot(ca.DM(normal), cop) - float(offset) * f[2]
        rows.add(f"CoP inside edge {k}", inside, -ca.inf, 0.0)
    if bounds.friction < FREE:
        slope = bounds.friction / np.sqrt(2.0)
        for axis, name in enumerate("xy"):
            for sign in (1.0, -1.0):
                label = f"friction {'+' if sign > 0 else '-'}{name}"
                rows.add(label, sign * f[axis] - slope * f[2], -ca.inf, 0.0)
    low, high = bounds.leg_force
    rows.add("force along the leg", foot.force[2] / weight, low / weight, high / weight)
    return rows


def elastic_rows(rows: Rows, foot: FlatFoot, bounds: Bounds, dt: float) -> None:
    """Add the leg's length and the wheel's angle, by braking; each row has a slack of its own."""
    slack, g = foot.x[9:], foot.model.gravity
    low, high = acceleration_range(
        foot.q[4], foot.leg_rate, bounds.leg_length, (LEG_BRAKE * g, LEG_BRAKE * g), dt, INSIST
    )
    rows.add("length of the leg", (foot.leg_acceleration - slack[0]) / g, low / g, high / g)
    if bounds.wheel_angle < FREE:
        strength = COUNTED * bounds.wheel_torque / foot.inertia
        edge = (1.0 - ANGLE_SKIN) * bounds.wheel_angle
        low, high = acceleration_range(
            foot.angle, foot.angle_rate, (-edge, edge), (strength, strength), dt, INSIST
        )
        # In the torque's own units, so that a heavy wheel's rows weigh what a light one's do.
        scale = foot.inertia / bounds.wheel_torque
        for k, axis in enumerate("123"):
            turn = (foot.angle_acceleration[k] - slack[1 + k]) * scale[k]
            rows.add(f"angle of the masses {axis}", turn, low[k] * scale[k], high[k] * scale[k])


def box(foot: FlatFoot, bounds: Bounds, dt: float) -> tuple[ca.SX, ca.SX]:
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
    fall = -(1.0 - LIGHTEST) * g
    free = ca.SX(ca.inf * ca.DM.ones(4))
    return (
        ca.vertcat(-ca.inf, -ca.inf, fall, torque[0], stroke[0], -free),
        ca.vertcat(ca.inf, ca.inf, ca.inf, torque[1], stroke[1], free),
    )
