"""Feet: the links that stand on the ground, each with a flat sole or a point."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.kinds import check_word
from wbc.polygon import convex_hull
from wbc.robot.foot_guess import guess_links
from wbc.robot.formats.description import GeometrySource
from wbc.robot.names import frame_table
from wbc.robot.sole import SMALL_SHARE, centred_on_sole, find_sole
from wbc.validate import Array, finite_array, finite_number, read_only

# m, rad: a frame of the file nearer than this is used as the sole's.
SAME_ORIGIN, SAME_TILT = 1e-3, np.deg2rad(1.0)
GIVE_FEET = "a robot that stands needs them: feet: {left: {link: LINK}, ...}"
NO_FEET = f"no feet were found (robot.notes: why), or its base is fixed; {GIVE_FEET}"
LEAST_SIZE = 0.01  # of a robot's size: smaller soles are in other units
BALL_SIZE = 0.03  # m: a smaller sole is the underside of a ball


@dataclass(frozen=True, eq=False)
class FootSpec:
    """Which link is a foot, and optionally its sole.

    Attributes
    ----------
    link:
        The foot's link, or any frame fixed to it.
    polygon:
        Corners (k, 2) of the sole [m] in the x-y plane of that frame, whose z axis must point up;
        their convex hull is used. Without it the sole is found from the collision shapes, or from
        those to draw of a body that has no others.
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
            No name of a link, an unknown key, or a polygon or height not made of finite numbers.
        """
        if not isinstance(given, FootSpec):
            keys = [field.name for field in fields(cls)]
            if not isinstance(given, Mapping) or "link" not in given or set(given) - set(keys):
                raise InvalidInputError(
                    f"foot {name!r}: expected 'link' and optionally 'polygon' and 'height', got"
                    f" {given!r}"
                )
            given = cls(**given)
        check_word(f"foot {name!r}, link", given.link)
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
    model: pin.Model, geometry: GeometrySource, specs: Mapping[str, FootSpec] | None, q: Array
) -> tuple[dict[str, Foot], tuple[str, ...]]:
    """Return the feet of a robot and notes, adding a sole frame to ``model`` for each.

    ``geometry``: collision shapes, of which only those of the feet are loaded.
    ``specs``: the feet; None guesses them (:func:`~wbc.robot.foot_guess.guess_links`), empty means
    none. Of three or more, those that end in balls are points.
    ``q``: a configuration (nq,) with the base upright and, if possible, the soles level.

    Raises UnknownNameError: a foot's link does not exist; InvalidInputError: a link whose z axis
    does not point up with a polygon, or neither polygon nor shapes, or one link as two feet.
    """
    data, feet, notes = model.createData(), dict[str, Foot](), list[str]()
    pin.framesForwardKinematics(model, data, q)
    if specs is None:
        guessed, lacking = guess_links(model, data, geometry)
        specs = {name: FootSpec(link) for name, link in guessed.items()}
        if not specs:
            return {}, (f"no feet were found: {lacking}; {GIVE_FEET}",)
        notes += [f"not all feet were found: {lacking}; {GIVE_FEET}"] if lacking else []
    _refuse_shared_links(specs)
    for name, spec in specs.items():
        placement, polygon, share = _sole(model, data, geometry, name, spec)
        small = spec.polygon is None and float(np.ptp(polygon, axis=0).max()) < BALL_SIZE
        if small and len(specs) > 2:  # bipeds must balance on their small soles
            polygon = np.zeros((1, 2))
        parent = model.frames[_frame_id(model, spec.link)]
        frame, polygon, note = _sole_frame(model, name, parent, placement, polygon)
        feet[name] = Foot(name, frame, spec.link, polygon)
        notes += note + _size_note(data, name, placement, polygon)
        if len(polygon) == 2 and spec.polygon is None:
            notes.append(
                f"the {name} foot touches level ground along a line only; give its polygon if more"
                " of it should"
            )
        if len(polygon) > 2 and share < SMALL_SHARE:
            notes.append(
                f"the sole that was found of the {name} foot is {share:.0%} of the rectangle round"
                " its body: no more of it touches level ground; give its polygon if it should"
            )
    return feet, tuple(notes)


def _size_note(data: pin.Data, name: str, sole: pin.SE3, polygon: Array) -> list[str]:
    """Return a note of a sole larger than its robot, or tiny: probably in other units."""
    places = np.array([at.translation for at in list(data.oMi)[1:]])
    size = float(np.linalg.norm(np.ptp(places, axis=0))) + float(np.linalg.norm(sole.translation))
    length = float(np.ptp(polygon, axis=0).max())
    if length <= size and (length == 0.0 or length >= LEAST_SIZE * size):
        return []
    return [
        f"the {name} sole is {length:.3g} m long, and the robot {size:.3g} m: are lengths of shapes"
        " or polygons in other units?"
    ]


def _refuse_shared_links(specs: Mapping[str, FootSpec]) -> None:
    taken = dict[str, str]()
    for name, spec in specs.items():
        other = taken.setdefault(spec.link, name)
        if other != name:
            raise InvalidInputError(
                f"foot {name!r}: {spec.link!r} is the {other} foot already; name another link"
            )


def _frame_id(model: pin.Model, link: str) -> int:
    table = frame_table(model)
    if link not in table:
        bodies = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise UnknownNameError("foot link", link, bodies)
    return table[link]


def _sole(
    model: pin.Model, data: pin.Data, geometry: GeometrySource, name: str, spec: FootSpec
) -> tuple[pin.SE3, Array, float]:
    """Return the sole's placement in the foot's joint, its polygon (k, 2) there, and its share.

    That is of the rectangle round the body; 1 of a polygon that was given.
    """
    frame_id = _frame_id(model, spec.link)
    frame, pose = model.frames[frame_id], data.oMf[frame_id]
    if spec.polygon is not None:
        if pose.rotation[2, 2] < 0.5:  # 60 degrees from upright
            raise InvalidInputError(
                f"foot {name!r}: the z axis of {spec.link!r} does not point up, so it cannot carry"
                " a polygon; name a frame at the sole, or leave the polygon out"
            )
        polygon = convex_hull(np.asarray(spec.polygon, dtype=float))
        return *centred_on_sole(frame.placement, polygon, -float(spec.height)), 1.0
    found = find_sole(model, geometry, frame, pose.rotation)
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
    wanted, notes, table = f"{name}_sole", list[str](), frame_table(model)
    while wanted in table:
        frame = model.frames[table[wanted]]
        offset = frame.placement.actInv(placement)
        near = float(np.linalg.norm(offset.translation)) < SAME_ORIGIN
        level = float(np.linalg.norm(pin.log3(offset.rotation))) < SAME_TILT
        if frame.parentJoint == parent.parentJoint and near and level:
            corners = np.column_stack([polygon, np.zeros(len(polygon))])
            moved = corners @ offset.rotation.T + offset.translation
            return wanted, moved[:, :2].copy(), notes
        notes = [f"frame {wanted!r} is not in the middle of the sole; see {wanted}_centre"]
        wanted = f"{wanted}_centre"
    frame = pin.Frame(wanted, parent.parentJoint, 0, placement, pin.FrameType.OP_FRAME)
    model.addFrame(frame, False)
    return wanted, polygon, notes
