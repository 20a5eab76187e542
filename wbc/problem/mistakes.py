"""Mistakes in a problem file, in plain words, each with its line and a suggestion.

Pydantic finds violations of the format. Unknown names and numbers that do not fit the robot, found
when objects are made, are collected here too, so that a file can be corrected at once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

from pydantic import BaseModel, ValidationError

from wbc.errors import ProblemFileError, UnknownNameError, WbcError, nearest, suggest
from wbc.problem.section import KnownKeys
from wbc.problem.source import KeyPath, Source

T = TypeVar("T")
SectionT = TypeVar("SectionT", bound=BaseModel)
Detail = Mapping[str, Any]


class Misplaced(ProblemFileError):
    """A mistake in the value at ``below``, relative to the current path."""

    def __init__(self, text: str, *below: str | int) -> None:
        super().__init__(text)
        self.below = below


class Mistakes:
    """Collects mistakes with their places in the file."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._found: list[tuple[KeyPath, str]] = []

    @contextmanager
    def at(self, *path: str | int) -> Iterator[None]:
        """Note a :class:`WbcError` in the block as a mistake at ``path``, and continue."""
        try:
            yield
        except WbcError as error:
            self.note(path, error)

    def require(self, path: KeyPath, make: Callable[[], T]) -> T:
        """Return the result of ``make`` for the value at ``path``.

        Raises ProblemFileError: it failed, or there was a mistake before: nothing can be built
        without it.
        """
        try:
            made = make()
        except WbcError as error:
            self.note(path, error)
            raise self._error() from error
        self.raise_any()
        return made

    def raise_any(self) -> None:
        """Raise ProblemFileError, with everything noted, if there was any mistake."""
        if self._found:
            raise self._error()

    def _error(self) -> ProblemFileError:
        return ProblemFileError(self.source.messages(self._found))

    def fail(self, path: KeyPath, text: str) -> NoReturn:
        """Raise ProblemFileError, with a last mistake at ``path``."""
        self.note(path, text)
        raise self._error()

    def note(self, path: KeyPath, error: WbcError | str) -> None:
        """Note a mistake, or its text; an unknown name is searched at and below ``path``.

        A text that begins with the section and one of its keys, such as "gait, height: ", is a
        mistake in that key.
        """
        text, here = str(error), self.source.at(path)
        if isinstance(error, Misplaced):
            path = (*path, *error.below)
        elif isinstance(error, UnknownNameError):
            path = self.source.find(error.name, path)
        elif path and isinstance(here, dict):
            section, _, rest = text.partition(", ")
            key, colon, said = rest.partition(": ")
            if section == path[-1] and key in here and colon:
                path, text = (*path, key), said
        self._found.append((path, text))


def read_section(section: type[SectionT], source: Source) -> SectionT:
    """Return the data of a source as a section."""
    keys: dict[int, KnownKeys] = {}
    try:
        return section.model_validate(source.data, context=keys)
    except ValidationError as error:
        raise ProblemFileError(source.messages(complaints(error, source, keys))) from error


def complaints(
    error: ValidationError, source: Source, keys: Mapping[int, KnownKeys], below: KeyPath = ()
) -> list[tuple[KeyPath, str]]:
    """Return every complaint: where it belongs, and its text.

    ``keys``: the keys that a mapping of ``source`` may have, by the mapping's identity; ``below``:
    where what was validated stands in ``source``.
    """
    details: list[Detail] = [
        {**detail, "loc": (*below, *detail["loc"])} for detail in error.errors(include_url=False)
    ]
    misspelt = {
        (*path[:-1], nearest(str(path[-1]), _known_keys(path, source, keys).here))
        for path in (_path(one) for one in details if one["type"] == "extra_forbidden")
    }
    found: list[tuple[KeyPath, str]] = []
    for detail in details:
        path = _path(detail)
        if detail["type"] == "missing" and path in misspelt:
            continue  # "taget" is unknown, hence "target" is missing: one mistake, said once
        if detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]:
            continue  # pydantic does not count the entries that it has complained about
        if detail["type"] == "extra_forbidden":
            known = _known_keys(path, source, keys)
            text = f"unknown key{suggest(str(path[-1]), known.here)}"
            if (where := known.elsewhere.get(str(path[-1]))) is not None:
                text = f"belongs to {where}"
        else:
            path, text = _explain(detail, path)
        found.append((path, text))
    return found


def shown(value: Any) -> str:
    """Return a value as it might be written in a file, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else f"{'-' if value < 0 else ''}.inf"
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _path(detail: Detail) -> KeyPath:
    """Return the key path of a complaint, without pydantic's names of forms and of keys."""
    return tuple(
        step
        for step in detail["loc"]
        if isinstance(step, int) or not (step == "[key]" or re.fullmatch(r"\(.*\)", step))
    )


