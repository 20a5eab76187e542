"""The robot: its visual shapes, or its collision shapes if those cannot be read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.errors import ModelError
from wbc.rmp.ellipsoid import equimomental
from wbc.robot import Robot
from wbc.robot.collision import fitted_bodies
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.validate import Array
from wbc.view.live.layers.layer import GREY, Context, Layer, surface_of, wxyz
from wbc.view.live.shown_frame import ShownFrame

PALE = 0.92  # largest brightness of a shape: shading would not show on white


class RobotShapes:
    """The shapes of a robot in the frames of their joints.

    ``shapes``: index of the joint, and the mesh in its frame.
    ``note``: which shapes replace the visual ones, and why; empty if none do.
    """

    def __init__(self, robot: Robot) -> None:
        self.note = ""
        self.shapes: Sequence[tuple[int, Mesh]] = ()
        try:
            self.shapes = RobotMeshes(robot).in_joint_frames
        except ModelError as error:
            self.note = f"visual shapes cannot be read: {error}"
        if not self.shapes:
            self.shapes = self._simple(robot)

    def _simple(self, robot: Robot) -> Sequence[tuple[int, Mesh]]:
        try:
            bodies = fitted_bodies(robot)
        except ModelError as error:
            why = self.note or "there are no visual shapes"
            self.note = f"{why}, and no collision shapes to draw instead: {error}"
            return ()
        self.note = f"collision shapes are drawn; {self.note or 'there are no visual ones'}"
        grey = (GREY[0] / 255.0, GREY[1] / 255.0, GREY[2] / 255.0)
        made = [(body, surface_of(body.shape)) for body in bodies]
        return [
            (body.joint, Mesh(body.link, surface.vertices, surface.faces, grey))
            for body, surface in made
        ]

    def extent(self, robot: Robot, q: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest corner (3,) of all shapes at ``q`` [m].

        Those of the ellipsoid's axes, if there are no shapes.
        """
        snapshot = robot.snapshot(q)
        rotations, origins = snapshot.joint_placements
        corners = [
            mesh.vertices @ rotations[joint].T + origins[joint] for joint, mesh in self.shapes
        ]
        if not corners:
            ellipsoid = equimomental(snapshot.inertia, robot.mass)
            arms = ellipsoid.semi_axes[:, None] * ellipsoid.axes.T
            corners = [origins, snapshot.com + arms, snapshot.com - arms]
        points = np.concatenate([*corners, snapshot.com[None]])
        return points.min(axis=0), points.max(axis=0)


class RobotLayer(Layer):
    """The robot in its current configuration.

    ``links``: name of the link, and the node, of each shape.
    """

    label = "Robot"

    def __init__(self, context: Context, shapes: RobotShapes) -> None:
        super().__init__(context)
        self._joints = sorted({joint for joint, _ in shapes.shapes})
        self._nodes = [
            self.scene.add_frame(f"{self.path}/{joint}", show_axes=False) for joint in self._joints
        ]
        self.links = []
        for number, (joint, mesh) in enumerate(shapes.shapes):
            r, g, b = (round(255.0 * min(part, PALE)) for part in mesh.colour)
            path = f"{joint}/{number} {mesh.name}"
            self.links.append((mesh.name, self.mesh(path, mesh, (r, g, b), flat_shading=True)))

    def show(self, shown: ShownFrame) -> None:
        """Move the links."""
        self.place(shown.frame.q)

    def place(self, q: Array) -> None:
        """Move the links to a configuration (nq,)."""
        rotations, origins = self.robot.snapshot(q).joint_placements
        for node, joint in zip(self._nodes, self._joints, strict=True):
            node.wxyz, node.position = wxyz(rotations[joint]), origins[joint]

    def set_opacity(self, opacity: float) -> None:
        """Set the opacity of the robot, from 0 to 1."""
        for _, mesh in self.links:
            mesh.opacity = None if opacity >= 1.0 else opacity


class BesideLayer(RobotLayer):
    """A second figure beside the robot, such as the human whose motion it follows."""

    label = "Human"

    def show(self, shown: ShownFrame) -> None:
        """Move its links."""
        if shown.frame.beside is not None:
            self.place(shown.frame.beside)
