"""A humanoid reduced to its reaction mass pendulum: leg, ellipsoid and the ground's push (paper 3).

World axes, SI units. The ground is flat, with normal +z.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.com_support import support_polygon
from wbc.errors import InvalidInputError
from wbc.kinds import check_kind
from wbc.polygon import polygon_margin
from wbc.rmp.axes import GAP, SAME_AXIS, are_distinct, follow, turning_rate
from wbc.rmp.ellipsoid import Ellipsoid, equimomental, equimomental_at_density
from wbc.rmp.ground import (
    Wrench,
    centre_of_pressure,
    centroidal_moment_pivot,
    in_contact,
    leg_of,
    normal_moment,
    total_wrench,
)
from wbc.robot import Snapshot
from wbc.robot.model import check_snapshot
from wbc.spatial import vech_inverse
from wbc.validate import Array, Bools, finite_number, finite_vector


@dataclass(frozen=True, eq=False)
class RmpState:
    """The reaction mass pendulum of a robot at one instant; made by :func:`reduce`.

    Angular momentum is about the CoM. CoP, CMP, leg and the moment about the normal are None in
    flight (see :func:`~wbc.rmp.ground.in_contact`). ``quasi_static`` is true if neither
    acceleration nor wrenches were given: ``momentum_rate`` is then zero, and the CoP the CoM's
    projection.

    The leg's direction n is (cos theta cos phi, sin phi, sin theta cos phi): upright is (pi/2, 0),
    and theta at phi = 0 is the paper's in the x-z plane. A leg along the y axis, flat on the
    ground, has no such angles.

    Reaction masses M/6 are at +-r_k e_k, in the order and with the signs nearest to the previous
    state's, if one was given. Where second moments are too close to call, axes are not defined:
    such axes are the previous state's, turned as little as possible, not a property of the robot.
    """

    mass: float  # M [kg]
    com: Array  # (3,) [m]
    com_velocity: Array  # (3,) [m/s]
    momentum: Array  # centroidal (6,): linear [kg m/s], angular k_G [kg m^2/s]
    momentum_rate: Array  # (6,) [N, N m]; angular: the moment of the ground's push about the CoM
    quasi_static: bool
    ground_force: Array  # f_r = M (c'' - g) (3,) [N]; negative z: only a ground that pulls gives it
    ground_moment: float | None  # n . m_r [N m], about the normal through the CoP
    cop: Array | None  # (3,) [m], on the ground; never clipped
    cmp: Array | None  # (3,) [m], on the ground
    support_polygon: Array | None  # corners (k, 2) [m], counter-clockwise; None if no feet named
    cop_margin: float | None  # how far the CoP is inside it [m]; None without CoP or polygon
    leg_length: float | None  # r_l, from CoP to CoM [m]
    leg_direction: Array | None  # unit vector n (3,)
    leg_angles: Array | None  # (theta, phi) [rad]
    inertia: Array  # centroidal CRB inertia (3, 3) [kg m^2]
    ellipsoid: Ellipsoid  # equimomental, of mass M, the longest semi-axis first
    ellipsoid_at_density: Ellipsoid | None  # of the given density (eq. 18), if one was
    radii: Array  # r_k (3,) [m]
    axes: Array  # e_k as columns (3, 3)
    axes_defined: Bools  # (3,)
    average_angular_velocity: Array  # of the momentum: I^-1 k_G (3,) [rad/s]
    axes_angular_velocity: Array | None  # at which the axes turn (3,) [rad/s]; None if undefined

    def __repr__(self) -> str:
        com = np.array2string(self.com, precision=3)
        where = (
            "in the air" if self.cop is None else f"cop={np.array2string(self.cop, precision=3)}"
        )
        return f"RmpState({self.mass:.2f} kg, com={com}, {where})"

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @property
    def flight(self) -> bool:
        """True if the ground does not push."""
        return self.cop is None

    @property
    def cop_inside(self) -> bool | None:
        """False if the CoP is outside the support polygon: the motion is infeasible."""
        return None if self.cop_margin is None else self.cop_margin >= 0.0


def reduce(
    snapshot: Snapshot,
    acceleration: ArrayLike | None = None,
    *,
    feet: Iterable[str] | None = None,
    wrenches: Iterable[Wrench] | None = None,
    density: float | None = None,
    previous: RmpState | None = None,
    ground_height: float = 0.0,
    gap: float = GAP,
) -> RmpState:
    """Return the reaction mass pendulum of a robot.

    The ground's push comes from ``acceleration``, with gravity and the ground the only forces; or
    from measured ``wrenches``; or, with neither, it is quasi-static: inertial forces are left out,
    those of v too (give zeros for these).

    Parameters
    ----------
    acceleration:
        Rate of v (nv,): base linear and angular acceleration in base axes, joint accelerations.
    feet:
        Feet that stand, for the support polygon. Without them the CoP is not judged.
    wrenches:
        Pairs (position (3,), wrench (6,)) of all contacts: force [N] and moment [N m] about that
        position that act on the robot, world axes. Empty in flight.
    density:
        Density [kg/m^3] for ``ellipsoid_at_density``.
    previous:
        The state before, which the order and signs of the axes follow.
    ground_height:
        Height of the ground [m].
    gap:
        Axes with second moments closer than this fraction of the largest are undefined.

    Raises
    ------
    InvalidInputError
        Numbers of a wrong shape or not finite, a density or gap that is not positive, both
        acceleration and wrenches, no feet, or a CoM that is at the CoP.
    UnknownNameError
        A foot that the robot does not have.
    """
    check_snapshot("reduce", snapshot)
    height = finite_number("ground_height", ground_height)
    gap = finite_number("gap", gap, above=0.0)
    momentum_rate = _momentum_rate(snapshot, acceleration, wrenches)
    polygon = None if feet is None else support_polygon(snapshot, feet)
    mass, inertia = snapshot.robot.mass, snapshot.inertia
    force = momentum_rate[:3] - mass * snapshot.robot.model.gravity.linear
    cop, cmp, moment = _pivots(snapshot, force, momentum_rate[3:], height)
    margin = None
    if cop is not None and polygon is not None:
        margin = float(polygon_margin(polygon, cop[:2]))
    length, direction, angles = _leg(snapshot.com, cop)
    ellipsoid = equimomental(inertia, mass)
    dense = None if density is None else equimomental_at_density(inertia, density)
    check_kind("reduce, previous", previous, RmpState, "wbc.reduce(...)", or_none=True)
    radii, axes, defined = _reaction_masses(ellipsoid, inertia, previous, gap)
    return RmpState(
        mass=mass,
        com=snapshot.com,
        com_velocity=snapshot.com_velocity,
        momentum=snapshot.momentum,
        momentum_rate=momentum_rate,
        quasi_static=acceleration is None and wrenches is None,
        ground_force=force,
        ground_moment=moment,
        cop=cop,
        cmp=cmp,
        support_polygon=polygon,
        cop_margin=margin,
        leg_length=length,
        leg_direction=direction,
        leg_angles=angles,
        inertia=inertia,
        ellipsoid=ellipsoid,
        ellipsoid_at_density=dense,
        radii=radii,
        axes=axes,
        axes_defined=defined,
        average_angular_velocity=snapshot.average_angular_velocity,
        axes_angular_velocity=_axes_rate(snapshot, axes) if defined.all() else None,
    )


def _momentum_rate(
    snapshot: Snapshot, acceleration: ArrayLike | None, wrenches: Iterable[Wrench] | None
) -> Array:
    """Return the rate of the centroidal momentum (6,) [N, N m]."""
    if acceleration is not None and wrenches is not None:
        raise InvalidInputError(
            "acceleration and wrenches both tell the ground's push; give one of them"
        )
    if acceleration is not None:
        a = finite_vector("acceleration", acceleration, snapshot.robot.nv)
        return np.asarray(snapshot.centroidal_map @ a + snapshot.momentum_drift)
    if wrenches is None:
        return np.zeros(6)
    force, moment = total_wrench(wrenches, snapshot.com)
    weight = snapshot.robot.mass * snapshot.robot.model.gravity.linear
    return np.concatenate((force + weight, moment))


def _pivots(
    snapshot: Snapshot, force: Array, moment: Array, height: float
) -> tuple[Array | None, Array | None, float | None]:
    """Return CoP, CMP and n . m_r, or three None in flight."""
    if not in_contact(force, snapshot.robot.weight):
        return None, None, None
    com = snapshot.com
    cop = centre_of_pressure(com, force, moment, height)
    cmp = centroidal_moment_pivot(com, force, height)
    return cop, cmp, float(normal_moment(com, force, moment, cop))


def _leg(com: Array, cop: Array | None) -> tuple[float | None, Array | None, Array | None]:
    """Return the leg's length, direction (3,) and angles (2,)."""
    if cop is None:
        return None, None, None
    length, direction, angles = leg_of(com, cop)
    return float(length), direction, None if np.isnan(angles).any() else angles


def _reaction_masses(
    ellipsoid: Ellipsoid, inertia: Array, previous: RmpState | None, gap: float
) -> tuple[Array, Array, Bools]:
    """Return radii (3,), axes (3, 3) and which of them are defined (3,)."""
    squares = ellipsoid.semi_axes**2
    known = are_distinct(squares, gap)
    if previous is None:
        return np.sqrt(0.6 * squares), ellipsoid.axes, known
    axes = follow(ellipsoid.axes, squares, previous.axes, gap)
    about = np.diagonal(axes.T @ inertia @ axes)
    along = np.maximum(0.5 * about.sum() - about, 0.0)
    # A tracked axis is defined if it is (up to sign) one of the defined axes of the ellipsoid.
    shared = np.square(axes.T @ ellipsoid.axes) @ known
    return np.sqrt(3.0 * along / ellipsoid.mass), axes, shared > 1.0 - SAME_AXIS


def _axes_rate(snapshot: Snapshot, axes: Array) -> Array:
    inertia_rate = vech_inverse(snapshot.inertia_jacobian @ snapshot.v)
    return turning_rate(snapshot.inertia, inertia_rate, axes)
