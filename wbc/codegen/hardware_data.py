"""The data of a robot's estimator and safety layer, as C."""

from __future__ import annotations

from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from wbc.codegen.c_text import comment
from wbc.codegen.texts import array_text, fields_text, number_text, struct_texts
from wbc.estimation import StateEstimator
from wbc.hardware import sensor_checks
from wbc.hardware.loop import PERIOD, cycles_per_tick
from wbc.hardware.postures import CrouchPath, PostureMotion
from wbc.hardware.robot_controller import STIFFNESS_FADE, stance_of
from wbc.hardware.safety import MAX_MAGNITUDE, RULES, TRANSITIONS, Answer, Fault, Mode, Safety
from wbc.hardware.setup import check_start, motions_of, safety_of
from wbc.hardware.udp import COMMAND_PORT, READING_PORT
from wbc.hardware.unitree.profiles import Profile, by_pattern
from wbc.problem import Problem
from wbc.problem.problem import require_torque
from wbc.robot import Robot
from wbc.validate import Array

_LIMITS = ("lower", "upper", "velocity", "effort", "kp", "kd", "torque_rate")
_NUMBERS = ("overrun", "overspeed", "overload", "warm", "hot")


class HardwareParts(NamedTuple):
    """The exported parts of a robot on its bus."""

    robot: Robot
    estimator: StateEstimator
    safety: Safety
    profile: Profile
    path: CrouchPath
    up: PostureMotion
    start: Array

    @classmethod
    def of(cls, problem: Problem, profile: Profile) -> HardwareParts:
        """Return those that ``wbc hardware run`` would have.

        Raises InvalidInputError: a problem of the velocity level, whose period is not of whole
        cycles, or that does not begin on all feet; a robot that cannot crouch, whose effort limits
        are not known, or that no gains fit.
        """
        require_torque(problem, "a robot is commanded torques")
        check_start(problem)
        cycles_per_tick(problem.spec.controller.dt)
        robot = problem.parts.robot
        path = CrouchPath.of(problem.parts.at_start)
        return cls(
            robot,
            StateEstimator(robot, profile.mount(robot), dt=PERIOD),
            safety_of(robot, profile, PERIOD),
            profile,
            path,
            motions_of(robot, profile, path).up,
            problem.parts.start,
        )


