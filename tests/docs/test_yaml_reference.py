"""The reference of problem files has all that the schema has."""

import re
import runpy
from pathlib import Path

from wbc.problem import json_schema

SITE = Path(__file__).parents[2] / "docs" / "site"


def test_every_key_and_every_kind_is_there() -> None:
    schema = json_schema()
    page = runpy.run_path(str(SITE / "yaml_reference.py"))["yaml_reference"](schema)
    anchors = re.findall(r"\{#([\w-]+)\}", page)
    assert len(anchors) == len(set(anchors))
    assert set(schema["$defs"]) <= set(anchors)
    assert set(re.findall(r"\]\(#([\w-]+)\)", page)) <= set(anchors)
    for name, part in schema["$defs"].items():
        for key, value in part["properties"].items():
            if "const" not in value:
                assert f"`{key}`" in page, (name, key)
