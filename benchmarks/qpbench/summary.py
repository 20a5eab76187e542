"""Summary of measurements, and a file of it for comparison with later runs.

The least time of each QP counts, since the rest is other processes'. A solver that failed at a QP
counts as :data:`LIMIT` in aggregates.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from qpbench.measure import Measured
from qpbench.sequence import FIELDS, QpSequence
from wbc.errors import InvalidInputError
from wbc.files import system_message
from wbc.problem.provenance import version_of, versions
from wbc.validate import Array

FORMAT = "wbc bench 1"
SHIFT = 10e-6  # shift of the geometric mean [s]: differences below it count little
LIMIT = 10e-3  # time of a failure [s]
RATIOS = np.logspace(0.0, 2.0, 81)  # to the fastest, of a performance profile
SOLVERS = ("daqp", "clarabel", "osqp", "piqp", "quadprog", "scs", "highs", "ecos", "cvxopt")


def summarise(
    sequences: Sequence[QpSequence], measured: Sequence[Measured], command: str
) -> dict[str, Any]:
    """Return everything as plain data.

    Parameters
    ----------
    command:
        The command line, to be repeated.
    """
    accuracies = list(dict.fromkeys(one.eps for one in measured))
    return {
        "format": FORMAT,
        "command": command,
        "machine": machine(),
        "versions": {**versions(), **{name: version_of(name) for name in SOLVERS}},
        "repeats": len(measured[0].seconds),
        "sequences": {one.name: _of_sequence(one) for one in sequences},
        "accuracies": {
            f"{eps:g}": _of_accuracy([one for one in measured if one.eps == eps])
            for eps in accuracies
        },
    }


def load_summary(path: Path) -> dict[str, Any]:
    """Read what ``wbc bench`` wrote as JSON.

    Raises
    ------
    InvalidInputError
        Missing, or something else.
    """
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["format"] == FORMAT:
            return dict(found)
        what = f"is in the format {str(found['format'])[:60]!r}, and {FORMAT!r} is read"
    except OSError as error:
        what = f"cannot be read: {system_message(error)}"
    except (ValueError, TypeError, KeyError):
        what = "is not what wbc bench wrote as .json"
    raise InvalidInputError(f"{path}: {what}")


def machine() -> str:
    """Return the processor and the system, in words."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    except OSError:
        pass
    return f"{model}, {platform.system()} {platform.machine()}"


def shifted_geometric_mean(seconds: Array) -> float:
    """Return exp(mean log(t + s)) - s of times (k,) [s], with the shift s above.

    References
    ----------
    Mittelmann, Benchmarks for optimization software, plato.asu.edu/ftp/shgeom.html.
    """
    return float(np.exp(np.log(seconds + SHIFT).mean()) - SHIFT)


def performance_profile(times: Mapping[str, Array]) -> dict[str, list[float]]:
    """Return, by solver, the share of QPs solved within each of :data:`RATIOS` of the fastest.

    Parameters
    ----------
    times:
        (k,) [s] by solver, of the same QPs; infinite where it failed.

    References
    ----------
    Dolan & More, Benchmarking optimization software with performance profiles, 2002.
    """
    best = np.min(list(times.values()), axis=0)
    solvable = np.isfinite(best)
    return {
        name: [float(np.mean(solvable & (of <= ratio * best))) for ratio in RATIOS]
        for name, of in times.items()
    }


def _of_sequence(sequence: QpSequence) -> dict[str, Any]:
    sizes = np.array(sequence.sizes())
    digest = hashlib.sha256()
    for qp in sequence.qps:
        for field in FIELDS:
            digest.update(np.ascontiguousarray(getattr(qp, field)).tobytes())
    return {
        **sequence.about,
        "QPs": len(sequence.qps),
        "unknowns": int(np.median(sizes[:, 0])),
        "equalities": int(np.median(sizes[:, 1])),
        "inequalities": int(np.median(sizes[:, 2])),
        "digest": digest.hexdigest(),
    }


def _of_accuracy(measured: Sequence[Measured]) -> dict[str, Any]:
    """Return figures of all solvers at one accuracy."""
    names = list(dict.fromkeys(one.solver for one in measured))
    solvers: dict[str, Any] = {}
    counted: dict[str, Array] = {}
    for name in names:
        mine = [one for one in measured if one.solver == name]
        solvers[name] = {
            "all": _figures(mine),
            "sequences": {one.sequence: {**_figures([one]), **_passes(one)} for one in mine},
        }
        counted[name] = np.concatenate(
            [np.where(one.success, one.seconds.min(axis=0), np.inf) for one in mine]
        )
    return {"solvers": solvers, "profile": performance_profile(counted)}


def _figures(measured: Sequence[Measured]) -> dict[str, Any]:
    """Return the figures of a solver on some sequences; times in seconds."""
    seconds = np.concatenate([one.seconds.min(axis=0) for one in measured])
    success = np.concatenate([one.success for one in measured])
    residuals = np.concatenate([one.residuals for one in measured])
    p50, p99, p999 = np.percentile(seconds, (50, 99, 99.9))
    return {
        "QPs": int(seconds.size),
        "success": float(success.mean()),
        "median": float(p50),
        "p99": float(p99),
        "p99.9": float(p999),
        "shifted_geometric_mean": shifted_geometric_mean(np.where(success, seconds, LIMIT)),
        "iterations": float(np.median(np.concatenate([one.iterations for one in measured]))),
        "worst_kkt": float(residuals.max()),
    }


def _passes(one: Measured) -> dict[str, Any]:
    """Return the median of each pass, and what the fixed computation took around it [s]."""
    medians = np.median(one.seconds, axis=1)
    return {"passes": medians.tolist(), "reference": one.reference.tolist()}
