"""What Python shows of public objects fits a line."""

from pathlib import Path

import numpy as np
import pytest

import wbc
from wbc.problem import load_problem

PROBLEMS = Path(__file__).parents[1] / "problems"


def objects() -> dict[str, object]:
    robot = wbc.Robot.load("hoap2_like")
    start = robot.snapshot(robot.posture("standing"))
    limits = wbc.Limits(robot)
    tasks = [
        wbc.InertiaTask(robot, start.inertia, components=["zz"]),
        wbc.ComTask(robot, start.com),
        wbc.PostureTask(robot, start.q),
    ]
    contacts = wbc.support(start, "double")
    kinematic = wbc.KinematicController(robot, tasks, contacts=contacts, limits=limits)
    tick = kinematic.step(start)
    hands = [
        wbc.PositionTask(robot, f"{side}_palm", start.position(f"{side}_palm"), name=name)
        for side, name in (("left", "left"), ("right", "right"))
    ]
    fuller = wbc.KinematicController(robot, [*tasks[1:], *hands], contacts=contacts)
    problem = load_problem(PROBLEMS / "astronaut_expand.yaml", {"stop.duration": 0.02})
    result = problem.run()
    pendulum = load_problem(PROBLEMS / "rmp_spin.yaml")
    times = np.arange(40) * 0.01
    motion = wbc.Motion(robot, times, np.tile(start.q[7:], (40, 1)), np.tile(start.q[:7], (40, 1)))
    return {
        "robot": robot,
        "snapshot": start,
        "limits": limits,
        "limits of the model": robot.limits,
        "foot": robot.feet["left"],
        "task": tasks[0],
        "contact": contacts[0],
        "controller": kinematic,
        "tick": tick,
        "fuller tick": fuller.step(start),
        "qp": tick.qp,
        "solution": tick.solution,
        "state": wbc.reduce(start),
        "flight": wbc.reduce(start, np.array([0.0, 0.0, -20.0, *np.zeros(robot.nv - 3)])),
        "obstacle": wbc.Obstacle.sphere("ball", (0, 0, 0), 0.1),
        "support": wbc.ComSupport.over(start, ["left", "right"]),
        "stance": wbc.stance_torques(start, contacts),
        "box": wbc.PositionBox.height(robot, 0.1),
        "problem": problem,
        "result": result,
        "history": result.history,
        "pendulum": pendulum,
        "pendulum's result": pendulum.run(),
        "motion": motion,
        "series": wbc.analyze(motion),
    }


@pytest.fixture(scope="module")
def shown() -> dict[str, str]:
    return {name: repr(one) for name, one in objects().items()}


def test_it_fits_a_line(shown: dict[str, str]) -> None:
    for name, text in shown.items():
        assert len(text) <= 110 and "\n" not in text, f"{name}: {text}"
        assert " object at 0x" not in text, f"{name}: {text}"


def test_it_says_what_matters(shown: dict[str, str]) -> None:
    assert shown["robot"].startswith("Robot('hoap2_like'")
    assert shown["tick"] == "Tick(solved, nv=31, errors: inertia, com, posture)"
    assert shown["fuller tick"] == "Tick(solved, nv=31, errors: com, posture, left and 1 more)"
    controller = "KinematicController('hoap2_like', 3 tasks, 2 contacts, 0 constraints, dt=0.005)"
    assert shown["controller"] == controller
    assert shown["limits of the model"] == "JointLimits(25 joints, 0 missing)"
    assert shown["history"] == "History(4 ticks, 0 to 0.015 s)"
    assert shown["result"] == "Result(timeout, 'hoap2_like', 4 ticks, 1 tasks)"
    assert "in the air" in shown["flight"]


def test_tab_offers_public_names_only() -> None:
    assert [name for name in dir(wbc) if name.startswith("_") and name != "__version__"] == []
