"""The law for a flat foot: capture point and momentum by one quadratic program each tick."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.polygon import half_planes, inset
from wbc.qp import QP, Backend, Labels, make_backend
from wbc.rmp.balance.capture import (
    CaptureGains,
    beyond_reserve,
    braking_debt,
    projected,
    wanted_cmp,
)
from wbc.rmp.balance.foot import TORSION, FlatFoot, box, elastic_rows, physical_rows
from wbc.rmp.balance.law import FREE, LawBounds, PendulumCommand, check_law
from wbc.rmp.functions import Evaluator
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, check_fields, finite_number, finite_vector, read_only, set_fields

UNKNOWNS = (
    *("c''_x", "c''_y", "c''_z", "tau_1", "tau_2", "tau_3", "r_1''", "r_2''", "r_3''"),
    *("slack leg", "slack angle 1", "slack angle 2", "slack angle 3"),
)
# Part of the rest height that the capture point law uses as least CoM height.
LEAST_HEIGHT = 0.1
# Angle [rad] and rate [rad/s] of the masses below which they count as returned.
RETURNED = 0.02
# A slack beyond this part of its scale is a violated limit. At a limit that is kept, the weights
# leave some 1e-5.
VIOLATED = 0.01


@dataclass(frozen=True)
class MomentumWeights:
    """Weights of the squares of what each unknown is off, in parts of its scale.

    The scale of accelerations is g, that of torques their limit, that of the slacks g and what the
    motors can do. Weights are far apart, so that each decides only what those before it leave
    open: the CoP costs nothing, so it does what it can; the wheel's return yields to the capture
    point; the height is kept as well as the CoM's place.

    Raises InvalidInputError: a weight that is not positive.
    """

    horizontal: float = 1.0
    vertical: float = 1.0
    wheel: float = 1e-4
    radii: float = 1e-2
    slack: float = 1e3

    def __post_init__(self) -> None:
        names = (each.name for each in fields(self))
        check_fields(self, "weights: ", *names, above=0.0)


@dataclass(frozen=True, eq=False)
class MomentumQp:
    """Keep a pendulum on a flat foot upright: CoP first, then the wheel, then the wheel back.

    The capture point is driven to the CoM's place of rest by a CMP beyond it
    (:mod:`wbc.rmp.balance.capture`). Within the support the CoP is the CMP. Outside, the rest is
    the wheel's torque up to its limit; braking stops it at the limit of its angle, so that the
    bang-bang of :mod:`wbc.rmp.balance.push_limits`, which absorbs the largest push, comes by
    itself. The masses turn back as soon as the CoP can pay for it.

    CoP, friction and the force along the leg are rows without slack; the length of the leg and the
    wheel's angle have slacks of great weight. The command is not ``ok``, and its note says why, if
    a slack gives way, or if the capture point is further out than foot and wheel together can reach
    at constant height: then only a step helps. The rows without slack may contradict each other at
    speeds of 10 m/s or rad/s and more. If the QP has no solution, the note has the evidence; the
    force then puts the CMP at the point of the support nearest to the CoM and slows the masses, and
    keeps no limits but the motors'.

    Phases: ``"wheel"`` while the capture point is beyond what the CoP can hold, ``"recover"`` until
    the masses have returned, ``"stand"``; ``"fallback"`` where the QP failed. The only memory
    between calls is the solver's warm start.

    The foot may stand anywhere; the law holds it where it stands. The bounds need a polygon with an
    inside and a finite wheel torque; friction is that of the pyramid inside the cone.

    Raises
    ------
    InvalidInputError
        Numbers that are unusable, or a place of rest that the bounds do not allow.
    """

    model: SolidRmp
    bounds: LawBounds
    com: ArrayLike  # where the CoM rests (3,) [m], above the inside of the polygon
    radii: ArrayLike  # distances of the masses at rest (3,) [m]
    dt: float = 1e-3  # time between commands [s], which braking reckons with
    # Their defaults were tuned for pendulums of 35 and 90 kg.
    gains: CaptureGains = field(default_factory=CaptureGains)
    weights: MomentumWeights = field(default_factory=MomentumWeights)
    backend: Backend = field(default_factory=lambda: make_backend("proxqp"))
    _program: _Program = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, SolidRmp)
        finite_number("gravity of the model", self.model.gravity, above=0.0)
        dt = finite_number("dt", self.dt, above=0.0)
        com, radii = finite_vector("com", self.com, 3), finite_vector("radii", self.radii, 3)
        _require_foot(self.bounds)
        _require_rest(self.bounds, com, radii)
        program = _Program(self, com, radii, dt)
        set_fields(self, com=read_only(com), radii=read_only(radii), _program=program)

    def program(self, q: ArrayLike, v: ArrayLike) -> QP:
        """Return the QP at q (12,), v (11,); its unknowns are in ``labels.variables``.

        Accelerations are in parts of g, torques and slacks in parts of what the motors can do.

        Raises
        ------
        InvalidInputError
            Wrong sizes or not finite.
        """
        return self._program(finite_vector("q", q, 12), finite_vector("v", v, 11)).qp

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces wanted at q (12,), v (11,); ``time`` plays no part."""
        q, v = finite_vector("q", q, 12), finite_vector("v", v, 11)
        tick = self._program(q, v)
        solution = self.backend.solve(tick.qp, "flat foot")
        still = np.zeros(2)
        if not solution.solved:
            force = self._program.force(q, v, tick.fallback)
            note = f"the QP failed; {solution.describe()}"
            return PendulumCommand(force, still, "fallback", ok=False, note=note)
        force = self._program.force(q, v, self._program.scale * solution.x)
        note = self._violations(solution.x, tick.outside)
        phase = "stand" if tick.turned < RETURNED else "recover"
        phase = "wheel" if tick.outside > 0.0 else phase
        return PendulumCommand(force, still, phase, ok=not note, note=note)

    def _violations(self, x: Array, outside: float) -> str:
        """Return which limits are violated, in words; empty if none."""
        # Both motors at once reach the corner of a box.
        reach = math.sqrt(2.0) * self.bounds.wheel_torque / (self.model.mass * self.model.gravity)
        if outside > reach:
            return (
                f"the capture point is {outside:.3g} m beyond what the foot can hold, and the wheel"
                f" reaches {reach:.3g} m; only a step helps"
            )
        slack = x[9:]
        if max(slack.max(), -slack.min()) <= VIOLATED:
            return ""
        gave = (f"{UNKNOWNS[9 + k]} {slack[k]:+.2g}" for k in np.flatnonzero(abs(slack) > VIOLATED))
        return f"too fast to be stopped before a limit, which gives way: {', '.join(gave)}"


