"""One robot with the native core and without, each with its own limits and margins."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import NamedTuple

import numpy as np

import wbc
from wbc.native import VARIABLE
from wbc.robot.collision import CollisionModel
from wbc.robot.collision.distances import parts
from wbc.robot.collision.model import Index, PairDistances
from wbc.validate import Array


class SamePairs(CollisionModel):
    """Pairs on one robot, found and measured on another with the core."""

    def __init__(self, robot: wbc.Robot, other: CollisionModel) -> None:
        super().__init__(robot, other.bodies, other.pairs.tolist())
        self._other, self.by_coal = other, False

    def nearest(
        self, snapshot: wbc.Snapshot, count: int | None = None, kept: Array | None = None
    ) -> PairDistances:
        there = self._other.robot.snapshot(snapshot.q)
        most = len(self.pairs) if count is None else min(count, len(self.pairs))
        measured = self._other.native.nearest(there.native_state, most, kept)
        if measured is None or np.isneginf(measured[1][0]).any():  # some bodies touch
            self.by_coal = True
            return self._other.nearest(there, count, kept)._replace(snapshot=snapshot)
        distance, normal, point = parts(measured[1])
        return PairDistances(measured[0], distance, normal.T, point.T, snapshot)

    def measure(self, snapshot: wbc.Snapshot, pairs: Index) -> PairDistances:
        there = self._other.robot.snapshot(snapshot.q)
        return self._other.measure(there, pairs)._replace(snapshot=snapshot)


class Side(NamedTuple):
    """A robot and what it keeps."""

    robot: wbc.Robot
    limits: wbc.Limits
    margin: wbc.SelfCollision | None = None


class Sides(NamedTuple):
    """One robot with the core, and without."""

    native: Side
    plain: Side


@contextmanager
def without_core() -> Iterator[None]:
    """Have WBC_NATIVE=off meanwhile."""
    os.environ[VARIABLE] = "off"
    yield
    os.environ[VARIABLE] = "require"


@lru_cache(maxsize=1)
def sides_of(name: str, margin: bool) -> Sides:
    """Load a robot twice."""
    robot = wbc.Robot.load(name)
    with without_core():
        plain = wbc.Robot.load(name)
        assert plain.native is None  # it keeps what it found when it was first asked
    assert robot.native is not None
    limits, others = wbc.Limits(robot), wbc.Limits(plain)
    if not margin:
        return Sides(Side(robot, limits), Side(plain, others))
    kept = wbc.SelfCollision(robot, limits=limits)
    same = wbc.SelfCollision(plain, model=SamePairs(plain, kept.model), limits=others)
    vars(same).update(margins=kept.margins, _kept=kept._kept)  # no one else may
    return Sides(Side(robot, limits, kept), Side(plain, others, same))
