"""Phases that cannot be meant, each with one message that says where; and their JSON Schema."""

import re
from pathlib import Path

import pytest

from tests.problem.loading import complaint_of as complaint
from tests.problem.loading import problem_of

GOOD = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: start}
  foot: {type: frame, frame: left_sole, control: pose, target: start, active: false}
  calm: {type: posture, weight: 0.1}
  size: {type: inertia, components: principal, target: start, active: false}
phases:
  shift: {duration: 1.0, tasks: {com: {target: {over: right}}}}
  lift:
    duration: 1.0
    support: right
    tasks:
      foot: {active: true, target: {position: {offset: [0, 0, 0.03]}}, weight: 3}
  down: {duration: 1.0, tasks: {foot: {target: start}}}
  stand: {duration: 1.0, support: double, tasks: {foot: {active: false}}}
stop: {accept: {com: 1.0}}
"""


def test_the_good_file_is_good(tmp_path: Path) -> None:
    phases = problem_of(tmp_path, GOOD).parts.phases
    assert [(phase.name, phase.begins) for phase in phases] == [
        ("shift", 0.0),
        ("lift", 1.0),
        ("down", 2.0),
        ("stand", 3.0),
    ]


MISTAKES = [
    # names
    ("{com: {target: {over", "{cmo: {target: {over", 9,
     "phases.shift.tasks.cmo: unknown task 'cmo'; did you mean 'com'?"),
    ("support: right", "support: rihgt", 12,
     "phases.lift.support: 'rihgt' does not exist; did you mean 'right'?"),
    ("support: right", "support: [right_sloe]", 12,
     "phases.lift.support[0]: unknown frame 'right_sloe'; did"),
    ("over: right", "over: rihgt", 9,
     "phases.shift.tasks.com.target.over: unknown foot of hoap2_like 'rihgt'; did"),
    ("{over: right}", "{ovr: right}", 9,
     "phases.shift.tasks.com.target.ovr: unknown key; did you mean 'over'?"),
    ("{over: right}", "{ofset: [0, 0, 0]}", 9, "target.ofset: unknown key; did you mean 'offset'?"),
    ("lift:\n    duration:", "lift:\n    duratoin:", 11,
     "phases.lift.duratoin: unknown key; did you mean 'duration'?"),
    ("active: true,", "actve: true,", 14,
     "phases.lift.tasks.foot.actve: unknown key; did you mean 'active'?"),
    ("lift:", "lift.1:", 10, "'lift.1' cannot be a name"),
    # numbers
    ("down: {duration: 1.0", "down: {duration: 0", 15,
     "phases.down.duration: must be greater than 0, got 0"),
    ("down: {duration: 1.0", "down: {duration: 0.001", 15,
     "phases.down.duration: 0.001 s is shorter than the time step (0.005 s)"),
    ("down: {duration: 1.0, ", "down: {", 15, "phases.down: 'duration' is missing"),
    ("down: {duration: 1.0", "down: {duration: 1.0e+9", 8,
     "phases: 1e+09 s at a time step of 0.005 s are 2e+11 ticks"),
    ("weight: 3}", "weight: [1, 2]}", 14,
     "phases.lift.tasks.foot.weight: needs one number, or 6 (x, y, z, rx, ry, rz), got 2"),
    ("weight: 3}", "weight: -3}", 14, "phases.lift.tasks.foot.weight: must be at least 0, got -3"),
    ("[0, 0, 0.03]", "[0, 0.03]", 14,
     "foot.target.position.offset: needs at least 3 entries, got 2"),
    ("[0, 0, 0.03]", "[0, 0, .nan]", 14, "foot.target.position.offset[2]: must be a finite number"),
    # forms: a target must be one of its own task
    ("{over: right}", "stat", 9,
     "phases.shift.tasks.com.target: expected [x, y, z] in metres, {offset: [x, y"),
    ("{foot: {target: start}}", "{foot: {target: {over: left}}}", 15,
     "phases.down.tasks.foot.target.over: unknown key"),
    ("{foot: {target: start}}", "{calm: {target: {knee: 1}}}", 15,
     "phases.down.tasks.calm.target.knee: unknown joint 'knee'"),
    ("{foot: {target: start}}", "{size: {active: true, target: [1, 1, -1]}}", 15,
     "size.target: a moment of inertia is not negative"),
    # what contradicts itself
    ("{foot: {active: false}}", "{}", 16,
     "phases.stand: task 'foot' moves what the support holds (left_sole); give active: false"),
    ("{com: {target: {over: right}}}", "{foot: {active: true}}", 9,
     "phases.shift.tasks.foot: task 'foot' moves what the support holds"),
    ("{foot: {active: false}}", "{foot: {active: false, target: start}}", 16,
     "phases.stand.tasks.foot.target: task 'foot' is off in this phase"),
    ("{foot: {active: false}}", "{foot: {active: false, weight: 2}}", 16,
     "phases.stand.tasks.foot.weight: task 'foot' is off in this"),
    ("down: {duration: 1.0, tasks: {foot: {target: start}}}",
     "down: {duration: 1.0, tasks: {com: {target: {over: left}}}}", 15,
     "phases.down.tasks.com.target.over: the left foot does not stand in this"),
    ("tasks: {foot: {active: false}}}",
     "tasks: {foot: {active: false}, com: {active: false}, calm: {active: false}}}", 16,
     "phases.stand: no task is active; there is nothing to do"),
    ("accept:", "duration: 3, accept:", 17,
     "stop.duration: a run with phases ends after the last; leave this out"),
    ("accept:", "speed: 1.0e-3, accept:", 17,
     "stop.speed: a run with phases ends after the last; leave this out"),
    ("com, target: start}", "com, target: start, ramp: 1}", 4,
     "tasks.com.ramp: with phases a target begins where this section says"),
    ("support: double\ntasks", "support: double\nstart: {joints: {left_ankle_roll: 0.2}}\ntasks", 2,
     "support: the left foot does not stand: a corner of its sole is"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "line", "words"), MISTAKES, ids=[mistake[1] for mistake in MISTAKES]
)
def test_mistake(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    assert old in GOOD
    message = complaint(tmp_path, GOOD.replace(old, new, 1))
    assert message.startswith(f"p.yaml:{line}: "), message
    assert words in message
    assert "\n" not in message  # one mistake, one line


def test_no_phases_are_not_phases(tmp_path: Path) -> None:
    text = GOOD.split("phases:")[0] + "phases: {}\n"
    assert "p.yaml:8: phases: empty; it needs at least one entry" in complaint(tmp_path, text)


def test_switched_off_tasks_without_phases(tmp_path: Path) -> None:
    text = "robot: hoap2_like\ntasks:\n  com: {type: com, target: start, active: false}\n"
    assert "p.yaml:2: tasks: no task is active" in complaint(tmp_path, text)


@pytest.mark.parametrize(
    ("everywhere", "later", "where"),
    [
        ("[left, right, left_palm]", "double", r":2: support\[2\]"),
        ("double", "[left, right, left_palm]", r":8: phases\.grasp\.support\[2\]"),
    ],
)
def test_frames_of_which_it_is_not_known_where_they_bear_are_found_before_the_run(
    tmp_path: Path, everywhere: str, later: str, where: str
) -> None:
    """In a later phase they were found when it began, and what was simulated was lost."""
    text = f"""\
robot: hoap2_like
support: {everywhere}
tasks:
  com: {{type: com, target: start}}
  calm: {{type: posture, weight: 0.1}}
phases:
  stand: {{duration: 0.1}}
  grasp: {{duration: 0.1, support: {later}}}
  go on: {{duration: 0.1}}
controller: {{level: torque}}
simulation: {{}}
"""
    found = complaint(tmp_path, text)
    assert re.search(f"{where}: where forces act on 'left_palm' is not known", found)
    assert found.count("left_palm'") == 1
    problem_of(tmp_path, text.replace("left_palm", "{frame: left_palm, type: point}"))
