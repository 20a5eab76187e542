"""Named postures: from an SRDF, from key frames, from the library; and standing on the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError, ModelError
from wbc.polygon import centroid, convex_hull, polygon_margin
from wbc.robot.feet import Foot
from wbc.robot.formats.couplings import Coupling
from wbc.robot.formats.description import State
from wbc.robot.library import NamedRobot
from wbc.robot.limits import BASE_NQ, BASE_NV, JointLimits
from wbc.robot.loops import CLOSED_GAP, Closure
from wbc.robot.names import frame_table, matches, matching
from wbc.robot.notes import noted
from wbc.spatial import skew
from wbc.validate import Array, by_name

NEUTRAL, STANDING, HALF_SITTING = "neutral", "standing", "half_sitting"
SAME_POSTURE = 0.7  # rad or m: a posture whose joints differ more is another one
OFF_DRIVER = 1e-3  # rad or m: more than the rounding of a mimic joint's value in a file
STANCE_WIDTH_COST = 10.0  # rad/m: cost of changing the distance between soles, by joint motion
# Of the CoM's height: two soles farther apart than the first are narrowed to the second.
WIDE_STANCE, NARROWED_STANCE = 0.7, 0.3
LEVEL = 1e-3  # m: corners of soles no further apart than this stand on one ground


def named_postures(
    limits: JointLimits, neutral: Array, states: Mapping[str, State], known: NamedRobot | None
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the postures of a robot by name, not yet set on the ground, and notes.

    ``neutral`` (every joint at 0) and ``standing`` are always there. A robot the library does not
    know stands as its own state ``standing`` or ``half_sitting`` says, or else in the neutral
    posture brought within the limits.
    """
    postures, notes = {NEUTRAL: neutral.copy()}, list[str]()
    for name, state in states.items():
        postures[name], note = _state_posture(limits, neutral, name, state)
        notes += note
    if known is not None:
        q = neutral.copy()
        q[3:BASE_NQ] = known.base_quaternion
        # The user may have locked joints that the library's posture names.
        free = {key: value for key, value in known.standing.items() if matches(key, limits.names)}
        set_joints(limits, q, free)
        postures[STANDING] = q
    elif STANDING not in postures:
        postures[STANDING] = postures.get(HALF_SITTING, limits.clamped(neutral))
    return postures, tuple(notes)


def rename_neutral(states: Mapping[str, State]) -> tuple[dict[str, State], tuple[str, ...]]:
    """Return states with one that is called ``neutral`` renamed, and a note of it.

    Self-collision, plants and searches rely on ``neutral`` having joints at 0.
    """
    if NEUTRAL not in states:
        return dict(states), ()
    other = f"{NEUTRAL}_2"
    note = f"the file's posture {NEUTRAL!r} is called {other!r}: in {NEUTRAL!r} joints are at 0"
    return {other if name == NEUTRAL else name: state for name, state in states.items()}, (note,)


def _state_posture(
    limits: JointLimits, neutral: Array, name: str, state: State
) -> tuple[Array, tuple[str, ...]]:
    """Return the posture of a state; joints that the model does not have (locked) are skipped."""
    q = neutral.copy()
    outside = []
    for joint, values in state.items():
        if len(values) == BASE_NQ:
            q[:BASE_NQ] = values
            q[3:BASE_NQ] /= np.linalg.norm(q[3:BASE_NQ])
        if joint not in limits.names:
            continue
        value = values[0] if len(values) == 1 else float(np.arctan2(values[1], values[0]))
        k = limits.names.index(joint)
        inside = limits.nearest(k, value)
        if abs(inside - value) > 1e-6:  # more than the file's rounding
            outside.append(joint)
        limits.set_joint(q, joint, inside)
    told = f"posture {name!r}: brought within the limits: {{}}"
    return q, noted(told, outside, len(outside))


def set_joints(limits: JointLimits, q: Array, joints: Mapping[str, float]) -> None:
    """Write joint values into ``q``; keys are joint names or patterns such as ``left_*``.

    Raises UnknownNameError: a key matches no joint; InvalidInputError: a value is not finite or
    outside the joint's limits.
    """
    for pattern, value in by_name("joints", joints).items():
        for k in matching(pattern, limits.names):
            limits.set_joint(q, limits.names[k], value)


def set_mimic_joints(limits: JointLimits, q: Array, couplings: Mapping[str, Coupling]) -> None:
    """Set mimic joints in ``q`` by their drivers, as far as their limits allow."""
    for joint, coupling in couplings.items():
        driver = q[limits.starts[limits.names.index(coupling.driver)]]
        k = limits.names.index(joint)
        q[limits.starts[k]] = limits.nearest(k, coupling.value(float(driver)))


