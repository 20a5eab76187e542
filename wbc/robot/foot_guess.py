"""Guess the feet of an unknown robot, and its upright orientation.

From names, positions and shapes; reasons are given for what is not found.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from os.path import commonprefix
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.robot.formats.description import GeometrySource
from wbc.robot.sole import find_sole, is_round_about, lowest_point
from wbc.rotations import exp_rotation
from wbc.validate import Array

# Foot -> words of a link's name.
SIDES = {"left": {"left", "l"}, "right": {"right", "r"}}
CORNERS = {
    "front_left": {"fl", "lf"},
    "front_right": {"fr", "rf"},
    "hind_left": {"hl", "lh", "rl", "bl", "lr", "lb"},
    "hind_right": {"hr", "rh", "rr", "br", "rb"},
}
ENDS = {"front": {"front", "fore"}, "hind": {"hind", "rear", "back"}}
FOOT_WORDS = {"foot", "feet", "ankle", "sole", "contact"}
WHEEL_WORDS = {"wheel", "caster", "roller"}
HAND_WORDS = {"hand", "gripper", "finger", "thumb", "palm"}
ARM_WORDS = {*HAND_WORDS, "wrist", "arm"}
NAMELESS = "no link is called a left or right foot, ankle or sole"
NOT_FEET = WHEEL_WORDS | ARM_WORDS
_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_JOINED = re.compile(rf"(left|right|[lr])({'|'.join(sorted(FOOT_WORDS))}|leg)")  # lfoot, rightleg
_ROLL = re.compile(r"(?<=ankle)_?r(?=_|$)", re.IGNORECASE)  # L_ANKLE_R, LLEG_ANKLE_R
_SIDE_OF_FOOT = re.compile(rf"(left|right)[_.-]?(?:{'|'.join(sorted(FOOT_WORDS))})", re.IGNORECASE)
SAME_HEIGHT, MIRRORED = 0.01, 0.02  # m: tolerances of two mirrored soles on one ground
LEAST_AREA = 1e-3  # m^2: a flat shape larger than a coin
BELOW_BASE = 0.05  # m: legs reach at least so far below the base's origin
SPRAWLED = 0.25  # of their distance from their middle: feet less far below the base's origin
LEAST_ROLLING = 20.0 * np.pi  # rad: a joint with a larger range is a wheel's
LEAST_ALIGNMENT = np.cos(np.deg2rad(30.0))  # of a direction that is taken for an axis


def words_of(name: str) -> set[str]:
    """Return the lower-case words of ``left_foot``, ``LAnkleRoll``, ``lfoot`` or ``LF_FOOT``."""
    words = [word.lower() for word in _WORDS.findall(name)]
    glued = [_JOINED.fullmatch(word) for word in words]
    return {*words, *(part for match in glued if match for part in match.groups())}


def foot_of(link: str) -> str | None:
    """Return the foot (``left``, ``hind_right``, ...) that a link's name says it is, or None."""
    words = words_of(link.rpartition("/")[2])  # the r of r2/left_foot is no side
    if not words & FOOT_WORDS or words & NOT_FEET:
        return None
    # FL of left_foot_FL is a corner of that foot.
    named = SIDES if words & SIDES.keys() else SIDES | CORNERS
    found = [foot for foot, marks in named.items() if words & marks]
    if len(found) > 1 and (plain := _ROLL.sub("", link)) != link:
        return foot_of(plain)
    if len(found) > 1:  # the r of r1_left_foot is the robot's
        found = [side.lower() for side in _SIDE_OF_FOOT.findall(link)]
    if len(found) != 1:
        return None
    ends = [end for end, marks in ENDS.items() if words & marks]
    return f"{ends[0]}_{found[0]}" if len(ends) == 1 and found[0] in SIDES else found[0]


def _feet_by_name(model: pin.Model) -> dict[str, str]:
    """Return the foot that a link's name says it is, but for what all links' names begin with."""
    names = [str(frame.name) for frame in bodies_of(model)]
    common = len(commonprefix(names).rpartition("_")[0])  # noqa: RUF071
    return {name: foot for name in names if (foot := foot_of(name[common:]) or foot_of(name))}


