"""The command line of this process, as a user calls it."""

from typer.testing import CliRunner, Result

from wbc.cli import app


def wbc_command(*arguments: object, stdin: str | None = None) -> Result:
    """Return what ``wbc`` with these arguments answers."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=stdin)