def data_header(parts: HardwareParts, title: str) -> str:
    """Return data.h: sizes, thresholds, and names of modes and faults."""
    core, robot = parts.estimator.core, parts.robot
    filter_, observer, n = core.filter, core.observer, robot.nv - 6
    sizes: dict[str, int] = {
        "JOINTS": n,
        "CONFIGURATION": robot.nq,
        "FEET": len(robot.feet),
        "IMUS": len(parts.estimator.imus),
        "COUNTS": core.counts.size,
        "EVENT": core.event.size,
        "DETAIL": core.detail.size,
        "X": core.made["x"].size,
        "WAIT": core.made["wait"].size,
        "FRAMES": core.made["frames"].size,
        "EST_STATE": core.made["state"].size,
        "EST_SCRATCH": core.made["scratch"].size,
        **filter_.sizes,
        "MOTION": observer.made["motion"].size,
        "MOMENTUM_FRAMES": observer.made["frames"].size,
        "MOMENTUM_SCRATCH": observer.made["scratch"].size,
        "ESTIMATE": core.out,
        "AT_V": core.out - robot.nq - robot.nv,
        "AT_Q": core.out - robot.nq,
        "POSTURES": len(parts.path.joints),
        "MODES": len(Mode),
        "FAULTS": len(Fault),
        "COMMAND_PORT": COMMAND_PORT,
        "READING_PORT": READING_PORT,
    }
    numbers = {
        "CYCLE": PERIOD,
        "FADE": STIFFNESS_FADE,
        "HUGE": MAX_MAGNITUDE,
        "ONTO": parts.up.onto,
        "ALONG": parts.up.along,
        **{name: x for name, x in vars(sensor_checks).items() if isinstance(x, int | float)},
    }
    lines = [
        f"/* {comment(title)} */",
        "#ifndef WBC_DATA_H",
        "#define WBC_DATA_H",
        "",
        '#include "core.h"',
        "",
        *(f"#define WBC_{name} {size}" for name, size in sizes.items()),
        "",
        *(f"#define WBC_{name} {number_text(x)} /* {x:g} */" for name, x in numbers.items()),
        "",
        *_enumerated("mode", Mode),
        *_enumerated("fault", Fault),
        *_enumerated("answer", Answer),
        "",
        "typedef struct {",
        f"    double {', '.join(f'{name}[WBC_JOINTS]' for name in _LIMITS)};",
        f"    double {', '.join(_NUMBERS)}, least_vertical, up[3];",
        "} wbc_safety_limits;",
        "typedef struct { int answer; double patience; } wbc_rule; /* s that a fault is borne */",
        "",
        "extern const wbc_filter wbc_planned_filter;",
        "extern const wbc_momentum wbc_planned_momentum;",
        "extern const wbc_estimator wbc_planned_estimator;",
        "extern const wbc_safety_limits wbc_limits;",
        "extern const double wbc_damping[WBC_JOINTS]; /* kd of joints that brake */",
        "extern const wbc_rule wbc_rules[WBC_FAULTS];",
        "extern const unsigned wbc_transitions[WBC_MODES]; /* bits of the modes it may lead to */",
        "extern const char *const wbc_mode_names[WBC_MODES], *const wbc_fault_names[WBC_FAULTS];",
        "/* Postures from standing to a crouch, and the torques that bear the weight there. */",
        "extern const double wbc_crouch[WBC_POSTURES][WBC_JOINTS];",
        "extern const double wbc_bearing[WBC_POSTURES][WBC_JOINTS];",
        "/* Gains: of postures that are held, and while the controller commands. */",
        "extern const double wbc_stiffness[WBC_JOINTS], wbc_holding[WBC_JOINTS];",
        "extern const double wbc_following[WBC_JOINTS];",
        "/* Where the problem begins: middle of the soles [m], and their heading. */",
        "extern const double wbc_begin_stance[3], wbc_begin_heading;",
        "",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def data_source(parts: HardwareParts, title: str) -> str:
    """Return data.c."""
    core, safety, limits = parts.estimator.core, parts.safety, parts.safety.limits
    robot, tree, observer = parts.robot, parts.robot.native.tree, core.observer
    given = {**core.given, "start": np.zeros(7)}
    nothing = {"held", "x", "P", "scratch", "origin"}
    momentum = {name: f"momentum_{name}" for name in observer.given}
    estimator = {name: f"estimator_{name}" for name in given}
    gains = {name: getattr(parts.profile, name) for name in ("stiffness", "holding", "following")}
    middle, heading = stance_of(robot, parts.start)
    arrays = {name: getattr(limits, name) for name in _LIMITS}
    fields = [f"    .{name} = {_initialiser(array)},\n" for name, array in arrays.items()]
    fields += [f"    .{name} = {number_text(float(getattr(limits, name)))},\n" for name in _NUMBERS]
    fields += [f"    .least_vertical = {number_text(float(np.cos(limits.tilt)))},\n"]
    fields += [f"    .up = {_initialiser(np.array(limits.up))},\n"]
    rules = "".join(
        f"    {{{int(RULES[fault].answer)}, {number_text(RULES[fault].patience)}}},"
        f" /* {comment(fault)} */\n"
        for fault in Fault
    )
    modes = list(Mode)
    leads = [sum(1 << modes.index(to) for to in TRANSITIONS[mode]) for mode in modes]
    return "\n".join(
        [
            f"/* {comment(title)} */",
            '#include "data.h"',
            "",
            *struct_texts("tree", tree.struct, tree.arrays),
            *(array_text(f"momentum_{name}", a) for name, a in observer.given.items()),
            *(array_text(f"estimator_{name}", a) for name, a in given.items()),
            _struct_text("filter", core.filter.struct, dict.fromkeys(nothing, "0")),
            _struct_text(
                "momentum",
                observer.struct,
                dict.fromkeys(observer.made, "0") | momentum | {"tree": "&tree"},
            ),
            _struct_text(
                "estimator",
                core.struct,
                dict.fromkeys(("filter", "momentum", *core.made), "0")
                | estimator
                | {"tree": "&tree"},
            ),
            f"const wbc_safety_limits wbc_limits = {{\n{''.join(fields)}}};",
            _doubles("damping[WBC_JOINTS]", safety.damping),
            f"const wbc_rule wbc_rules[WBC_FAULTS] = {{\n{rules}}};",
            f"const unsigned wbc_transitions[WBC_MODES] = {{{', '.join(map(str, leads))}}};",
            _names("mode", Mode),
            _names("fault", Fault),
            _doubles("crouch[WBC_POSTURES][WBC_JOINTS]", parts.path.joints),
            _doubles("bearing[WBC_POSTURES][WBC_JOINTS]", parts.path.torques),
            *(_doubles(f"{name}[WBC_JOINTS]", by_pattern(robot, k)) for name, k in gains.items()),
            _doubles("begin_stance[3]", middle),
            f"const double wbc_begin_heading = {number_text(heading)};",
            "",
        ]
    )


def _struct_text(name: str, struct: Any, pointers: dict[str, str]) -> str:
    return f"const wbc_{name} wbc_planned_{name} = {fields_text(struct, pointers)};\n"


def _enumerated(kind: str, names: type[Enum]) -> list[str]:
    found = [f"    WBC_{kind.upper()}_{one.name}," for one in names]
    return [f"enum wbc_{kind} {{", *found, "};"]


def _names(kind: str, names: type[Enum]) -> str:
    inside = "".join(f'    "{one}",\n' for one in names)
    return f"const char *const wbc_{kind}_names[WBC_{kind.upper()}S] = {{\n{inside}}};"


def _doubles(declared: str, array: Array) -> str:
    return f"const double wbc_{declared} = {_initialiser(array)};"


def _initialiser(array: Array) -> str:
    if array.ndim > 1:
        return f"{{\n{''.join(f'    {_initialiser(row)},' + chr(10) for row in array)}}}"
    return f"{{{', '.join(number_text(float(value)) for value in array)}}}"
