"""From a target in a problem file to numbers; what is relative is relative to the start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.problem.mistakes import Misplaced
from wbc.problem.target_specs import Offset, Over, QuaternionTarget, Rpy, Scale
from wbc.robot import Robot, Snapshot
from wbc.robot.feet import NO_FEET
from wbc.rotations import rotation_from
from wbc.spatial import DIAGONAL, vech_inverse
from wbc.tasks.inertia import DIAGONAL_COMPONENTS, TRACE, vech_target
from wbc.validate import Array, finite_vector

START = "start"
DOUBLE = ("left", "right")


def point(target: Sequence[float] | Offset | str, start: Array) -> Array:
    """Return a wanted position or direction (3,); ``start`` is what it is at the start."""
    if isinstance(target, str):
        return start
    if isinstance(target, Offset):
        return start + np.array(target.offset)
    return np.array(target)


def centre_of_mass(
    target: Sequence[float] | Offset | Over | str, start: Array, now: Snapshot, before: Array
) -> Array:
    """Return a wanted place of the CoM (3,) [m].

    Parameters
    ----------
    start:
        Where it was at the start of the run (3,).
    now, before:
        The robot when the target is set, and the target until then (3,).

    Raises
    ------
    UnknownNameError
        No such foot.
    """
    if not isinstance(target, Over):
        return point(target, start)
    place = sole_middle(now, feet_under(target, now.robot))
    place[2] = before[2] if target.height is None else target.height
    return place


def feet_under(target: Over, robot: Robot) -> tuple[str, ...]:
    """Return the feet that a target is above, all of which exist."""
    feet = DOUBLE if target.over == "double" else (target.over,)
    for foot in feet:
        if foot not in robot.feet:
            choices = [*robot.feet, *(["double"] if set(DOUBLE) <= set(robot.feet) else [])]
            remedy = "" if robot.feet else NO_FEET
            raise UnknownNameError(f"foot of {robot.name}", target.over, choices, remedy)
    return feet


def sole_middle(snapshot: Snapshot, feet: Sequence[str]) -> Array:
    """Return the mean (3,) of the middles of the soles, which is where their frames are."""
    places = [snapshot.position(snapshot.robot.feet[foot].frame) for foot in feet]
    return np.asarray(np.mean(places, axis=0))


def rotation(target: Rpy | QuaternionTarget | str, start: Array) -> Array:
    """Return a wanted rotation (3, 3).

    Raises
    ------
    Misplaced
        A quaternion without length.
    """
    if isinstance(target, Rpy):
        return _from_rpy(*target.rpy)
    if isinstance(target, QuaternionTarget):
        quaternion = np.array(target.quaternion)
        length = float(np.linalg.norm(quaternion))
        if length < 1e-9:
            raise Misplaced("a quaternion needs some length", "target", "quaternion")
        return rotation_from(quaternion / length)
    return start


def _from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll) (3, 3), the convention of URDF."""
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def inertia(
    target: float | Sequence[float] | Sequence[Sequence[float]] | Scale | str,
    components: Sequence[str],
    start: Array,
) -> Array:
    """Return a wanted inertia (6,) [kg m^2] in the axes of ``start`` (6,).

    Raises
    ------
    Misplaced
        The form does not fit the components, or a moment of inertia is negative.
    """
    if isinstance(target, str):
        return start
    if isinstance(target, Scale):
        return _scaled(target, components, start)
    try:
        entries = vech_target("inertia", np.array(target), components)
    except InvalidInputError as error:
        raise Misplaced(str(error).removeprefix("inertia: "), "target") from None
    _check_moments(entries[DIAGONAL])
    return entries


def _scaled(target: Scale, components: Sequence[str], start: Array) -> Array:
    if isinstance(target.scale, float | int):
        return target.scale * start
    if not set(components) <= {*DIAGONAL_COMPONENTS, *TRACE}:
        raise Misplaced(
            "three factors fit the diagonal only (components: diagonal); give one factor",
            "target",
            "scale",
        )
    scaled = start.copy()
    scaled[DIAGONAL] *= target.scale
    return scaled


def principal_moments(
    target: float | Sequence[float] | Sequence[Sequence[float]] | Scale | str, start: Array
) -> Array:
    """Return wanted principal moments (3,) [kg m^2], smallest first; ``start`` is vech (6,).

    Raises
    ------
    Misplaced
        Not three numbers, or a negative one.
    """
    moments = np.linalg.eigvalsh(vech_inverse(start))
    if isinstance(target, str):
        return moments
    if isinstance(target, Scale):
        return np.sort(moments * np.array(target.scale))
    if np.shape(target) != (3,):
        raise Misplaced("expected the three principal moments, or {scale: ...}", "target")
    wanted = np.sort(np.array(target, dtype=float))
    _check_moments(wanted)
    return wanted


def _check_moments(moments: Array) -> None:
    if (moments < 0.0).any():
        raise Misplaced("a moment of inertia is not negative", "target")


def posture(target: Mapping[str, float] | str, robot: Robot, start: Array) -> Array:
    """Return a wanted configuration (nq,); its base part means nothing.

    Raises
    ------
    UnknownNameError
        No such posture or joint.
    InvalidInputError
        A joint value outside the joint's limits.
    """
    if isinstance(target, str):
        return start if target == START else robot.posture(target)
    return with_joints(robot, start, target)


def with_joints(robot: Robot, q: Array, joints: Mapping[str, float]) -> Array:
    """Return ``q`` with joints, by name or pattern, at the given values [rad or m]."""
    named = robot.posture("neutral", joints)
    chosen = sorted({index for pattern in joints for index in robot.joint_indices(pattern)})
    step = np.zeros(robot.nv)
    step[chosen] = robot.difference(q, named)[chosen]
    return robot.integrate(q, step, 1.0)


def momentum(target: Sequence[float], components: Sequence[str], names: Sequence[str]) -> Array:
    """Return a wanted momentum (6,) from six numbers or one for each component.

    Raises
    ------
    Misplaced
        Another number of numbers.
    """
    if len(target) == len(names):
        return finite_vector("momentum", target, len(names))
    if len(target) != len(components):
        raise Misplaced(
            f"needs {len(components)} entries ({', '.join(components)}) or all {len(names)}, "
            f"got {len(target)}",
            "target",
        )
    full = np.zeros(len(names))
    full[[names.index(component) for component in components]] = target
    return full
