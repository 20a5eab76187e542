"""The whole control tick as a textbook poses it: NumPy, Pinocchio, qpsolvers, nothing of wbc.

    velocity level   x = (v+)       J v+ = -gain/dt e - bias
    torque level     x = (v+, f)    J v+ = J v + dt (-kp e - kd e' - drift),    kd = 2 sqrt(kp)

in the weighted least-squares sense, with error e, e' = J v + bias, e'' = J v' + drift; contacts are
met exactly, v+ stays in the box of the limits, margins are kept, and at the torque level

    M (v+ - v)/dt + D v+ + h = [0; tau] + J' F,    F in friction cones,    |tau| <= tau_max

with force unknowns f = F dt/m [m/s]. Priorities are a cascade: a level is solved, what it achieves
(J x of its rows) is frozen, the next one follows. Slow and plain: the compiled core is held to it.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag

from tests.reference.bounds import (
    Cost,
    Limits,
    Pair,
    arrival_box,
    cutting_planes,
    margin_rows,
    velocity_box,
)
from tests.reference.qp import solve
from tests.reference.state import Array, State
from tests.reference.tasks import Contact, Rows, Task, rows_of

OUTWEIGHS, IDLE, FLATTEST = 1e4, 1e-6, 1e-5  # recovery by the heaviest row; least curvature
SHORT = 0.05  # m: joints recover little by shorter levers
SCALES = (1.0, 0.25, 0.0625, 0.0)  # of a step that would end inside a margin, velocity level


@dataclass(frozen=True)
class Parts:
    """What a tick is about; torque: whether it decides torques."""

    tasks: list[Task]
    contacts: list[Contact]
    limits: Limits
    pairs: list[Pair]
    dt: float
    torque: bool


def tick(model: pin.Model, q: Array, v: Array, parts: Parts) -> tuple[Array, Array | None]:
    """Return the velocity at the end of the tick (nv,), and torques (nv - 6,) at that level.

    Raises
    ------
    Unsolved
        Not everything can be kept.
    """
    state, nv, dt, torque = State(model, q, v), model.nv, parts.dt, parts.torque
    forces = sum(3 * len(one.corners) for one in parts.contacts) if torque else 0
    n = nv + forces

    # Goals: rows of tasks by level; soft contacts are of the first.
    levels = {priority: [] for priority in sorted({task.priority for task in parts.tasks})}
    for task in parts.tasks:
        levels[task.priority].append(driven(task, rows_of(state, task), v, parts))
    first, *_ = levels.values()
    equal = []
    for contact in parts.contacts:
        held = Task("held", pin.SE3(contact.rotation, contact.position), contact.frame)
        row = driven(held, rows_of(state, held), v, parts)
        if contact.soft is None:
            equal.append((row.J, row.target))
        else:
            first.append(row._replace(weight=np.sqrt(contact.soft)))

    # Safe: joint rates in a box; clearances not used up too fast; what is outside comes back.
    recovery = []
    if torque:
        lower, upper = arrival_box(state, parts.limits, dt)
    else:
        lower, upper, recovery = velocity_box(state, parts.limits, dt)
    joints = np.eye(nv)[6:]
    below = [(joints, upper), (-joints, -lower)]  # J x <= most
    if parts.pairs:
        J, least, push = margin_rows(state, parts.pairs, parts.limits, dt, torque)
        below.append((-J, -least))
        recovery = [*recovery, *push]
    heaviest = max(float(np.max(c.weight**2 * (c.J**2).sum(axis=1))) for c in first)
    weight = np.sqrt(OUTWEIGHS * max(heaviest, IDLE))
    recovery = [one._replace(weight=weight) for one in agreeing(recovery)]

    # Physics: no forces at the base, bounded torques, corner forces in their cones.
    rest, damping = np.zeros(n), np.full(n, 1e-6)
    if torque:
        unit = state.mass / dt  # N by unknown
        matrix, offset = dynamics(state, parts)  # base forces and torques = matrix x + offset
        equal.append((matrix[:6] / unit, -offset[:6] / unit))
        for sign in (1.0, -1.0):
            left = parts.limits.torque - sign * offset[6:]
            below.append((sign * matrix[6:] / unit, left / unit))
        cones = np.hstack((np.zeros((5 * forces // 3, nv)), friction(parts.contacts)))
        below.append((cones, np.zeros(len(cones))))
        rest[:nv], damping[:nv], damping[nv:] = v, 1e-3, 1e-2

    # Look ahead: where the step leads into a margin, once more with rows that are linear there.
    def solved() -> Array:
        return cascade(list(levels.values()), recovery, equal, below, damping, rest)

    x = solved()
    if parts.pairs and (cuts := cutting_planes(state, x[:nv], parts.pairs, dt)):
        below.append((-cuts[0], -cuts[1]))
        x = solved()
    if torque:
        return x[:nv], matrix[6:] @ x + offset[6:]
    for scale in SCALES:
        if not parts.pairs or cutting_planes(state, scale * x, parts.pairs, dt) is None:
            return scale * x, None
    return 0.0 * x, None


def agreeing(recovery: list[Cost]) -> list[Cost]:
    """None is asked to leave more slowly than the joints move it that recover another one."""
    if not recovery:
        return []
    J, target = (np.concatenate([one[k] for one in recovery]) for k in range(2))
    rows = np.abs(J).sum(axis=1) != 1.0  # the others are of joints
    sign = np.where(rows | (target >= 0.0), 1.0, -1.0)
    rate, joints = sign * target, sign[:, None] * J[:, 6:]
    own = np.square(joints).sum(axis=1)
    lever = np.maximum(own + SHORT**2, np.where(np.outer(rows, rows), own[:, None], 0.0))
    moved = joints @ joints.T * rate / lever
    return [Cost(J, sign * np.maximum(rate, np.where(rate > 0.0, moved, -np.inf).max(axis=1)), 1.0)]


def driven(task: Task, rows: Rows, v: Array, parts: Parts) -> Cost:
    """The law of the level: what v+ should do for an error."""
    if parts.torque:
        moving = rows.J @ v
        asked = -task.kp * rows.error - 2.0 * np.sqrt(task.kp) * (moving + rows.bias)
        return Cost(rows.J, moving + parts.dt * (asked - rows.drift), task.weight)
    target = -task.gain / parts.dt * rows.error - rows.bias
    return Cost(rows.J, target, task.weight, 0.5 * task.gain * rows.bound, rows.curvature)


def dynamics(state: State, parts: Parts) -> tuple[Array, Array]:
    """Base forces and torques by x: M (v+ - v)/dt + D v+ + h - J' F, F = f m/dt at each corner."""
    model, data, dt = state.model, state.model.createData(), parts.dt
    upper = np.triu(pin.crba(model, data, state.q))
    M = upper + np.triu(upper, 1).T
    h = pin.nonLinearEffects(model, data, state.q, state.v)
    columns = [M / dt + np.diag(model.damping)]
    for contact in parts.contacts:
        place, J, _ = state.frame(contact.frame)
        for corner in contact.corners:
            point = J[:3] - pin.skew(place.rotation @ corner) @ J[3:]
            columns.append(-state.mass / dt * point.T @ place.rotation)
    return np.hstack(columns), h - M @ state.v / dt


