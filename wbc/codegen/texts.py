"""The plan of a controller and its recorded ticks as text that C reads, every bit of them."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.codegen.known import CodegenError
from wbc.codegen.recording import Recording
from wbc.codegen.targets import contact_parts, task_parts
from wbc.controllers.native_memory import NativeMemory

_PER_LINE = 6
# What belongs to each controller in C, not to the plan.
_OWN = ("state", "out", "scratch", "order", "quadprog", "settings")


def plan_header(recording: Recording, title: str) -> str:
    """Return plan.h: sizes and names."""
    controller, memory = recording.controller, recording.plan.memory
    solver, robot = recording.solver, controller.robot
    tasks, contacts = task_parts(controller), contact_parts(controller)
    parts = [
        f"    {part.name} = {k}, /* {part.kind.name}: {_words(part.task.name)} */"
        for k, part in enumerate((*tasks, *contacts))
    ]
    sizes = {
        "NQ": robot.nq,
        "NV": robot.nv,
        "TORQUE": int(memory.struct.torque),
        "TASKS": len(tasks),
        "PARTS": len(tasks) + len(contacts),
        "NUMBERS": memory.number.size,
        "STATE": memory.state.size,
        "OUT": memory.size,
        "SCRATCH": memory.arrays["scratch"].size,
        "ORDER": memory.arrays["order"].size,
        "MOST_ITERATIONS": solver.max_iterations,
    }
    lines = [
        f"/* {title} */",
        "#ifndef WBC_PLAN_H",
        "#define WBC_PLAN_H",
        "",
        '#include "core/core.h"',
        "",
        *(f"#define WBC_{name} {size}" for name, size in sizes.items()),
        f"#define WBC_DT {_number(controller.dt)} /* {controller.dt:g} s */",
        f"#define WBC_EPS {_number(solver.eps)} /* {solver.eps:g} */",
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


def plan_source(recording: Recording, title: str) -> str:
    """Return plan.c: all that was planned."""
    controller, memory = recording.controller, recording.plan.memory
    names = ", ".join(f'"{name}"' for name in controller.robot.joint_names)
    tree = memory.tree
    arrays = {**memory.arrays, "number": recording.numbers}
    arrays = {name: array for name, array in arrays.items() if name not in _OWN}
    structs: dict[str, Iterable[ctypes.Structure]] = {"block": memory.blocks}
    if memory.forces is not None and memory.forces.count:
        structs["force"] = memory.forces.structs
    known = {name: name for name, array in arrays.items() if array.size}
    known |= {"tree": "&tree", **{name: name for name in structs}}
    counts = {"nv": tree.nv, "joints": tree.joints}
    return "\n".join(
        [
            f"/* {title} */",
            '#include "plan.h"',
            "",
            f"const char *const wbc_joint_names[WBC_NV - 6] = {{{names}}};",
            "",
            *(_array(f"tree_{name}", array) for name, array in tree.arrays.items()),
            "static const wbc_tree tree = {",
            *(f"    .{name} = {count}," for name, count in counts.items()),
            *(f"    .{name} = tree_{name}," for name in tree.arrays),
            "};",
            "",
            *(_array(name, array) for name, array in arrays.items() if array.size),
            *(_structs(name, every) for name, every in structs.items()),
            "const wbc_plan wbc_planned = {",
            *_fields(memory, known),
            "};",
            "",
        ]
    )


def recording_text(recording: Recording) -> str:
    """Return recording.txt, which main.c reads."""
    robot = recording.controller.robot
    torque = int(recording.plan.memory.struct.torque)
    lines = [f"wbc recording 1 {len(recording.ticks)} {robot.nq} {robot.nv} {torque}"]
    for tick in recording.ticks:
        command = (tick.velocity,) if tick.torque is None else (tick.velocity, tick.torque)
        numbers = np.concatenate((tick.q, tick.v, *tick.targets, *command)).tolist()
        lines.append(" ".join(map(float.hex, numbers)))
    return "\n".join(lines) + "\n"


def _fields(memory: NativeMemory, known: Mapping[str, str]) -> Iterable[str]:
    """Yield the fields of the plan's struct."""
    struct = memory.struct
    for name, kind, *_ in struct._fields_:
        value = getattr(struct, name)
        if kind is not ctypes.c_void_p:
            yield f"    .{name} = {_number(value)},"
        elif name in known:
            yield f"    .{name} = {known[name]},"
        elif value and name not in _OWN and memory.arrays.get(name, np.zeros(1)).size:
            raise CodegenError(f"the core reads {name!r} of this controller, which is not exported")


def _structs(name: str, array: Iterable[ctypes.Structure]) -> str:
    rows = (
        ", ".join(f".{field} = {_number(getattr(one, field))}" for field, *_ in one._fields_)
        for one in array
    )
    inside = "".join(f"    {{{row}}},\n" for row in rows)
    return f"static const wbc_{name} {name}[] = {{\n{inside}}};\n"


def _array(name: str, array: NDArray[Any]) -> str:
    kind = "int64_t" if array.dtype.kind == "i" else "double"
    values = [_number(value) for value in array.ravel().tolist()]
    lines = [
        "    " + ", ".join(values[k : k + _PER_LINE]) + ",\n"
        for k in range(0, len(values), _PER_LINE)
    ]
    return f"static const {kind} {name}[] = {{\n{''.join(lines)}}};\n"


def _number(value: float) -> str:
    """Return an integer, or a float with every bit of it."""
    if isinstance(value, int):
        return str(value)
    return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(str(value), float.hex(value))


def _words(name: str) -> str:
    """Return a name as it may stand in a comment."""
    return name.replace("*/", "* /")
