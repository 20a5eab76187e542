"""A run as a film, drawn without a screen; the same run gives the same file."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from wbc.errors import InvalidInputError
from wbc.files import ending_of, system_message
from wbc.kinds import whole_number
from wbc.robot import Robot
from wbc.robot.geometry import Mesh, RobotMeshes
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array, finite_number, finite_vector
from wbc.view import style
from wbc.view.camera import Camera
from wbc.view.history import DrawableRun, HistoryLike, read_history
from wbc.view.options import View
from wbc.view.panel import Panel
from wbc.view.portrait import (
    DEFAULT,
    INCH,
    LINE,
    Portrait,
    captions,
    draw_pendulum,
    extent_of,
    portrait_of,
    write_caption,
)
from wbc.view.render import render
from wbc.view.solids import limit_triangles

FORMATS = (".gif", ".mp4")
DOTS, LEAST, LARGEST = 100, 150, 65_535  # pixels per inch, and along each side
TRIANGLES = 40_000  # of the robot: finer ones are not visible
POSES = 24  # spread over the run, that the camera must contain
MOST_FPS = 50  # pictures per second: a GIF has no more
MOST_PICTURES = 1_000_000  # pictures: half a day of film
END_TIME = 0.7  # s for which the end is shown
MARKS, LINES = 0.8, (1.2, 1.2)  # size of the pendulum; widths of outlines [points]
ABOVE, EDGE = 0.25, 0.06  # inches, of the title and below the caption
BITEXACT = ["-pix_fmt", "yuv420p", "-fflags", "+bitexact", "-flags:v", "+bitexact"]

Progress = Callable[[int, int], None]


class RowDrawer(Protocol):
    """Draws one row after the other into one figure."""

    figure: Figure

    def draw(self, row: int) -> None:
        """Draw a row."""


def film_format(path: str | Path) -> str:
    """Return the ending of a film's file."""
    wanted = "a film is written as .gif or .mp4; a picture by wbc run PROBLEM.yaml --plot run.png"
    ending = ending_of(path, FORMATS, wanted)
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise InvalidInputError(f"{path}: needs the program ffmpeg; install it, or write a .gif")
    return ending


def film_rows(time: Array, fps: float, speed: float) -> list[int]:
    """Return the row of each picture, with the end held for a moment."""
    pictures = float(time[-1] - time[0]) * fps / speed
    if pictures > MOST_PICTURES:
        raise InvalidInputError(
            f"film, speed {speed:g}: {pictures:.1g} pictures, at most {MOST_PICTURES}; let it be"
            " faster"
        )
    count = round(pictures) + 1
    wanted = time[0] + np.arange(count) * speed / fps
    rows = np.searchsorted(time, wanted - 1e-9).clip(0, len(time) - 1).tolist()
    return [*rows, *[len(time) - 1] * round(END_TIME * fps)]


def film_run(
    robot: Robot,
    history: HistoryLike,
    path: str | Path,
    *,
    title: str,
    fps: int = 20,
    speed: float = 1.0,
    size: tuple[int, int] = (480, 560),
    view: View = DEFAULT,
    terrain: Terrain = LEVEL,
    progress: Progress | None = None,
) -> Path:
    """Write a film of a run, and return its path; the file appears whole or not at all.

    ``history``: as for :func:`wbc.view.plot_run`.
    ``path``: a ``.gif``, or an ``.mp4`` where ffmpeg is installed.
    ``fps``: pictures per second, at most 50; a GIF, which counts in 0.01 s, has the nearest it can.
    ``speed``: how much faster than the run the film is.
    ``size``: width and height [pixels]; made even.
    ``terrain``: of a simulation, what the robot stood on.
    ``progress``: called with pictures done and pictures in all.

    Raises InvalidInputError: another ending, no such folder, numbers out of range, or what
    :func:`wbc.view.plot_run` refuses.
    """
    run = read_history(robot, history, terrain)
    return write_film(
        lambda: Film(run, title, even_size(size), view), run.time, path, fps, speed, progress
    )


