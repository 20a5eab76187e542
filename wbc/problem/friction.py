"""What contacts bear at the torque level, as a problem file describes it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from wbc.constraints.friction import MOST_FACETS, FrictionCone
from wbc.problem.section import Forms, NonNegative, Positive, Section, default_of


class FrictionSpec(Section):
    """A friction cone, as the pyramid that the controller knows of it."""

    coefficient: Positive = default_of(FrictionCone, "coefficient")
    """Friction coefficient: tangential force over normal force."""
    facets: Annotated[int, Field(ge=3, le=MOST_FACETS)] = default_of(FrictionCone, "facets")
    """Sides of the pyramid."""
    inner: bool = default_of(FrictionCone, "inner")
    """Whether the pyramid is inscribed in the cone, which is safe, or circumscribed."""
    least: NonNegative = default_of(FrictionCone, "least")
    """Normal force that the contact should have at least [N]; gives way where it cannot be had."""
    most: Positive | None = None
    """Largest normal force [N]; left out: any."""

    @field_validator("most")
    @classmethod
    def _above_least(cls, most: float | None, info: ValidationInfo) -> float | None:
        least = info.data.get("least")
        if most is not None and least is not None and most < least:
            raise PydanticCustomError("range", "must not be below least")
        return most


Friction = Annotated[
    Positive | FrictionSpec, Forms("a coefficient, or {coefficient: ..., facets: ...}")
]


def cone(friction: float | FrictionSpec) -> FrictionCone:
    """Return the cone of a coefficient or a mapping."""
    if isinstance(friction, FrictionSpec):
        return FrictionCone(**friction.model_dump(exclude_none=True))
    return FrictionCone(friction)