def friction(contacts: list[Contact]) -> Array:
    """Rows F f <= 0 for all corners: four facets of an inscribed pyramid, and a push."""
    blocks = []
    for contact in contacts:
        slope = contact.friction * np.cos(np.pi / 4)
        cone = [[1, 0, -slope], [0, 1, -slope], [-1, 0, -slope], [0, -1, -slope], [0, 0, -1]]
        blocks += [np.array(cone)] * len(contact.corners)
    return block_diag(*blocks) if blocks else np.zeros((0, 0))


def cascade(
    levels: list[list[Cost]],
    recovery: list[Cost],
    equal: list[tuple[Array, Array]],
    below: list[tuple[Array, Array]],
    damping: Array,
    rest: Array,
) -> Array:
    """Level by level the least squares that remain: what a level achieves, J x, is frozen.

    Recovery is a cost of the first level, and of no other.
    """
    n, nv = rest.size, below[0][0].shape[1]

    def wide(J: Array) -> Array:
        return np.hstack((J, np.zeros((len(J), n - J.shape[1]))))

    E, G = (
        np.concatenate([np.zeros((0, n)), *(wide(J) for J, _ in part)]) for part in (equal, below)
    )
    d, h = (np.concatenate([np.zeros(0), *(b for _, b in part)]) for part in (equal, below))
    x = np.linalg.lstsq(E, d, rcond=1e-12)[0] if d.size else np.zeros(n)
    for number, level in enumerate(levels):
        P, g = np.zeros((n, n)), -damping * rest
        for cost in level if number else [*level, *recovery]:
            J = wide(cost.J)
            P += cost.weight**2 * J.T @ J
            g -= cost.weight**2 * J.T @ cost.target
        curvature = sum(cost.curvature for cost in level)
        if np.any(curvature):
            P[:nv, :nv] = convexified(P[:nv, :nv] + curvature)
        P[range(nv), range(nv)] += sum(cost.damping for cost in level)
        x = solve(P + np.diag(damping), g, E, x, G, h)
        h = np.maximum(h, G @ x)  # what rounding left
        E = np.concatenate((E, *(wide(cost.J) for cost in level)))
    return x


def convexified(H: Array) -> Array:
    """H with its eigenvalues' sizes, none below a part of the largest."""
    values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    sizes = np.maximum(np.abs(values), FLATTEST * np.abs(values).max())
    return (vectors * sizes) @ vectors.T
