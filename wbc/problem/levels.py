"""Tasks and keys of one control level only, which are refused at the other.

They would have no effect, without anyone noticing.
"""

from __future__ import annotations

from collections.abc import Iterator

from wbc.problem.mistakes import Mistakes
from wbc.problem.section import Section
from wbc.problem.source import KeyPath
from wbc.problem.spec import ProblemSpec
from wbc.problem.support import ContactSpec, Support

VELOCITY, TORQUE = "velocity", "torque"
TASK_KEYS = {
    VELOCITY: ("gain", "gain_per_second", "lm_damping", "singular_threshold", "weighs_error"),
    TORQUE: ("kp", "kd", "law"),
}
CONTACT_KEYS = {VELOCITY: ("gain",), TORQUE: ("kp", "kd", "friction", "corners")}
REMEDY = {
    VELOCITY: "at the torque level give kp and kd, or leave both out",
    TORQUE: "give controller: {level: torque}, or leave it out",
}


def check_level(spec: ProblemSpec, mistakes: Mistakes) -> None:
    """Note the tasks and keys that have no effect at a problem's level."""
    other = VELOCITY if spec.controller.level == TORQUE else TORQUE
    for name, task in spec.tasks.items():
        if task.level == other:
            text = f"give controller: {{level: {other}}}, or leave the task out"
            mistakes.note(
                ("tasks", name, "type"), f"{task.type} belongs to the {other} level; {text}"
            )
    for path, section in _sections(spec):
        keys = (CONTACT_KEYS if isinstance(section, ContactSpec) else TASK_KEYS)[other]
        for key in sorted(section.model_fields_set & set(keys)):
            mistakes.note((*path, key), f"belongs to the {other} level; {REMEDY[other]}")


def _sections(spec: ProblemSpec) -> Iterator[tuple[KeyPath, Section]]:
    for name, task in spec.tasks.items():
        yield ("tasks", name), task
    supports: list[tuple[KeyPath, Support | None]] = [(("support",), spec.support)]
    for name, phase in (spec.phases or {}).items():
        supports.append((("phases", name, "support"), phase.support))
    for path, support in supports:
        for k, one in enumerate(() if isinstance(support, str | None) else support):
            if isinstance(one, ContactSpec):
                yield (*path, k), one
