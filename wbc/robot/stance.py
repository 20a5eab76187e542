"""The stance of a robot: feet, base and standing posture, which depend on each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.feet import Foot, FootSpec, find_feet
from wbc.robot.foot_guess import (
    ARM_WORDS,
    BELOW_BASE,
    bodies_of,
    facing_ahead,
    foot_of,
    rolling_joints,
    upright,
    words_of,
)
from wbc.robot.formats.description import Description, GeometrySource
from wbc.robot.library import RobotSource
from wbc.robot.limits import JointLimits
from wbc.robot.loops import Closure
from wbc.robot.model_checks import link_of
from wbc.robot.notes import noted
from wbc.robot.postures import (
    STANDING,
    com_from_middle,
    is_standing,
    put_on_ground,
    settle_on_ground,
)
from wbc.robot.sole import lowest_point
from wbc.validate import Array, by_name

# m: a shape this much lower than the soles touches the ground first.
BELOW_SOLES = 5e-3
# rad or m: nearer than this to an end of its range a joint is at it.
AT_END = 0.01
OFF_MIDDLE = 0.02  # m: farther from the feet's middle the CoM is set above it
LOW_JOINTS = 0.3  # of the CoM's height: shapes of lower joints are checked


Feet = Mapping[str, FootSpec | Mapping[str, Any]]  # as users give them


class StandingPose(NamedTuple):
    """The stance of a robot."""

    q: Array  # (nq,) standing posture, on the ground
    feet: Mapping[str, Foot]
    bolted: bool  # whether its base is fixed
    notes: tuple[str, ...]  # what was guessed or turned, in words


def arm_reason(model: pin.Model, geometry: GeometrySource, q: Array) -> str:
    """Return why a robot without feet is an arm (or a hand) bolted down, in words; empty if not.

    One joint carries all others and none is below the base as legs are; or the root link's name
    tells (``base`` does not of what has wheels, or links called feet). ``q`` (nq,) has the base
    upright.
    """
    root = next((str(frame.name) for frame in bodies_of(model) if frame.parentJoint == 1), "")
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    stands = any(foot_of(frame.name) for frame in bodies_of(model) if frame.parentJoint > 1)
    rolls = bool(rolling_joints(model, data, geometry))
    if words_of(root) & ARM_WORDS or (root == "base" and not (stands or rolls)):
        return f"the root link is called {root!r}"
    if list(model.parents).count(1) != 1:
        return ""
    heights = [pose.translation[2] for pose in data.oMi][1:]
    above = min(heights) > heights[0] - BELOW_BASE
    return "the root link carries a single arm" if above else ""


def find_stance(
    found: RobotSource,
    description: Description,
    feet: Feet | None,
    base: str | None,
    closure: Closure,
    q: Array,
) -> StandingPose:
    """Return the stance of a robot near posture ``q`` (nq,).

    ``feet``, ``base``: as in :meth:`wbc.robot.Robot.load`; ``closure``: of the model, to which sole
    frames are added, and of its loops, which are closed in ``q``.
    """
    model, notes = closure.model, tuple[str, ...]()
    specs = found.known.feet if found.known else {} if base == "fixed" else None  # None: guess
    if feet is not None:
        specs = {name: FootSpec.of(name, spec) for name, spec in by_name("feet", feet).items()}
    if found.known is None:
        links = None if specs is None else {name: one.link for name, one in specs.items()}
        q, turned = upright(model, q, links)
        notes = (turned,) if turned else ()
        ahead = q if turned else facing_ahead(model, q, links)
    else:
        ahead = q
    soles, foot_notes = find_feet(model, description.geometry, specs, ahead)
    bolted = None
    if description.mounted:
        if base == "floating":
            raise ModelError(
                f"{found.path}: base: floating: the root moves by joints of its own, and what they"
                " are on has no mass; give the root a free joint instead"
            )
        bolted = "the root moves by joints of its own"
        if base is None:
            foot_notes = (*foot_notes, f"the base is fixed, since {bolted}")
    elif base is None:
        if not soles:  # neither feet nor the user tell
            bolted = description.bolted
            bolted = arm_reason(model, description.geometry, q) if bolted == "" else bolted
            reason = f"{bolted} and there are no feet"
        if not bolted and description.bolted is not None and _is_mount(model):
            bolted = reason = "the root has no mass and moves by a joint"
        elif soles and description.bolted:
            told = f"the base floats, as there are feet, though {description.bolted}"
            foot_notes = (f"{told}; base: fixed bolts it", *foot_notes)
    if bolted and not description.mounted:
        foot_notes = (f"the base is fixed, since {reason}; base: floating lets it float",)
    notes += foot_notes
    if found.known is None:
        # Knees whose ranges do not have 0 put feet ahead of the hips, or behind them.
        ends = _at_ends(closure.limits, q)
        bent = len(soles) > 2 and ends[_bearing(model, closure.limits, soles)].any()
        bent = bent and np.linalg.norm(com_from_middle(model, q, soles)) > OFF_MIDDLE
        q, unsettled = settle_on_ground(closure, q, soles, np.zeros(2) if bent else None)
        if bent and unsettled:  # knees alone do not move it there
            q, unsettled = settle_on_ground(closure, q, soles)
        notes += unsettled
    q = put_on_ground(model, q, soles)
    if found.known is None:
        notes += _notes_below_soles(model, description.geometry, q, soles)
        notes += _notes_at_ends(closure.limits, q) if soles else ()
    return StandingPose(q, soles, base == "fixed" or bool(bolted), notes)


def _is_mount(model: pin.Model) -> bool:
    """Return whether the root has no mass and one joint: floating, it would move twice that way."""
    return bool(model.inertias[1].mass == 0.0) and list(model.parents).count(1) == 1


def stance_from_postures(
    found: RobotSource,
    description: Description,
    postures: Mapping[str, Array],
    feet: Feet | None,
    base: str | None,
    closure: Closure,
) -> StandingPose:
    """Return :func:`find_stance` from ``standing`` or, if that does not stand, from a key frame.

    The first of the file's that stands is taken, with a note; ``postures`` are all by name.
    """
    tried = partial(find_stance, found, description, feet, base)
    names = [name for name in description.states if name in postures and name != STANDING]
    if found.known is not None or STANDING in description.states or not names:
        return tried(closure, postures[STANDING])
    for name in (STANDING, *names):
        there = replace(closure, model=closure.model.copy())
        pose = tried(there, postures[name])
        if pose.bolted or (pose.feet and is_standing(there.model, pose.q, pose.feet)):
            break
    else:
        name = STANDING
    pose = tried(closure, postures[name])
    if name == STANDING:
        return pose
    note = f"'standing' is the key frame {name!r}, since the neutral posture does not stand"
    return pose._replace(notes=(note, *pose.notes))


def _at_ends(limits: JointLimits, q: Array) -> Array:
    """Return which joints' ranges do not have 0, and begin or end where ``q`` has them (bool)."""
    ends = np.clip(0.0, limits.lower, limits.upper)
    return (ends != 0.0) & (np.abs(q[list(limits.starts)] - ends) < AT_END)


