"""A robot's two legs: how far they reach, how fast and how strongly they swing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc.constraints import Limits
from wbc.controllers.effort_bounds import scaled_effort
from wbc.errors import InvalidInputError
from wbc.robot.chains import leg_joints
from wbc.robot.limits import BASE_NV
from wbc.robot.model import Robot, Snapshot, check_robot
from wbc.robot.postures import STANDING
from wbc.rotations import exp_rotation
from wbc.validate import Array, read_only

SIDES = ("left", "right")
# Longest leg, as a ratio of its full length: a straight knee is singular.
STRETCH = 0.98
# Likewise at the default height of a walk: knees stay bent in a long step.
WALKING_STRETCH = 0.905
# Smallest cosine between axes of a leg that count as parallel.
PARALLEL = 0.95
# Shortening of a leg that lifts its foot, as a ratio of its length.
LIFT = 0.1
# Part of torques and ranges that a swing may use; the rest is for the leg's other tasks.
SHARE = 0.8
# Likewise of speeds: while the hip swings, the knee must bend and stretch within the same time.
SPEED_SHARE = 0.5
# Of a foot [m/s^2], where the hip has no effort limit.
MAX_ACCELERATION = 1e4
# rad: smallest heading of a standing robot; less is what feet turned unlike each other leave.
FACING = 1e-3
# Samples of a leg's length over the knee's range.
KNEE_SAMPLES = 33
# A knee's range is symmetric if its sides differ by less than this part of it.
SYMMETRY = 0.15
# Shortest lever of a hip that swings the foot forwards or sideways, as a ratio of the leg's length.
MIN_LEVER = 0.2
# Legs can turn if a hip turns the foot about the vertical by at least this [rad per rad].
MIN_TURN = 0.2
# Largest width by length of a foot that is an edge, to be walked on.
MAX_EDGE_SKEW = 0.2
ORIGIN = read_only(np.zeros(3))


@dataclass(frozen=True)
class Legs:
    """Sizes and abilities, of the weaker leg, in the standing posture."""

    length: float  # largest distance of the ankle from the hip [m]
    hip_height: float  # of the hip over the ankle [m]
    com_height: float  # of the CoM over the soles [m]
    width: float  # distance of the soles' middles from each other [m]
    sole_width: float  # of the wider sole, from side to side [m]
    # At which the hip can swing a foot forwards, relative to the hip [m/s].
    swing_speed: float
    swing_acceleration: float  # likewise, by the hip's torque and the leg's inertia [m/s^2]
    turn: float  # range of a foot's yaw, either way; 0 if it has none [rad]
    turn_speed: float  # of a foot's yaw [rad/s]
    lift_speed: float  # mean speed at which the knee lifts a foot [m/s]
    # Shortest distance of the ankle from the hip at which the knee bears the robot alone [m].
    bearing_length: float
    gravity: float  # [m/s^2]

    @classmethod
    def of(
        cls, robot: Robot, limits: Limits | None = None, torque_limits: float | None = 1.0
    ) -> Legs:
        """Return the legs of a robot with the feet ``left`` and ``right``.

        Parameters
        ----------
        limits:
            Of the joints, besides the robot's own: speeds, how far hips turn, and accelerations
            that were given.
        torque_limits:
            Factor on the robot's effort limits, as the controller has it; None: no bounds.

        Raises
        ------
        InvalidInputError
            Another number of feet, a base that is fixed, a leg without a knee, or a left foot that
            stands to the right of the right one.
        """
        check_biped(robot)
        snapshot = robot.snapshot(robot.postures[STANDING])
        effort = scaled_effort(robot, torque_limits)
        legs = [_leg(robot, side, limits, effort) for side in SIDES]
        places = [snapshot.position(robot.feet[side].frame) for side in SIDES]
        ahead = np.sum([snapshot.rotation(robot.feet[side].frame)[:, 0] for side in SIDES], axis=0)
        separation = places[0] - places[1]
        if ahead[0] * separation[1] - ahead[1] * separation[0] <= 0.0:
            links = [robot.feet[side].link for side in SIDES]
            raise InvalidInputError(
                f"biped: the left foot of {robot.name}, {links[0]}, does not stand to the left of"
                f" the right one, {links[1]}; exchange them in feet, or turn their frames: x is"
                " ahead"
            )
        soles = [np.ptp(robot.feet[side].polygon[:, 1]) for side in SIDES]
        weaker = {name: min(leg[name] for leg in legs) for name in legs[0]}
        weaker["bearing_length"] = max(leg["bearing_length"] for leg in legs)
        return cls(
            com_height=float(snapshot.com[2] - np.mean([place[2] for place in places])),
            width=float(np.linalg.norm(places[0][:2] - places[1][:2])),
            sole_width=float(max(soles)),
            gravity=robot.gravity,
            **weaker,
        )

    def reach(self, com_height: float) -> float:
        """Return how far the ankle can be from below the hip [m], with the CoM at this height.

        Raises
        ------
        InvalidInputError
            The legs do not reach the ground.
        """
        hip_height = self.hip_height + com_height - self.com_height
        max_length = STRETCH * self.length
        if not 0.0 < hip_height < max_length:
            max_height = self.com_height + max_length - self.hip_height
            raise InvalidInputError(
                f"gait, height: with the CoM at {com_height:g} m the legs do not reach the ground"
                f" with bent knees; give more than {max_height - max_length:.3f} and less than"
                f" {max_height:.3f} m"
            )
        return math.sqrt(max_length**2 - hip_height**2)

    def com_height_for(self, reach: float) -> float:
        """Return how high the CoM can be if the ankle is ``reach`` from below the hip [m].

        The inverse of :meth:`reach`; a leg reaches no farther than its length.
        """
        max_length = STRETCH * self.length
        return self.com_height - self.hip_height + math.sqrt(max(max_length**2 - reach**2, 0.0))


def check_biped(robot: Robot) -> None:
    """Refuse robots that are no bipeds.

    Raises InvalidInputError: no robot, one on a fixed base, or one whose feet are not ``left`` and
    ``right`` with soles.
    """
    check_robot("biped, robot", robot)
    if set(robot.feet) != set(SIDES):
        feet = ", ".join(robot.feet) or "none"
        raise InvalidInputError(
            f"biped: two feet are expected, left and right; {robot.name} has: {feet}. Name them"
            " in Robot.load(..., feet={'left': ..., 'right': ...})"
        )
    points = [
        foot.link
        for foot in robot.feet.values()
        if len(foot.polygon) < 3
        and np.ptp(foot.polygon[:, 1]) >= MAX_EDGE_SKEW * np.ptp(foot.polygon[:, 0])
    ]
    if points:
        raise InvalidInputError(
            f"biped: soles to stand on are expected; {robot.name} touches the ground in points,"
            f" or along edges across its way, with {', '.join(points)}. Give polygons:"
            " Robot.load(..., feet={'left': {'link': ..., 'polygon': [[x, y], ...], 'height': ...},"
            " ...})"
        )
    if robot.fixed_base:
        raise InvalidInputError(f"biped: the base of {robot.name} is fixed; load it floating")


def hip_and_ankle(snapshot: Snapshot, side: str) -> Array:
    """Return the places of a leg's hip and ankle (2, 3) [m], wherever its file draws them."""
    down = leg_joints(snapshot.robot, side)
    R, p = snapshot.joint_placements
    return np.array([p[k[0]] + R[k[0]] @ _nearest_to_next(snapshot, k) for k in (down, down[::-1])])


