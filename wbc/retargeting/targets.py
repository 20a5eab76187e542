"""A robot's targets in each frame: a human's motion, scaled to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wbc.gait.legs import SIDES, hip_and_ankle
from wbc.retargeting.cop_correction import (
    cop_displacement,
    least_com_displacement,
    load_shares,
    required_cop,
)
from wbc.retargeting.footsteps import FootPath, FootPaths, foot_paths, yaw_pitch_rotations
from wbc.retargeting.robot_setup import RobotSetup
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.source import HumanFrames
from wbc.robot import Robot
from wbc.robot.postures import STANDING
from wbc.spatial import vech_inverse
from wbc.validate import Array, Bools

# Where legs do not reach, the CoM is lowered and steps are shortened: the least sum of squares of
# the lowering by this part of the legs' length and of the shortening by this part of the steps.
LOWERING_UNIT, SHORTENING_UNIT = 0.05, 0.2
MIN_STEP_SCALE = 0.5  # of the human's scaled horizontal distances
STEP_SCALES = 26  # candidates between MIN_STEP_SCALE and 1
MAX_LEG_EXTENSION = 0.985  # of standing legs, by their full length
STRAIGHT_WALK = 0.9  # distance of the CoM between both ends by the length of its path
# The CoM's displacement for balance saturates at this part of its height, as (1 + x^p)^(-1/p).
MAX_DISPLACEMENT, SATURATION_POWER = 0.15, 8
# Its standard deviation along an axis by the human CoM's: a third makes both correlate by 0.95.
MAX_DEVIATION = 0.3
NOTED_WIDENING = 5e-4  # m
MAX_FORWARD_SHIFT = 0.08  # of the CoM over the feet, by the legs' length


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of n frames, the robot's own size and time, its ground at z = 0."""

    time: Array  # (n,) [s], even
    com: Array  # (n, 3) [m]
    angular_momentum: Array  # about the CoM (n, 3) [kg m^2/s]
    rotation: Mapping[str, Array]  # of the robot's frames for pelvis, trunk and head (n, 3, 3)
    arms: Mapping[str, Array]  # directions of upper arm and forearm (n, 2, 3), by side
    inertia: Array  # the human's, scaled (n, 3, 3) [kg m^2]
    feet: FootPaths  # paths of the soles
    # the human's CoM (n, 3) [m], scaled, before it was moved for balance, reach and arms' mass
    human_com: Array
    cop: Array  # of the targets, inside the feet that stand (n, 2) [m]; NaN in the air
    notes: tuple[str, ...]  # what was changed

    @property
    def down(self) -> Bools:
        """Which feet touch the ground (n, 2), left and right."""
        return self.feet.down

    @property
    def dt(self) -> float:
        """[s]."""
        return float(self.time[1] - self.time[0])


def scaled_targets(
    source: HumanFrames, setup: RobotSetup, scale: MotionScale, balance: bool
) -> Targets:
    """Return a robot's targets; with ``balance`` the CoM is moved so that the CoP is feasible."""
    series, robot, body = source.series, setup.robot, setup.body
    dt = scale.time * float(series.time[1] - series.time[0])
    pelvis = source.rotation["pelvis"] @ body.upright[body.pelvis]
    feet = foot_paths(source, setup, _step_scaling(source, scale, 1.0))
    step_scale, lowering, notes = _step_scale_and_lowering(source, setup, scale, pelvis, feet)
    scaling = _step_scaling(source, scale, step_scale)
    if step_scale < 1.0:
        feet = foot_paths(source, setup, scaling)
    com = _scaled_com(source, setup, scale, scaling)
    human_com = com.copy()
    com[:, 2] += _arm_rise(source, setup, scale) - lowering
    if feet.widening > NOTED_WIDENING:
        why = "for legs that cannot roll the soles" if feet.line_feet else "to pass each other"
        notes += (f"feet set {1e3 * feet.widening:.0f} mm farther outwards each, {why}",)
    notes += feet.notes
    k = scale.angular_momentum * series.momentum[:, 3:]
    rotation = {body.pelvis: pelvis}
    for part, frame in (("trunk", body.trunk), ("head", body.head)):
        if frame is not None and frame not in rotation:
            rotation[frame] = source.rotation[part] @ body.upright[frame]
    targets = Targets(
        time=dt * np.arange(len(source), dtype=float),
        com=com,
        angular_momentum=k,
        rotation=rotation,
        arms={side: source.arms[side] for side in body.arms},
        inertia=scale.inertia * np.array([vech_inverse(one) for one in series.inertia]),
        feet=feet,
        human_com=human_com,
        cop=np.full((len(source), 2), np.nan),
        notes=notes,
    )
    return balance_com(targets, robot, k) if balance else targets


