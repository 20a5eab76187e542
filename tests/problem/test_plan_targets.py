"""Targets that follow a plan: short runs, in which the plan is met, and mistakes."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import complaint_of, problem_of
from wbc.errors import ProblemFileError
from wbc.problem import Problem, load_problem
from wbc.rmp.plan import load_plan, problem_from_data, problem_to_data
from wbc.simulation import SimulationStatus

PLAN = """\
model: rmp_solid
robot: hoap2_like
plan:
  goal: {com: {offset: [0.0, 0.01, 0.0]}, rotation: [-0.02, 0.0, 0.0]}
  schedule: {lean: {duration: 0.4, support: {soles: double, margin: 0.01}, intervals: 8}}
  limits: {friction: 0.5, torsion: 0.02, normal_force: [5.0, 200.0]}
"""
TRACK = """\
robot: {model: hoap2_like, armature: 0.001}
support: double
tasks:
  com: {type: com, target: {plan: lean.yaml, begins: 0.05}, kp: 60, weight: 30}
  spin: {type: momentum, components: angular, target: {plan: lean.yaml, begins: 0.05}, weight: 20}
  cop: {type: cop, target: {plan: lean.yaml, begins: 0.05}}
  shape: {type: inertia, target: {plan: lean.yaml, begins: 0.05}, per_mass: true, weight: 0.1}
  posture: {type: posture, weight: 0.1}
controller: {level: torque, solver: active_set}
simulation: {duration: 0.5}
"""
AWAY_AND_BACK = """\
phases:
  one: {duration: 0.1}
  two: {duration: 0.1, tasks: {com: {active: false}}}
  three: {duration: 0.1, tasks: {com: {active: true}}}
  four: {duration: 0.3}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "lean.yaml").write_text(PLAN)
    return tmp_path


def problem(folder: Path, text: str = TRACK) -> Problem:
    return problem_of(folder, text)


def test_a_plan_is_followed_and_the_result_tells_how_well(folder: Path) -> None:
    one = problem(folder)
    result = one.simulate()
    assert result.status is SimulationStatus.STOOD
    found = result.tracking
    assert found is not None and found.whole
    # Of a CoM that goes 10 mm and a body that leans: a tenth of what happens.
    assert found.com.peak == pytest.approx(0.01, rel=0.1) and found.com.worst < 1e-3
    assert found.cop.rms < 3e-3
    assert found.momentum.rms < 0.1 * found.momentum.peak
    robot, last = one.parts.robot, result.arrays["q"][-1]
    moved = robot.snapshot(last).com - robot.snapshot(one.parts.start).com
    np.testing.assert_allclose(moved, (0.0, 0.01, 0.0), atol=1e-3)
    told = json.loads(json.dumps(result.summary()))["plan"]
    assert told["com"]["worst"] == found.com.worst and told["ends"] == pytest.approx(0.45)
    made_with = result.summary()["planned"]
    assert problem_to_data(problem_from_data(made_with)) == made_with
    assert made_with["pendulum"]["mass"] == robot.mass
    assert result.arrays["plan_cop"].shape == result.arrays["cop"].shape


def test_a_plan_is_followed_at_the_velocity_level(folder: Path) -> None:
    text = TRACK.replace("kp: 60", "gain: 0.5").replace(
        "controller: {level: torque, solver: active_set}", ""
    )
    text = text.replace("simulation: {duration: 0.5}", "stop: {duration: 1.0}")
    text = "\n".join(line for line in text.splitlines() if "type: cop" not in line)
    one = problem(folder, text)
    result = one.run()
    assert one.parts.plan is not None
    time, com = result.history.time, result.history.com
    assert time[-1] >= one.parts.plan.ends - 0.01  # it does not end at rest, before the plan begins
    # Rates are given with the target: no lag. A tick's integration is off by its square.
    np.testing.assert_allclose(com, one.parts.plan.at(time).com, atol=2e-4)


