"""Joint drives: rotor inertia, friction and effort limits, stored in Pinocchio's model.

Pinocchio's mass matrix (``crba``) and inverse dynamics (``rnea``) include the rotor inertia;
damping and dry friction are in neither: they are torques besides M a + bias.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError
from wbc.robot.limits import JointLimits
from wbc.robot.names import matching
from wbc.robot.notes import noted
from wbc.validate import by_name, finite_number

JointValues = float | Mapping[str, float]  # one for all joints, or by name or pattern


def set_drives(
    model: pin.Model,
    *,
    armature: JointValues | None = None,
    damping: JointValues | None = None,
    friction: JointValues | None = None,
    effort: JointValues | None = None,
) -> None:
    """Write given values into ``model``; they override the file's for the joints named.

    Raises UnknownNameError: no joint matches; InvalidInputError: not a finite number, negative, or
    an effort of 0.
    """
    names = [str(model.names[j]) for j in range(2, model.njoints) if model.nvs[j] == 1]
    rates = np.array([model.idx_vs[model.getJointId(name)] for name in names], dtype=int)
    for what, given, files in (
        ("armature", armature, (model.armature,)),
        ("damping", damping, (model.damping,)),
        ("friction", friction, (model.upperDryFrictionLimit, model.lowerDryFrictionLimit)),
        ("effort", effort, (model.upperEffortLimit, model.lowerEffortLimit)),
    ):
        if given is None:
            continue
        for k, value in _by_joint(what, given, names).items():
            for sign, file in zip((1.0, -1.0), files, strict=False):
                file[rates[k]] = sign * value


def _by_joint(what: str, given: JointValues, names: Sequence[str]) -> dict[int, float]:
    entries = by_name(what, given) if isinstance(given, Mapping) else {"*": given} if names else {}
    values = dict[int, float]()
    for pattern, value in entries.items():
        where = what if entries is not given else f"{what} of joint {pattern!r}"
        number = finite_number(where, value, least=0.0)
        if what == "effort" and number == 0.0:
            raise InvalidInputError(f"{where}: a joint without torque is locked; give locked=")
        values |= dict.fromkeys(matching(pattern, names), number)
    return values


def motors_without_effort(limits: JointLimits, motorless: Sequence[str]) -> tuple[str, ...]:
    """Return the joints with a motor whose largest torque or force is not known, in order."""
    return tuple(name for name in limits.without_effort if name not in motorless)


def effort_note(limits: JointLimits, motorless: Sequence[str] = ()) -> tuple[str, ...]:
    """Return a note that names the actuated joints without an effort limit, if there are any."""
    without = motors_without_effort(limits, motorless)
    which = ("any joint",) if without and without == limits.names else without
    return noted(
        "no effort limit is given for {}: torques are not bounded there (effort: ...)", which
    )


def armature_note(model: pin.Model) -> tuple[str, ...]:
    """Return a note of rotor inertias above the whole robot's: a unit, or a ratio not squared.

    The robot's is the largest principal moment about the CoM in the neutral posture, without
    rotors; for prismatic joints its mass.
    """
    data = model.createData()
    pin.ccrba(model, data, pin.neutral(model), np.zeros(model.nv))
    turned, moved = float(np.linalg.eigvalsh(data.Ig.inertia)[2]), float(data.Ig.mass)
    heavy = []
    for j in (j for j in range(2, model.njoints) if model.nvs[j] == 1):
        rotor = float(model.armature[model.idx_vs[j]])
        slides = model.joints[j].shortname().startswith("JointModelP")
        if rotor > (moved if slides else turned):
            heavy.append(f"{model.names[j]} ({rotor:.3g} {'kg' if slides else 'kg m^2'})")
    return noted(
        f"rotor inertias above that of the whole robot ({turned:.2g} kg m^2): {{}}; they are as"
        " felt at the joint, in kg m^2: the rotor's own times the gear ratio squared",
        heavy,
    )
