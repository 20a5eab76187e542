"""``wbc render``: a film of a run."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import errors_in_one_line
from wbc.cli.options import Quiet, RobotOfResult, SavedOrProblem, Show, ViewFrom, check_view

if TYPE_CHECKING:
    from wbc.cli.progress import ProgressCall

FPS, SIZE = 20, "480x560"


def render(
    run: SavedOrProblem,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The film: .gif, or .mp4 if there is ffmpeg.")
    ],
    fps: Annotated[int, typer.Option(help="Pictures per second, at most 50.")] = FPS,
    speed: Annotated[
        float, typer.Option(help="How much faster than the run; 0.25 is slow motion.")
    ] = 1.0,
    size: Annotated[str, typer.Option(help="Width x height in pixels.")] = SIZE,
    view_from: ViewFrom = "front-left",
    show: Show = "all",
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Draw a run as a film, without a screen; the same run gives the same file."""
    with errors_in_one_line():
        from wbc.cli.outputs import check_place, require_matplotlib
        from wbc.cli.progress import shown_progress
        from wbc.cli.saved import saved_or_run, title_of
        from wbc.problem.pendulum.saved import SavedPendulum

        require_matplotlib("wbc render")
        from wbc.view.film import film_format, film_run
        from wbc.view.options import View
        from wbc.view.pendulum_film import film_pendulum

        check_view(view_from, show)
        film_format(output)
        check_place("--output", output)
        pixels = _size(size)
        saved = saved_or_run(run, robot, quiet)
        with nullcontext() if quiet else shown_progress() as progress:
            told = None if progress is None else _told(progress)
            title = title_of(saved)
            if isinstance(saved, SavedPendulum):
                film_pendulum(saved.history, output, title=title, fps=fps, speed=speed,
                              size=pixels, progress=told)  # fmt: skip
            else:
                film_run(saved.robot, saved.history, output, title=title, fps=fps, speed=speed,
                         size=pixels, view=View.of(view_from, show), progress=told)  # fmt: skip
        if not quiet:
            typer.echo(f"written  {output}")


def _told(progress: ProgressCall) -> Callable[[int, int], None]:
    return lambda done, total: progress(done, total, {"drawing": True})


def _size(text: str) -> tuple[int, int]:
    from wbc.errors import InvalidInputError

    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and max(int(width), int(height)) <= 4096):
        raise InvalidInputError(f"--size {text}: expected width x height in pixels, as in {SIZE}")
    return int(width), int(height)
