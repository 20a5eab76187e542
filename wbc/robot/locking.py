"""Lock joints at a value: they leave the model, and what they carry joins the parent body."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError, ModelError
from wbc.robot.description import Description
from wbc.robot.limits import Limits
from wbc.robot.names import matching
from wbc.validate import Array, finite_number


def lock_joints(description: Description, locked: Mapping[str, float]) -> pin.Model:
    """Return a new model in which the given joints are rigid.

    Parameters
    ----------
    locked:
        Joint name or pattern to the value [rad or m] at which it is held; later entries win.

    Raises
    ------
    UnknownNameError
        No such joint.
    InvalidInputError
        A value that is not finite or outside the joint's limits.
    ModelError
        A joint coupled to another one is left free.
    """
    model = description.model
    names = [name for name, nv in zip(model.names, model.nvs, strict=True) if nv == 1]
    locked = {
        names[k]: value
        for pattern, value in locked.items()
        for k in matching(pattern, names, "joint to lock")
    }
    _refuse_coupled(description, locked)
    if not locked:
        return model.copy()
    reference = pin.neutral(model)
    limits = Limits.of(model)
    for name, value in locked.items():
        place_joint(limits, reference, name, value)
    ids = [model.getJointId(name) for name in locked]
    return pin.buildReducedModel(model, ids, reference)


def _refuse_coupled(description: Description, locked: Mapping[str, float]) -> None:
    free = {name: by for name, by in description.coupled.items() if name not in locked}
    if not free:
        return
    name, by = next(iter(free.items()))
    remedy = ", ".join(f"{joint!r}: 0.0" for joint in sorted({*free, *free.values()} - {*locked}))
    raise ModelError(
        f"{description.path}: joint {name!r} is coupled to {by!r} (mimic or equality), which is not"
        f" supported; lock every such joint: locked={{{remedy}}}"
    )


def place_joint(limits: Limits, q: Array, name: str, value: float) -> None:
    """Write the value of one joint into ``q``.

    Raises
    ------
    InvalidInputError
        Not finite, or outside the joint's limits by more than rounding.
    """
    value = finite_number(f"joint {name!r}", value)
    k = limits.names.index(name)
    lower, upper = float(limits.lower[k]), float(limits.upper[k])
    if not lower - 1e-6 <= value <= upper + 1e-6:  # files round limits and postures to 6 digits
        raise InvalidInputError(
            f"joint {name!r}: {value:g} is outside its limits [{lower:g}, {upper:g}]"
        )
    start = limits.starts[k]
    if k in limits.unbounded:
        q[start : start + 2] = np.cos(value), np.sin(value)
    else:
        q[start] = min(max(value, lower), upper)
