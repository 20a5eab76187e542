"""A standing motion as targets over time, for tasks that follow it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from wbc.errors import InvalidInputError
from wbc.polygon import inset, nearest_point
from wbc.retargeting.cop_correction import com_displacement, required_cop
from wbc.retargeting.ground_forces import ground_forces
from wbc.retargeting.standing import StandingMotion
from wbc.robot.limits import BASE_NQ
from wbc.robot.series import centroidal_series, rates
from wbc.rotations import same_sign
from wbc.spatial import COLUMNS, ROWS
from wbc.tracking.deviation import Unbalanced
from wbc.tracking.reference import PlanTarget, cop_on_ground, interpolated
from wbc.validate import Array, finite_number, read_only

STEP = 1e-3  # s between samples
BEGINS, EASE = 0.3, 0.5  # s
CHECKED_EVERY = 10  # samples, for what cannot be balanced
FRICTION = 0.6


@dataclass(frozen=True, eq=False)
class MotionTarget(PlanTarget):
    """Targets of a motion at one time, or at n times: those of a plan, and the posture."""

    q: Array  # (..., nq)
    v: Array  # (..., nv)
    acceleration: Array  # (..., nv)


class MotionReference:
    """Follows a standing motion over time; ``target = reference.at(time)`` in every tick.

    Tasks take targets as from a plan (:class:`wbc.PlanReference`), and also::

        posture.set_target(target.q, target.v, target.acceleration)

    A recording begins and ends in the middle of a motion: here its time is eased in from rest and
    out to rest. Before and after, targets are those of its first and last configuration.

    Parameters
    ----------
    motion:
        Of :meth:`StandingMotion.of <wbc.retargeting.standing.StandingMotion.of>` or ``read``.
    begins:
        When it begins [s].
    ease:
        Time [s] in which it reaches its own speed, and in which it comes to rest; each prolongs it
        by half of that. A shorter motion is eased throughout.
    slower:
        Factor on its time, at least 1.
    lean:
        The CoM is displaced so that the CoP is at least this far inside the soles [m]; None: the
        motion as it is.
    friction:
        Coefficient, for ``unbalanced``.

    Attributes
    ----------
    led:
        Largest displacement of the CoM [m], with ``lean``.

    Raises
    ------
    InvalidInputError
        Numbers out of range, or soles too small for ``lean``.
    """

    followed: ClassVar[str] = "motion"

    def __init__(
        self,
        motion: StandingMotion,
        *,
        begins: float = BEGINS,
        ease: float = EASE,
        slower: float = 1.0,
        lean: float | None = None,
        friction: float = FRICTION,
    ) -> None:
        what = "motion reference"
        self.motion = motion
        self.begins = finite_number(f"{what}, begins", begins, least=0.0)
        self.slower = finite_number(f"{what}, slower", slower, least=1.0)
        length = float(motion.time[-1]) * self.slower
        self.ease = min(finite_number(f"{what}, ease", ease, above=0.0), length)
        self.duration = length + self.ease
        self.lean = None if lean is None else finite_number(f"{what}, lean", lean, least=0.0)
        self.friction = finite_number(f"{what}, friction", friction, above=0.0)
        count = int(np.ceil(self.duration / STEP))
        self._times = read_only(np.linspace(0.0, self.duration, count + 1))
        self.led = 0.0
        self._target = self._sampled()

    @property
    def ends(self) -> float:
        """When it has come to rest [s]."""
        return self.begins + self.duration

    def at(self, time: float | ArrayLike) -> MotionTarget:
        """Return the targets at a time [s], or at times (n,).

        Raises
        ------
        InvalidInputError
            A time that is not finite.
        """
        what = "motion reference, time"
        _, found = interpolated(what, time, self.begins, self._times, self._target)
        quaternion = found["q"][..., 3:BASE_NQ]
        quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
        return MotionTarget(**found)

    @cached_property
    def unbalanced(self) -> tuple[Unbalanced, ...]:
        """Where the motion, eased but without ``lean``, cannot be balanced, and why."""
        rows, robot = slice(None, None, CHECKED_EVERY), self.motion.robot
        q, v, acceleration = (
            one[rows] for one in (self._target.q, self._target.v, self._target.acceleration)
        )
        whole = centroidal_series(robot, q, v, acceleration)
        time, supports = self.begins + self._times[rows], self.motion.stands(q)
        found = ground_forces(robot, q, v, acceleration, whole, time, supports, self.friction)
        return found.unbalanced

    def _sampled(self) -> MotionTarget:
        motion, robot, dt = self.motion, self.motion.robot, float(self._times[1])
        q = _interpolated(motion, self._motion_time())
        v, acceleration = rates(robot, q, dt)
        v[[0, -1]] = acceleration[[0, -1]] = 0.0
        whole = centroidal_series(robot, q, v, acceleration)
        m, k_rate = robot.mass, whole.momentum_rate[:, 3:]
        com, com_velocity = whole.com, whole.momentum[:, :3] / m
        com_acceleration = whole.momentum_rate[:, :3] / m
        cop, time_constant_sq = required_cop(com, k_rate, m, robot.gravity, dt)
        if self.lean is not None:
            e = com_displacement(self._feasible_cop(cop) - cop, time_constant_sq, dt)
            e = np.column_stack((e, np.zeros(len(e))))
            self.led = float(np.linalg.norm(e, axis=1).max())
            e_rate = np.gradient(e, dt, axis=0)
            com, com_velocity = com + e, com_velocity + e_rate
            com_acceleration = com_acceleration + np.gradient(e_rate, dt, axis=0)
            cop = self._feasible_cop(cop)
        inertia, inertia_rate = (
            one[:, ROWS, COLUMNS] for one in (whole.inertia, whole.inertia_rate)
        )
        return MotionTarget(
            com=com,
            com_velocity=com_velocity,
            com_acceleration=com_acceleration,
            momentum=np.hstack((m * com_velocity, whole.momentum[:, 3:])),
            momentum_rate=np.hstack((m * com_acceleration, k_rate)),
            cop=cop_on_ground(cop, com, np.arange(float(len(cop)))),
            inertia=inertia,
            inertia_rate=inertia_rate,
            inertia_acceleration=np.gradient(inertia_rate, dt, axis=0),
            q=q,
            v=v,
            acceleration=acceleration,
        )

    def _motion_time(self) -> Array:
        """Return the motion's own time (n,) [s] at the samples: its rate is eased in and out."""

        def integral(u: Array) -> Array:  # of minimum_jerk from 0 to u
            return u**4 * (2.5 + u * (u - 3.0))

        t, ease, length = self._times, self.ease, self.duration - self.ease
        elapsed = ease * integral(np.minimum(t / ease, 1.0))
        remaining = ease * integral(np.minimum((self.duration - t) / ease, 1.0))
        late = np.where(t > length, length - remaining, t - 0.5 * ease)
        return np.clip(np.where(t < ease, elapsed, late) / self.slower, 0.0, self.motion.time[-1])

    def _feasible_cop(self, cop: Array) -> Array:
        """Return the nearest CoP (n, 2) at least ``lean`` inside the soles; NaN stays."""
        (support, *_) = self.motion.stands(self.motion.q[:1])
        return nearest_point(inset(support.polygon, self.lean or 0.0), cop)


