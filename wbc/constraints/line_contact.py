"""A contact along a line: an edge, or a sole that its leg cannot hold level."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.constraints.contact import Contact
from wbc.errors import InvalidInputError
from wbc.native.rows import Kind, NativeRows
from wbc.tasks.point import AXES
from wbc.validate import Array, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture

STRAIGHTNESS = 1e-3  # m: how far its points may be beside a line through the frame's origin
LEAST_HORIZONTAL = 0.1  # of a line's length: seen from above


class LineContact(Contact):
    """A frame held, but free to turn about a line (five rows: x y z, and ry rz across the line).

    So an edge is held, a sole that is much narrower than long, and the sole of a leg that has no
    joint to roll it: held in all six rows a walking robot on such legs cannot fall aside as a
    pendulum does, and goes over the sole's edge unforeseen.

    Parameters
    ----------
    corners:
        (k, 2) or (k, 3) points at which forces act, in the frame's axes [m]: on a line through its
        origin, of which the first and the last are the ends. By default where the x axis leaves the
        sole that the frame is, or its corners if those are two.
    friction:
        As of any :class:`Contact`, but not None.

    See :class:`Contact` for the others.
    """

    corners: Array

    ROWS = (*AXES, "ry", "rz")

    def _set_attribute(self, name: str, value: Any) -> None:
        if name == "friction" and value is None:
            raise InvalidInputError(
                f"{self}, friction: what pulls and twists holds all six rows; use Contact, or give"
                " a FrictionCone"
            )
        super()._set_attribute(name, value)

    def _corners(self, given: ArrayLike | None) -> Array:
        corners = super()._corners(given)
        if corners is None:
            corners = np.zeros((1, 3))
        elif given is None and len(corners) > 2:
            corners = _x_axis_ends(corners)
        line = corners[-1] - corners[0]
        length, across = math.hypot(*line.tolist()), math.hypot(*line[:2].tolist())
        line /= max(length, 1e-300)
        beside = np.abs(corners - np.outer(corners @ line, line)).max()
        if across <= LEAST_HORIZONTAL * length or beside > STRAIGHTNESS:
            raise InvalidInputError(
                f"{self}, corners: expected points on a line through the origin of {self.frame!r},"
                " the first and the last its ends, across its z axis"
            )
        dx, dy, dz = line.tolist()
        x, y = -dy * length / across, dx * length / across
        self._across = read_only(np.array(((x, y, 0.0), (-dz * y, dz * x, dx * y - dy * x))))
        return corners

    def native(self) -> tuple[NativeRows, ...]:
        """Return its rows."""
        numbers = self.position, self.rotation.ravel(), self._across.ravel()
        still, rows = self._zeros(), (0, 1, 2, 6, 7)
        return (NativeRows(Kind.CONTACT, self.frame, rows, still, still, numbers),)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return the drift from the anchor, [m] above [rad], as an expression of the posture."""
        rows = np.eye(5, 6)
        rows[3:, 3:] = self._across
        return (super().symbolic_error(posture).T @ rows.T).T

    @property
    def axes_across(self) -> Array:
        """Unit vectors (2, 3) that the last two rows are about, in the world, at the anchor."""
        return np.asarray(self._across @ self.rotation.T)


def _x_axis_ends(sole: Array) -> Array:
    """Return where the x axis leaves a sole of corners (k, 3): behind and ahead (2, 3)."""
    corners = sole[:, :2].tolist()  # a handful: plain numbers are faster
    ends = [
        x - y * (u - x) / (v - y)
        for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True)
        if y * v <= 0.0 and y != v
    ]
    return read_only(np.array(((min(ends), 0.0, 0.0), (max(ends), 0.0, 0.0))))
