"""A robot description as read from a file, before any joint is locked."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import pinocchio as pin

State = Mapping[str, tuple[float, ...]]  # joint name -> its coordinates in q


class GeometrySource(Protocol):
    """Where the shapes of a robot come from; meshes are slow to load, hence on demand."""

    def load(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> pin.GeometryModel:
        """Return the shapes of ``kind``, placed on ``model``, of all links or only of ``links``.

        ``model`` may have joints locked since it was read: links keep their frames.

        Raises
        ------
        ModelError
            A mesh exists but cannot be read.
        """
        ...


@dataclass(frozen=True)
class Description:
    """What one URDF or MJCF file says.

    Attributes
    ----------
    name:
        The robot's name in the file.
    path:
        The file.
    model:
        Kinematics and inertias, all joints free; joint 1 is the free-flyer.
    geometry:
        Loads the collision or visual shapes when asked.
    coupled:
        Joints that the file ties to another one, and to which; they must be locked.
    states:
        Named configurations the file holds (MJCF key frames).
    notes:
        What was tolerated, in words.
    """

    name: str
    path: Path
    model: pin.Model
    geometry: GeometrySource
    coupled: Mapping[str, str] = field(default_factory=dict)
    states: Mapping[str, State] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
