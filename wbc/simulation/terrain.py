"""The ground: a plane, level or sloped, steps on it, and walls beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.gait.walls import Wall, check_walls
from wbc.kinds import check_switches
from wbc.rotations import upright_on
from wbc.run.saving import plain
from wbc.validate import Array, check_fields, finite_array, list_of, read_only, set_fields

# MuJoCo's solimp of contacts: impedance at first and at depth, and that depth [m]. With MuJoCo's
# defaults, 0.9 and 0.95, feet sink in five times as far.
IMPEDANCE = (0.98, 0.995, 0.001)


@dataclass(frozen=True, eq=False)
class Step:
    """A box on the ground.

    Attributes
    ----------
    centre:
        Of its upper face (3,) [m], world axes.
    size:
        Side lengths (3,) along its own x, y, z [m].
    yaw:
        Of the box, about the vertical [rad].
    friction:
        Coefficient of friction; None: that of the ground.
    slope:
        Rise over run of its upper face along its own x and y.
    """

    centre: Array
    size: Array
    yaw: float = 0.0
    friction: float | None = None
    slope: tuple[float, float] = (0.0, 0.0)

    if TYPE_CHECKING:  # array-likes are given, arrays are read

        def __init__(
            self,
            centre: ArrayLike,
            size: ArrayLike,
            yaw: float = ...,
            friction: float | None = ...,
            slope: tuple[float, float] = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        x, y = finite_array("step, slope", self.slope, (2,)).tolist()
        set_fields(
            self,
            centre=read_only(finite_array("step, centre", self.centre, (3,))),
            size=read_only(finite_array("step, size", self.size, (3,))),
            slope=(x, y),
        )
        if (self.size <= 0.0).any():
            raise InvalidInputError(f"step, size: sides must be positive, got {self.size.tolist()}")
        check_fields(self, "step, ", "yaw")
        if self.friction is not None:
            check_fields(self, "step, ", "friction", least=0.0)

    @property
    def axes(self) -> Array:
        """Its x and y axes in the world (2, 2), as columns."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array(((c, -s), (s, c)))

    @property
    def rotation(self) -> Array:
        """Its axes in the world, tilt included (3, 3), as columns."""
        normal = np.array((-self.slope[0], -self.slope[1], 1.0))
        turn = np.eye(3)
        turn[:2, :2] = self.axes
        return turn @ upright_on(normal / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class Terrain:
    """The ground: a plane through the world's origin, steps, and walls.

    Attributes
    ----------
    friction:
        Coefficient of friction of the ground; the cone is circular.
    slope:
        Rise over run of the plane along x and y.
    steps:
        Boxes.
    time_constant:
        Of contacts, critically damped [s]; MuJoCo's ``solref``. At 0.01 s a standing robot sinks in
        by 0.06 mm.
    drift:
        Whether contacts compensate the drift J' q', which MuJoCo's do not; see
        :mod:`wbc.simulation.states`. It takes time.
    walls:
        Plates beside the robot; :meth:`height` ignores them.
    """

    friction: float = 0.8
    slope: tuple[float, float] = (0.0, 0.0)
    steps: tuple[Step, ...] = ()
    time_constant: float = 0.01
    drift: bool = False
    walls: tuple[Wall, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, "terrain, ", "friction", least=0.0)
        check_fields(self, "terrain, ", "time_constant", above=0.0)
        check_switches(self, "terrain, ", "drift")
        x, y = finite_array("terrain, slope", self.slope, (2,)).tolist()
        set_fields(
            self,
            slope=(x, y),
            steps=list_of("terrain, steps", self.steps, Step, "Step(centre, size)"),
            walls=check_walls("terrain", self.walls),
        )

    @property
    def upright(self) -> Array:
        """(3,) whose product with a point is its vertical distance from the plane [m]."""
        return np.array([-self.slope[0], -self.slope[1], 1.0])

    @property
    def normal(self) -> Array:
        """Unit normal (3,) of the plane, upwards."""
        return self.upright / np.linalg.norm(self.upright)

    def height(self, points: Array) -> Array:
        """Return the height (k,) of the ground, or of a step on it, at points (k, 2) [m]."""
        heights = points @ np.array(self.slope)
        for step in self.steps:
            offset = points - step.centre[:2]
            rise = (offset @ step.axes) @ np.array(step.slope)
            local = (np.column_stack((offset, rise)) @ step.rotation)[:, :2]
            inside = (np.abs(local) <= 0.5 * step.size[:2]).all(axis=1)
            heights = np.where(inside, np.maximum(heights, step.centre[2] + rise), heights)
        return heights

    def surface(self, points: Array) -> Array:
        """Return points (k, 2) or (k, 3) projected vertically onto the surface (k, 3) [m]."""
        level = points[:, :2]
        return np.column_stack((level, self.height(level)))

    def to_data(self) -> dict[str, Any]:
        """Return plain data for :meth:`from_data`."""
        return dict(plain(self))

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Terrain:
        """Return the terrain of :meth:`to_data`."""
        steps = tuple(Step(**step) for step in data["steps"])
        walls = tuple(Wall(**wall) for wall in data.get("walls", ()))
        return cls(**{**data, "steps": steps, "walls": walls})


LEVEL = Terrain()
