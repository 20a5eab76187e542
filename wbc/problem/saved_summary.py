"""The summary in a result's file: what reports and recordings read of it, checked when it is read.

A file may be damaged, or written by another program; what nobody reads may be anything.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wbc.errors import InvalidInputError, listed

Number = Annotated[float, Field(strict=True)] | None  # what is not finite is written as null
Text = Annotated[str, Field(strict=True)]
REMEDY = "make it by: wbc run PROBLEM.yaml -o result.npz"


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Problem(_Part):
    text: Text
    file: Text | None = None
    overrides: dict[str, Any] | None = None


class _Task(_Part):
    norm: Number
    units: list[Text]
    tolerance: Number
    rows: list[Text] = []


class _Constraint(_Part):
    least_clearance: Number
    time: Number
    at: Any


class _HeldBack(_Part):
    seconds: Number
    first: Number
    last: Number


class _Times(_Part):
    median: Number
    p99: Number
    max: Number


class _Push(_Part):
    impulse: list[Annotated[float, Field(strict=True)]]
    body: Text
    at: Annotated[float, Field(strict=True)]


class _Simulation(_Part):
    pushes: list[_Push] = []
    relaxed: Number = None
    least_cop_margin: Number = None
    peak_tilt: Number = None
    lost_frames: Number = None
    saturated: dict[str, Annotated[float, Field(strict=True)]] = {}
    notes: list[Text] = []
    terrain: dict[str, Any] | None = None


class _Summary(_Part):
    format: Text
    status: Text
    problem: _Problem | None = None
    measures: dict[str, Number] = {}
    simulation: _Simulation = _Simulation()
    tasks: dict[str, _Task] = {}
    constraints: dict[str, _Constraint] = {}
    held_back: dict[str, _HeldBack] = {}
    tick_time: dict[str, _Times] = {}
    versions: dict[str, Text] = {}


def read_summary(path: Path, text: str, formats: Collection[str]) -> dict[str, Any]:
    """Return the summary in a result's file, which says that it is in one of some formats.

    Raises
    ------
    InvalidInputError
        No JSON, or something in it that is read is not of its kind: all of it is named.
    """
    try:
        summary = json.loads(text)
        json.dumps(summary, ensure_ascii=False).encode()  # JSON has strings that are no text
        found = summary["format"]
        if found not in formats:
            known = " or ".join(map(repr, formats))
            raise InvalidInputError(f"{path}: is a {found!r:.40}, not a {known}; {REMEDY}")
        _Summary.model_validate(summary)
    except ValidationError as error:
        wrong = [
            f"{'.'.join(map(str, one['loc'])) or 'all of it'}: {one['msg'].lower()}"
            for one in error.errors(include_url=False, include_input=False)
        ]
        what = f"{path}: its summary is damaged ({listed(wrong, 3):.300}); {REMEDY}"
        raise InvalidInputError(what) from error
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InvalidInputError(f"{path}: not the result of a run; {REMEDY}") from error
    return dict(summary)
