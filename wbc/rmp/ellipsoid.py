"""The equimomental ellipsoid of an inertia: its size, its axes and its reaction masses.

A uniform solid ellipsoid with semi-axes a_k along e_k has, about its centre, the second moment of
mass M/5 a_k^2 along each axis. Every inertia that a body can have is that of exactly one such
ellipsoid of given mass, and of exactly one of given density (paper 3.2). It is long where mass lies
far from the CoM, unlike the ellipsoid of inertia, and so looks like the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rotations import check_rotation
from wbc.validate import Array, check_fields, finite_array, finite_number, read_only, set_fields

# How far numbers may be off from a physical inertia, as a fraction of its largest entry or moment:
# files hold nine digits or so.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """A uniform solid ellipsoid centred at the CoM.

    Where two semi-axes are equal, their directions in that plane are arbitrary.

    Raises
    ------
    InvalidInputError
        A negative semi-axis, axes that are not a rotation matrix, or a mass that is not positive.
    """

    semi_axes: Array  # lengths a_k (3,) [m]; those computed here are the longest first
    axes: Array  # e_k as the columns of a rotation (3, 3), in the frame of the inertia
    mass: float  # [kg]

    def __post_init__(self) -> None:
        semi_axes = finite_array("ellipsoid: semi_axes", self.semi_axes, (3,))
        axes = finite_array("ellipsoid: axes", self.axes, (3, 3))
        if semi_axes.min() < 0.0:
            raise InvalidInputError(f"ellipsoid: semi_axes must not be negative, got {semi_axes}")
        check_rotation("ellipsoid: axes", axes)
        check_fields(self, "ellipsoid: ", "mass", above=0.0)
        set_fields(self, semi_axes=read_only(semi_axes), axes=read_only(axes))

    @property
    def volume(self) -> float:
        """4/3 pi a_1 a_2 a_3 [m^3]."""
        return float(4.0 / 3.0 * np.pi * np.prod(self.semi_axes))

    @property
    def principal_moments(self) -> Array:
        """Moments of inertia about the three axes (3,) [kg m^2]: M/5 (a_j^2 + a_k^2)."""
        squares = self.semi_axes**2
        return self.mass / 5.0 * (squares.sum() - squares)

    def inertia(self) -> Array:
        """Return the inertia about the centre (3, 3) [kg m^2]; inverse of :func:`equimomental`."""
        return (self.axes * self.principal_moments) @ self.axes.T


def second_moment(inertia: ArrayLike) -> Array:
    """Return the second moment of mass Sigma = tr(I)/2 1 - I (3, 3) of an inertia I [kg m^2].

    Sigma is the integral of x x^T over the mass, x from the point that I (3, 3) is about.

    Raises
    ------
    InvalidInputError
        Not (3, 3), not finite or not symmetric, or a matrix that no body can have: one principal
        moment is larger than the sum of the others.
    """
    I = finite_array("inertia", inertia, (3, 3))  # noqa: E741
    size = np.abs(I).max()
    skewness = np.abs(I - I.T).max()
    if skewness > ROUNDING * size:
        raise InvalidInputError(
            f"inertia: must be symmetric, but mirrored entries differ by {skewness:.3g} kg m^2"
        )
    I = 0.5 * (I + I.T)  # noqa: E741
    moments = np.linalg.eigvalsh(I)
    excess = moments[2] - moments[0] - moments[1]
    if excess > ROUNDING * size:
        listed = ", ".join(f"{moment:.6g}" for moment in moments)
        raise InvalidInputError(
            f"inertia: no body has the principal moments {listed} kg m^2: the largest exceeds the"
            f" sum of the others by {excess:.3g} (triangle inequality)"
        )
    return 0.5 * np.trace(I) * np.eye(3) - I


def equimomental(inertia: ArrayLike, mass: float) -> Ellipsoid:
    """Return the uniform ellipsoid of the given mass and inertia: a_k = sqrt(5 lambda_k / M).

    The inertia (3, 3) [kg m^2] is that about the CoM, M the mass [kg].

    Raises
    ------
    InvalidInputError
        Impossible inertia (see :func:`second_moment`), or a mass that is not positive.
    """
    mass = finite_number("mass", mass, above=0.0)
    along, axes = _principal(inertia)
    return Ellipsoid(np.sqrt(5.0 * along / mass), axes, mass)


def equimomental_at_density(inertia: ArrayLike, density: float) -> Ellipsoid:
    """Return the uniform ellipsoid of the given density and inertia; its mass follows (eq. 18).

    With the paper's mean density the mass comes out as the body's own only if the body fills as
    much space as its ellipsoid would; use :func:`equimomental` for an ellipsoid of the right mass.
    The inertia (3, 3) [kg m^2] is that about the CoM, the density in kg/m^3.

    Raises
    ------
    InvalidInputError
        Impossible inertia (see :func:`second_moment`), one of a flat body, whose ellipsoid has no
        volume at any mass, or a density that is not positive.
    """
    density = finite_number("density", density, above=0.0)
    along, axes = _principal(inertia)
    if along[2] <= ROUNDING * along[0]:
        raise InvalidInputError(
            "inertia: it is that of a flat body (no extent along one axis), whose ellipsoid has no"
            " volume and hence no density; use the body's mass instead"
        )
    # Eq. 18 with s_i = 2 lambda_i; the product of all three turns s_j s_k into s_i alone.
    s = 2.0 * along
    scale = (15.0 / (8.0 * np.pi * density)) ** 0.2
    semi_axes = scale * np.sqrt(s) / np.prod(s) ** 0.1
    mass = density * 4.0 / 3.0 * np.pi * float(np.prod(semi_axes))
    return Ellipsoid(semi_axes, axes, mass)


def reaction_mass_radii(inertia: ArrayLike, mass: float) -> Array:
    """Return r_k = sqrt(3 lambda_k / M) (3,) [m], in the order of :func:`equimomental`'s axes.

    Six point masses M/6 at +-r_k e_k have the body's mass, CoM and inertia: the reaction masses of
    the paper's Fig. 5.

    Raises
    ------
    InvalidInputError
        Impossible inertia (see :func:`second_moment`), or a mass that is not positive.
    """
    mass = finite_number("mass", mass, above=0.0)
    along, _ = _principal(inertia)
    return np.sqrt(3.0 * along / mass)


def _principal(inertia: ArrayLike) -> tuple[Array, Array]:
    """Return lambda (3,), largest first, and the axes as columns of a rotation (3, 3).

    The first two axes point the way of their largest component; the third completes the triad.
    """
    values, vectors = np.linalg.eigh(second_moment(inertia))
    along = np.maximum(values[::-1], 0.0)  # flat bodies: rounding leaves a small negative
    axes = np.empty((3, 3))
    for k in range(2):
        axis = vectors[:, 2 - k]
        # Rounded, so that of components that are equal but for rounding the first one decides.
        largest = int(np.argmax(np.round(np.abs(axis), 6)))
        axes[:, k] = np.copysign(1.0, axis[largest]) * axis
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return along, axes
