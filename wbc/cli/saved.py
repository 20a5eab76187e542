"""A run to draw: read from a result's file, or made by running a problem now."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from wbc.cli.errors import complain

if TYPE_CHECKING:
    from wbc.problem import Result
    from wbc.problem.pendulum.result import PendulumResult
    from wbc.problem.pendulum.saved import SavedPendulum
    from wbc.problem.saved import SavedRun
    from wbc.simulation import SimulationResult


def saved_or_run(path: Path, robot: str | None, quiet: bool) -> SavedRun | SavedPendulum:
    """Return the run of an ``.npz``, or that of a problem file, which is run or simulated first.

    Raises
    ------
    InvalidInputError
        Another file than a result.
    """
    from wbc.cli.progress import shown_progress
    from wbc.errors import InvalidInputError
    from wbc.problem import Problem, load_problem
    from wbc.problem.pendulum.saved import SavedPendulum
    from wbc.problem.saved import SavedRun, load_result
    from wbc.robot import Robot

    if path.suffix.lower() == ".npz":
        return load_result(path, None if robot is None else Robot.load(robot))
    if robot is not None:
        raise InvalidInputError("--robot: only for a result's .npz; a problem names its robot")
    problem, name = load_problem(path), "stdin" if str(path) == "-" else path.stem
    with nullcontext() if quiet else shown_progress() as progress:
        if not isinstance(problem, Problem):
            moved = problem.run(progress)
            _warn(moved)
            return SavedPendulum.of(moved, name)
        simulated = problem.spec.controller.level == "torque"
        result = problem.simulate(progress) if simulated else problem.run(progress)
    _warn(result)
    return SavedRun.of(result, name)


def _warn(result: Result | SimulationResult | PendulumResult) -> None:
    if not result.status.good:
        complain(f"{result.status.value.replace('_', ' ')}: {result.reason}")


def title_of(saved: SavedRun | SavedPendulum) -> str:
    """Return the name of a run and how it ended."""
    return f"{saved.name}: {str(saved.summary['status']).replace('_', ' ')}"
