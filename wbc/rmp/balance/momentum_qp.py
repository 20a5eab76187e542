"""The law for a flat foot: capture point and momentum by one quadratic program each tick."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.polygon import half_planes
from wbc.qp import QP, Backend, make_backend
from wbc.rmp.balance.bounds import FREE, Bounds
from wbc.rmp.balance.capture import CaptureGains
from wbc.rmp.balance.flat_foot import FlatFoot
from wbc.rmp.balance.function import Evaluator
from wbc.rmp.balance.law import Command
from wbc.rmp.balance.standing_program import UNKNOWNS, Rest, StandingProgram, Weights
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, finite_number, finite_vector, read_only

# Angle [rad] and rate [rad/s] of the masses below which they count as returned.
RETURNED = 0.02
# A slack beyond this part of its scale is a limit not kept. At a limit that is kept, the weights
# leave some 1e-5.
GIVEN_WAY = 0.01


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

    Parameters
    ----------
    model:
        The pendulum. Its foot may stand anywhere; the law holds it where it stands.
    bounds:
        A polygon with an inside and a finite wheel torque are needed. Friction is that of the
        pyramid inside the cone.
    com:
        Where the CoM rests (3,) [m], above the inside of the polygon.
    radii:
        Distances of the masses at rest (3,) [m].
    dt:
        Time between commands [s], which braking reckons with.
    gains, weights:
        See there; defaults were tuned for pendulums of 35 and 90 kg.
    backend:
        Solver of the QP; ProxQP unless given.

    Raises
    ------
    InvalidInputError
        Numbers that are unusable, or a place of rest that the bounds do not allow.
    """

    model: SolidRmp
    bounds: Bounds
    com: ArrayLike
    radii: ArrayLike
    dt: float = 1e-3
    gains: CaptureGains = field(default_factory=CaptureGains)
    weights: Weights = field(default_factory=Weights)
    backend: Backend = field(default_factory=lambda: make_backend("proxqp"))
    _program: StandingProgram = field(init=False, repr=False)
    _force: Evaluator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        finite_number("gravity of the model", self.model.gravity, above=0.0)
        dt = finite_number("dt", self.dt, above=0.0)
        com, radii = finite_vector("com", self.com, 3), finite_vector("radii", self.radii, 3)
        _require_foot(self.bounds)
        _require_rest(self.bounds, com, radii)
        foot = FlatFoot.of(self.model)
        program = StandingProgram(foot, self.bounds, Rest(com, radii), dt, self.gains, self.weights)
        force = ca.Function("force", [foot.q, foot.v, foot.x], [ca.densify(foot.force)])
        object.__setattr__(self, "com", read_only(com))
        object.__setattr__(self, "radii", read_only(radii))
        object.__setattr__(self, "_program", program)
        object.__setattr__(self, "_force", Evaluator(force))

    def program(self, q: ArrayLike, v: ArrayLike) -> QP:
        """Return the QP at q (12,), v (11,); its unknowns are in ``labels.variables``.

        Accelerations are in parts of g, torques and slacks in parts of what the motors can do.

        Raises
        ------
        InvalidInputError
            Wrong sizes or not finite.
        """
        return self._program(finite_vector("q", q, 12), finite_vector("v", v, 11)).qp

    def command(self, q: Array, v: Array, time: float) -> Command:
        """Return the forces wanted at q (12,), v (11,); ``time`` plays no part.

        Raises
        ------
        InvalidInputError
            Wrong sizes or not finite.
        """
        q, v = finite_vector("q", q, 12), finite_vector("v", v, 11)
        tick = self._program(q, v)
        solution = self.backend.solve(tick.qp, "flat foot")
        still = np.zeros(2)
        if not solution.solved:
            force = self._force(q, v, tick.fallback)[0][:, 0]
            note = f"the QP failed; {solution.describe()}"
            return Command(force, still, "fallback", ok=False, note=note)
        force = self._force(q, v, self._program.scale * solution.x)[0][:, 0]
        note = self._complaint(solution.x, tick.outside)
        return Command(force, still, _phase(tick.outside, tick.turned), ok=not note, note=note)

    def _complaint(self, x: Array, outside: float) -> str:
        """Return what cannot be done; empty if all can."""
        # Both motors at once reach the corner of a box.
        reach = math.sqrt(2.0) * self.bounds.wheel_torque / (self.model.mass * self.model.gravity)
        if outside > reach:
            return (
                f"the capture point is {outside:.3g} m beyond what the foot can hold, and the wheel"
                f" reaches {reach:.3g} m; only a step helps"
            )
        slack = x[9:]
        if max(slack.max(), -slack.min()) <= GIVEN_WAY:
            return ""
        gave = (
            f"{UNKNOWNS[9 + k]} {slack[k]:+.2g}" for k in np.flatnonzero(abs(slack) > GIVEN_WAY)
        )
        return f"too fast to be stopped before a limit, which gives way: {', '.join(gave)}"


def _phase(outside: float, turned: float) -> str:
    if outside > 0.0:
        return "wheel"
    return "stand" if turned < RETURNED else "recover"


def _require_foot(bounds: Bounds) -> None:
    if bounds.polygon is None or np.ndim(bounds.polygon) != 2:
        raise InvalidInputError(
            "bounds: MomentumQp needs a support polygon (k, 2); for a foot without extent there is"
            " PointStabiliser"
        )
    if bounds.wheel_torque == FREE:
        raise InvalidInputError("bounds: MomentumQp needs a finite wheel_torque")


def _require_rest(bounds: Bounds, com: Array, radii: Array) -> None:
    normals, offsets = half_planes(np.asarray(bounds.polygon))
    inside = float((offsets - normals @ com[:2]).min())
    if inside <= 0.0:
        raise InvalidInputError(
            "com: must rest above the inside of the support polygon, and is"
            f" {max(0.0, -inside):.3g} m beyond its edge"
        )
    low, high = bounds.radius
    if not (low <= radii.min() and radii.max() <= high):
        raise InvalidInputError(f"radii: must be within [{low:g}, {high:g}] m, got {radii}")
    low, high = bounds.leg_length
    if not low < com[2] < high:
        raise InvalidInputError(
            f"com: its height {com[2]:g} m is no length of the leg, which is in [{low:g}, {high:g}]"
        )
