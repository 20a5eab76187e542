"""The JSON Schema of problem files, for editors and other checkers."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import models_json_schema

from wbc.problem.retarget import RetargetSpec
from wbc.problem.spec import ProblemSpec
from wbc.problem.walk import WalkSpec


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a problem file.

    A file with the key ``model`` is about a pendulum, one with ``motion`` is for ``wbc retarget``,
    any other is about a robot; with ``gait`` it walks.
    """
    from wbc.problem.pendulum.spec import PendulumSpec  # only now: it loads CasADi

    specs = ProblemSpec, WalkSpec, PendulumSpec, RetargetSpec
    places, schema = models_json_schema([(spec, "validation") for spec in specs])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:wbc:schema:problem:1",
        "title": "wbc problem",
        "if": {"type": "object", "required": ["model"]},
        "then": places[PendulumSpec, "validation"],
        "else": {
            "if": {"type": "object", "required": ["motion"]},
            "then": places[RetargetSpec, "validation"],
            "else": {
                "if": {"type": "object", "required": ["gait"]},
                "then": places[WalkSpec, "validation"],
                "else": places[ProblemSpec, "validation"],
            },
        },
        "$defs": _unwrapped(schema["$defs"]),
    }


def _unwrapped(schema: Any) -> Any:
    """Return a schema whose descriptions are on one line each."""
    if isinstance(schema, dict):
        return {key: _unwrapped(value) for key, value in schema.items()}
    if isinstance(schema, list):
        return [_unwrapped(value) for value in schema]
    return " ".join(schema.split()) if isinstance(schema, str) else schema
