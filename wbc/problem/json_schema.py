"""The JSON Schema of problem files, for editors and other checkers."""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise
from typing import Any

from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue, models_json_schema
from pydantic_core.core_schema import ModelSchema

from wbc.problem.retarget import RetargetSpec
from wbc.problem.section import Section
from wbc.problem.spec import ProblemSpec
from wbc.problem.walk import WalkSpec


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a problem file.

    A file with the key ``model`` is about a pendulum, one with ``motion`` is for ``wbc retarget``,
    any other is about a robot; with ``gait`` it walks.
    """
    from wbc.problem.pendulum.spec import PendulumSpec  # only now: it loads CasADi

    specs = ProblemSpec, WalkSpec, PendulumSpec, RetargetSpec
    places, schema = models_json_schema(
        [(spec, "validation") for spec in specs], schema_generator=_WithDocstrings
    )
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


class _WithDocstrings(GenerateJsonSchema):
    """Describes keys by the docstrings below them.

    Only where a schema is asked for: pydantic's own ``use_attribute_docstrings`` reads the sources
    whenever the sections are loaded, a fifth of the start of every command.
    """

    def model_schema(self, schema: ModelSchema) -> JsonSchemaValue:
        described = super().model_schema(schema)
        for section in schema["cls"].__mro__:
            if issubclass(section, Section):
                for key, text in _docstrings(section.__module__).get(section.__name__, {}).items():
                    if key in described["properties"]:
                        described["properties"][key].setdefault("description", text)
        return described


@cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings below attributes of the classes of a module, by class and attribute."""
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError):  # typed at a prompt
        return {}
    return {
        section.name: {
            key.target.id: inspect.cleandoc(str(text.value.value))
            for key, text in pairwise(section.body)
            if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name)
            if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        }
        for section in ast.walk(ast.parse(source))
        if isinstance(section, ast.ClassDef)
    }


def _unwrapped(schema: Any) -> Any:
    """Return a schema whose descriptions are on one line each."""
    if isinstance(schema, dict):
        return {key: _unwrapped(value) for key, value in schema.items()}
    if isinstance(schema, list):
        return [_unwrapped(value) for value in schema]
    return " ".join(schema.split()) if isinstance(schema, str) else schema
