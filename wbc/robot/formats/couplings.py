"""Couplings between joints, and loops between frames, besides the kinematic tree."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.polynomial import Polynomial

DEGREE = 4  # of a polynomial by which a joint follows another one


@dataclass(frozen=True)
class Coupling:
    """A joint that follows another one: ``ratio * driver + offset`` [rad or m].

    ``curved`` are the coefficients of driver^2, driver^3 and driver^4 that are added.
    """

    driver: str
    ratio: float = 1.0
    offset: float = 0.0
    curved: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_linear(self) -> bool:
        """Whether there are no higher powers."""
        return not any(self.curved)

    @property
    def polynomial(self) -> Polynomial:
        """Of the driver's position."""
        return Polynomial((self.offset, self.ratio, *self.curved))

    def value(self, driver: float) -> float:
        """Return where the joint is by its driver's position [rad or m]."""
        if self.is_linear:
            return self.ratio * driver + self.offset
        return float(self.polynomial(driver))

    def slope(self, driver: float) -> float:
        """Return the derivative of :meth:`value`."""
        return self.ratio if self.is_linear else float(self.polynomial.deriv()(driver))

    @property
    def is_constant(self) -> bool:
        """Whether it follows no joint: it is held at ``offset``."""
        return not self.driver

    def inverse(self, joint: str) -> Coupling | None:
        """Return how the driver follows ``joint`` if that follows it by a plain ratio, or None."""
        if not self.driver or not self.is_linear or self.ratio == 0.0:
            return None
        return Coupling(joint, 1.0 / self.ratio, -self.offset / self.ratio)

    def after(self, step: Coupling) -> Coupling | None:
        """Return what follows ``step``'s driver if this one follows ``step``'s joint.

        None: of higher degree than 4.
        """
        if self.is_linear and step.is_linear:
            ratio, offset = self.ratio * step.ratio, self.ratio * step.offset + self.offset
            return Coupling(step.driver, ratio, offset)
        powers = self.polynomial(step.polynomial).trim().coef.tolist()
        if len(powers) > DEGREE + 1:
            return None
        p = (*powers, *(0.0,) * (DEGREE + 1 - len(powers)))
        return Coupling(step.driver, p[1], p[0], (p[2], p[3], p[4]))


@dataclass(frozen=True)
class Loop:
    """Two frames of a robot, on different bodies, that are one.

    Attributes
    ----------
    frames:
        The one that is held, and the one that it is held at, by their names.
    kind:
        ``"point"``, the default: their origins meet (a ball joint); ``"pose"``: their axes too (a
        weld).
    """

    frames: tuple[str, str]
    kind: str = "point"
