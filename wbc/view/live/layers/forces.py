"""Contact forces as arrows, and their friction cones."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.constraints.friction import FrictionCone
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import cone
from wbc.validate import Array
from wbc.view.live.layers.layer import BLUE, GREEN, GREY, VERMILION, Context, Layer, wxyz
from wbc.view.live.messages import ControllerInfo
from wbc.view.live.shown_frame import ShownFrame

REACH = 0.5  # of the robot's size: the arrow of a force as large as the robot's weight
CONE = 0.15  # of the robot's size: height of a cone
FLIP = np.diag([1.0, -1.0, -1.0])  # a half-turn: meshes of cones have their apex on top
CONE_TOLERANCE = 0.02  # a force this near the edge, as a fraction of the cone, is drawn in red
LEAST = 1e-3  # of the weight: smaller forces are not drawn


class ForcesLayer(Layer):
    """The force of each contact at its CoP, red at the edge of its cone; blue: external forces."""

    label = "Contact forces"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._arrows = self.arrows("arrows", GREEN, shaft=0.007, head=0.018, length=0.04)
        self._cones = dict[str, Any]()
        self._friction = dict[str, FrictionCone]()

    def cast(self, cast: ControllerInfo) -> None:
        """Make the cones of the contacts."""
        for node in self._cones.values():
            node.remove()
        self._friction = {
            one.frame: one.friction for one in cast.contacts if one.friction is not None
        }
        height = CONE * self.size
        self._cones = {}
        for frame, friction in self._friction.items():
            surface = cone(friction.coefficient * height, 0.5 * height)
            vertices = surface.vertices @ FLIP + [0.0, 0.0, 0.5 * height]
            self._cones[frame] = self.mesh(
                f"cone {frame}",
                Triangles(vertices, surface.faces),
                GREY,
                opacity=0.18,
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )

    def show(self, shown: ShownFrame) -> None:
        """Draw the forces of the tick; none at the velocity level."""
        least = LEAST * self.robot.weight
        acting = [one for one in shown.forces if np.linalg.norm(one[2][:3]) > least]
        for frame, node in self._cones.items():
            node.visible = any(name == frame for name, *_ in acting)
        known = [one for one in shown.known_wrenches if np.linalg.norm(one[1][:3]) > 0.0]
        self._arrows.visible = bool(acting or known)
        if not self._arrows.visible:
            return
        scale = REACH * self.size / self.robot.weight
        starts = [place for place, _ in known]
        ends = [place + scale * wrench[:3] for place, wrench in known]
        colours = [BLUE] * len(known)
        for name, place, wrench in acting:
            rotation = shown.snapshot.rotation(name)
            start = point_of_action(place, wrench, rotation)
            starts.append(start)
            ends.append(start + scale * wrench[:3])
            colours.append(VERMILION if self._at_edge(name, rotation.T @ wrench[:3]) else GREEN)
            if name in self._cones:
                node = self._cones[name]
                node.position, node.wxyz = start, wxyz(rotation)
        self._arrows.points = np.stack([starts, ends], axis=1).astype(np.float32)
        self._arrows.colors = np.array(colours, dtype=np.uint8)

    def _at_edge(self, frame: str, force: Array) -> bool:
        """Whether a force (3,) in a contact's axes is nearly at the edge of its cone."""
        friction = self._friction.get(frame)
        if friction is None:
            return False
        least_left = -float((friction.matrix() @ force).max())
        return least_left < CONE_TOLERANCE * friction.coefficient * float(force[2])


def point_of_action(place: Array, wrench: Array, rotation: Array) -> Array:
    """Return the CoP of one contact at ``place`` (3,) from its wrench (6,).

    Without normal force it is the frame's origin.
    """
    force, moment = rotation.T @ wrench[:3], rotation.T @ wrench[3:]
    if force[2] <= 0.0:
        return place
    return np.asarray(place + rotation @ [-moment[1] / force[2], moment[0] / force[2], 0.0])
