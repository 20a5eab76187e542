"""Slack: contacts and constraints that may give way, and its cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from wbc.constraints.rows import Bounds, Constraint
from wbc.errors import InvalidInputError, UnknownNameError, shown
from wbc.qp.problem import QP, Labels
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number

# What the name of a slack variable begins with; the name of its row follows.
SLACK_OF = "slack of "
# A slack below this [m/s] is what solvers leave.
NEGLIGIBLE = 1e-7
NO_SLACK: Mapping[str, float] = MappingProxyType({})


class Slacks:
    """Slack weights by the name of a contact (its frame) or constraint; all others are hard.

    A soft contact is a cost: its rows are met as well as their weight against the tasks allows. A
    soft constraint keeps its rows, each with a slack variable in the QP: as long as it is not
    overruled it is met exactly, but for (gradient along the row) / weight. Both are of the first
    priority level: tasks of those below may not overrule them further.

    ``weights``: of 1/2 slack^2, the slack in m/s or rad/s: [1/(m/s)^2] or [1/(rad/s)^2], > 0.
    ``leaving``: the same for contacts that are being released.

    Raises UnknownNameError: no contact or constraint of a name; InvalidInputError: no mapping, a
    weight that is not a positive number, or a name that several have.
    """

    def __init__(
        self,
        weights: Mapping[str, float],
        contacts: Sequence[Task],
        constraints: Sequence[Constraint],
        leaving: Mapping[str, float] = NO_SLACK,
    ) -> None:
        if not isinstance(weights, Mapping):
            raise InvalidInputError(
                f"controller, slack: expected weights by name, got {shown(weights)}"
            )
        known = [contact.name for contact in contacts] + [part.name for part in constraints]
        for name in weights:
            if name not in known:
                raise UnknownNameError("contact or constraint", name, known)
            if known.count(name) > 1:
                raise InvalidInputError(
                    f"controller, slack: {known.count(name)} contacts and constraints are called"
                    f" {name!r}; tell them apart: constraint.name = ..."
                )
        own = {
            name: finite_number(f"controller, slack of {name!r}", weight, above=0.0)
            for name, weight in weights.items()
        }
        self.weights: Mapping[str, float] = {**leaving, **own}

    def is_hard(self, name: str) -> bool:
        """Whether a contact or constraint may not give way."""
        return name not in self.weights

    def split(self, contacts: Sequence[Task]) -> tuple[tuple[Task, ...], tuple[Task, ...]]:
        """Return the hard contacts and the soft ones."""
        hard = tuple(contact for contact in contacts if self.is_hard(contact.name))
        return hard, tuple(contact for contact in contacts if contact not in hard)

    def soften(self, constraint: Constraint, bounds: Bounds) -> Bounds:
        """Return a constraint's rows with their slack weights, if it is soft.

        The cost that recovers a margin is dropped: it would outweigh the tasks that may overrule.
        """
        if self.is_hard(constraint.name):
            return bounds
        weight = self.weights[constraint.name]
        return bounds._replace(slack=np.full(bounds.lower.size, weight), push=None)


class SlackQP(NamedTuple):
    """A QP with soft inequality rows, whose slacks are not among its unknowns."""

    slackless: QP
    weights: Array | None  # (mi,) of the slacks, infinite for hard rows; None: all rows are hard

    @property
    def qp(self) -> QP:
        """The QP with its slacks as unknowns, made at each access."""
        return self.slackless if self.weights is None else with_slack(self.slackless, self.weights)

    def slack_of(self, x: Array) -> dict[str, float]:
        """Return the slack of each row that has some, by name; ``x`` has the slacks at its end."""
        if self.weights is None:
            return {}
        slack, names = x[self.slackless.g.size :], self.slackless.labels.inequality
        rows = np.flatnonzero(np.isfinite(self.weights))
        nonzero = np.flatnonzero(np.abs(slack) > NEGLIGIBLE)
        return {names[rows[k]]: float(slack[k]) for k in nonzero.tolist()}


def with_slack(qp: QP, weights: Array) -> QP:
    """Return the QP with a slack variable for each inequality row that may give way.

    ``l <= C x - s <= u`` at the cost of 1/2 weight s^2. The slacks are unknowns behind x, named
    after their rows.

    ``weights``: (mi,), infinite for rows that may not give way.
    """
    soft = np.flatnonzero(np.isfinite(weights))
    n, k = qp.g.size, soft.size
    P = np.zeros((n + k, n + k))
    P[:n, :n] = qp.P
    P.flat[n * (n + k + 1) :: n + k + 1] = weights[soft]
    give = np.zeros((qp.u.size, k))
    give[soft, np.arange(k)] = -1.0
    free = np.full(k, np.inf)
    names = tuple(f"{SLACK_OF}{qp.labels.inequality[row]}" for row in soft)
    return QP(
        P=P,
        g=np.concatenate((qp.g, np.zeros(k))),
        A=np.concatenate((qp.A, np.zeros((qp.b.size, k))), axis=1),
        b=qp.b,
        C=np.concatenate((qp.C, give), axis=1),
        l=qp.l,
        u=qp.u,
        lower=np.concatenate((qp.lower, -free)),
        upper=np.concatenate((qp.upper, free)),
        labels=Labels(qp.labels.equality, qp.labels.inequality, qp.labels.variables + names),
    )
