"""Guess which links are the feet: by their names, or by what reaches lowest on both sides."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin

from wbc.robot.formats.description import GeometrySource
from wbc.robot.sole import body_points, found_sole

# Foot -> the words of a link's name that mean it.
SIDES = {"left": {"left", "l"}, "right": {"right", "r"}}
CORNERS = {
    "front_left": {"fl", "lf"},
    "front_right": {"fr", "rf"},
    "hind_left": {"hl", "lh", "rl", "bl"},
    "hind_right": {"hr", "rh", "rr", "br"},
}
FOOT_WORDS = {"foot", "feet", "ankle", "sole", "contact"}
NOT_FEET = {"wheel", "caster", "roller", "hand", "gripper", "finger", "wrist", "palm", "arm"}
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
SAME_HEIGHT, MIRRORED = 0.01, 0.02  # m: two soles on the same ground, one the other's image
LEAST_AREA = 1e-3  # m^2: a flat shape larger than a coin
BELOW_BASE = 0.05  # m: legs reach at least so far below the base's origin


def words_of(name: str) -> set[str]:
    """Return the lower-case words of ``left_foot``, ``LAnkleRoll``, ``l_sole`` or ``LF_FOOT``."""
    return {word.lower() for word in _WORDS.findall(name)}


def foot_of(link: str) -> str | None:
    """Return the foot (``left``, ``hind_right``, ...) that a link's name says it is, or None."""
    words = words_of(link)
    if not words & FOOT_WORDS or words & NOT_FEET:
        return None
    found = [foot for foot, marks in (SIDES | CORNERS).items() if words & marks]
    return found[0] if len(found) == 1 else None


def guess_links(model: pin.Model, data: pin.Data, geometry: GeometrySource) -> dict[str, str]:
    """Return the feet as name to link; empty when there is no good guess.

    A foot is a link whose name holds a side (left, l, right, r) or a corner (FL, hr, ...) and one
    of :data:`FOOT_WORDS`, and whose rigid body has shapes; of several, the one that reaches lowest.
    Without such names: the two bodies at the ends of limbs that reach lowest, with flat undersides,
    one to the left and its image to the right. Wheels and hands are neither.

    ``data`` holds the frame placements of a posture with the base upright.
    """
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 1]
    rolling = {f.parentJoint for f in bodies if words_of(f.name) & {"wheel", "caster", "roller"}}
    bodies = [frame for frame in bodies if frame.parentJoint not in rolling]
    named = [(foot, frame) for frame in bodies if (foot := foot_of(frame.name))]
    lowest: dict[str, tuple[float, str]] = {}
    for foot, frame in named:
        height = _lowest_point(model, data, geometry, frame.parentJoint)
        lowest[foot] = min(lowest.get(foot, (np.inf, "")), (height, str(frame.name)))
    found = {name: lowest[name][1] for name in SIDES | CORNERS if name in lowest}
    found = {name: link for name, link in found.items() if lowest[name][0] < np.inf}
    if set(found) == {"front_left", "front_right"}:  # a biped whose legs are called so
        return dict(zip(SIDES, found.values(), strict=True))
    return found or ({} if rolling else _lowest_pair(model, data, geometry, bodies))


def _lowest_point(model: pin.Model, data: pin.Data, geometry: GeometrySource, joint: int) -> float:
    """Return how high the lowest point of a joint's body is [m]; infinite if it has no shape."""
    pose = data.oMi[joint]
    points = body_points(model, geometry, joint, pose.rotation[2])
    if not len(points):
        return np.inf
    return float((points @ pose.rotation[2]).min()) + float(pose.translation[2])


def _lowest_pair(
    model: pin.Model, data: pin.Data, geometry: GeometrySource, bodies: list[pin.Frame]
) -> dict[str, str]:
    """Return the two lowest flat bodies at the ends of limbs, if they are left and right."""
    inner = {int(parent) for parent in model.parents}
    ends = {f.parentJoint: f for f in reversed(bodies) if f.parentJoint not in inner}
    height = {joint: float(data.oMi[joint].translation[2]) for joint in ends}
    base = float(data.oMi[1].translation[2])
    low = {joint: z for joint, z in height.items() if z < base - BELOW_BASE}
    low = {joint: z for joint, z in low.items() if z < min(low.values()) + 2 * SAME_HEIGHT}
    if len(low) != 2 or any(words_of(ends[joint].name) & NOT_FEET for joint in low):
        return {}
    soles = []
    for joint in low:
        R = data.oMi[joint].rotation @ ends[joint].placement.rotation
        found = found_sole(model, geometry, ends[joint], R)
        if found is None or np.prod(np.ptp(found[1], axis=0)) < LEAST_AREA:
            return {}
        soles.append((data.oMi[joint] * found[0]).translation)
    names = [str(ends[joint].name) for joint in low]
    apart = np.abs(soles[0] * [1, -1, 1] - soles[1])
    if apart.max() > MIRRORED or abs(soles[0][2] - soles[1][2]) > SAME_HEIGHT:
        return {}
    left = int(soles[1][1] > soles[0][1])
    return {"left": names[left], "right": names[1 - left]}
