"""Errors of tasks and contacts, and their derivatives: e' = J v + bias, e'' = J v' + drift."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from tests.reference.state import Array, State

AXIS = np.array([0.6, 0.0, -0.8])  # of a frame, that is pointed
VECH, TWICE = np.triu_indices(3), np.sqrt([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])  # xx xy xz yy yz zz


@dataclass(frozen=True)
class Task:
    """kind: com position orientation axis posture damping momentum inertia; frame: its index.

    Of an inertia (by mass) ``frame`` is None for the world's axes, 0 for the base's.
    """

    kind: str
    target: Array | None = None
    frame: int | None = None
    weight: float = 1.0
    priority: int = 0
    gain: float = 0.5
    kp: float = 100.0
    rate: Array | float = 0.0
    acceleration: Array | float = 0.0
    second_order: bool = False


@dataclass(frozen=True)
class Contact:
    """A frame held where it is anchored; soft: a cost of that weight instead."""

    frame: int
    position: Array
    rotation: Array
    corners: Array  # (k, 3) in the frame's axes, where forces act
    friction: float = 0.6
    soft: float | None = None


class Rows(NamedTuple):
    """Of a task: bound and curvature are of what Gauss-Newton leaves out of the Hessian."""

    J: Array
    error: Array
    bias: Array | float = 0.0
    drift: Array | float = 0.0
    bound: Array | float = 0.0
    curvature: Array | float = 0.0


def rows_of(state: State, task: Task) -> Rows:
    """The task's error and derivatives (a contact's, too: kind ``held``)."""
    model, data, v, target = state.model, state.data, state.v, task.target
    rate, push = -np.asarray(task.rate), -np.asarray(task.acceleration)
    match task.kind:
        case "com" | "position":
            if task.kind == "com":
                p, J, drift = data.com[0], data.Jcom, data.acom[0]
            else:
                place, J, drift = state.frame(task.frame)
                p = place.translation
            inertia = state.inertia()[0]
            lever = np.linalg.norm(p - state.q[:3]) + 1.5 * np.sqrt(np.trace(inertia) / state.mass)
            bound = np.linalg.norm(task.weight**2 * (p - target)) * lever
            return Rows(J[:3], p - target, rate, drift[:3] + push, bound)
        case "orientation":
            place, J, drift = state.frame(task.frame)
            R, w = place.rotation, J[3:] @ v
            Q, turn = target.T @ R, R.T @ (w + rate)
            turning = R.T @ (drift[3:] + push - np.cross(w, rate))
            log = pin.Jlog3(Q)
            drift = log @ turning + _slope(lambda h: pin.Jlog3(Q @ pin.exp3(h * turn)) @ turn)
            return Rows(log @ R.T @ J[3:], pin.log3(Q), log @ R.T @ rate, drift)
        case "axis":
            place, J, drift = state.frame(task.frame)
            p, w, alpha = place.rotation @ AXIS, J[3:] @ v, drift[3:]
            drift = np.cross(w, np.cross(w, p)) + np.cross(alpha, p) + push
            return Rows(-pin.skew(p) @ J[3:], p - target, rate, drift)
        case "posture":
            J = np.eye(model.nv)[6:]
            rate, push = (np.broadcast_to(one, model.nv)[6:] for one in (rate, push))
            return Rows(J, (state.q - target)[7:], rate, push)
        case "damping":
            return Rows(np.eye(model.nv), np.zeros(model.nv))
        case "momentum":
            at, still = model.createData(), np.zeros(model.nv)
            Ag = pin.computeCentroidalMap(model, at, state.q).copy()
            moving = pin.computeCentroidalMomentumTimeVariation(model, at, state.q, v, still)
            drift = moving.vector if hasattr(moving, "vector") else at.dhg.vector
            return Rows(Ag, np.zeros(6), -target, drift + rate)
        case "held":
            place, J, drift = state.frame(task.frame)
            turn = pin.log3(place.rotation @ target.rotation.T)
            return Rows(J, np.r_[place.translation - target.translation, turn], 0.0, drift)
    at = state if task.frame is None else state.in_base()
    inertia, rates, drift = at.inertia()
    G = task.weight**2 / state.mass**2 * (inertia - target)
    H, scale = at.inertia_hessian(G), TWICE / state.mass
    if at is not state:  # the base moves nothing in its own axes
        rates[:6] = H[:6] = H[:, :6] = 0.0
    J = scale[:, None] * rates[:, *VECH].T
    parts = inertia - target, rate + np.zeros((3, 3)), drift + push
    e, bias, drift = (scale * X[VECH] for X in parts)
    if task.second_order:
        return Rows(J, e, bias, drift, curvature=H)
    return Rows(J, e, bias, drift, np.abs(H).sum(axis=0))


def _slope(f) -> Array:
    """df/dh at 0 by differences of eighth order: exact to rounding for what is smooth."""
    h = 0.02
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return sum(w * (f(k * h) - f(-k * h)) for k, w in enumerate(weights, 1)) / h
