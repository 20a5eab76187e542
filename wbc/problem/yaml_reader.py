"""YAML text to plain data (mappings, lists, text, numbers), and the line of every key.

A problem file may come from a stranger: nothing in it is executed, and nothing in it can make
reading slow or large. Size, depth, aliases and the expanded number of values are limited, tags and
merge keys are refused, and so are duplicate keys, of which plain YAML keeps either.
"""

from __future__ import annotations

import contextlib
import re
import sys
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    Event,
    NodeEvent,
)
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from wbc.errors import ProblemFileError, shown
from wbc.problem.source import KeyPath, Source, written

DASH, STDIN = Path("-"), "<stdin>"
PROBLEMS = Path("problems")  # where a clone has its own
MAX_BYTES = 1_000_000
# First bytes of packed files: ZIP (.npz), gzip, HDF5.
BINARY = (b"PK", b"\x1f\x8b", b"\x89H")
MAX_DEPTH = 32
MAX_ALIASES = 50
MAX_VALUES = 20_000
MAX_DIGITS = 400

_CORE = "tag:yaml.org,2002:"
_PLAIN = {_CORE + kind for kind in ("null", "bool", "int", "float", "str", "seq", "map")}
_NUMBERS = {_CORE + kind for kind in ("null", "bool", "int", "float")}
_HINTS = {
    "\\t": "indent with spaces, not with a tab",
    "mapping values are not allowed": "a text with ': ' in it needs quotes; or is a line indented "
    "too far?",
    "found unexpected end of stream": "a closing quote is missing",
    "<stream end>": "a closing bracket is missing",
    "expected ',' or '}'": "is a comma missing, or a blank after a colon, as in {a: 1, b: 2}?",
    "expected <block end>": "this line is indented differently from its neighbours",
}
_STAR = re.compile(r"(?:^|[\s{\[,])\*\w")


def read_source(path: Path, keys: str = "'robot:' and 'tasks:'") -> Source:
    """Read a problem file, or another that needs at least ``keys``; ``-`` is stdin.

    Raises ProblemFileError: missing, unreadable, too large, not UTF-8, not YAML, or not a mapping.
    """
    name = STDIN if path == DASH else str(path)
    source = parse(_text_of(path, name), name)
    if source.data is None:
        raise ProblemFileError(f"{name}: empty; it needs at least {keys}")
    if not isinstance(source.data, dict):
        raise ProblemFileError(
            f"{name}:1: expected keys such as {keys}, got "
            f"{'a list' if isinstance(source.data, list) else shown(source.data)}"
        )
    return source


def _text_of(path: Path, name: str) -> str:
    try:
        if path == DASH:
            content = sys.stdin.buffer.read(MAX_BYTES + 1)
        else:
            with path.open("rb") as file:
                content = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise ProblemFileError(f"{name}: no such file{_similar_file(path)}") from None
    except IsADirectoryError:
        raise ProblemFileError(f"{name}: a folder; name a problem file in it") from None
    except (OSError, ValueError) as error:
        raise ProblemFileError(f"{name}: cannot be read: {error}") from error
    if len(content) > MAX_BYTES:
        raise ProblemFileError(f"{name}: larger than {MAX_BYTES:,} bytes; is it a problem file?")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if content[:2] in BINARY:
            raise ProblemFileError(
                f"{name}: no problem file, but a packed one (.npz, .gz); results are for wbc"
                " replay, report, render and export"
            ) from None
        line = content.count(b"\n", 0, error.start) + 1
        raise ProblemFileError(f"{name}:{line}: not UTF-8 text; save the file as UTF-8") from error


def _similar_file(path: Path) -> str:
    """Return a suggestion for a missing file, or an empty text."""
    stems = (path.with_suffix(".yaml"), path.with_suffix(".yml"))
    places = (*stems, *(PROBLEMS / one.name for one in stems))
    with contextlib.suppress(OSError, ValueError):
        found = next((one for one in places if one.is_file()), None)
        if found is not None:
            return f"; did you mean {found}?"
        names = {one.stem: one for one in path.parent.glob("*.y*ml")}
        for stem in get_close_matches(path.stem, names, n=1):
            return f"; did you mean {names[stem]}?"
    return ""


def parse(text: str, name: str) -> Source:
    """Return the data in YAML ``text``; ``name`` is what messages call it.

    Raises ProblemFileError: not YAML, or refused as described at the top of this file.
    """
    try:
        _check_events(text, name)
        root = YAML(typ="safe", pure=True).compose(text)
    except YAMLError as error:
        raise ProblemFileError(_syntax_message(error, text, name)) from error
    if root is None:
        return Source(name, text, None, {})
    walk = _Walk(name)
    return Source(name, text, walk.value(root, ()), walk.lines)


