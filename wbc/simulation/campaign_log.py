"""Outcomes of a campaign in a file, one line as each comes, so that a kill costs only the last."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from wbc.errors import InvalidInputError
from wbc.simulation.campaign import PushOutcome


class CampaignLog:
    """A file of JSON lines: what was pushed and how, then one outcome in each; a context.

    Parameters
    ----------
    path:
        If it is there, it is gone on with.
    made_of:
        What the outcomes depend on, as plain data; a file of anything else is refused.

    Attributes
    ----------
    known:
        Outcomes that were there, by the name of the problem.

    Raises
    ------
    InvalidInputError
        Not such a file, or one of another campaign.
    OSError
        It cannot be read or written.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        self.path = path
        self.known: dict[str, list[PushOutcome]] = {}
        head = json.loads(json.dumps(made_of))  # as it will be read back
        whole = self._read(head) if path.exists() else 0
        self._file = path.open("a", encoding="utf-8")
        self._file.truncate(whole)  # what a kill left of a line
        if whole == 0:
            self._write(head)

    def add(self, problem: str, outcome: PushOutcome) -> None:
        """Keep an outcome."""
        self._write({"problem": problem, **outcome._asdict()})

    def remove(self) -> None:
        """Delete the file: the campaign is done, and its result written."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> CampaignLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _write(self, entry: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(entry, allow_nan=False) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, head: Mapping[str, Any]) -> int:
        """Read what is there, and return how many bytes of it are whole lines."""
        try:
            data = self.path.read_bytes()
            whole = data.rfind(b"\n") + 1
            lines = [json.loads(line) for line in data[:whole].splitlines()]
            outcomes = [(one.pop("problem"), PushOutcome(**one)) for one in lines[1:]]
        except (ValueError, TypeError, AttributeError, KeyError) as error:
            raise InvalidInputError(
                f"{self.path}: is not what a campaign left; delete it to begin anew ({error})"
            ) from error
        if not lines:
            return 0
        if lines[0] != head:
            first = lines[0] if isinstance(lines[0], dict) else {}
            differs = sorted(name for name in {*first, *head} if first.get(name) != head.get(name))
            raise InvalidInputError(
                f"{self.path}: was left by another campaign ({', '.join(differs) or 'its head'}"
                " differs); delete it to begin anew, or write to another file"
            )
        for problem, outcome in outcomes:
            self.known.setdefault(problem, []).append(outcome)
        return whole
