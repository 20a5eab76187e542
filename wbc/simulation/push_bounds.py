"""What theory says of pushes that a standing robot can absorb without a step.

All in parts of M omega d, the impulse that the ankles alone absorb if it comes at once (see
:func:`wbc.simulation.capture_impulse`):

- a push that takes time T: the CoP goes to the edge as it begins. The weighted mean of
  :mod:`wbc.rmp.balance.push_limits` then holds of cmp - F / (M omega^2), and the impulse is
  omega T / (1 - e^(-omega T)) times larger;
- a reaction mass pendulum of the robot's inertia, whose wheel has the torque of the hips and turns
  as far as the trunk may: M omega (d + reach), longer for T likewise. An estimate for a humanoid:
  its legs do not turn, its arms turn farther, and its knees and CoM's height are left out.
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
ALONG = 0.3  # cosine of the angle from which on a joint's axis does not count


class PushBounds(NamedTuple):
    """Impulses [N s] by direction (n,)."""

    angles: Array  # of the directions [rad], 0 along world x
    ankle: Array  # M omega d: at once, by the CoP
    pulse: Array  # the same for a push that takes its time
    # By CoP and reaction mass, for a push that takes its time; None: ``why_no_wheel``.
    wheel: Array | None
    omega: float  # sqrt(g / z) [1/s]
    # Inertia about x and y [kg m^2], torque [N m] about each, and angle [rad].
    reaction_mass: dict[str, Any]
    why_no_wheel: str


def pulse_factor(omega: float, duration: float) -> float:
    """Return how much more impulse is absorbed if it comes evenly within ``duration`` [s].

    omega T / (1 - e^(-omega T)): the CoP is at the edge while the push goes on, too.
    """
    x = omega * duration
    return x / -math.expm1(-x) if x > 0.0 else 1.0


def push_bounds(
    snapshot: Snapshot, feet: Iterable[str], angles: Array, duration: float, tilt: float
) -> PushBounds:
    """Return what a robot at rest on its feet absorbs, in theory.

    Parameters
    ----------
    angles:
        Directions (n,) [rad], 0 along world x.
    duration:
        Of the push [s].
    tilt:
        How far the reaction mass may turn [rad].

    Raises
    ------
    InvalidInputError
        No feet, or a CoM that is not above their soles.
    """
    from wbc.rmp.balance.push_limits import Wheel, push_limits  # loads CasADi

    feet = tuple(feet)
    robot = snapshot.robot
    along = np.column_stack((np.cos(angles), np.sin(angles)))
    inertia = np.diag(snapshot.inertia)[:2].copy()
    torque, why = np.array([hip_torque(snapshot, feet, axis) for axis in (0, 1)]), ""
    if not np.isfinite(torque).all() or torque.min() <= 0.0:
        why = "the hips have no effort limits, or do not turn about a horizontal axis"
    # One motor torque for both axes, the weaker hip's: the wheel of push_limits has one.
    wheel = Wheel(inertia, 1.0 if why else float(torque.min()), tilt)
    limits = push_limits(
        along,
        support_polygon(snapshot, feet),
        wheel,
        mass=robot.mass,
        height=com_height(snapshot, feet),
        com=snapshot.com[:2],
        gravity=robot.gravity,
    )
    longer = pulse_factor(limits.omega, duration)
    return PushBounds(
        angles=angles,
        ankle=limits.ankle,
        pulse=longer * limits.ankle,
        wheel=None if why else longer * limits.wheel,
        omega=limits.omega,
        reaction_mass={
            "inertia": inertia.tolist(), "torque": float(torque.min()), "angle": tilt
        },
        why_no_wheel=why,
    )  # fmt: skip


def hip_torque(snapshot: Snapshot, feet: Iterable[str], axis: int) -> float:
    """Return the torque about a world axis that the hips of the legs give together [N m].

    Of each leg that joint among the first three from the trunk which gives most about the axis; 0
    without any, infinite without limits.
    """
    robot = snapshot.robot
    total = 0.0
    for foot in feet:
        J = snapshot.jacobian(robot.foot(foot).frame)[3:]  # world axes, of the leg's joints only
        chain = [k for k in range(6, robot.nv) if np.abs(J[:, k]).max() > 1e-9][:HIP_JOINTS]
        effort = robot.limits.effort
        # Axes across it do not count: neither cos 90 deg times an effort without limit.
        parts = [abs(J[axis, k]) * effort[k - 6] for k in chain if abs(J[axis, k]) > ALONG]
        total += max(parts, default=0.0)
    return total


def capture_impulse(snapshot: Snapshot, feet: Iterable[str], direction: ArrayLike) -> float:
    """Return M omega d [N s]: what moves the capture point of a robot at rest to its soles' edge.

    It is the largest push through the CoM that is caught without a step and without angular
    momentum, given at once; d is the distance from the CoM's projection to the edge of the soles in
    the direction of the push, omega^2 = g / z with z the CoM's height over the soles.

    Parameters
    ----------
    feet:
        That stand.
    direction:
        (2,) or (3,), of which the part along x and y counts; its length does not.

    Raises
    ------
    InvalidInputError
        No direction along the ground, no feet, or a CoM that is not above the soles.
    """
    given = real_array("push, direction", direction)
    along = finite_array("push, direction", given, (3 if given.size == 3 else 2,))[:2]
    length = float(np.linalg.norm(along))
    if length == 0.0:
        raise InvalidInputError("push, direction: needs a part along the ground")
    feet = names_of("push, feet", feet)
    normals, offsets = half_planes(support_polygon(snapshot, feet))
    towards = normals @ (along / length)
    left = offsets - normals @ snapshot.com[:2]
    if left.min() <= 0.0:
        raise InvalidInputError(
            f"push: the CoM is {-1e3 * left.min():.3g} mm outside the soles; no impulse is caught"
        )
    d = float((left[towards > 0.0] / towards[towards > 0.0]).min())
    robot = snapshot.robot
    return robot.mass * math.sqrt(robot.gravity / com_height(snapshot, feet)) * d


def com_height(snapshot: Snapshot, feet: Iterable[str]) -> float:
    """Return the height of the CoM over the soles of feet, on average [m]."""
    soles = [snapshot.position(snapshot.robot.foot(foot).frame)[2] for foot in feet]
    return float(snapshot.com[2]) - float(np.mean(soles))
