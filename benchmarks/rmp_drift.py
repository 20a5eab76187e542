"""Drift of energy and angular momentum of the pendulum's steps, on one tumbling motion.

The motion is that of wbc.rmp.drift.compare_steps: a solid reaction mass pendulum left to itself,
passing close to the singular orientation of Euler angles. Numbers are the largest departures over
all steps, as fractions of the start. Nothing is written.

    python benchmarks/rmp_drift.py [--steps 100000] [--dt 0.005]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from time import process_time

from wbc.rmp.drift import compare_steps


def main() -> None:
    """Run the comparison and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--dt", type=float, default=5e-3, help="length of a step [s]")
    options = parser.parse_args()
    start = process_time()
    found = compare_steps(options.steps, options.dt)
    print(f"{options.steps} steps of {options.dt:g} s, {process_time() - start:.1f} s of CPU time")
    print(f"{'step':<20} {'energy':>9} {'spin':>9} {'yaw':>9}")
    for name, drift in found.items():
        print(f"{name:<20} {drift.energy:>9.1e} {drift.spin:>9.1e} {drift.yaw:>9.1e}")


if __name__ == "__main__":
    main()