def couple_postures(
    limits: JointLimits,
    postures: Mapping[str, Array],
    states: Mapping[str, State],
    couplings: Mapping[str, Coupling],
) -> tuple[str, ...]:
    """Set mimic joints in all postures but ``neutral``, in place.

    Return notes of values in the file's ``states`` that are not where their drivers put them.
    """
    notes = tuple[str, ...]()
    for name, q in postures.items():
        if name == NEUTRAL:
            continue
        before = limits.joint_positions(q.copy())  # which may be a view
        set_mimic_joints(limits, q, couplings)
        after, said = limits.joint_positions(q), states.get(name, {})
        moved = [
            f"{joint} at {after[k]:.4g}, not {before[k]:.4g}"
            for k, joint in enumerate(limits.names)
            if joint in said and joint in couplings and abs(after[k] - before[k]) > OFF_DRIVER
        ]
        told = f"posture {name!r}: joints follow their drivers in place of the file's values: {{}}"
        notes += noted(told, moved)
    return notes


def close_postures(
    closure: Closure, postures: dict[str, Array], drawn: State, path: Path
) -> tuple[str, ...]:
    """Close the loops in all postures, in place; return notes of those that stay open.

    ``standing`` is closed starting from itself, or from the file's initial joints. Without loops,
    its drivers move where mimic joints cannot follow; other postures do not change.
    """
    open_ones = []
    for name, q in postures.items():
        off = np.abs(closure.errors(q)[0]).max(initial=0.0) > CLOSED_GAP
        if not closure.loops and (name != STANDING or not off):
            continue
        try:
            postures[name] = closure.closed(q)
        except InvalidInputError as error:
            if name != STANDING:
                open_ones.append(name)
                continue
            other, _ = _state_posture(closure.limits, q, name, drawn)
            try:
                postures[name] = closure.closed(other)
            except InvalidInputError:
                raise ModelError(f"{path}: posture {name!r}: {error}") from error
    told = "loops are open in the postures {}, and none near closes them"
    return noted(told, open_ones, len(open_ones))


def put_on_ground(model: pin.Model, q: Array, feet: Mapping[str, Foot]) -> Array:
    """Return ``q`` raised or lowered so that the lowest corner of the soles is at z = 0.

    Without feet nothing is moved.
    """
    if not feet:
        return q
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    q = q.copy()
    q[2] -= float(_sole_corners(model, data, feet)[:, 2].min())
    return q


