"""What a robot is asked to do in each frame: a human's motion, scaled to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wbc.gait.legs import SIDES, Legs, leg_joints
from wbc.retargeting.balanced import cop_of, least_moved, loads, pressing
from wbc.retargeting.body_map import BodyMap
from wbc.retargeting.footsteps import FootPath, FootPaths, foot_paths, pitched
from wbc.retargeting.scaling import MotionScale, StandingBody
from wbc.retargeting.source import HumanFrames
from wbc.robot import Robot
from wbc.robot.postures import STANDING
from wbc.spatial import vech_inverse
from wbc.validate import Array

# For legs to reach, the CoM is lowered and steps get shorter, by what is least in squares of these
# parts of the legs' length and of the level distances.
LOWERED, SHORTENED = 0.05, 0.2
SHORTEST = 0.5  # part of the human's scaled level distances that is left at least
TRIED = 26  # shares
STRAIGHTEST = 0.985  # part of the full length that standing legs are stretched to
STRAIGHT = 0.9  # part of its way that the CoM is away at the end
# Of its height: so far the CoM is moved for balance at most; how suddenly it is held there.
FARTHEST, SUDDEN = 0.15, 8
# And to and fro along an axis by this part of the human's own motion at most, rms by rms: by a
# third of it both correlate by 0.95.
UNLIKE = 0.3
AHEAD = 0.08  # of the legs' length: so far the CoM is put ahead at most


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of n frames, the robot's own size and time, its ground at z = 0.

    Attributes
    ----------
    time:
        (n,) [s], even.
    com:
        (n, 3) [m].
    angular_momentum:
        About the CoM (n, 3) [kg m^2/s].
    rotation:
        Of the robot's frames for pelvis, trunk and head (n, 3, 3).
    arms:
        Directions of upper arm and forearm (n, 2, 3), by side.
    inertia:
        The human's, scaled (n, 3, 3) [kg m^2].
    feet:
        Ways of the soles.
    human_com:
        The human's CoM, scaled, before it was moved for balance and reach (n, 3) [m].
    cop:
        Of the targets, where the feet can push (n, 2) [m]; NaN in the air.
    notes:
        What was changed, in words.
    """

    time: Array
    com: Array
    angular_momentum: Array
    rotation: Mapping[str, Array]
    arms: Mapping[str, Array]
    inertia: Array
    feet: FootPaths
    human_com: Array
    cop: Array
    notes: tuple[str, ...]

    @property
    def down(self) -> NDArray[np.bool_]:
        """Which feet touch the ground (n, 2), left and right."""
        return self.feet.down

    @property
    def dt(self) -> float:
        """[s]."""
        return float(self.time[1] - self.time[0])


def scaled_targets(
    source: HumanFrames, robot: Robot, legs: Legs, body: BodyMap, standing: StandingBody,
    scale: MotionScale, balance: bool,
) -> Targets:  # fmt: skip
    """Return a robot's targets, the CoM moved where the feet can push (``balance``)."""
    series = source.series
    dt = scale.time * float(series.time[1] - series.time[0])
    pelvis = source.rotation["pelvis"] @ body.upright[body.pelvis]
    feet = foot_paths(source, robot, legs, _spread(source, scale, 1.0))
    share, lowered, notes = _within_reach(source, robot, legs, standing, scale, pelvis, body, feet)
    spread = _spread(source, scale, share)
    if share < 1.0:
        feet = foot_paths(source, robot, legs, spread)
    com = _scaled_com(source, legs, standing, scale, spread)
    com[:, 2] -= lowered
    if feet.wider > 0.0:
        why = "as legs stand that cannot roll them" if feet.lines else "to pass each other"
        notes += (f"feet set {1e3 * feet.wider:.0f} mm farther outwards each, {why}",)
    notes += feet.notes
    k = scale.angular_momentum * series.momentum[:, 3:]
    rotation = {body.pelvis: pelvis}
    for part, frame in (("trunk", body.trunk), ("head", body.head)):
        if frame is not None and frame not in rotation:
            rotation[frame] = source.rotation[part] @ body.upright[frame]
    arms = {
        side: -np.stack(
            [source.rotation[f"{side}_{part}"][:, :, 2] for part in ("upper_arm", "forearm")],
            axis=1,
        )
        for side in body.arms
    }
    targets = Targets(
        time=dt * np.arange(len(source)),
        com=com,
        angular_momentum=k,
        rotation=rotation,
        arms=arms,
        inertia=scale.inertia * np.array([vech_inverse(one) for one in series.inertia]),
        feet=feet,
        human_com=com.copy(),
        cop=np.full((len(source), 2), np.nan),
        notes=notes,
    )
    return balanced(targets, robot, k) if balance else targets


