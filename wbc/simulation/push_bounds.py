"""Theoretical bounds of the pushes that a standing robot can absorb without a step.

All in units of M omega d, the instantaneous impulse that the ankles alone absorb (see
:func:`wbc.simulation.capture_impulse`):

- a push of duration T: the CoP goes to the edge as it begins. The weighted mean of
  :mod:`wbc.rmp.balance.push_limits` then holds for cmp - F / (M omega^2), and the impulse is
  omega T / (1 - e^(-omega T)) times larger;
- a reaction mass pendulum of the robot's inertia, whose wheel has the torque of the hips and turns
  as far as the trunk may: M omega (d + reach), larger for T likewise. An estimate for a humanoid:
  its legs do not turn, its arms turn farther, and its knees and CoM's height are neglected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.polygon import half_planes
from wbc.robot import Snapshot
from wbc.validate import Array, finite_array, names_of, real_array

HIP_JOINTS = 3  # of a leg, counted from the trunk
MIN_COSINE = 0.3  # between a joint's axis and the axis of the torque, for the joint to count


class PushBounds(NamedTuple):
    """Impulses [N s] by direction (n,)."""

    angles: Array  # of the directions [rad], 0 along world x
    ankle: Array  # M omega d: instantaneous, by the CoP
    pulse: Array  # the same for a push of some duration
    # By CoP and reaction mass, for a push of some duration; None: ``why_no_wheel``.
    wheel: Array | None
    omega: float  # sqrt(g / z) [1/s]
    # Inertia about x and y [kg m^2], torque [N m] about each, and angle [rad].
    reaction_mass: dict[str, Any]
    why_no_wheel: str


def pulse_factor(omega: float, duration: float) -> float:
    """Return the factor on the impulse if its force is constant over ``duration`` [s].

    omega T / (1 - e^(-omega T)): the CoP is at the edge during the push, too.
    """
    x = omega * duration
    return x / -math.expm1(-x) if x > 0.0 else 1.0


def push_bounds(
    snapshot: Snapshot, feet: Iterable[str], angles: Array, duration: float, tilt: float
) -> PushBounds:
    """Return the bounds of a robot at rest on its feet.

    ``angles``: directions (n,) [rad], 0 along world x.
    ``duration``: of the push [s].
    ``tilt``: largest angle of the reaction mass [rad].

    Raises InvalidInputError: no feet, or a CoM that is not above their soles.
    """
    from wbc.rmp.balance.push_limits import Wheel, push_limits  # loads CasADi

    feet = tuple(feet)
    robot = snapshot.robot
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    inertia = np.diag(snapshot.inertia)[:2].copy()
    torque, why = np.array([hip_torque(snapshot, feet, axis) for axis in (0, 1)]), ""
    if not np.isfinite(torque).all() or torque.min() <= 0.0:
        why = "the hips have no effort limits, or do not turn about a horizontal axis"
    # push_limits' wheel has one torque for both axes: the smaller.
    wheel = Wheel(inertia, 1.0 if why else float(torque.min()), tilt)
    limits = push_limits(
        directions,
        support_polygon(snapshot, feet),
        wheel,
        mass=robot.mass,
        height=com_height(snapshot, feet),
        com=snapshot.com[:2],
        gravity=robot.gravity,
    )
    factor = pulse_factor(limits.omega, duration)
    return PushBounds(
        angles=angles,
        ankle=limits.ankle,
        pulse=factor * limits.ankle,
        wheel=None if why else factor * limits.wheel,
        omega=limits.omega,
        reaction_mass={
            "inertia": inertia.tolist(), "torque": float(torque.min()), "angle": tilt
        },
        why_no_wheel=why,
    )  # fmt: skip


def hip_torque(snapshot: Snapshot, feet: Iterable[str], axis: int) -> float:
    """Return the total torque of the hips about a world axis [N m].

    Of each leg the joint among the first three from the trunk with most torque about the axis; 0
    without any, infinite without limits.
    """
    robot = snapshot.robot
    total = 0.0
    for foot in feet:
        J = snapshot.jacobian(robot.foot(foot).frame)[3:]  # world axes, of the leg's joints only
        chain = [k for k in range(6, robot.nv) if np.abs(J[:, k]).max() > 1e-9][:HIP_JOINTS]
        effort = robot.limits.effort
        # Orthogonal axes do not count: 0 times an infinite effort is NaN.
        parts = [abs(J[axis, k]) * effort[k - 6] for k in chain if abs(J[axis, k]) > MIN_COSINE]
        total += max(parts, default=0.0)
    return total


def capture_impulse(snapshot: Snapshot, feet: Iterable[str], direction: ArrayLike) -> float:
    """Return M omega d [N s], which moves the capture point of a robot at rest to its soles' edge.

    It is the largest instantaneous push through the CoM that is absorbed without a step and without
    angular momentum; d is the distance from the CoM's projection to the edge of the soles in the
    direction of the push, omega^2 = g / z with z the CoM's height over the soles.

    Parameters
    ----------
    feet:
        In contact.
    direction:
        (2,) or (3,), projected onto x and y; of any length.

    Raises
    ------
    InvalidInputError
        No direction along the ground, no feet, or a CoM that is not above the soles.
    """
    given = real_array("push, direction", direction)
    horizontal = finite_array("push, direction", given, (3 if given.size == 3 else 2,))[:2]
    length = float(np.linalg.norm(horizontal))
    if length == 0.0:
        raise InvalidInputError("push, direction: needs a part along the ground")
    feet = names_of("push, feet", feet)
    normals, offsets = half_planes(support_polygon(snapshot, feet))
    towards = normals @ (horizontal / length)
    slack = offsets - normals @ snapshot.com[:2]
    if slack.min() <= 0.0:
        raise InvalidInputError(
            f"push: the CoM is {-1e3 * slack.min():.3g} mm outside the soles; no impulse is caught"
        )
    d = float((slack[towards > 0.0] / towards[towards > 0.0]).min())
    robot = snapshot.robot
    return robot.mass * math.sqrt(robot.gravity / com_height(snapshot, feet)) * d


def com_height(snapshot: Snapshot, feet: Iterable[str]) -> float:
    """Return the CoM's height over the mean height of the soles [m]; InvalidInputError below."""
    soles = [snapshot.position(snapshot.robot.foot(foot).frame)[2] for foot in feet]
    height = float(snapshot.com[2]) - float(np.mean(soles))
    if height <= 0.0:
        raise InvalidInputError(f"push: the CoM is {-1e3 * height:.3g} mm below the soles")
    return height
