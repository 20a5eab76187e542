"""The shown frame with derived quantities, computed once for all layers."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from wbc.constraints.com_support import support_polygon
from wbc.reduction import RmpState, reduce
from wbc.robot import Foot, Robot, Snapshot
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array
from wbc.view.live.messages import ControllerInfo, Frame
from wbc.view.scene import sole_corners

GROUND_TOLERANCE = 2e-3  # m: of a standing sole's corners


class ShownFrame:
    """A frame with the robot's snapshot and its pendulum; computed when first asked for.

    ``followed``: (3,) [m]: which point of the world is shown at the page's origin.
    """

    def __init__(
        self,
        robot: Robot,
        frame: Frame,
        cast: ControllerInfo | None,
        previous: RmpState | None = None,
        terrain: Terrain = LEVEL,
    ) -> None:
        self.robot, self.frame, self.cast, self.terrain = robot, frame, cast, terrain
        self._previous = previous
        self.followed: Array = np.zeros(3)

    @cached_property
    def snapshot(self) -> Snapshot:
        """The robot's state."""
        return self.robot.snapshot(self.frame.q, self.frame.v)

    @cached_property
    def forces(self) -> list[tuple[str, Array, Array]]:
        """Frame, place and wrench (6,) of each contact; none at the velocity level."""
        told = {} if self.frame.told is None else self.frame.told.forces
        return [(k, self.snapshot.position(k), w) for k, w in told.items() if k in self.held]

    @cached_property
    def known_wrenches(self) -> list[tuple[Array, Array]]:
        """The known external wrenches, with the points where they act."""
        told = {} if self.frame.told is None else self.frame.told.wrenches
        return [(self.snapshot.position(name), wrench) for name, wrench in told.items()]

    @cached_property
    def state(self) -> RmpState:
        """The reaction mass pendulum: of the contact forces if they are known, else at rest.

        Of a robot that does not stand it is in flight: no leg, wherever its CoM is.
        """
        known = [one[1:] for one in self.forces]
        return reduce(
            self.snapshot,
            feet=[foot.name for foot in self.standing] or None,
            wrenches=known if known or not self.has_ground else None,
            previous=self._previous,
            ground_height=float(self.on_ground(self.snapshot.com)[2]),
        )

    @cached_property
    def held(self) -> tuple[str, ...]:
        """Frames that are held."""
        return () if self.cast is None else tuple(one.frame for one in self.cast.contacts)

    @cached_property
    def standing(self) -> list[Foot]:
        """The feet that are held; without a controller those whose soles are on the ground."""
        feet = self.robot.feet.values()
        if self.cast is None:
            return [foot for foot in feet if self._touches(foot)]
        return [foot for foot in feet if {foot.frame, foot.link} & set(self.held)]

    @cached_property
    def has_ground(self) -> bool:
        """Whether anything stands; a floating robot has no leg and no CoP."""
        return bool(self.standing or self.forces)

    @cached_property
    def polygon(self) -> Array | None:
        """Corners (k, 2) of the support polygon; None if no foot stands."""
        names = [foot.name for foot in self.standing]
        return support_polygon(self.snapshot, names) if names else None

    def on_ground(self, points: Array) -> Array:
        """Return the points (..., 3) of the ground above or below points (..., 2) or (..., 3)."""
        return self.terrain.surface(np.atleast_2d(points)).reshape(*points.shape[:-1], 3)

    def _touches(self, foot: Foot) -> bool:
        corners = self.sole(foot)
        return bool(np.abs((corners - self.on_ground(corners))[:, 2]).max() < GROUND_TOLERANCE)

    def sole(self, foot: Foot) -> Array:
        """Return the corners (k, 3) of a foot's sole."""
        return sole_corners(self.snapshot, foot)
