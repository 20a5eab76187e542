"""Tasks about forces in problem files: what is made of them, mistakes, and a short simulation."""

from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from tests.problem.loading import complaint_of, problem_of
from wbc.cli.printing import tasks_table
from wbc.problem import Problem
from wbc.run.stopping import Stop
from wbc.tasks import ContactForceTask, CopTask, ForceRateTask, ForceTask, LoadShareTask, TorqueTask

HEAD = "robot: {model: hoap2_like, armature: 0.003}\nsupport: double\ntasks:\n"
MOTION = """\
  com: {type: com, target: start, weight: 10, kp: 40}
  torso: {type: frame, frame: base, control: orientation, target: start}
  posture: {type: posture, weight: 0.1}
controller: {level: torque}
simulation: {duration: 0.1}
"""
SHARE = "{type: load_share, target: {right_sole: 1, left_sole: 2}, weight: 3}"
PHASES = """\
phases:
  both: {duration: 0.05}
  left: {duration: 0.05, support: left}
"""


def problem(folder: Path, task: str, rest: str = MOTION) -> Problem:
    return problem_of(folder, f"{HEAD}  t: {task}\n{rest}")


def complaint(folder: Path, task: str, rest: str = MOTION) -> str:
    return complaint_of(folder, f"{HEAD}  t: {task}\n{rest}")


def made(folder: Path, task: str) -> Any:
    return problem(folder, task).parts.tasks[0]


def test_contact_force(tmp_path: Path) -> None:
    one = made(tmp_path, "{type: contact_force, frame: left_sole, components: [fy], target: [3]}")
    assert isinstance(one, ContactForceTask)
    assert one.rows == ("fy",) and one.frame == "left_sole" and one.name == "t"
    np.testing.assert_array_equal(one.target, [0, 3, 0, 0, 0, 0])
    plain = made(tmp_path, "{type: contact_force, frame: left_sole, priority: 1}")
    default = ContactForceTask(plain.robot, "left_sole")
    assert plain.rows == default.rows and plain.priority == 1
    np.testing.assert_array_equal(plain.target, default.target)
    np.testing.assert_array_equal(plain.weight, default.weight)


def test_load_share_whatever_the_order_of_its_frames(tmp_path: Path) -> None:
    one = made(tmp_path, SHARE)
    assert isinstance(one, LoadShareTask)
    assert one.frames == ("left_sole", "right_sole")
    np.testing.assert_array_equal(one.target, [2, 1])
    np.testing.assert_array_equal(one.weight, [3, 3])


def test_cop(tmp_path: Path) -> None:
    one = made(tmp_path, "{type: cop, target: [0.01, 0.02], weight: [1, 2]}")
    assert isinstance(one, CopTask) and one.frame is None
    np.testing.assert_array_equal(one.target, [0.01, 0.02])
    np.testing.assert_array_equal(one.weight, [1, 2])
    assert made(tmp_path, "{type: cop, target: [0, 0, 0.1]}").target.shape == (3,)
    assert made(tmp_path, "{type: cop, frame: left_sole, target: [0, 0]}").frame == "left_sole"


def test_force_rate(tmp_path: Path) -> None:
    one = made(tmp_path, "{type: force_rate}")
    default = ForceRateTask(one.robot)
    assert isinstance(one, ForceRateTask) and one.frames == default.frames
    np.testing.assert_array_equal(one.weight, default.weight)
    assert made(tmp_path, "{type: force_rate, frames: [left_sole]}").frames == ("left_sole",)


def test_torque(tmp_path: Path) -> None:
    one = made(tmp_path, "{type: torque}")
    assert isinstance(one, TorqueTask)
    np.testing.assert_array_equal(one.weight, TorqueTask(one.robot).weight)
    assert not one.target.any() and len(one.rows) == len(one.robot.joint_names)
    some = made(tmp_path, "{type: torque, target: {'*_knee_pitch': 0.5}, joints: ['left_*']}")
    assert some.target.sum() == 1.0  # of both knees, 0.5 each
    assert all(row.startswith("left_") for row in some.rows)
    assert (made(tmp_path, "{type: torque, target: 0.2}").target == 0.2).all()
    values = [0.1 * k for k in range(len(one.target))]
    np.testing.assert_allclose(made(tmp_path, f"{{type: torque, target: {values}}}").target, values)


