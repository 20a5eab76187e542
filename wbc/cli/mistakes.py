"""What typer refuses of a command line, with what to write in its place."""

from __future__ import annotations

import re
from typing import Any

import typer
from typer.core import TyperGroup

from wbc.cli.errors import errors_in_one_line

UsageError: Any = typer.BadParameter.__base__  # typer does not show it
OF_THE_FILE = "values of the file are replaced by --set"


class Commands(TyperGroup):
    """Commands whose refusals say what to write where that can be known."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command of the line; the package's own errors become a message each.

        Raises
        ------
        UsageError
            Typer's own, which typer tells; what to write is in its message.
        """
        with errors_in_one_line():
            try:
                return super().invoke(ctx)
            except UsageError as error:
                if hint := self._hint(error):
                    error.message = f"{error.message.rstrip('.')}; {hint}"
                raise

    def _hint(self, error: Any) -> str:
        """Return what to write in place of what is refused; empty where nobody knows."""
        command, said, group = error.ctx.command, error.message, error.ctx.parent
        if command is self and (found := re.fullmatch(r"No such command '(.*)'\.", said)):
            word = found[1]
            if word.endswith((".yaml", ".yml")):
                return f"a problem is run by: wbc run {word}, and in physics by: wbc sim {word}"
            nearest = next((name for name in self.commands if word.startswith(name)), None)
            return f"did you mean {nearest!r}?" if nearest else ""
        of_this = group is not None and group.command is self  # not of a group within this one
        if not of_this or not any("--set" in one.opts for one in command.params):
            return ""
        if found := re.match(r"Got unexpected extra argument.*\(([^\s=]+=[^\s)]+)", said):
            return f"{OF_THE_FILE}: --set {found[1]}"
        cut = any("=" not in one for one in error.ctx.params.get("assign") or ())
        if said.startswith("Got unexpected extra") and cut:
            return "--set takes a path and its value as one word, as in --set tasks.com.gain=0.3"
        if said.startswith("No such option") and not getattr(error, "possibilities", None):
            return f"{OF_THE_FILE}, as in --set tasks.com.gain=0.3"
        return ""
