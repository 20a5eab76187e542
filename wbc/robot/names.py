"""Joints by name or shell-style pattern such as ``left_*``; frames by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

import pinocchio as pin

from wbc.errors import UnknownNameError

WORLD, BASE = "world", "base"  # the free-flyer's own frame
COM = "com"  # not a frame: the default point about which moments are taken
# A link and a joint may share a name; links are what people mean, then frames added on purpose.
_PRECEDENCE = (
    pin.FrameType.JOINT,
    pin.FrameType.FIXED_JOINT,
    pin.FrameType.SENSOR,
    pin.FrameType.OP_FRAME,
    pin.FrameType.BODY,
)


def matches(pattern: str, names: Sequence[str]) -> tuple[int, ...]:
    """Return the entries of ``names`` that a name or pattern matches; empty if none does.

    An existing name means itself only, even if it reads as a pattern: ``hinge[1]``.
    """
    if pattern in names:
        return (names.index(pattern),)
    return tuple(k for k, name in enumerate(names) if fnmatchcase(name, pattern))


def matching(pattern: str, names: Sequence[str], kind: str = "joint") -> tuple[int, ...]:
    """Return the entries of ``names`` that a name or pattern matches."""
    found = matches(pattern, names) if isinstance(pattern, str) else ()
    if not found:
        raise UnknownNameError(kind, pattern, names)
    return found


def looked_up(kind: str, name: str, indices: Mapping[str, int]) -> int:
    """Return the index of a name."""
    try:
        return indices[name]
    except (KeyError, TypeError):  # or no name at all
        raise UnknownNameError(kind, name, indices) from None


def add_base_frame(model: pin.Model) -> tuple[str, ...]:
    """Make ``base`` mean the frame of the free-flyer; return notes of names that mean others."""
    identity = pin.SE3.Identity()
    com: tuple[str, ...] = ()
    if any(frame.name == COM for frame in model.frames):
        com = (f"{COM!r} means the centre of mass in about=, not the file's {COM!r}",)
    notes = com
    for frame in model.frames:
        if frame.name == BASE and frame.type != pin.FrameType.JOINT:
            if frame.parentJoint == 1 and frame.placement.isApprox(identity, 1e-12):
                return com
            notes = (*com, f"frame {BASE!r} means the floating base, not the file's {BASE!r}")
    model.addFrame(pin.Frame(BASE, 1, 0, identity, pin.FrameType.OP_FRAME), False)
    return notes


def frame_table(model: pin.Model) -> dict[str, int]:
    """Return frame name to index in ``model.frames``, without what is fixed to the world."""
    ranked = sorted(
        (_PRECEDENCE.index(frame.type), index, frame.name)
        for index, frame in enumerate(model.frames)
        if frame.parentJoint > 0
    )
    table = {name: index for _, index, name in ranked}
    ours = [i for i, f in enumerate(model.frames) if f.name == BASE and f.parentJoint == 1]
    if ours:
        table[BASE] = ours[-1]  # added last, see above
    return table
