"""What a foot of some extent can give: no torque that takes the CoP out of it."""

from __future__ import annotations

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.polygon import half_planes
from wbc.rmp.balance.bounds import Bounds
from wbc.rmp.balance.function import Evaluator
from wbc.rmp.balance.law import Pendulum
from wbc.rmp.planar import PlanarRmp
from wbc.validate import Array

# The CoP is kept this far inside the support: rounding, and its way while a command is held [m].
SKIN = 1e-5


def require_support(model: Pendulum, bounds: Bounds) -> None:
    """Raise InvalidInputError for a polygon of the other kind of pendulum; none is fine."""
    flat = isinstance(model, PlanarRmp)
    if bounds.polygon is not None and (np.ndim(bounds.polygon) == 1) != flat:
        want = "(least x, greatest x)" if flat else "corners (k, 2)"
        raise InvalidInputError(f"bounds: polygon of a {type(model).__name__} must be {want}")


class Foot:
    """The support polygon of a foot that stays, as a limit on torques about the leg's foot.

    Raises
    ------
    InvalidInputError
        Bounds without a polygon, or with one of the other kind of pendulum.
    """

    def __init__(self, model: Pendulum, bounds: Bounds) -> None:
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
        self._pressure = Evaluator(_pressure(model))

    def room(self, q: Array, v: Array, force: Array) -> float:
        """Return how far inside its polygon the true CoP is [m] under forces f.

        ``-inf`` if the ground does not push.
        """
        return _room(*self._loads(q, v, force))

    def share(self, q: Array, v: Array, force: Array, torque: Array) -> tuple[float, float]:
        """Return the largest part s in [0, 1] of ``torque`` for which the CoP stays in the foot.

        Forces f = force + s torque (nf,). The CoP times the push of the ground is affine in f, so
        each edge of the polygon is a limit on s. If s = 0 is outside, some s is still sought that
        brings the CoP back; if there is none, s is 0. The second number is :meth:`room` at s.
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
        return s, _room(start + s * (end - start), push + s * (pushed - push))

    def _loads(self, q: Array, v: Array, force: Array) -> tuple[Array, float]:
        """Return (n . p - offset) f_z for each edge, not above 0 inside, and f_z."""
        pressure, push = self._pressure(q, v, force)
        f_z = float(push[0, 0])
        return self._normals @ pressure[:, 0] - (self._offsets - SKIN) * f_z, f_z


def _room(loads: Array, push: float) -> float:
    return float((-loads / push).min()) + SKIN if push > 0.0 else -np.inf


def _pressure(model: Pendulum) -> ca.Function:
    """Return (q, v, f) -> (CoP times f_z, f_z); the foot has no acceleration (theory, 7)."""
    nq, nv, nf = len(model.Q), len(model.V), len(model.F)
    q, v, f = ca.SX.sym("q", nq), ca.SX.sym("v", nv), ca.SX.sym("f", nf)
    x = ca.vertcat(q, v)
    rate = model.functions["state_rate"](x, ca.vertcat(ca.SX.zeros(nv - nf), f))
    push = model.functions["ground_reaction"](q, v, rate[nq:])
    com, _ = model.functions["com"](q, v)
    k_G, _ = model.functions["momenta"](q, v)
    moment = ca.jtimes(k_G, x, rate)
    # Planar momenta are about -y; in space m is crossed with the vertical.
    turned = moment if nv - nf == 1 else ca.vertcat(-moment[1], moment[0])
    pressure = com[:-1] * push[-1] - com[-1] * push[:-1] + turned
    return ca.Function("pressure", [q, v, f], [ca.densify(pressure), ca.densify(push[-1])])
