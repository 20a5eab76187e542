"""Weights of the joints: which of them move where tasks leave the choice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE, matches
from wbc.validate import Array, finite_number, finite_vector, read_only

WHAT = "controller, joint_weights"

# By joint name, pattern or "base", or one for each entry of v.
JointWeights = Mapping[str, float] | ArrayLike


def weights_of(robot: Robot, given: JointWeights | None) -> Array:
    """Return the weights (nv,), all 1 where nothing is given.

    ``given``: by joint name or shell pattern, and ``"base"`` for the six of the base; later entries
    win. Or (nv,) numbers. All above 0.

    Raises UnknownNameError: a name or pattern that no joint matches; InvalidInputError: a weight
    that is not a positive number, not as many as v has entries, or a key that is no name.
    """
    weights: Array = np.ones(robot.nv)
    if isinstance(given, Mapping):
        for pattern, weight in given.items():
            if not isinstance(pattern, str):
                raise InvalidInputError(f"{WHAT}: expected names of joints, got {pattern!r}")
            value = finite_number(f"{WHAT} of {pattern!r}", weight, above=0.0)
            weights[moved_by(robot, pattern)] = value
    elif given is not None:
        weights = finite_vector(WHAT, given, robot.nv)
        if (weights <= 0.0).any():
            raise InvalidInputError(f"{WHAT}: each must be greater than 0, got {weights.min():g}")
    return read_only(weights)


def moved_by(robot: Robot, pattern: str) -> list[int]:
    """Return the entries of v of the joints that a name or pattern matches, or of ``"base"``.

    Raises UnknownNameError: no joint matches.
    """
    found = [BASE_NV + k for k in matches(pattern, robot.joint_names)]
    if not found and pattern != BASE:
        raise UnknownNameError("joint", pattern, (BASE, *robot.joint_names))
    return found or list(range(BASE_NV))
