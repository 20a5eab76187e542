"""Controllers as a problem file describes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from wbc.problem.section import Name, Positive, Section

METHODS = ("qp", "pseudo_inverse")


TimeStep = Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=1.0)]


class QpSpec(Section):
    """One quadratic program per tick: contacts and limits are met exactly, tasks as weighted."""

    method: Literal["qp"] = "qp"
    solver: Name = "proxqp"
    """The QP solver: proxqp, or any that qpsolvers finds installed."""
    eps: Positive | None = None
    """Accuracy asked of the solver; null: its default here."""
    formulation: Literal["equality", "reduced"] = "equality"
    """equality: contacts are rows of the QP; reduced: they are eliminated first."""
    dt: TimeStep = 0.005
    """Time step [s]."""
    damping: Positive = 1e-6
    """Weight of 1/2 |v|^2: picks one among equally good velocities."""
    on_failure: Literal["hold", "damp", "raise"] = "hold"
    """When a QP has no solution: stand still, slow down, or end the run."""


class PseudoInverseSpec(Section):
    """The damped pseudo-inverse of the paper, a baseline: limits are met by clipping."""

    method: Literal["pseudo_inverse"]
    dt: TimeStep = 0.005
    """Time step [s]."""
    damping: Positive = 1e-3
    """Weight of 1/2 |v|^2; the tasks' rows nearly lose rank, so it must not be tiny."""


def _method_form(value: Any) -> str | None:
    if isinstance(value, Section):
        return f"({getattr(value, 'method', None)})"
    if not isinstance(value, Mapping):
        return None
    method = value.get("method", "qp")
    return f"({method})" if method in METHODS else None


ControllerChoice = Annotated[
    Annotated[QpSpec, Tag("(qp)")] | Annotated[PseudoInverseSpec, Tag("(pseudo_inverse)")],
    Discriminator(
        _method_form,
        custom_error_type="controller",
        custom_error_message="expected a controller",
    ),
]
