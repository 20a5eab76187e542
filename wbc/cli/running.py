"""What commands that run a problem share: checks before it, and what is done when it has ended."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from wbc.cli.errors import NOT_REACHED, QP_FAILED, complain

if TYPE_CHECKING:
    from wbc.problem import Problem
    from wbc.problem.pendulum.problem import PendulumProblem
    from wbc.problem.pendulum.result import PendulumStatus
    from wbc.run import History
    from wbc.run.stopping import RunStatus
    from wbc.simulation import SimulationStatus
    from wbc.view.live.watching import Watching


@dataclass(frozen=True)
class Wanted:
    """What a user wants of a run besides the run itself."""

    path: Path
    output: list[Path]
    plot: Path | None
    quiet: bool
    view: bool

    @property
    def name(self) -> str:
        """Of the problem, as titles and files have it."""
        return "stdin" if str(self.path) == "-" else self.path.stem

    def check(self) -> None:
        """Raise for what could not be written, drawn or shown, before any work is done."""
        from wbc.view.live.process import require_viser

        check_outputs(self.output, self.plot)
        if self.view:
            require_viser()

    def watching(self, problem: Problem | PendulumProblem) -> Watching | None:
        """Return what shows the run, if that is wanted.

        Raises
        ------
        InvalidInputError
            A pendulum's problem: the viewer shows robots.
        """
        from wbc.errors import InvalidInputError
        from wbc.problem import Problem
        from wbc.view.live.watching import Watching

        if not self.view:
            return None
        if not isinstance(problem, Problem):
            raise InvalidInputError(
                "--view shows robots, and this is a pendulum's problem; use --plot"
            )
        return Watching(problem.parts.robot, title=self.name)


@dataclass(frozen=True)
class Ended:
    """A run that has ended."""

    # save and draw: write the result, and a picture of it, into a file.
    save: Callable[[Path], object]
    draw: Callable[[Path], object]
    tell: Callable[[Iterable[Path]], object]  # print what came of it, and which files were written
    code: int  # the exit code
    interrupted: int | None  # the exit code if the user ended it
    history: History | None  # to be played again, if it was watched


def check_outputs(output: list[Path], plot: Path | None) -> None:
    """Raise for files that could not be written or drawn, before any work is done."""
    from wbc.cli.outputs import check_picture, check_place
    from wbc.run.saving import result_format

    for each in output:
        result_format(each)
        check_place("--output", each)
    if plot is not None:
        check_picture("--plot", plot)


def exit_code(status: RunStatus | SimulationStatus | PendulumStatus) -> int:
    """Return the exit code of a run that ended so."""
    if status.good:
        return 0
    return QP_FAILED if status.value == "qp_failed" else NOT_REACHED


def finish(wanted: Wanted, ended: Ended, watching: Watching | None) -> int:
    """Write, draw, print and show what came of a run; return the exit code."""
    from wbc.cli.outputs import Outputs

    interrupted, output, outputs = ended.interrupted is not None, wanted.output, Outputs()
    if interrupted and not output:
        output = [Path(tempfile.mkdtemp(prefix="wbc-")) / f"{wanted.name}.npz"]
    for each in output:
        outputs.save(each, ended.save)
    if wanted.plot is not None:
        outputs.draw(wanted.plot, ended.draw)
    if not wanted.quiet:
        ended.tell(outputs.written)
    code = outputs.exit_code(ended.code)
    if ended.interrupted is not None:
        where = ", ".join(str(one) for one in outputs.written) or "nowhere"
        complain(f"interrupted; what was computed until then is in {where}")
        return ended.interrupted
    if watching is not None and ended.history is not None:
        watching.replay(ended.history)
        typer.echo(f"it can be played again at {watching.viewer.url}; Ctrl-C ends", err=True)
        watching.viewer.wait()
    return code
