"""A history of tick benchmarks, a line of JSON for each run, and changes since the last like it.

Every run has rounds, each its own process, with a median tick of each kind in units of a fixed
computation just before and after: see :mod:`qpbench.compare`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from qpbench.compare import PASSES, TimeRatio, time_ratio

from wbc.errors import InvalidInputError

FORMAT = "wbc ticks 1"
ALIKE = ("robot", "machine")


class NothingToCompareError(InvalidInputError):
    """A history has no run like this one; the message says what is missing."""


def last_like(path: Path, figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the last run of a history with the same robot and machine.

    Raises
    ------
    NothingToCompareError
        There is none.
    InvalidInputError
        The file is no history.
    OSError
        It cannot be read.
    """
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    for number, line in reversed(list(enumerate(text.splitlines(), 1))):
        try:
            found = json.loads(line)
            of_ours = found["format"] == FORMAT
            alike = of_ours and all(found[name] == figures[name] for name in ALIKE)
        except (ValueError, TypeError, KeyError):
            of_ours = False
        if not of_ours:
            raise InvalidInputError(f"{path}:{number}: is no line of a history of ticks ({FORMAT})")
        if alike:
            return dict(found)
    wanted = ", ".join(f"{name} {figures[name]}" for name in ALIKE)
    raise NothingToCompareError(f"{path} has no earlier run with {wanted}")


def changes_since(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, TimeRatio]:
    """Return the change of each kind of tick that both runs have.

    Raises
    ------
    NothingToCompareError
        Too few rounds to know how much they scatter, or no kind of tick in common.
    """
    least = min(one["rounds"] for one in (old, new))
    if least < PASSES:
        raise NothingToCompareError(f"needs {PASSES} rounds each, has {least}")
    common = [label for label in new["ticks"] if label in old["ticks"]]
    if not common:
        raise NothingToCompareError(f"the last run had other ticks: {', '.join(old['ticks'])}")
    passes = {
        label: [np.log(one["ticks"][label]["passes"]) for one in (old, new)] for label in common
    }
    return {label: time_ratio(before, after) for label, (before, after) in passes.items()}
