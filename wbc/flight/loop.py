"""Closed paths of joints: Fourier series, smooth all round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.validate import Array


def harmonics(phase: Array, count: int, derivative: int = 0) -> Array:
    """Return (n, 2 count): cos(h p) - 1 and sin(h p) at phases (n,), or a derivative by p.

    What is zero at p = 0 makes a path begin where it is asked to.
    """
    h = np.arange(1, count + 1)
    angle = np.outer(phase, h) + 0.5 * np.pi * derivative
    start = 1.0 if derivative == 0 else 0.0
    factor = h.astype(float) ** derivative
    return np.hstack((factor * np.cos(angle) - start, factor * np.sin(angle)))


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed path of joints, gone round once while its phase goes from 0 to 2 pi.

    Attributes
    ----------
    start:
        (k,) joints at phase 0 [rad or m].
    coefficients:
        (2 h, k) of :func:`harmonics`.
    """

    start: Array
    coefficients: Array

    def at(self, phase: Array, derivative: int = 0) -> Array:
        """Return the joints (n, k) at phases (n,), or a derivative by the phase."""
        count = len(self.coefficients) // 2
        found = harmonics(np.atleast_1d(phase), count, derivative) @ self.coefficients
        return found + self.start if derivative == 0 else found