def bearing_joints(robot: Robot) -> NDArray[np.int64]:
    """Return the indices among the joints' torques (k,) of hips and knees that have motors."""
    joints = list[int]()
    for side in SIDES:
        leg = leg_joints(robot, side)
        joints += leg[: leg.index(knee_of(robot, side)) + 1]
    found = [robot.model.idx_vs[joint] - BASE_NV for joint in joints]
    driven = [k for k in found if robot.joint_names[k] not in robot.unactuated]
    return np.array(driven, dtype=np.int64)


def _leg(robot: Robot, side: str, given: Limits | None, effort: Array) -> dict[str, float]:
    """Return what :class:`Legs` has of one leg, by name."""
    joints = leg_joints(robot, side)
    if len(joints) < 3:
        raise InvalidInputError(
            f"biped: the {side} leg of {robot.name} has {len(joints)} joints of its own; walking"
            " takes a hip, a knee and an ankle"
        )
    snapshot = robot.snapshot(robot.postures[STANDING])
    knee, angles, lengths = _knee(robot, side)
    hips = [int(robot.model.idx_vs[joint]) for joint in joints[: joints.index(knee)]]
    J = _foot_jacobian(snapshot, side)
    columns = [int(robot.model.idx_vs[joint]) for joint in joints]
    for row, which, where in ((0, hips, "forwards"), (1, columns, "to a side")):
        if float(np.abs(J[row, which]).max()) < MIN_LEVER * float(lengths.max()):
            names = [str(robot.model.names[joint]) for joint in joints]
            raise InvalidInputError(
                f"biped: the {side} leg of {robot.name} is {', '.join(names)}; the"
                f" last one is the ankle, and those above the knee cannot swing the foot {where}:"
                " walking takes hips that pitch and roll, a knee and an ankle"
            )
    swing_hip = max(hips, key=lambda k: abs(float(J[0, k])))
    yaw_hip = max(hips, key=lambda k: abs(float(J[5, k])))
    lever, hip = abs(float(J[0, swing_hip])), swing_hip - BASE_NV
    inertia = float(snapshot.mass_matrix[swing_hip, swing_hip])
    limits, turn, turn_speed = robot.limits, 0.0, 0.0
    with np.errstate(divide="ignore", invalid="ignore"):  # damping may leave no torque before
        speed = np.fmin(limits.velocity, effort / robot.damping)
    limit = MAX_ACCELERATION
    if given is not None:
        speed = np.fmin(speed, given.speed)
        if not given.by_default:
            fastest = given.acceleration if given.speed_up is None else given.speed_up
            limit = min(limit, float(fastest[hip]) * lever)
    if abs(J[5, yaw_hip]) > MIN_TURN:
        yaw, angle = yaw_hip - BASE_NV, float(snapshot.joint_positions[yaw_hip - BASE_NV])
        ranges = (limits,) if given is None else (limits, given)
        room = min(min(one.upper[yaw] - angle, angle - one.lower[yaw]) for one in ranges)
        turn = SHARE * max(float(room), 0.0)
        turn_speed = SHARE * float(speed[yaw])
    lift = LIFT * float(lengths.max())
    low, high = (
        _knee_angle(angles, lengths, part * lengths.max())
        for part in (WALKING_STRETCH, WALKING_STRETCH - LIFT)
    )
    if high == low:
        raise InvalidInputError(
            f"biped: the knee of {robot.name}'s {side} leg, {robot.model.names[knee]}, does not"
            f" shorten it to {100.0 * (WALKING_STRETCH - LIFT):.0f} % of its length, which lifts a"
            " foot; is its range right?"
        )
    bends = int(robot.model.idx_vs[knee]) - BASE_NV
    return {
        "length": float(lengths.max()),
        "hip_height": float(_leg_vectors(robot, joints, [snapshot.q])[0, 2]),
        "swing_speed": SPEED_SHARE * float(speed[hip]) * lever,
        "swing_acceleration": min(SHARE * float(effort[hip]) / inertia * lever, limit),
        "turn": turn,
        "turn_speed": turn_speed,
        "lift_speed": SHARE * float(speed[bends]) * lift / abs(high - low),
        "bearing_length": _bearing_length(robot.weight, float(effort[bends]), angles, lengths),
    }


