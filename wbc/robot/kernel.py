"""The native core's passes over one kinematic tree.

One call writes CoM, CRB inertia with its Jacobian, centroidal map and placements into one array. It
takes 2 us on the G1; Pinocchio's pass, with reading its results from Python, takes 40. A second
call, on demand, adds mass matrix, bias forces and drifts; frames are computed one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.native import doubles, ffi, integers, lib, pointer
from wbc.robot.limits import JointLimits
from wbc.spatial import vech
from wbc.validate import FLOAT, Array, Index, is_plain, read_only


class NativeTree:
    """A model as the core reads it; immutable, shared by threads.

    ``struct``: pointer to the ``wbc_tree``.
    ``arrays``: its arrays, by the names of ``wbc_tree`` in source/core.h.
    ``parts``: slices of the quantities in a state or a motion, by the names of ``wbc_state_places``
    and ``wbc_motion_places``.
    """

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.nq, self.nv, self.joints = int(model.nq), int(model.nv), int(model.njoints)
        joints = range(self.joints)
        parents = [int(parent) for parent in model.parents]
        parents[0] = 0
        kinds, axes = _kinds_and_axes(model)
        starts = [[max(int(i), 0) for i in indices] for indices in (model.idx_qs, model.idx_vs)]
        parent, kind, iq, iv = np.array([parents, kinds, *starts], dtype=np.int64)
        self.arrays: dict[str, NDArray[Any]] = {  # the struct points at them
            "parent": parent,
            "kind": kind,
            "iq": iq,
            "iv": iv,
            "axis": axes,
            "placement": np.array([_flat(pose) for pose in model.jointPlacements]),
            "body": np.array([_body(model.inertias[j]) for j in joints]),
            "armature": np.array(model.armature),
            "gravity": np.array(model.gravity.linear),
        }
        places = {name: pointer(array) for name, array in self.arrays.items()}
        self.struct = ffi.new("wbc_tree *", {"nv": self.nv, "joints": self.joints, **places})
        state, motion = ffi.new("wbc_state_places *"), ffi.new("wbc_motion_places *")
        lib.wbc_places(self.struct, state, motion)
        self.parts = _slices(state) | _slices(motion)
        self.frames, self.motion_size = int(state.frames), int(motion.end)
        self.frame_size = int(lib.FRAME_JACOBIAN) + 6 * self.nv
        self._places: dict[tuple[int, ...], tuple[int, Any, Any]] = {}

    def places(self, *indices: int) -> tuple[int, Any, Any]:
        """Return how many frames, and pointers to their joints and to their placements there."""
        found = self._places.get(indices)
        if found is None:
            joints, placements = frame_places(self.model, indices)
            found = self._places[indices] = len(indices), integers(joints), doubles(placements)
        return found

    def poses(self, state: Array, *indices: int) -> Array:
        """Return origin and rotation of each frame (k, 4, 3), one above the other."""
        out = np.empty((len(indices), 4, 3))
        lib.wbc_frame_poses(self.struct, doubles(state), *self.places(*indices), doubles(out))
        return read_only(out)

    def frame(self, state: Array, index: int) -> Array:
        """Return origin, rotation and Jacobian of a frame, one behind the other."""
        out = np.empty(self.frame_size)
        lib.wbc_frames(self.struct, doubles(state), *self.places(index), doubles(out))
        return read_only(out)


class NativeState(NamedTuple):
    """The core's results at one state."""

    array: Array  # all results, read-only; see source/core.h
    tree: NativeTree

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity by the name of its place: a view on the whole."""
        return self.array[self.tree.parts[name]].reshape(shape)

    def copied(self, name: str) -> Array:
        """Return a copy of a quantity, which does not keep the whole array alive."""
        return read_only(self.array[self.tree.parts[name]].copy())

    def inertia_hessian(self, weights: Array, mass: float) -> Array:
        """Return the second derivative (nv, nv) by v of <weights, inertia>: see curvature.c."""
        nv = self.tree.nv
        hessian, work = np.empty((nv, nv)), np.empty(13 * (nv + 3))
        at, given = map(doubles, (self.array, vech(weights)))
        lib.wbc_inertia_hessian(self.tree.struct, at, mass, given, *map(doubles, (work, hessian)))
        return hessian

    def motion(self, v: Array) -> NativeMotion:
        """Return the quantities that depend on the velocity (nv,) too."""
        tree = self.tree
        out, scratch = np.empty(tree.motion_size), np.empty(9 * tree.joints + 6 * tree.nv)
        lib.wbc_motion(tree.struct, *map(doubles, (self.array, v, out, scratch)))
        return NativeMotion(read_only(out), self.array, tree)


class NativeMotion(NamedTuple):
    """Mass matrix, bias forces, and second derivatives at zero acceleration of v."""

    array: Array  # all of it, read-only; see source/core.h
    state: Array  # the array of the NativeState that it belongs to
    tree: NativeTree

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity by the name of its place: a view on the whole."""
        return self.array[self.tree.parts[name]].reshape(shape)

    def drift(self, name: str) -> Array:
        """Return a copy of a drift by the name of its place."""
        return read_only(self.array[self.tree.parts[name]].copy())

    def frame_drift(self, index: int) -> Array:
        """Return the acceleration (6,) of a frame."""
        tree, out = self.tree, np.empty(6)
        state, motion, to = map(doubles, (self.state, self.array, out))
        lib.wbc_drifts(tree.struct, state, motion, *tree.places(index), to)
        return read_only(out)


