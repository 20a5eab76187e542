"""``wbc init``, ``wbc check`` and ``wbc schema``: problem files before they are run."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import BAD_INPUT, complain, print_notes, warn_unless_quiet
from wbc.cli.options import Assign, overrides_of, robots_beginning

if TYPE_CHECKING:
    from wbc.problem import Problem
    from wbc.problem.pendulum.problem import PendulumProblem

SCHEMA_FILE = "wbc.schema.json"


def init(
    path: Annotated[
        Path, typer.Argument(help="The file to write; - prints it.", metavar="PROBLEM.yaml")
    ] = Path("problem.yaml"),
    robot: Annotated[
        str,
        typer.Option(
            help="The robot: a name, or a URDF or MJCF file.", autocompletion=robots_beginning
        ),
    ] = "hoap2_like",
) -> None:
    """Write a commented problem file that runs, and the schema with which an editor completes it.

    Neither replaces a file that is there.
    """
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError
    from wbc.files import write_text
    from wbc.problem.template import problem_template
    from wbc.robot import Robot

    shown = str(path) == "-"
    if not shown:
        check_place("wbc init", path)
        if path.exists():
            raise InvalidInputError(f"wbc init {path}: is there already; name another file")
    loaded = Robot.load(robot)
    is_file = loaded.path.resolve() == Path(robot).resolve()
    name = str(loaded.path.resolve()) if is_file else robot
    if shown:
        typer.echo(problem_template(loaded, name, "problem.yaml"), nl=False)
        return
    schema = path.parent / SCHEMA_FILE
    if not schema.exists():
        write_text(schema, _schema_text())
    text = problem_template(loaded, name, str(path), SCHEMA_FILE)
    write_text(path, text)
    typer.echo(f"written  {path}\nschema   {schema}\nnow try  wbc run {quote(str(path))}")


def check(
    problems: Annotated[
        list[Path],
        typer.Argument(help="Problem files; - reads one from stdin.", metavar="PROBLEM.yaml..."),
    ],
    assign: Assign = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print mistakes only.", callback=warn_unless_quiet)
    ] = False,
) -> None:
    """Check problem files without running them: every mistake with its line."""
    from wbc.errors import WbcError
    from wbc.problem import Problem, load_problem

    wrong, overrides = 0, overrides_of(assign)
    for path in problems:
        try:
            problem = load_problem(path, overrides)
        except WbcError as error:
            complain(str(error))
            wrong += 1
            continue
        if not quiet:
            typer.echo(f"{problem.source.name}: {_summary_line(problem)}")
            if isinstance(problem, Problem):
                print_notes(problem.parts.robot)
    raise typer.Exit(BAD_INPUT if wrong else 0)


def _summary_line(problem: Problem | PendulumProblem) -> str:
    from wbc.problem import Problem

    if not isinstance(problem, Problem):
        law = problem.spec.law
        what = f"law {law.type}" if law is not None else "a plan"
        return f"valid: {problem.spec.model}, {problem.mass:g} kg, {what}"
    spec, parts = problem.spec, problem.parts
    counts = {
        "task": len(spec.tasks),
        "contact": len(parts.contacts),
        "constraint": len(spec.constraints),
        "phase": len(spec.phases or ()),
    }
    told = [f"{count} {what}{'s' if count > 1 else ''}" for what, count in counts.items() if count]
    return f"valid: {parts.robot.name}, {', '.join(told)}"


def schema(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write to a file instead.")
    ] = None,
) -> None:
    """Print the JSON Schema of problem files, for completion and checks in an editor.

    A problem file names it in its first line: # yaml-language-server: $schema=wbc.schema.json
    """
    from wbc.cli.outputs import check_place
    from wbc.files import write_text

    text = _schema_text()
    if output is None:
        typer.echo(text, nl=False)
        return
    check_place("--output", output)
    write_text(output, text)


def _schema_text() -> str:
    import json

    from wbc.problem.json_schema import json_schema

    return json.dumps(json_schema(), indent=2) + "\n"
