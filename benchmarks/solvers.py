"""QP solvers on the QP sequences of the problems, in order, so that warm starts count.

Every problem is run once with the default solver and its QPs are recorded. Each backend then solves
the same sequences to the same accuracy. No solver's word is taken: an answer is a success only if
its KKT residuals, recomputed here from the QP, are below the accuracy (relative to the terms they
are made of), and its status says solved. Times are thread CPU time of one call from Python, with
the conversion that the solver needs and the check of its answer.

    python benchmarks/solvers.py [--ticks 300] [--eps 1e-6] [--problems problems/*.yaml]
        [--solvers proxqp proxqp_cold daqp ...] [--output benchmarks/results/solvers.json]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
import contextlib
import json
import platform
import sys
from dataclasses import dataclass, field
from pathlib import Path
from time import thread_time

import numpy as np

from wbc.controllers import Tick
from wbc.problem import load_problem
from wbc.qp.backend import installed_solvers, make_backend
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.problem import QP

PROBLEMS = Path(__file__).parents[1] / "problems"


@dataclass
class Record:
    """What one backend did on one or more sequences."""

    times: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    residuals: list[float] = field(default_factory=list)
    successes: int = 0

    def row(self) -> dict[str, float]:
        """Return the columns of the table."""
        return {
            "QPs": len(self.times),
            "success %": 100.0 * self.successes / len(self.times),
            "median us": float(np.median(self.times)) * 1e6,
            "p99 us": float(np.percentile(self.times, 99)) * 1e6,
            "iterations": float(np.median(self.iterations)),
            "worst KKT": max(self.residuals),
        }


def record_sequence(path: Path, ticks: int) -> list[QP]:
    """Run a problem with the default solver and return its first QPs, in order."""
    sequence: list[QP] = []

    class Enough(Exception):
        pass

    def keep(tick: Tick) -> None:
        sequence.append(tick.qp)
        if len(sequence) == ticks:
            raise Enough

    with contextlib.suppress(Enough):
        load_problem(path).run(observe=keep)
    return sequence


def solve_sequence(name: str, eps: float, sequence: list[QP], record: Record) -> None:
    """Solve a sequence with a fresh backend and add what happened to ``record``."""
    backend = make_backend(name, eps=eps)
    for qp in sequence:
        start = thread_time()
        s = backend.solve(qp, workspace="benchmark")
        record.times.append(thread_time() - start)
        record.iterations.append(s.iterations)
        r = kkt_residuals(qp, s.x, s.y, s.z, s.z_box)
        worst = max(r.primal, r.dual, r.complementarity)
        record.residuals.append(worst if np.isfinite(worst) else np.inf)
        record.successes += s.solved and acceptable(r, eps, qp, s.x, s.y, s.z, s.z_box)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", type=Path, default=sorted(PROBLEMS.glob("*.yaml")))
    parser.add_argument("--solvers", nargs="+", default=list(installed_solvers()))
    parser.add_argument("--ticks", type=int, default=300, help="QPs kept from each problem")
    parser.add_argument("--eps", type=float, default=1e-6, help="accuracy asked of every solver")
    parser.add_argument("--output", type=Path, help="save the table as JSON")
    options = parser.parse_args()
    sequences = {}
    for path in options.problems:
        sequences[path.stem] = record_sequence(path, options.ticks)
        print(f"recorded {len(sequences[path.stem]):5d} QPs of {path.name}", file=sys.stderr)
    records = {name: Record() for name in options.solvers}
    by_problem: dict[str, dict[str, dict[str, float]]] = {}
    for (
        stem,
        sequence,
    ) in sequences.items():  # solvers in turn on each: the machine's drift hits all
        by_problem[stem] = {}
        for name in options.solvers:
            record = Record()
            solve_sequence(name, options.eps, sequence, record)
            by_problem[stem][name] = record.row()
            total = records[name]
            total.times += record.times
            total.iterations += record.iterations
            total.residuals += record.residuals
            total.successes += record.successes
    table = {name: record.row() for name, record in records.items()}
    ranked = sorted(table, key=lambda name: table[name]["median us"])
    columns = list(next(iter(table.values())))
    print(f"{len(sequences)} problems, eps {options.eps:g}, {platform.machine()}, one thread")
    print(f"{'solver':14s}" + "".join(f"{name:>12s}" for name in columns))
    for name in ranked:
        print(f"{name:14s}" + "".join(f"{table[name][column]:12.4g}" for column in columns))
    if options.output:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        options.output.write_text(
            json.dumps({"eps": options.eps, "all": table, "by problem": by_problem}, indent=2)
        )


if __name__ == "__main__":
    main()