def _foot_jacobian(standing: Snapshot, side: str) -> Array:
    """Return a standing foot's Jacobian (6, nv), x ahead, wherever the file has the robot face."""
    J, heading = standing.jacobian(standing.robot.feet[side].frame), standing_heading(standing)
    if not heading:
        return J
    R = exp_rotation(np.array((0.0, 0.0, -heading)))
    return np.concatenate((R @ J[:3], R @ J[3:]))


def heading_of(rotations: Iterable[Sequence[Sequence[float]] | Array]) -> float:
    """Return the mean heading of frames' x axes [rad]."""
    x, y, _ = np.sum([[row[0] for row in R] for R in rotations], axis=0).tolist()
    return math.atan2(y, x)


def standing_heading(standing: Snapshot) -> float:
    """Return where the feet point together [rad]; 0 where soles turned outwards leave a rest."""
    heading = heading_of(standing.rotation(foot.frame) for foot in standing.robot.feet.values())
    return heading if abs(heading) > FACING else 0.0


def knee_bends(robot: Robot, length: float) -> dict[str, float]:
    """Return the angle [rad] of each knee at which the leg has this length [m].

    Knees bend to the side with more range, within it; those with a symmetric range, or none in the
    file, bend ahead, as a human's.
    """
    bends = {}
    for side in SIDES:
        knee, angles, lengths, _ = _knee_branch(robot, side)
        bends[str(robot.model.names[knee])] = _knee_angle(angles, lengths, length)
    return bends


