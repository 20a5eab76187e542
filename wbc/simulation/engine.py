"""MuJoCo itself: loaded on demand, its warnings as errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wbc.errors import WbcError
from wbc.robot.tree import LARGEST

# MuJoCo's warnings of an unusable state, and the quantity that they are about.
_STATES = {
    "mjWARN_BADQPOS": "position",
    "mjWARN_BADQVEL": "velocity",
    "mjWARN_BADQACC": "acceleration",
}


class SimulationError(WbcError):
    """The physics cannot go on, or cannot be set up.

    Parameters
    ----------
    what:
        What is wrong, and what to do.
    time:
        Simulated time [s]; None if nothing was simulated.
    joint:
        The joint, or ``base``, that is the cause, if one is.
    """

    def __init__(self, what: str, time: float | None = None, joint: str | None = None) -> None:
        self.time, self.joint = time, joint
        super().__init__(what if time is None else f"simulation at t = {time:.4f} s: {what}")


def check_state(
    mujoco: Any, data: Any, coordinates: Sequence[str], velocities: Sequence[str]
) -> None:
    """Raise an error for MuJoCo's warnings since the reset, and for unusable states.

    ``coordinates``, ``velocities``: joint of each entry of ``qpos`` and ``qvel``.
    """
    if data.warning.number.any():
        _raise_warnings(mujoco, data, coordinates, velocities)
    for what, values, names in (
        ("position", data.qpos, coordinates),
        ("velocity", data.qvel, velocities),
    ):
        if not float(values @ values) <= LARGEST**2:  # nor NaN
            joint = names[int(np.abs(values).argmax())]
            raise SimulationError(
                f"the {what} of {joint!r} is beyond {LARGEST:g}: the simulation blew up",
                float(data.time),
                joint,
            )


def _raise_warnings(
    mujoco: Any, data: Any, coordinates: Sequence[str], velocities: Sequence[str]
) -> None:
    numbers = data.warning.number
    kinds = {name: int(kind) for name, kind in mujoco.mjtWarning.__members__.items()}
    given = {name: k for name, k in kinds.items() if k < len(numbers) and numbers[k]}
    for name, what in _STATES.items():
        if name in given:
            names = coordinates if what == "position" else velocities
            joint = names[int(data.warning.lastinfo[given[name]])]
            raise SimulationError(
                f"the {what} of {joint!r} is not finite or huge: the simulation blew up; look at"
                " the torques, or take a smaller physics_dt",
                float(data.time),
                joint,
            )
    for name in given:
        remedy = {
            "mjWARN_CONTACTFULL": "too many contacts for its memory; use fewer shapes",
            "mjWARN_CNSTRFULL": "too many contacts and limits for its memory; use fewer shapes",
        }.get(name, "see MuJoCo's manual")
        raise SimulationError(f"MuJoCo warned ({name}): {remedy}", float(data.time))
