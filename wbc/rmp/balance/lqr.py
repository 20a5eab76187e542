"""Linear quadratic regulator about any equilibrium of a planar or solid pendulum."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, solve_continuous_are
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.rmp.balance.foot import SupportFoot
from wbc.rmp.balance.law import LawBounds, Pendulum, PendulumCommand, check_law, refuse_torsion
from wbc.rmp.pendulum import AT_REST
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, finite_vector, read_only, set_fields

# Singular values of [A - s 1, B], in scaled units, below which no input reaches the mode.
UNCONTROLLABLE = 1e-7


@dataclass(frozen=True, eq=False)
class Lqr:
    """u = u_0 - K x with the gain K that makes the integral of x^T Q x + u^T R u least.

    The state x (2 n,) is the difference from rest at ``q0`` of all coordinates but the CoP's, which
    stays, and then their rates: n = 4, (theta, r_l, alpha, r), or n = 9, (theta, phi, r_l, rotation
    of the masses (3,), r_1, r_2, r_3), where the rotation is the vector of q0^-1 q. The inputs u
    are those of ``model.F``; for a solid pendulum tau_1 .. tau_3 are torques of a hip, whose
    reaction turns the leg, and tau_theta, tau_phi are what the foot alone gives. Without ``foot``
    these are left out: a point contact gives none. Rotation, body rate and hip torque are taken in
    the axes of the masses at rest, and brought back to where the masses are: masses that swing far
    out must not turn the torque that holds the leg.

    Riccati: A^T P + P A - P B R^-1 B^T P + Q = 0, K = R^-1 B^T P (Anderson and Moore, Optimal
    Control, 1990), on ``model.linearisation``, in units in which Q and R are identities.

    Torques of the wheel and the force along the leg are clipped to the bounds, and torque of the
    foot is cut back, in its direction, to where the CoP stays inside the polygon. Friction, rate
    and angle of the wheel and the masses' strokes are not enforced. In phase ``"clipped"`` a bound
    is at work, in ``"hold"`` none; ``ok`` is False if the CoP cannot be kept inside.

    Weights follow Bryson's rule: Q = diag(1 / errors^2), R = diag(1 / efforts^2), from the largest
    states (2 n,) and inputs that are wanted. Defaults: 0.1 rad for the leg, 1 rad for the masses, 5
    percent of the leg for lengths, rates sqrt(g / r_l) times as much; for forces the weight of what
    they move, for torques 0.3 M g r_l.

    Raises InvalidInputError: no equilibrium with these inputs (the message says what is missing),
    an unstable mode that no input reaches, or numbers that are unusable.
    """

    model: Pendulum
    q0: Array  # where it should rest (nq,)
    foot: bool = False  # whether torque about the leg's foot is an input; this needs a polygon
    bounds: LawBounds = field(default_factory=LawBounds)  # what is clipped to
    errors: ArrayLike | None = None
    efforts: ArrayLike | None = None
    gain: Array = field(init=False, repr=False)  # K (nu, 2 n)
    cost: Array = field(init=False, repr=False)  # P (2 n, 2 n)
    open_loop: tuple[Array, Array] = field(init=False, repr=False)  # (A, B) on x and u
    _rest: Array = field(init=False, repr=False)
    _foot: SupportFoot | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, PlanarRmp, SolidRmp)
        refuse_torsion(self.bounds, self)
        q0 = read_only(finite_vector("q0", self.q0, len(self.model.Q)))
        rest = self.model.holding_force(q0)
        foot = SupportFoot(self.model, self.bounds) if self.foot else None
        _require_rest(self.model, q0, rest, foot)
        A, B = _open_loop(self.model, q0, rest, self.foot)
        default_errors, default_efforts = _largest_wanted(self.model, q0)
        errors = default_errors if self.errors is None else self.errors
        efforts = default_efforts[-B.shape[1] :] if self.efforts is None else self.efforts
        errors = finite_vector("errors", errors, len(A))
        K, P = riccati_gain(A, B, errors, finite_vector("efforts", efforts, B.shape[1]))
        set_fields(self, q0=q0, gain=K, cost=P, open_loop=(A, B), _rest=rest, _foot=foot)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of x."""
        moving = self.model.V[self.model.COP :]
        return (*moving, *(f"{name} rate" for name in moving))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of u."""
        return self.model.F[0 if self.foot else self.model.COP :]

    def state(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return x (2 n,) at a configuration and velocity."""
        q = finite_vector("q", q, len(self.model.Q))
        v = finite_vector("v", v, len(self.model.V))
        places = q - self.q0
        if isinstance(self.model, SolidRmp):
            rotation = self._rotation(q)
            places = np.concatenate((places[:5], rotation.as_rotvec(), places[9:]))
            v[5:8] = rotation.apply(v[5:8])
        return np.concatenate((places[self.model.COP :], v[self.model.COP :]))

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces; ``time`` does not matter."""
        driven = self.model.COP
        wanted = self._rest.copy()
        wanted[len(wanted) - len(self.gain) :] -= self.gain @ self.state(q, v)
        if isinstance(self.model, SolidRmp):
            wanted[3:6] = self._rotation(q).inv().apply(wanted[3:6])
        given = self._clipped(wanted)
        force = given.copy()
        force[:driven] = 0.0
        if isinstance(self.model, SolidRmp):
            force += self.model.hip_torque(q, given[3:6]) * _REACTION
        scale, note = 1.0, ""
        if self._foot is not None:
            torque = np.zeros(len(force))
            torque[:driven] = given[:driven]
            scale, margin = self._foot.torque_scale(q, v, force, torque)
            force += scale * torque
            if margin == -np.inf:
                note = "the ground would have to pull"
            elif margin < 0.0:
                note = f"the CoP would leave the support by {-margin:.4g} m"
        clipped = scale < 1.0 or not np.array_equal(given, wanted)
        return PendulumCommand(
            force, np.zeros(driven), "clipped" if clipped else "hold", not note, note
        )

    def _rotation(self, q: Array) -> Rotation:
        """Return the rotation of the masses from rest, in their axes at rest."""
        return Rotation.from_quat(self.q0[5:9]).inv() * Rotation.from_quat(q[5:9])

    def _clipped(self, wanted: Array) -> Array:
        given, leg = wanted.copy(), self.model.COP
        given[leg] = np.clip(wanted[leg], *self.bounds.leg_force)
        wheel = slice(3, 6) if leg == 2 else slice(2, 3)
        most = self.bounds.wheel_torque
        given[wheel] = np.clip(wanted[wheel], -most, most)
        return given


# The part of a hip's torque that is not in the rows of the masses already.
_REACTION = np.array((1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def riccati_gain(A: Array, B: Array, errors: Array, efforts: Array) -> tuple[Array, Array]:
    """Return (K, P) of the regulator of x' = A x + B u, weighted by Bryson's rule.

    ``errors``, ``efforts``: largest states and inputs wanted, > 0: Q = diag(1 / errors^2), R =
    diag(1 / efforts^2).
    """
    if errors.min() <= 0.0 or efforts.min() <= 0.0:
        raise InvalidInputError("lqr: errors and efforts must be positive")
    # In these units x and u are of order one: the equation is solved where it is well scaled.
    a, b = A * (errors / errors[:, None]), B * (efforts / errors[:, None])
    _require_stabilisable(a, b)
    try:
        p = solve_continuous_are(a, b, np.eye(len(a)), np.eye(b.shape[1]))
    except (LinAlgError, ValueError) as error:
        raise InvalidInputError(f"lqr: the Riccati equation has no solution: {error}") from error
    return (efforts[:, None] * (b.T @ p)) / errors, p / np.outer(errors, errors)


def _require_stabilisable(a: Array, b: Array) -> None:
    size = max(1.0, float(np.abs(a).max()))
    for mode in np.linalg.eigvals(a):
        if mode.real < -UNCONTROLLABLE * size:
            continue
        test = np.hstack((a - mode * np.eye(len(a)), b))
        if np.linalg.svd(test, compute_uv=False)[-1] < UNCONTROLLABLE * size:
            raise InvalidInputError(
                f"lqr: the mode at {mode:.3g} 1/s does not decay, and no input reaches it; with a"
                " point contact this needs gravity, or a foot"
            )


def _require_rest(model: Pendulum, q0: Array, rest: Array, foot: SupportFoot | None) -> None:
    if foot is not None:
        out = -foot.cop_margin(q0, np.zeros(len(model.V)), rest)
        if out > 0.0:
            raise InvalidInputError(
                f"q0: no equilibrium; the CoP would be {out:.4g} m out of the support"
            )
        return
    missing = float(np.abs(rest[: model.COP]).max())
    if missing > AT_REST * max(model.mass * model.gravity * q0[model.LEG], 1.0):
        raise InvalidInputError(
            f"q0: no equilibrium on a point contact; the foot would have to give {missing:.4g} N m"
        )


def _open_loop(model: Pendulum, q0: Array, rest: Array, foot: bool) -> tuple[Array, Array]:
    """Return (A, B) without the CoP; a hip's torque takes its reaction along."""
    nv, driven = len(model.V), model.COP
    A, B = model.linearisation(q0, rest)
    inputs = np.eye(len(model.F))
    if isinstance(model, SolidRmp):
        for axis in range(3):
            inputs[:, 3 + axis] = model.hip_torque(q0, np.eye(3)[axis])
    kept = [*range(driven, nv), *range(nv + driven, 2 * nv)]
    B = B[kept, driven:] @ inputs[:, 0 if foot else driven :]
    return A[np.ix_(kept, kept)], B


def _largest_wanted(model: Pendulum, q0: Array) -> tuple[Array, Array]:
    leg, gravity = float(q0[model.LEG]), model.gravity or 1.0
    lean, turn, length = 0.1, 1.0, 0.05 * leg
    force = model.mass * gravity
    torque = 0.3 * force * leg
    if isinstance(model, PlanarRmp):
        places = np.array((lean, length, turn, length))
        efforts = np.array((torque, force, torque, force))
    else:
        places = np.repeat((lean, length, turn, length), (2, 1, 3, 3))
        efforts = np.repeat((torque, force, torque, force / 3.0), (2, 1, 3, 3))
    return np.concatenate((places, np.sqrt(gravity / leg) * places)), efforts
