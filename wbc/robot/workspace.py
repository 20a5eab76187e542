"""Pinocchio's scratch memory of one robot, and which snapshot it holds at the moment.

Allocating a ``pin.Data`` costs more than a whole control tick, so a robot owns one set for all its
snapshots. A snapshot that reads from it first makes sure that the passes were run at its own state:
results are therefore always right, whatever was evaluated in between. A robot has one workspace for
each thread: another thread cannot run its passes between a check and what is then read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.validate import Array

# Where the entries of the (3, 3) inertia are among the nine of a composite.
INERTIA_ENTRIES = np.array([[3, 4, 6], [4, 5, 7], [6, 7, 8]])


class Workspace:
    """Scratch memory for the passes over one model."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.kinematics_data = model.createData()
        self.kinematics_owner: Any = None
        # Views on what the passes fill: reading it from Pinocchio takes longer.
        self.centroidal_map: Array = self.kinematics_data.Ag
        self.twists: Array = self.kinematics_data.J
        self.placements = JointPlacements(self.kinematics_data)
        self.composites = CompositeInertias(model, self.kinematics_data)
        self.frames: dict[int, tuple[Array, Array]] = {}
        self.columns = CarriedColumns(model)
        self._rates = model.createData()
        self._rates_owner: Any = None
        self.scratch = model.createData()
        self.at_rest = np.zeros(model.nv)

    def kinematics(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding placements, joint Jacobians, centroidal map and inertia at (q, v)."""
        if self.kinematics_owner is not owner:
            self.kinematics_owner = None  # an exception half-way must not leave a false claim
            pin.ccrba(self.model, self.kinematics_data, q, v)
            self.kinematics_owner = owner
        return self.kinematics_data

    def frame_view(self, index: int) -> tuple[Array, Array]:
        """Return views on a frame's origin and rotation, which are kept in ``frames``."""
        pose = self.kinematics_data.oMf[index]
        view = self.frames[index] = pose.translation, pose.rotation
        return view

    def placed(self, owner: Any, q: Array) -> pin.Data:
        """Return data holding the joints' placements at q, at least."""
        if self.kinematics_owner is owner:
            return self.kinematics_data
        pin.forwardKinematics(self.model, self.scratch, q)
        return self.scratch

    def rates(self, owner: Any, q: Array, v: Array) -> pin.Data:
        """Return data holding velocities, and accelerations and momentum's rate for v' = 0."""
        if self._rates_owner is not owner:
            self._rates_owner = None
            rest = self.at_rest
            pin.computeCentroidalMomentumTimeVariation(self.model, self._rates, q, v, rest)
            self._rates_owner = owner
        return self._rates


class JointPlacements:
    """A window on ``data.oMi``: rotations (njoints, 3, 3) and origins (njoints, 3), world axes.

    Reading 31 placements from Python takes 13 us, copying them through this window 1. They lie in
    one block of memory at a constant distance, which is checked once; where they do not, they are
    read one by one. The arrays follow the data: copy what should last. Entry 0 is the world.
    """

    def __init__(self, data: pin.Data) -> None:
        self._data = data  # the views must not outlive the memory they look at
        self._rotations = side_by_side([pose.rotation for pose in data.oMi])
        self._origins = side_by_side([pose.translation for pose in data.oMi])

    def copies(self) -> tuple[Array, Array]:
        """Return fresh arrays of rotations and origins as they are in the data now."""
        if self._rotations is None or self._origins is None:
            poses = list(self._data.oMi)
            rotations = np.array([pose.rotation for pose in poses])
            return rotations, np.array([pose.translation for pose in poses])
        return self._rotations.copy(order="C"), self._origins.copy()


class CompositeInertias:
    """A window on ``data.oYcrb``: for each entry of v the inertia of all bodies that it moves.

    Reading them one by one from Python takes 25 us, through this window 2. Each lies in memory as
    mass, CoM and the six entries xx xy yy xz yz zz of the inertia about the CoM; that is checked
    against Pinocchio's own getters when first used, and where it is not so they are read one by
    one.
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._data = data  # the window must not outlive the memory it looks at
        joints = [j for j in range(model.njoints) for _ in range(model.nvs[j])]
        self._joints = np.array(sorted(joints, key=lambda j: int(model.idx_vs[j])))
        levers = side_by_side([Y.lever for Y in data.oYcrb])
        self._window: Array | None = None
        if levers is not None and levers.strides[0] >= 9 * levers.itemsize:
            shape, strides = (len(levers), 9), (levers.strides[0], levers.itemsize)
            self._window = np.lib.stride_tricks.as_strided(
                levers, shape=shape, strides=strides, writeable=False
            )
        self._checked = False

    def read(self) -> Array:
        """Return (nv, 9): CoM, world axes [m], then the inertia's entries about it [kg m^2]."""
        return self._every()[self._joints]

    def whole(self) -> Array:
        """Return a copy (9,) of those of the whole robot."""
        return self._every()[0].copy()

    def _every(self) -> Array:
        """Return those of all joints (njoints, 9); of the world they are the whole robot's."""
        if not self._checked:
            self._checked = True
            if self._window is not None and not (self._window == self._one_by_one()).all():
                self._window = None
        return self._one_by_one() if self._window is None else self._window

    def _one_by_one(self) -> Array:
        rows, columns = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
        return np.array([[*Y.lever, *Y.inertia[rows, columns]] for Y in self._data.oYcrb])


class CarriedColumns:
    """Which entries of v carry which: the structure of the tree, column by column.

    Attributes
    ----------
    orders:
        (nv, nv), 2 where column j moves the body of column k and not the other way round, 1 where
        both move one body, 0 elsewhere: with its transpose, both orders of every pair.
    """

    def __init__(self, model: pin.Model) -> None:
        body = np.zeros(model.nv, dtype=int)
        for j in range(1, model.njoints):
            body[model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = j
        chains = [set(map(int, chain)) for chain in model.supports]
        reaches = np.array([[int(j) in chains[k] for j in body] for k in body])
        self.orders: Array = reaches * (2.0 - reaches.T)


def side_by_side(fields: Sequence[Any]) -> Array | None:
    """Return one view (n, ...) on n arrays that lie at a constant distance in memory, or None.

    The view does not keep these arrays alive.
    """
    first = fields[0]
    steps = np.unique(np.diff([field.ctypes.data for field in fields]))
    if len(steps) > 1 or any(field.flags.owndata for field in fields):
        return None
    step = int(steps[0]) if len(steps) else first.nbytes
    shape, strides = (len(fields), *first.shape), (step, *first.strides)
    return np.lib.stride_tricks.as_strided(first, shape=shape, strides=strides, writeable=False)
