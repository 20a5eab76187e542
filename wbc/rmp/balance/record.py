"""The record of a pendulum's motion under a law, and how near to its bounds it came."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wbc.polygon import polygon_margin
from wbc.rmp.balance.foot import ground_loads
from wbc.rmp.balance.law import FREE, LawBounds, Pendulum
from wbc.rmp.ground import centre_of_pressure, in_contact
from wbc.rmp.integrators import runge_kutta
from wbc.rmp.planar import PlanarRmp
from wbc.validate import Array

# Tolerance of a bound, in its unit: the accuracy of a QP, for N and N m of the order of a thousand.
BOUND_TOLERANCE = 1e-6


class Ending(Enum):
    """How a simulation ended."""

    COMPLETE = "complete"
    FELL = "fell"
    CONTACT_LOST = "contact lost"
    LAW_FAILED = "law failed"
    DIVERGED = "diverged"


@dataclass(frozen=True, eq=False)
class Simulation:
    """A motion of n steps, and how it ended. Nothing in it is infinite; only ``cop`` has NaN.

    With ``pivot`` the foot was bolted to the ground, which then bounds neither CoP nor friction nor
    force along the leg. CoP and ground force are those at the beginning of each step.
    """

    model: Pendulum  # that moved
    bounds: LawBounds  # that it is judged by
    pivot: bool
    time: Array  # (n + 1,) [s]
    q: Array  # (n + 1, nq)
    v: Array  # (n + 1, nv); where a push acted, the velocity after it
    force: Array  # commands f (n, nf), each held until the next time
    cop_acceleration: Array  # the other part of the commands (n, 1 or 2) [m/s^2]
    cop: Array  # true CoP (n, 1 or 2) [m], from f_r and k_G'; NaN where the ground does not push
    ground_force: Array  # f_r (n, 2 or 3) [N], up last
    phase: list[str]  # of the law (n,)
    ok: NDArray[np.bool_]  # the law's verdict on itself (n,)
    ending: Ending
    note: str  # why it ended, or else the first complaint of the law; may be empty

    @property
    def ended_at(self) -> float:
        """The last time [s]."""
        return float(self.time[-1])

    @property
    def cop_violation(self) -> float:
        """Largest distance of the true CoP from the support [m]; zero if it never left it."""
        return max(0.0, -self.margins()["cop"])

    def com(self) -> tuple[Array, Array]:
        """Return position [m] and velocity [m/s] of the CoM (n + 1, 2 or 3), up last."""
        c, rate = self.model.functions["com"].map(len(self.q))(self.q.T, self.v.T)
        return c.full().T, rate.full().T

    def momentum(self) -> Array:
        """Return k_G (n + 1, 1 or 3) [kg m^2/s]."""
        k_G, _ = self.model.functions["momenta"].map(len(self.q))(self.q.T, self.v.T)
        return np.asarray(k_G.full().T)

    def margins(self) -> dict[str, float]:
        """Return the least distance to each bound over the run; negative where it was broken.

        Keys are ``cop`` [m] and the names of the other bounds, in their units; ``inf`` for what
        has no bound. For a solid pendulum the wheel's angle is the rotation vector of the masses'
        frame from the world's axes, and its rate is their body rate.

        Judged at the beginning, in the middle and at the end of each step, before any push; but
        the CoP of a foot without extent at the beginning only: no command held for a while keeps
        it in a point.
        """
        b, (q, v, cop, ground_force) = self.bounds, self._samples
        pushed = ~np.isnan(cop[:, 0])
        level, up = ground_force[pushed, :-1], ground_force[pushed, -1]
        masses = self.model.RADII
        if isinstance(self.model, PlanarRmp):
            turned, spin = q[:, 3], v[:, 3]
        else:
            # The shorter way round: a quaternion and its negative are one orientation.
            turned, spin = Rotation.from_quat(q[:, 5:9]).as_rotvec(), v[:, 5:8]
        leg_force = self.force[:, self.model.F.index("f_l")]
        torque = self.force[:, -2 * masses : -masses]
        slope = np.linalg.norm(level, axis=1) / up
        return {
            "cop": FREE if self.pivot else self._cop_margin(cop[pushed]),
            "friction": FREE if self.pivot else _least(b.friction - slope),
            "leg_force": FREE if self.pivot else _within(leg_force, b.leg_force),
            "leg_length": _within(q[:, self.model.LEG], b.leg_length),
            "wheel_torque": _least(b.wheel_torque - np.abs(torque)),
            "wheel_angle": _least(b.wheel_angle - np.abs(turned)),
            "wheel_rate": _least(b.wheel_rate - np.abs(spin)),
            "radius": _within(q[:, -masses:], b.radius),
        }

    def broken(self) -> dict[str, float]:
        """Return the violated bounds, and the largest violation, in their units."""
        return {
            name: -margin for name, margin in self.margins().items() if margin < -BOUND_TOLERANCE
        }

    @cached_property
    def _samples(self) -> tuple[Array, Array, Array, Array]:
        """q, v at all times, and in the middle and at the end of each step; CoP and f_r there."""
        states = [np.column_stack((self.q, self.v))]
        pushes = [(self.cop, self.ground_force)]
        if len(self.force):
            inputs = np.column_stack((self.cop_acceleration, self.force))
            half = runge_kutta(self.model, (self.time[1] - self.time[0]) / 2).map(len(inputs))
            at = states[0][:-1]
            for _ in range(2):
                at = half(at.T, inputs.T).full().T
                states.append(at)
                pushes.append(ground_push(self.model, at, inputs))
        x = np.concatenate(states)
        cop, force = (np.concatenate(each) for each in zip(*pushes, strict=True))
        return x[:, : self.q.shape[1]], x[:, self.q.shape[1] :], cop, force

    def _cop_margin(self, cop: Array) -> float:
        polygon = self.bounds.polygon
        if polygon is None:
            away = self.cop - self.q[:-1, : self.cop.shape[1]]
            return _least(-np.linalg.norm(away[~np.isnan(away[:, 0])], axis=1))
        if np.ndim(polygon) == 1:
            low, high = np.asarray(polygon).tolist()
            return _within(cop, (low, high))
        return _least(polygon_margin(polygon, cop)) if len(cop) else FREE


def ground_push(model: Pendulum, states: Array, inputs: Array) -> tuple[Array, Array]:
    """Return the true CoP (n, 1 or 2) [m], NaN where the ground does not push, and f_r [N].

    ``states``, ``inputs``: (q, v) (n, nq + nv) and (CoP acceleration, f) (n, nv).
    """
    nq, nv = len(model.Q), len(model.V)
    if not len(states):
        return np.zeros((0, model.COP)), np.zeros((0, model.COP + 1))
    x, u = ca.SX.sym("x", nq + nv), ca.SX.sym("u", nv)
    loads = ca.Function("loads", [x, u], ground_loads(model, x, u))
    c, force, moment = (each.full().T for each in loads.map(len(states))(states.T, inputs.T))
    return _cop(c, force, moment, model.mass * model.gravity), force


def _cop(com: Array, force: Array, moment: Array, weight: float) -> Array:
    """Return the CoP (n, 1 or 2); a planar pendulum moves in the plane y = 0 of space."""
    if force.shape[1] == 2:
        zero = np.zeros(len(force))
        com = np.column_stack((com[:, 0], zero, com[:, 1]))
        force = np.column_stack((force[:, 0], zero, force[:, 1]))
        # Planar momenta are about -y.
        moment = np.column_stack((zero, -moment[:, 0], zero))
        return _cop(com, force, moment, weight)[:, :1]
    cop = np.full((len(force), 2), np.nan)
    pushed = in_contact(force, weight)
    cop[pushed] = centre_of_pressure(com[pushed], force[pushed], moment[pushed])[:, :2]
    return cop


def _within(values: Array, interval: tuple[float, float]) -> float:
    return min(_least(values - interval[0]), _least(interval[1] - values))


def _least(values: Array) -> float:
    return float(values.min()) if values.size else FREE