def _require_foot(bounds: LawBounds) -> None:
    if bounds.polygon is None or np.ndim(bounds.polygon) != 2:
        raise InvalidInputError(
            "bounds: MomentumQp needs a support polygon (k, 2); for a foot without extent there is"
            " PointStabiliser"
        )
    if bounds.wheel_torque == FREE:
        raise InvalidInputError("bounds: MomentumQp needs a finite wheel_torque")


def _require_rest(bounds: LawBounds, com: Array, radii: Array) -> None:
    normals, offsets = half_planes(np.asarray(bounds.polygon))
    inside = float((offsets - normals @ com[:2]).min())
    if inside <= bounds.cop_margin:
        raise InvalidInputError(
            f"com: must rest inside the support polygon by more than cop_margin,"
            f" {bounds.cop_margin:g} m, and is {abs(inside):.3g} m"
            f" {'inside' if inside > 0.0 else 'beyond'} its edge"
        )
    low, high = bounds.radius
    if not (low <= radii.min() and radii.max() <= high):
        raise InvalidInputError(f"radii: must be within [{low:g}, {high:g}] m, got {radii}")
    low, high = bounds.leg_length
    if not low < com[2] < high:
        raise InvalidInputError(
            f"com: its height {com[2]:g} m is no length of the leg, which is in [{low:g}, {high:g}]"
        )


@dataclass(frozen=True, eq=False)
class _Tick:
    """The QP of one state, with its diagnostics."""

    qp: QP
    fallback: Array  # unknowns (13,), not scaled, for the case that the QP fails
    outside: float  # how far the capture point is beyond what the CoP can hold [m]
    turned: float  # the largest angle or rate of the masses [rad, rad/s]