def balance_com(targets: Targets, robot: Robot, k: Array, com: Array | None = None) -> Targets:
    """Return targets with the CoM moved so that the CoP is inside the feet that stand.

    ``k``: angular momentum (n, 3) of the robot, or of its targets [kg m^2/s].
    ``com``: CoM (n, 3) of the robot [m]; None: of the targets.
    """
    dt = targets.dt
    k_rate = np.gradient(k, dt, axis=0)
    cop, time_constant_sq = required_cop(
        targets.com if com is None else com, k_rate, robot.mass, robot.gravity, dt
    )
    # The displacement is relative to the human's CoM: an earlier one may be taken back.
    before = targets.com[:, :2] - targets.human_com[:, :2]
    undisplaced = cop - cop_displacement(before, time_constant_sq, dt)
    guess = np.where(np.isfinite(targets.cop), targets.cop, undisplaced)  # an earlier goal
    e, goal = least_com_displacement(
        undisplaced, time_constant_sq, dt, targets.feet.supports, guess
    )
    # A motion that cannot be balanced must not drag the CoM far from the human's,
    ratio = np.linalg.norm(e, axis=1) / (MAX_DISPLACEMENT * float(np.mean(targets.com[:, 2])))
    e /= ((1.0 + ratio**SATURATION_POWER) ** (1.0 / SATURATION_POWER))[:, None]
    # nor make it oscillate where the human's hardly moves.
    mean, human = e.mean(axis=0), targets.human_com[:, :2].std(axis=0)
    e -= mean
    e *= np.minimum(1.0, MAX_DEVIATION * human / np.maximum(e.std(axis=0), 1e-12))
    displaced = targets.com.copy()
    displaced[:, :2] = targets.human_com[:, :2] + mean + e
    return replace(targets, com=displaced, cop=goal)


def _flat_shift(path: FootPath) -> Array:
    """Return a foot's shift (n, 2) [m] where it stands flat, interpolated elsewhere."""
    frames, flat = np.arange(len(path.down)), path.down & (path.pitch == 0.0)
    if not flat.any():
        return np.zeros_like(path.shift)
    return np.column_stack([np.interp(frames, frames[flat], one[flat]) for one in path.shift.T])


def _step_scaling(source: HumanFrames, scale: MotionScale, step_scale: float) -> Array:
    """Return the matrix (3, 3) from a human's positions to the robot's.

    Of a straight walk only the distances along it are scaled by ``step_scale``, so that the width
    of the steps stays; otherwise all horizontal ones.
    """
    scaling = scale.length * np.eye(3)
    com = source.series.com[:, :2]
    net, whole = com[-1] - com[0], float(np.linalg.norm(np.diff(com, axis=0), axis=1).sum())
    length = float(np.linalg.norm(net))
    if length > STRAIGHT_WALK * whole and length > 0.0:
        scaling[:2, :2] -= scale.length * (1.0 - step_scale) * np.outer(net, net) / length**2
    else:
        scaling[:2, :2] *= step_scale
    return scaling


