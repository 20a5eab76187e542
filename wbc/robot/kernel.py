"""The native core's pass over one kinematic tree, and the check that it may be trusted with it.

One call writes what most ticks ask for into fixed places of one array: CoM, CRB inertia with its
Jacobian, centroidal map, placements, and the frames that earlier snapshots were asked for. It takes
2 us on the G1, where Pinocchio's pass and the reading of its results from Python take 40.
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.native import Core, NativeCoreError, core, mode
from wbc.robot.inertia import inertia_rates
from wbc.robot.workspace import Workspace
from wbc.spatial import vech
from wbc.validate import Array, read_only

# Frames kept in every state at most, 0.1 us each; others are computed when they are asked for.
KEPT = 32
# What the core and Pinocchio may differ by, relative to the largest entry.
AGREEMENT = 1e-10
REVOLUTE, PRISMATIC, CONTINUOUS = 1, 2, 3  # as in source/core.h


class _Tree(ctypes.Structure):
    """``wbc_tree`` of source/core.h."""

    _fields_ = [("nv", ctypes.c_int64), ("joints", ctypes.c_int64)] + [
        (name, ctypes.c_void_p)
        for name in ("parent", "kind", "iq", "iv", "placement", "axis", "body")
    ]


class NativeTree:
    """A model as the core sees it; does not change, threads share it."""

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
        self._kept = integers, placement, axes, body  # the struct points at them
        addresses = [row.ctypes.data for row in (*integers, *self._kept[1:])]
        self._struct = _Tree(self.nv, self.joints, *addresses)
        self.address = ctypes.addressof(self._struct)
        nv, base = self.nv, 18
        self.com_jacobian = slice(base + 6 * nv, base + 9 * nv)
        self.centroidal_map = slice(base, base + 6 * nv)
        self.inertia_jacobian = slice(base + 9 * nv, base + 15 * nv)
        self.twists = slice(base + 15 * nv, base + 21 * nv)
        self.rotations = slice(base + 21 * nv, base + 21 * nv + 9 * self.joints)
        self.origins = slice(self.rotations.stop, self.rotations.stop + 3 * self.joints)
        self.frames = self.origins.stop
        self.frame_size = 12 + 6 * nv


class NativeState(NamedTuple):
    """What the core found at one state.

    Attributes
    ----------
    array:
        All of it, read-only; see source/core.h.
    slots:
        Where frames begin in it, by name.
    """

    array: Array
    tree: NativeTree
    slots: Mapping[str, int]

    def part(self, name: str, *shape: int) -> Array:
        """Return a quantity by the name of its place: a view on the whole."""
        place: slice = getattr(self.tree, name)
        return self.array[place].reshape(shape)

    def com_and_inertia(self) -> tuple[Array, Array]:
        """Return copies (3,) and (3, 3), which may be kept much longer than the whole."""
        return self.array[:3].copy(), self.array[3:12].copy().reshape(3, 3)

    def momentum(self) -> Array:
        """Return a copy (6,)."""
        return self.array[12:18].copy()

    def frame(self, name: str, robot: HasPass) -> tuple[tuple[Array, Array], Array]:
        """Return (origin (3,), rotation (3, 3)) and Jacobian (6, nv) of a frame."""
        array, begin = self.array, self.slots.get(name)
        if begin is None:
            passes = robot.native  # of this thread, whoever made the state
            assert passes is not None
            array, begin = passes.frame(array, name), 0
        pose = array[begin : begin + 12].copy()  # may be kept longer than the rest
        pose.flags.writeable = False
        jacobian = array[begin + 12 : begin + self.tree.frame_size].reshape(6, -1)
        return (pose[:3], pose[3:].reshape(3, 3)), jacobian


class HasPass(Protocol):
    """What a state needs of its robot."""

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

    def __init__(self, tree: NativeTree, frames: Mapping[str, int]) -> None:
        self.tree = tree
        self.slots: dict[str, int] = {}
        self._indices = frames
        self._q, self._v = np.zeros(tree.nq), np.zeros(tree.nv)
        self._scratch = np.zeros(13 * tree.joints)
        self._joints = np.zeros(KEPT, dtype=np.int64)
        self._placements = np.zeros((KEPT, 12))
        self._grow()

    def evaluate(self, q: Array, v: Array) -> NativeState:
        """Return all that is known at (q, v)."""
        self._q[:] = q
        self._v[:] = v
        self._call(*self._arguments)
        found = self._state.copy()
        found.flags.writeable = False
        return NativeState(found, self.tree, self.slots)

    def frame(self, state: Array, name: str) -> Array:
        """Return a frame that ``state`` does not hold; later ones will hold it too."""
        tree, out = self.tree, np.empty(self.tree.frame_size)
        joint, placement = frame_places(tree.model, [self._indices[name]])
        arrays = state, joint, placement, out
        where, of, there, to = (array.ctypes.data for array in arrays)
        tree.core.wbc_frames(tree.address, where, 1, of, there, to)
        if name not in self.slots and len(self.slots) < KEPT:
            self._joints[len(self.slots)] = joint[0]
            self._placements[len(self.slots)] = placement[0]
            self.slots = {**self.slots, name: tree.frames + len(self.slots) * tree.frame_size}
            self._grow()
        return read_only(out)

    def _grow(self) -> None:
        tree, count = self.tree, len(self.slots)
        self._state = np.zeros(tree.frames + count * tree.frame_size)
        self._call: Any = tree.core.wbc_state
        arrays = self._q, self._v, self._state, self._scratch
        addresses = [array.ctypes.data for array in arrays]
        frames = self._joints.ctypes.data, self._placements.ctypes.data
        self._arguments = (tree.address, *addresses, count, *frames)


def frame_places(model: pin.Model, frames: Sequence[int]) -> tuple[NDArray[np.int64], Array]:
    """Return the joints (k,) and the placements there (k, 12) of frames, as the core reads them."""
    every = [model.frames[index] for index in frames]
    joints = np.array([frame.parentJoint for frame in every], dtype=np.int64)
    placements: Array = np.array([_flat(frame.placement) for frame in every])
    return joints, placements


def native_tree(name: str, work: Workspace) -> NativeTree | None:
    """Return the tree of a robot if there is a core that agrees with Pinocchio, else None.

    Raises
    ------
    NativeCoreError
        ``WBC_NATIVE=require``, and there is none.
    """
    found = core()
    if found is None:
        return None
    tree = NativeTree(found, work.model)
    worst = disagreement(tree, work)
    if worst <= AGREEMENT:  # NaN is not
        return tree
    said = f"the native core and Pinocchio differ by {worst:.1e} on {name}; it is not used for it"
    if mode() == "require":
        raise NativeCoreError(said)
    logging.getLogger(__name__).warning("%s", said)
    return None


def disagreement(tree: NativeTree, work: Workspace, states: int = 2, seed: int = 0) -> float:
    """Return the largest difference from Pinocchio at random states, relative to each quantity."""
    model, rng = tree.model, np.random.default_rng(seed)
    last = model.nframes - 1
    worst = 0.0
    for _ in range(states):
        q = pin.integrate(model, pin.neutral(model), rng.uniform(-1.5, 1.5, tree.nv))
        v = rng.standard_normal(tree.nv)
        data = work.kinematics(object(), q, v)
        com = np.array(data.oYcrb[0].lever)
        pose = pin.updateFramePlacement(model, data, last)
        theirs = (
            com,
            data.Ig.inertia,
            data.hg.vector,
            data.Ag,
            data.Ag[:3] / pin.computeTotalMass(model),
            inertia_rates(work.composites.read(), work.composites.masses, data.J, com),
            data.J,
            *work.placements.copies(),
            pose.translation,
            pose.rotation,
            pin.getFrameJacobian(model, data, last, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED),
        )
        passed = NativePass(tree, {"": last})
        first = passed.evaluate(q, v).array
        frame = passed.frame(first, "")
        whole = passed.evaluate(q, v).array  # now holds the frame
        for ours in (np.concatenate((first, frame)), whole):
            begin = 0
            for wanted in theirs:
                got = ours[begin : begin + np.size(wanted)].reshape(np.shape(wanted))
                begin += np.size(wanted)
                difference = np.abs(got - wanted).max() / max(np.abs(wanted).max(), 1e-9)
                worst = float(np.maximum(worst, difference))  # keeps NaN
    return worst


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
