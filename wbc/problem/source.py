"""The unvalidated data of a problem file, with the line of each part."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from wbc.errors import ProblemFileError

# Path of a value in nested mappings and lists, written as tasks.com.target[0].
KeyPath = tuple[str | int, ...]

# A step is [3], "any text", 'any text', or text without the special characters.
_STEP = re.compile(r"""\[(\d{1,9})\] | "([^"]+)" | '([^']+)' | ([^.\[\]"']+)""", re.VERBOSE)


def written(path: KeyPath) -> str:
    """Return a key path as text; :func:`parse_path` reads it back."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            # Escaped: a key may contain terminal control sequences.
            shown = step if step.isprintable() else step.encode("unicode_escape").decode()
            plain = re.fullmatch(r"[^.\[\]\"'=]+", shown)
            text += ("." if text else "") + (shown if plain else f'"{shown}"')
    return text


def parse_path(text: str) -> KeyPath:
    """Return the key path that ``text`` spells, such as ``tasks.com.target[0]``.

    A key with a dot in it is put in quotes: ``robot.locked."waist.yaw"``.
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
            f"{text[:60]!r} is not a key path; write the keys with dots between, as in "
            "tasks.com.gain or tasks.com.target[0]"
        )
    return tuple(steps)


@dataclass(frozen=True)
class Source:
    """Plain data, and where each part of it was written."""

    name: str  # the file, as messages name it
    text: str  # the file's text
    data: Any  # mappings, lists, text, numbers, booleans and None
    lines: Mapping[KeyPath, int]  # line of every key and list entry, counted from 1
    # The override at a key path, for messages.
    overridden: Mapping[KeyPath, str] = field(default_factory=dict)

    def where(self, path: KeyPath) -> str:
        """Return where a value was written: ``file.yaml:12`` or ``--set tasks.com.gain``."""
        if path not in self.lines:  # what an override made on the way to its key
            for given, label in self.overridden.items():
                if given[: len(path)] == path:
                    return label
        prefixes = [path[:size] for size in range(len(path), -1, -1)]
        for prefix in prefixes:
            if prefix in self.overridden:
                return self.overridden[prefix]
        line = next((self.lines[prefix] for prefix in prefixes if prefix in self.lines), 1)
        return f"{self.name}:{line}"

    def message(self, path: KeyPath, text: str) -> str:
        """Return ``text`` preceded by the line and the key path."""
        where = self.where(path)
        named = not path or where.endswith(f" {written(path)}")  # as in --set tasks.com.gain
        return ": ".join((where, *([] if named else [written(path)]), text))

    def messages(self, mistakes: Iterable[tuple[KeyPath, str]]) -> str:
        """Return one text for all mistakes, in the order of the file; ``--set`` comes last."""
        ordered = sorted(mistakes, key=lambda mistake: self._order(mistake[0]))
        lines = list(dict.fromkeys(self.message(path, text) for path, text in ordered))
        if len(lines) == 1:
            return lines[0]
        return "\n  ".join((f"{len(lines)} mistakes in {self.name}:", *lines))

    def _order(self, path: KeyPath) -> tuple[bool, int]:
        place = self.where(path)
        inside = place.startswith(f"{self.name}:")
        return not inside, int(place.rpartition(":")[2]) if inside else 0

    def at(self, path: KeyPath) -> Any:
        """Return the value at a key path, or None if there is none."""
        value = self.data
        for step in path:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def find(self, text: str, below: KeyPath) -> KeyPath:
        """Return the path of the first key or value that is ``text`` at or below a path.

        If there is none, that path itself.
        """
        return next(_occurrences(self.at(below), text, below), below)


def _occurrences(value: Any, text: str, path: KeyPath) -> Iterator[KeyPath]:
    if value == text:
        yield path
    entries = value.items() if isinstance(value, dict) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else entries:
        if key == text:
            yield (*path, key)
        yield from _occurrences(entry, text, (*path, key))


def quoted(text: str) -> str:
    """Return a text as YAML reads it back: in quotes, unless it is plain."""
    plain = text.isascii() and all(letter.isalnum() or letter in "_-./" for letter in text)
    simple = plain and (text[0].isalpha() or text[0] == "/")
    return text if simple else "'" + text.replace("'", "''") + "'"