def even_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return a size in pixels made even, as films need it."""
    width, height = finite_vector("film, size", size, 2).tolist()
    if not LEAST <= min(width, height) <= max(width, height) <= LARGEST:
        raise InvalidInputError(
            f"film, size: at least {LEAST} x {LEAST} pixels, at most {LARGEST} each, got {size}"
        )
    return int(width) // 2 * 2, int(height) // 2 * 2


def write_film(
    make: Callable[[], RowDrawer],
    time: Array,
    path: str | Path,
    fps: int,
    speed: float,
    progress: Progress | None,
) -> Path:
    """Write one picture per row, of times (n,) [s]; see :func:`film_run`."""
    path = Path(path)
    ending = film_format(path)
    fps = whole_number("film, fps", fps, least=1, most=MOST_FPS)
    speed = finite_number("film, speed", speed, above=0.0)
    if not path.parent.is_dir():
        raise InvalidInputError(f"{path}: there is no folder {path.parent}; make it first")
    # As many as are shown: with 40 in a second of the run, of which a GIF shows 50, it would hurry.
    shown = fps if ending == ".mp4" else 100 / round(100 / fps)
    rows = film_rows(time, shown, speed)
    drawn = make()
    drawn.draw(rows[0])
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".film-") as folder:
            part = Path(folder) / f"film{ending}"
            with _writer(ending, shown).saving(drawn.figure, str(part), DOTS) as writer:
                for done, row in enumerate(rows, 1):
                    if row != rows[max(done - 2, 0)]:
                        drawn.draw(row)
                    writer.grab_frame()
                    if progress is not None:
                        progress(done, len(rows))
            part.replace(path)
    except (OSError, subprocess.CalledProcessError) as error:  # that of ffmpeg on a full disk too
        raise InvalidInputError(f"{path}: cannot be written: {system_message(error)}") from error
    return path


def _writer(ending: str, fps: float) -> AbstractMovieWriter:
    if ending == ".mp4":
        return FFMpegWriter(fps=int(fps), codec="libx264", extra_args=BITEXACT)
    return PillowWriter(fps=fps * (1.0 - 1e-9))  # type: ignore[arg-type]  # it cuts off parts of a ms


def sheet(size: tuple[int, int]) -> Figure:
    """Return an empty figure of a size in pixels."""
    return Figure(figsize=(size[0] / DOTS, size[1] / DOTS), dpi=DOTS, facecolor="white")


class Film:
    """Draws a run's rows one after the other, from where all of them are seen."""

    def __init__(self, run: DrawableRun, title: str, size: tuple[int, int], view: View) -> None:
        width, height = (pixels / DOTS for pixels in size)
        self._run, self._view, self._title = run, view, title
        shapes = RobotMeshes(run.robot).in_joint_frames
        self._joints = [joint for joint, _ in shapes]
        self._meshes = limit_triangles([mesh for _, mesh in shapes], TRIANGLES)
        self.figure = sheet(size)
        few = np.unique(np.linspace(0, len(run.time) - 1, POSES).astype(int)).tolist()
        seen = [self._portrait(row) for row in few]
        told = captions(seen, width)
        below = EDGE + LINE * len(told)
        write_caption(self.figure, told, below)
        self._head = self.figure.text(
            0.5, 1.0 - 0.04 / height, "", ha="center", va="top", fontsize=8.0, color=style.BLACK
        )
        place = (0.0, below, width, height - ABOVE - below)
        self._axes = style.place(self.figure, *place)
        pixels = (round(place[2] * DOTS), round(place[3] * DOTS))
        points = np.concatenate([extent_of(one) + one.scene.below_centre for one in seen])
        self._camera = Camera.framing(points, view.azimuth, view.elevation, *pixels)

    def draw(self, row: int) -> None:
        """Draw a row of the run."""
        portrait = self._portrait(row)
        self._axes.clear()
        panel = Panel(self._axes, self._camera, render(portrait.scene, self._camera), DOTS / INCH)
        panel.show()
        draw_pendulum(panel, portrait, MARKS, LINES)
        phase = f", {self._run.phase_at(row)}" if self._run.phase_at(row) else ""
        self._head.set_text(f"{self._title}, t = {self._run.time[row]:.2f} s{phase}")

    def _portrait(self, row: int) -> Portrait:
        run = self._run
        pose, snapshot = run.pose(row, now=True), run.robot.snapshot(run.q[row])
        rotations, origins = snapshot.joint_placements
        placed: Sequence[Mesh] = [
            Mesh(mesh.name, mesh.vertices @ rotations[j].T + origins[j], mesh.faces, mesh.colour)
            for j, mesh in zip(self._joints, self._meshes, strict=True)
        ]
        return portrait_of(snapshot, placed, pose, "", self._view)