def upright(model: pin.Model, q: Array, feet: Mapping[str, str] | None) -> tuple[Array, str]:
    """Return ``q`` with the feet below the base and the left ones to the left, and what was turned.

    Files whose y axis points up, or whose x axis points backwards, are recognised by where their
    feet are. A base that ``q`` turns already is left as it is if the feet are then below it.

    ``feet``: foot to link; None stands for the links that are called feet.
    """
    data = model.createData()
    pin.centerOfMass(model, data, q)
    places = _named_positions(model, data, feet)
    if len(places) < 2:
        return q, ""
    lefts, rights = _sides(places)
    down = middle = _mean(places.values())
    below = middle - data.oMi[1].actInv(data.com[0])
    nearest = min(float(np.linalg.norm(place)) for place in (down, *places.values()))
    if nearest < BELOW_BASE or down @ below < 0.0:
        down = below  # the base's origin is on the ground, between the feet, in one or below them
    spread = float(np.mean([np.linalg.norm(place - middle) for place in places.values()]))
    if np.linalg.norm(down) < max(BELOW_BASE, SPRAWLED * spread):
        return q, ""  # legs that stick out, as an ant's with knees above it, show no direction
    up, left = _axis_along(-down), _axis_along(_mean(lefts) - _mean(rights))
    if up is None:
        up = np.array([0.0, 0.0, 1.0])
    turns = not np.array_equal(q[3:7], [0.0, 0.0, 0.0, 1.0])
    if turns and float((pin.Quaternion(q[3:7]).matrix() @ up)[2]) > LEAST_ALIGNMENT:
        return q, ""
    if left is None or not lefts or not rights or abs(float(left @ up)) > 0.5:
        left = np.array([0.0, 1.0, 0.0]) if not up[1] else np.array([0.0, 0.0, -up[1]])
    axes = np.stack([np.cross(left, up), left, up])  # the world's, in the base
    if np.array_equal(axes, np.eye(3)) and not turns:
        return q, ""
    turned = q.copy()
    turned[3:7] = pin.Quaternion(axes).coeffs()
    return turned, (
        f"the base's {_name_of(up)} axis points up and its {_name_of(axes[0])} axis forwards, as"
        " its feet say: 'standing' is turned"
    )


def facing_ahead(model: pin.Model, q: Array, feet: Mapping[str, str] | None) -> Array:
    """Return ``q`` (nq,) with the base over the world's origin, its x axis forwards.

    Backwards if the feet that are called left are then to the left. A base whose z axis does not
    point up keeps its heading. ``feet`` are as in :func:`upright`.
    """
    R = pin.Quaternion(q[3:7]).matrix()
    ahead = q.copy()
    ahead[:2] = 0.0
    heading = float(np.arctan2(R[1, 0], R[0, 0]))
    if R[2, 2] <= LEAST_ALIGNMENT or heading == 0.0:
        return ahead
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    lefts, rights = _sides(_named_positions(model, data, feet))
    if lefts and rights and (_mean(lefts) - _mean(rights))[1] < 0.0:
        heading += np.pi
    ahead[3:7] = pin.Quaternion(exp_rotation(np.array([0.0, 0.0, -heading])) @ R).coeffs()
    return ahead


def _named_positions(
    model: pin.Model, data: pin.Data, feet: Mapping[str, str] | None
) -> dict[str, Array]:
    """Return the positions (3,) in the base of the given feet, or of links named as feet."""
    bodies = {str(frame.name): frame for frame in bodies_of(model)}
    if feet is None:
        named = [(foot, bodies[name]) for name, foot in _feet_by_name(model).items()]
    else:
        named = [(foot, bodies[link]) for foot, link in feet.items() if link in bodies]
    return {
        foot: frame.placement.translation  # of a leg that is locked
        if frame.parentJoint == 1
        else data.oMi[1].actInv(data.oMi[frame.parentJoint]).translation
        for foot, frame in named
    }


def _sides(places: Mapping[str, Array]) -> tuple[list[Array], list[Array]]:
    """Return the places of the left feet, and of the right ones."""
    lefts = [place for foot, place in places.items() if foot.endswith("left")]
    return lefts, [place for foot, place in places.items() if foot.endswith("right")]


def _mean(places: Collection[Array]) -> Array:
    return np.mean(list(places), axis=0) if places else np.zeros(3)


def _axis_along(direction: Array) -> Array | None:
    """Return the signed axis (3,) that a direction is nearly along, or None."""
    k = int(np.abs(direction).argmax())
    if abs(direction[k]) <= LEAST_ALIGNMENT * float(np.linalg.norm(direction)):
        return None
    axis = np.zeros(3)
    axis[k] = np.sign(direction[k])
    return axis


def _name_of(axis: Array) -> str:
    return ("-" if axis.sum() < 0.0 else "") + "xyz"[int(np.abs(axis).argmax())]


