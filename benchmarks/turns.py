"""Turns without momentum: planned, by commanded velocities, and by torques in MuJoCo.

Runs problems/turn_*.yaml: the base's rotation, the largest commanded momentum of a tick and the
least distance between bodies. Then by torques, without gravity, at several steps of the physics,
which conserves momentum to the order of its step: the rotation, and the momentum gained; and with
one more cycle, planned for the measured remainder. With --write the turns are planned anew and the
files written.

    python benchmarks/turns.py [--axes x y z] [--write] [--torques] [--corrected]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
from pathlib import Path
from time import perf_counter

import numpy as np

import wbc
from wbc.flight.planner import plan_turn
from wbc.problem import Problem, load_problem
from wbc.rotations import exp_rotation, log_rotation, rotation_from

PROBLEMS = Path(__file__).parents[1] / "problems"
ROBOT, MARGIN = "hoap2_like", 0.003
PERIOD, SETTLES = 3.0, 0.2  # s, of a cycle, and after it
CYCLES = {"x": 6, "y": 4, "z": 4}
WORDS = {"x": "to its right side", "y": "forwards", "z": "to its left"}
TEXT = """\
# An astronaut turns by 90 degrees {words} with nothing to push against: its joints follow a closed
# path, and each cycle leaves a net rotation. Its momentum is zero all the time.
# Planned by wbc.flight.planner.plan_turn; benchmarks/turns.py --write plans it anew.
robot: {robot}
support: floating

tasks:
  still: {{type: momentum, priority: 0}}
  path:
    type: posture
    priority: 1
    target:
      cycles: {cycles}
      period: {period:g}
      loop:  # coefficients by joint, of cos(p) - 1, cos(2 p) - 1, sin(p), sin(2 p)
{loop}
constraints:
  self collision: {{type: self_collision, margin: 0.002}}

controller: {{dt: 0.005, solver: active_set}}
stop: {{duration: {duration:g}, speed: null, accept: {{path: 1.0e-3, still: 1.0e-9}}}}
"""


def write(axis: str) -> None:
    """Plan a turn and write its problem file."""
    robot = wbc.Robot.load(ROBOT)
    began = perf_counter()
    rounds = plan_turn(
        robot,
        0.5 * np.pi * np.eye(3)["xyz".index(axis)],
        cycles=CYCLES[axis],
        collision=wbc.SelfCollision(robot, margin=MARGIN),
    )
    print(f"{axis}: planned in {perf_counter() - began:.0f} s", flush=True)
    target = rounds.target()
    loop = "\n".join(f"        {name}: {values}" for name, values in target["loop"].items())
    text = TEXT.format(
        words=WORDS[axis],
        robot=ROBOT,
        loop=loop,
        cycles=rounds.cycles,
        period=rounds.period,
        duration=rounds.duration + 0.2,
    )
    (PROBLEMS / f"turn_{axis}_hoap2.yaml").write_text(text)


def turned(q: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the base's rotation vector from one configuration to another, in degrees."""
    between = rotation_from(start[3:7]).T @ rotation_from(q[3:7])
    return np.rad2deg(log_rotation(between))


def by_velocities(axis: str) -> str:
    """Return a line about the commanded velocities."""
    problem = load_problem(PROBLEMS / f"turn_{axis}_hoap2.yaml")
    assert isinstance(problem, Problem)
    result = problem.run()
    robot, history = problem.parts.robot, result.history
    pairs = zip(history.q, history.v, strict=True)
    momentum = max(np.abs(robot.snapshot(q, v).momentum).max() for q, v in pairs)
    least = min(one.value for one in result.clearance.values())
    angles = np.round(turned(result.q, problem.parts.start), 3)
    return (
        f"{result.status.value}, turned by {angles} degrees, momentum at most {momentum:.1e} (SI),"
        f" {1e3 * least:.2f} mm beyond the margin at least"
    )


def torque_problem(axis: str, physics_dt: float) -> Problem:
    """Return a turn by torques in MuJoCo, without gravity."""
    dt = max(0.002, physics_dt)
    problem = load_problem(
        PROBLEMS / f"turn_{axis}_hoap2.yaml",
        {
            "robot": {"model": ROBOT, "armature": 0.003},
            "controller": {"level": "torque", "dt": dt, "solver": "active_set"},
            "simulation": {
                "start": {"height": 1.0},
                "gravity": 0,
                "physics_dt": physics_dt,
                "falls": {"tilt": 100, "com_height": 0},
                "duration": CYCLES[axis] * 3.0 + 0.2,
            },
            "stop": {},
        },
    )
    assert isinstance(problem, Problem)
    return problem


def by_torques(axis: str, physics_dt: float) -> str:
    """Return a line about torques in MuJoCo, without gravity."""
    problem = torque_problem(axis, physics_dt)
    result = problem.simulate()
    robot, arrays = problem.parts.robot, result.arrays
    pairs = zip(arrays["q"], arrays["v"], strict=True)
    spin = max(np.abs(robot.snapshot(q, v).momentum[3:]).max() for q, v in pairs)
    angles = np.round(turned(arrays["q"][-1], problem.parts.start), 3)
    return (
        f"{result.status.value}, turned by {angles} degrees, angular momentum at most {spin:.1e},"
        f" {100 * result.relaxed:.2f} % of ticks relaxed"
    )


def corrected(axis: str, physics_dt: float) -> str:
    """Return a line about a turn by torques with one more cycle for the remainder."""
    problem = torque_problem(axis, physics_dt)
    robot, start = problem.parts.robot, problem.parts.start
    plant = problem.plant()
    supervisor = problem.supervisor(plant)
    for tick in range(round(problem.spec.whole_stop.duration / plant.dt)):
        snapshot = plant.snapshot()
        controller = supervisor.update(tick, snapshot)
        assert controller is not None
        plant.step(controller.step(snapshot).torque)
    goal = rotation_from(start[3:7]) @ exp_rotation(0.5 * np.pi * np.eye(3)["xyz".index(axis)])
    now, before = plant.snapshot(), plant.snapshot().q
    # Momentum gained by the physics keeps rotating the base meanwhile, to first order as now.
    missing = log_rotation(rotation_from(before[3:7]).T @ goal) - (PERIOD + SETTLES) * now.v[3:6]
    rounds = plan_turn(
        robot,
        missing,
        q=start,
        cycles=1,
        period=PERIOD,
        collision=wbc.SelfCollision(robot, margin=MARGIN),
    )
    path = next(task for task in problem.parts.tasks if task.name == "path")
    for tick in range(round((rounds.duration + SETTLES) / plant.dt)):
        path.set_target(*rounds.at(tick * plant.dt))
        plant.step(supervisor.controller.step(plant.snapshot()).torque)
    first, second = (np.round(turned(q, start), 3) for q in (before, plant.snapshot().q))
    return f"turned by {first} degrees, with one more round by {second}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--axes", nargs="+", choices="xyz", default=list("xyz"))
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--torques", action="store_true")
    parser.add_argument("--corrected", action="store_true")
    given = parser.parse_args()
    for axis in given.axes:
        if given.write:
            write(axis)
        print(f"{axis}: velocities: {by_velocities(axis)}", flush=True)
        for step in (1e-3, 2.5e-4) if given.torques else ():
            print(f"{axis}: torques, steps of {step:g} s: {by_torques(axis, step)}", flush=True)
        if given.corrected:
            print(f"{axis}: torques, corrected: {corrected(axis, 1e-3)}", flush=True)
