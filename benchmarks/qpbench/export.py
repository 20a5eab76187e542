"""Sequences as a test set for ``qpbenchmark``, and its warm-started variant that it lacks.

The test set is a Parquet file of problems in the form of qpsolvers (G x <= h, A x = b, a box), and
a Python file that the command ``qpbenchmark`` takes. The warm variant is the same sequences solved
in order by a kept solver: ``proxqp`` and ``proxqp_refreshed`` of ``wbc bench``. A script does so
without this package, for your own solvers.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qpbench.sequence import QpSequence
from wbc.extras import require
from wbc.files import write_text, write_whole
from wbc.qp import QP
from wbc.qp.qpsolvers_backend import OneSided

NAME = "wbc_sequences"
TEST_SET = '''"""QPs of whole-body control, recorded by wbc bench.

Run it by: qpbenchmark --results-path results.csv {name}.py run --author YOU
"""

from pathlib import Path

from qpbenchmark import ParquetTestSet


class WbcSequences(ParquetTestSet):
    """QPs in the order in which a controller solved them."""

    def __init__(self) -> None:
        super().__init__(Path(__file__).with_suffix(".parquet"))

    @property
    def title(self) -> str:
        return "Whole-body control of humanoids"

    @property
    def description(self) -> str:
        return {description!r}

    @property
    def sparse_only(self) -> bool:
        return False
'''
WARM = '''"""Sequences in order, each QP begun at the last solution: python {name}_warm.py [SOLVER].

Needs pandas, pyarrow and qpsolvers. A solver that takes initial values (osqp, proxqp, qpoases, scs)
is warm; one that ignores them (daqp, quadprog, clarabel) is as fast as cold.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pandas
import qpsolvers

solver = sys.argv[1] if len(sys.argv) > 1 else "proxqp"
table = pandas.read_parquet(Path(__file__).with_name("{name}.parquet"))
times = {{"cold": [], "warm": []}}
last, sequence = None, None
for row in table.to_dict("records"):
    n = row["q"].size
    data = {{key: None if row[key] is None else np.array(row[key]) for key in row if key != "name"}}
    for key in ("P", "G", "A"):
        data[key] = None if data[key] is None else data[key].reshape(-1, n)
    problem = qpsolvers.Problem(**data)
    name = row["name"].rpartition(" ")[0]
    if name != sequence or last is None or last.size != n:
        sequence, last = name, None
    for kind, start in (("cold", None), ("warm", last)):
        begin = time.thread_time()
        solution = qpsolvers.solve_problem(problem, solver, initvals=start)
        times[kind].append(time.thread_time() - begin)
    last = solution.x if solution.found else None
for kind, found in times.items():
    print(f"{{solver}} {{kind}}: median {{1e6 * np.median(found):.1f}} us of {{len(found)}} QPs")
'''


def export_qpbenchmark(folder: Path, sequences: Sequence[QpSequence]) -> list[Path]:
    """Write a test set into a folder, which is made if need be, and return its files.

    Raises
    ------
    MissingPackageError
        pyarrow is not installed.
    OSError
        A file cannot be written.
    """
    require("pyarrow", "wbc bench --qpbenchmark")
    folder.mkdir(parents=True, exist_ok=True)
    rows = [
        {**problem_of(qp), "name": f"{one.name} {k}"}
        for one in sequences
        for k, qp in enumerate(one.qps)
    ]
    table = folder / f"{NAME}.parquet"
    _write(table, rows)
    names = ", ".join(one.name for one in sequences)
    description = f"{len(rows)} QPs of {len(sequences)} sequences: {names}."
    told = {"name": NAME, "description": description}
    texts = {folder / f"{NAME}.py": TEST_SET, folder / f"{NAME}_warm.py": WARM}
    for path, text in texts.items():
        write_text(path, text.format(**told))
    return [table, *texts]


def problem_of(qp: QP) -> dict[str, Any]:
    """Return a QP in the form of qpsolvers, matrices row by row; None for parts that it lacks."""
    rows = OneSided.of(qp, keep_box=True)
    parts = {
        "P": qp.P, "q": qp.g, "G": rows.G, "h": rows.h, "A": qp.A, "b": qp.b,
        "lb": qp.lower, "ub": qp.upper,
    }  # fmt: skip
    return {name: part.ravel().tolist() if part.size else None for name, part in parts.items()}


def _write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of lists of numbers, or text, as they are."""
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.Table.from_pylist(list(rows))
    write_whole(path, lambda file: parquet.write_table(table, file, compression="zstd"))
