"""Problem files before they are run: begun, checked, described; what robots are described by."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import urdf
from tests.command import wbc_command
from tests.problem.loading import problem_of
from wbc.problem import load_problem
from wbc.robot import Robot

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("robot", ["hoap2_like", "g1", "mixed_joints"])
def test_the_file_to_begin_with_runs(robot: str, tmp_path: Path) -> None:
    path = tmp_path / "begin.yaml"
    model = Path(__file__).parents[1] / "models" / "mixed_joints.urdf"
    answer = wbc_command("init", path, "--robot", model if robot == "mixed_joints" else robot)
    assert answer.exit_code == 0, answer.stderr
    assert f"wbc run {path}" in answer.stdout
    result = load_problem(path).run()
    assert result.status.good, result.reason


def test_files_and_robots_whose_names_need_quotes(tmp_path: Path) -> None:
    """The file had the robot `/tmp/x/d`, and what to try next was of two files."""
    folder = tmp_path / "d #1: [x]"
    folder.mkdir()
    model, path = folder / "r: a.urdf", folder / "my p.yaml"
    model.write_text((Path(__file__).parents[1] / "models" / "mixed_joints.urdf").read_text())
    answer = wbc_command("init", path, "--robot", model)
    assert answer.exit_code == 0, answer.stderr
    assert f"wbc run '{path}'" in answer.stdout
    text = path.read_text()
    assert f"wbc check '{path}'" in text and f"wbc robots '{model}'" in text
    assert wbc_command("check", path).exit_code == 0


def test_what_is_commented_out_is_valid_too(tmp_path: Path) -> None:
    text = wbc_command("init", "-").stdout
    text = re.sub(r"# (hand:|  {type: frame)", r"\1", text).replace("FRAME", "left_hand")
    text = re.sub(r"constraints: {}\n  # (.*)\n  # (.*)\n", r"constraints:\n  \1\n  \2\n", text)
    spec = problem_of(tmp_path, text).spec
    assert {"hand", "bodies", "room"} <= set(spec.tasks) | set(spec.constraints)


def test_the_schema_lies_beside_the_file_and_is_named_in_its_first_line(tmp_path: Path) -> None:
    wbc_command("init", tmp_path / "p.yaml")
    first = (tmp_path / "p.yaml").read_text().splitlines()[0]
    name = first.removeprefix("# yaml-language-server: $schema=")
    schema = json.loads((tmp_path / name).read_text())
    assert schema == json.loads(wbc_command("schema").stdout)
    assert schema["$id"] == "urn:wbc:schema:problem:1"


def test_no_file_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("mine")
    answer = wbc_command("init", path)
    assert (answer.exit_code, path.read_text()) == (1, "mine")
    assert "is there already" in answer.stderr
    assert not list(tmp_path.glob("*.json"))
    assert "there is no folder" in wbc_command("init", tmp_path / "no" / "p.yaml").stderr


def test_check_names_every_mistake_and_runs_nothing(tmp_path: Path) -> None:
    good, bad = PROBLEMS / "shape_standing_g1.yaml", tmp_path / "bad.yaml"
    bad.write_text("robot: hoap2_like\nsupport: double\ntasks:\n  c: {type: cm}\n")
    answer = wbc_command("check", bad, good, PROBLEMS / "rmp_spin.yaml", PROBLEMS / "plan_hop.yaml")
    assert answer.exit_code == 1
    assert f"{bad}:4: tasks.c.type: 'cm' does not exist" in answer.stderr
    robot, law, plan = answer.stdout.splitlines()
    assert robot == f"{good}: valid: g1, 4 tasks, 2 contacts"
    assert ("law spin" in law, "a plan" in plan) == (True, True)
    answer = wbc_command("check", good, "-q", "--set", "tasks.com.weight=-1")
    assert (answer.exit_code, answer.stdout) == (1, "")
    assert "tasks.com.weight" in answer.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "motion: walk.trc\nrobot: g1\n",
            "is a human's motion for a robot, not a problem: wbc ret",
        ),
        ("problems: [a.yaml]\n", "is a campaign of problems, not a problem: wbc batch"),
    ],
)
@pytest.mark.parametrize("verb", ["check", "run"])
def test_files_of_other_commands_are_told_from_problems(text, said, verb, tmp_path) -> None:
    """Their keys were unknown: motion, did you mean 'simulation'?"""
    path = tmp_path / "a.yaml"
    path.write_text(text)
    answer = wbc_command(verb, path)
    assert answer.exit_code and said in answer.stderr and answer.stderr.count("\n") == 1


def test_stdin_is_a_problem_file(tmp_path: Path) -> None:
    text = (PROBLEMS / "shape_standing_g1.yaml").read_text()
    short = ("--set", "stop.duration=0.02", "--set", "tasks.shape.ramp=null", "-q")
    files = [tmp_path / name for name in ("a.json", "a.npz")]
    answer = wbc_command("run", "-", *short, "-o", files[0], "-o", files[1], stdin=text)
    assert answer.exit_code == 0, answer.stderr
    summary = json.loads(files[0].read_text())
    assert summary["problem"]["text"] == text
    assert all(file.is_file() for file in files)
    answer = wbc_command("check", "-", stdin="tasks: {}\n")
    assert "error: " in answer.stderr and "<stdin>" in answer.stderr
    assert "expected keys" in wbc_command("check", "-", stdin="[1]").stderr


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("wbc robots h", ["hoap2_like"]),
        ("wbc run p.yaml --solver proxqp_c", ["proxqp_cold"]),
        ("wbc che", ["check"]),
        ("wbc run prob", []),  # the shell offers files
    ],
)
def test_what_tab_offers(words: str, offered: list[str]) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'wbc'\nfrom wbc.cli import main; main()"],
        env={
            "_WBC_COMPLETE": "complete_bash",
            "COMP_WORDS": words,
            "COMP_CWORD": str(words.count(" ")),
            "PYTHONPATH": str(PROBLEMS.parent),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.split() == offered


def test_help_is_short_too() -> None:
    for arguments in (["-h"], ["run", "-h"], ["robots", "-h"]):
        assert "Usage" in wbc_command(*arguments).stdout


def test_joints_have_limits_and_masses_and_the_masses_add_up(hoap2: Robot) -> None:
    text = wbc_command("robots", "hoap2_like").stdout
    table, _, _ = text.partition("missing limits")
    rows = {line.split()[0]: line.split()[1:] for line in table.splitlines() if line.strip()}
    elbow = hoap2.joint_names.index("left_elbow_pitch")
    limits = hoap2.limits
    shown = [limits.lower[elbow], limits.upper[elbow], limits.velocity[elbow], limits.effort[elbow]]
    assert [float(cell) for cell in rows["left_elbow_pitch"][:4]] == pytest.approx(shown, rel=1e-3)
    masses = [float(rows[name][-1]) for name in ("base", *hoap2.joint_names)]
    assert sum(masses) == pytest.approx(hoap2.mass, abs=5e-4 * len(masses))  # printed to 1 g
    assert "missing limits: none" in text
    assert set(hoap2.frame_names) <= set(text.split())


def test_missing_limits_are_said(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf.arm_of_one_joint(urdf.limit(1, 0, 0)))
    answer = wbc_command("robots", path)
    assert "missing limits: velocity (j); effort (j)" in answer.stdout
    assert "note: arm: joints without a limit: velocity (j); effort (j)" in answer.stderr
    row = next(line for line in answer.stdout.splitlines() if line.startswith("j "))
    assert row.split() == ["j", "-1", "1", "none", "none", "1.000"]


def test_names_that_look_like_markup_are_printed_as_they_are(tmp_path: Path) -> None:
    """A console would take [/j] for the end of a style, and leave [lr] out."""
    links = map(urdf.link, ("base", "[lr]eft"))
    text = urdf.robot("odd", *links, urdf.joint("[/j]", "base", "[lr]eft"))
    (tmp_path / "[odd].urdf").write_text(text)
    shown = wbc_command("robots", tmp_path / "[odd].urdf").stdout
    assert {"[lr]eft", "[/j]"} <= set(shown.partition("frames:")[2].split())
    problem = tmp_path / "[p].yaml"
    problem.write_text(
        "robot: '[odd].urdf'\ntasks:\n  p: {type: posture, target: start}\n"
        "  tip: {type: frame, frame: '[lr]eft', control: position, target: start}\n"
        "stop: {duration: 0.05}\n"
    )
    assert "([/j], tick 0)" in wbc_command("run", problem).stdout


def test_joints_that_follow_others_are_named(tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    links = map(urdf.link, ("palm", "thumb_link", "finger_link"))
    mimic = '<mimic joint="thumb" multiplier="-0.5" offset="0.1"/>'
    thumb = urdf.joint("thumb", "palm", "thumb_link")
    finger = urdf.joint("finger", "palm", "finger_link", mimic)
    path.write_text(urdf.robot("hand", *links, thumb, finger))
    assert "finger follows: -0.5 thumb +0.1\n" in wbc_command("robots", path).stdout


def test_tab_offers_what_begins_so() -> None:
    from wbc.cli.options import (
        directions_beginning,
        layers_beginning,
        robots_beginning,
        solvers_beginning,
    )

    assert "g1" in robots_beginning("g") and "talos" not in robots_beginning("g")
    assert solvers_beginning("act") == ["active_set"]
    assert directions_beginning("front-r") == ["front-right"]
    assert layers_beginning("ground,ell") == ["ground,ellipsoid"]
    assert "no-ground" in layers_beginning("no-") and "robot" not in layers_beginning("no-")