class NativePass:
    """Memory of one thread for passes over a tree.

    ``plans``: plans for evaluating rows at its states, by what they are about.
    """

    def __init__(self, tree: NativeTree) -> None:
        self.tree = tree
        self.plans: dict[object, Any] = {}
        size = tree.nq + tree.nv
        memory = np.zeros(size + tree.nq)
        self._measured, self._reached = memory[:size], memory[size:]
        self._shapes = (tree.nq,), (tree.nv,)
        self._there, self._tree = doubles(memory), tree.struct
        self._scratch = doubles(np.zeros(13 * tree.joints + 17 * tree.nv))

    def measured(self, q: Any, v: Any) -> bytes | None:
        """Return a checked state as snapshots store it, q then v; None: Python must check it."""
        # As is_plain of both, without its calls.
        arrays = type(q) is type(v) is np.ndarray and q.dtype is v.dtype is FLOAT
        if not arrays or (q.shape, v.shape) != self._shapes:
            return None
        # Copies: arrays may be strided, and nobody writes to them meanwhile.
        if lib.wbc_check(self._tree, q.tobytes(), v.tobytes(), self._there):
            return None
        return self._measured.tobytes()

    def integrated(self, q: Any, v: Any, dt: float) -> Array | None:
        """Return q integrated with v over dt; None: Python must check the input."""
        if not all(map(is_plain, (q, v), self._shapes)):
            return None
        given = doubles(q.tobytes()), doubles(v.tobytes())
        if lib.wbc_move(self._tree, *given, dt, self._there):
            return None
        return self._reached.copy()

    def integrated_all(self, q: Array, steps: Array) -> tuple[Array, int]:
        """Return q (n, nq) displaced by (n, nv), and how many of them are right."""
        reached, given = np.empty_like(q), (doubles(q), doubles(steps))
        return reached, lib.wbc_moves(self._tree, len(q), *given, self._there, doubles(reached))

    def evaluate(self, measured: bytes) -> NativeState:
        """Return the core's results at a measured q and v, without frames."""
        tree, out, q = self.tree, np.empty(self.tree.frames), doubles(measured)
        none = 0, ffi.NULL, ffi.NULL
        lib.wbc_state(self._tree, q, q + tree.nq, doubles(out), self._scratch, *none)
        return NativeState(read_only(out), tree)

    def evaluate_all(
        self, q: Array, v: Array, frames: Sequence[int] = (), momentum_jacobian: Array | None = None
    ) -> Array:
        """Return the core's results at (q (n, nq), v (n, nv)), one state a row, then its frames.

        ``momentum_jacobian`` (n, 6, nv), if given, is filled.
        """
        tree, count = self.tree, len(frames)
        joint, placement = frame_places(tree.model, frames)
        size = tree.frames + count * tree.frame_size
        q, v, out = np.ascontiguousarray(q), np.ascontiguousarray(v), np.zeros((len(q), size))
        given, to = (self._tree, len(q), doubles(q), doubles(v)), (doubles(out), self._scratch)
        change = ffi.NULL if momentum_jacobian is None else doubles(momentum_jacobian)
        lib.wbc_states(*given, *to, count, pointer(joint), pointer(placement), change)
        return out


def frame_places(model: pin.Model, frames: Sequence[int]) -> tuple[Index, Array]:
    """Return the joints (k,) and the placements there (k, 12) of frames, as the core reads them."""
    every = [model.frames[index] for index in frames]
    joints = np.array([frame.parentJoint for frame in every], dtype=np.int64)
    placements: Array = np.array([_flat(frame.placement) for frame in every])
    return joints, placements


def joint_starts(limits: JointLimits) -> Index:
    """Return the joints' indices in q (joints,); -index - 1 for those stored as (cos, sin)."""
    starts, turning = np.array(limits.starts, dtype=np.int64), list(limits.unbounded)
    starts[turning] = -starts[turning] - 1
    return starts


def _slices(places: Any) -> dict[str, slice]:
    """Return the slice of each part but the last."""
    begins = [(name, int(getattr(places, name))) for name, _ in ffi.typeof(places).item.fields]
    return {name: slice(begin, end) for (name, begin), (_, end) in pairwise(begins)}


def _flat(pose: pin.SE3) -> Array:
    return np.concatenate((pose.rotation.ravel(), pose.translation))


def _body(inertia: pin.Inertia) -> Array:
    """Return mass, CoM and inertia about it (10,)."""
    return np.concatenate(([inertia.mass], inertia.lever, vech(inertia.inertia)))


def _kinds_and_axes(model: pin.Model) -> tuple[list[int], Array]:
    """Return the ``joint_kind`` of each joint, and its axis (joints, 3) as Pinocchio moves it."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    kinds, axes = [0, 0], np.zeros((model.njoints, 3))
    for j in range(2, model.njoints):
        name = model.joints[j].shortname().removeprefix("JointModel")
        slides, turns = name[0] == "P", lib.CONTINUOUS if model.nqs[j] == 2 else lib.REVOLUTE
        kinds.append(lib.PRISMATIC if slides else turns)
        twist = data.J[:, model.idx_vs[j]]
        axes[j] = data.oMi[j].rotation.T @ (twist[:3] if slides else twist[3:])
        axes[j] /= np.linalg.norm(axes[j])
    return kinds, axes
