"""Walks in problem files: what is made of them, mistakes with their places, and a short one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problem.loading import complaint_of, problem_of
from wbc.errors import InvalidInputError
from wbc.gait import Walker
from wbc.problem import Problem
from wbc.problem.campaign import load_campaign
from wbc.problem.saved import load_result
from wbc.problem.walk import WalkSpec, walker_of
from wbc.simulation import SimulationStatus

WALK = """\
robot: hoap2_like
gait:
  clearance: 0.02
  commands:
    - {at: 0.1, vx: 0.12}
    - {at: 0.9, vx: 5}
simulation: {duration: 1.2}
"""


SPIN = {
    "type": "com", "axes": ["x", "y"], "target": "start",
    "law": {"type": "capture_point", "gain": 3, "spin": 20},
}  # fmt: skip


def problem(folder: Path, text: str = WALK, overrides: dict[str, Any] | None = None) -> Problem:
    return problem_of(folder, text, overrides)


def walker_in(problem: Problem) -> Walker:
    assert isinstance(problem.spec, WalkSpec)
    return walker_of(problem.spec, problem.parts)


@pytest.mark.slow
def test_it_walks_and_says_what_was_beyond_the_legs(tmp_path: Path) -> None:
    one = problem(tmp_path)
    result = one.simulate()
    assert result.status is SimulationStatus.STOOD
    assert result.arrays["q"][-1, 0] - result.arrays["q"][0, 0] > 0.04
    assert [note for note in result.notes if note.startswith("commands: after ")]
    assert [note for note in result.notes if "command at 0.9 s: (5, 0) m/s is beyond" in note]
    supports = set(result.run.history.support.tolist())
    assert {"left", "right"} <= supports and len(supports) >= 3
    assert result.relaxed < 0.01


@pytest.mark.slow
def test_a_saved_walk_is_read_back_with_its_robot(tmp_path: Path) -> None:
    brief = {"simulation.duration": 0.02, "gait.commands": [{"at": 0.0, "vx": 0.1}]}
    result = problem(tmp_path, overrides=brief).simulate()
    result.save(tmp_path / "walk.npz")
    saved = load_result(tmp_path / "walk.npz")
    assert saved.robot.name == "hoap2_like"
    np.testing.assert_array_equal(saved.history.q, result.arrays["q"])


def test_walks_are_runs_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "walk.yaml").write_text(WALK)
    (tmp_path / "campaign.yaml").write_text(
        "problems: [walk.yaml]\ngrid: {gait.clearance: [0.02, 0.03]}\nseeds: 2\n"
        "draw: {simulation.friction: [0.5, 0.7]}\n"
    )
    runs = load_campaign(tmp_path / "campaign.yaml").runs
    assert [run.overrides["gait.clearance"] for run in runs] == [0.02, 0.02, 0.03, 0.03]


def test_settings_arrive(tmp_path: Path) -> None:
    walker = walker_in(problem(tmp_path, overrides={"gait.weights": {"trunk": 2.0}}))
    assert walker.gait.clearance == 0.02
    names = {task.name: task for task in walker.controller.tasks}
    assert names["base"].weight.tolist() == [2.0] * 3


@pytest.mark.parametrize(
    ("friction", "coefficient", "facets"),
    [(None, 0.6, 8), (0.4, 0.4, 8), ({"least": 1.0}, 0.6, 8), ({"facets": 4}, 0.6, 4)],
)
def test_soles_have_a_walkers_facets(tmp_path, friction, coefficient, facets) -> None:
    given = {} if friction is None else {"controller": {"level": "torque", "friction": friction}}
    walker = walker_in(problem(tmp_path, overrides=given))
    (left, _) = walker.controller.contacts
    assert left.friction is not None
    assert (left.friction.coefficient, left.friction.facets) == (coefficient, facets)


def test_what_a_file_says_of_the_controller_leaves_the_rest_a_walkers(tmp_path: Path) -> None:
    """As the how-to writes it; the level had to be said, and the solver became another."""
    walker = walker_in(problem(tmp_path, overrides={"controller": {"delay": 0.004}}))
    assert walker.controller.delay == 0.004
    assert type(walker.controller.backend) is type(Walker(walker.robot).controller.backend)


def test_other_tasks_come_along(tmp_path: Path) -> None:
    text = WALK + "tasks:\n  arms: {type: posture, weight: 0.5, joints: {'*elbow*': 1}}\n"
    assert "arms" in {task.name for task in walker_in(problem(tmp_path, text)).lasting_tasks}


def test_constraints_give_way_as_they_say(tmp_path: Path) -> None:
    """They were hard in a walk, whatever their slack."""
    bodies = {"type": "self_collision", "slack": 100.0}
    walker = walker_in(problem(tmp_path, overrides={"constraints": {"bodies": bodies}}))
    assert not walker.controller.slacks.is_hard("bodies")
    assert walker.controller.slacks.is_hard("left_sole")


@pytest.mark.parametrize(
    ("target", "angles"),
    [
        ({"target": {"left_elbow_pitch": -1.3}, "ramp": 0.5}, (0.0, -0.5, -1.0)),
        ({"target": {"loop": {"left_elbow_pitch": [0.2, 0.0]}, "period": 0.5}}, (0.0, -0.4, 0.0)),
    ],
)
def test_targets_of_other_tasks_move_as_they_say(tmp_path, target, angles) -> None:
    """They were at their ends from the first tick on, and loops were not gone round."""
    arms = {"type": "posture", "weight": 0.5, "joints": {"*elbow*": 1}, **target}
    one = problem(tmp_path, overrides={"tasks": {"arms": arms}})
    supervisor, elbow = one.supervisor_on_robot(), one.parts.robot.joint_index("left_elbow_pitch")
    (task,) = (task for task in supervisor.tasks if task.name == "arms")
    for tick, angle in zip((0, 125, 300), angles, strict=True):
        supervisor.update(tick, one.parts.at_start)
        change = task.target[elbow + 1] - one.parts.start[elbow + 1]
        assert change == pytest.approx(angle, abs=1e-9)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"gait.single": 0}, "gait.single: must be greater than 0, got 0"),
        ({"gait.single": 1e-6}, "gait.single: 1e-06 s is shorter than a foot takes to bear"),
        ({"gait.height": 0.4}, "legs do not reach the ground"),
        ({"gait.ramp": 0.3}, "gait.ramp: 0.3 s is longer than the double support"),
        ({"gait.relative": True}, "gait.relative: is about footsteps that are given"),
        ({"phases": {"one": {"duration": 1.0}}}, "phases: has no place in a problem of this kind"),
        ({"gait.commands": []}, "gait.commands: empty; it needs at least one entry"),
        ({"gait.commands": [{"at": 0.5}, {"at": 0.5}]}, "commands[1].at: comes after the one at"),
        ({"gait.commands": [{"at": 9}]}, "is given after the end of the simulation (1.2 s)"),
        ({"gait.commands": [{"at": 0, "vz": 1}]}, "did you mean 'vy'"),
        ({"gait.weights": {"trunk": 0}}, "walking weights, trunk: must be greater than 0"),
        ({"support": "left"}, "support: 'left' does not exist"),
        ({"robot": {"model": "hoap2_like", "feet": {}}}, "gait: biped: two feet are expected"),
        ({"tasks": {"com": SPIN}}, "tasks.com.law.spin: is for a robot that stands"),
    ],
)  # fmt: skip
def test_mistakes(tmp_path: Path, overrides: dict[str, Any], said: str) -> None:
    assert said in complaint_of(tmp_path, WALK, overrides)


def test_what_has_no_two_feet_is_told_that_walking_takes_them(tmp_path: Path) -> None:
    """A quadruped was told to write ``support: all``, and then that no walk has that."""
    feet = "{front: {link: left_sole}, hind: {link: right_sole}}"
    text = WALK.replace("robot: hoap2_like", f"robot: {{model: hoap2_like, feet: {feet}}}")
    said = complaint_of(tmp_path, text)
    assert "p.yaml:2: gait: biped: two feet are expected, left and right; hoap2_like has" in said
    assert "front, hind" in said and "support" not in said


FOOTSTEPS = """\
robot: hoap2_like
gait:
  relative: true
  footsteps:
    - {foot: left, x: 0.02, y: 0.095}
    - {foot: right, x: 0.03, y: -0.1, yaw: 0.1, duration: 0.3}
    - {foot: left, x: 0.0, y: 0.095}