def _known_keys(path: KeyPath, source: Source, keys: Mapping[int, KnownKeys]) -> KnownKeys:
    return keys.get(id(source.at(path[:-1])), KnownKeys())


def _explain(detail: Detail, path: KeyPath) -> tuple[KeyPath, str]:
    kind, value = detail["type"], detail["input"]
    if kind == "missing":
        return path[:-1], f"{str(path[-1])!r} is missing"
    if kind == "one_of":
        return _choice(value, detail["ctx"], path)
    speak = _TEXTS.get(kind)
    if speak is None:
        text = detail["msg"]
        return path, f"{text[:1].lower()}{text[1:]}, got {shown(value)}{decimal_comma(value)}"
    return path, speak(value, detail.get("ctx", {}))


def _choice(value: Any, context: Detail, path: KeyPath) -> tuple[KeyPath, str]:
    """Explain a section whose ``type``, ``control`` or ``method`` does not exist."""
    key, words = context["key"], context["words"].split(", ")
    if not isinstance(value, dict):
        example = context["example"]
        return path, f"expected keys and values such as {example}, got {shown(value)}"
    if key not in value:
        return path, f"{key!r} is missing (choose from: {', '.join(words)})"
    return (*path, key), f"{shown(value[key])} does not exist{suggest(str(value[key]), words)}"


def decimal_comma(value: Any) -> str:
    """Return what to write instead of a number with a comma in it; empty if it is none."""
    comma = isinstance(value, str) and re.fullmatch(r"[-+]?\d+,\d+", value.strip())
    return f" (write {value.strip().replace(',', '.')}, with a point)" if comma else ""


def _number(value: Any, _: Detail, kind: str = "a number") -> str:
    if isinstance(value, str):
        return f"expected {kind}, got the text {shown(value)}{_number_hint(value)}"
    return f"expected {kind}, got {shown(value)}"


def _number_hint(value: str) -> str:
    try:
        float(value)
    except ValueError:
        return decimal_comma(value)
    return " (leave out the quotes)"


def _word(value: Any, _: Detail) -> str:
    return f"expected text, got {shown(value)}" + (
        " (put it in quotes)" if isinstance(value, int | float) else ""
    )


def _list(value: Any, _: Detail) -> str:
    mask = isinstance(value, int | str) and re.fullmatch(r"[01]+|[xyz]+", str(value))
    hint = "; a mask is not understood, name the rows as in [x, y]" if mask else ""
    if isinstance(value, Mapping) and value.keys() & {"rpy", "quaternion"}:
        return f"expected three rows of a rotation matrix, got {shown(value)}"
    return f"expected a list such as [x, y], got {shown(value)}{hint}"


def _literal(value: Any, context: Detail) -> str:
    choices = re.findall(r"'([^']*)'", context["expected"]) or [context["expected"]]
    return f"{shown(value)} does not exist{suggest(str(value), choices)}"


def _bound(phrase: str, key: str) -> Callable[[Any, Detail], str]:
    return lambda value, context: f"must be {phrase} {context[key]:g}, got {shown(value)}"


def _entries(value: Any, context: Detail) -> str:
    least, most = context.get("min_length"), context.get("max_length")
    size = context["actual_length"]
    if not size:
        return "empty; it needs at least one entry"
    bound = f"at least {least}" if most is None else f"at most {most}"
    return f"needs {bound} entries, got {size}: {shown(value)}"


_TEXTS: Mapping[str, Callable[[Any, Detail], str]] = {
    "twice": lambda _, context: f"{context['entry']} is named twice",
    "float_type": _number,
    "int_type": lambda value, context: _number(value, context, "a whole number"),
    "finite_number": lambda value, _: f"must be a finite number, got {shown(value)}",
    "bool_type": lambda value, _: f"expected true or false, got {shown(value)}",
    "string_type": _word,
    "tuple_type": _list,
    "dict_type": lambda value, _: f"expected keys and values, got {shown(value)}",
    "model_type": lambda value, _: f"expected keys and values, got {shown(value)}",
    "none_required": lambda *_: "has no place in a problem of this kind; leave it out",
    "literal_error": _literal,
    "greater_than": _bound("greater than", "gt"),
    "greater_than_equal": _bound("at least", "ge"),
    "less_than": _bound("less than", "lt"),
    "less_than_equal": _bound("at most", "le"),
    "too_short": _entries,
    "too_long": _entries,
    "string_too_short": lambda *_: "empty; some text is needed",
    "string_pattern_mismatch": lambda value, _: (
        f"{shown(value)} cannot be a name; use letters, digits, spaces, _ and -, and begin with a "
        "letter or digit"
    ),
}