@pytest.mark.slow
def test_a_file_of_a_plan_is_as_good_as_its_description(folder: Path) -> None:
    load_problem(folder / "lean.yaml").run().save(folder / "lean.npz")
    solved = problem(folder).parts.plan
    read = problem(folder, TRACK.replace("lean.yaml", "lean.npz")).parts.plan
    assert solved is not None and read is not None
    times = np.linspace(0.0, 0.5, 11)
    np.testing.assert_array_equal(solved.at(times).com, read.at(times).com)
    kept = load_plan(folder / "lean.npz")
    np.testing.assert_array_equal(solved.plan.solution, kept.solution)


def test_tasks_have_the_targets_of_the_plan(folder: Path) -> None:
    one = problem(folder)
    assert one.parts.plan is not None
    tasks = {task.name: task for task in one.parts.tasks}
    phases = one.executor()
    phases.move_to(0.15)
    wanted = one.parts.plan.at(0.15)
    np.testing.assert_array_equal(tasks["com"].target, wanted.com)
    np.testing.assert_array_equal(tasks["com"].target_rate, wanted.com_velocity)
    np.testing.assert_array_equal(tasks["com"].target_acceleration, wanted.com_acceleration)
    np.testing.assert_array_equal(tasks["spin"].target, wanted.momentum)
    np.testing.assert_array_equal(tasks["spin"].target_rate, wanted.momentum_rate)
    np.testing.assert_array_equal(tasks["cop"].target, wanted.cop)
    np.testing.assert_array_equal(tasks["shape"].target, wanted.inertia)
    np.testing.assert_array_equal(tasks["shape"].target_rate, wanted.inertia_rate)
    assert phases.ramps_end == one.parts.plan.ends


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("{plan: lean.yaml, begins: 0.05}, kp", "{plan: leen.yaml}, kp", "leen.yaml"),
        ("{plan: lean.yaml, begins: 0.05}, kp", "{plann: lean.yaml}, kp", "did you mean 'plan'"),
        ("{plan: lean.yaml, begins: 0.05}, kp", "{plan: p.yaml}, kp", "p.yaml plans nothing"),
        ("begins: 0.05}, kp", "begins: -1}, kp", "at least 0"),
        ("begins: 0.05}, kp", "begins: 0.06}, kp", "follow the same plan or motion, and 'com'"),
        ("kp: 60", "ramp: 0.2", "says itself how its target moves"),
        ("{type: cop,", "{type: cop, frame: left_sole,", "has the CoP of all contacts"),
        ("per_mass", "frame: base, per_mass", "inertia in world axes"),
        ("per_mass", "about: left_sole, per_mass", "inertia about the CoM"),
        ("per_mass", "components: principal, per_mass", "give entries of the matrix"),
        ("duration: 0.5", "duration: 0.3", "the plan ends at 0.45 s, after the run"),
        ("support: double", "support: floating", "feet on the ground"),
        ("support: double", "support: left", "outside the soles"),
        ("com, target: {plan: lean.yaml, begins: 0.05}, kp",
         "frame, frame: torso, control: position, target: {plan: lean.yaml}, kp",
         "plan: unknown key"),
        ("simulation: {duration: 0.5}", "phases: {one: {duration: 0.3}}",
         "after the run (all phases"),
        ("simulation: {duration: 0.5}", "phases: {one: {duration: 0.5, support: left}}",
         "the same feet in all phases"),
        ("simulation: {duration: 0.5}",
         "phases: {one: {duration: 0.5, tasks: {com: {target: start}}}}",
         "the task follows a plan"),
    ],
)  # fmt: skip
def test_mistakes(folder: Path, old: str, new: str, wanted: str) -> None:
    assert old in TRACK
    assert wanted in complaint_of(folder, TRACK.replace(old, new))


