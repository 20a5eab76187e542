"""Every class of mistake in a problem file gives a typed error that says where and what to do."""

from pathlib import Path
from typing import Any

import pytest

from tests.problem.loading import complaint_of
from wbc.problem import load_problem

GOOD = """\
robot: hoap2_like
start: {posture: standing, joints: {"*_knee_pitch": 0.5}}
support: double
tasks:
  shape: {type: inertia, components: diagonal, frame: base, target: [0.1, 0.1, 0.03]}
  com: {type: com, axes: [x, y], target: {offset: [0.0, 0.0, 0.0]}, weight: 2}
  hand: {type: frame, frame: left_hand, control: position, target: start}
  calm: {type: posture, target: start, joints: {"*_hip_*": 0}, weight: 0.1}
  spin: {type: momentum, components: angular}
limits: {margin: 0.01}
controller: {solver: proxqp}
stop: {duration: 1.0, accept: {com: 1.0e-3}}
"""


SPIN, SHAPE = "{type: momentum, components: angular}", GOOD[GOOD.index("diagonal") :].split("}")[0]
TORSO = "type: frame, frame: torso, control: orientation"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "p.yaml"


def complaint(file: Path, text: str, overrides: dict[str, Any] | None = None) -> str:
    return complaint_of(file.parent, text, overrides)


def test_the_good_file_is_good(file: Path) -> None:
    file.write_text(GOOD)
    problem = load_problem(file)
    assert [task.name for task in problem.parts.tasks] == ["shape", "com", "hand", "calm", "spin"]
    assert [contact.frame for contact in problem.parts.contacts] == ["left_sole", "right_sole"]


