"""Finer shapes for pairs of bodies that simple shapes show too near.

The raw shapes (meshes) give the distance of two bodies when the robot stands. If the simple shapes
have less than the margin, the pair gets hulls; if these have too little, the meshes are bisected
repeatedly where they are nearest, and the hulls of the parts, which contain every triangle, follow
non-convex shapes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from wbc.robot.collision.bodies import NamedSurface, named_surfaces, simple_shape
from wbc.robot.collision.fitting import Fit, convex, fit_close_hull, hull_corners
from wbc.robot.collision.shapes import Body, Hull, moved
from wbc.robot.formats.triangles import Triangles, as_bvh, without_unused_vertices
from wbc.robot.geometry import triangulated
from wbc.robot.model import Robot
from wbc.robot.postures import STANDING
from wbc.validate import Array, Index

TOLERANCES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)  # m, of hulls: the coarsest sufficient one is used
Pair = tuple[int, int]
MOST_PAIRS = 32  # of parts, for one pair of bodies
LEAST_PART = 5e-3  # m: parts are not cut any further
# Distances that differ by less [m] count as equal: parts that share a corner differ by rounding.
EQUAL_DISTANCE = 1e-6


class FinerPair(NamedTuple):
    """Bodies to be kept apart, each first from each second, in place of one pair."""

    first: tuple[Body, ...]
    second: tuple[Body, ...]
    distance: float  # least distance when standing [m]
    raw: float  # distance of the raw shapes [m]


@dataclass(frozen=True, eq=False)
class _Surface:
    """Triangles (m, 3) of some vertices (k, 3)."""

    vertices: Array
    faces: Index

    @cached_property
    def points(self) -> Array:
        """The vertices (k, 3) of the triangles."""
        return without_unused_vertices(self.vertices, self.faces).vertices

    @cached_property
    def hull(self) -> Array:
        """Corners of their hull, used for every tolerance."""
        return hull_corners(self.points)

    @cached_property
    def size(self) -> float:
        """Length of the bounding box's longest side [m]; 0 if it cannot be cut."""
        return 0.0 if len(self.faces) < 2 else float(np.ptp(self.points, axis=0).max())

    @cached_property
    def halves(self) -> tuple[_Surface, _Surface]:
        """Two parts, cut across the longest side; a triangle belongs to the side of its middle."""
        axis = int(np.argmax(np.ptp(self.points, axis=0)))
        middles = self.vertices[:, axis][self.faces].mean(axis=1)
        order = np.argsort(middles, kind="stable")
        cut = int(np.searchsorted(middles[order], 0.5 * (middles.min() + middles.max())))
        cut = min(max(cut, 1), len(order) - 1)
        halves = self.faces[order[:cut]], self.faces[order[cut:]]
        return _Surface(self.vertices, halves[0]), _Surface(self.vertices, halves[1])


class _RawShape:
    """The raw shape of a body, and what is derived from it on demand."""

    def __init__(self, found: NamedSurface, standing: pin.SE3) -> None:
        self.name, self.geometry, self.placement = found.name, found.geometry, found.placement
        self.place = standing * found.placement  # in the world, when standing
        self._fits: dict[float, _Part] = {}

    @cached_property
    def tree(self) -> coal.CollisionGeometry:
        """The geometry for coal's distances."""
        return as_bvh(*self.geometry) if isinstance(self.geometry, Triangles) else self.geometry

    @cached_property
    def surface(self) -> _Surface | None:
        """Its triangles; None for round shapes."""
        is_mesh = isinstance(self.geometry, Triangles | coal.BVHModelBase)
        return _Surface(*triangulated(self.geometry)) if is_mesh else None

    def fit(self, tolerance: float) -> _Part:
        """Return the hull of the whole shape; round shapes are not changed."""
        if tolerance not in self._fits:
            if self.surface is not None:
                self._fits[tolerance] = _Part.of(self.surface, tolerance)
            else:
                fit = simple_shape(self.geometry, "hull", self.name)
                is_hull = isinstance(fit.shape, Hull)
                core = convex(fit.shape.core) if is_hull else self.geometry
                self._fits[tolerance] = _Part(fit, NO_SURFACE, core)
        return self._fits[tolerance]


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of a raw shape: triangles in its own frame, none if it cannot be cut."""

    fit: Fit
    surface: _Surface
    geometry: coal.ShapeBase

    @classmethod
    def of(cls, surface: _Surface, tolerance: float) -> _Part:
        """Return a part."""
        fit = fit_close_hull(surface.points, tolerance, surface.hull)
        return cls(fit, surface, convex(fit.shape.core))

    @property
    def radius(self) -> float:
        """Rounding radius, which coal's shape does not include [m]."""
        return self.fit.shape.radius if isinstance(self.fit.shape, Hull) else 0.0

    @cached_property
    def halves(self) -> tuple[_Part, _Part]:
        """Its two halves, cached for bodies that are near several others."""
        first, second = self.surface.halves
        return _Part.of(first, TOLERANCES[-1]), _Part.of(second, TOLERANCES[-1])


