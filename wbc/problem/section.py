"""Building blocks of problem files: strict sections, numbers, and values with several forms.

A value may have several forms (a weight is a number or a list of them). The form is determined
before the value is checked, so that messages are about that form. Its name is in parentheses, so
that it cannot be mistaken for a key of the file.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from dataclasses import Field as DataclassField
from difflib import get_close_matches
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    Strict,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

Entry = TypeVar("Entry")
START_WORD = "start"
START, WORD, NUMBER, LIST, MATRIX, MAPPING = (
    f"({form})" for form in ("start", "word", "number", "list", "matrix", "mapping")
)
ALIKE = 0.8  # of keys that may be meant: 'position' is not 'motion'


class KnownKeys(NamedTuple):
    """The keys that a mapping may have, and the right places of keys that belong elsewhere."""

    here: tuple[str, ...] = ()
    elsewhere: Mapping[str, str] = MappingProxyType({})


class Section(BaseModel):
    """A mapping with known keys; any other key is an error, and no value is converted."""

    elsewhere: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Keys that make no sense here, and what they belong to, in words."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Note which keys this mapping may have: a message about a wrong one lists them.

        The note goes to the validation's context, under the identity of the mapping.
        """
        if isinstance(info.context, dict):
            info.context[id(data)] = KnownKeys(tuple(cls.model_fields), cls.elsewhere)
        return data


@dataclass(frozen=True)
class Words:
    """Annotates a text that must be one of some words."""

    words: tuple[str, ...]

    def __get_pydantic_core_schema__(self, _: Any, __: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.literal_schema(list(self.words))


@dataclass(frozen=True)
class OneOf:
    """Annotates sections that are distinguished by the word under one of their keys.

    They are the members of a union, or all leaf subclasses of a base class. The words are those of
    the sections' own ``Literal``; a section in which the key has a default is used if the key is
    left out.

    ``key``: such as ``type``.
    ``example``: a mapping, as messages show it.
    ``then``: the key that distinguishes sections with the same word.
    """

    key: str
    example: str
    then: str = ""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        parts = get_args(source) or (source,)
        return self._schema([section for part in parts for section in leaves(part)], handler)

    def _schema(self, sections: list[type[BaseModel]], handler: GetCoreSchemaHandler) -> CoreSchema:
        members, default = dict[str, list[type[BaseModel]]](), None
        for section in sections:
            field = section.model_fields[self.key]
            default = default if field.is_required() else field.default
            for word in get_args(field.annotation):
                members.setdefault(word, []).append(section)
        nested = OneOf(self.then, self.example)
        choices: dict[Any, CoreSchema] = {
            f"({word})": handler.generate_schema(same[0])
            if len(same) == 1
            else nested._schema(same, handler)
            for word, same in members.items()
        }

        def tag(value: Any) -> str | None:
            word = default
            if isinstance(value, BaseModel):
                word = getattr(value, self.key, None)
            elif isinstance(value, Mapping):
                word = value.get(self.key, default)
            return f"({word})" if isinstance(word, str) and word in members else None

        return core_schema.tagged_union_schema(
            choices,
            tag,
            custom_error_type="one_of",
            custom_error_message=f"expected keys and values such as {self.example}",
            custom_error_context={
                "key": self.key,
                "words": ", ".join(members),
                "example": self.example,
            },
        )


def leaves(section: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield the leaf subclasses of a section; itself if it has none."""
    subclasses = section.__subclasses__()
    if not subclasses:
        yield section
    for subclass in subclasses:
        yield from leaves(subclass)


def default_of(maker: Callable[..., Any], parameter: str) -> Any:
    """Return a parameter's default in a class or function, so that sections do not repeat it."""
    return inspect.signature(maker).parameters[parameter].default


@dataclass(frozen=True)
class Forms:
    """Annotates a union whose member is selected by the form of the value.

    Of several sections a mapping is the one that has most of its keys, or keys like them.

    ``expected``: names the forms in messages.
    """

    expected: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        members = {_form(member): member for member in get_args(source)}
        return core_schema.tagged_union_schema(
            {form: handler.generate_schema(member) for form, member in members.items()},
            lambda value: _form_in(members, value),
            custom_error_type="form",
            custom_error_message=f"expected {self.expected}",
        )


def _form(member: Any) -> str:
    """Return the form that a member of a union is written in; of a section, its name."""
    kind = get_args(member)[0] if get_origin(member) is Annotated else member
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return START if parts == (START_WORD,) else WORD
    if origin is tuple:
        entry = get_args(parts[0])[0] if get_origin(parts[0]) is Annotated else parts[0]
        return MATRIX if get_origin(entry) is tuple else LIST
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return f"({kind.__name__})"
    return {str: WORD, float: NUMBER, int: NUMBER}.get(kind, MAPPING)


def _form_in(members: Mapping[str, Any], value: Any) -> str | None:
    """Return the form in which a value is written; None: in none of these."""
    if isinstance(value, str):
        return START if value == START_WORD and START in members else WORD
    if isinstance(value, Mapping | BaseModel):
        return _mapping_in(members, value)
    if isinstance(value, list | tuple):
        nested = any(isinstance(entry, list | tuple) for entry in value)
        return MATRIX if nested else LIST
    return NUMBER if isinstance(value, int | float) and not isinstance(value, bool) else None


def _mapping_in(members: Mapping[str, Any], value: Mapping[str, Any] | BaseModel) -> str | None:
    keys = type(value).model_fields if isinstance(value, BaseModel) else value
    known = {
        form: getattr(member, "model_fields", ())
        for form, member in members.items()
        if form not in (START, WORD, NUMBER, LIST, MATRIX)
    }
    if len(known) == 1:
        return next(iter(known))
    hits = {
        form: sum(bool(get_close_matches(str(key), here, 1, ALIKE)) for key in keys)
        for form, here in known.items()
    }
    nearest = max(hits, key=lambda form: hits[form], default=None)
    return nearest if nearest and hits[nearest] else MAPPING


def _distinct(entries: tuple[str, ...]) -> tuple[str, ...]:
    for entry in entries:
        if entries.count(entry) > 1:
            raise PydanticCustomError("twice", "{entry} is named twice", {"entry": repr(entry)})
    return entries


# Nothing about a robot in SI units is larger; squared twice it still is far from overflow.
LARGEST = 1e9

Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0, le=LARGEST)]
# Of what is divided by: lengths, masses, durations.
Size = Annotated[float, Field(allow_inf_nan=False, ge=1e-9, le=LARGEST)]
NonNegative = Annotated[float, Field(allow_inf_nan=False, ge=0, le=LARGEST)]
Fraction = Annotated[float, Field(allow_inf_nan=False, gt=0, le=1)]
PositiveOrInfinite = Annotated[float, Field(gt=0)]
Name = Annotated[str, Field(min_length=1)]

