"""The native core's passes over one kinematic tree.

One call writes what most ticks ask for into fixed places of one array: CoM, CRB inertia with its
Jacobian, centroidal map, placements, and the frames that earlier snapshots were asked for. It takes
2 us on the G1, where Pinocchio's pass and the reading of its results from Python take 40. A second
one, made when it is asked for, adds mass matrix, bias forces and drifts.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.native import Core, address
from wbc.spatial import vech
from wbc.validate import Array, are_plain, read_only

# Frames kept in every state at most, 0.1 us each; others are computed when they are asked for.
KEPT = 32
REVOLUTE, PRISMATIC, CONTINUOUS = 1, 2, 3  # as in source/core.h
_ARRAYS = ("parent", "kind", "iq", "iv", "placement", "axis", "body", "armature", "gravity")


class _Tree(ctypes.Structure):
    """``wbc_tree`` of source/core.h."""

    _fields_ = [("nv", ctypes.c_int64), ("joints", ctypes.c_int64)] + [
        (name, ctypes.c_void_p) for name in _ARRAYS
    ]


class NativeTree:
    """A model as the core sees it; does not change, threads share it.

    Attributes
    ----------
    struct, address:
        What the core reads, and where it lies.
    arrays:
        What the struct points at, by the names of ``wbc_tree`` in source/core.h.
    """

    def __init__(self, core: Core, model: pin.Model) -> None:
        self.core = core
        self.model = model
        self.nq, self.nv, self.joints = int(model.nq), int(model.nv), int(model.njoints)
        joints = range(self.joints)
        parents = [int(parent) for parent in model.parents]
        parents[0] = 0
        kinds, axes = _kinds_and_axes(model)
        starts = [[max(int(i), 0) for i in indices] for indices in (model.idx_qs, model.idx_vs)]
        integers = np.array([parents, kinds, *starts], dtype=np.int64)
        placement = np.array([_flat(pose) for pose in model.jointPlacements])
        body = np.array([_body(model.inertias[j]) for j in joints])
        armature, gravity = np.array(model.armature), np.array(model.gravity.linear)
        every = (*integers, placement, axes, body, armature, gravity)
        # The struct points at them.
        self.arrays: dict[str, NDArray[Any]] = dict(zip(_ARRAYS, every, strict=True))
        self.struct = _Tree(self.nv, self.joints, *map(address, every))
        self.address = ctypes.addressof(self.struct)
        nv, base = self.nv, 18
        self.com_jacobian = slice(base + 6 * nv, base + 9 * nv)
        self.centroidal_map = slice(base, base + 6 * nv)
        self.inertia_jacobian = slice(base + 9 * nv, base + 15 * nv)
        self.twists = slice(base + 15 * nv, base + 21 * nv)
        self.rotations = slice(base + 21 * nv, base + 21 * nv + 9 * self.joints)
        self.origins = slice(self.rotations.stop, self.rotations.stop + 3 * self.joints)
        self.frames = self.origins.stop
        self.frame_size = 12 + 6 * nv
        drifts = nv * nv + nv
        self.mass_matrix, self.bias = slice(0, nv * nv), slice(nv * nv, drifts)
        self.com_drift = slice(drifts, drifts + 3)
        self.momentum_drift = slice(drifts + 3, drifts + 9)
        self.inertia_rate = slice(drifts + 9, drifts + 15)
        self.inertia_curvature = slice(drifts + 15, drifts + 21)
        self.motion = drifts + 21
        self.motion_size = self.motion + 9 * self.joints

    def frame(self, state: Array, index: int) -> Array:
        """Return a frame, as states keep it."""
        joint, placement = frame_places(self.model, [index])
        out = np.empty(self.frame_size)
        where, of, there, to = map(address, (state, joint, placement, out))
        self.core.wbc_frames(self.address, where, 1, of, there, to)
        return read_only(out)


class NativeState(NamedTuple):
    """What the core found at one state."""

    array: Array  # all of it, read-only; see source/core.h
    tree: NativeTree
    slots: Mapping[str, int]  # where frames begin in it, by name

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity by the name of its place: a view on the whole."""
        place: slice = getattr(self.tree, name)
        return self.array[place].reshape(shape)

    def com(self) -> Array:
        """Return a copy (3,), which may be kept much longer than the whole."""
        return self.array[:3].copy()

    def inertia(self) -> Array:
        """Return a copy (3, 3)."""
        return self.array[3:12].copy().reshape(3, 3)

    def momentum(self) -> Array:
        """Return a copy (6,)."""
        return self.array[12:18].copy()

    def frame(self, name: str, robot: HasPass) -> tuple[tuple[Array, Array], Array]:
        """Return (origin (3,), rotation (3, 3)) and Jacobian (6, nv) of a frame."""
        array, begin = self.array, self.slots.get(name)
        if begin is None:
            index = robot.frame_indices[name]
            array, begin = self.tree.frame(array, index), 0
            if robot.native is not None:  # of this thread, whoever made the state
                robot.native.keep(name, index)
        pose = array[begin : begin + 12].copy()  # may be kept longer than the rest
        pose.flags.writeable = False
        jacobian = array[begin + 12 : begin + self.tree.frame_size].reshape(6, -1)
        return (pose[:3], pose[3:].reshape(3, 3)), jacobian

    def motion(self, v: Array) -> NativeMotion:
        """Return what depends on the state's velocity (nv,), too."""
        tree = self.tree
        out, scratch = np.empty(tree.motion_size), np.empty(9 * tree.joints + 6 * tree.nv)
        addresses = map(address, (self.array, v, out, scratch))
        tree.core.wbc_motion(tree.address, *addresses)
        return NativeMotion(read_only(out), self.array, tree)