NO_SURFACE = _Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))


class FinerShapes:
    """The raw shapes of a robot when standing, and finer ones for the pairs that need them."""

    def __init__(self, robot: Robot, bodies: Sequence[Body]) -> None:
        self._bodies = bodies
        R, p = robot.snapshot(robot.postures[STANDING]).joint_placements
        joints = [pin.SE3(*pose) for pose in zip(R, p, strict=True)]
        self._shapes = {
            one.name: _RawShape(one, joints[one.joint]) for one in named_surfaces(robot)
        }
        self._raw: dict[Pair, float] = {}
        self._made: dict[_Part, Body] = {}
        self._cut = Counter[str]()  # parts made of each body

    def are_described(self, pair: Pair) -> bool:
        """Return whether both bodies represent shapes of the robot's description."""
        return all(self._bodies[k].name in self._shapes for k in pair)

    def raw_distance(self, pair: Pair) -> float:
        """Return the distance [m] of two bodies' raw shapes when standing; 0 if they touch."""
        if pair not in self._raw:
            trees = [self._shape(k).tree for k in pair]
            self._raw[pair] = max(self._distance(pair, trees), 0.0)
        return self._raw[pair]

    def _shape(self, body: int) -> _RawShape:
        return self._shapes[self._bodies[body].name]

    def pair(self, pair: Pair, wanted: float) -> FinerPair:
        """Return finer bodies that are ``wanted`` apart, or as far as parts of 5 mm can show."""
        a, b = pair
        for tolerance in TOLERANCES:
            sides = [[self._shape(a).fit(tolerance)], [self._shape(b).fit(tolerance)]]
            if self._part_distance(pair, sides[0][0], sides[1][0]) >= wanted:
                break
        while True:
            apart = {
                (i, j): self._part_distance(pair, one, two)
                for i, one in enumerate(sides[0])
                for j, two in enumerate(sides[1])
            }
            distance = min(apart.values())
            nearest = next(
                parts for parts, far in apart.items() if far <= distance + EQUAL_DISTANCE
            )
            larger = int(sides[1][nearest[1]].surface.size > sides[0][nearest[0]].surface.size)
            part = sides[larger][nearest[larger]]
            full = (len(sides[larger]) + 1) * len(sides[1 - larger]) > MOST_PAIRS
            if distance >= wanted or part.surface.size < LEAST_PART or full:
                first, second = self._as_bodies(a, sides[0]), self._as_bodies(b, sides[1])
                return FinerPair(first, second, distance, self.raw_distance(pair))
            sides[larger][nearest[larger] : nearest[larger] + 1] = part.halves

    def _part_distance(self, pair: Pair, one: _Part, two: _Part) -> float:
        """Return the distance [m] of parts of two bodies."""
        return self._distance(pair, (one.geometry, two.geometry)) - one.radius - two.radius

    def _distance(self, pair: Pair, shapes: Sequence[coal.CollisionGeometry]) -> float:
        """Return the distance [m] of two geometries placed as two bodies' shapes are."""
        arguments: list[object] = []
        for k, geometry in zip(pair, shapes, strict=True):
            place = self._shape(k).place
            arguments += [geometry, coal.Transform3s(place.rotation, place.translation)]
        return float(coal.distance(*arguments, coal.DistanceRequest(), coal.DistanceResult()))

    def _as_bodies(self, body: int, parts: Sequence[_Part]) -> tuple[Body, ...]:
        """Return parts as bodies; a part that several pairs share is one body."""
        coarse, pose = self._bodies[body], self._shape(body).placement
        place = np.array(pose.rotation), np.array(pose.translation)
        for part in parts:
            if part not in self._made:
                self._cut[coarse.name] += len(parts) > 1
                name = f"{coarse.name}/{self._cut[coarse.name]}" if len(parts) > 1 else coarse.name
                shape = moved(part.fit.shape, *place)
                self._made[part] = Body(name, coarse.link, coarse.joint, shape, part.fit.bulge)
        return tuple(self._made[part] for part in parts)