def balanced(targets: Targets, robot: Robot, k: Array, com: Array | None = None) -> Targets:
    """Return targets with the CoM moved so that the CoP is where feet stand.

    Parameters
    ----------
    k:
        Angular momentum (n, 3) that the robot has, or is wanted to have [kg m^2/s].
    com:
        Its CoM (n, 3) [m]; None: the wanted one.
    """
    dt = targets.dt
    k_rate = np.gradient(k, dt, axis=0)
    cop, square = cop_of(targets.com if com is None else com, k_rate, robot.mass, robot.gravity, dt)
    # From the human's on: what was moved before may be taken back.
    before = targets.com[:, :2] - targets.human_com[:, :2]
    off, goal = least_moved(cop - pressing(before, square, dt), square, dt, targets.feet.supports)
    moving = targets.com.copy()
    # What cannot be balanced is not balanced by a CoM that runs away from the human's.
    part = np.linalg.norm(off, axis=1) / (FARTHEST * float(np.mean(targets.com[:, 2])))
    off /= ((1.0 + part**SUDDEN) ** (1.0 / SUDDEN))[:, None]
    # Nor by one that goes its own way where the human's hardly moves.
    mean, own = off.mean(axis=0), targets.human_com[:, :2].std(axis=0)
    off -= mean
    off *= np.minimum(1.0, UNLIKE * own / np.maximum(off.std(axis=0), 1e-12))
    moving[:, :2] = targets.human_com[:, :2] + mean + off
    return replace(targets, com=moving, cop=goal)


def _held(path: FootPath) -> Array:
    """Return a foot's shift (n, 2) where it stands flat, interpolated between."""
    frames, flat = np.arange(len(path.down)), path.down & (path.pitch == 0.0)
    if not flat.any():
        return np.zeros_like(path.shift)
    return np.column_stack([np.interp(frames, frames[flat], one[flat]) for one in path.shift.T])


def _spread(source: HumanFrames, scale: MotionScale, share: float) -> Array:
    """Return what takes a human's places to the robot's (3, 3), steps shortened to ``share``.

    Who walks straight on is shortened along that way only: sideways steps stay as wide.
    """
    spread = scale.length * np.eye(3)
    com = source.series.com[:, :2]
    net, whole = com[-1] - com[0], float(np.linalg.norm(np.diff(com, axis=0), axis=1).sum())
    length = float(np.linalg.norm(net))
    if length > STRAIGHT * whole and length > 0.0:
        spread[:2, :2] -= scale.length * (1.0 - share) * np.outer(net, net) / length**2
    else:
        spread[:2, :2] *= share
    return spread


