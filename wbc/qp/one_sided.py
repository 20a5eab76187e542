"""The rows of a QP as G x <= h, and multipliers of such rows back in two-sided form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.qp.problem import QP
from wbc.validate import Array

Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class OneSided:
    """Finite ends only: upper ends of C, lower ends of C, then the same of the box.

    ``box_upper`` and ``box_lower`` are empty when the solver takes the box as it is.
    """

    G: Array  # (m, n)
    h: Array  # (m,)
    upper: Index
    lower: Index
    box_upper: Index
    box_lower: Index

    @classmethod
    def of(cls, qp: QP, keep_box: bool) -> OneSided:
        """Return the one-sided rows of ``qp``, with rows for its box unless ``keep_box``."""
        upper, lower = np.flatnonzero(np.isfinite(qp.u)), np.flatnonzero(np.isfinite(qp.l))
        G, h = [qp.C[upper], -qp.C[lower]], [qp.u[upper], -qp.l[lower]]
        box_upper = box_lower = np.zeros(0, dtype=np.intp)
        if not keep_box:
            box_upper = np.flatnonzero(np.isfinite(qp.upper))
            box_lower = np.flatnonzero(np.isfinite(qp.lower))
            unit = np.eye(qp.g.size)
            G += [unit[box_upper], -unit[box_lower]]
            h += [qp.upper[box_upper], -qp.lower[box_lower]]
        return cls(np.concatenate(G), np.concatenate(h), upper, lower, box_upper, box_lower)

    def two_sided(self, qp: QP, multipliers: Array) -> tuple[Array, Array]:
        """Return z (mi,) and z_box (n,) for multipliers (m,) >= 0 of ``G x <= h``."""
        z, z_box = np.zeros(qp.u.size), np.zeros(qp.g.size)
        parts = (self.upper, self.lower, self.box_upper, self.box_lower)
        up, low, box_up, box_low = np.split(multipliers, np.cumsum([p.size for p in parts[:3]]))
        z[self.upper] += up
        z[self.lower] -= low
        z_box[self.box_upper] += box_up
        z_box[self.box_lower] -= box_low
        return z, z_box
