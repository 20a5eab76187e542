"""The output files of a command, checked before the work so that no results are lost."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import typer

from wbc.cli.errors import BAD_INPUT, complain
from wbc.errors import InvalidInputError, WbcError
from wbc.extras import require
from wbc.files import system_message
from wbc.run.saving import result_format


@dataclass
class Outputs:
    """The files written and, in words, the failures."""

    written: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def save(self, path: Path, save: Callable[[Path], object]) -> None:
        """Write a result by ``save(path)``; if that fails, into a temporary folder."""
        try:
            save(path)
            self.written.append(path)
        except OSError as error:
            where = _saved_elsewhere(path, save)
            self.failures.append(
                f"--output {path}: cannot be written: {system_message(error)}; {where}"
            )

    def draw(self, path: Path, draw: Callable[[Path], object], option: str = "--plot") -> None:
        """Write a picture by ``draw(path)``; a failure is noted."""
        if self.try_to(f"{option} {path}", lambda: draw(path)):
            self.written.append(path)

    def try_to(self, what: str, act: Callable[[], object]) -> bool:
        """Call ``act`` and return True, or record a failure of ``what``."""
        try:
            act()
        except WbcError as error:
            self.failures.append(f"{what}: {error}")
        except OSError as error:
            self.failures.append(f"{what}: cannot be written: {system_message(error)}")
        else:
            return True
        return False

    def exit_code(self, code: int = 0) -> int:
        """Print the failures, and return the exit code: ``code`` if there are none."""
        for failure in self.failures:
            complain(failure)
        return BAD_INPUT if self.failures else code


def _saved_elsewhere(path: Path, save: Callable[[Path], object]) -> str:
    """Write a result into a temporary folder, and return its place, in words."""
    folder = None
    try:
        folder = Path(tempfile.mkdtemp(prefix="wbc-"))
        save(folder / path.name)
    except OSError as error:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        return f"nor into a temporary folder: {system_message(error)}; the result is lost"
    return f"the result is in {folder / path.name} instead"


def write_one(path: Path, save: Callable[[Path], object], quiet: bool) -> int:
    """Write the one file of a command, print how large it is, and return the exit code."""
    outputs = Outputs()
    outputs.save(path, save)
    if not quiet:
        for each in outputs.written:
            typer.echo(f"written  {each} ({each.stat().st_size / 1e6:.1f} MB)")
    return outputs.exit_code()


def check_outputs(output: list[Path], plot: Path | None) -> None:
    """Raise if outputs cannot be written or drawn, before any work is done."""
    for each in output:
        result_format(each)
        check_place("--output", each)
    if plot is not None:
        check_picture("--plot", plot)


def check_picture(option: str, path: Path) -> None:
    """Raise InvalidInputError or MissingPackageError if no picture can be drawn into ``path``."""
    require("matplotlib", option)
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
        raise InvalidInputError(
            f"{option} {path}: cannot be written: {system_message(error)}"
        ) from error