def is_standing(model: pin.Model, q: Array, feet: Mapping[str, Foot]) -> bool:
    """Return whether all soles are level with one ground and the CoM is above their hull."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    corners = _sole_corners(model, data, feet)
    if np.ptp(corners[:, 2]) > LEVEL:
        return False
    hull = convex_hull(corners[:, :2])
    com = pin.centerOfMass(model, data, q)
    above = com[2] > corners[:, 2].max()
    return len(hull) > 2 and bool(above) and float(polygon_margin(hull, com[:2])) > 0.0


def settle_on_ground(
    closure: Closure, q: Array, feet: Mapping[str, Foot], com: Array | None = None
) -> tuple[Array, tuple[str, ...]]:
    """Return a posture near ``q`` that is_standing on all feet, or ``q`` itself and a note.

    Damped Gauss-Newton on the heights and tilts of the soles and on the CoM over the middle of
    their hull; joints stay within their limits, and those held only by springs do not move. A cost
    keeps the soles' distance, but legs that are drawn far apart are brought together if possible.

    ``closure``: of the model and limits, which has the frames of the soles.
    ``com``: where the CoM shall be (2,) [m], from the middle of the soles' hull; None: in the
    middle, unless ``q`` stands.
    """
    model, limits = closure.model, closure.limits
    if not feet or (com is None and is_standing(model, q, feet)):
        return q, ()
    apart, height = _stance_vector(model, q, feet)
    astride = len(feet) == 2 and math.hypot(*apart) > WIDE_STANCE * height
    for goal in [NARROWED_STANCE * height, None] if astride else [None]:
        found = _level_soles(closure, q, feet, com, goal)
        far = np.abs(limits.joint_positions(found) - limits.joint_positions(q)).max(initial=0.0)
        is_closed = not closure.binds or float(np.abs(closure.errors(found)[0]).max()) <= CLOSED_GAP
        if far < SAME_POSTURE and is_closed and is_standing(model, found, feet):
            return found, ()
    corners = sum(len(foot.polygon) for foot in feet.values())
    why = "no posture near it balances on level soles"
    if corners < 3:
        why = "its feet are points: no flat underside was found; give link, polygon and height"
    return q, (f"posture 'standing' does not stand: {why}",)


def _level_soles(
    closure: Closure, q: Array, feet: Mapping[str, Foot], com: Array | None, together: float | None
) -> Array:
    """Return a posture (nq,) near ``q`` on level soles, or the search's last one.

    ``together``: wanted distance of two soles [m]; None: a cost keeps their distance.
    """
    found, model, limits = q.copy(), closure.model, closure.limits
    held = [BASE_NV + limits.names.index(joint) for joint in closure.sprung]
    dear = STANCE_WIDTH_COST if together is None else 0.0
    for _ in range(100):
        error, J, places = _standing_error(model, found, feet)
        if com is not None:
            error[:2] -= com
        if together is not None:
            way = _stance_vector(model, found, feet)[0]
            size = math.hypot(*way)
            error = np.append(error, size - together)
            J = np.vstack((J, way / size @ (places[:2] - places[2:])))
        if closure.binds:
            error, J = (
                np.concatenate(both) for both in zip((error, J), closure.errors(found), strict=True)
            )
        J[:, held] = 0.0
        cheap = np.linalg.solve(np.eye(model.nv) + dear**2 * places.T @ places, J.T)
        step = cheap @ np.linalg.solve(J @ cheap + 1e-6 * np.eye(len(J)), error)
        step *= -min(1.0, 0.2 / max(float(np.abs(step).max()), 1e-12))  # rad or m
        found = limits.clamped(pin.integrate(model, found, step))
        if float(np.abs(error).max()) < 1e-7:
            break
    if closure.binds:
        with suppress(InvalidInputError):  # or it does not stand
            found = closure.closed(found)
    return found


def _stance_vector(model: pin.Model, q: Array, feet: Mapping[str, Foot]) -> tuple[Array, float]:
    """Return the vector (2,) from the second sole to the first, and the CoM's height over them.

    Zero unless there are two feet.
    """
    data, frames = model.createData(), frame_table(model)
    com = pin.centerOfMass(model, data, q)
    pin.updateFramePlacements(model, data)
    places = np.array([data.oMf[frames[foot.frame]].translation for foot in feet.values()])
    way = (places[0] - places[1])[:2] if len(places) == 2 else np.zeros(2)
    return way, float(com[2] - places[:, 2].mean())


def com_from_middle(model: pin.Model, q: Array, feet: Mapping[str, Foot]) -> Array:
    """Return where the CoM is (2,) [m], seen from the middle of the soles' hull, world axes."""
    return _standing_error(model, q, feet)[0][:2]


def _standing_error(
    model: pin.Model, q: Array, feet: Mapping[str, Foot]
) -> tuple[Array, Array, Array]:
    """Return the standing error (k,) [m, rad] of ``q`` and its Jacobian (k, nv).

    Then the Jacobian (2 feet, nv) of the soles' horizontal positions from their middle.
    """
    data, frames = model.createData(), frame_table(model)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    com_jacobian = pin.jacobianCenterOfMass(model, data, q)
    hull = convex_hull(_sole_corners(model, data, feet)[:, :2])
    error = [data.com[0][:2] - centroid(hull)]
    rows, places = [], []
    for foot in feet.values():
        index = frames[foot.frame]
        J = pin.getFrameJacobian(model, data, index, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        places.append(J[:2])
        pose = data.oMf[index]
        error.append(pose.translation[2:])
        rows.append(J[2:3])
        if len(foot.polygon) > 1:  # a point has no tilt
            normal = pose.rotation[:, 2]
            error.append(normal[:2])
            rows.append(-(skew(normal) @ J[3:])[:2])
    middle = np.mean(places, axis=0)
    J = np.concatenate([com_jacobian[:2] - middle, *rows])
    return np.concatenate(error), J, np.concatenate(places - middle)


def _sole_corners(model: pin.Model, data: pin.Data, feet: Mapping[str, Foot]) -> Array:
    """Return the corners of all soles (k, 3) in the world, frames being placed in ``data``."""
    frames = frame_table(model)
    corners = []
    for foot in feet.values():
        pose = data.oMf[frames[foot.frame]]
        corners.append(foot.polygon @ pose.rotation[:, :2].T + pose.translation)
    return np.concatenate(corners)