FRAME = "{type: contact_force, frame: left_sole, "
MISTAKES = [
    (FRAME.replace("left_sole", "left_sle") + "}", "t.frame: unknown frame 'left_sle'; did you me"),
    (
        FRAME.replace("left_sole", "left_hand") + "}",
        "p.yaml:4: tasks.t.frame: unknown contact 'left_hand'; the support never holds it while"
        " the task is on (held: left_sole, right_sole)",
    ),
    (FRAME + "target: [1, 2]}", "p.yaml:4: tasks.t.target: needs 6 entries (fx, fy, fz, mx, my, m"),
    (FRAME + "components: [fx], target: [1, 2]}", "needs 1 entries (fx) or all 6, got 2"),
    (FRAME + "components: [fw]}", "tasks.t.components[0]: 'fw' does not exist"),
    (FRAME + "weight: [1, 2]}", "tasks.t.weight: needs one number, or 6 (fx, fy, fz, mx, my, mz)"),
    (FRAME + "gain: 0.1}", "p.yaml:4: tasks.t.gain: unknown key"),
    (FRAME + "kd: 3}", "tasks.t.kd: unknown key"),
    ("{type: load_share}", "p.yaml:4: tasks.t: 'target' is missing"),
    ("{type: load_share, target: {left_sole: 1}}", "tasks.t.target: needs at least 2 entries"),
    ("{type: load_share, target: {left_sole: 0, right_sole: 0}}", "shares must not all be 0"),
    ("{type: load_share, target: {left_sole: -1, right_sole: 1}}", "left_sole: must be at least 0"),
    ("{type: load_share, target: {left_sole: 1, torso: 1}}", "target.torso: unknown contact 'tors"),
    ("{type: cop, target: [0]}", "tasks.t.target: needs at least 2 entries, got 1"),
    ("{type: cop, frame: left_sole, target: [0, 0, 0]}", "t.target: needs 2 entries, in the plane"),
    ("{type: cop, frame: left_hand, target: [0, 0]}", "tasks.t.frame: unknown contact 'left_hand'"),
    ("{type: force_rate, frames: [left_sole, torso]}", "t.frames[1]: unknown contact 'torso'"),
    ("{type: force_rate, target: start}", "tasks.t.target: 'start' does not exist"),
    ("{type: torque, target: [1, 2]}", "p.yaml:4: tasks.t.target: needs 25 entries, one for each"),
    ("{type: torque, target: {elbw: 1}}", "tasks.t.target.elbw: unknown joint 'elbw'"),
    ("{type: torque, joints: [elbw]}", "tasks.t.joints[0]: unknown joint 'elbw'"),
]


@pytest.mark.parametrize(("task", "words"), MISTAKES)
def test_mistakes_are_told_with_their_place(tmp_path: Path, task: str, words: str) -> None:
    assert words in complaint(tmp_path, task)


@pytest.mark.parametrize(
    "task",
    [FRAME + "}", SHARE, "{type: cop, target: [0, 0]}", "{type: force_rate}", "{type: torque}"],
)
def test_the_velocity_level_has_no_forces(tmp_path: Path, task: str) -> None:
    rest = "  com: {type: com, target: start}\n"
    kind = task.split("type: ")[1].split(",")[0].rstrip("}")
    words = f"p.yaml:4: tasks.t.type: {kind} belongs to the torque level; give controller: {{level"
    assert words in complaint(tmp_path, task, rest)


