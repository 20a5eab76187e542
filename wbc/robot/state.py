"""Everything known about the robot at one measured state (q, v), read-only.

World-aligned quantities unless a frame is named; spatial vectors linear first. Quantities are
computed when first asked for and kept; none changes when another snapshot is made. All come from
one pass of the compiled core, which loading checks against Pinocchio.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.native import lib
from wbc.robot.kernel import NativeState
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.names import BASE, COM, WORLD
from wbc.robot.parallel_axis import (
    is_com,
    moving_frame,
    parallel_axis,
    parallel_axis_hessian,
    parallel_axis_rates,
)
from wbc.robot.tree import KinematicTree
from wbc.spatial import commutator_matrix, congruence, skew, vech
from wbc.validate import Array, finite_array, read_only

POSE: int = lib.FRAME_JACOBIAN  # numbers of a frame before its Jacobian

if TYPE_CHECKING:
    lazy = cached_property
else:

    class lazy(cached_property):
        """A ``cached_property`` without the lock, which Python 3.12 has dropped: 0.1 us for 0.8."""

        def __get__(self, instance: Any, owner: object = None) -> Any:
            if instance is None:
                return self
            value = instance.__dict__[self.attrname] = self.func(instance)
            return value


class KinematicState:
    """A robot at configuration ``q`` moving at velocity ``v``; see :class:`wbc.Snapshot`.

    Attributes
    ----------
    robot:
        Whose state it is.
    """

    robot: KinematicTree

    def __init__(self, robot: KinematicTree, q: Array, v: Array) -> None:
        own = self.__dict__  # past __setattr__, which would take as long as all the rest
        own.update(robot=robot, q=q, v=v, _placements={}, _jacobians={})
        own["_sealed"] = True

    @classmethod
    def of_measured(cls, robot: KinematicTree, measured: bytes) -> Self:
        """Return the state of a checked configuration with a velocity behind it: the core's way."""
        state = object.__new__(cls)
        own = state.__dict__
        own["robot"], own["measured"], own["_sealed"] = robot, measured, True
        return state

    def __setattr__(self, name: str, value: object) -> None:
        if "_sealed" in self.__dict__:  # properties keep what they computed without passing here
            raise InvalidInputError(
                f"snapshot: {name!r} cannot be assigned, a snapshot is what was measured; take "
                "another one of the configuration you mean"
            )
        object.__setattr__(self, name, value)

    def __getstate__(self) -> dict[str, object]:  # what the core found is found again
        return {
            k: v for k, v in self.__dict__.items() if k not in ("native_state", "native_motion")
        }

    def __repr__(self) -> str:
        com = np.array2string(self.com, precision=3)
        return f"{type(self).__name__}({self.robot.name}, com={com})"

    @lazy
    def measured(self) -> bytes:
        """The bytes of q, and of v behind it."""
        return self.q.tobytes() + self.v.tobytes()

    @lazy
    def q(self) -> Array:
        """Configuration (nq,): base position [m], base quaternion xyzw, joints [rad or m]."""
        return np.frombuffer(self.measured, count=self.robot.nq)  # read-only, as bytes are

    @lazy
    def v(self) -> Array:
        """Velocity (nv,): base linear and angular in base axes, joint rates; 0 if none given."""
        return np.frombuffer(self.measured, offset=8 * self.robot.nq)

    @lazy
    def _placements(self) -> dict[str, tuple[Array, Array]]:
        """Those that were asked for, by frame."""
        return {}

    @lazy
    def _jacobians(self) -> dict[str, Array]:
        """Likewise."""
        return {}

    @lazy
    def native_state(self) -> NativeState:
        """All that a tick asks for, from one pass of the core."""
        return self.robot.native.evaluate(self.measured)

    @lazy
    def joint_positions(self) -> Array:
        """Positions (nv-6,) of the joints [rad or m]; angles of continuous joints."""
        limits = self.robot.limits  # read in every tick: no call unless it is needed
        return limits.joint_positions(self.q) if limits.unbounded else self.q[BASE_NQ:]

    # ------------------------------------------------------------------ momentum and CoM

    @lazy
    def com(self) -> Array:
        """CoM (3,) in the world [m]."""
        return self.native_state.copied("com")

    @lazy
    def centroidal_map(self) -> Array:
        """Centroidal momentum matrix A_g (6, nv): ``momentum == centroidal_map @ v``."""
        return self.native_state.part("centroidal_map", 6, -1)

    @lazy
    def momentum(self) -> Array:
        """Centroidal momentum (6,): linear [kg m/s], angular about the CoM [kg m^2/s]."""
        return self.native_state.copied("momentum")

    @lazy
    def com_jacobian(self) -> Array:
        """CoM Jacobian (3, nv) [m per unit of v]; paper eq. 28 divided by the mass."""
        return self.native_state.part("com_jacobian", 3, -1)

    @lazy
    def com_velocity(self) -> Array:
        """Velocity of the CoM (3,) [m/s]."""
        return read_only(self.momentum[:3] / self.robot.mass)

    @lazy
    def average_angular_velocity(self) -> Array:
        """I_c^-1 k_c (3,) [rad/s]: of the momentum, not of the ellipsoid's axes (theory 3)."""
        return read_only(np.linalg.solve(self.inertia, self.momentum[3:]))

    # ------------------------------------------------------------------ inertia

    @lazy
    def inertia(self) -> Array:
        """Centroidal CRB inertia (3, 3) [kg m^2], world axes."""
        return self.native_state.copied("inertia").reshape(3, 3)

    def inertia_in(self, frame: str = WORLD, about: str | ArrayLike = COM) -> Array:
        """CRB inertia (3, 3) [kg m^2] in axes of ``world``, ``base`` or a named frame.

        Parameters
        ----------
        about:
            The point that it is taken about: ``"com"``, ``"world"`` for the world's origin (the
            paper's spatial frame), a frame for that frame's origin, which moves with the robot, or
            a point (3,) fixed in the world [m].
        """
        total = self.inertia
        if not is_com(about):
            total = read_only(total + parallel_axis(self.robot.mass, self.arm(about)))
        if isinstance(frame, str) and frame == WORLD:
            return total
        R = self.rotation(frame)
        return read_only(R.T @ total @ R)

    def arm(self, about: str | ArrayLike) -> Array:
        """From the point that :meth:`inertia_in` is taken ``about`` to the CoM (3,), world [m]."""
        if is_com(about):
            return np.zeros(3)
        if isinstance(about, str):
            return self.com if about == WORLD else self.com - self.position(about)
        return self.com - finite_array("snapshot, about", about, (3,))

    def arm_jacobian(self, about: str | ArrayLike) -> Array:
        """Jacobian (3, nv) of :meth:`arm` [m per unit of v]."""
        if is_com(about):
            return np.zeros((3, self.robot.nv))
        frame, J = moving_frame(about), self.com_jacobian
        return J if frame is None else J - self.jacobian(frame)[:3]

    def inertia_about(self, frame: str) -> Array:
        """Spatial CRB inertia (6, 6) about the origin of a frame and in its axes, linear first.

        Paper eq. 12 for the base; blocks [[M 1, -M [c]], [M [c], I - M [c]^2]], c the CoM there.
        """
        R, p = self.rotation(frame), self.position(frame)
        arm = skew(R.T @ (self.com - p))
        M = self.robot.mass
        spatial = np.empty((6, 6))
        spatial[:3, :3] = M * np.eye(3)
        spatial[:3, 3:] = -M * arm
        spatial[3:, :3] = M * arm
        spatial[3:, 3:] = R.T @ self.inertia @ R - M * arm @ arm
        return read_only(spatial)

    @lazy
    def base_inertia_jacobian(self) -> Array:
        """Derivative d vech(I_base)/dv (6, nv), base axes; its base columns are zero."""
        J = congruence(self.rotation(BASE).T) @ self.inertia_jacobian
        J[:, :BASE_NV] = 0.0
        return read_only(J)

    @lazy
    def inertia_jacobian(self) -> Array:
        """Derivative d vech(I)/dv (6, nv), world axes; xx, xy, xz, yy, yz, zz (eqs. 24-27)."""
        return self.native_state.part("inertia_jacobian", 6, -1)

    def inertia_jacobian_in(self, frame: str = WORLD, about: str | ArrayLike = COM) -> Array:
        """Jacobian (6, nv) of :meth:`inertia_in` for the same ``frame`` and ``about``."""
        centroidal = is_com(about)
        if frame == BASE and centroidal:
            return self.base_inertia_jacobian
        J = self.inertia_jacobian
        if not centroidal:
            by_arm = parallel_axis_rates(self.robot.mass, self.arm(about))
            J = read_only(J + by_arm @ self.arm_jacobian(about))
        if frame == WORLD:
            return J
        R = self.rotation(frame)
        spin = commutator_matrix(self.inertia_in(WORLD, about)) @ self.jacobian(frame)[3:]
        return read_only(congruence(R.T) @ (J - spin))

    def spatial_inertia_entries(self, about: str | ArrayLike = WORLD) -> Array:
        """Entries (9,) of the spatial CRB inertia: xx xy xz yy yz zz, then mass times the arm.

        World axes, ``about`` as in :meth:`inertia_in`, [kg m^2] above [kg m]: the vector of paper
        5.1, about the spatial frame's origin unless another point is named.
        """
        arm = self.arm(about)
        return read_only(
            np.concatenate((vech(self.inertia_in(WORLD, about)), self.robot.mass * arm))
        )

    def spatial_inertia_jacobian(self, about: str | ArrayLike = WORLD) -> Array:
        """CRB inertia Jacobian J_I (9, nv) of :meth:`spatial_inertia_entries` (eqs. 24-28).

        Columns are by v, the base's first: J_I,0 and J_I,q of eq. 25. Eqs. 26 and 27 as corrected
        in the errata; the last three rows are J_G of eq. 28.
        """
        of_arm = self.robot.mass * self.arm_jacobian(about)
        return read_only(np.concatenate((self.inertia_jacobian_in(WORLD, about), of_arm)))

    def inertia_hessian(self, weights: Array, about: str | ArrayLike = COM) -> Array:
        """Second derivative (nv, nv) by v of sum_ab weights_ab I_ab, world axes.

        ``weights`` is a symmetric (3, 3) matrix; times the error of an inertia task this is what
        Gauss-Newton leaves out.
        """
        weights, mass = finite_array("weights", weights, (3, 3)), self.robot.mass
        hessian = self.native_state.inertia_hessian(weights, mass)
        if not is_com(about):
            arm, of_arm = self.arm(about), self.arm_jacobian(about)
            twists, orders = self.joint_twists, self.robot.carried
            hessian += parallel_axis_hessian(weights, mass, arm, of_arm, twists, orders)
        return read_only(hessian)

    def base_inertia_hessian(self, weights: Array, about: str | ArrayLike = COM) -> Array:
        """Hessian (nv, nv) by the joints of the same sum, I and weights in base axes."""
        S, weights = self.rotation(BASE), finite_array("weights", weights, (3, 3))
        hessian = self.inertia_hessian(S @ weights @ S.T, about).copy()
        hessian[:BASE_NV] = 0.0
        hessian[:, :BASE_NV] = 0.0
        return read_only(hessian)

    # ------------------------------------------------------------------ frames

    def position(self, frame: str) -> Array:
        """Origin of a frame in the world (3,) [m]."""
        return self.placement(frame)[0]

    def rotation(self, frame: str) -> Array:
        """Rotation (3, 3) taking the frame's axes to the world's."""
        return self.placement(frame)[1]

    def placement(self, frame: str) -> tuple[Array, Array]:
        """Position and rotation of a frame."""
        try:
            return self._placements.get(frame) or self._placement(frame)
        except TypeError:
            self.robot.frame_id(frame)  # says so of what is no name
            raise

    def jacobian(self, frame: str) -> Array:
        """Jacobian (6, nv) of the frame's origin velocity and angular velocity, world axes."""
        self.placement(frame)  # says so of what is no frame
        found = self._jacobians.get(frame)
        if found is None:
            state = self.native_state
            whole = state.tree.frame(state.array, self.robot.frame_id(frame))
            found = self._jacobians[frame] = whole[POSE:].reshape(6, -1)
        return found

    @lazy
    def joint_placements(self) -> tuple[Array, Array]:
        """Rotations (njoints, 3, 3) and origins (njoints, 3) of all joints; entry 0: the world."""
        state = self.native_state
        return state.part("rotations", -1, 3, 3), state.part("origins", -1, 3)

    @lazy
    def joint_twists(self) -> Array:
        """(6, nv): column k is the twist that v_k = 1 gives to all bodies that it carries.

        World axes, the linear part that of the point at the world's origin.
        """
        return self.native_state.part("twists", 6, -1)

    def _placement(self, frame: str) -> tuple[Array, Array]:
        """Return where a frame is."""
        (pose,) = self._poses(frame)
        placed = self._placements[frame] = pose[0], pose[1:]
        return placed

    def _poses(self, *frames: str) -> Array:
        """Return position and rotation of each frame (k, 4, 3), from one call of the core."""
        state = self.native_state
        return state.tree.poses(state.array, *map(self.robot.frame_id, frames))
