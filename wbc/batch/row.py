"""What a run came to, as one row of plain values; and rows in a Parquet file."""

from __future__ import annotations

import json
import math
import os
import socket
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from wbc.errors import InvalidInputError, WbcError
from wbc.files import write_whole
from wbc.problem import Problem, Result
from wbc.problem.campaign import Run
from wbc.problem.controller_spec import TorqueSpec
from wbc.problem.problem import load_same_text
from wbc.problem.provenance import versions
from wbc.simulation import SimulationResult

ERROR, DIED = "error", "worker_died"  # statuses of runs that have no result
ENDING = ".parquet"
_MADE_OF = b"wbc"  # under this key of the schema's metadata
Row = dict[str, Any]
_one_at_a_time = threading.Lock()  # a cluster may give a process several threads


def made_with() -> dict[str, str]:
    """Return the versions that rows depend on."""
    return versions("mujoco")


def run_row(run: Run, text: str) -> Row:
    """Run a problem and return its row; an error is a row, too: the campaign goes on.

    ``text``: of the problem's file, which must not have changed.
    """
    with _one_at_a_time:
        start = perf_counter()
        loaded = start
        try:
            problem = load_same_text(run.path, run.overrides, text)
            loaded = perf_counter()
            if isinstance(problem, Problem) and isinstance(problem.spec.controller, TorqueSpec):
                outcome = _of_simulation(problem.simulate())
            else:
                result = problem.run()
                outcome = (
                    _of_run(result)
                    if isinstance(result, Result)
                    else {**_ending(result), **result.measures}
                )
        except WbcError as error:
            outcome = no_result(ERROR, str(error))
        except Exception as error:  # a mistake of ours in one run must not cost the others
            outcome = no_result(ERROR, f"{type(error).__name__}: {error}")
        where = f"{socket.gethostname()}:{os.getpid()}"
        took = {
            "load_seconds": loaded - start,
            "wall_seconds": perf_counter() - start,
            "worker": where,
        }
        return plain_row({**heading(run), **outcome, **took})


def heading(run: Run) -> Row:
    """Return what tells a run from others: the first columns."""
    named = {"run": run.number, "problem": run.problem, "case": run.case, "seed": run.seed}
    return {**named, **run.overrides}


def no_result(status: str, reason: str) -> Row:
    """Return the ending of a run that came to nothing."""
    return {"status": status, "solved": False, "reason": reason}


def plain_row(row: Mapping[str, Any]) -> Row:
    """Return a row that JSON and tables take: what is not finite is None."""
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in row.items()
    }


def _ending(result: Any) -> Row:
    return {"status": result.status.value, "solved": result.status.good, "reason": result.reason}


def _of_run(result: Result) -> Row:
    """Return the measures of a run, in SI units."""
    times = result.tick_times()["cpu"]
    row = {
        **_ending(result),
        "reach": result.reach or None,
        "ticks": len(result.history),
        "time": len(result.history) * result.dt,
        "failed_ticks": len(result.failures),
        **{f"error.{name}": task.norm for name, task in result.tasks.items()},
        **{f"clearance.{name}": worst.value for name, worst in result.clearance.items()},
        "joint_margin": result.margin.value,
        "slip": result.slip.value if result.slip else None,
        "balance": result.balance.value if result.balance else None,
        "worst_kkt": result.worst_kkt,
        "tick_median": times["median"],
        "tick_p99": times["p99"],
    }
    if result.shaping is not None:
        shaping = result.shaping
        row |= {"cost": shaping.cost_end, "best_cost": shaping.best.cost}
    return row


def _of_simulation(result: SimulationResult) -> Row:
    return {
        **_of_run(result.run),
        **_ending(result),
        "time": result.duration,
        "stood": result.verdict.stood,
        "peak_tilt": result.peak_tilt,
        "least_cop_margin": result.least_cop_margin,
        "relaxed": result.relaxed,
        "lost_frames": result.lost,
    }


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], made_of: Mapping[str, Any]) -> None:
    """Write rows as a table, whole or not at all.

    Columns are those of all rows in order of appearance; what a row lacks is null. A column of
    booleans, integers or numbers is that, of text is text, and of anything else, integers of more
    than 64 bits too, is JSON text.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: _column([row.get(name) for row in rows]) for name in names}
    table = pyarrow.table(columns).replace_schema_metadata({_MADE_OF: json.dumps(made_of).encode()})
    write_whole(path, lambda file: parquet.write_table(table, file))


def read_rows(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the rows of a file, and what they were made of.

    Raises
    ------
    InvalidInputError
        Not a file of ours.
    OSError
        It cannot be read.
    """
    import pyarrow
    from pyarrow import parquet

    try:
        table = parquet.read_table(path)
        made_of = json.loads((table.schema.metadata or {})[_MADE_OF])
    except (pyarrow.ArrowException, KeyError, ValueError) as error:
        raise InvalidInputError(f"{path}: is not a table that wbc batch wrote ({error})") from error
    return table.to_pylist(), made_of


def _column(values: Sequence[Any]) -> Any:
    import pyarrow

    kinds = {type(value) for value in values if value is not None}
    if kinds == {int, float}:
        kinds, values = {float}, [None if one is None else float(one) for one in values]
    types = {
        bool: pyarrow.bool_(), int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()
    }  # fmt: skip
    fits = kinds != {int} or all(one is None or -(2**63) <= one < 2**63 for one in values)
    if len(kinds) == 1 and (kind := next(iter(kinds))) in types and fits:
        return pyarrow.array(values, types[kind])
    if not kinds:
        return pyarrow.nulls(len(values), pyarrow.string())
    return pyarrow.array([None if one is None else json.dumps(one) for one in values])
