"""Which contacts and constraints may give way, and what giving way costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wbc.constraints.contact import Contact
from wbc.constraints.rows import Bounds, Constraint
from wbc.errors import UnknownNameError
from wbc.laws import Rows
from wbc.validate import finite_number


class Softness:
    """Slack weights by the name of a contact (its frame) or constraint; all others are hard.

    A soft contact is a cost: its rows are met as well as their weight against the tasks allows. A
    soft constraint keeps its rows, each with a slack variable in the QP: as long as it is not
    overruled it is met exactly, but for (pull on the row) / weight.

    Parameters
    ----------
    weights:
        Of 1/2 slack^2, the slack in m/s or rad/s: [1/(m/s)^2] or [1/(rad/s)^2], > 0.

    Raises
    ------
    UnknownNameError
        No contact or constraint of a name.
    InvalidInputError
        A weight that is not a positive number.
    """

    def __init__(
        self,
        weights: Mapping[str, float],
        contacts: Sequence[Contact],
        constraints: Sequence[Constraint],
    ) -> None:
        known = [contact.frame for contact in contacts] + [part.name for part in constraints]
        for name in weights:
            if name not in known:
                raise UnknownNameError("contact or constraint", name, known)
        self._weights = {
            name: finite_number(f"controller, slack of {name!r}", weight, above=0.0)
            for name, weight in weights.items()
        }

    def is_hard(self, name: str) -> bool:
        """Whether a contact or constraint may not give way."""
        return name not in self._weights

    def split(self, contacts: Sequence[Contact]) -> tuple[tuple[Contact, ...], tuple[Contact, ...]]:
        """Return the hard contacts and the soft ones."""
        hard = tuple(contact for contact in contacts if self.is_hard(contact.frame))
        return hard, tuple(contact for contact in contacts if contact not in hard)

    def cost(self, contact: Contact, rows: Rows) -> Rows:
        """Return the rows of a soft contact as a cost."""
        return rows._replace(weight=np.sqrt(self._weights[contact.frame]) * rows.weight)

    def soften(self, constraint: Constraint, bounds: Bounds) -> Bounds:
        """Return a constraint's rows with their slack weights, if it is soft.

        The dominating cost that pushes out of a margin goes: it would overrule what overrules.
        """
        if self.is_hard(constraint.name):
            return bounds
        weight = self._weights[constraint.name]
        return bounds._replace(slack=np.full(bounds.lower.size, weight), push=None)