# Lists of the file become tuples, hence lax about the container and strict about the entries.
ListOf = Annotated[tuple[Entry, ...], Strict(False)]
NonEmpty = Annotated[ListOf[Entry], Field(min_length=1)]
Two = Annotated[ListOf[Entry], Field(min_length=2, max_length=2)]
Three = Annotated[ListOf[Entry], Field(min_length=3, max_length=3)]
Names = NonEmpty[Name]
Distinct = AfterValidator(_distinct)

Point = Three[Number]
Components = Three[Number | None]  # of a vector; null is free
Quaternion = Annotated[ListOf[Number], Field(min_length=4, max_length=4)]
Pair = Two[Number]
Range = Two[float]  # (least, greatest); infinity is no limit; what gets it checks the order

# Numbers of joints, one for all or by name or pattern.
JointNumbers = Annotated[
    NonNegative | dict[Name, NonNegative], Forms("a number, or {joint or pattern: number}")
]
PositiveJointNumbers = Annotated[
    Positive | dict[Name, Positive], Forms("a number, or {joint or pattern: number}")
]

Weight = Annotated[
    NonNegative | NonEmpty[NonNegative],
    Forms("a number, or a list with one for each row of the task"),
]


class KeysOf:
    """Annotates a dict of a dataclass's fields, in ``Annotated[dict[str, Any], ...]``.

    Keys, descriptions and defaults are taken from the dataclass, which checks the numbers further
    when it is made. A key with a default may be left out, or be null. The form of a value follows
    from that: infinity means positive or infinite; a pair is (least, greatest); None is three
    components, of which some may be null; any other number is nonnegative.

    ``kind``: a dataclass with a section ``Parameters`` or ``Attributes`` in its docstring;
    ``forms``: types of keys to which the above does not apply.
    """

    def __init__(self, kind: type, /, **forms: Any) -> None:
        about, described = (inspect.getdoc(kind) or "").split("\n")[0], _descriptions(kind)
        entries = {
            each.name: _entry(each, forms.get(each.name), described.get(each.name))
            for each in fields(kind)
            if each.init
        }
        self._section = create_model(kind.__name__, __base__=Section, __doc__=about, **entries)

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema = handler.generate_schema(self._section)
        as_is = core_schema.plain_serializer_function_ser_schema(dict)
        return core_schema.no_info_after_validator_function(_given, schema, serialization=as_is)


def _given(section: BaseModel) -> dict[str, Any]:
    found = {name: getattr(section, name) for name in section.model_fields_set}
    return {name: value for name, value in found.items() if value is not None}


def _entry(of: DataclassField[Any], form: Any, description: str | None) -> Any:
    if of.default is of.default_factory is MISSING:
        return form, Field(description=description)
    number = isinstance(of.default, float) and math.isfinite(of.default)
    if form is None:
        sizes = {float: PositiveOrInfinite, tuple: Range}
        form = NonNegative if number else sizes.get(type(of.default), Components)
    return form | None, Field(of.default if number else None, description=description)


def _descriptions(kind: type) -> dict[str, str]:
    """Return the descriptions of a class's parameters in its docstring, by name."""
    _, *rest = re.split(
        r"\n(?:Parameters|Attributes)\n-+\n", inspect.getdoc(kind) or "", maxsplit=1
    )
    body = "".join(rest)
    body = re.split(r"\n\w+\n---", body)[0]
    found = re.findall(r"^(\w[\w, ]*):?\n((?:(?:    .*)?\n?)+)", body, re.MULTILINE)
    return {name: inspect.cleandoc(text) for names, text in found for name in names.split(", ")}
