"""The reference of problem files, made from their JSON Schema when the site is built."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

Schema = Mapping[str, Any]
FIRST = {
    "ProblemSpec": "A problem of a robot",
    "WalkSpec": "A walk",
    "PendulumSpec": "A problem of a pendulum",
    "RetargetSpec": "A human's motion for a robot",
}
SECTIONS = {
    "tasks": "Tasks",
    "constraints": "Constraints",
    "controller": "Controllers",
    "law": "Balance laws",
}
CHOSEN = ("type", "control", "method")  # constants that tell kinds apart
HEAD = """# Problem files

Made from the schema that `wbc schema` prints, so it says what this version accepts. A file with
the key `model` is about a pendulum, one with `gait` a walk, one with `motion` for
`wbc retarget`, any other about a robot. SI units;
angles in radians. Weights multiply a row before squaring. For completion in an editor:
`wbc schema > wbc.schema.json`.
"""


def yaml_reference(schema: Schema) -> str:
    """Return the page as Markdown."""
    return HEAD + "\n" + "\n".join(_Reference(schema["$defs"]).sections())


class _Reference:
    def __init__(self, definitions: Mapping[str, Schema]) -> None:
        self.definitions = definitions
        self.shown: set[str] = set()

    def sections(self) -> Iterator[str]:
        for first, title in FIRST.items():
            yield f"## {title} {{#{first}}}\n"
            self.shown.add(first)
            yield self.table(first)
            spec = self.definitions[first]["properties"]
            for key, words in SECTIONS.items():
                if key in spec:
                    yield f"## {words} {{#{first}-{key}}}\n"
                    yield from self.kinds(list(_references(spec[key])))
            rest = [name for name in self.reached(first) if name not in self.shown]
            if rest:
                yield f"## Parts of {title[0].lower()}{title[1:]} {{#{first}-parts}}\n"
            for name in rest:
                yield from self.section(name)

    def kinds(self, names: list[str]) -> Iterator[str]:
        """Yield a section for each kind, what all have in common said once, first."""
        rows = [dict(self.definitions[name]["properties"]) for name in names]
        common = {
            key: part
            for key, part in rows[0].items()
            if sum(other.get(key) == part for other in rows) > len(rows) / 2 and key not in CHOSEN
        }
        if len(names) > 2 and common:
            yield "These keys mean the same wherever a kind lists them:\n"
            yield self.rows(common, ())
        else:
            common = {}
        for name in names:
            yield from self.section(name, common)

    def section(self, name: str, common: Schema | None = None) -> Iterator[str]:
        if name in self.shown:
            return
        self.shown.add(name)
        parts = self.definitions[name]["properties"]
        chosen = [
            f"{key}: {parts[key]['const']}" for key in CHOSEN if "const" in parts.get(key, {})
        ]
        title = ", ".join(f"`{one}`" for one in chosen) or name.removesuffix("Spec")
        yield f"### {title} {{#{name}}}\n"
        yield self.table(name, common)

    def table(self, name: str, common: Schema | None = None) -> str:
        """Return the description and the keys of a definition."""
        one = self.definitions[name]
        own, said = {}, []
        for key, part in one["properties"].items():
            if key in CHOSEN and "const" in part:
                continue
            if common and common.get(key) == part:
                said.append(f"`{key}`")
            else:
                own[key] = part
        text = one.get("description", "") + "\n"
        if said:
            text += f"\nAlso: {', '.join(said)}.\n"
        return text + ("\n" + self.rows(own, one.get("required", ())) if own else "")

    def rows(self, parts: Schema, required: Any) -> str:
        lines = ["| key | value | default | meaning |", "|---|---|---|---|"]
        for key, part in parts.items():
            default = "needed" if key in required else _default(part)
            meaning = part.get("description", "").replace("|", r"\|")
            lines.append(f"| `{key}` | {self.kind(part)} | {default} | {meaning} |")
        return "\n".join(lines) + "\n"

    def kind(self, part: Schema) -> str:
        """Return in words what a value may be."""
        if "$ref" in part:
            name = part["$ref"].rpartition("/")[2]
            return f"[{name.removesuffix('Spec')}](#{name})"
        for either in ("anyOf", "oneOf"):
            if either in part:
                words = [self.kind(one) for one in part[either]]
                return " or ".join(dict.fromkeys(words))
        if "const" in part:
            return f"`{part['const']}`"
        if "enum" in part:
            return ", ".join(f"`{one}`" for one in part["enum"])
        if part.get("type") == "array":
            least, most = part.get("minItems"), part.get("maxItems")
            if least == most is not None:
                count = f"{least} "
            elif most is not None:
                count = f"{least or 0} to {most} "
            else:
                count = ""
            return f"list of {count}({self.kind(part.get('items', {}))})"
        if part.get("type") == "object":
            inner = [*part.get("patternProperties", {}).values()]
            more = part.get("additionalProperties")
            inner += [more] if isinstance(more, dict) else []
            return "mapping of names to " + " or ".join(self.kind(one) for one in inner)
        return {
            "string": "text",
            "number": "number" + _range(part),
            "integer": "whole number" + _range(part),
            "boolean": "`true`, `false`",
            "null": "`null`",
        }.get(part.get("type", ""), "any")

    def reached(self, name: str) -> list[str]:
        """Return the names of all definitions that a definition leads to, itself first."""
        found, ahead = [], [name]
        while ahead:
            now = ahead.pop(0)
            if now not in found:
                found.append(now)
                ahead += _references(self.definitions[now])
        return found


def _references(part: Any) -> Iterator[str]:
    if isinstance(part, Mapping):
        if "$ref" in part:
            yield part["$ref"].rpartition("/")[2]
        for key, value in part.items():
            if key != "discriminator":
                yield from _references(value)
    elif isinstance(part, list):
        for value in part:
            yield from _references(value)


def _range(part: Schema) -> str:
    if "minimum" in part and part["minimum"] > -1e8:
        return f" ≥ {part['minimum']:g}" + (f", ≤ {part['maximum']:g}" if _upper(part) else "")
    if "exclusiveMinimum" in part:
        above = f" > {part['exclusiveMinimum']:g}"
        return above + (f", ≤ {part['maximum']:g}" if _upper(part) else "")
    return ""


def _upper(part: Schema) -> bool:
    return "maximum" in part and part["maximum"] < 1e8


def _default(part: Schema) -> str:
    if "default" not in part or isinstance(part["default"], dict):
        return ""
    return f"`{json.dumps(part['default'])}`"
