"""External forces from joint torques: residuals of the generalised momentum.

With p = M v, M a + h = S' tau + J' f gives the external force J' f = p' - M' v + h - S' tau, whose
observer r' = K (J' f - r) needs no acceleration (De Luca and Mattone, *Actuator failure detection
and isolation using generalized momenta*, ICRA 2003). Over a period M v grows by
M_k (v_{k+1} - v_k) + (M_{k+1} - M_k) v_{k+1}, whose second term cancels with M' v, so that

    r += (1 - exp(-K dt)) (M_k (v_{k+1} - v_k) / dt + h_k - S' tau - r)

needs no derivative of M either. The wrenches on the soles are a damped least-squares solution of
J' f = r, so that a straight leg gives no excessive forces; the base's rows, which have the
acceleration of the whole mass, have a smaller weight. Where loops or gears tie joints together, r
has their forces, too, which do no work: J' f = r is then solved along the motions that they allow.
The arithmetic is the core's (``source/momentum.c``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.native import doubles, ffi, lib, pointer
from wbc.robot import Robot
from wbc.robot.kernel import frame_places
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.postures import STANDING
from wbc.validate import Array, finite_array, finite_number

# Levers too short to tell a force: squared [m^2], at most, and by the CoM's height. Those of small
# robots are shorter: with 1e-3 m^2 a foot in the air bore a quarter of a HOAP's weight.
MAX_LEVER_SQUARED, LEVER_RATIO = 1e-3, 0.05


class MomentumObserver:
    """Low-passed external generalised force, and the wrenches on the soles that explain it.

    Parameters
    ----------
    bandwidth:
        K [1/s]: forces are observed with a delay of 1/K.
    base_trust:
        Weight of the base's rows by the joints' in the least squares.

    Attributes
    ----------
    feet:
        Names, in the order of :attr:`wrenches`.
    struct, given, made:
        Of the core: its struct, and the arrays that it reads and writes, by their names there.

    Raises
    ------
    InvalidInputError
        More than four feet, or a number out of range.
    """

    def __init__(self, robot: Robot, bandwidth: float = 150.0, base_trust: float = 0.1) -> None:
        check_robot("momentum observer, robot", robot)
        self.robot, self.feet = robot, tuple(robot.feet)
        self.bandwidth = finite_number("momentum observer, bandwidth", bandwidth, above=0.0)
        trust = finite_number("momentum observer, base_trust", base_trust, least=0.0)
        if len(self.feet) > lib.MOMENTUM_MOST_FEET:
            raise InvalidInputError(
                f"momentum observer: {robot.name} has {len(self.feet)} feet; at most"
                f" {lib.MOMENTUM_MOST_FEET} are supported"
            )
        self._arguments = robot, bandwidth, trust
        standing = robot.snapshot(robot.postures[STANDING])
        soles = [standing.position(foot.frame)[2] for foot in robot.feet.values()]
        height = float(standing.com[2]) - min(soles, default=0.0)
        tree, nv, k = robot.native.tree, robot.nv, len(self.feet)
        ids = [robot.frame_id(foot.frame) for foot in robot.feet.values()]
        joints, placements = frame_places(robot.model, ids)
        sizes = {"residual": nv, "velocity": nv, "motion": tree.motion_size, "wrenches": 6 * k}
        # One array of the state; then arrays that each update overwrites.
        self._memory = np.zeros(sum(sizes.values()) + 1)
        ends = np.cumsum(list(sizes.values())).tolist()
        parts = dict(zip(sizes, np.split(self._memory, ends), strict=False))
        self._residual, self._wrenches = parts["residual"], parts["wrenches"].reshape(k, 6)
        made = {
            "state": np.zeros(tree.frames),
            "frames": np.zeros(max(k, 1) * tree.frame_size),
            "scratch": np.zeros(13 * tree.joints + 17 * nv),
            "known": self._memory[-1:],  # whether a state was taken in
        }
        n = nv - BASE_NV
        self._untied = np.zeros((n, n) if robot.closure.binds else 0)
        self.tie(standing.q)
        given = {
            "placement": placements.reshape(-1),
            "damping": robot.damping.copy(),
            "friction": robot.friction.copy(),
        }
        given |= {"untied": self._untied} if self._untied.size else {}
        self.given: Mapping[str, NDArray[Any]] = given | {"joint": joints}
        self.made: Mapping[str, NDArray[Any]] = parts | made
        arrays = {name: pointer(array) for name, array in (self.made | self.given).items()}
        self.struct = ffi.new(
            "wbc_momentum *",
            {
                "tree": tree.struct,
                "feet": k,
                "base_trust": trust,
                "bandwidth": self.bandwidth,
                "lever": min(MAX_LEVER_SQUARED, (LEVER_RATIO * height) ** 2),
                **arrays,
            },
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor, arguments and memory: the core's struct cannot be pickled."""
        return type(self), self._arguments, self.memory()

    def __setstate__(self, memory: Array) -> None:
        self.restore(memory)

    @property
    def residual(self) -> Array:
        """External generalised force (nv,) [N, N m], the base's in its axes; a copy.

        Where loops or gears tie joints together it has their forces, too.
        """
        return self._residual.copy()

    @property
    def wrenches(self) -> dict[str, Array]:
        """Wrench (6,) on each sole by foot, at its frame's origin in world axes [N, N m]."""
        wrenches = self._wrenches.copy()
        return dict(zip(self.feet, wrenches, strict=True))

    def reset(self) -> None:
        """Restart, without forces."""
        self._memory[:] = 0.0

    def tie(self, q: Array) -> None:
        """Tell the core which motions of the joints loops and gears allow at ``q`` (nq,)."""
        if self._untied.size:
            J = self.robot.closure.errors(q)[1][:, BASE_NV:]
            self._untied[:] = np.eye(len(self._untied)) - np.linalg.pinv(J, rcond=1e-9) @ J

    def joint_torques(self, q: Array, v: Array, torque: Array) -> Array:
        """Return what motors (nv-6,) and springs give; the core knows of no springs, nor loops."""
        self.tie(q)
        if not self.robot.passive:
            return torque
        return torque + self.robot.passive_forces(q, v)[BASE_NV:]

    def update(self, q: Array, v: Array, torque: Array, dt: float) -> None:
        """Update by the state now and the motors' torques (nv-6,) over the ``dt`` [s] before.

        The joints' damping and dry friction in the model are subtracted from the torques, and what
        springs give is added.

        Raises
        ------
        InvalidInputError
            Something is NaN, or of another size.
        """
        q, v = self.robot.check_configuration(q), self.robot.check_velocity(v)
        torque = finite_array("momentum observer, torque", torque, (self.robot.nv - BASE_NV,))
        step = finite_number("momentum observer, dt", dt, least=0.0)
        torque = self.joint_torques(q, v, torque)
        lib.wbc_momentum_update(self.struct, *map(doubles, (q, v, torque)), step)

    def memory(self) -> Array:
        """Return the whole state, for :meth:`restore`."""
        return self._memory.copy()

    def restore(self, memory: Array) -> None:
        """Restore a state of :meth:`memory`."""
        self._memory[:] = memory
