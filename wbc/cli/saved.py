"""A run to draw: read from a result's file, or made by running a problem now."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from wbc.cli.errors import complain

if TYPE_CHECKING:
    from wbc.problem.saved import SavedRun


def saved_or_run(path: Path, robot: str | None, quiet: bool) -> SavedRun:
    """Return the run of an ``.npz``, or that of a problem file, which is run first.

    Raises
    ------
    InvalidInputError
        A pendulum's problem, or another file than a result.
    """
    from wbc.cli.progress import shown_progress
    from wbc.errors import InvalidInputError
    from wbc.problem import Problem, load_problem
    from wbc.problem.saved import SavedRun, load_result
    from wbc.robot import Robot

    if path.suffix.lower() == ".npz":
        return load_result(path, None if robot is None else Robot.load(robot))
    if robot is not None:
        raise InvalidInputError("--robot: only for a result's .npz; a problem names its robot")
    problem = load_problem(path)
    if not isinstance(problem, Problem):
        raise InvalidInputError(
            f"{path}: a pendulum's problem; draw it by: wbc run {path} --plot picture.png"
        )
    with nullcontext() if quiet else shown_progress() as progress:
        result = problem.run(progress)
    if not result.status.good:
        complain(f"{result.status.value.replace('_', ' ')}: {result.reason}")
    return SavedRun.of(result, "stdin" if str(path) == "-" else path.stem)


def title_of(saved: SavedRun) -> str:
    """Return the name of a run and how it ended."""
    return f"{saved.name}: {str(saved.summary['status']).replace('_', ' ')}"