def guess_links(
    model: pin.Model, data: pin.Data, geometry: GeometrySource
) -> tuple[dict[str, str], str]:
    """Return the feet as name to link, and what was not found and why, in words.

    A foot is a link whose name holds a side (left, l, right, r) or a corner (FL, hr, ...) and one
    of :data:`FOOT_WORDS`, and whose rigid body has shapes; of several, the one that reaches lowest.
    A body is one foot, however many of its frames are called so, and which of four feet is in front
    is seen, not read. Without such names, or shapes there, or with some of four corners only: the
    two bodies at the ends of limbs that reach lowest, with flat undersides, one to the left and its
    image to the right; or four, two on either side.
    Wheels, what carries them (:func:`rolling_joints`), and hands are none.

    ``data`` holds the frame placements of a posture with the base upright.
    """
    bodies = [frame for frame in bodies_of(model) if _may_be_foot(model, frame)]
    rolling = rolling_joints(model, data, geometry)
    bodies = [frame for frame in bodies if frame.parentJoint not in rolling]
    named = _named_feet(model, data, bodies)
    named += _below_ankles(model, named, bodies)
    lowest: dict[str, tuple[float, str]] = {}
    by_name = _feet_by_name(model)
    for foot, frame in named:
        height = lowest_point(model, data, geometry, frame.parentJoint)
        if frame.name not in by_name:
            height += SAME_HEIGHT  # toes beside a sole are lower by less
        lowest[foot] = min(lowest.get(foot, (np.inf, "~")), (height, str(frame.name)))
    ordered = {name: lowest[name] for name in SIDES | CORNERS if name in lowest}
    found = {name: link for name, (height, link) in ordered.items() if height < np.inf}
    shapeless = ", ".join(link for height, link in ordered.values() if height == np.inf)
    lacking = (_missing_sides(found) or _ambiguous_names(model, named, found)) if found else ""
    if lacking and set(found) <= set(CORNERS):  # LR_FOOT is the foot of a biped's right leg
        joints = {str(frame.name): int(frame.parentJoint) for frame in bodies}
        others, _ = _lowest_pair(model, data, geometry, bodies)
        if {joints[link] for link in found.values()} < {joints[link] for link in others.values()}:
            return others, ""
    rigid = [
        str(one.name) for one in bodies_of(model) if one.parentJoint == 1 and foot_of(one.name)
    ]
    locked = f"the base carries {', '.join(rigid)} with no joint between: is a leg locked?"
    if not found and rolling:
        return {}, "it has wheels, and wheels are no soles"
    if not found:
        others, why = _lowest_pair(model, data, geometry, bodies)
        if others or not shapeless:
            return others, locked if rigid and not others else why
    if shapeless:
        missing = f"no shapes to find soles from on {shapeless}"
        return found, f"{missing}; give link, polygon and height"
    return found, locked if rigid and lacking else lacking


def _may_be_foot(model: pin.Model, frame: pin.Frame) -> bool:
    """Return whether a frame is on a body below the base that has mass or shapes.

    Or the root link itself, if it is called a foot.
    """
    joint = int(frame.parentJoint)
    if joint == 1 and foot_of(frame.name) is not None:
        return not [*_links_above(model, frame)]
    return joint > 1 and (model.inertias[joint].mass > 0.0 or joint not in set(model.parents))


def rolling_joints(model: pin.Model, data: pin.Data, geometry: GeometrySource) -> set[int]:
    """Return the joints that turn wheels, and those that carry these.

    Wheels are links below the base that are named so, or that end limbs, turn without end, are
    round and less than their diameter above the lowest limb, as the bearing of a rod is not.
    ``data``: as in :func:`guess_links`.
    """
    bodies = (frame for frame in bodies_of(model) if _may_be_foot(model, frame))
    rolling = {int(one.parentJoint) for one in bodies if words_of(one.name) & WHEEL_WORDS}
    height = {joint: float(data.oMi[joint].translation[2]) for joint in range(1, model.njoints)}
    low = [j for j in _continuous_ends(model) if height[j] < height[1] - BELOW_BASE]
    wheels = [joint for joint in low if _is_wheel(model, geometry, joint)]
    if wheels:
        ends = {*range(2, model.njoints)} - {int(parent) for parent in model.parents}
        ends |= {int(model.parents[joint]) for joint in wheels}  # a foot that carries a rotor
        lowest = {end: lowest_point(model, data, geometry, end) for end in ends}
        ground = min(lowest.values())
        rolling |= {j for j in wheels if lowest[j] - ground < 2.0 * (height[j] - lowest[j])}
    return rolling | {int(model.parents[joint]) for joint in rolling}