def _check_events(text: str, name: str) -> None:
    """Check limits on the stream of events, before nested objects are made."""
    depth = aliases = documents = 0
    for count, event in enumerate(YAML(typ="safe", pure=True).parse(text)):
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        aliases += isinstance(event, AliasEvent)
        documents += isinstance(event, DocumentStartEvent)
        tag = getattr(event, "tag", None) if isinstance(event, NodeEvent) else None
        if tag is not None and str(tag) not in _PLAIN:
            _refuse(name, event, f"the tag {str(tag)!r} is not allowed; write plain values")
        if depth > MAX_DEPTH:
            _refuse(name, event, f"nested deeper than {MAX_DEPTH} levels")
        if aliases > MAX_ALIASES:
            _refuse(name, event, f"more than {MAX_ALIASES} aliases (*name)")
        if documents > 1:
            _refuse(name, event, "a second document begins here; a file holds one problem")
        if count > 2 * MAX_VALUES:
            _refuse(name, event, f"more than {MAX_VALUES:,} values")


def _refuse(name: str, event: Event, reason: str) -> None:
    raise ProblemFileError(f"{name}:{event.start_mark.line + 1}: {reason}")


def _syntax_message(error: YAMLError, text: str, name: str) -> str:
    if not isinstance(error, MarkedYAMLError) or error.problem_mark is None:
        return f"{name}: not valid YAML: {str(error).splitlines()[0]}"
    mark = error.problem_mark
    if error.context_mark and ("end of stream" in error.problem or "stream end" in error.problem):
        mark = error.context_mark  # where the quote or bracket opens that nothing closes
    line = mark.line
    problem = ", ".join(part for part in (error.context, error.problem) if part)
    hint = next((f" ({hint})" for sign, hint in _HINTS.items() if sign in problem), "")
    if _STAR.search("".join(text.splitlines()[line : line + 1])):
        hint = ' (text that begins with * needs quotes, as in "*_knee")'
    return f"{name}:{line + 1}: not valid YAML: {problem}{hint}"


class _Walk:
    """Turns nodes into data; aliases are expanded, and the expanded values counted."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self._values = 0
        self._scalars = YAML(typ="safe", pure=True).constructor

    def value(self, node: Node, path: KeyPath) -> Any:
        self.lines.setdefault(path, node.start_mark.line + 1)
        self._values += 1
        if self._values > MAX_VALUES or len(path) > MAX_DEPTH:
            raise self._error(path, "too much; do aliases (*name) repeat themselves?")
        if isinstance(node, MappingNode):
            return self._mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.value(entry, (*path, k)) for k, entry in enumerate(node.value)]
        return self._scalar(node, path)

    def _mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if data and not value_node.value and str(key_node.value).isdecimal():
                self._refuse_comma((*path, last := next(reversed(data))), data[last], key_node)
            key = self._key(key_node, path)
            if node.flow_style and ":" in key and not (key_node.style or value_node.value):
                spaced = "{" + key.replace(":", ": ") + "}"
                raise self._error((*path, key), f"a blank is missing after the colon: {spaced}")
            here = (*path, key)
            if key in data:
                first = self.lines[here]
                self.lines[here] = line
                raise self._error(here, f"given twice, first on line {first}; keep one")
            self.lines[here] = line
            data[key] = self.value(value_node, here)
        return data

    def _refuse_comma(self, path: KeyPath, before: Any, node: Node) -> None:
        """Refuse ``{weight: 0,01}``, which YAML reads as a weight of 0 and a key 01."""
        if isinstance(before, int) and not isinstance(before, bool):
            number = f"{before}.{node.value}"
            raise self._error(path, f"a decimal comma? write {number}, with a point")

    def _key(self, node: Node, path: KeyPath) -> str:
        line = node.start_mark.line + 1
        if not isinstance(node, ScalarNode):
            raise ProblemFileError(f"{self.name}:{line}: a key must be text, not a list or mapping")
        if node.tag == _CORE + "merge":
            raise ProblemFileError(
                f"{self.name}:{line}: merge keys (<<) are not read; write the entries out"
            )
        if node.tag in _NUMBERS:
            place = f"{written(path)}: " if path else ""
            raise ProblemFileError(
                f"{self.name}:{line}: {place}the key {node.value or 'null'!s} is not text; put it "
                "in quotes"
            )
        return str(node.value)

    def _scalar(self, node: Node, path: KeyPath) -> Any:
        if node.tag not in _NUMBERS:
            return str(node.value)
        if len(str(node.value)) > MAX_DIGITS:
            raise self._error(path, _unsupported(node))
        try:
            return self._scalars.construct_object(node)
        except (ValueError, IndexError, YAMLError) as error:
            raise self._error(path, _unsupported(node)) from error

    def _error(self, path: KeyPath, text: str) -> ProblemFileError:
        return ProblemFileError(Source(self.name, "", None, self.lines).message(path, text))


def _unsupported(node: Node) -> str:
    return f"not a usable number: {str(node.value)[:40]!r}; a text needs quotes"