def _scaled_com(
    source: HumanFrames, legs: Legs, standing: StandingBody, scale: MotionScale, spread: Array
) -> Array:
    """Return the human's CoM, scaled (n, 3) [m], over the robot's ground.

    A robot may have its hips farther behind its CoM than a human. By how much, on average over the
    motion, the CoM is put ahead, so that legs have what they reach on both sides.
    """
    height = source.series.com[:, 2] - source.series.ground_height - scale.human_height
    turns = pitched(source.heading, np.zeros(len(source)))
    ahead = scale.length * float(np.mean(np.einsum("nji,nj->ni", turns, source.hips)[:, 0]))
    ahead -= float(standing.hips[:, 0].mean())
    most = AHEAD * legs.length
    com = np.empty((len(source), 3))
    com[:, :2] = source.series.com[:, :2] @ spread[:2, :2].T
    com[:, :2] += min(max(ahead, -most), most) * turns[:, :2, 0]
    com[:, 2] = scale.robot_height + scale.length * height
    return com


def _within_reach(
    source: HumanFrames, robot: Robot, legs: Legs, standing: StandingBody, scale: MotionScale,
    pelvis: Array, body: BodyMap, widest: FootPaths,
) -> tuple[float, float, tuple[str, ...]]:  # fmt: skip
    """Return which part of level distances legs reach, and by how much the CoM is lowered [m].

    ``widest``: ways of the feet with all of the level distances.
    """
    lacking = _stretch(source, robot, legs, standing, scale, pelvis, body, widest)
    shares = np.linspace(1.0, SHORTEST, TRIED)
    lower = np.array([lacking(share) for share in shares])
    cost = (lower / (LOWERED * legs.length)) ** 2 + ((1.0 - shares) / SHORTENED) ** 2
    share, lowered = float(shares[np.argmin(cost)]), float(lower[np.argmin(cost)])
    notes = list[str]()
    if share < 1.0:
        notes.append(f"steps are {share:.0%} of the human's, scaled: the legs reach so far")
    if lowered > 0.0:
        notes.append(f"the CoM is {1e3 * lowered:.0f} mm lower, for flat feet to reach the ground")
    return share, lowered, tuple(notes)


def _stretch(
    source: HumanFrames, robot: Robot, legs: Legs, standing: StandingBody, scale: MotionScale,
    pelvis: Array, body: BodyMap, widest: FootPaths,
) -> Callable[[float], float]:  # fmt: skip
    """Return by how much the CoM must be lowered for standing legs to be bent enough [m].

    By which part of the level distances is left: all places are linear in it, but for how far feet
    are set outwards, which is taken to be, too.
    """
    snapshot = robot.snapshot(robot.postures[STANDING])
    upright, longest = snapshot.rotation(body.pelvis), STRAIGHTEST * legs.length
    # Who leans has the hips elsewhere under the CoM than who stands upright.
    bent = scale.length * (source.hips - source.rotation["pelvis"] @ source.upright_hips)
    ends = []
    for share in (SHORTEST, 1.0):
        spread = _spread(source, scale, share)
        feet = widest if share == 1.0 else foot_paths(source, robot, legs, spread)
        com = _scaled_com(source, legs, standing, scale, spread)
        weight = loads(feet.down)
        com[:, :2] += sum(weight[:, [n]] * _held(feet.paths[s]) for n, s in enumerate(SIDES))
        ways = []  # from the ankle on the ground to the hip
        for side, hip in zip(SIDES, standing.hips, strict=True):
            ankle = snapshot.position(str(robot.model.names[leg_joints(robot, side)[-1]]))
            sole, path = robot.feet[side].frame, feet.paths[side]
            arm = snapshot.rotation(sole).T @ (ankle - snapshot.position(sole))
            way = com + bent + pelvis @ (upright.T @ hip) - path.place - path.rotation @ arm
            ways.append(way[path.down])
        ends.append(np.concatenate(ways))

    def lacking(share: float) -> float:
        part = (share - SHORTEST) / (1.0 - SHORTEST)
        way = (1.0 - part) * ends[0] + part * ends[1]
        flat = np.square(way[:, :2]).sum(axis=1)
        highest = np.sqrt(np.maximum(longest**2 - flat, 0.0))
        return float((way[:, 2] - highest).max(initial=0.0))

    return lacking