def _continuous_ends(model: pin.Model) -> list[int]:
    """Return the last joints of limbs that are continuous, or turn more than ten times."""
    inner, found = {int(parent) for parent in model.parents}, []
    for joint in range(2, model.njoints):
        most = model.upperPositionLimit[int(model.idx_qs[joint])]
        if joint not in inner and (model.nqs[joint] == 2 or most >= LEAST_ROLLING):
            found.append(joint)
    return found


def _is_wheel(model: pin.Model, geometry: GeometrySource, joint: int) -> bool:
    """Return whether a joint's body is round about its axis."""
    data, local = model.createData(), pin.ReferenceFrame.LOCAL
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axis = pin.getJointJacobian(model, data, joint, local)[3:, int(model.idx_vs[joint])]
    return bool(axis.any()) and is_round_about(model, geometry, joint, axis)


def _below_ankles(
    model: pin.Model, named: list[tuple[str, pin.Frame]], bodies: list[pin.Frame]
) -> list[tuple[str, pin.Frame]]:
    """Return what ends the legs of links that are called ankles and nothing more, as those feet.

    Of ``anklePitchLeft`` and ``toeLeft`` below it the sole is the lower one's.
    """
    taken = {int(frame.parentJoint) for _, frame in named}
    ends = {int(one.parentJoint): one for one in reversed(bodies)}.items()
    return [
        (foot, end)
        for foot, frame in named
        if words_of(frame.name) & FOOT_WORDS == {"ankle"}
        for joint, end in ends
        if joint in model.subtrees[frame.parentJoint] and joint not in {*model.parents, *taken}
    ]


def _named_feet(
    model: pin.Model, data: pin.Data, bodies: list[pin.Frame]
) -> list[tuple[str, pin.Frame]]:
    """Return the frames named as feet, one per body, and which foot each is.

    The r of ``rl_foot`` may mean rear or right: four feet are told apart by their positions.
    """
    called: dict[int, list[tuple[str, pin.Frame]]] = {}
    by_name = _feet_by_name(model)
    for frame in bodies:
        foot = by_name.get(frame.name)
        if foot is not None:
            called.setdefault(int(frame.parentJoint), []).append((foot, frame))
    named = []
    for entries in called.values():
        feet = {foot for foot, _ in entries}
        sides = feet & SIDES.keys() or feet
        if len(sides) > 1:  # its front and its rear
            sides = {foot.rpartition("_")[2] for foot in sides}
        frames = [frame for foot, frame in entries if foot in sides] or [one for _, one in entries]
        named.append((min(sides), min(frames, key=lambda frame: str(frame.name))))
    called_so = {int(frame.parentJoint): foot for foot, frame in named}
    for k, (foot, frame) in enumerate(named):  # a leg has one foot: iCub's l_upper_leg_back_contact
        leg = {*model.supports[frame.parentJoint], *model.subtrees[frame.parentJoint]}
        if any(called_so[joint] != foot for joint in leg & called_so.keys()):
            named[k] = foot.rpartition("_")[2], frame
    if not any(foot.startswith("hind") for foot, _ in named):  # a biped whose legs are called so
        named = [(foot.removeprefix("front_"), frame) for foot, frame in named]
    cornered = [frame for foot, frame in named if foot in CORNERS]
    by_place = _by_position(data, {int(frame.parentJoint): frame for frame in cornered})
    return list(by_place.items()) or named


def _by_position(data: pin.Data, feet: Mapping[int, Any]) -> dict[str, Any]:
    """Return four feet, given by their joints, named by their positions; empty for other counts."""
    base = data.oMi[1].translation
    at = {joint: data.oMi[joint].translation - base for joint in feet}
    lefts = sorted((j for j in at if at[j][1] > 0.0), key=lambda j: -at[j][0])
    rights = sorted((j for j in at if at[j][1] < 0.0), key=lambda j: -at[j][0])
    if len(lefts) != 2 or len(rights) != 2:
        return {}
    ordered = (lefts[0], rights[0], lefts[1], rights[1])
    return {name: feet[joint] for name, joint in zip(CORNERS, ordered, strict=True)}


def bodies_of(model: pin.Model) -> list[pin.Frame]:
    """Return the frames that are links."""
    return [frame for frame in model.frames if frame.type == pin.FrameType.BODY]


