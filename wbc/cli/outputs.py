"""What ``wbc run`` writes: checked before the run, so that no finished run is lost."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from wbc.errors import InvalidInputError, WbcError
from wbc.problem import Result
from wbc.problem.pendulum.result import PendulumResult
from wbc.run.saving import result_format


@dataclass
class Outputs:
    """The files that are wanted of a run.

    Attributes
    ----------
    result, picture:
        Where to write them, or None.
    written:
        What has been written.
    failures:
        What could not be, in words.
    """

    result: Path | None
    picture: Path | None
    written: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raise InvalidInputError for what could never be written."""
        if self.result is not None:
            result_format(self.result)
            check_place("--output", self.result)
        if self.picture is not None:
            check_picture("--plot", self.picture)

    def write(self, result: Result | PendulumResult, name: str) -> None:
        """Write what is wanted of ``result``; a failure is noted, and does not lose the rest."""
        if self.result is not None:
            self._save(result, self.result)
        if self.picture is not None:
            title = f"{name}: {result.status.value.replace('_', ' ')}"
            self._draw(result, self.picture, title)

    def _save(self, result: Result | PendulumResult, path: Path) -> None:
        try:
            result.save(path)
            self.written.append(path)
        except OSError as error:
            elsewhere = Path(tempfile.mkdtemp(prefix="wbc-")) / path.name
            result.save(elsewhere)
            self.failures.append(
                f"--output {path}: cannot be written: {error.strerror}; the result is in "
                f"{elsewhere} instead"
            )

    def _draw(self, result: Result | PendulumResult, path: Path, title: str) -> None:
        from wbc.view import plot_pendulum, plot_run

        try:
            if isinstance(result, Result):
                draw: Callable[..., Any] = plot_run  # a History has every array that it reads
                draw(result.robot, result.history, path, title=title)
            else:
                plot_pendulum(result.history, path, title=title)
            self.written.append(path)
        except WbcError as error:
            self.failures.append(f"--plot {path}: {error}")
        except OSError as error:
            self.failures.append(f"--plot {path}: cannot be written: {error.strerror}")


def check_picture(option: str, path: Path) -> None:
    """Raise InvalidInputError if no picture can be drawn into ``path``."""
    if find_spec("matplotlib") is None:
        raise InvalidInputError(f"{option} needs matplotlib: pip install 'wbc[plot]'")
    from wbc.view.style import picture_file

    check_place(option, path)
    picture_file(path)


def check_place(option: str, path: Path) -> None:
    """Raise InvalidInputError if ``path`` cannot be written; tried by writing next to it."""
    if path.is_dir():
        raise InvalidInputError(f"{option} {path}: is a folder; name a file in it")
    if not path.parent.is_dir():
        raise InvalidInputError(f"{option} {path}: there is no folder {path.parent}")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InvalidInputError(f"{option} {path}: cannot be written: {error.strerror}") from error