# What to replace in the good file by what, the line of the mistake, and words of the message.
MISTAKES = [
    # unknown keys and names: with the nearest that exists
    ("margin:", "margni:", 10, "limits.margni: unknown key; did you mean 'margin'?"),
    ("stop:", "stpo:", 12, "stpo: unknown key; did you mean 'stop'?"),
    ("target: start}", "taget: start}", 7, "tasks.hand.taget: unknown key; did you mean 'target'?"),
    ("components: angular", "gain: 0.5", 9,
     "tasks.spin.gain: unknown key (choose from: active, components"),
    ("weight: 2", "priority: 1.5", 6, "tasks.com.priority: expected a whole number, got 1.5"),
    ("{offset: [0.0, 0.0, 0.0]}", "{offset: [0, 0, 0], position: [0, 0, 1]}", 6,
     "tasks.com.target.position: unknown key (choose from: offset)"),
    ("support:", "dt: 0.01\nsupport:", 3, "dt: belongs to controller; write controller: {dt: ...}"),
    ("support:", "dt: 0.01\nsupport:", 3, "{dt: ...}, or --set controller.dt=..."),
    ("hoap2_like", "zzz", 1, "robot: unknown robot 'zzz'; choose from: g1, "),
    ("hoap2_like", "hoap2", 1, "robot: unknown robot 'hoap2'; did you mean 'hoap2_like'?"),
    ("hoap2_like", "missing.urdf", 1, "no such file"),
    ("posture: standing", "posture: stading", 2, "start.posture: unknown posture 'stading'; did"),
    ('"*_knee_pitch"', "left_knee_pich", 2, "unknown joint 'left_knee_pich'; did you mean"),
    ('"*_knee_pitch"', '"*_kneee"', 2, "start.joints.*_kneee: unknown joint"),
    ("double", "doubel", 3, "support: 'doubel' does not exist; did you mean 'double'?"),
    ("double", "[left_sole, right_sloe]", 3,
     "support[1]: unknown frame 'right_sloe'; did you mean"),
    ("double", "[left_sole, left_sole]", 3, "support[1]: frame 'left_sole' is named twice"),
    ("frame: base", "frame: bsae", 5,
     "tasks.shape.frame: unknown frame 'bsae'; did you mean 'base'"),
    ("frame: left_hand", "frame: left_hnd", 7, "tasks.hand.frame: unknown frame 'left_hnd'; did"),
    ('"*_hip_*"', "waist_pich", 8, "tasks.calm.joints.waist_pich: unknown joint 'waist_pich'; did"),
    ("type: com,", "type: comm,", 6, "tasks.com.type: 'comm' does not exist; did you mean 'com'?"),
    ("type: com,", "", 6,
     "tasks.com: 'type' is missing (choose from: com, frame, relative_pose, distance"),
    ("control: position", "control: positon", 7,
     "tasks.hand.control: 'positon' does not exist; did"),
    ("control: position,", "", 7, "tasks.hand: 'control' is missing"),
    ("solver: proxqp", "solver: proxpq", 11, "controller.solver: unknown QP solver 'proxpq'; did"),
    ("solver: proxqp", "method: qpp", 11,
     "controller.method: 'qpp' does not exist; did you mean 'qp'"),
    ("accept: {com:", "accept: {cmo:", 12,
     "stop.accept.cmo: unknown task 'cmo'; did you mean 'com'?"),
    # numbers
    ("[0.1, 0.1, 0.03]", "[0.1, 0.1]", 5, "tasks.shape.target: needs at least 3 entries, got 2"),
    ("[0.1, 0.1, 0.03]", "[1, 1, 1, 1]", 5,
     "tasks.shape.target: expected a symmetric (3, 3) matrix"),
    ("[0.1, 0.1, 0.03]", "[0.1, .nan, 0.1]", 5, "target[1]: must be a finite number, got .nan"),
    ("[0.1, 0.1, 0.03]", "[0.1, -0.1, 0.1]", 5, "target: a moment of inertia is not negative"),
    ("[0.1, 0.1, 0.03]", '["0.1", 0.1, 0.1]', 5, "got the text '0.1' (leave out the quotes)"),
    ("[0.1, 0.1, 0.03]", "expand", 5, "tasks.shape.target: expected numbers in kg m^2"),
    ("[0.0, 0.0, 0.0]", "[0.0, 0.0]", 6,
     "tasks.com.target.offset: needs at least 3 entries, got 2"),
    ("[0.0, 0.0, 0.0]", "[0, 0, .inf]", 6, "must be a finite number, got .inf"),
    ("weight: 2}", "weight: -2}", 6, "tasks.com.weight: must be at least 0, got -2"),
    ("weight: 2}", "weight: [1, 2, 3]}", 6, "weight: needs one number, or 2 (x, y), got 3"),
    ("weight: 2}", "weight: [1, -1]}", 6, "tasks.com.weight[1]: must be at least 0, got -1"),
    ("weight: 2}", "weight: true}", 6, "tasks.com.weight: expected a number, or a list"),
    ("weight: 2}", "weight: 2, gain: 1.5}", 6, "tasks.com.gain: must be at most 1, got 1.5"),
    ("weight: 2}", "weight: 2, gain: }", 6, "tasks.com.gain: expected a number, got nothing"),
    ("weight: 2}", "weight: 2, ramp: 3}", 6, "tasks.com.ramp: 3 s is longer than the run"),
    ("angular}", "angular, target: [1, 2]}", 9, "needs 3 entries (kx, ky, kz) or all 6, got 2"),
    ("weight: 2}", "weight: 1.0e+300}", 6, "tasks.com.weight: must be at most 1e+09, got 1e+300"),
    ("[0.0, 0.0, 0.0]", "[0, 0, -1.0e+300]", 6, "must be at least -1e+09, got -1e+300"),
    ("solver: proxqp", "dt: 1.0e-300", 11, "controller.dt: must be at least 1e-06, got 1e-300"),
    ("0.5}", "5.0}", 2, "joint 'left_knee_pitch': 5 is outside its limits"),
    ("margin: 0.01", "margin: 3", 10, "leaves no range for joint"),
    ("margin: 0.01", "position: yes", 10, "limits.position: expected true or false, got 'yes'"),
    ("margin: 0.01", "base_twist: [1, 1]", 10,
     "limits.base_twist: needs at least 6 entries, got 2"),
    ("duration: 1.0", "duration: 1.0e+9", 12, "2e+11 ticks; at most 1,000,000 are possible"),
    ("solver: proxqp", "eps: 0", 11, "controller.eps: must be greater than 0, got 0"),
    ("solver: proxqp", "eps: 1.0e-20", 11, "controller: eps of ProxQP: must be at least 1e-12"),
    # masks: bare digits are a number, quoted ones a text, and both are refused
    ("axes: [x, y]", "axes: 110", 6,
     "tasks.com.axes: expected a list such as [x, y], got 110; a mask"),
    ("axes: [x, y]", 'axes: "110"', 6, "expected a list such as [x, y], got '110'; a mask"),
    ("axes: [x, y]", "axes: xy", 6, "expected a list such as [x, y], got 'xy'; a mask"),
    ("axes: [x, y]", "axes: [x, x]", 6, "tasks.com.axes: 'x' is named twice"),
    ("axes: [x, y]", "axes: [x, w]", 6, "tasks.com.axes[1]: 'w' does not exist"),
    ("weight: 2}", "weight: 0,01}", 6, "tasks.com.weight: a decimal comma? write 0.01"),
    ("weight: 2}", "gain: '0,5'}", 6, "gain: expected a number, got the text '0,5' (write 0.5,"),
    ("weight: 2}", "weight: '0,5'}", 6, "one for each row of the task, got '0,5' (write 0.5, with"),
    ("weight: 2}", "weight: -__}", 6, "weight: not a usable number: '-__'; a text needs quotes"),
    ("weight: 2}", f"weight: 0x{'f' * 5000}}}", 6, "weight: not a usable number: '0xfff"),
    ("frame: left_hand", "frame: left_kne", 7, "'left_kne'; did you mean 'left_knee_pitch'?"),
    # forms
    ("limits: {margin: 0.01}", "limits:", 10, "limits: expected none, or keys such as margin:"),
    ("limits: {margin: 0.01}", "limits: off", 10, "'off' does not exist (choose from: none)"),
    ("double", "2", 3,
     "support: expected floating, left, right, double, all, or a list of feet and frames, got 2"),
    ("hoap2_like", "7", 1, "robot: expected a robot's name"),
    (SPIN, "momentum", 9, "tasks.spin: expected keys and values"),
    ("spin:", "spin.2:", 9, "'spin.2' cannot be a name"),
    (SPIN, f"{{{TORSO}, target: {{turn: [0, 0, 1]}}}}", 9,
     "expected {rpy: [roll, pitch, yaw]} in radians, {quaternion: [x, y, z, w]},"),
    (SPIN, f"{{{TORSO}, target: {{quaternion: [0, 0, 0, 0]}}}}", 9,
     "tasks.spin.target.quaternion: a quaternion needs some length"),
    ("posture, target: start", "posture, target: 3", 8, "expected the name of a posture, {joint: "
     "value}, {loop: ...}, {motion: file}, or start,"),
    # what does not fit together
    ("weight: 0.1", "weight: 0", 8, "tasks.calm.weight: without weight the task does nothing"),
    ("hoap2_like", "{model: hoap2_like, locked: {waist_pich: 0}}", 1,
     "robot.locked.waist_pich: unknown"),
    ("hoap2_like", "{model: hoap2_like, feet: {heel: {link: left_foot}}}", 3,
     "support: unknown foot of hoap2_like 'left'"),
    (SHAPE, "principal, frame: base, target: start", 5,
     "tasks.shape.frame: principal moments are the same in every"),
    (SHAPE, "principal, about: world, target: start", 5,
     "tasks.shape.about: principal moments are those about"),
    (SHAPE, "principal, weight: [1, 1, 1], target: start", 5,
     "tasks.shape.weight: principal moments take one weight"),
    (SHAPE, "principal, second_order: true, target: start", 5,
     "tasks.shape.second_order: there is no second order"),
    (SHAPE, "principal, target: [1, 1, 1, 1, 1, 1]", 5,
     "tasks.shape.target: expected the three principal moments"),
    (SHAPE, "principal, target: [1, 1, -1]", 5,
     "tasks.shape.target: a moment of inertia is not negative"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "line", "words"), MISTAKES, ids=[mistake[1] for mistake in MISTAKES]
)
def test_mistake(file: Path, old: str, new: str, line: int, words: str) -> None:
    assert old in GOOD
    message = complaint(file, GOOD.replace(old, new, 1))
    assert message.startswith(f"p.yaml:{line}: "), message
    assert words in message
    assert "\n" not in message  # one mistake, one line
    assert "pydantic" not in message.lower()


