"""Pinocchio's scratch memory of one robot, one for each thread, and the structure of its tree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from wbc.validate import Array


class ModelScratch:
    """Scratch memory for passes over a model: making a ``pin.Data`` takes longer than a tick."""

    def __init__(self, model: pin.Model) -> None:
        self.model = model
        self.columns = CarriedColumns(model)
        self._data = model.createData()
        self._owner: Any = None

    def placed(self, owner: Any, q: Array) -> pin.Data:
        """Return data holding the joints' placements at q, of a state whose they may be already."""
        if self._owner is not owner:
            self._owner = None  # an exception half-way must not leave a false claim
            pin.forwardKinematics(self.model, self._data, q)
            self._owner = owner
        return self._data


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