def test_a_phase_cannot_begin_to_follow_a_plan(folder: Path) -> None:
    at_rest = TRACK.replace("{plan: lean.yaml, begins: 0.05}", "start", 1)
    text = "\n".join(line for line in at_rest.splitlines() if "plan:" not in line)
    text = text.replace(
        "simulation: {duration: 0.5}",
        "phases: {one: {duration: 0.5, tasks: {com: {target: {plan: lean.yaml}}}}}",
    )
    assert "from the start on: give it in the section tasks" in complaint_of(folder, text)


def test_a_task_that_comes_back_has_the_target_of_the_plan(folder: Path) -> None:
    one = problem(folder, TRACK.replace("simulation: {duration: 0.5}", AWAY_AND_BACK))
    assert one.parts.plan is not None
    executor, start = one.executor(), one.parts.robot.snapshot(one.parts.start)
    com = next(task for task in one.parts.tasks if task.name == "com")
    for tick in (0, 60, 110, 160):  # one in each phase, of 2 ms
        executor.update(tick, start)
        np.testing.assert_array_equal(com.target, one.parts.plan.at(0.002 * tick).com)


def test_a_plan_for_another_robot_is_refused_with_the_numbers(folder: Path) -> None:
    other = PLAN.replace("robot: hoap2_like", "mass: 30.0").replace(
        "{soles: double, margin: 0.01}", "{at: [0, 0], size: [0.1, 0.1]}"
    )
    other = other.replace(
        "  goal: {com: {offset: [0.0, 0.01, 0.0]}, rotation: [-0.02, 0.0, 0.0]}",
        "  start: {com: [0, 0, 0.75], com_velocity: [0, 0, 0], rotation: [0, 0, 0],"
        " momentum: [0, 0, 0], radii: [0.2, 0.2, 0.2], radii_rates: [0, 0, 0]}",
    )
    (folder / "lean.yaml").write_text(other)
    told = complaint_of(folder, TRACK)
    assert told.startswith("p.yaml:4: tasks.com.target: the plan is not for hoap2_like")
    assert "its mass is 30 kg" in told and "mm from the robot's" in told


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("robot: hoap2_like", "robot: hoap2_lik", "lean.yaml:2: robot: unknown robot"),
        ("robot: hoap2_like", "robot: hoap2_like\nmass: 3", "mass: is that of the robot"),
        ("robot: hoap2_like", "robot: hoap2_like\nposture: kneeling", "unknown posture"),
        ("robot: hoap2_like", "", "'mass' is missing"),
        ("robot: hoap2_like", "mass: 3", "offset is from a robot's CoM"),
        ("soles: double", "soles: rear", "lean.yaml:5: plan.schedule.lean"),
        ("margin: 0.01", "margin: 0.5", "nothing of it is 0.5 m inside"),
        ("offset: [0.0, 0.01, 0.0]", "offset: [0.0, 0.01]", "needs at least 3 entries"),
        ("rmp_solid", "rmp_planar", "belongs to a plan of model rmp_solid"),
    ],
)  # fmt: skip
def test_mistakes_about_the_robot_of_a_plan(folder: Path, old: str, new: str, wanted: str) -> None:
    assert old in PLAN
    (folder / "lean.yaml").write_text(PLAN.replace(old, new))
    with pytest.raises(ProblemFileError) as caught:
        load_problem(folder / "lean.yaml")
    assert wanted in str(caught.value).replace(f"{folder}/", "")


def test_the_planned_robot_is_where_the_posture_has_it(folder: Path) -> None:
    found = load_problem(folder / "lean.yaml", {"plan.goal.radii": [None, None, None]})
    assert not isinstance(found, Problem)
    problem_of = found.parts.problem
    robot = problem(folder).parts.robot
    start = robot.snapshot(robot.posture("standing"))
    assert problem_of.mass == found.mass == robot.mass
    np.testing.assert_array_equal(problem_of.start.com, start.com)
    np.testing.assert_allclose(problem_of.goal.com, start.com + (0.0, 0.01, 0.0), rtol=1e-15)
    assert problem_of.goal.radii == (None, None, None)
    assert problem_of.nominal == problem_of.start