def _scaled_com(
    source: HumanFrames, setup: RobotSetup, scale: MotionScale, scaling: Array
) -> Array:
    """Return the human's CoM, scaled (n, 3) [m], over the robot's ground.

    A robot may have its hips farther behind its CoM than a human: the CoM is shifted forward by the
    mean difference, so that the legs reach as far forward as backward.
    """
    height = source.series.com[:, 2] - source.series.ground_height - scale.human_height
    R = yaw_pitch_rotations(source.heading)
    shift = scale.length * float(np.mean(np.einsum("nji,nj->ni", R, source.hips)[:, 0]))
    shift -= float(setup.standing.hips[:, 0].mean())
    most = MAX_FORWARD_SHIFT * setup.legs.length
    com = np.empty((len(source), 3))
    com[:, :2] = source.series.com[:, :2] @ scaling[:2, :2].T
    com[:, :2] += min(max(shift, -most), most) * R[:, :2, 0]
    com[:, 2] = scale.robot_height + scale.length * height
    return com


def _arm_rise(source: HumanFrames, setup: RobotSetup, scale: MotionScale) -> Array:
    """Return what the robot's arms raise its CoM more than the human's, scaled, do (n,) [m].

    Without it a robot with heavy arms would bend its knees while it raises them, and one with light
    arms wherever they hang.
    """
    rise = np.zeros(len(source))
    for side, arms in source.arms.items():
        levers = setup.standing.arm_levers.get(side, 0.0) - scale.length * source.arm_levers[side]
        rise += (1.0 + arms[:, :, 2]) @ levers
    return rise


def _step_scale_and_lowering(
    source: HumanFrames, setup: RobotSetup, scale: MotionScale, pelvis: Array, unscaled: FootPaths
) -> tuple[float, float, tuple[str, ...]]:
    """Return the scale of the steps and the lowering of the CoM [m] for legs to reach, and notes.

    All positions are linear in the step scale, but for the outward shift of the feet, which is
    taken as linear too. ``unscaled``: paths of the feet with a step scale of 1.
    """
    robot, legs = setup.robot, setup.legs
    snapshot, longest = robot.snapshot(robot.postures[STANDING]), MAX_LEG_EXTENSION * legs.length
    upright = snapshot.rotation(setup.body.pelvis)
    # A bent body has its hips elsewhere relative to the CoM than an upright one.
    bent = scale.length * (source.hips - source.rotation["pelvis"] @ source.upright_hips)
    ends = []
    for step_scale in (MIN_STEP_SCALE, 1.0):
        scaling = _step_scaling(source, scale, step_scale)
        feet = unscaled if step_scale == 1.0 else foot_paths(source, setup, scaling)
        com = _scaled_com(source, setup, scale, scaling)
        share = load_shares(feet.down)
        com[:, :2] += sum(share[:, [n]] * _flat_shift(feet.paths[s]) for n, s in enumerate(SIDES))
        vectors = []  # from the ankle on the ground to the hip
        for side, hip in zip(SIDES, setup.standing.hips, strict=True):
            _, ankle = hip_and_ankle(snapshot, side)
            sole, path = robot.feet[side].frame, feet.paths[side]
            arm = snapshot.rotation(sole).T @ (ankle - snapshot.position(sole))
            vector = com + bent + pelvis @ (upright.T @ hip) - path.place - path.rotation @ arm
            vectors.append(vector[path.down])
        ends.append(np.concatenate(vectors))
    scales = np.linspace(1.0, MIN_STEP_SCALE, STEP_SCALES)
    lower = np.empty(STEP_SCALES)
    for k, u in enumerate((scales - MIN_STEP_SCALE) / (1.0 - MIN_STEP_SCALE)):
        vector = (1.0 - u) * ends[0] + u * ends[1]
        horizontal_sq = np.square(vector[:, :2]).sum(axis=1)
        highest = np.sqrt(np.maximum(longest**2 - horizontal_sq, 0.0))
        lower[k] = (vector[:, 2] - highest).max(initial=0.0)
    cost = (lower / (LOWERING_UNIT * legs.length)) ** 2 + ((1.0 - scales) / SHORTENING_UNIT) ** 2
    step_scale, lowered = float(scales[np.argmin(cost)]), float(lower[np.argmin(cost)])
    notes = list[str]()
    if step_scale < 1.0:
        notes.append(f"steps are {step_scale:.0%} of the human's, scaled: the legs reach so far")
    if lowered > 0.0:
        notes.append(f"the CoM is {1e3 * lowered:.0f} mm lower, for flat feet to reach the ground")
    return step_scale, lowered, tuple(notes)
