"""Kinematics of a robot at many states, in preallocated arrays.

One pass of the core per state, about 5 us for 31 velocities; the rest is vectorised by NumPy.
Linear first, world axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from wbc.robot.kernel import NativeState, NativeTree
from wbc.robot.model import Robot
from wbc.robot.tree import KinematicTree
from wbc.spatial import vech_inverse
from wbc.validate import Array, Bools, finite_array

FRAMES_PER_CALL = 500  # frames from one call of ``progress`` to the next
Progress = Callable[[int, int], None]


class StateSeries(NamedTuple):
    """The core's results at n states; the quantities are those of :class:`wbc.Snapshot`."""

    array: Array  # (n, size), one state a row
    tree: NativeTree
    slots: Mapping[str, int]  # offsets of the requested frames, by name
    v: Array  # velocities (n, nv)
    # Derivative of the centroidal momentum by q at constant v (n, 6, nv), if requested.
    momentum_jacobian: Array

    def __len__(self) -> int:
        return len(self.array)

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity (n, ...) by the name of its place, such as ``centroidal_map``."""
        return self.array[:, self.tree.parts[name]].reshape(len(self.array), *shape)

    @property
    def inertia(self) -> Array:
        """Centroidal CRB inertia (n, 3, 3) [kg m^2]."""
        return self.part("inertia", 3, 3)

    @property
    def com(self) -> Array:
        """CoM (n, 3) [m]."""
        return self.part("com", 3)

    def position(self, frame: str) -> Array:
        """Origin of a frame (n, 3) [m]."""
        return self._of(frame, 0, 3)

    def rotation(self, frame: str) -> Array:
        """Rotation (n, 3, 3) from a frame's axes to the world's."""
        return self._of(frame, 3, 12).reshape(-1, 3, 3)

    def jacobian(self, frame: str) -> Array:
        """Jacobian (n, 6, nv) of a frame's origin and rotation."""
        return self._of(frame, 12, self.tree.frame_size).reshape(len(self), 6, -1)

    def state(self, k: int) -> NativeState:
        """Return one state."""
        return NativeState(self.array[k], self.tree)

    def _of(self, frame: str, begin: int, end: int) -> Array:
        at = self.slots[frame]
        return self.array[:, at + begin : at + end]


def state_series(
    robot: KinematicTree,
    q: Array,
    v: Array | None = None,
    frames: Iterable[str] = (),
    momentum_jacobian: bool = False,
) -> StateSeries:
    """Return the core's results at n states, with some frames: 4 us a state for 35 velocities.

    ``q``: configurations (n, nq), with unit quaternions.
    ``v``: velocities (n, nv); zero if not given.
    ``frames``: names of the frames to include.
    ``momentum_jacobian``: whether to include it.

    Raises InvalidInputError: arrays of a wrong shape, or not finite; UnknownNameError: no such
    frame.
    """
    count = len(q)
    q = finite_array("q", q, (count, robot.nq))
    v = np.zeros((count, robot.nv)) if v is None else finite_array("v", v, (count, robot.nv))
    tree, index = robot.native.tree, {name: robot.frame_id(name) for name in frames}
    slots = {name: tree.frames + k * tree.frame_size for k, name in enumerate(index)}
    change = np.zeros((count if momentum_jacobian else 0, 6, robot.nv))
    of = change if momentum_jacobian else None
    array = robot.native.evaluate_all(q, v, tuple(index.values()), of)
    return StateSeries(array, tree, slots, v, change)


def velocities(robot: KinematicTree, q: Array, dt: float) -> Array:
    """Return the velocities (n - 1, nv) from each of n configurations to the next, after ``dt``."""
    steps = [pin.difference(robot.model, a, b) for a, b in pairwise(q)]
    return np.array(steps).reshape(-1, robot.nv) / dt


def rates(robot: KinematicTree, q: Array, dt: float) -> tuple[Array, Array]:
    """Return velocities of n configurations and their rates (n, nv), ``dt`` from one to the next.

    By central differences, one-sided at the ends.
    """
    steps = velocities(robot, q, dt)
    v = np.vstack((steps[:1], 0.5 * (steps[:-1] + steps[1:]), steps[-1:]))
    inner = np.diff(steps, axis=0) / dt
    return v, np.vstack((inner[:1], inner, inner[-1:])) if len(inner) else np.zeros_like(v)


@dataclass(frozen=True, eq=False)
class CentroidalSeries:
    """The robot as a whole in n frames."""

    com: Array  # CoM (n, 3) [m]
    # momentum and momentum_rate: centroidal momentum and its rate (n, 6): linear [kg m/s],
    # angular [kg m^2/s].
    momentum: Array
    momentum_rate: Array
    # inertia and inertia_rate: centroidal CRB inertia (n, 3, 3) [kg m^2] and its rate [kg m^2/s].
    inertia: Array
    inertia_rate: Array
    # Placement of each foot's sole frame in the world (n, 4, 4), homogeneous.
    soles: Mapping[str, Array]