@dataclass(frozen=True, eq=False)
class FrameRotation:
    """Rotation of a frame over a motion, with rates in the rotating axes."""

    reference: MotionReference
    frame: str

    @property
    def duration(self) -> float:
        """When it is at rest at its end [s]."""
        return self.reference.ends

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return rotation (3, 3), angular velocity and acceleration (3,) at ``t`` [s]."""
        target = self.reference.at(t)
        snapshot = self.reference.motion.robot.snapshot(target.q, target.v)
        R, J = snapshot.rotation(self.frame), snapshot.jacobian(self.frame)[3:]
        alpha = J @ target.acceleration + snapshot.drift(self.frame)[3:]
        return R, R.T @ (J @ target.v), R.T @ alpha


def _interpolated(motion: StandingMotion, times: Array) -> Array:
    """Return configurations (m, nq) at times of the motion (m,) [s], twice differentiable."""
    robot, time = motion.robot, motion.time
    if robot.limits.unbounded:
        raise InvalidInputError(
            f"motion reference: {robot.name} has continuous joints, which are not followed"
        )
    found = np.empty((len(times), robot.nq))
    found[:, :3] = CubicSpline(time, motion.q[:, :3])(times)
    rotations = RotationSpline(time, Rotation.from_quat(motion.q[:, 3:BASE_NQ]))
    found[:, 3:BASE_NQ] = same_sign(rotations(times).as_quat())
    found[:, BASE_NQ:] = CubicSpline(time, motion.q[:, BASE_NQ:])(times)
    return found