def test_missing_parts_are_named(file: Path) -> None:
    assert "p.yaml:1: 'robot' is missing" in complaint(
        file, "tasks: {c: {type: com, target: start}}\n"
    )
    assert "p.yaml:1: 'tasks' is missing" in complaint(file, "robot: hoap2_like\n")
    assert "p.yaml:2: tasks: empty" in complaint(file, "robot: hoap2_like\ntasks: {}\n")


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(file: Path) -> None:
    text = GOOD.replace("margin:", "margni:").replace("type: com,", "type: comm,")
    lines = complaint(
        file, text.replace("taget", "target").replace("weight: 0.1", "gain: 2")
    ).split("\n")
    assert lines[0] == "3 mistakes in p.yaml:"
    assert [line.split(": ")[0].strip() for line in lines[1:]] == [
        f"p.yaml:{k}" for k in (6, 8, 10)
    ]


def test_names_are_looked_up_for_the_whole_file_too(file: Path) -> None:
    text = GOOD.replace("frame: base", "frame: bsae").replace("proxqp", "proxpq")
    lines = complaint(file, text.replace("{com: 1", "{cmo: 1")).split("\n")
    assert [line.split(": ")[1] for line in lines[1:]] == [
        "tasks.shape.frame",
        "controller.solver",
        "stop.accept.cmo",
    ]


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("tasks.com.gain", 2, "--set tasks.com.gain: must be at most 1, got 2"),
        ("tasks.com.target.offset[1]", float("nan"), "must be a finite number, got .nan"),
        ("tasks.com.gian", 0.1, "--set tasks.com.gian: unknown key; did you mean 'gain'?"),
        ("tasks.hand.frame", "left_hnd",
         "--set tasks.hand.frame: unknown frame 'left_hnd'; did you"),
        ("controller", {"method": "pseudo_inverse", "solver": "x"},
         "controller.solver: unknown key"),
        ("robot", object(), "robot: expected a robot's name"),
        ("tasks.new", {"type": "com"}, "--set tasks.new: 'target' is missing"),
        ("tasks.com.axes.0", "x", "'tasks.com.axes' is a list; write tasks.com.axes[0]"),
    ],
)  # fmt: skip
def test_overrides_are_checked_like_the_file(file: Path, path: str, value: Any, words: str) -> None:
    message = complaint(file, GOOD, {path: value})
    assert message.startswith(f"--set {path}: ")
    assert words in message


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ("{'*_ankle_pitch': 0.0}", "the left foot does not stand: a corner of its sole is"),
        ("{right_hip_pitch: -0.7, right_knee_pitch: 1.4, right_ankle_pitch: -0.7}",
         "the right foot does not stand: a corner of its sole is 38 mm above the ground"),
    ],
)  # fmt: skip
def test_soles_that_support_are_on_the_ground(file: Path, joints: str, words: str) -> None:
    """They were held there, in the air or on an edge, and the CoM counted as over them."""
    text = GOOD.replace('{"*_knee_pitch": 0.5}', joints)
    assert f"p.yaml:3: support: {words}" in complaint(file, text)
    file.write_text(text.replace("support: double", "support: [left_sole, right_sole]"))
    load_problem(file)  # where they are is meant


