"""Pairs of bodies near collision, and the obstacles around the robot."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wbc.robot import Robot
from wbc.robot.collision import CollisionModel, HalfSpace
from wbc.validate import Array
from wbc.view.live.layers.layer import (
    GREEN,
    ORANGE,
    SKY,
    VERMILION,
    Context,
    Layer,
    surface_of,
    wxyz,
)
from wbc.view.live.messages import ControllerInfo, PairsInfo
from wbc.view.live.shown_frame import ShownFrame

NEAREST = 6  # pairs listed for each constraint
MEASURED = 25  # pairs measured for each constraint: more than are listed, as margins differ
DRAWN = 0.05  # of the robot's size: pairs with more clearance than this are not drawn
NEAR = 2.0  # times its margin: pairs nearer than this are drawn in orange
WALL, THING = 0.12, 0.4  # opacity of half-spaces, which are infinite, and of other obstacles
TOUCHING = 1e-3  # m: pairs this near to their margins are drawn in red


class Pair(NamedTuple):
    """Two bodies that are near each other."""

    label: str
    distance: float  # [m]
    margin: float  # least distance allowed [m]
    ends: Array  # nearest points (2, 3) [m]

    @property
    def colour(self) -> tuple[int, int, int]:
        """Of the pair: red at its margin, orange near it, green elsewhere."""
        if self.distance < self.margin + TOUCHING:
            return VERMILION
        return ORANGE if self.distance < NEAR * self.margin + TOUCHING else GREEN


class Watched:
    """The pairs of a constraint, measured in the viewer's thread."""

    def __init__(self, robot: Robot, info: PairsInfo) -> None:
        self._info = info
        self._model = CollisionModel(robot, info.bodies, info.pairs)
        self._first = len(info.bodies) - len(info.obstacles)

    def nearest(self, shown: ShownFrame) -> list[Pair]:
        """Return the nearest pairs, those with the least clearance first."""
        for k, (name, _) in enumerate(self._info.obstacles):
            if name in shown.frame.obstacles:
                self._model.place(self._first + k, *shown.frame.obstacles[name])
        found = self._model.nearest(shown.snapshot, MEASURED)
        pairs = [
            Pair(
                self._model.labels[which],
                float(found.distance[k]),
                float(self._info.margins[which]),
                np.stack([found.point[k], found.point[k] - found.distance[k] * found.normal[k]]),
            )
            for k, which in enumerate(found.pairs.tolist())
        ]
        return sorted(pairs, key=lambda pair: pair.distance - pair.margin)[:NEAREST]


class MarginsLayer(Layer):
    """Lines between the nearest points of the nearest pairs.

    ``nearest``: the nearest pairs in the last frame, the one with the least clearance first.
    """

    label = "Nearest pairs"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._watched: list[Watched] = []
        self.nearest: list[Pair] = []
        self._lines = self.lines("lines", GREEN, thickness=0.008, visible=False)

    def cast(self, cast: ControllerInfo) -> None:
        """Set the pairs of the controller's collision constraints."""
        self._watched = [Watched(self.robot, info) for info in cast.pairs]
        self.nearest = []

    def show(self, shown: ShownFrame) -> None:
        """Measure and draw."""
        found = [pair for watched in self._watched for pair in watched.nearest(shown)]
        self.nearest = sorted(found, key=lambda pair: pair.distance - pair.margin)
        near = [one for one in found if one.distance - one.margin < DRAWN * self.size]
        self._lines.visible = bool(near)
        if near:
            self._lines.points = np.array([pair.ends for pair in near], dtype=np.float32)
            colours = np.array([pair.colour for pair in near], dtype=np.uint8)
            self._lines.colors = np.repeat(colours[:, None], 2, axis=1)


class ObstaclesLayer(Layer):
    """The obstacles around the robot."""

    label = "Obstacles"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._nodes = dict[str, Any]()

    def cast(self, cast: ControllerInfo) -> None:
        """Create the obstacles of the constraints."""
        for node in self._nodes.values():
            node.remove()
        self._nodes = {}
        for info in cast.pairs:
            for name, shape in info.obstacles:
                wall = isinstance(shape, HalfSpace)
                looks = {"opacity": WALL if wall else THING, "cast_shadow": not wall}
                surface = surface_of(shape)
                self._nodes[name] = self.mesh(name, surface, SKY, flat_shading=True, **looks)

    def show(self, shown: ShownFrame) -> None:
        """Move them to their current poses."""
        for name, (rotation, origin) in shown.frame.obstacles.items():
            if name in self._nodes:
                self._nodes[name].wxyz = wxyz(rotation)
                self._nodes[name].position = origin
