"""What a problem file says, before it is known to make sense, and the line of every key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from wbc.problem.keys import KeyPath, written


@dataclass(frozen=True)
class Source:
    """Plain data, and where each part of it was written.

    Attributes
    ----------
    name:
        The file, as messages name it.
    text:
        The file's text.
    data:
        Mappings, lists, text, numbers, booleans and None.
    lines:
        Line of every key and list entry, counted from 1.
    overridden:
        What replaced the file's value at a key path, for messages.
    """

    name: str
    text: str
    data: Any
    lines: Mapping[KeyPath, int]
    overridden: Mapping[KeyPath, str] = field(default_factory=dict)

    def where(self, path: KeyPath) -> str:
        """Return where a value was written: ``file.yaml:12`` or ``--set tasks.com.gain``."""
        prefixes = [path[:size] for size in range(len(path), -1, -1)]
        for prefix in prefixes:
            if prefix in self.overridden:
                return self.overridden[prefix]
        line = next((self.lines[prefix] for prefix in prefixes if prefix in self.lines), 1)
        return f"{self.name}:{line}"

    def message(self, path: KeyPath, text: str) -> str:
        """Return ``text`` headed by the place and the key path."""
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
            inside = isinstance(value, dict) and step in value
            inside = inside or (
                isinstance(value, list) and isinstance(step, int) and step < len(value)
            )
            if not inside:
                return None
            value = value[step]
        return value

    def find(self, text: str, below: KeyPath) -> KeyPath:
        """Return the path of the first key or value that is ``text`` at or below a path.

        Where there is none, that path itself.
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