def knees_one_way(robot: Robot) -> Robot:
    """Return a robot whose knees bend only to the side of :func:`knee_bends`.

    Knees with a symmetric range could otherwise bend backwards where a leg is nearly straight.
    """
    limits = robot.limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    for side in SIDES:
        knee, angles, lengths, symmetric = _knee_branch(robot, side)
        k = int(robot.model.idx_vs[knee]) - BASE_NV
        if symmetric and k not in limits.unbounded:
            standing = float(limits.joint_positions(robot.postures[STANDING])[k])
            if lengths[0] > lengths[-1]:
                lower[k] = min(angles[0], standing)
            else:
                upper[k] = max(angles[-1], standing)
    if (lower == limits.lower).all() and (upper == limits.upper).all():
        return robot
    return replace(robot, limits=replace(limits, lower=lower, upper=upper))


def _knee_branch(robot: Robot, side: str) -> tuple[int, Array, Array, bool]:
    """Return a leg's knee, its angles and lengths on the side it bends to, and if both are open."""
    knee, angles, lengths = _knee(robot, side)
    straight = int(lengths.argmax())
    symmetric = abs(angles[0] + angles[-1] - 2.0 * angles[straight]) < SYMMETRY * float(
        np.ptp(angles)
    )
    if symmetric:
        standing = robot.snapshot(robot.postures[STANDING])
        foot = _foot_jacobian(standing, side)[:3, robot.model.idx_vs[knee]]
        bends_ahead = -foot[0] > 0.5 * np.linalg.norm(foot)  # the foot goes back, the knee ahead
        branch = slice(straight, None) if bends_ahead else slice(straight + 1)
        angles, lengths = angles[branch], lengths[branch]
    return knee, angles, lengths, bool(symmetric)


def bent_backwards(snapshot: Snapshot) -> bool:
    """Return whether a knee is past straight, on the side to which it does not bend.

    It is straight where the parallel axes of hip, knee and ankle lie in one plane, wherever the
    joints' origins are along them. In the zero posture of some files they do not.
    """
    robot, limits = snapshot.robot, snapshot.robot.limits
    _, origins = snapshot.joint_placements
    for side in SIDES:
        joints = leg_joints(robot, side)
        knee = knee_of(robot, side)
        angular = snapshot.jacobian(robot.feet[side].frame)[3:]
        axes = {joint: angular[:, robot.model.idx_vs[joint]] for joint in joints}
        axis = axes[knee]
        parallel = [joint for joint in joints if abs(axes[joint] @ axis) > PARALLEL]
        if knee not in parallel[1:-1]:  # one that slides has no axis
            continue
        place = parallel.index(knee)
        thigh, shank = np.diff(origins[parallel[place - 1 : place + 2]], axis=0)
        along = (thigh @ axis) * (shank @ axis)
        bend = math.atan2(axis @ np.cross(thigh, shank), thigh @ shank - along)
        k = limits.names.index(str(robot.model.names[knee]))
        middle = 0.5 * float(limits.lower[k] + limits.upper[k])
        if bend * (middle - float(snapshot.joint_positions[k]) + bend) < 0.0:
            return True
    return False


def _knee_angle(angles: Array, lengths: Array, length: float) -> float:
    """Return the angle [rad] at which a leg has a length [m], see :func:`knee_bends`."""
    straight = int(lengths.argmax())
    ahead = angles[-1] - angles[straight] > angles[straight] - angles[0]
    branch = slice(straight, None) if ahead else slice(straight, None, -1)
    shorter = np.maximum.accumulate(-lengths[branch])  # rises along the bend
    return float(np.interp(-length, shorter, angles[branch]))


