"""A plan as targets over time for a robot's tasks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from wbc.kinds import check_kind, switch
from wbc.robot import Snapshot
from wbc.robot.model import check_snapshot
from wbc.rotations import rotations_from
from wbc.spatial import COLUMNS, ROWS, skews, vech
from wbc.tracking.plan_check import check_plan
from wbc.validate import Array, finite_array, finite_number, names_of, real_array

if TYPE_CHECKING:  # plans load CasADi
    from wbc.rmp.plan.plan import Plan, Trajectory

STEP = 1e-3  # s between samples of a plan
DOUBLE = ("left", "right")


@dataclass(frozen=True, eq=False)
class PlanTarget:
    """Targets of a plan at one time, or at n times; world axes.

    Rates and accelerations are zero before the plan begins and after it ends.
    """

    com: Array  # c (..., 3) [m]
    com_velocity: Array  # (..., 3) [m/s]
    com_acceleration: Array  # (..., 3) [m/s^2]
    momentum: Array  # (..., 6) linear [kg m/s], then angular about the CoM [kg m^2/s]
    momentum_rate: Array  # (..., 6) [N, N m]
    cop: Array  # (..., 3) [m], on the ground z = 0
    inertia: Array  # vech (..., 6): xx xy xz yy yz zz [kg m^2]
    inertia_rate: Array  # (..., 6) [kg m^2/s]
    inertia_acceleration: Array  # (..., 6) [kg m^2/s^2]


class PlanReference:
    """Follows a plan over time, from ``begins`` on; checks that the plan is for this robot.

    ``target = reference.at(time)`` in every tick has the targets of a controller's tasks::

        com.set_target(target.com, target.com_velocity, target.com_acceleration)
        spin.set_target(target.momentum, target.momentum_rate)
        shape.set_target(target.inertia, target.inertia_rate, target.inertia_acceleration)
        cop.set_target(target.cop)

    Before the plan begins the targets are those of ``start``, at rest; the plan may begin
    elsewhere, such as where a push leaves the robot. After its end they are its last ones, at rest.
    The plan is sampled every millisecond, and interpolated linearly. In a flight there is no CoP:
    its target is interpolated.

    Parameters
    ----------
    start:
        The robot at rest, where it stands; see :func:`wbc.tracking.plan_check.check_plan`.
    feet:
        Those that stand, all the time except in flights.
    begins:
        When the plan begins [s].
    flights:
        Whether feet leave the ground in the plan's flights and return to their places, which is up
        to the caller. Otherwise a plan with a flight is refused.

    Raises
    ------
    PlanMismatchError
        A plan for another robot, place or soles, or with a flight without ``flights``.
    InvalidInputError
        Soles that are not on the ground, or a time that is negative.
    UnknownNameError
        The robot has no such foot.
    """

    followed: ClassVar[str] = "plan"

    def __init__(
        self,
        plan: Plan,
        start: Snapshot,
        *,
        feet: Iterable[str] = DOUBLE,
        begins: float = 0.0,
        flights: bool = False,
    ) -> None:
        from wbc.rmp.plan.plan import Plan  # a plan needs CasADi

        check_kind("plan reference, plan", plan, Plan, "load_plan(path)")
        check_snapshot("plan reference, start", start)
        feet, flights = names_of("plan reference, feet", feet), switch("flights", flights)
        check_plan(plan, start, feet, flights=flights)
        self.plan = plan
        self.begins = finite_number("plan reference, begins", begins, least=0.0)
        count = max(int(np.ceil(plan.duration / STEP)), 1)
        below = np.array((*start.com[:2], 0.0))
        self._before = {"com": start.com, "cop": below, "inertia": vech(start.inertia)}
        self._times = np.linspace(0.0, plan.duration, count + 1)
        self._table = _table(plan.at(self._times), plan.problem.mass)

    @property
    def ends(self) -> float:
        """When the plan ends [s]."""
        return self.begins + self.plan.duration

    def at(self, time: float | ArrayLike) -> PlanTarget:
        """Return the targets at a time [s], or at times (n,).

        Raises
        ------
        InvalidInputError
            A time that is not finite.
        """
        what = "plan reference, time"
        t, found = interpolated(what, time, self.begins, self._times, self._table)
        before, active = (t < 0.0)[..., None], (t <= self.plan.duration)[..., None]
        if before.any():
            for name, values in found.items():
                found[name] = np.where(before, self._before.get(name, 0.0), values)
        for name in found.keys() - self._before.keys():
            found[name] = found[name] * active
        return PlanTarget(**found)


def interpolated(
    what: str, time: float | ArrayLike, begins: float, times: Array, table: PlanTarget
) -> tuple[Array, dict[str, Array]]:
    """Return times since ``begins`` [s], and there all targets of a table at even ``times``."""
    given = real_array(what, time)
    t = finite_array(what, given, given.shape) - begins
    place = np.clip(t / times[1], 0.0, len(times) - 1.0)
    k = np.minimum(place.astype(int), len(times) - 2)
    after = (place - k)[..., None]
    before = 1.0 - after
    return t, {name: before * one[k] + after * one[k + 1] for name, one in vars(table).items()}


def _table(motion: Trajectory, mass: float) -> PlanTarget:
    inertia, rate, acceleration = inertia_motion(motion, mass)
    return PlanTarget(
        com=motion.com,
        com_velocity=motion.com_velocity,
        com_acceleration=motion.com_acceleration,
        momentum=np.hstack((mass * motion.com_velocity, motion.momentum)),
        momentum_rate=np.hstack((mass * motion.com_acceleration, motion.momentum_rate)),
        cop=cop_on_ground(motion.cop, motion.com, motion.time),
        inertia=inertia,
        inertia_rate=rate,
        inertia_acceleration=acceleration,
    )


def cop_on_ground(cop: Array, com: Array, time: Array) -> Array:
    """Return the CoP (n, 3) of (n, 2), at z = 0, linearly interpolated where there is none.

    Without any, in a motion that is all flight, it is below the CoM (n, 3).
    """
    known = np.isfinite(cop).all(axis=1)
    if not known.any():
        cop, known = com[:, :2], ~known
    columns = [np.interp(time, time[known], one[known]) for one in cop.T]
    return np.column_stack((*columns, np.zeros(len(cop))))


def inertia_motion(motion: Trajectory, mass: float) -> tuple[Array, Array, Array]:
    """Return vech (n, 6) of the masses' inertia R D R', world axes, and its two derivatives.

    With w the body rate and X = D' + [w]x D - D [w]x they are R X R' and
    R (X' + [w]x X - X [w]x) R'; w' is that of Euler's equation.
    """
    R = rotations_from(motion.orientation)
    w = np.einsum("nji,nj->ni", R, motion.angular_velocity)
    torque = np.einsum("nji,nj->ni", R, motion.momentum_rate)
    r, rate, acceleration = motion.radii, motion.radii_rates, motion.radii_accelerations
    # I_i = M/3 (r_j^2 + r_k^2)
    D, D_rate, D_acceleration = (
        mass / 3.0 * (squares.sum(axis=1)[:, None] - squares)
        for squares in (r**2, 2.0 * r * rate, 2.0 * (rate**2 + r * acceleration))
    )
    w_rate = (torque - D_rate * w - np.cross(w, D * w)) / D
    W, W_rate = skews(w), skews(w_rate)
    D, D_rate, D_acceleration = (one[:, :, None] * np.eye(3) for one in (D, D_rate, D_acceleration))
    X = D_rate + W @ D - D @ W
    X_rate = D_acceleration + W_rate @ D + W @ D_rate - D_rate @ W - D @ W_rate
    R_T = R.transpose(0, 2, 1)
    inertia, first, second = (
        (R @ one @ R_T)[:, ROWS, COLUMNS] for one in (D, X, X_rate + W @ X - X @ W)
    )
    return inertia, first, second