def test_a_folder_given_as_a_robot_is_called_one(file: Path) -> None:
    (file.parent / "robot.urdf").mkdir()
    message = complaint(file, GOOD.replace("hoap2_like", "./robot.urdf"))
    assert "robot.urdf: a folder; name a robot file in it" in message


def test_a_robot_with_feet_does_not_float_because_support_was_forgotten(file: Path) -> None:
    message = complaint(file, GOOD.replace("support: double\n", ""))
    assert message == (
        "p.yaml:1: support: say what the robot stands on: write support: left, right, double, a "
        "list of feet and frames such as [left, right], or floating (nothing is held)"
    )
    file.write_text(GOOD.replace("support: double", "support: floating"))
    assert load_problem(file).parts.contacts == ()
    text = GOOD.replace(', joints: {"*_knee_pitch": 0.5}', "").replace("support: double\n", "")
    phases = "phases: {one: {duration: 1.0, support: double}, two: {duration: 1.0}}\nstop: {}\n"
    file.write_text(text.partition("stop:")[0] + phases)
    assert len(load_problem(file).parts.contacts) == 2


def test_a_robot_without_feet_need_not_say_that_it_floats(file: Path) -> None:
    text = GOOD.replace("support: double\n", "").replace(
        "hoap2_like", "{model: hoap2_like, feet: {}}"
    )
    file.write_text(text)
    assert load_problem(file).parts.contacts == ()


def test_a_task_does_not_pull_at_what_is_held(file: Path) -> None:
    old, new = "frame: left_hand, control: position", "frame: left_foot, control: position"
    words = "tasks.hand: task 'hand' moves what the support holds (left_foot); give active: false"
    assert words in complaint(file, GOOD.replace(old, new))
    soft = "support: [right_sole, {frame: left_sole, slack: 1.0}]"
    file.write_text(GOOD.replace(old, new).replace("support: double", soft))
    load_problem(file)


def test_the_robot_is_not_inside_an_obstacle_at_the_start(file: Path) -> None:
    room = (
        "constraints: {room: {type: obstacles, links: [torso], things: "
        "{ball: {sphere: 1.0, position: [0, 0, 0.3]}}}}\n"
    )
    message = complaint(file, GOOD + room)
    assert "constraints.room: the robot is inside an obstacle at the start: torso" in message
