"""The plan of a controller: unknowns, priority levels and row names, which ticks have in common.

A :class:`Plan` is made once for each set of tasks and contacts; a tick then only fills in numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.constraints.contact import ContactRows
from wbc.constraints.independent_rows import independent_rows
from wbc.constraints.limits import BASE_ROWS
from wbc.constraints.rows import Bounds
from wbc.controllers.dynamics import TickDynamics
from wbc.controllers.slack import Slacks, with_slack
from wbc.laws import Rows, stacked
from wbc.qp.problem import QP, Labels
from wbc.robot import Robot
from wbc.tasks.task import Task
from wbc.validate import Array, read_only

# Curvatures below this fraction of the largest are raised to it: steps stay finite in flat valleys.
FLATTEST = 1e-5
# Recovery from outside a limit or margin outweighs the tasks by this factor (in the squared cost).
RECOVERY_FACTOR = 1e2
# Least squared weight assumed for the heaviest row, for when all tasks are switched off: recovery
# then outweighs the usual damping, 1e-6, by the factor above.
IDLE = 1e-6


@dataclass(frozen=True, eq=False)
class Decision:
    """The unknowns x (n,) of a tick: the velocity v+ at its end, then what a level adds.

    The velocity level has v+ alone; a torque level has contact forces behind it. Rows may have nv
    columns or n: those on v+ are written once for both levels.

    Attributes
    ----------
    names:
        (n,), a bound is named after its unknown.
    nv:
        How many of them are v+.
    damping:
        (n,) weights of 1/2 x^2 in the cost; they make the optimum unique.
    lower, upper:
        (n - nv,) bounds on what is behind v+.
    """

    names: tuple[str, ...]
    nv: int
    damping: Array
    lower: Array
    upper: Array

    @classmethod
    def velocity(cls, robot: Robot, damping: Array) -> Decision:
        """Return the unknowns of the velocity level."""
        none = read_only(np.zeros(0))
        return cls(BASE_ROWS + robot.joint_names, robot.nv, damping, none, none)

    def extended(
        self, names: Sequence[str], lower: Array, upper: Array, damping: Array
    ) -> Decision:
        """Return these unknowns and further ones (m,) behind them."""
        return Decision(
            self.names + tuple(names),
            self.nv,
            np.concatenate((self.damping, damping)),
            np.concatenate((self.lower, lower)),
            np.concatenate((self.upper, upper)),
        )

    @cached_property
    def size(self) -> int:
        """How many unknowns there are, n."""
        return len(self.names)

    @cached_property
    def no_rows(self) -> Bounds:
        """No inequality rows on these unknowns."""
        none = read_only(np.zeros(0))
        return Bounds((), read_only(np.zeros((0, self.size))), none, none)


class Physics(NamedTuple):
    """What ties the unknowns behind v+ to it at one snapshot: nothing at the velocity level.

    Attributes
    ----------
    equalities:
        Rows (k, n) met exactly, in the order of their names in the plan.
    bounds:
        Inequality rows (m, n), such as friction cones; None for none.
    forces:
        Rows of the tasks about forces, in the order of the plan.
    rest:
        (n,) what the damping of the unknowns pulls towards; None for zero.
    dynamics:
        What forces and torques are by the unknowns, at the torque level.
    """

    equalities: Sequence[Rows] = ()
    bounds: Bounds | None = None
    forces: Sequence[Rows] = ()
    rest: Array | None = None
    dynamics: TickDynamics | None = None


NO_PHYSICS = Physics()


@dataclass(frozen=True, eq=False)
class Plan:
    """The levels of a controller.

    Attributes
    ----------
    held:
        The contacts that are met exactly.
    soft:
        Those that may give way: costs of the first level, behind the tasks.
    levels:
        Indices of each level's costs among the tasks, the soft contacts, then the tasks about
        forces.
    labels:
        Of each level's QP; those of inequality rows come with the rows.
    workspace:
        Names the set of contacts: solvers keep a warm start for each.
    """

    decision: Decision
    held: ContactRows
    soft: tuple[Task, ...]
    levels: tuple[tuple[int, ...], ...]
    labels: tuple[Labels, ...]
    workspace: tuple[object, ...]

    @classmethod
    def of(
        cls,
        decision: Decision,
        tasks: Sequence[Task],
        contacts: Sequence[Task],
        slacks: Slacks,
        physics: tuple[str, ...] = (),
        forces: Sequence[Task] = (),
    ) -> Plan:
        """Return the plan; ``physics`` names the equality rows that a level puts before contacts.

        ``forces`` are the tasks about forces.

        A level's QP keeps what the levels above achieve: its equality rows are the first level's,
        then the rows of the tasks above that have weight.
        """
        hard, soft = slacks.split(contacts)
        held = independent_rows(hard)
        levels = _levels(tasks, soft, forces)
        equality = physics + held.labels
        labels = [Labels(equality, (), decision.names)]
        costs = (*tasks, *soft, *forces)
        for level in levels[:-1]:
            equality += tuple(
                f"{costs[k].name} {row}"
                for k in level
                for row, weight in zip(costs[k].rows, costs[k].weight, strict=True)
                if weight > 0.0
            )
            labels.append(Labels(equality, (), decision.names))
        workspace = tuple(contact.name for contact in contacts), held.labels
        return cls(decision, held, soft, levels, tuple(labels), workspace)


def by_priority(tasks: Sequence[Task]) -> tuple[tuple[int, ...], ...]:
    """Return the indices of the tasks of each level, the most important level first."""
    return tuple(
        tuple(k for k, task in enumerate(tasks) if task.priority == priority)
        for priority in sorted({task.priority for task in tasks})
    )


def _levels(
    tasks: Sequence[Task], soft: Sequence[Task], forces: Sequence[Task]
) -> tuple[tuple[int, ...], ...]:
    """Return the indices of each level; soft contacts, behind the tasks, are of the first."""
    count = len(tasks)
    first, *lower = (
        tuple(k if k < count else k + len(soft) for k in level)
        for level in by_priority([*tasks, *forces])
    )
    return (*first, *range(count, count + len(soft))), *lower


def assemble(
    decision: Decision,
    costs: Sequence[Rows],
    equalities: Sequence[Rows],
    box: tuple[Array, Array],
    bounds: Bounds | None,
    labels: Labels,
    rest: Array | None = None,
) -> QP:
    """Return a level's QP: costs squared and added, equalities, inequality rows and the box.

    Parameters
    ----------
    costs:
        Rows met in the weighted least-squares sense, with their own damping.
    equalities:
        Rows met exactly; their weights are not used.
    box:
        Bounds (nv,), (nv,) on the velocity.
    bounds:
        Inequality rows, or None for none.
    labels:
        Names; those of the inequality rows are taken from ``bounds``.
    rest:
        (n,) what the decision's damping pulls towards; None for zero.
    """
    n, nv = decision.damping.size, decision.nv
    lower, upper = box
    if n > nv:
        lower = np.concatenate((lower, decision.lower))
        upper = np.concatenate((upper, decision.upper))
    P, g = _cost(decision, costs)
    none = decision.no_rows
    A, b = none.matrix, none.lower
    if equalities:
        matrices, targets = [], []
        for rows in equalities:
            matrices.append(rows.matrix)
            targets.append(rows.target)
        A, b = stacked(matrices, n), np.concatenate(targets)
    if bounds is None:
        bounds = none
    else:
        labels = Labels(labels.equality, bounds.labels, labels.variables)
    C = bounds.matrix if bounds.matrix.shape[1] == n else stacked([bounds.matrix], n)
    if rest is not None:
        g -= decision.damping * rest
    qp = QP(P, g, A, b, C, bounds.lower, bounds.upper, lower, upper, labels)
    return qp if bounds.slack is None else with_slack(qp, bounds.slack)


def _cost(decision: Decision, costs: Sequence[Rows]) -> tuple[Array, Array]:
    """Return P (n, n) and g (n,): rows met in the weighted least-squares sense, and damping."""
    matrices, targets, weights, curved, single = [], [], [], [], []
    damping: float | Array = 0.0
    n, nv = decision.damping.size, decision.nv
    width = nv  # of the columns that any row has
    for rows in costs:
        damping = damping + rows.damping  # not in place: a law's array is the law's
        if rows.curvature is not None:
            curved.append(rows.curvature)
        if rows.columns is not None:
            single.append(rows)
            continue
        width = max(width, rows.matrix.shape[1])
        matrices.append(rows.matrix)
        targets.append(rows.target)
        weights.append(rows.weight)
    if matrices:  # stacked: one product is cheaper than one per task
        J, square = stacked(matrices, width), np.concatenate(weights)
        square *= square
        weighted = square[:, None] * J
        # Not the product of an array with itself: NumPy takes twice as long for one that small.
        P = J.T.dot(weighted)
        g = np.concatenate(targets).dot(weighted)
        np.negative(g, out=g)
        if width < n:
            P, g = _widened(P, g, n)
    else:
        P, g = np.zeros((n, n)), np.zeros(n)
    diagonal = P.reshape(-1)[:: n + 1]
    for rows in single:  # of the identity
        square = rows.weight * rows.weight
        diagonal[rows.columns] += square
        square *= rows.target
        g[rows.columns] -= square
    if curved:
        P[:nv, :nv] = convexified(P[:nv, :nv] + sum(curved))
    diagonal += decision.damping
    if n > nv:
        diagonal = diagonal[:nv]
    diagonal += damping
    return P, g


def _widened(P: Array, g: Array, n: int) -> tuple[Array, Array]:
    """Return a cost with further unknowns (n in all), of which it says nothing."""
    wide, slope, width = np.zeros((n, n)), np.zeros(n), g.size
    wide[:width, :width] = P
    slope[:width] = g
    return wide, slope


class Assembled(NamedTuple):
    """The QP of a level without inequality rows, and the largest square of a weighted row of it."""

    qp: QP
    heaviest: float

    def bounded(self, bounds: Bounds | None, box: tuple[Array, Array]) -> QP:
        """Return the QP with inequality rows and a box on v+, as :func:`assemble` would."""
        qp, nv = self.qp, box[0].size
        lower, upper = box
        if nv < qp.g.size:
            lower = np.concatenate((lower, qp.lower[nv:]))
            upper = np.concatenate((upper, qp.upper[nv:]))
        if bounds is None:
            return qp._replace(lower=lower, upper=upper)
        P, g = qp.P, qp.g
        if bounds.push is not None:
            push = outweighing(bounds.push, self.heaviest)
            J = stacked([push.weight[:, None] * push.matrix], g.size)
            P, g = P + J.T @ J, g - (push.weight * push.target) @ J
        labels = Labels(qp.labels.equality, bounds.labels, qp.labels.variables)
        rows = stacked([bounds.matrix], g.size), bounds.lower, bounds.upper
        qp = QP(P, g, qp.A, qp.b, *rows, lower, upper, labels)
        return qp if bounds.slack is None else with_slack(qp, bounds.slack)


def outweighing(rows: Rows, heaviest: float) -> Rows:
    """Return rows with a weight that no other row, of square ``heaviest`` at most, matches."""
    weight = math.sqrt(RECOVERY_FACTOR * max(heaviest, IDLE))
    return rows._replace(weight=weight * rows.weight)


def convexified(H: Array) -> Array:
    """Return the nearest thing to H (n, n) that a QP can use: its eigenvalues made positive.

    Taking their absolute values keeps the Newton step where H is convex and leaves a saddle by the
    direction of negative curvature at the same scale (Dauphin et al. 2014, "saddle-free Newton").
    """
    values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    sizes = np.abs(values)
    np.maximum(sizes, FLATTEST * sizes.max(), out=sizes)
    half = vectors * np.sqrt(sizes)
    return half @ half.T
