"""The drift of a humanoid that stands for long: noise, delay and a wrong mass, in MuJoCo.

Default gains: CoM, trunk and posture tasks, feet on the ground, joint limits. Sensors have noise of
1e-3 rad and 0.05 rad/s on every joint and on the base, and are 4 ms late; the "real" masses are 10
% off, alternating. Reported: the motion of the feet and the CoM, and the relaxed ticks.

    python benchmarks/standing.py [--robots g1] [--minutes 10] [--mass 1.0 0.9] [--solver NAME]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse

import numpy as np
from disturbed import DT, NOISE

import wbc
from wbc.simulation import ModelMismatch, Plant, Sensors, simulate


def stand(name: str, minutes: float, mass: float, solver: str) -> str:
    """Return one line of the table."""
    robot = wbc.Robot.load(name)
    sensors = Sensors(**{**NOISE, "delay": 0.004}, seed=1)
    plant = Plant(robot, dt=DT, sensors=sensors, mismatch=ModelMismatch(mass=mass))
    start = robot.snapshot(robot.posture("standing"))
    tasks = [
        wbc.ComTask(robot, start.com),
        wbc.OrientationTask(robot, "base", start.rotation("base")),
        wbc.PostureTask(robot, start.q),
    ]
    controller = wbc.TorqueController(
        robot,
        tasks,
        contacts=wbc.support(start, "double"),
        limits=wbc.Limits(robot),
        dt=DT,
        solver=solver,
    )
    plant.reset(start.q)
    soles = [foot.frame for foot in robot.feet.values()]
    ticks = relaxed = 0
    begun = {}
    for one in simulate(controller, plant, 60.0 * minutes):
        ticks += 1
        relaxed += one.tick.policy is not None
        if one.time >= 1.0 and not begun:  # it has settled
            here = plant.snapshot()
            begun = {sole: here.position(sole) for sole in soles}
    here = plant.snapshot()
    creep = max(np.linalg.norm(here.position(sole) - place) for sole, place in begun.items())
    verdict = "stood" if one.verdict.stood else f"fell: {one.verdict}"
    off = np.linalg.norm(here.com - start.com)
    return (
        f"{name:11} {minutes:6.1f} min  mass x {mass:4.2f}  {verdict}, feet crept {1e3 * creep:.3f}"
        f" mm, CoM {1e3 * off:.2f} mm off, {relaxed} of {ticks} relaxed"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", nargs="+", default=["g1"])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--mass", type=float, nargs="+", default=[1.0, 0.9, 1.1])
    parser.add_argument("--solver", default="active_set")
    given = parser.parse_args()
    for robot in given.robots:
        for factor in given.mass:
            print(stand(robot, given.minutes, factor, given.solver), flush=True)
