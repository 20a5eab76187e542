"""Identical runs give identical bits: in one process, between processes, wherever memory lies."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SCRIPT = """
import hashlib, sys
from dataclasses import replace
import numpy as np
from wbc.problem import load_problem

rng, kept = np.random.default_rng(int(sys.argv[2])), []
for name, duration in (("astronaut_expand", 0.3), ("fig6b_g1", 0.15), ("safe_reach_g1", 0.1)):
    problem = load_problem(f"{sys.argv[1]}/{name}.yaml", {"stop.duration": duration})
    spec = problem.spec
    for solver in ("proxqp", "proxqp", "daqp", "daqp"):
        kept += [np.empty(2 * size + 200) for size in rng.integers(0, 99, size=7)]
        controller = spec.controller.model_copy(update={"solver": solver})
        chosen = replace(problem, spec=spec.model_copy(update={"controller": controller}))
        ticks = []
        history = chosen.run(observe=ticks.append).history
        bits = hashlib.sha256(history.q.tobytes() + history.v.tobytes())
        for tick in ticks:
            for part in (tick.qp.P, tick.qp.g, tick.solution.y, tick.solution.z_box):
                bits.update(part.tobytes())
        kept.append(ticks)
        print(name, solver, len(history), bits.hexdigest())
"""


def runs(seed: int, **environment: str) -> list[str]:
    """Return one line for each run of a fresh process, after allocations chosen by ``seed``."""
    command = [sys.executable, "-c", SCRIPT, str(PROBLEMS), str(seed)]
    surroundings = {**os.environ, **environment}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=surroundings)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_identical_runs_have_identical_bits() -> None:
    first = runs(0, PYTHONHASHSEED="1")
    second = runs(1, PYTHONHASHSEED="2", PYTHONMALLOC="malloc")
    assert len(first) == 12
    assert len({line.rpartition(" ")[0] for line in first}) == 6  # three problems, two solvers
    assert first[::2] == first[1::2]  # each problem and solver twice in a process
    assert first == second