def _missing_sides(found: dict[str, str]) -> str:
    """Return which feet are missing beside those found by name, in words; empty if none."""
    whole = SIDES if set(found) <= set(SIDES) else CORNERS
    lacking = [name for name in whole if name not in found]
    called = ", ".join(found.values())
    return f"no link is called the {', '.join(lacking)} foot, as {called} is" if lacking else ""


def _ambiguous_names(
    model: pin.Model, named: list[tuple[str, pin.Frame]], found: Mapping[str, str]
) -> str:
    """Return which links of other legs have a found foot's name, in words; empty if none."""
    # By the first joint below the base: rods beside an ankle are of its leg.
    legs = {str(one.name): int([*model.supports[one.parentJoint], 1][2]) for _, one in named}
    names = [(foot, str(frame.name)) for foot, frame in named if foot in found]
    others = [name for foot, name in names if 1 != legs[found[foot]] != legs[name]]  # 1: the root
    chosen = ", ".join(found.values())
    return f"{', '.join(others)} of other legs are called so, too, as {chosen}" if others else ""


def _links_above(model: pin.Model, frame: pin.Frame) -> Iterator[str]:
    """Yield the names of the links that carry a link, up to the root."""
    while int(frame.parentFrame) > 0:
        frame = model.frames[int(frame.parentFrame)]
        if frame.type == pin.FrameType.BODY:
            yield str(frame.name)


def _lowest_pair(
    model: pin.Model, data: pin.Data, geometry: GeometrySource, bodies: list[pin.Frame]
) -> tuple[dict[str, str], str]:
    """Return the two lowest flat bodies at the ends of limbs if they are left and right, or why."""
    inner = {int(parent) for parent in model.parents}
    ends = {f.parentJoint: f for f in reversed(bodies) if f.parentJoint not in inner}
    height = {joint: float(data.oMi[joint].translation[2]) for joint in ends}
    base = float(data.oMi[1].translation[2])
    low = {joint: z for joint, z in height.items() if z < base - BELOW_BASE}
    low = {joint: z for joint, z in low.items() if z < min(low.values()) + 2 * SAME_HEIGHT}
    names = [str(ends[joint].name) for joint in low]
    if not low:  # the knees of an insect's legs are level with its trunk
        beneath = [
            str(ends[joint].name)
            for joint in sorted(ends)
            if lowest_point(model, data, geometry, joint) < base - BELOW_BASE
        ]
        high = f"{', '.join(beneath)}, which reach below the base, move about joints level with it"
        return {}, f"{NAMELESS}, and {high if beneath else 'no limb ends below the base'}"
    lowest = f"{NAMELESS}; the lowest ends of limbs, {', '.join(names)}"
    if any(words_of(name) & NOT_FEET for name in names):
        return {}, f"{lowest}, are called hands or wheels"
    carriers = [name for joint in low for name in _links_above(model, ends[joint])]
    hand = next((name for name in carriers if words_of(name) & HAND_WORDS), None)
    if hand is not None:
        return {}, f"{lowest}, are fingers of {hand}"
    if len(low) not in (2, 4):
        return {}, f"{lowest}, are not a pair"
    if any(lowest_point(model, data, geometry, joint) == np.inf for joint in low):
        return {}, f"{lowest}, have no shapes"
    if len(low) == 4:
        feet = _by_position(data, {joint: str(ends[joint].name) for joint in low})
        return feet, "" if feet else f"{lowest}, are not two to either side"
    soles = []
    for joint in low:
        R = data.oMi[joint].rotation @ ends[joint].placement.rotation
        found = find_sole(model, geometry, ends[joint], R)
        if found is None or np.prod(np.ptp(found[1], axis=0)) < LEAST_AREA:
            return {}, f"{lowest}, have no flat undersides"
        soles.append((data.oMi[joint] * found[0]).translation)
    apart = np.abs(soles[0] * [1, -1, 1] - soles[1])
    if apart.max() > MIRRORED or abs(soles[0][2] - soles[1][2]) > SAME_HEIGHT:
        return {}, f"{lowest}, are not one the other's mirror image"
    left = int(soles[1][1] > soles[0][1])
    feet = {"left": names[left], "right": names[1 - left]}
    called = [{side for side in SIDES if words_of(feet[foot]) & SIDES[side]} for foot in SIDES]
    if called == [{"right"}, {"left"}]:
        return {}, f"{lowest}, are not on the sides they are called: its x axis may point backwards"
    return feet, ""
