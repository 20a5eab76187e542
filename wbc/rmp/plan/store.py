"""Problems as plain data, and plans in NPZ files with a format version, written atomically."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, UnknownNameError, WbcError
from wbc.files import finite, read_arrays, write_arrays
from wbc.rmp.plan.layout import lay_out
from wbc.rmp.plan.plan import Plan, Stats
from wbc.rmp.plan.problem import Pendulum, PlanProblem, Weights
from wbc.rmp.plan.schedule import PathLimits, PlanPhase, State
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

FORMAT = "wbc-plan"
LARGEST = 1 << 26  # largest unpacked size that is read [bytes]; a long plan has a few 10^5
VERSION = 1
_PENDULUMS: dict[str, type[Pendulum]] = {"solid": SolidRmp, "planar": PlanarRmp}
_Made = TypeVar("_Made")
_ARRAYS = ("solution", "duals_variables", "duals_rows")


def problem_to_data(problem: PlanProblem) -> dict[str, Any]:
    """Return a problem as plain data, for JSON or YAML; an infinite limit is null."""
    data = {each.name: getattr(problem, each.name) for each in fields(problem)}
    kind = "planar" if problem.plane else "solid"
    data["pendulum"] = {"kind": kind, "mass": problem.mass, "gravity": problem.gravity}
    data["schedule"] = [asdict(phase) for phase in problem.schedule]
    for name in ("start", "goal", "nominal", "limits", "weights"):
        data[name] = asdict(data[name])
    return dict(finite(data))


def problem_from_data(data: Mapping[str, Any]) -> PlanProblem:
    """Return the problem from plain data; keys that are left out take their defaults.

    Raises
    ------
    InvalidInputError
        Not such data, or a problem that contradicts itself.
    UnknownNameError
        A key that does not exist.
    """
    return _decoded("plan", PlanProblem, data)


def save_plan(plan: Plan, path: str | Path) -> Path:
    """Write a plan, and return the path.

    The file is complete in itself: problem, solution, multipliers, and for other readers the motion
    at the knots as arrays ``knots_time``, ``knots_com`` and so on.

    Raises
    ------
    InvalidInputError
        The path does not end in ``.npz``, or its folder does not exist.
    """
    path = Path(path)
    if path.suffix != ".npz" or not path.parent.is_dir():
        raise InvalidInputError(f"{path}: a plan is written as .npz, into a folder that exists")
    write_arrays(path, plan_arrays(plan))
    return path


def plan_arrays(plan: Plan) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a plan's file by name; further entries in the file are ignored."""
    meta = {
        "format": FORMAT,
        "version": VERSION,
        "problem": problem_to_data(plan.problem),
        "stats": finite(asdict(plan.stats)),
        "phases": list(plan.phases),
        "starts": plan.starts.tolist(),
    }
    return {
        "meta": np.array(json.dumps(meta, allow_nan=False)),
        **dict(zip(_ARRAYS, (plan.solution, *plan.duals), strict=True)),
        **{f"knots_{f.name}": getattr(plan.knots, f.name) for f in fields(plan.knots)},
    }


def load_plan(path: str | Path) -> Plan:
    """Return a plan from its file.

    Raises
    ------
    InvalidInputError
        The file does not exist, is no plan, of a later format, or damaged.
    """
    kinds = {"meta": "U"} | dict.fromkeys(_ARRAYS, "iuf")
    found = read_arrays(path, lambda _: tuple(kinds), lambda name: kinds[name], LARGEST)
    try:
        meta = json.loads(str(found["meta"]))
        arrays = [np.array(found[name], dtype=float) for name in _ARRAYS]
    except (KeyError, ValueError, RecursionError) as error:
        raise InvalidInputError(f"{path}: cannot be read as a plan: {error}") from error
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise InvalidInputError(f"{path}: is not a plan")
    if meta.get("version") != VERSION:
        raise InvalidInputError(
            f"{path}: is of format version {meta.get('version')!r}; this package reads {VERSION}"
        )
    try:
        problem = problem_from_data(meta.get("problem", {}))
        stats = _decoded("stats", Stats, meta.get("stats"))
    except (WbcError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InvalidInputError(f"{path}: is damaged: {error}") from error
    solution, at_variables, at_rows = arrays
    if {solution.shape, at_variables.shape} != {(lay_out(problem).count,)}:
        raise InvalidInputError(f"{path}: its solution is not one of its problem")
    if not np.isfinite(solution).all():
        raise InvalidInputError(f"{path}: its solution holds NaN or infinity")
    return Plan(problem, solution, (at_variables, at_rows), stats)


def _decoded(what: str, cls: type[_Made], data: Any) -> _Made:
    """Return an object of a dataclass from its fields as plain data."""
    given = _mapping(what, data)
    own = {each.name: each for each in fields(cls) if each.init}  # type: ignore[arg-type]
    for name in given:
        if name not in own:
            raise UnknownNameError(f"key of {what}", str(name), own)
    for name, each in own.items():
        if name not in given and each.default is each.default_factory is MISSING:
            raise InvalidInputError(f"{what}: {name} is missing")
    decoded = {name: _DECODERS[name](x) if name in _DECODERS else x for name, x in given.items()}
    return cls(**decoded)


def _pendulum(data: Any) -> Pendulum:
    body = dict(_mapping("pendulum", data))
    kind = body.pop("kind", "solid")
    if kind not in _PENDULUMS:
        raise UnknownNameError("pendulum kind", str(kind), _PENDULUMS)
    return _decoded("pendulum", _PENDULUMS[kind], body)


def _schedule(data: Any) -> tuple[PlanPhase, ...]:
    if not isinstance(data, list | tuple):
        raise InvalidInputError("schedule: expected a list of phases")
    phases = [{"name": "", **_mapping("phase", each)} for each in data]
    for phase in phases:
        if phase.get("limits") is None:
            phase.pop("limits", None)
    return tuple(_decoded(f"phase {phase['name']!r}", PlanPhase, phase) for phase in phases)


def _limits(data: Any) -> PathLimits:
    def number(value: Any) -> Any:
        return math.inf if value is None else value

    given = {
        name: tuple(map(number, value)) if isinstance(value, list | tuple) else number(value)
        for name, value in _mapping("limits", data).items()
    }
    return _decoded("limits", PathLimits, given)


# Decoders from plain data to a field's value, by the field's name, where they differ.
_DECODERS: dict[str, Callable[[Any], Any]] = {
    **{name: partial(_decoded, name, State) for name in ("start", "goal", "nominal", "end")},
    "weights": partial(_decoded, "weights", Weights),
    "limits": _limits,
    "pendulum": _pendulum,
    "schedule": _schedule,
}


def _mapping(what: str, data: Any) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise InvalidInputError(f"{what}: expected keys and values, got {data!r}")
    return data
