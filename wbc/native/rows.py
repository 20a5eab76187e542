"""How a task or contact describes its rows to the native core."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from typing import NamedTuple

from wbc.native import lib
from wbc.validate import Array


class Kind(IntEnum):
    """What the core can evaluate; ``row_kind`` of source/core.h. Each with the numbers it needs."""

    POINT = lib.POINT  # target (3,), the robot's mass; entries: axes; frame None: the CoM
    ORIENTATION = lib.ORIENTATION  # target (3, 3), its angular velocity (3,) and acceleration (3,)
    # Selection (k, 6) of vech(I), what it should give (k,); frame None: world axes.
    INERTIA = lib.INERTIA_ENTRIES
    JOINTS = lib.JOINTS  # positions (k,); entries: joints
    MOMENTUM = lib.MOMENTUM_ENTRIES  # none; entries
    # Position (3,), rotation (3, 3), and of lines two axes across it there (2, 3); entries: rows, 6
    # and 7 about those axes.
    CONTACT = lib.CONTACT
    LINEAR = lib.LINEAR  # matrix (k, nv), offset (k,): error = matrix @ (0, joints) - offset
    LOOP = lib.LOOP  # none; entries: rows
    # Seen from the other frame: position (3,), rotation (3, 3), rate (6,), acceleration (6,).
    RELATIVE = lib.RELATIVE
    GEAR = lib.GEAR  # two joints, and the polynomial's coefficients, lowest first (7,)
    # Unit vectors: target (3,), axis (3,) in the frame's axes; entries: world axes.
    POINTING = lib.POINTING
    # Of a centre of pressure: point (3,), whether it is as high as contacts on the mean.
    COP = lib.COP
    GIVEN = lib.GIVEN  # of forces, by Python: matrix (k, n), target (k,)
    # By Python: Jacobian (k, nv), error (k,), bound on the curvature (nv,), or curvature (nv, nv).
    ASKED = lib.ASKED


class NativeRows(NamedTuple):
    """Rows of one kind: k of them, behind each other."""

    kind: Kind
    frame: str | None  # that they are about, or None
    entries: tuple[int, ...]  # (k,) which entries of what the kind knows
    bias: Array  # (k,) minus the rate of the target
    drift: Array  # (k,) minus its acceleration
    numbers: tuple[Array, ...]  # what the kind needs, in its order
    # Whether the kind's curvature is damped; see :class:`~wbc.laws.VelocityLaw`.
    curved: bool = True
    # The task's attributes that bias, drift and numbers are, in this order; "" for what stays.
    # Where a target was set these are read again, and nothing is described anew.
    moving: tuple[str, ...] = ()
    other: str | None = None  # the frame that a loop's is held at

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames that they are about."""
        return tuple(name for name in (self.frame, self.other) if name is not None)

    def block(self, frames: Sequence[str], **places: int) -> dict[str, int]:
        """Return the ``wbc_block`` of source/core.h, by where these frames and all else are."""
        own, other = (-1 if one is None else frames.index(one) for one in (self.frame, self.other))
        return {"kind": self.kind, "frame": own, "other": other, **places}


def frames_of(base: str, rows: Iterable[NativeRows]) -> tuple[list[str], int]:
    """Return the frames that rows are about, ``base`` first, and how many of them need Jacobians.

    Those of loops alone are behind the others: the core works out rows of loops without.
    """
    named = [(one.frames, one.kind != Kind.LOOP) for one in rows]
    moving = dict.fromkeys((base, *(name for frames, moves in named if moves for name in frames)))
    return list(moving | dict.fromkeys(name for frames, _ in named for name in frames)), len(moving)
