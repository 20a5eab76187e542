"""Feet: which links stand on the ground (as told, or guessed), and the flat sole of each."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sized
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.polygon import convex_hull
from wbc.robot.formats.description import GeometrySource
from wbc.robot.names import frame_table
from wbc.robot.sole import body_points, centred, found_sole
from wbc.validate import Array, finite_array, finite_number, read_only

SAME_PLACE, SAME_TILT = 1e-3, np.deg2rad(1.0)  # m, rad: a frame of the file is the sole's frame
NO_FEET = "no feet were found; a robot that stands needs them: feet: {left: {link: LINK}, ...}"
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


@dataclass(frozen=True, eq=False)
class FootSpec:
    """Which link is a foot, and optionally its sole.

    Attributes
    ----------
    link:
        The foot's link, or any frame fixed to it.
    polygon:
        Corners (k, 2) of the sole [m] in the x-y plane of that frame, whose z axis must point up;
        their convex hull is used. Without it the sole is found from the collision shapes.
    height:
        How far the frame's origin is above the sole [m]; used with ``polygon`` only.
    """

    link: str
    polygon: ArrayLike | None = None
    height: float = 0.0

    @classmethod
    def of(cls, name: str, given: FootSpec | Mapping[str, Any]) -> FootSpec:
        """Return ``given``, or the specification that a plain mapping holds.

        Raises
        ------
        InvalidInputError
            No link, an unknown key, or a polygon or height that is not made of finite numbers.
        """
        if not isinstance(given, FootSpec):
            keys = [field.name for field in fields(cls)]
            if not isinstance(given, Mapping) or "link" not in given or set(given) - set(keys):
                raise InvalidInputError(
                    f"foot {name!r}: expected 'link' and optionally 'polygon' and 'height', got"
                    f" {given!r}"
                )
            given = cls(**given)
        if given.polygon is not None:
            rows = len(given.polygon) if isinstance(given.polygon, Sized) else 0
            if rows == 0:
                raise InvalidInputError(f"foot {name!r}: polygon needs corners [[x, y], ...]")
            finite_array(f"foot {name!r}: polygon", given.polygon, (rows, 2))
        finite_number(f"foot {name!r}: height", given.height)
        return given


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot of a loaded robot.

    Attributes
    ----------
    name:
        Such as ``left``.
    frame:
        Frame of the model at the sole: origin in the middle of ``polygon``, z out of the ground
        into the foot, x forwards.
    link:
        The link (or frame) that was taken for the foot.
    polygon:
        Corners (k, 2) of the sole in that frame [m], counter-clockwise, read-only.
    """

    name: str
    frame: str
    link: str
    polygon: Array

    def __repr__(self) -> str:
        return f"Foot({self.name!r}, link={self.link!r}, {len(self.polygon)} corners)"

    def __post_init__(self) -> None:
        read_only(self.polygon)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.name, self.frame, self.link, self.polygon)


def find_feet(
    model: pin.Model,
    geometry: GeometrySource,
    specs: Mapping[str, FootSpec] | None,
    q: Array,
) -> tuple[dict[str, Foot], tuple[str, ...]]:
    """Return the feet of a robot and notes, adding a sole frame to ``model`` for each.

    Parameters
    ----------
    geometry:
        Collision shapes, of which only those of the feet are loaded.
    specs:
        The feet; None guesses them (see :func:`guess_links`), empty means none.
    q:
        A configuration (nq,) with the base upright and, if possible, the soles level.

    Raises
    ------
    UnknownNameError
        A foot's link does not exist.
    InvalidInputError
        A link whose z axis does not point up with a polygon, or neither polygon nor shapes.
    """
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    if specs is None:
        guessed = guess_links(model, data, geometry)
        specs = {name: FootSpec(link) for name, link in guessed.items()}
        if not specs:
            return {}, (NO_FEET,)
    feet, notes = {}, []
    for name, spec in specs.items():
        placement, polygon = _sole(model, data, geometry, name, spec)
        parent = model.frames[_frame_id(model, spec.link)]
        frame, polygon, note = _sole_frame(model, name, parent, placement, polygon)
        feet[name] = Foot(name, frame, spec.link, polygon)
        notes += note
    return feet, tuple(notes)


def is_arm(model: pin.Model, q: Array) -> bool:
    """Return whether one joint carries all else, and no joint is below the base as legs are.

    ``q`` (nq,) has the base upright.
    """
    if list(model.parents).count(1) != 1:
        return False
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    heights = [pose.translation[2] for pose in data.oMi][1:]
    return min(heights) > heights[0] - BELOW_BASE


def _frame_id(model: pin.Model, link: str) -> int:
    table = frame_table(model)
    if link not in table:
        bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise UnknownNameError("foot link", link, bodies)
    return table[link]


def _sole(
    model: pin.Model, data: pin.Data, geometry: GeometrySource, name: str, spec: FootSpec
) -> tuple[pin.SE3, Array]:
    """Return the sole's placement in the foot's joint, and its polygon (k, 2) there."""
    frame_id = _frame_id(model, spec.link)
    frame, pose = model.frames[frame_id], data.oMf[frame_id]
    if spec.polygon is not None:
        if pose.rotation[2, 2] < 0.5:  # 60 degrees from upright
            raise InvalidInputError(
                f"foot {name!r}: the z axis of {spec.link!r} does not point up, so it cannot carry"
                " a polygon; name a frame at the sole, or leave the polygon out"
            )
        polygon = convex_hull(np.asarray(spec.polygon, dtype=float))
        return centred(frame.placement, polygon, -float(spec.height))
    found = found_sole(model, geometry, frame, pose.rotation)
    if found is None:
        raise InvalidInputError(
            f"foot {name!r}: link {spec.link!r} has no shape to find the sole from;"
            " give its polygon"
        )
    return found


def _sole_frame(
    model: pin.Model, name: str, parent: pin.Frame, placement: pin.SE3, polygon: Array
) -> tuple[str, Array, list[str]]:
    """Return the name of a frame at the sole and the polygon in it, adding the frame if needed."""
    wanted, notes = f"{name}_sole", list[str]()
    for frame in model.frames:
        if frame.name != wanted:
            continue
        offset = frame.placement.actInv(placement)
        near = float(np.linalg.norm(offset.translation)) < SAME_PLACE
        level = float(np.linalg.norm(pin.log3(offset.rotation))) < SAME_TILT
        if frame.parentJoint == parent.parentJoint and near and level:
            corners = np.column_stack([polygon, np.zeros(len(polygon))])
            moved = corners @ offset.rotation.T + offset.translation
            return wanted, moved[:, :2].copy(), notes
        notes = [f"frame {wanted!r} is not in the middle of the sole; see {wanted}_centre"]
        wanted = f"{wanted}_centre"
        break
    frame = pin.Frame(wanted, parent.parentJoint, 0, placement, pin.FrameType.OP_FRAME)
    model.addFrame(frame, False)
    return wanted, polygon, notes


# ---------------------------------------------------------------------- guessing the feet


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
