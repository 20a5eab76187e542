"""Cost and rows of the flat foot's quadratic program, and the Function that fills them in."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.polygon import half_planes
from wbc.qp import QP, Labels
from wbc.rmp.balance.bounds import Bounds
from wbc.rmp.balance.capture import CaptureGains, beyond_reserve, braking_debt, nearest, wanted_cmp
from wbc.rmp.balance.flat_foot import FlatFoot, box, elastic_rows, physical_rows
from wbc.rmp.balance.function import Evaluator
from wbc.validate import Array, finite_number

UNKNOWNS = (
    *("c''_x", "c''_y", "c''_z", "tau_1", "tau_2", "tau_3", "r_1''", "r_2''", "r_3''"),
    *("slack leg", "slack angle 1", "slack angle 2", "slack angle 3"),
)
# The CoP is kept this far inside the support, for rounding and for the CoP's way in a tick [m].
SKIN = 1e-5
# Part of the rest height below which the capture point law reckons with no lower CoM.
LOWEST = 0.1


@dataclass(frozen=True)
class Weights:
    """Weights of the squares of what each unknown is off, in parts of its scale.

    The scale of accelerations is g, that of torques their limit, that of the slacks g and what the
    motors can do. Weights are far apart, so that each decides only what those before it leave
    open: the CoP costs nothing, so it does what it can; the wheel's return yields to the capture
    point; the height is kept as well as the CoM's place.

    Raises
    ------
    InvalidInputError
        A weight that is not positive.
    """

    horizontal: float = 1.0
    vertical: float = 1.0
    wheel: float = 1e-4
    radii: float = 1e-2
    slack: float = 1e3

    def __post_init__(self) -> None:
        for name in ("horizontal", "vertical", "wheel", "radii", "slack"):
            finite_number(f"weights: {name}", getattr(self, name), above=0.0)


@dataclass(frozen=True, eq=False)
class Rest:
    """Where a pendulum comes to rest: CoM (3,) [m] and radii (3,) [m]."""

    com: Array
    radii: Array


@dataclass(frozen=True, eq=False)
class Tick:
    """The QP of one state, and what else is told of it.

    ``fallback`` (13,) are unknowns, not scaled, for the case that the QP fails, ``outside`` is how
    far the capture point is beyond what the CoP can hold [m], ``turned`` the largest angle or rate
    of the masses [rad, rad/s].
    """

    qp: QP
    fallback: Array
    outside: float
    turned: float


class StandingProgram:
    """Fills in the QP of a state; everything that does not depend on it is worked out once.

    The unknowns of the QP are those of :mod:`wbc.rmp.balance.flat_foot` divided by ``scale`` (13,):
    a torque in N m would have a curvature of 1e-8, less than solvers look at, and drift.

    Parameters
    ----------
    foot:
        Symbols of the pendulum.
    bounds, rest, dt, gains, weights:
        See :class:`wbc.rmp.balance.momentum_qp.MomentumQp`, which has checked them.
    """

    def __init__(
        self,
        foot: FlatFoot,
        bounds: Bounds,
        rest: Rest,
        dt: float,
        gains: CaptureGains,
        weights: Weights,
    ) -> None:
        corners = np.asarray(bounds.polygon)
        normals, offsets = half_planes(corners)
        rows = physical_rows(foot, bounds, normals, offsets - SKIN)
        elastic_rows(rows, foot, bounds, dt)
        self.scale = _scale(foot, bounds, rest)
        share = np.repeat(
            (weights.horizontal, weights.vertical, weights.wheel, weights.radii, weights.slack),
            (2, 1, 3, 3, 4),
        )
        self._P = np.diag(share)
        self._A, self._b = np.zeros((0, len(UNKNOWNS))), np.zeros(0)
        self._labels = Labels((), tuple(rows.labels), UNKNOWNS)
        expression = ca.vertcat(*rows.expressions)
        constant = ca.substitute(expression, foot.x, ca.DM.zeros(len(UNKNOWNS)))
        aims = _Aims.of(foot, bounds, rest, corners, gains)
        outputs = (
            -ca.DM(share / self.scale) * aims.wanted,
            ca.jacobian(expression, foot.x) @ ca.DM(np.diag(self.scale)),
            ca.vertcat(*rows.lower) - constant,
            ca.vertcat(*rows.upper) - constant,
            *(limit / ca.DM(self.scale) for limit in box(foot, bounds, dt)),
            aims.fallback,
            aims.outside,
            ca.fmax(ca.norm_inf(foot.angle), ca.norm_inf(foot.v[5:8])),
        )
        dense = [ca.densify(each) for each in outputs]
        self._tick = Evaluator(ca.Function("tick", [foot.q, foot.v], dense))

    def __call__(self, q: Array, v: Array) -> Tick:
        """Return the QP at q (12,), v (11,), which are not checked."""
        g, C, l, u, lower, upper, fallback, outside, turned = self._tick(q, v)  # noqa: E741
        qp = QP(
            P=self._P,
            g=g[:, 0],
            A=self._A,
            b=self._b,
            C=C,
            l=l[:, 0],
            u=u[:, 0],
            lower=lower[:, 0],
            upper=upper[:, 0],
            labels=self._labels,
        )
        return Tick(qp, fallback[:, 0], float(outside[0, 0]), float(turned[0, 0]))


@dataclass(frozen=True, eq=False)
class _Aims:
    """Where the unknowns should be, where they go if the QP fails, and what the phase says."""

    wanted: ca.SX  # (13,)
    fallback: ca.SX  # (13,)
    outside: ca.SX

    @classmethod
    def of(
        cls, foot: FlatFoot, bounds: Bounds, rest: Rest, support: Array, gains: CaptureGains
    ) -> _Aims:
        model, com, rate, most = foot.model, foot.com, foot.com_rate, bounds.wheel_torque
        height = rest.com[2]
        omega = ca.sqrt(model.gravity / ca.fmax(com[2], LOWEST * height))
        xi = com[:2] + rate[:2] / omega
        k_G, _ = model.functions["momenta"](foot.q, foot.v)
        debt = braking_debt(k_G, most, model.mass * model.gravity, omega)
        level = omega**2 * (com[:2] - wanted_cmp(xi, debt, rest.com[:2], support, gains))
        lift = gains.height**2 * (height - com[2]) - 2 * gains.height * rate[2]
        turn = gains.wheel**2 * foot.angle + 2 * gains.wheel * foot.v[5:8]
        back = foot.gyroscopic - foot.inertia * turn
        slide = gains.radii**2 * (ca.DM(rest.radii) - foot.q[9:]) - 2 * gains.radii * foot.v[8:]
        hold = omega**2 * (com[:2] - nearest(support, com[:2]))
        calm = ca.fmax(-most, ca.fmin(most, back))
        none = ca.SX.zeros(4)
        return cls(
            wanted=ca.vertcat(level, lift, back, slide, none),
            fallback=ca.vertcat(hold, 0.0, calm, slide, none),
            outside=ca.norm_2(beyond_reserve(xi + debt, rest.com[:2], support, gains)),
        )


def _scale(foot: FlatFoot, bounds: Bounds, rest: Rest) -> Array:
    """Return the scale (13,) of each unknown."""
    g, most = foot.model.gravity, bounds.wheel_torque
    inertia = foot.model.mass / 3.0 * (np.sum(rest.radii**2) - rest.radii**2)
    return np.concatenate((np.full(3, g), np.full(3, most), np.full(4, g), most / inertia))
