"""Finer shapes for bodies that stand nearer to each other than their simple shapes can tell.

The raw shapes (the meshes) say how far two bodies are apart when the robot stands. Where the simple
shapes leave less than the margin, the pair gets hulls; where these leave too little, the meshes are
cut in halves where they are nearest, again and again, and the hulls of the parts, which hold every
triangle, follow what is not convex.
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
from numpy.typing import NDArray

from wbc.robot.collision.bodies import named_surfaces, simple_shape
from wbc.robot.collision.fitting import Fit, convex, fit_close_hull, hull_corners
from wbc.robot.collision.nearest_triangles import Clusters, nearest_triangles
from wbc.robot.collision.shapes import Body, Hull, moved
from wbc.robot.formats.triangles import Triangles, as_bvh, without_spare
from wbc.robot.geometry import triangulated
from wbc.robot.model import Robot
from wbc.robot.postures import STANDING
from wbc.validate import Array

TOLERANCES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)  # m, of hulls: the coarsest that will do is used
Pair = tuple[int, int]
MOST_PAIRS = 32  # of parts, for one pair of bodies
SMALLEST = 5e-3  # m: parts are not cut any further
# Parts that share a corner are as near as each other [m] but for rounding, which must not choose.
EVEN = 1e-6


class FinerPair(NamedTuple):
    """Bodies to be kept apart, each first from each second, in place of one pair."""

    first: tuple[Body, ...]
    second: tuple[Body, ...]
    distance: float  # the least of them when standing [m]
    raw: float  # that of the raw shapes [m]


@dataclass(frozen=True, eq=False)
class _Surface:
    """Triangles (m, 3) of some vertices (k, 3)."""

    vertices: Array
    faces: NDArray[np.int64]

    @cached_property
    def points(self) -> Array:
        """Those vertices (k, 3) that triangles have."""
        return without_spare(self.vertices, self.faces).vertices

    @cached_property
    def hull(self) -> Array:
        """Corners of the hull round them: asked for with every tolerance."""
        return hull_corners(self.points)

    @cached_property
    def size(self) -> float:
        """Length of its longest side [m]; 0 if it cannot be cut."""
        return 0.0 if len(self.faces) < 2 else float(np.ptp(self.points, axis=0).max())

    @cached_property
    def halves(self) -> tuple[_Surface, _Surface]:
        """Two parts, cut across the longest side; a triangle goes where its middle is."""
        axis = int(np.argmax(np.ptp(self.points, axis=0)))
        middles = self.vertices[:, axis][self.faces].mean(axis=1)
        order = np.argsort(middles, kind="stable")
        cut = int(np.searchsorted(middles[order], 0.5 * (middles.min() + middles.max())))
        cut = min(max(cut, 1), len(order) - 1)
        halves = self.faces[order[:cut]], self.faces[order[cut:]]
        return _Surface(self.vertices, halves[0]), _Surface(self.vertices, halves[1])


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
        """Radius that coal does not know of [m]."""
        return self.fit.shape.radius if isinstance(self.fit.shape, Hull) else 0.0

    @cached_property
    def halves(self) -> tuple[_Part, _Part]:
        """Its two halves: of a body that is near several others they are asked for again."""
        first, second = self.surface.halves
        return _Part.of(first, TOLERANCES[-1]), _Part.of(second, TOLERANCES[-1])


NONE = _Surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))


class FinerShapes:
    """The raw shapes of a robot when standing, and finer ones for the pairs that need them."""

    def __init__(self, robot: Robot, bodies: Sequence[Body]) -> None:
        self._bodies = bodies
        self._shapes = {surface.name: surface for surface in named_surfaces(robot)}
        self._raw: dict[Pair, float] = {}
        self._clusters: dict[str, Clusters] = {}
        self._trees: dict[str, coal.BVHModelBase] = {}
        self._standing = robot.snapshot(robot.postures[STANDING])
        self._surfaces: dict[str, _Surface] = {}
        self._whole: dict[tuple[str, float], _Part] = {}
        self._made: dict[_Part, Body] = {}
        self._cut = Counter[str]()  # parts made of each body

    def know(self, pair: Pair) -> bool:
        """Whether both bodies stand for shapes of the robot's description."""
        return all(self._bodies[k].name in self._shapes for k in pair)

    @cached_property
    def _placements(self) -> list[pin.SE3]:
        R, p = self._standing.joint_placements
        return [pin.SE3(*pose) for pose in zip(R, p, strict=True)]

    def raw_distance(self, pair: Pair, near: float = 0.0) -> float:
        """Return the distance [m] of two bodies' raw shapes when standing; 0 where they meet.

        Where it is below ``near``, it may be less than what is returned, which is below that too.
        """
        if pair not in self._raw:
            self._raw[pair] = max(self._raw_distance(pair, near), 0.0)
        return self._raw[pair]

    def _raw_distance(self, pair: Pair, near: float) -> float:
        names = [self._bodies[k].name for k in pair]
        one, other = (self._clusters_of(name) for name in names)
        if one is None or other is None:
            return self._distance(pair, [self._tree(name) for name in names])
        places = [self._place(k) for k in pair]
        first, second, most = nearest_triangles(one, other, *places)
        if most < near:
            return most
        return self._distance(pair, (as_bvh(*first), as_bvh(*second)))

    def _clusters_of(self, name: str) -> Clusters | None:
        """Return a mesh's triangles in groups; None of other shapes."""
        geometry = self._shapes[name].geometry
        if not isinstance(geometry, Triangles):
            return None
        if name not in self._clusters:
            self._clusters[name] = Clusters(geometry)
        return self._clusters[name]

    def _tree(self, name: str) -> coal.CollisionGeometry:
        """Return a body's raw shape as coal measures it."""
        geometry = self._shapes[name].geometry
        if not isinstance(geometry, Triangles):
            return geometry
        if name not in self._trees:
            self._trees[name] = as_bvh(*geometry)
        return self._trees[name]

    def _place(self, body: int) -> pin.SE3:
        shape = self._shapes[self._bodies[body].name]
        return self._placements[shape.joint] * shape.placement

    def pair(self, pair: Pair, wanted: float) -> FinerPair:
        """Return finer bodies that stand ``wanted`` apart, or as far as parts of 5 mm leave."""
        a, b = pair
        for tolerance in TOLERANCES:
            sides = [[self._all_of(a, tolerance)], [self._all_of(b, tolerance)]]
            if self._apart(pair, sides[0][0], sides[1][0]) >= wanted:
                break
        while True:
            apart = {
                (i, j): self._apart(pair, one, two)
                for i, one in enumerate(sides[0])
                for j, two in enumerate(sides[1])
            }
            distance = min(apart.values())
            nearest = next(parts for parts, far in apart.items() if far <= distance + EVEN)
            larger = int(sides[1][nearest[1]].surface.size > sides[0][nearest[0]].surface.size)
            part = sides[larger][nearest[larger]]
            full = (len(sides[larger]) + 1) * len(sides[1 - larger]) > MOST_PAIRS
            if distance >= wanted or part.surface.size < SMALLEST or full:
                first, second = self._named(a, sides[0]), self._named(b, sides[1])
                return FinerPair(first, second, distance, self.raw_distance(pair))
            sides[larger][nearest[larger] : nearest[larger] + 1] = part.halves

    def _apart(self, pair: Pair, one: _Part, two: _Part) -> float:
        """Return the distance [m] of parts of two bodies."""
        return self._distance(pair, (one.geometry, two.geometry)) - one.radius - two.radius

    def _distance(self, pair: Pair, shapes: Sequence[coal.CollisionGeometry]) -> float:
        """Return the distance [m] of two geometries placed as two bodies' shapes are."""
        arguments: list[object] = []
        for k, geometry in zip(pair, shapes, strict=True):
            place = self._place(k)
            arguments += [geometry, coal.Transform3s(place.rotation, place.translation)]
        return float(coal.distance(*arguments, coal.DistanceRequest(), coal.DistanceResult()))

    def _all_of(self, body: int, tolerance: float) -> _Part:
        """Return the hull of all of a body's raw shape; what is round stays as it is."""
        name = self._bodies[body].name
        key = name, tolerance
        if key not in self._whole:
            geometry = self._shapes[name].geometry
            if isinstance(geometry, coal.BVHModelBase | Triangles):
                if name not in self._surfaces:
                    is_here = isinstance(geometry, Triangles)
                    surface = geometry if is_here else triangulated(geometry)
                    self._surfaces[name] = _Surface(surface.vertices, surface.faces)
                self._whole[key] = _Part.of(self._surfaces[name], tolerance)
            else:
                fit = simple_shape(geometry, "hull", name)
                core = convex(fit.shape.core) if isinstance(fit.shape, Hull) else geometry
                self._whole[key] = _Part(fit, NONE, core)
        return self._whole[key]

    def _named(self, body: int, parts: Sequence[_Part]) -> tuple[Body, ...]:
        """Return parts as bodies; one that several pairs share is one body."""
        coarse = self._bodies[body]
        pose = self._shapes[coarse.name].placement
        place = np.array(pose.rotation), np.array(pose.translation)
        for part in parts:
            if part not in self._made:
                self._cut[coarse.name] += len(parts) > 1
                name = f"{coarse.name}/{self._cut[coarse.name]}" if len(parts) > 1 else coarse.name
                shape = moved(part.fit.shape, *place)
                self._made[part] = Body(name, coarse.link, coarse.joint, shape, part.fit.bulge)
        return tuple(self._made[part] for part in parts)