def _bearing(model: pin.Model, limits: JointLimits, feet: Mapping[str, Foot]) -> list[int]:
    """Return the places in ``limits`` of the legs' joints."""
    soles = [model.frames[model.getFrameId(foot.frame)].parentJoint for foot in feet.values()]
    legs = {str(model.names[joint]) for sole in soles for joint in model.supports[sole]}
    return [k for k, name in enumerate(limits.names) if name in legs]


def _notes_at_ends(limits: JointLimits, q: Array) -> tuple[str, ...]:
    """Return notes of joints whose ranges do not have 0, and begin or end where ``q`` has them."""
    held = _at_ends(limits, q)
    told = "'standing' has {} at an end of their ranges; bend them: posture('standing', joints=...)"
    return noted(told, [name for name, one in zip(limits.names, held, strict=True) if one])


def _notes_below_soles(
    model: pin.Model, geometry: GeometrySource, q: Array, feet: Mapping[str, Foot]
) -> tuple[str, ...]:
    """Return notes of shapes that are lower than the soles, or as low."""
    if not feet:
        return ()
    soles = {int(model.frames[model.getFrameId(foot.frame)].parentJoint) for foot in feet.values()}
    parents = [int(parent) for parent in model.parents]
    beside = {parents[sole] for sole in soles} - {0, 1}
    near = {joint for joint, parent in enumerate(parents) if parent in soles and joint > 1}
    near |= {joint for joint, parent in enumerate(parents) if parent in beside} - soles
    data = model.createData()
    high = LOW_JOINTS * float(pin.centerOfMass(model, data, q)[2])
    # A hexapod's feet are fixed to its shanks.
    high = max([high, *(float(data.oMi[joint].translation[2]) + BELOW_SOLES for joint in soles)])
    near |= {k for k in range(2, model.njoints) if data.oMi[k].translation[2] < high} - soles
    heights = {joint: lowest_point(model, data, geometry, joint) for joint in sorted(near)}
    lower = [
        f"{link_of(model, joint)} by {-1e3 * height:.0f} mm"
        for joint, height in heights.items()
        if height < -BELOW_SOLES
    ]
    level = [
        link_of(model, joint) for joint, height in heights.items() if abs(height) <= BELOW_SOLES
    ]
    told = "lower than the soles in 'standing': {}; are these its soles (feet)?"
    return noted(told, lower, len(lower)) + noted(
        "level with the soles in 'standing', and no part of them: {}; feet=... may name them, or"
        " locked=... of their joints make them part",
        level,
        len(level),
    )