def centroidal_series(
    robot: Robot, q: Array, v: Array, acceleration: Array, progress: Progress | None = None
) -> CentroidalSeries:
    """Return CoM, momentum, inertia, their rates and the soles' placements in n frames.

    ``q``: configurations (n, nq), with unit quaternions.
    ``v``, ``acceleration``: velocities and their rates (n, nv): base in base axes, joints.
    ``progress``: called with frames done and frames in all, every 500 frames and at the end.

    Raises InvalidInputError: arrays of a wrong shape, or not finite.
    """
    count = len(q)
    q = finite_array("q", q, (count, robot.nq))
    v = finite_array("v", v, (count, robot.nv))
    acceleration = finite_array("acceleration", acceleration, (count, robot.nv))
    com, momentum, rate = np.empty((count, 3)), np.empty((count, 6)), np.empty((count, 6))
    inertia, inertia_rate = np.empty((2, count, 3, 3))
    soles = _sole_arrays(robot, count)
    for part, states in _chunks(robot, q, v, progress):
        com[part], inertia[part] = states.com, states.inertia
        momentum[part] = states.part("momentum", 6)
        centroidal_map = states.part("centroidal_map", 6, -1)
        rate[part] = (centroidal_map @ acceleration[part][:, :, None])[:, :, 0]
        for k, now in enumerate(v[part]):
            motion = states.state(k).motion(now)
            rate[part.start + k] += motion.part("momentum_drift", 6)
            inertia_rate[part.start + k] = vech_inverse(motion.part("inertia_rate", 6))
        _place_soles(robot, states, part, soles)
    return CentroidalSeries(com, momentum, rate, inertia, inertia_rate, soles)


@dataclass(frozen=True, eq=False)
class CentroidalDerivatives:
    """First derivatives of the robot as a whole in n frames, by q in its tangent space, v, v'."""

    com: Array  # by q (n, 3, nv)
    inertia: Array  # of xx xy xz yy yz zz, by q (n, 6, nv)
    # centroidal_map: of momentum by v, and of its rate by v' (n, 6, nv)
    centroidal_map: Array
    momentum_by_q: Array  # (n, 6, nv)
    rate_by_q: Array  # of the momentum's rate (n, 6, nv)
    rate_by_v: Array  # (n, 6, nv)
    soles: Array  # Jacobians of the soles' frames, in the order of robot.feet (n, f, 6, nv)


def centroidal_derivatives(
    robot: Robot, q: Array, v: Array, acceleration: Array
) -> CentroidalDerivatives:
    """Return the derivatives of what :func:`centroidal_series` gives, and the soles' Jacobians.

    Parameters and errors as there. Some 60 us per frame for 31 velocities.
    """
    count = len(q)
    q = finite_array("q", q, (count, robot.nq))
    v = finite_array("v", v, (count, robot.nv))
    acceleration = finite_array("acceleration", acceleration, (count, robot.nv))
    model, data = robot.model, robot.model.createData()
    com, soles = np.empty((count, 3, robot.nv)), np.empty((count, len(robot.feet), 6, robot.nv))
    inertia, by_q, rate_by_q, rate_by_v, centroidal_map = np.empty((5, count, 6, robot.nv))
    frames = [foot.frame for foot in robot.feet.values()]
    for k in range(count):
        by_q[k], rate_by_q[k], rate_by_v[k], centroidal_map[k] = (
            pin.computeCentroidalDynamicsDerivatives(model, data, q[k], v[k], acceleration[k])
        )
        snapshot = robot.snapshot(q[k])
        com[k], inertia[k] = snapshot.com_jacobian, snapshot.inertia_jacobian
        for number, frame in enumerate(frames):
            soles[k, number] = snapshot.jacobian(frame)
    return CentroidalDerivatives(com, inertia, centroidal_map, by_q, rate_by_q, rate_by_v, soles)


def sole_series(robot: Robot, q: Array, progress: Progress | None = None) -> dict[str, Array]:
    """Return the placement of each foot's sole frame in the world (n, 4, 4), by foot.

    Parameters and errors as of :func:`centroidal_series`.
    """
    count = len(q)
    q = finite_array("q", q, (count, robot.nq))
    soles = _sole_arrays(robot, count)
    for part, states in _chunks(robot, q, np.zeros((count, robot.nv)), progress):
        _place_soles(robot, states, part, soles)
    return soles


def revolute_joints(robot: Robot) -> Bools:
    """Return which actuated joints turn rather than slide (nv-6,), bool."""
    model = robot.model
    kinds = [model.joints[model.getJointId(name)].shortname() for name in robot.joint_names]
    return np.array([not kind.startswith("JointModelP") for kind in kinds], dtype=bool)


def _chunks(
    robot: Robot, q: Array, v: Array, progress: Progress | None
) -> Iterator[tuple[slice, StateSeries]]:
    """Yield some states after the others, with the frames of the soles."""
    frames = [foot.frame for foot in robot.feet.values()]
    for begin in range(0, len(q), FRAMES_PER_CALL):
        part = slice(begin, min(begin + FRAMES_PER_CALL, len(q)))
        yield part, state_series(robot, q[part], v[part], frames)
        if progress is not None:
            progress(part.stop, len(q))


def _sole_arrays(robot: Robot, count: int) -> dict[str, Array]:
    return {name: np.tile(np.eye(4), (count, 1, 1)) for name in robot.feet}


def _place_soles(
    robot: Robot, states: StateSeries, part: slice, soles: Mapping[str, Array]
) -> None:
    for name, placed in soles.items():
        frame = robot.feet[name].frame
        placed[part, :3, :3], placed[part, :3, 3] = states.rotation(frame), states.position(frame)
