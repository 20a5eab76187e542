"""What a run came to, as one row of plain values."""

from __future__ import annotations

import math
import os
import socket
import threading
from collections.abc import Mapping
from time import perf_counter
from typing import Any

from wbc.errors import WbcError
from wbc.problem import Problem, Result
from wbc.problem.campaign import Run
from wbc.problem.controller_spec import TorqueSpec
from wbc.problem.problem import load_unchanged
from wbc.problem.provenance import version_of, versions
from wbc.simulation import SimulationResult

ERROR, DIED = "error", "worker_died"  # statuses of runs that have no result
Row = dict[str, Any]
_one_at_a_time = threading.Lock()  # a cluster may give a process several threads


def made_with() -> dict[str, str]:
    """Return the versions that rows depend on."""
    return {**versions(), "mujoco": version_of("mujoco")}


def run_row(run: Run, text: str) -> Row:
    """Run a problem and return its row; an error is a row, too: the campaign goes on.

    Parameters
    ----------
    text:
        Of the problem's file, which must not have changed.
    """
    with _one_at_a_time:
        start = perf_counter()
        loaded = start
        try:
            problem = load_unchanged(run.path, run.overrides, text)
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
