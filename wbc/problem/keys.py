"""Key paths: where a value stands in nested mappings and lists, as ``tasks.com.target[0]``."""

from __future__ import annotations

import re

from wbc.errors import ProblemFileError

KeyPath = tuple[str | int, ...]

# A step is [3], "any text", 'any text', or text free of the characters that mean something here.
_STEP = re.compile(r"""\[(\d+)\] | "([^"]+)" | '([^']+)' | ([^.\[\]"']+)""", re.VERBOSE)


def written(path: KeyPath) -> str:
    """Return a key path as text; :func:`parse_path` reads it back."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            # Escaped, for a key may hold what a terminal would obey.
            shown = step if step.isprintable() else step.encode("unicode_escape").decode()
            plain = re.fullmatch(r"[^.\[\]\"'=]+", shown)
            text += ("." if text else "") + (shown if plain else f'"{shown}"')
    return text


def parse_path(text: str) -> KeyPath:
    """Return the key path that ``text`` spells, such as ``tasks.com.target[0]``.

    A key with a dot in it is put in quotes: ``robot.locked."waist.yaw"``.

    Raises
    ------
    ProblemFileError
        Empty, or not of that form.
    """
    steps: list[str | int] = []
    at = 0
    while at < len(text):
        if steps and text[at] == ".":
            at += 1
        step = _STEP.match(text, at)
        if step is None:
            break
        index, *names = step.groups()
        steps.append(next(name for name in names if name) if index is None else int(index))
        at = step.end()
        if at < len(text) and text[at] not in ".[":
            break
    if at < len(text) or not steps or text.endswith("."):
        raise ProblemFileError(
            f"{text!r} is not a key path; write the keys with dots between, as in "
            "tasks.com.gain or tasks.com.target[0]"
        )
    return tuple(steps)
