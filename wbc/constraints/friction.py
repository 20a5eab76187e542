"""Friction: a linearised cone at each point of a contact, and a range of normal force."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError
from wbc.kinds import check_switches, whole_number
from wbc.validate import Array, check_fields, set_fields

MOST_FACETS = 64


@dataclass(frozen=True, slots=True)
class FrictionCone:
    """A linearised friction cone: forces push, and slide by no more than friction allows.

    Attributes
    ----------
    coefficient:
        Friction coefficient mu, > 0: tangential force over normal force.
    facets:
        Of the pyramid that stands for the cone, at least 3.
    inner:
        Whether the pyramid is inscribed in the cone, so that every force in it is inside the true
        cone; otherwise it is circumscribed.
    least, most:
        Range of the contact's whole normal force [N]. ``least`` keeps a foot loaded; it is relaxed
        where it cannot be met.
    """

    coefficient: float = 0.6
    facets: int = 4
    inner: bool = True
    least: float = 0.0
    most: float = math.inf

    def __post_init__(self) -> None:
        check_fields(self, "friction, ", "coefficient", above=0.0)
        check_fields(self, "friction, ", "least", least=0.0)
        check_switches(self, "friction, ", "inner")
        facets = whole_number("friction, facets", self.facets, least=3, most=MOST_FACETS)
        set_fields(self, facets=facets)
        check_fields(self, "friction, ", "most", unlimited=True)
        if self.most < self.least:
            raise InvalidInputError(
                f"friction, most: {self.most} is below the least normal force {self.least:g}"
            )

    def matrix(self) -> Array:
        """Return A (facets, 3) with A f <= 0 for allowed forces f, the normal along z."""
        angles = 2.0 * math.pi * np.arange(self.facets) / self.facets
        slope = self.coefficient * (math.cos(math.pi / self.facets) if self.inner else 1.0)
        return np.stack((np.cos(angles), np.sin(angles), np.full(self.facets, -slope)), axis=1)

    def excess(self, force: Array) -> float:
        """Return by how much a force (3,) leaves the exact cone [N]; negative inside."""
        return math.hypot(force[0], force[1]) - self.coefficient * float(force[2])
