"""The tasks' targets: ghosts of frames, CoM and ellipsoid; and handles to drag them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from viser.transforms import SO3

from wbc.errors import WbcError
from wbc.rmp.ellipsoid import Ellipsoid, equimomental
from wbc.spatial import COMPONENTS, DIAGONAL, vech, vech_inverse
from wbc.validate import Array
from wbc.view.live.layers.layer import GREEN, Context, Layer, place_ellipsoid, wxyz
from wbc.view.live.messages import ControllerInfo, SetTarget, TaskInfo
from wbc.view.live.shown_frame import ShownFrame

HANDLE = 0.16  # of the robot's size
HELD = 0.6  # s after the last drag until a handle follows its target again

Drag = Callable[[SetTarget], None]


@dataclass
class Place:
    """The targets of one frame, or of the CoM: by at most one task each."""

    frame: str  # empty for the CoM
    position: TaskInfo | None = None
    rotation: TaskInfo | None = None

    def here(self, shown: ShownFrame) -> Array:
        """Return the actual position (3,) [m]."""
        return shown.snapshot.position(self.frame) if self.frame else shown.snapshot.com

    def pose(self, shown: ShownFrame) -> tuple[Array, Array] | None:
        """Return target position and rotation; without a target the position is the actual one.

        None if there is no target.
        """
        targets = shown.frame.targets
        if any(one and one.name not in targets for one in (self.position, self.rotation)):
            return None
        p = self.here(shown)
        R: Array = np.eye(3)  # world axes without a target rotation
        if self.position is not None:
            wanted = targets[self.position.name][0]
            chosen = [k for k, axis in enumerate("xyz") if axis in self.position.rows]
            p = p.copy()
            p[chosen] = wanted[chosen]
        if self.rotation is not None:
            R = targets[self.rotation.name][-1]
        return p, R

    def task_requests(self, position: Array, rotation: Array) -> Iterator[SetTarget]:
        """Yield the requests that set a pose as the target."""
        if self.position is not None and self.position is self.rotation:
            yield SetTarget(self.position.name, (position, rotation))
            return
        if self.position is not None:
            yield SetTarget(self.position.name, (position,))
        if self.rotation is not None:
            yield SetTarget(self.rotation.name, (rotation,))


def places_of(cast: ControllerInfo) -> list[Place]:
    """Return the frames, and the CoM, for which tasks have targets."""
    found = dict[str, Place]()
    for task in cast.tasks:
        frame = "" if task.kind == "com" else task.frame
        if task.kind not in ("com", "position", "orientation", "pose"):
            continue
        place = found.get(frame, Place(frame))
        if task.kind != "orientation" and place.position is None:
            place.position = task
        if task.kind in ("orientation", "pose") and place.rotation is None:
            place.rotation = task
        found[frame] = place
    return list(found.values())


class TargetsLayer(Layer):
    """Ghosts at the targets of the tasks, with lines to them from the actual positions."""

    label = "Targets"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._places: list[tuple[Place, Any]] = []
        self._shapes: list[tuple[TaskInfo, Any]] = []
        self._axes: list[TaskInfo] = []
        self._lines = self.lines("lines", GREEN, thickness=0.004, visible=False)
        self._arrows = self.arrows("axes", GREEN, shaft=0.005, head=0.012, length=0.03)

    def cast(self, cast: ControllerInfo) -> None:
        """Create a ghost for each target."""
        for _, node in (*self._places, *self._shapes):
            node.remove()
        self._places = [(place, self._ghost(place)) for place in places_of(cast)]
        shaped = [task for task in cast.tasks if task.kind in ("inertia", "principal")]
        self._shapes = [(task, self.rings(f"ellipsoid {task.name}", GREEN, 2.0)) for task in shaped]
        self._axes = [task for task in cast.tasks if task.kind == "axis"]

    def _ghost(self, place: Place) -> Any:
        if place.rotation is None:
            return self.scene.add_icosphere(
                f"{self.path}/{place.frame or 'com'}",
                0.022 * self.size,
                GREEN,
                opacity=0.5,
                cast_shadow=False,
                receive_shadow=False,
            )
        return self.scene.add_frame(
            f"{self.path}/{place.frame}",
            axes_length=0.07 * self.size,
            axes_radius=0.004 * self.size,
            origin_color=GREEN,
            origin_radius=0.009 * self.size,
        )

    def show(self, shown: ShownFrame) -> None:
        """Move the ghosts to the current targets."""
        lines = []
        for place, node in self._places:
            pose = place.pose(shown)
            node.visible = pose is not None
            if pose is None:
                continue
            node.position, node.wxyz = pose[0], wxyz(pose[1])
            if place.position is not None:
                lines.append((place.here(shown), pose[0]))
        self._lines.visible = bool(lines)
        if lines:
            self._lines.points = np.array(lines, dtype=np.float32)
        for task, node in self._shapes:
            ellipsoid = wanted_ellipsoid(task, shown)
            node.visible = ellipsoid is not None
            if ellipsoid is not None:
                place_ellipsoid(node, ellipsoid, shown.snapshot.com)
        self._show_axes(shown)

    def _show_axes(self, shown: ShownFrame) -> None:
        targets = shown.frame.targets
        wanted = [task for task in self._axes if task.name in targets]
        self._arrows.visible = bool(wanted)
        if wanted:
            origins = np.array([shown.snapshot.position(task.frame) for task in wanted])
            ends = origins + 0.15 * self.size * np.array([targets[task.name][0] for task in wanted])
            self._arrows.points = np.stack([origins, ends], axis=1).astype(np.float32)


def wanted_ellipsoid(task: TaskInfo, shown: ShownFrame) -> Ellipsoid | None:
    """Return the target ellipsoid of a task; components without a target are the actual ones.

    None if no body can have such an inertia, or the task has no target.
    """
    target = shown.frame.targets.get(task.name)
    if target is None:
        return None
    snapshot, mass = shown.snapshot, shown.robot.mass
    try:
        if task.kind == "principal":
            _, axes = np.linalg.eigh(snapshot.inertia)  # smallest first, as the target
            return equimomental((axes * target[0]) @ axes.T, mass)
        actual = vech(snapshot.inertia_in(task.frame))
        wanted = actual.copy()
        if task.rows == ("trace",):
            wanted *= target[0][DIAGONAL].sum() / actual[DIAGONAL].sum()
        else:
            chosen = [COMPONENTS.index(row) for row in task.rows]
            wanted[chosen] = target[0][chosen]
        R = np.eye(3) if task.frame == "world" else snapshot.rotation(task.frame)
        return equimomental(R @ vech_inverse(wanted) @ R.T, mass)
    except WbcError:
        return None


class HandlesLayer(Layer):
    """Handles by which the targets of frames and of the CoM are dragged."""

    label = "Drag targets"

    def __init__(self, context: Context, drag: Drag) -> None:
        super().__init__(context)
        self._drag = drag
        self._handles: list[tuple[Place, Any]] = []
        self._touched = dict[str, float]()

    def cast(self, cast: ControllerInfo) -> None:
        """Create a handle for each target that can be dragged."""
        for _, handle in self._handles:
            handle.remove()
        self._handles = [(place, self._handle(place)) for place in places_of(cast)]

    def _handle(self, place: Place) -> Any:
        moved = place.position is not None
        active = (True, True, True)
        if place.position is not None and place.rotation is None:
            x, y, z = (axis in place.position.rows for axis in "xyz")
            active = (x, y, z)
        handle = self.scene.add_transform_controls(
            f"{self.path}/{place.frame or 'com'}",
            scale=HANDLE * self.size,
            disable_axes=not moved,
            disable_sliders=not moved,
            disable_rotations=place.rotation is None,
            active_axes=active,
            depth_test=False,
        )

        async def dragged(event: Any) -> None:  # async: handled in the order of the events
            self._touched[place.frame] = time.monotonic()
            rotation = np.asarray(SO3(np.asarray(event.target.wxyz)).as_matrix())
            for wish in place.task_requests(np.asarray(event.target.position).copy(), rotation):
                self._drag(wish)

        handle.on_update(dragged)
        return handle

    def show(self, shown: ShownFrame) -> None:
        """Move the handles to the targets, except those that are being dragged."""
        now = time.monotonic()
        for place, handle in self._handles:
            if now - self._touched.get(place.frame, -HELD) < HELD:
                continue
            pose = place.pose(shown)
            handle.visible = pose is not None
            if pose is not None:
                handle.position, handle.wxyz = pose[0], wxyz(pose[1])
