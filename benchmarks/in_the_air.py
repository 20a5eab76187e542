"""Figures of the problem files' hop and somersault.

The hop (problems/hop_g1.yaml): speed of the CoM at take-off, actual and planned; the height of the
lower sole; the time of touchdown against the plan, and the speed of the faster sole in the tick
before. The somersault (problems/somersault_hoap2.yaml): rate of the base about its axis of
rotation, and moment of inertia about it, spread and tucked.

    python benchmarks/in_the_air.py
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

from pathlib import Path

import numpy as np

from wbc.problem import Problem, load_problem
from wbc.robot import Snapshot
from wbc.simulation import SimulationResult

PROBLEMS = Path(__file__).parents[1] / "problems"
FALLS = 0.5  # m/s^2 off gravity within which a plan is in flight: a tick of the plan's own rounding


def simulated(name: str) -> tuple[Problem, SimulationResult, list[Snapshot]]:
    """Return a file's problem, its result, and the true states."""
    problem = load_problem(PROBLEMS / name)
    assert isinstance(problem, Problem)
    result = problem.simulate()
    if not result.status.good:
        raise SystemExit(f"{name}: {result.reason}")
    states = zip(result.arrays["q"], result.arrays["v"], strict=True)
    return problem, result, [problem.parts.robot.snapshot(q, v) for q, v in states]


def hop() -> str:
    """Return a line about the hop."""
    problem, result, states = simulated("hop_g1.yaml")
    arrays, robot = result.arrays, problem.parts.robot
    time, dt = arrays["time"], problem.plant().dt
    soles = [foot.frame for foot in robot.feet.values()]
    height = np.array([[state.position(sole)[2] for sole in soles] for state in states])
    fall = -np.array([[(state.jacobian(sole) @ state.v)[2] for sole in soles] for state in states])
    force = sum(np.linalg.norm(arrays[f"forces/{sole}"][:, :3], axis=1) for sole in soles)
    planned = arrays["plan_com"][:, 2]
    flight = np.abs(np.diff(planned, 2) / dt**2 + robot.gravity) < FALLS
    off, on = time[1:-1][flight][[0, -1]]
    air = np.flatnonzero((force == 0.0) & (time > 0.5 * off))  # no force is known at the start
    first, last = air[0], air[-1]
    rise = np.gradient(planned, dt).max()
    return (
        f"hop: takes off at {states[first].com_velocity[2]:.2f} m/s where {rise:.2f} are planned,"
        f" lifts the soles by {100 * (height.min(axis=1).max() - height[0].min()):.1f} cm, touches"
        f" {1e3 * (time[last] + dt - on):.0f} ms after the planned time, soles at"
        f" {fall[last].max():.2f} m/s"
    )


def somersault() -> str:
    """Return a line about the somersault."""
    _, result, states = simulated("somersault_hoap2.yaml")
    phase = result.run.history.phase
    ends = [states[np.flatnonzero(phase == name)[-1]] for name in ("spread", "tucked")]
    spread, tucked = ((end.v[4], end.inertia_in("base")[1, 1]) for end in ends)
    return (
        f"somersault: turns {tucked[0] / spread[0]:.3f} times as fast tucked; its moments of"
        f" inertia are as {spread[1] / tucked[1]:.3f}"
    )


if __name__ == "__main__":
    print(somersault(), flush=True)
    print(hop(), flush=True)
