"""Joint limits, one entry for each joint velocity."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError
from wbc.validate import Array, finite_number, read_only

# Anything this large stands for no limit: exporters write 1e16, 1e30, FLT_MAX and DBL_MAX.
UNLIMITED = 1e10
BASE_NQ, BASE_NV = 7, 6  # coordinates and velocities of the free-flyer, always first


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the actuated joints, in velocity order: entry k belongs to ``v[6 + k]``.

    Attributes
    ----------
    names:
        Joint names (nv-6).
    lower, upper:
        Position limits (nv-6,) [rad or m]; infinite for a continuous joint or if missing.
    velocity:
        Largest speed (nv-6,) [rad/s or m/s]; infinite if missing (0 in a file means missing).
    effort:
        Largest torque or force (nv-6,) [N m or N]; infinite if missing, likewise.
    missing:
        Every limit that a joint lacks, such as ``"left_knee: velocity"``. A continuous joint
        lacks no position limit.
    starts:
        Index in q of each joint's first coordinate (nv-6).
    unbounded:
        Entries of the continuous joints, which q stores as (cos, sin).
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    missing: tuple[str, ...]
    starts: tuple[int, ...]
    unbounded: tuple[int, ...]

    def __post_init__(self) -> None:
        for array in (self.lower, self.upper, self.velocity, self.effort):
            read_only(array)

    def __repr__(self) -> str:
        return f"JointLimits({len(self.names)} joints, {len(self.missing)} missing)"

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))

    @classmethod
    def of(cls, model: pin.Model) -> JointLimits:
        """Return the limits of a model of which every joint but the root has one velocity.

        Joints that have more (not supported, see :mod:`wbc.robot.model_checks`) are left out.
        """
        joints = [j for j in range(2, model.njoints) if model.nvs[j] == 1]
        starts = [int(model.idx_qs[j]) for j in joints]
        rates = [int(model.idx_vs[j]) for j in joints]
        names = tuple(str(model.names[j]) for j in joints)
        unbounded = tuple(k for k, j in enumerate(joints) if model.nqs[j] == 2)
        lower = _infinite_from(model.lowerPositionLimit[starts])
        upper = _infinite_from(model.upperPositionLimit[starts])
        lower[list(unbounded)], upper[list(unbounded)] = -np.inf, np.inf
        velocity = _positive(model.velocityLimit[rates])
        effort = _positive(model.effortLimit[rates])
        bounded = np.isfinite(lower) & np.isfinite(upper)
        bounded[list(unbounded)] = True
        given = (bounded, np.isfinite(velocity), np.isfinite(effort))
        missing = tuple(
            f"{name}: {what}"
            for k, name in enumerate(names)
            for what, there in zip(("position", "velocity", "effort"), given, strict=True)
            if not there[k]
        )
        return cls(names, lower, upper, velocity, effort, missing, tuple(starts), unbounded)

    @property
    def without_effort(self) -> tuple[str, ...]:
        """Joints whose largest torque or force is not known, in order."""
        return tuple(self.names[k] for k in np.flatnonzero(np.isinf(self.effort)))

    def joint_positions(self, q: Array) -> Array:
        """Return joint positions (..., nv-6) held in ``q`` (..., nq); angles of continuous joints.

        Without continuous joints this is a view of ``q``.
        """
        if not self.unbounded:
            return q[..., BASE_NQ:]
        positions = q[..., list(self.starts)]
        for k in self.unbounded:
            start = self.starts[k]
            positions[..., k] = np.arctan2(q[..., start + 1], q[..., start])
        return positions

    def past(self, positions: Array) -> Array:
        """Return how far joint positions (..., nv-6) are past their limits [rad or m].

        Negative inside; NaN compares as inside.
        """
        return np.fmax(self.lower - positions, positions - self.upper)

    def write_positions(self, q: Array, positions: Array) -> None:
        """Write joint positions (nv-6,) [rad or m] into ``q`` (nq,), whatever their limits."""
        if not self.unbounded:
            q[BASE_NQ:] = positions
            return
        q[list(self.starts)] = positions
        for k in self.unbounded:
            start = self.starts[k]
            q[start : start + 2] = np.cos(positions[k]), np.sin(positions[k])

    def set_joint(self, q: Array, name: str, value: float) -> None:
        """Write the value of one joint [rad or m] into ``q`` (nq,).

        Raises
        ------
        InvalidInputError
            Not finite, or outside the joint's limits by more than rounding.
        """
        value = finite_number(f"joint {name!r}", value)
        k = self.names.index(name)
        lower, upper = float(self.lower[k]), float(self.upper[k])
        if not lower - 1e-6 <= value <= upper + 1e-6:  # files round limits and postures to 6 digits
            raise InvalidInputError(
                f"joint {name!r}: {value:g} is outside its limits [{lower:g}, {upper:g}]"
            )
        start = self.starts[k]
        if k in self.unbounded:
            q[start : start + 2] = np.cos(value), np.sin(value)
        else:
            q[start] = self.nearest(k, value)

    def nearest(self, k: int, value: float) -> float:
        """Return the value [rad or m] nearest to ``value`` in the range of entry ``k``."""
        return min(max(value, float(self.lower[k])), float(self.upper[k]))

    def clamped(self, q: Array) -> Array:
        """Return a copy of ``q`` (nq,) with every bounded joint at the nearest value in range."""
        q, starts = q.copy(), list(self.starts)
        q[starts] = np.clip(q[starts], self.lower, self.upper)  # no bound where there is no limit
        return q


def _infinite_from(values: Array) -> Array:
    """Return a copy in which the parsers' various "no limit" numbers are infinite."""
    return np.where(np.abs(values) >= UNLIMITED, np.copysign(np.inf, values), values)


def _positive(values: Array) -> Array:
    return np.where((values > 0.0) & (values < UNLIMITED), values, np.inf)