class NativeMotion(NamedTuple):
    """Mass matrix, bias forces, and second derivatives at zero acceleration of v."""

    array: Array  # all of it, read-only; see source/core.h
    state: Array  # the array of the NativeState that it belongs to
    tree: NativeTree

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity by the name of its place: a view on the whole."""
        place: slice = getattr(self.tree, name)
        return self.array[place].reshape(shape)

    def drift(self, name: str) -> Array:
        """Return a copy of a drift by the name of its place."""
        place: slice = getattr(self.tree, name)
        return read_only(self.array[place].copy())

    def frame_drift(self, index: int) -> Array:
        """Return the acceleration (6,) of a frame."""
        tree, out = self.tree, np.empty(6)
        joint, placement = frame_places(tree.model, [index])
        arrays = self.state, self.array
        state, motion = map(address, arrays)
        of, there, to = map(address, (joint, placement, out))
        tree.core.wbc_drifts(tree.address, state, motion, 1, of, there, to)
        return read_only(out)


class HasPass(Protocol):
    """What a state needs of its robot."""

    @property
    def frame_indices(self) -> Mapping[str, int]:
        """Pinocchio's index of each frame."""

    @property
    def native(self) -> NativePass | None:
        """The pass of the calling thread."""


class NativePass:
    """Memory of one thread for passes over a tree.

    Attributes
    ----------
    slots:
        Where frames begin that every state holds, by name; replaced, not changed, when one joins.
    """

    def __init__(self, tree: NativeTree) -> None:
        self.tree = tree
        self.slots: dict[str, int] = {}
        size = tree.nq + tree.nv
        memory = np.zeros(size + tree.nq)
        self._measured, self._reached = memory[:size], memory[size:]
        self._shapes = (tree.nq,), (tree.nv,)
        self._there, self._tree = address(memory), tree.address
        self._check: Any = tree.core.wbc_check
        self._scratch = np.zeros(13 * tree.joints + 17 * tree.nv)
        self._joints = np.zeros(KEPT, dtype=np.int64)
        self._placements = np.zeros((KEPT, 12))
        self._grow()

    def measured(self, q: Any, v: Any) -> bytes | None:
        """Return a state as snapshots keep it, v behind q; None: Python looks closely."""
        of_q, of_v = self._shapes
        if not are_plain(q, of_q, v, of_v):
            return None
        if self._check(self._tree, q.tobytes(), v.tobytes(), self._there):
            return None
        return self._measured.tobytes()

    def reached(self, q: Any, v: Any, dt: float) -> Array | None:
        """Return where a measured q gets to at v over dt; None: Python looks closely."""
        of_q, of_v = self._shapes
        if not are_plain(q, of_q, v, of_v):
            return None
        tree = self.tree
        if tree.core.wbc_move(tree.address, q.tobytes(), v.tobytes(), dt, self._there):
            return None
        return self._reached.copy()

    def evaluate(self, q: Array, v: Array) -> NativeState:
        """Return all that is known at (q, v)."""
        self._call(self.tree.address, q.tobytes(), v.tobytes(), *self._arguments)
        found = self._state.copy()
        found.flags.writeable = False
        return NativeState(found, self.tree, self.slots)

    def keep(self, name: str, index: int) -> None:
        """Let later states hold a frame, if there is room for one more."""
        tree = self.tree
        if name in self.slots or len(self.slots) >= KEPT:
            return
        joint, placement = frame_places(tree.model, [index])
        self._joints[len(self.slots)] = joint[0]
        self._placements[len(self.slots)] = placement[0]
        self.slots = {**self.slots, name: tree.frames + len(self.slots) * tree.frame_size}
        self._grow()

    def _grow(self) -> None:
        tree, count = self.tree, len(self.slots)
        self._state = np.zeros(tree.frames + count * tree.frame_size)
        self._call: Any = tree.core.wbc_state
        frames = address(self._joints), address(self._placements)
        self._arguments = (address(self._state), address(self._scratch), count, *frames)


def frame_places(model: pin.Model, frames: Sequence[int]) -> tuple[NDArray[np.int64], Array]:
    """Return the joints (k,) and the placements there (k, 12) of frames, as the core reads them."""
    every = [model.frames[index] for index in frames]
    joints = np.array([frame.parentJoint for frame in every], dtype=np.int64)
    placements: Array = np.array([_flat(frame.placement) for frame in every])
    return joints, placements


def _flat(pose: pin.SE3) -> Array:
    """Return rotation and origin (12,)."""
    return np.concatenate((pose.rotation.ravel(), pose.translation))


def _body(inertia: pin.Inertia) -> Array:
    """Return mass, CoM and inertia about it (10,)."""
    return np.concatenate(([inertia.mass], inertia.lever, vech(inertia.inertia)))


def _kinds_and_axes(model: pin.Model) -> tuple[list[int], Array]:
    """Return what each joint is, and its axis (joints, 3) as Pinocchio moves it."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    kinds, axes = [0, 0], np.zeros((model.njoints, 3))
    for j in range(2, model.njoints):
        name = model.joints[j].shortname().removeprefix("JointModel")
        kinds.append(PRISMATIC if name[0] == "P" else CONTINUOUS if model.nqs[j] == 2 else REVOLUTE)
        twist = data.J[:, model.idx_vs[j]]
        axes[j] = data.oMi[j].rotation.T @ (twist[:3] if kinds[j] == PRISMATIC else twist[3:])
        axes[j] /= np.linalg.norm(axes[j])
    return kinds, axes
