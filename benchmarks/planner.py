"""Every planning example from a cold start: size, iterations, CPU time, and how true the plan is.

    python benchmarks/planner.py [--factor 8]

Defect: worst difference to an integration of each interval anew. Excess: worst violation of a limit
at ``factor`` points an interval (SI; negative is room). Drift: of k_G over a flight.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse

from plan_examples import EXAMPLES

from wbc.rmp.plan import check, solve


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--factor", type=int, default=8)
    factor = parser.parse_args().factor
    print(
        f"{'example':22}{'variables':>10}{'rows':>7}{'iterations':>11}{'seconds':>9}"
        f"{'defect':>10}{'excess':>10}{'drift':>10}"
    )
    for name, build in EXAMPLES.items():
        plan = solve(build())
        verdict, stats = check(plan, factor), plan.stats
        print(
            f"{name:22}{stats.variables:10}{stats.constraints:7}{stats.iterations:11}"
            f"{stats.seconds:9.2f}{verdict.defect:10.1e}{verdict.excess:10.1e}{verdict.drift:10.1e}"
        )


if __name__ == "__main__":
    main()