class _Program:
    """Fills in the QP of a state; everything that does not depend on it is worked out once.

    The QP's unknowns are those of :mod:`wbc.rmp.balance.foot` divided by ``scale`` (13,): a torque
    in N m would have a curvature of 1e-8, less than solvers look at, and drift.
    """

    def __init__(self, law: MomentumQp, com: Array, radii: Array, dt: float) -> None:
        foot, bounds = FlatFoot(law.model), law.bounds
        normals, offsets = half_planes(np.asarray(bounds.polygon))
        rows = physical_rows(foot, bounds, normals, offsets - bounds.cop_margin)
        if bounds.torsion and not any(row.label.startswith(TORSION) for row in rows):
            raise InvalidInputError(
                "bounds: torsion needs a finite friction and a rectangular polygon"
            )
        rows += elastic_rows(foot, bounds, dt)
        g, most = law.model.gravity, bounds.wheel_torque
        inertia = law.model.mass / 3.0 * (np.sum(radii**2) - radii**2)
        self.scale = np.concatenate((np.repeat((g, most, g), (3, 3, 4)), most / inertia))
        w = law.weights
        share = np.repeat((w.horizontal, w.vertical, w.wheel, w.radii, w.slack), (2, 1, 3, 3, 4))
        self._P = np.diag(share)
        self._A, self._b = np.zeros((0, len(UNKNOWNS))), np.zeros(0)
        self._labels = Labels((), tuple(row.label for row in rows), UNKNOWNS)
        expression = ca.vertcat(*(row.expression for row in rows))
        constant = ca.substitute(expression, foot.x, ca.DM.zeros(len(UNKNOWNS)))
        wanted, fallback, outside = _wanted_and_fallback(foot, law, com, radii)
        outputs = (
            -ca.DM(share / self.scale) * wanted,
            ca.jacobian(expression, foot.x) @ ca.DM(np.diag(self.scale)),
            ca.vertcat(*(row.lower for row in rows)) - constant,
            ca.vertcat(*(row.upper for row in rows)) - constant,
            *(limit / ca.DM(self.scale) for limit in box(foot, bounds, dt)),
            fallback,
            outside,
            ca.fmax(ca.norm_inf(foot.angle), ca.norm_inf(foot.v[5:8])),
        )
        state = [foot.q, foot.v]
        self._tick = Evaluator(ca.Function("tick", state, [ca.densify(each) for each in outputs]))
        force = ca.Function("force", [*state, foot.x], [ca.densify(foot.force)])
        self._force = Evaluator(force)

    def force(self, q: Array, v: Array, x: Array) -> Array:
        """Return f (9,) for unknowns x (13,), not scaled."""
        return self._force(q, v, x)[0]

    def __call__(self, q: Array, v: Array) -> _Tick:
        """Return the QP at q (12,), v (11,), which are not checked."""
        g, C, l, u, lower, upper, fallback, outside, turned = self._tick(q, v)  # noqa: E741
        qp = QP(self._P, g, self._A, self._b, C, l, u, lower, upper, self._labels)
        return _Tick(qp, fallback, float(outside[0]), float(turned[0]))


def _wanted_and_fallback(
    foot: FlatFoot, law: MomentumQp, com: Array, radii: Array
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the wanted unknowns (13,), the fallback (13,), and ``outside``."""
    model, gains, most = law.model, law.gains, law.bounds.wheel_torque
    support = inset(np.asarray(law.bounds.polygon), law.bounds.cop_margin)
    place, rate = foot.com, foot.com_rate
    omega = ca.sqrt(model.gravity / ca.fmax(place[2], LEAST_HEIGHT * com[2]))
    xi = place[:2] + rate[:2] / omega
    k_G, _ = model.functions["momenta"](foot.q, foot.v)
    debt = braking_debt(k_G, most, model.mass * model.gravity, omega)
    level = omega**2 * (place[:2] - wanted_cmp(xi, debt, com[:2], support, gains))
    lift = gains.height**2 * (com[2] - place[2]) - 2 * gains.height * rate[2]
    turn = gains.wheel**2 * foot.angle + 2 * gains.wheel * foot.v[5:8]
    back = foot.gyroscopic - foot.inertia * turn
    slide = gains.radii**2 * (ca.DM(radii) - foot.q[9:]) - 2 * gains.radii * foot.v[8:]
    hold = omega**2 * (place[:2] - projected(support, place[:2]))
    calm = ca.fmax(-most, ca.fmin(most, back))
    none = ca.SX.zeros(4)
    return (
        ca.vertcat(level, lift, back, slide, none),
        ca.vertcat(hold, 0.0, calm, slide, none),
        ca.norm_2(beyond_reserve(xi + debt, com[:2], support, gains)),
    )
