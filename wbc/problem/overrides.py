"""Values that replace those of a problem file: ``--set tasks.com.gain=0.3``."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from wbc.errors import ProblemFileError, suggest
from wbc.problem.source import KeyPath, Source, parse_path, written
from wbc.problem.yaml_reader import parse
from wbc.run.saving import plain

_ASSIGNMENT = re.compile(r"""((?:"[^"]*"|'[^']*'|[^="'])+)=(.*)""", re.DOTALL)


# Names in key paths: their section, what they name, and their step in the path. A misspelt one must
# not create a new entry.
_NAMED = (("tasks", "task", 1), ("phases", "phase", 1), ("tasks", "task", 3))


def parse_override(text: str) -> tuple[str, Any]:
    """Return key path and value of ``PATH=VALUE``; the value is a YAML scalar, list or mapping.

    Raises
    ------
    ProblemFileError
        Not of that form.
    """
    parts = _ASSIGNMENT.fullmatch(text)
    if parts is None or not parts[1].strip() or not parts[2].strip():
        raise ProblemFileError(
            f"--set {text}: expected PATH=VALUE, for instance --set tasks.com.gain=0.3"
        )
    path = parts[1].strip()
    source = parse(parts[2], f"--set {path}")
    return path, source.data


def apply_overrides(source: Source, overrides: Mapping[str, Any]) -> Source:
    """Return ``source`` with the value at each key path replaced, or added if it was not there.

    Raises ProblemFileError: the source is no mapping; or a path that leads into something that is
    no mapping or list, past the end of a list, or into a task or phase that does not exist; or a
    value that a later one replaces with all of its section.
    """
    if not isinstance(source.data, dict):
        raise ProblemFileError(f"{source.name}: is no mapping, in which a value could be replaced")
    data = copy.deepcopy(source.data)
    overridden, given = dict(source.overridden), dict[KeyPath, str]()
    for text, value in overrides.items():
        label = f"--set {text}"
        try:
            path = parse_path(text)
        except ProblemFileError as error:
            raise ProblemFileError(f"--set {error}") from None
        for before, name in given.items():
            if len(before) > len(path) and before[: len(path)] == path:
                raise ProblemFileError(
                    f"{label}: replaces {name} with all else there; give it first"
                )
        _put(data, path, plain(value), label)
        overridden[path], given[path] = label, text
    return replace(source, data=data, overridden=overridden)


def _put(data: dict[str, Any], path: KeyPath, value: Any, label: str) -> None:
    for section, kind, at in _NAMED:
        known = data.get(section)
        if _passes_through(path, section, at) and isinstance(known, dict) and path[at] not in known:
            name = str(path[at])
            raise ProblemFileError(f"{label}: no {kind} {name!r}{suggest(name, known)}")
    inside: Any = data
    for k, step in enumerate(path):
        _check_step(inside, step, path[:k], label)
        if k == len(path) - 1:
            inside[step] = value
        elif isinstance(inside, dict):
            inside = inside.setdefault(step, {})
        else:
            inside = inside[step]


def _passes_through(path: KeyPath, section: str, at: int) -> bool:
    """Return whether a path continues after a name at ``at`` that ``section`` must contain."""
    in_phase = at > 1 and path[0] == "phases" and path[at - 1 : at] == (section,)
    return len(path) > at + 1 and (in_phase or (at == 1 and path[0] == section))


def _check_step(inside: Any, step: str | int, so_far: KeyPath, label: str) -> None:
    """Refuse a step that the value before it does not have."""
    here = f"{written(so_far)!r}" if so_far else "the file"
    if isinstance(step, int):
        if not isinstance(inside, list):
            raise ProblemFileError(f"{label}: {here} is not a list, so it has no entry [{step}]")
        if step >= len(inside):
            raise ProblemFileError(
                f"{label}: {here} has {len(inside)} entries, the last is [{len(inside) - 1}]"
            )
    elif isinstance(inside, list) and step.isdecimal():
        raise ProblemFileError(
            f"{label}: {here} is a list; write {written((*so_far, 0))[:-2]}{step}]"
        )
    elif not isinstance(inside, dict):
        kind = "a list" if isinstance(inside, list) else f"{inside!r}"
        raise ProblemFileError(
            f"{label}: {here} is {kind} and has no keys; replace it as a whole: "
            f"--set {written(so_far)}='{{{step}: ...}}'"
        )
