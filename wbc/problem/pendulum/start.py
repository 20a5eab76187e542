"""Where a pendulum starts: from words of the file to configuration and velocity."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.problem.mistakes import Misplaced
from wbc.problem.pendulum.start_specs import PendulumStartSpec
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array


def planar_start(spec: PendulumStartSpec, model: PlanarRmp) -> tuple[Array, Array]:
    """Return (q, v) of a planar pendulum.

    Raises
    ------
    Misplaced
        What only a solid pendulum has, or neither or both of inertia and radii.
    """
    for name in ("phi", "rpy"):
        if name in spec.model_fields_set:
            raise Misplaced("only a solid pendulum (rmp_solid) has this", "start", name)
    if "phi" in spec.rates.model_fields_set:
        raise Misplaced("only a solid pendulum (rmp_solid) has this", "start", "rates", "phi")
    key, sizes = _masses(spec)
    size = _one(sizes, key)
    r = math.sqrt(size / model.mass) if key == "inertia" else size
    spin = _one(spec.rates.spin, "rates", "spin")
    q = np.array((0.0, spec.theta, spec.leg_length, spec.alpha, r))
    return q, np.array((0.0, spec.rates.theta, spec.rates.leg, spin, 0.0))


def solid_start(spec: PendulumStartSpec, model: SolidRmp) -> tuple[Array, Array]:
    """Return (q, v) of a solid pendulum.

    Raises
    ------
    Misplaced
        What only a planar pendulum has, neither or both of inertia and radii, or moments of inertia
        that no masses have.
    """
    if "alpha" in spec.model_fields_set:
        raise Misplaced("only a planar pendulum has this; a solid one has rpy", "start", "alpha")
    key, sizes = _masses(spec)
    three = _three(sizes, key)
    radii = _radii(three, model.mass) if key == "inertia" else three
    quaternion = Rotation.from_euler("xyz", spec.rpy).as_quat()  # x y z w; about fixed axes
    spin = np.zeros(3) if spec.rates.spin == 0.0 else _three(spec.rates.spin, "rates", "spin")
    q = np.concatenate(((0.0, 0.0, spec.theta, spec.phi, spec.leg_length), quaternion, radii))
    rates = (0.0, 0.0, spec.rates.theta, spec.rates.phi, spec.rates.leg)
    return q, np.concatenate((rates, spin, np.zeros(3)))


def _masses(spec: PendulumStartSpec) -> tuple[str, float | tuple[float, ...]]:
    given = {"inertia": spec.inertia, "radii": spec.radii}
    found = {key: value for key, value in given.items() if value is not None}
    if len(found) != 1:
        raise Misplaced("give inertia or radii, and only one of them", "start")
    return next(iter(found.items()))


def _one(value: float | tuple[float, ...], *where: str) -> float:
    if isinstance(value, tuple):
        raise Misplaced("a planar pendulum needs one number here", "start", *where)
    return float(value)


def _three(value: float | tuple[float, ...], *where: str) -> Array:
    if not isinstance(value, tuple):
        raise Misplaced("a solid pendulum needs three numbers here", "start", *where)
    return np.array(value)


def _radii(moments: Array, mass: float) -> Array:
    """Return r_k (3,) with (M/3) (r_i^2 + r_j^2) the moments of inertia (3,)."""
    squares = 3.0 * (0.5 * moments.sum() - moments) / mass
    if squares.min() < 0.0:
        k = int(squares.argmin())
        raise Misplaced(
            f"no mass has these moments: {moments[k]:g} is more than the sum of the other two",
            "start",
            "inertia",
        )
    return np.asarray(np.sqrt(squares))
