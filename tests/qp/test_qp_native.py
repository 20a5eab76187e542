"""ProxQP gives the same bits wherever the allocator puts its memory."""

import subprocess
import sys

import numpy as np

from wbc.qp import ProxQP


def test_solutions_do_not_depend_on_where_memory_lies(ticks):
    """The builds for AVX2 and AVX-512 differ in the last bits at every second place."""
    qps, rng = list(ticks(seed=3, count=30, mi=25)), np.random.default_rng(0)
    found, kept = set(), []
    for _ in range(12):
        kept += [np.empty(2 * size + 200) for size in rng.integers(0, 99, size=7)]
        solver = ProxQP()
        solutions = [solver.solve(qp) for qp in qps]
        found.add(b"".join(s.x.tobytes() + s.z_box.tobytes() for s in solutions))
        kept.append(solver)  # the next one gets other memory
    assert len(found) == 1


def build_after(statements: str) -> str:
    """Return what a fresh process says of the build in use after ``statements``."""
    ask = "from wbc.qp.native import BUILD; import qpsolvers; print(BUILD or 'narrow')"
    command = [sys.executable, "-c", statements + ask]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_the_narrow_build_is_loaded_unless_another_is_there_already():
    assert build_after("") == "narrow"
    whichever = build_after("import proxsuite; ")  # by processor; two in one process would abort
    assert whichever in ("avx512", "avx2", "narrow")
