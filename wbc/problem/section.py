"""What every part of a problem file is made of: strict sections, numbers, and values of many forms.

A value may be written in several forms (a weight is one number or a list of them). Which form it is
decides, before anything is checked, what the messages are about; the tags below name the forms.
They are in parentheses, so that they cannot be taken for keys of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    Tag,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

START_WORD = "start"
START, WORD, NUMBER, LIST, MATRIX, MAPPING = (
    Tag(f"({form})") for form in ("start", "word", "number", "list", "matrix", "mapping")
)


class Section(BaseModel):
    """A mapping with known keys; any other key is an error, and no value is converted."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True
    )

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Note which keys this mapping may have: a message about a wrong one lists them.

        The note goes to the validation's context, under the identity of the mapping.
        """
        if isinstance(info.context, dict):
            info.context[id(data)] = tuple(cls.model_fields)
        return data


def form_of(value: Any) -> str | None:
    """Return the tag of the form in which a value is written."""
    if isinstance(value, str):
        return START.tag if value == START_WORD else WORD.tag
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float):
        return NUMBER.tag
    if isinstance(value, Mapping | BaseModel):
        return MAPPING.tag
    if not isinstance(value, list | tuple):
        return None
    nested = any(isinstance(entry, list | tuple) for entry in value)
    return MATRIX.tag if nested else LIST.tag


def forms(expected: str) -> Discriminator:
    """Return what picks a form of a union; ``expected`` names the forms in messages."""
    return Discriminator(
        form_of, custom_error_type="form", custom_error_message=f"expected {expected}"
    )


def _distinct(entries: tuple[str, ...]) -> tuple[str, ...]:
    for entry in entries:
        if entries.count(entry) > 1:
            raise PydanticCustomError("twice", "{entry} is named twice", {"entry": repr(entry)})
    return entries


# Nothing about a robot in SI units is larger; squared twice it still is far from overflow.
LARGEST = 1e9

Number = Annotated[float, Field(allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(allow_inf_nan=False, gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(allow_inf_nan=False, ge=0, le=LARGEST)]
Fraction = Annotated[float, Field(allow_inf_nan=False, gt=0, le=1)]
PositiveOrInfinite = Annotated[float, Field(gt=0)]
Name = Annotated[str, Field(min_length=1)]

# Lists of the file become tuples, hence lax about the container and strict about the entries.
Point = Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=3)]
Quaternion = Annotated[tuple[Number, ...], Strict(False), Field(min_length=4, max_length=4)]
Pair = Annotated[tuple[Number, ...], Strict(False), Field(min_length=2, max_length=2)]
# (least, greatest), in which infinity is no limit; what gets it checks the order.
Range = Annotated[tuple[float, ...], Strict(False), Field(min_length=2, max_length=2)]
Names = Annotated[tuple[Name, ...], Strict(False), Field(min_length=1)]
Distinct = AfterValidator(_distinct)

Weight = Annotated[
    Annotated[NonNegative, NUMBER]
    | Annotated[tuple[NonNegative, ...], Strict(False), Field(min_length=1), LIST],
    forms("a number, or a list with one for each row of the task"),
]
