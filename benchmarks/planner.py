"""Every planning example from a cold start: size, iterations, CPU time, and accuracy.

    python benchmarks/planner.py [--factor 8]

Defect: worst difference to an integration of each interval anew. Excess: worst violation of a limit
at ``factor`` points an interval (SI; negative: slack). Drift: of k_G over a flight. The examples
are files of problems/, two of them with more of a turn.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import math
from pathlib import Path
from typing import Any

from wbc.problem import load_problem
from wbc.problem.pendulum.plan import Planning
from wbc.problem.pendulum.problem import PendulumProblem
from wbc.rmp.plan import PlanProblem, check, solve

PROBLEMS = Path(__file__).parents[1] / "problems"
ENDS = "plan.schedule.wind up.end.rotation", "plan.schedule.flight.end.rotation"
ANY_PITCH = [0.0, None, 0.0]
EXAMPLES: dict[str, tuple[str, dict[str, Any]]] = {
    "push": ("push", {}),
    "push and step": ("push_step", {}),
    "squat": ("squat", {}),
    "lean": ("lean", {}),
    "hop": ("hop", {}),
    "hop with half turn": ("hop_turn", {}),
    "hop with whole turn": (
        "hop_turn",
        {end: [0.0, 0.0, sign * math.pi] for end, sign in zip(ENDS, (-1, 1), strict=True)},
    ),
    "hop with somersault": (
        "hop_turn",
        {f"plan.{state}.rotation": ANY_PITCH for state in ("start", "goal", "nominal")}
        | {end: [0.0, sign * math.pi, 0.0] for end, sign in zip(ENDS, (-1, 1), strict=True)},
    ),
    "walk": ("walk", {}),
}


def example(name: str) -> PlanProblem:
    """Return an example."""
    file, overrides = EXAMPLES[name]
    problem = load_problem(PROBLEMS / f"plan_{file}.yaml", overrides)
    assert isinstance(problem, PendulumProblem) and isinstance(problem.parts, Planning)
    return problem.parts.problem


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--factor", type=int, default=8)
    factor = parser.parse_args().factor
    print(
        f"{'example':22}{'variables':>10}{'rows':>7}{'iterations':>11}{'seconds':>9}"
        f"{'defect':>10}{'excess':>10}{'drift':>10}"
    )
    for name in EXAMPLES:
        plan = solve(example(name))
        verdict, stats = check(plan, factor), plan.stats
        print(
            f"{name:22}{stats.variables:10}{stats.constraints:7}{stats.iterations:11}"
            f"{stats.seconds:9.2f}{verdict.defect:10.1e}{verdict.excess:10.1e}{verdict.drift:10.1e}"
        )


if __name__ == "__main__":
    main()
