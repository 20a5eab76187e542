"""Pairs of capsules that must not touch: segments with a radius, each fixed to a frame.

A capsule whose end points coincide is a sphere.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.robot import Snapshot
from wbc.robot.symbolic import SymbolicPosture
from wbc.validate import Array, finite_number, finite_vector, read_only

WORLD = "world"
# Added to the squared lengths [m^2]: segments that are points, or parallel, divide by no zero.
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class CapsulePair:
    """Two capsules that are to stay apart.

    Attributes
    ----------
    frame_a, frame_b:
        Frames of the robot that they are fixed to, or ``world`` for an obstacle.
    start_a, end_a, start_b, end_b:
        End points (3,) of the segments in those frames [m].
    radius_a, radius_b:
        [m], not negative.
    clearance:
        Distance to keep between the surfaces [m].
    """

    frame_a: str
    start_a: ArrayLike
    end_a: ArrayLike
    radius_a: float
    frame_b: str
    start_b: ArrayLike
    end_b: ArrayLike
    radius_b: float
    clearance: float = 0.0

    def __post_init__(self) -> None:
        for name in ("start_a", "end_a", "start_b", "end_b"):
            what = f"capsule pair {self.name!r}, {name}"
            object.__setattr__(self, name, read_only(finite_vector(what, getattr(self, name), 3)))
        for name in ("radius_a", "radius_b", "clearance"):
            what = f"capsule pair {self.name!r}, {name}"
            object.__setattr__(self, name, finite_number(what, getattr(self, name), least=0.0))

    @property
    def name(self) -> str:
        """The two frames, for messages."""
        return f"{self.frame_a} - {self.frame_b}"

    @property
    def reach(self) -> float:
        """Least distance of the two segments [m]."""
        return self.radius_a + self.radius_b + self.clearance

    def excess(self, snapshot: Snapshot) -> float:
        """Return how much further apart the capsules are than asked for [m]; negative if not."""
        ends = []
        for frame, points in self._ends():
            if frame == WORLD:
                ends += points
            else:
                R, p = snapshot.rotation(frame), snapshot.position(frame)
                ends += [p + R @ point for point in points]
        return segment_distance(*ends) - self.reach

    def symbolic_excess(self, posture: SymbolicPosture) -> ca.SX:
        """Return squared distance of the segments minus what it must be at least [m^2]."""
        ends = []
        for frame, points in self._ends():
            columns = [ca.SX(ca.DM(point)) for point in points]
            if frame == WORLD:
                ends += columns
            else:
                R, p = posture.rotation(frame), posture.position(frame)
                ends += [p + ca.mtimes(R, column) for column in columns]
        return squared_segment_distance(*ends) - self.reach**2

    def _ends(self) -> tuple[tuple[str, list[Array]], tuple[str, list[Array]]]:
        a = [np.asarray(self.start_a), np.asarray(self.end_a)]
        b = [np.asarray(self.start_b), np.asarray(self.end_b)]
        return (self.frame_a, a), (self.frame_b, b)


def squared_segment_distance(a0: ca.SX, a1: ca.SX, b0: ca.SX, b1: ca.SX) -> ca.SX:
    """Return the squared distance of two segments, once continuously differentiable.

    The nearest points of the lines, moved into the segments one after the other (Ericson, Real-Time
    Collision Detection, 5.1.9). At the nearest points the distance does not change to first order
    with where they are, so the kinks of moving them into the segments do not show in its gradient.
    """
    u, v, r = a1 - a0, b1 - b0, a0 - b0
    uu, vv, uv = ca.sumsqr(u) + TINY, ca.sumsqr(v) + TINY, ca.dot(u, v)
    ur, vr = ca.dot(u, r), ca.dot(v, r)
    s = _within((uv * vr - ur * vv) / (uu * vv - uv**2 + TINY * uu * vv + TINY**2))
    t = _within((uv * s + vr) / vv)
    s = _within((uv * t - ur) / uu)
    return ca.sumsqr(r + s * u - t * v)


def _within(x: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(x, 0.0), 1.0)


def segment_distance(a0: Array, a1: Array, b0: Array, b1: Array) -> float:
    """Return the distance of two segments [m], by checking ends and the interior."""
    found = [_to_segment(p, b0, b1) for p in (a0, a1)] + [_to_segment(p, a0, a1) for p in (b0, b1)]
    u, v, r = a1 - a0, b1 - b0, a0 - b0
    basis = np.column_stack((u, -v))
    gram = basis.T @ basis
    if np.linalg.det(gram) > TINY * gram[0, 0] * gram[1, 1] > 0.0:
        s, t = np.linalg.solve(gram, -basis.T @ r)
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            found.append(float(np.linalg.norm(r + s * u - t * v)))
    return min(found)


def _to_segment(p: Array, start: Array, end: Array) -> float:
    way = end - start
    square = float(way @ way)
    t = 0.0 if square == 0.0 else min(max(float((p - start) @ way) / square, 0.0), 1.0)
    return float(np.linalg.norm(start + t * way - p))