simulation: {duration: 2.2}
"""


@pytest.mark.slow
def test_it_walks_on_footsteps_and_says_where_feet_landed(tmp_path: Path) -> None:
    one = problem(tmp_path, FOOTSTEPS)
    result = one.simulate()
    assert result.status is SimulationStatus.STOOD
    (note,) = result.notes
    assert note.startswith("footsteps: 3 of 3 made; feet landed within ")
    # By the simulation's own state: from the right foot, in its axes.
    end = result.robot.snapshot(result.arrays["q"][-1])
    left, right = (end.position(result.robot.feet[foot].frame) for foot in ("left", "right"))
    R = end.rotation(result.robot.feet["right"].frame)
    np.testing.assert_allclose(R.T @ (left - right), (0.0, 0.095, 0.0), atol=3e-3)


@pytest.mark.slow
def test_a_footstep_that_is_not_at_the_height_that_was_said_is_told(tmp_path: Path) -> None:
    step = {"foot": "left", "x": 0.02, "y": 0.095, "z": 0.02, "duration": 0.5}
    (note,) = problem(tmp_path, FOOTSTEPS, {"gait.footsteps": [step]}).simulate().notes
    assert note.endswith("as measured; footstep 1 at -20 mm from its z")
    seen = {"gait.footsteps": [step | {"z": 0.05}], "gait.see": True}
    seen["simulation.terrain.steps"] = [{"centre": [2, 0, 0.1], "size": [1, 1, 0.1]}]
    told = complaint_of(tmp_path, FOOTSTEPS, seen)
    assert "footsteps[0].z: 0.05 m in the world, but the ground that is given is at 0 m" in told


def test_footsteps_in_the_world_are_those_of_relative_ones(tmp_path: Path) -> None:
    relative = problem(tmp_path, FOOTSTEPS)
    assert isinstance(relative.spec, WalkSpec)
    start = relative.parts.robot.snapshot(relative.parts.start)
    given = [step.footstep for step in relative.spec.gait.footsteps]
    world = walker_in(relative).follow(given, start, relative=True)
    steps = [vars(step) for step in world]
    absolute = problem(tmp_path, FOOTSTEPS, {"gait.relative": False, "gait.footsteps": steps})
    assert isinstance(absolute.spec, WalkSpec)
    assert [step.footstep for step in absolute.spec.gait.footsteps] == list(world)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": 0.5}, "footsteps[1].x: 0.5 m ahead of the left foot is out of reach of the legs"),
        ({"y": -0.5}, "footsteps[1].y: 0.5 m beside the left foot is out of reach of the legs"),
        ({"y": 0.1}, "footsteps[1].y: -0.1 m beside the left foot, on its own side, is across it"),
        ({"yaw": 0.7}, "footsteps[1].yaw: 0.7 rad from the left foot is out of reach of the hips"),
        ({"y": -0.075, "x": 0.0, "yaw": 0.4}, "footsteps[1].yaw: the sole would stand on that"),
        ({"x": 0.14}, "footsteps[1].duration: the foot goes 0."),
        ({"duration": 0}, "footsteps[1].duration: must be greater than 0, got 0"),
        ({"duration": 0.01}, "footsteps[1].duration: 0.01 s on one foot; 0."),
        ({"foot": "left"}, "footsteps[1].foot: the left one has just landed; it must be right"),
        ({"foot": "rihgt"}, "did you mean 'right'"),
        ({"z": 1.0}, "footsteps[1].z: "),
        ({"w": 1.0}, "footsteps[1].w: unknown key"),
    ],
)
def test_mistakes_in_footsteps(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    step = {"foot": "right", "x": 0.03, "y": -0.1} | change
    steps = [{"foot": "left", "x": 0.02, "y": 0.095}, step]
    assert said in complaint_of(tmp_path, FOOTSTEPS, {"gait.footsteps": steps})


def test_every_footstep_that_cannot_be_is_told_at_once(tmp_path: Path) -> None:
    far = [{"foot": "left", "x": 0.9, "y": 0.1}, {"foot": "right", "x": 0.0, "y": -0.9}]
    told = complaint_of(tmp_path, FOOTSTEPS, {"gait.footsteps": far})
    assert "footsteps[0].x" in told and "footsteps[1].y" in told


def test_a_walk_says_where_to(tmp_path: Path) -> None:
    text = "robot: hoap2_like\ngait: {clearance: 0.02}\nsimulation: {duration: 1}\n"
    assert "gait: says not where to: give commands, or footsteps" in complaint_of(tmp_path, text)
    assert "gait.footsteps: empty" in complaint_of(tmp_path, FOOTSTEPS, {"gait.footsteps": []})


def test_a_walk_is_not_run(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="wbc sim"):
        problem(tmp_path).run()