def bending_joint(robot: Robot, joints: Sequence[int], tip: Array) -> int:
    """Return the joint of a chain that shortens it most over its range: an elbow.

    The chain ends at ``tip`` (3,) [m], in the axes of its last joint.
    """
    return _bending_joint(robot, joints, joints[1:], tip)[0]


def knee_of(robot: Robot, side: str) -> int:
    """Return the joint of a leg that shortens it most."""
    return _knee(robot, side)[0]


@lru_cache(maxsize=16)  # a robot does not change, and is asked several times at the start of a walk
def _knee(robot: Robot, side: str) -> tuple[int, Array, Array]:
    """Return the knee of a leg, angles over its range, and the leg's lengths there."""
    joints = leg_joints(robot, side)
    knee, angles, lengths = _bending_joint(robot, joints, joints[1:-1])
    return knee, read_only(angles), read_only(lengths)


def _bending_joint(
    robot: Robot, joints: Sequence[int], candidates: Sequence[int], tip: Array | None = None
) -> tuple[int, Array, Array]:
    """Return the joint that shortens a chain most, angles over its range, and the lengths there."""
    lengths = {joint: _lengths(robot, joints, joint, tip) for joint in candidates}
    joint = max(lengths, key=lambda joint: float(np.ptp(lengths[joint][1])))
    return joint, *lengths[joint]


def _bearing_length(weight: float, effort: float, angles: Array, lengths: Array) -> float:
    """Return the shortest length of a leg at which its knee bears the weight [m].

    By virtual work a knee at angle q bears F with the torque F dL/dq.
    """
    torque = weight * np.abs(np.gradient(lengths, angles))
    too_weak = lengths[torque > SHARE * effort]
    able = lengths[lengths > too_weak.max()] if too_weak.size else lengths
    return float(able.min()) if able.size else float(lengths.max())


def _leg_vectors(
    robot: Robot, joints: Sequence[int], configurations: Iterable[Array], tip: Array | None = None
) -> Array:
    """Return the vectors (n, 3) from the ankle, or a ``tip`` (3,) in its axes, to the hip [m].

    ``joints`` begin with the hip and end with the ankle.
    """
    standing = robot.snapshot(robot.postures[STANDING])
    hip = _nearest_to_next(standing, joints)
    tip = _nearest_to_next(standing, joints[::-1]) if tip is None else tip
    data, vectors = robot.model.createData(), []  # one for all: creating it takes longer than use
    for q in configurations:
        pin.forwardKinematics(robot.model, data, q)
        vectors.append(data.oMi[joints[0]].act(hip) - data.oMi[joints[-1]].act(tip))
    return np.array(vectors)


def _nearest_to_next(snapshot: Snapshot, joints: Sequence[int]) -> Array:
    """Return the point of a joint's axis (3,), in its axes, that is nearest to the next axis [m].

    A file may draw a joint anywhere along its axis. Axes parallel to it are passed over; its origin
    is returned if all are, or if it slides.
    """
    columns = [snapshot.robot.model.idx_vs[joint] for joint in joints]
    rotations, origins = snapshot.joint_placements
    axis, *others = snapshot.joint_twists[3:, columns].T
    for other, origin in zip(others, origins[joints[1:]], strict=True):
        cosine = float(axis @ other)
        if axis.any() and other.any() and abs(cosine) < PARALLEL:
            away = (origin - origins[joints[0]]) @ (axis - cosine * other)
            return np.asarray(rotations[joints[0]].T @ axis * (away / (1.0 - cosine**2)))
    return ORIGIN


def _lengths(
    robot: Robot, joints: Sequence[int], joint: int, tip: Array | None
) -> tuple[Array, Array]:
    """Return angles over a joint's range, and the chain's lengths there."""
    limits, k = robot.limits, int(robot.model.idx_vs[joint]) - BASE_NV
    bent = np.tile(robot.postures[STANDING], (KNEE_SAMPLES, 1))
    angles = np.linspace(max(limits.lower[k], -np.pi), min(limits.upper[k], np.pi), KNEE_SAMPLES)
    for q, angle in zip(bent, angles.tolist(), strict=True):
        limits.set_joint(q, limits.names[k], angle)
    vectors = _leg_vectors(robot, joints, bent, tip)
    return angles, np.asarray(np.linalg.norm(vectors, axis=1))
