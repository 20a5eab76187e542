"""Outcomes of a campaign of pushes in a file, one line as each comes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wbc.journal import Journal, not_ours
from wbc.simulation.campaign import PushOutcome


class CampaignLog(Journal):
    """What was pushed and how, then one outcome in each line; a context.

    Attributes
    ----------
    known:
        Outcomes that were there, by the name of the problem.

    Raises
    ------
    InvalidInputError, JournalError
        As :class:`~wbc.journal.Journal` does.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        super().__init__(path, made_of)
        self.known: dict[str, list[PushOutcome]] = {}
        try:
            for entry in self.entries:
                outcome = {name: value for name, value in entry.items() if name != "problem"}
                self.known.setdefault(entry["problem"], []).append(PushOutcome(**outcome))
        except (TypeError, KeyError) as error:
            self._file.close()
            raise not_ours(path, error) from error

    def record(self, problem: str, outcome: PushOutcome) -> None:
        """Keep an outcome."""
        self.add({"problem": problem, **outcome._asdict()})
