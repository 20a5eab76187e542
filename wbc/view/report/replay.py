"""The data of a report's replay: the shapes, and the poses of moving parts in each frame."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from wbc.problem.pendulum.result import PendulumHistory
from wbc.rmp.ellipsoid import equimomental, reaction_mass_radii
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.validate import Array
from wbc.view import palette, style
from wbc.view.history import DrawableRun
from wbc.view.pendulum_plots import SOLID
from wbc.view.solids import board_surfaces, limit_triangles, solid_surface

TRIANGLES = 40_000  # of the robot
FPS, MOST = 30.0, 900  # frames per second, and in all
STEPS = 65535  # of a coordinate over the extent of its mesh
WALL = 0.7  # m: half the side of a wall
COLOURS = {
    "principal": style.PRINCIPAL,
    "target": style.YELLOW,
    "sole": style.ORANGE,
    "board": palette.BOARD,
}
THIN = 0.03  # m: thickness of a planar pendulum's wheel


def replay_rows(time: Array) -> list[int]:
    """Return the rows to show, evenly spread, including the first and the last."""
    span = float(time[-1] - time[0])
    count = min(len(time), MOST, max(2, round(span * FPS) + 1))
    wanted = np.linspace(time[0], time[-1], count)
    return np.unique(np.searchsorted(time, wanted - 1e-9).clip(0, len(time) - 1)).tolist()


def replay_data(run: DrawableRun, rows: Sequence[int]) -> dict[str, Any]:
    """Return plain data: arrays as base64 text of little-endian numbers."""
    robot = run.robot
    shapes = RobotMeshes(robot).in_joint_frames
    meshes = limit_triangles([mesh for _, mesh in shapes], TRIANGLES)
    poses = [run.pose(row) for row in rows]
    snapshots = [robot.snapshot(pose.q) for pose in poses]
    com = np.array([one.com for one in snapshots])
    ellipsoids = [equimomental(one.inertia, robot.mass) for one in snapshots]
    radii = [reaction_mass_radii(one.inertia(), robot.mass) for one in ellipsoids]
    rotations = np.concatenate([one.joint_placements[0] for one in snapshots])
    origins = np.concatenate([one.joint_placements[1] for one in snapshots])
    turns = Rotation.from_matrix(rotations).as_quat()
    return {
        "time": _numbers(run.time[rows]),
        "parts": [
            {"joint": joint, "colour": list(mesh.colour), **_surface(mesh)}
            for (joint, _), mesh in zip(shapes, meshes, strict=True)
        ],
        "joints": len(origins) // len(rows),
        # (frames, joints, 7): origin, quaternion xyzw
        "places": _numbers(np.column_stack((origins, turns))),
        "com": _numbers(com),
        "feet": _numbers(run.terrain.surface(com)),  # (frames, 3): of the leg
        "axes": _numbers([one.axes for one in ellipsoids]),  # (frames, 9): as columns
        # (frames, 6): semi-axes, radii of the masses
        "sizes": _numbers(np.column_stack(([one.semi_axes for one in ellipsoids], radii))),
        "stands": [pose.stands and bool(robot.feet) for pose in poses],
        "grounded": any(pose.grounded for pose in poses),
        "slope": list(run.terrain.slope),
        "boards": [_surface(one) for one in board_surfaces(run.terrain)],
        "soles": [*_soles(run)],
        "obstacles": [
            {**_surface(_obstacle(run, name)), "places": _numbers(track.place[list(rows)])}
            for name, track in run.obstacles.items()
        ],
        "aims": [
            {
                "name": name,
                "points": _numbers(run.points[name][list(rows)]),
                "wanted": _numbers(targets[list(rows)]),
            }
            for name, targets in run.targets.items()
        ],
        "phases": [run.phase_at(row) for row in rows],
        "colours": COLOURS,
    }


def pendulum_replay(history: PendulumHistory, rows: Sequence[int]) -> dict[str, Any]:
    """Return the data of a pendulum, which has no meshes, but a leg with its own foot."""
    radii, axes = history.radii[rows], history.axes[rows]
    if history.flat:  # a wheel in the plane of x and z
        across = np.abs(axes[:, 1])  # (frames, 3): component of each axis normal to the plane
        semi_axes = radii[:, :1] * np.maximum(1.0 - across, THIN)
    else:
        semi_axes = SOLID * radii
    feet = history.foot[rows]
    return {
        "time": _numbers(history.time[rows]),
        "parts": [],
        "joints": 0,
        "places": "",
        "com": _numbers(history.com[rows]),
        "axes": _numbers(axes.reshape(-1, 9)),
        "sizes": _numbers(np.concatenate((semi_axes, radii), axis=1)),
        "feet": _numbers(feet),  # (frames, 3), NaN in flight
        "stands": np.isfinite(feet).all(axis=1).tolist(),
        "grounded": True,
        "slope": [0.0, 0.0],
        "boards": [],
        "soles": [],
        "obstacles": [],
        "aims": [],
        "phases": [history.phase[row] for row in rows],
        "colours": COLOURS,
        "layers": ["ground", "ellipsoid", "masses", "com", "leg", "follow"],
    }


def _soles(run: DrawableRun) -> list[dict[str, Any]]:
    """Return the corners of the soles in the frames of their joints."""
    robot, soles = run.robot, []
    for foot in robot.feet.values():
        frame = robot.frame(foot.frame)
        corners = np.column_stack((foot.polygon, np.zeros(len(foot.polygon))))
        placed = corners @ np.array(frame.placement.rotation).T + frame.placement.translation
        soles.append({"joint": int(frame.parentJoint), "corners": placed.tolist()})
    return soles


def _obstacle(run: DrawableRun, name: str) -> Triangles:
    track = run.obstacles[name]
    there = np.flatnonzero(np.isfinite(track.place).all(axis=(1, 2)))
    place = track.place[there[0]] if len(there) else np.eye(3, 4)
    base = run.q[0, :3]
    centre = (base - place[:, 3]) @ place[:, :3]
    return solid_surface(track.shape, centre, WALL, -float(place[2, 3]))


def _surface(surface: Triangles | Mesh) -> dict[str, Any]:
    """Return triangles with corners rounded to 1/65535 of the mesh's extent."""
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    step = np.maximum(high - low, 1e-9) / STEPS
    corners = np.round((surface.vertices - low) / step).astype("<u2")
    wide = len(surface.vertices) > STEPS
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "corners": _text(corners),
        "faces": _text(surface.faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
    }


def _numbers(values: ArrayLike) -> str:
    return _text(np.asarray(values, dtype="<f4"))


def _text(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
