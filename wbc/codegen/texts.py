"""A controller's plan and recorded ticks as C text, exact to the last bit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.codegen.c_text import comment, literal
from wbc.codegen.core_parts import CodegenError
from wbc.codegen.recording import TickRecording
from wbc.codegen.targets import contact_parts, task_parts
from wbc.native import ffi

PER_LINE = 6
# Arrays of each controller in C, not of the plan.
_RUNTIME = ("state", "out", "scratch", "order", "rows", "below", "given", "push")


def plan_header(recording: TickRecording, title: str) -> str:
    """Return plan.h: sizes and names."""
    controller, memory = recording.controller, recording.plan.memory
    solver, robot = recording.solver, controller.robot
    tasks, contacts = task_parts(controller), contact_parts(controller)
    parts = [
        f"    {part.name} = {k}, /* {part.kind.name}: {comment(part.task.name)} */"
        for k, part in enumerate((*tasks, *contacts))
    ]
    sizes = {
        "NQ": robot.nq,
        "NV": robot.nv,
        "TORQUE": int(memory.struct.torque),
        "TASKS": len(tasks),
        "PARTS": len(tasks) + len(contacts),
        "NUMBERS": memory.arrays["number"].size,
        "STATE": memory.state.size,
        "OUT": memory.layout.out,
        "SCRATCH": memory.arrays["scratch"].size,
        "ORDER": memory.arrays["order"].size,
    }
    lines = [
        f"/* {comment(title)} */",
        "#ifndef WBC_PLAN_H",
        "#define WBC_PLAN_H",
        "",
        '#include "core/core.h"',
        "",
        *(f"#define WBC_{name} {size}" for name, size in sizes.items()),
        f"#define WBC_DT {number_text(controller.dt)} /* {controller.dt:g} s */",
        f"#define WBC_EPS {number_text(solver.eps)} /* {solver.eps:g} */",
        "",
        "/* What has a target: tasks, then contacts. */",
        "enum wbc_part {",
        *parts,
        "};",
        "",
        "extern const wbc_plan wbc_planned;",
        "extern const char *const wbc_joint_names[WBC_NV - 6];",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def plan_source(recording: TickRecording, title: str) -> str:
    """Return plan.c: all that was planned."""
    controller, memory = recording.controller, recording.plan.memory
    names = ",\n".join(f"    {literal(name)}" for name in controller.robot.joint_names)
    tree, margin = memory.tree, memory.margin
    arrays = {**memory.arrays, "number": recording.numbers}
    pointers = {
        "tree": "&tree",
        "block": "block",
        "force": "0",  # nothing is touched: an arm, or a robot in the air
        # C knows no arrays without entries.
        **{name: name if array.size else "0" for name, array in arrays.items()},
        **dict.fromkeys(_RUNTIME, "0"),
    }
    parts = [
        *struct_texts("tree", tree.struct, tree.arrays),
        *(array_text(name, array) for name, array in arrays.items() if name not in _RUNTIME),
        _list("block", memory.blocks),
    ]
    if memory.forces is not None and memory.forces.count:
        pointers["force"] = "force"
        parts.append(_list("force", memory.forces.structs))
    if margin is not None:
        pointers["margin"] = "&margin"
        parts += struct_texts("pairs", margin.watched, margin.known.pairs.arrays)
        parts += struct_texts("margin", margin.struct, margin.arrays, of="&pairs")
    return "\n".join(
        [
            f"/* {comment(title)} */",
            '#include "plan.h"',
            "",
            f"const char *const wbc_joint_names[WBC_NV - 6] = {{\n{names},\n}};",
            "",
            *parts,
            f"const wbc_plan wbc_planned = {fields_text(memory.struct, pointers)};",
            "",
        ]
    )


def recording_text(recording: TickRecording) -> str:
    """Return recording.txt, which main.c reads."""
    robot = recording.controller.robot
    torque = int(recording.plan.memory.struct.torque)
    lines = [f"wbc recording 1 {len(recording.ticks)} {robot.nq} {robot.nv} {torque}"]
    for tick in recording.ticks:
        command = (tick.velocity,) if tick.torque is None else (tick.velocity, tick.torque)
        numbers = np.concatenate((tick.q, tick.v, *tick.targets, *command)).tolist()
        lines.append(" ".join(map(float.hex, numbers)))
    return "\n".join(lines) + "\n"


def struct_texts(
    name: str, struct: Any, arrays: Mapping[str, NDArray[Any]], **pointers: str
) -> list[str]:
    """Return the definitions of arrays and of a struct of the core that points at them.

    Both are named without ``wbc_``; ``pointers`` are its others, in words.
    """
    at = {key: f"{name}_{key}" for key in arrays} | pointers
    found = [array_text(at[key], array) for key, array in arrays.items()]
    return [*found, f"static const wbc_{name} {name} = {fields_text(struct, at)};\n"]


def _list(name: str, structs: Iterable[Any]) -> str:
    inside = "".join(f"{fields_text(one, {})},\n" for one in structs)
    return f"static const wbc_{name} {name}[] = {{\n{inside}}};\n"


def fields_text(struct: Any, pointers: Mapping[str, str]) -> str:
    """Return the fields of a struct, or of what points at one; those that point in words."""
    fields, kind = [], ffi.typeof(struct)
    for name, field in (kind.item if kind.kind == "pointer" else kind).fields:
        value = getattr(struct, name)
        if field.type.kind == "array":
            entries = ", ".join(map(number_text, value))
            fields.append(f"    .{name} = {{{entries}}},\n")
        elif field.type.kind != "pointer":
            fields.append(f"    .{name} = {number_text(value)},\n")
        elif name in pointers:
            fields.append(f"    .{name} = {pointers[name]},\n")
        elif value:
            raise CodegenError(f"the core reads {name!r} of this controller, which is not exported")
    return f"{{\n{''.join(fields)}}}"


def array_text(name: str, array: NDArray[Any]) -> str:
    """Return the definition of an array, flat; nothing for one without entries."""
    if not array.size:
        return ""
    kind = "int64_t" if array.dtype.kind == "i" else "double"
    values = [number_text(value) for value in array.ravel().tolist()]
    lines = [
        "    " + ", ".join(values[k : k + PER_LINE]) + ",\n"
        for k in range(0, len(values), PER_LINE)
    ]
    return f"static const {kind} {name}[] = {{\n{''.join(lines)}}};\n"


def number_text(value: float) -> str:
    """Return an integer, or a float with every bit of it."""
    if isinstance(value, int):
        return str(value)
    return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(str(value), float.hex(value))
