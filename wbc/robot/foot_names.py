"""Guess which links are the feet, from their names and their lowest points."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin

from wbc.robot.description import GeometrySource
from wbc.robot.sole import body_points

SIDES = {"left": {"left", "l"}, "right": {"right", "r"}}
FOOT_WORDS = {"foot", "ankle", "sole"}
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


def words_of(name: str) -> set[str]:
    """Return the lower-case words of ``left_foot``, ``LAnkleRoll``, ``l_sole`` or ``leftFoot``."""
    return {word.lower() for word in _WORDS.findall(name)}


def side_of(name: str) -> str | None:
    """Return ``left`` or ``right`` if the name says that the link belongs to that foot."""
    words = words_of(name)
    sides = [side for side, marks in SIDES.items() if words & marks]
    return sides[0] if len(sides) == 1 and words & FOOT_WORDS else None


def guess_links(model: pin.Model, data: pin.Data, geometry: GeometrySource) -> dict[str, str]:
    """Return the feet as name to link; empty when there is no good guess.

    A foot is a link whose name holds a side (left, l, right, r) and one of the words foot, ankle
    and sole, and whose rigid body has collision shapes; of several on a side, the one that reaches
    lowest. ``data`` holds the frame placements of a posture with the base upright.
    """
    bodies = [f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint > 1]
    named = {frame.name: frame.parentJoint for frame in bodies if side_of(frame.name)}
    if not named:
        return {}
    links = [frame.name for frame in bodies if frame.parentJoint in named.values()]
    shapes = geometry.load(model, pin.GeometryType.COLLISION, links)
    lowest: dict[str, tuple[float, str]] = {}
    for link, joint in named.items():
        pose = data.oMi[joint]
        points = body_points(shapes, joint, pose.rotation[2])
        if len(points):
            height = float((points @ pose.rotation[2]).min()) + float(pose.translation[2])
            side = str(side_of(link))
            lowest[side] = min(lowest.get(side, (np.inf, "")), (height, link))
    return {side: lowest[side][1] for side in SIDES if side in lowest}