def test_a_contact_must_be_one_in_some_phase_with_the_task(tmp_path: Path) -> None:
    assert problem(tmp_path, SHARE, MOTION.split("simulation")[0] + PHASES).parts.tasks
    only = PHASES.replace("0.05}", "0.05, tasks: {t: {active: true}}}")
    left = only.replace("support: left}", "support: left, tasks: {t: {active: true}}}")
    left = left.replace("both: {duration: 0.05, tasks: {t: {active: true}}}", "both: {duration: 1}")
    words = "target.right_sole: unknown contact 'right_sole'; the support never holds it"
    off = SHARE.replace("weight", "active: false, weight")
    assert words in complaint(tmp_path, off, MOTION.split("simulation")[0] + left)


@pytest.mark.parametrize(
    ("task", "target", "words"),
    [
        (SHARE, "{left_sole: 1, torso: 2}", "needs the frames that the task has: left_sole, right"),
        ("{type: cop, target: [0, 0]}", "[0, 0, 0]", "needs 2 entries as in the task itself, got"),
    ],
)
def test_phases_keep_the_form_of_a_target(tmp_path, task, target, words) -> None:
    phases = f"phases:\n  only: {{duration: 0.1, tasks: {{t: {{target: {target}}}}}}}\n"
    said = complaint(tmp_path, task, MOTION.split("simulation")[0] + phases)
    assert f"phases.only.tasks.t.target: {words}" in said


def test_the_load_goes_where_it_is_asked_to(tmp_path: Path) -> None:
    """The plant's own forces, of MuJoCo; without the task the symmetric stance shares evenly.

    Within 0.05 of the share: soles of finite stiffness and 0.1 s.
    """
    one = problem(tmp_path, SHARE).simulate()
    assert one.status.good, one.reason
    last = {side: one.arrays[f"forces/{side}_sole"][-1, 2] for side in ("left", "right")}
    assert last["left"] / sum(last.values()) == pytest.approx(2 / 3, abs=0.05)
    # What is told at the end is what the last tick decided.
    told = one.run.tasks["t"]
    planned = np.array([one.arrays[f"planned_forces/{f}_sole"][-1, 2] for f in ("left", "right")])
    np.testing.assert_allclose(told.error, planned - planned.sum() * np.array([2, 1]) / 3)
    assert told.units == ("N", "N")
    even = problem(tmp_path, SHARE.replace("weight", "active: false, weight")).simulate()
    last = {side: even.arrays[f"forces/{side}_sole"][-1, 2] for side in ("left", "right")}
    assert last["left"] / sum(last.values()) == pytest.approx(0.5, abs=0.05)
    assert np.isnan(even.run.tasks["t"].error).all()
    console = Console(record=True, width=80, file=StringIO())
    console.print(tasks_table(even.run))
    assert "it was never on" in console.export_text()


def test_shares_change_smoothly_in_a_phase_and_rest_without_the_contact(tmp_path: Path) -> None:
    phases = (
        "phases:\n"
        "  even: {duration: 0.02}\n"
        "  left: {duration: 0.1, tasks: {t: {target: {left_sole: 30, right_sole: 10}}}}\n"
        "  up: {duration: 0.02, support: left}\n"
    )
    start = SHARE.replace("left_sole: 2", "left_sole: 1")
    one = problem(tmp_path, start, MOTION.split("simulation")[0] + phases)
    executor, here = one.executor(), one.parts.robot.snapshot(one.parts.start)
    shares = []
    for tick in (0, 35, 60):
        controller = executor.update(tick, here)
        assert controller is not None
        task = next(task for task in controller.tasks if isinstance(task, ForceTask))
        shares.append(task.target[0] / task.target.sum())
        tick_now = controller.step(here)
    np.testing.assert_allclose(shares, [0.5, 0.625, 0.75], atol=1e-12)
    assert tick_now.ok and tick_now.errors["t"].any()  # the right sole's force goes by a ramp
    for _ in range(30):  # 0.06 s, the ramp takes 0.05
        tick_now = controller.step(here)
    assert tick_now.ok and not tick_now.errors["t"].any()  # of the left sole alone: it rests
    assert Stop(**one.spec.whole_stop.model_dump()).duration == pytest.approx(0.14)
