"""The command line as a user meets it: output, exit codes, errors on one line; doctor and cache."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import wbc
from tests.command import wbc_command
from tests.failing_ticks import let_ticks_fail
from tests.urdf import arm_of_one_joint, limit
from wbc.cli import app, progress
from wbc.errors import ModelError
from wbc.files import CACHE_VARIABLE
from wbc.problem import History
from wbc.robot import kernel, robot_names
from wbc.robot.packages import menagerie_names
from wbc.view.options import View

GOOD = """\
robot: hoap2_like
support: floating
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0, 0, 0.01]}}
stop: {duration: 1.0, speed: 1.0e-3, accept: {hand: 1.0e-3}}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD)
    return path


def refused(*arguments: object) -> str:
    """Run what must fail as bad input; return the message."""
    answer = wbc_command(*arguments)
    assert answer.exit_code == 1
    assert answer.stdout == ""
    assert answer.stderr.startswith("error: ")
    assert "Traceback" not in answer.stderr
    return answer.stderr.removeprefix("error: ").rstrip("\n")


def test_a_robot_that_falls_over_is_not_exit_zero(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "robot: hoap2_like\nsupport: double\n"
        "tasks: {com: {type: com, target: {offset: [0.08, 0, 0]}, axes: [x, y], gain: 0.1}}\n"
        "stop: {duration: 1.0, accept: {com: 1.0e-3}, speed: null}\n"
    )
    answer = wbc_command("run", path)
    assert answer.exit_code == 3
    assert "not kept: ran for 1 s, but the robot falls: its CoM was" in answer.stdout
    assert wbc_command("run", path, "--set", "stop.balance=null").exit_code == 0


def test_a_good_run(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", float("inf"))
    answer = wbc_command("run", file, "--output", tmp_path / "r.json")
    assert answer.exit_code == 0
    for words in ("converged", "hand", "joint limits", "every tick solved", "median", "r.json"):
        assert words in answer.stdout
    assert answer.stderr == ""
    assert json.loads((tmp_path / "r.json").read_text())["status"] == "converged"


def test_quiet_says_nothing(file: Path) -> None:
    answer = wbc_command("run", file, "--quiet")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "", "")


@pytest.mark.parametrize(
    ("assignments", "code", "words"),
    [
        (["stop.duration=0.02", "stop.accept.hand=1e-9"], 3, "not reached"),
        (["stop.duration=0.05", "stop.accept={}"], 3, "timeout"),
        (["stop.duration=0.05", "stop.accept={}", "stop.speed=null"], 0, "completed"),
        (["stop.duration=0.5", "stop.speed=null"], 0, "accepted"),
    ],
)
def test_exit_codes(file: Path, assignments: list[str], code: int, words: str) -> None:
    options = [part for assignment in assignments for part in ("--set", assignment)]
    answer = wbc_command("run", file, *options)
    assert answer.exit_code == code
    assert words in answer.stdout


def test_a_failed_qp_has_its_own_exit_code(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    let_ticks_fail(monkeypatch)
    answer = wbc_command("run", file, "--set", "stop.duration=0.02")
    assert answer.exit_code == 4
    assert "4 of 4 ticks failed; the first, tick 0: QP failed" in " ".join(answer.stdout.split())


def test_the_solver_can_be_chosen(file: Path, tmp_path: Path) -> None:
    answer = wbc_command("run", file, "--solver", "proxqp_cold", "-q", "-o", tmp_path / "r.json")
    assert answer.exit_code == 0
    overrides = json.loads((tmp_path / "r.json").read_text())["problem"]["overrides"]
    assert overrides == {"controller.solver": "proxqp_cold"}
    message = refused("run", file, "--solver", "proxpq")
    assert message.startswith("--set controller.solver: unknown QP solver 'proxpq'; did you mean")


def test_bad_input_is_one_clean_message(file: Path, tmp_path: Path) -> None:
    assert refused("run", tmp_path / "missing.yaml") == f"{tmp_path}/missing.yaml: no such file"
    assert refused("run", tmp_path) == f"{tmp_path}: a folder; name a problem file in it"
    assert refused("batch", "/") == "/: a folder; name a problem file in it"  # ValueError
    assert "expected PATH=VALUE" in refused("run", file, "--set", "tasks.hand.gain")
    assert "must be at most 1, got 2" in refused("run", file, "--set", "tasks.hand.gain=2")
    file.write_text(GOOD.replace("left_hand", "left_hnd"))
    message = refused("run", file)
    assert message.startswith(f"{file}:4: tasks.hand.frame: unknown frame 'left_hnd'; did you mean")
    assert "\n" not in message


def test_outputs_are_checked_before_the_run(file: Path, tmp_path: Path) -> None:
    file.write_text(GOOD.replace("left_hand", "left_hnd"))  # would be the next complaint
    assert "written as .json (summary), .npz" in refused("run", file, "-o", tmp_path / "r.txt")
    assert "there is no folder" in refused("run", file, "-o", tmp_path / "no" / "r.json")
    (tmp_path / "r.json").mkdir()
    assert "is a folder" in refused("run", file, "-o", tmp_path / "r.json")
    assert "there is no folder" in refused("run", file, "--plot", tmp_path / "no" / "r.png")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.yaml", "r.json"]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "render"])
def test_a_file_with_dollars_in_its_name_is_drawn_under_that_name(file, tmp_path, command) -> None:
    named = tmp_path / "p$_{$.yaml"  # to Matplotlib a formula, and a broken one
    named.write_text(file.read_text())
    picture = tmp_path / ("r.svg" if command == "run" else "r.gif")
    options = ("--plot",) if command == "run" else ("--fps", 1, "-o")
    answer = wbc_command(command, named, *options, picture, "-q")
    assert answer.exit_code == 0, answer.stderr
    assert picture.is_file()


def test_plot_without_matplotlib_fails_before_the_run(file, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("wbc.extras.find_spec", lambda name: None)
    message = refused("run", file, "--plot", tmp_path / "r.png")
    assert message == "--plot needs matplotlib: pip install 'wbc[plot]'"


def test_a_picture_is_drawn_last_and_may_fail(file, tmp_path, monkeypatch) -> None:
    drawn: list[tuple[int, str]] = []
    outputs = ("-o", tmp_path / "r.json", "--plot", tmp_path / "r.png")

    def draw(robot: object, history: History, path: Path, *, title: str, view: View) -> None:
        assert (tmp_path / "r.json").is_file()
        drawn.append((len(history), title))
        if len(drawn) > 1:
            raise ModelError("a mesh is broken")

    monkeypatch.setattr("wbc.view.plot_run", draw)
    answer = wbc_command("run", file, *outputs)
    assert answer.exit_code == 0
    assert "r.png" in answer.stdout
    ((ticks, title),) = drawn
    assert title == "p: converged"
    assert ticks == json.loads((tmp_path / "r.json").read_text())["ticks"]
    answer = wbc_command("run", file, *outputs)
    assert answer.exit_code == 1
    assert "converged" in answer.stdout
    assert answer.stderr == f"error: --plot {tmp_path / 'r.png'}: a mesh is broken\n"


def test_a_result_that_cannot_be_saved_is_saved_elsewhere(file, tmp_path, monkeypatch) -> None:
    from wbc.problem import Result as RunResult

    save = RunResult.save
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def full_disk(self: RunResult, path: Path) -> None:
        if path.parent == tmp_path:
            raise OSError(28, "No space left on device")
        save(self, path)

    monkeypatch.setattr(RunResult, "save", full_disk)
    answer = wbc_command("run", file, "-o", tmp_path / "r.json")
    assert answer.exit_code == 1
    assert "cannot be written: No space left on device" in answer.stderr
    (saved,) = tmp_path.glob("wbc-*/r.json")
    assert f"the result is in {saved} instead" in answer.stderr.replace("\n", "")
    assert json.loads(saved.read_text())["status"] == "converged"


def test_schema(tmp_path: Path) -> None:
    printed = wbc_command("schema")
    assert printed.exit_code == 0
    schema = json.loads(printed.stdout)
    about_robots = schema["else"]["else"]
    retarget, walk, robot, pendulum = (
        schema["$defs"][branch["$ref"].rsplit("/", 1)[1]]
        for branch in (
            schema["else"]["then"], about_robots["then"], about_robots["else"], schema["then"]
        )
    )  # fmt: skip
    assert set(retarget["required"]) == {"motion", "robot"}
    assert set(walk["required"]) == {"robot", "gait"}
    assert set(robot["required"]) == {"robot", "tasks"}
    assert set(pendulum["required"]) == {"model"}
    assert wbc_command("schema", "--output", tmp_path / "s.json").exit_code == 0
    assert json.loads((tmp_path / "s.json").read_text()) == schema


def test_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = wbc_command("robots").stdout.splitlines()
    names = [line.split()[0] for line in lines]
    assert names[: len(robot_names())] == list(robot_names())
    assert names[len(robot_names()) :] == list(menagerie_names() or ("menagerie:NAME",))
    monkeypatch.setattr("wbc.robot.library._data_folders", lambda: iter(()))
    printed = wbc_command("robots").stdout.splitlines()
    missing = dict(line.split(maxsplit=1) for line in printed[: len(robot_names())])
    assert missing["hoap2_like"].endswith("hoap2_like.urdf")
    assert missing["g1"] == "not installed (pip install 'wbc[robots]')"


def test_a_robot_is_described_with_its_notes(tmp_path: Path) -> None:
    answer = wbc_command("robots", "hoap2_like")
    for words in ("hoap2_like.urdf", "floating base", "left (left_foot)", "neutral, standing"):
        assert words in answer.stdout
    assert (answer.exit_code, answer.stderr) == (0, "")
    answer = wbc_command("robots", lonely_arm(tmp_path))
    assert "fixed base" in answer.stdout
    assert "feet: none" in answer.stdout
    assert answer.stderr.count("note: arm: the base is fixed") == 1
    assert "no such file" in refused("robots", tmp_path / "none.urdf")


def test_a_run_prints_the_robots_notes_once(tmp_path: Path) -> None:
    lonely_arm(tmp_path)
    path = tmp_path / "p.yaml"
    path.write_text(
        "robot: arm.urdf\ntasks:\n  tip: {type: frame, frame: upper, control: position,"
        " target: {offset: [0, 0, 0]}}\n"
        "stop: {duration: 0.02}\n"
    )
    answer = wbc_command("run", path)
    assert answer.stderr.count("note: arm: the base is fixed") == 1
    assert wbc_command("run", path, "--quiet").stderr == ""


def test_what_the_library_warns_of_is_printed_once(tmp_path: Path) -> None:
    """A handler that swallowed all of it was attached, but only robots' notes were printed."""
    path = tmp_path / "p.yaml"
    path.write_text(
        "robot: hoap2_like\nsupport: double\ntasks: {com: {type: com, target: [0, 0, 300]}}\n"
        "stop: {duration: 0.02}\n"
    )
    for _ in range(2):  # commands in one process
        assert wbc_command("run", path).stderr.count("m away: is it in mm?") == 1
    assert wbc_command("run", path, "--quiet").stderr == ""


def lonely_arm(folder: Path) -> Path:
    path = folder / "arm.urdf"
    path.write_text(arm_of_one_joint(limit(1, 9, 2)))
    return path


def test_version_and_wrong_usage() -> None:
    assert wbc_command("--version").stdout == f"wbc {wbc.__version__}\n"
    assert wbc_command("run").exit_code == 2
    assert wbc_command("rnu").exit_code == 2
    assert wbc_command("run", "x.yaml", "--nonsense").exit_code == 2


@pytest.mark.parametrize(
    ("command", "unwanted"),
    [
        (["--help"], {"pinocchio", "numpy", "pydantic", "proxsuite"}),
        (["run", "p.yaml"], {"scipy.stats", "scipy.optimize", "matplotlib", "casadi"}),
    ],
)
def test_commands_load_only_the_libraries_that_they_use(command, unwanted, tmp_path) -> None:
    (tmp_path / "p.yaml").write_text(
        "robot: hoap2_like\nsupport: double\ntasks: {com: {type: com, target: [0, 0, 0.3]}}\n"
        "stop: {duration: 0.02}\n"
    )
    code = (
        "import sys; from wbc.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        f"print(sorted({unwanted} & set(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code, *command],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(wbc.__file__).parents[1])},
    )
    assert answer.stdout.splitlines()[-1] == "[]"


def test_python_m_wbc_is_wbc() -> None:
    answer = subprocess.run(
        [sys.executable, "-m", "wbc", "--version"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(Path(wbc.__file__).parents[1])},
    )
    assert answer.stdout == f"wbc {wbc.__version__}\n"


@pytest.mark.slow
def test_pairs_in_contact_by_design_are_listed_by_a_command_and_in_every_result(tmp_path) -> None:
    """iCub's shins stand in its feet."""
    pair, why = "l_lower_leg vs l_foot", "in contact when standing"
    answer = wbc_command("collisions", "icub")
    assert answer.exit_code == 0
    assert f"  {pair}: {why}" in answer.output
    assert "  l_hip_1 vs torso_1: " in answer.output  # watched, with finer shapes
    path = tmp_path / "p.yaml"
    path.write_text(
        "robot: icub\nsupport: floating\n"
        "tasks:\n"
        "  com: {type: com, target: {offset: [0, 0, -0.001]}}\n"
        "constraints:\n"
        "  bodies: {type: self_collision}\n"
        "stop: {duration: 0.01}\n"
    )
    output = tmp_path / "out.json"
    answer = wbc_command("run", path, "--output", output)
    told = json.loads(output.read_text())["unwatched_pairs"]
    assert told["bodies"][pair] == why
    assert all(
        reason not in ("adjacent", "disabled in the SRDF") for reason in told["bodies"].values()
    )
    assert "not watched" in answer.output


def test_layers_and_directions_of_a_picture(file, tmp_path, monkeypatch) -> None:
    views: list[View] = []
    monkeypatch.setattr("wbc.view.plot_run", lambda *_, title, view: views.append(view))
    options = ("--plot", tmp_path / "r.png", "--view-from", "left", "--show", "robot,com")
    assert wbc_command("run", file, *options).exit_code == 0
    assert views == [View.of("left", "robot,com")]
    assert "unknown layer 'legs'; did you mean 'leg'" in refused("run", file, "--show", "legs")
    assert "unknown direction to view from 'up'" in refused("run", file, "--view-from", "up")


def test_options_that_would_act_on_nothing_are_refused(file: Path, tmp_path: Path) -> None:
    for options in (("--show", "com"), ("--view-from", "top")):
        assert "are of the picture; name it with --plot" in refused("run", file, *options)
    recording = tmp_path / "m.csv"
    said = refused("analyze", recording, "--robot", "hoap2_like", "--snapshots", "3")
    assert "--snapshots: are of the picture" in said
    for other in (file, tmp_path / "r.npz"):
        told = refused("run", file, "-o", tmp_path / "r.npz", "--save-tick", other)
        assert "is the problem or an output; name another file" in told
    pendulum = "problems/rmp_spin.yaml"
    assert "this is a pendulum" in refused("run", pendulum, "-q", "--save-tick", tmp_path / "t.npz")


def test_table_given_as_a_problem_is_not_printed_whole(tmp_path: Path) -> None:
    table = tmp_path / "r.csv"
    table.write_text("time [s],x [m]\n" + "0.0,0.1\n" * 10_000)
    assert len(refused("check", table)) < 300


def test_names_of_files_that_are_no_text_are_run_saved_drawn_and_replayed(tmp_path: Path) -> None:
    """Latin-1 from an old disk; the result was refused as none, pictures were a traceback."""
    file = Path(os.fsdecode(bytes(tmp_path / "k") + b"\xe4se.yaml"))
    file.write_text(GOOD)
    saved, picture = tmp_path / "r.npz", tmp_path / "r.png"
    for output in (saved, tmp_path / "r.json"):
        assert wbc_command("run", file, "-q", "-o", output).exit_code == 0
    assert wbc_command("replay", saved).exit_code == 0
    assert wbc_command("run", file, "-q", "--plot", picture).exit_code == 0
    for problem in (file, saved):
        assert wbc_command("report", problem, "-o", tmp_path / "r.html").exit_code == 0


def test_closed_stdout_is_no_traceback(file: Path) -> None:
    line = f'exec "{sys.executable}" -m wbc run "{file}" -q >&- 2>&-'
    assert subprocess.run(["sh", "-c", line], check=False).returncode == 0


@pytest.mark.parametrize("name", ["push", "bench"])
def test_help_wraps_by_the_terminals_width_alone(name: str) -> None:
    """At 80 columns every line of 100 of the source ended in one of a word or two."""
    command = typer.main.get_command(app).get_command(None, name)
    assert "\n\n" in command.help  # paragraphs stay
    assert not re.search(r"[^\n]\n[^\n]", command.help)


def test_units_stand_in_the_help() -> None:
    """Rich takes [s] for markup and swallows it: "when it begins ."."""
    commands = typer.main.get_command(app).commands
    assert "push" in commands
    for name, command in commands.items():
        said = [command.help, *(getattr(p, "help", None) for p in command.params)]
        for text in said:
            assert not re.search(r"\[[a-zA-Z/^0-9 ]+\]", text or ""), f"wbc {name}: {text}"


def test_a_file_that_is_not_there_is_answered_with_the_one_that_is(file, monkeypatch) -> None:
    monkeypatch.chdir(file.parent)
    (file.parent / "problems").mkdir()
    (file.parent / "problems" / "walk.yaml").write_text(GOOD)
    for asked, meant in (("p.yml", "p.yaml"), ("walk.yaml", "problems/walk.yaml")):
        assert refused("run", asked) == f"{asked}: no such file; did you mean {meant}?"
    assert refused("run", "pp.yaml") == "pp.yaml: no such file; did you mean p.yaml?"
    assert refused("run", "else/where.yaml") == "else/where.yaml: no such file"


def test_what_typer_refuses_is_answered_with_what_to_write(file: Path) -> None:
    for words, meant in (
        (("run", file, "tasks.hand.gain=0.3"), "--set tasks.hand.gain=0.3"),
        (("sim", file, "a.b=1", "c.d=2"), "replaced by --set: --set a.b=1"),
        (("run", file, "--set", "tasks.hand.gain", "0.3"), "one word"),
        (("run", file, "--gain=0.3"), "No such option: --gain; values of the file are replaced"),
        (("hardware", "run", file, "a.b=1"), "--set a.b=1"),
        (("run", file, "--set"), "Option '--set' requires an argument."),
        (("walk.yaml",), "is run by: wbc run walk.yaml"),
        (("simulate", file), "did you mean 'sim'?"),
    ):
        result = wbc_command(*words)
        told = " ".join(re.sub(r"[^!-~]", " ", result.stderr).split())
        assert result.exit_code == 2
        assert meant in told and told.count("values of the file") <= 1, told
    for words in (("run", file, "--plto", "x.png"), ("run", file, file), ("init", "x", "--gain")):
        assert "--set" not in wbc_command(*words).stderr


def test_a_problem_is_no_campaign(file: Path) -> None:
    pytest.importorskip("pyarrow")
    told = refused("batch", file)
    assert "is a problem, not a campaign of problems: wbc run" in told and "\n" not in told


def test_versions_the_core_and_its_distance_from_pinocchio_are_said() -> None:
    answer = wbc_command("doctor")
    assert answer.exit_code == 0, answer.output
    assert "cffi " in answer.output and "pin 4" in answer.output
    assert re.search(r"core: \S*_core\S*\.so", answer.output)
    apart = re.search(r"against Pinocchio on hoap2_like: (\S+)", answer.output)
    assert apart is not None and 0.0 < float(apart[1]) < 1e-11  # rounding, of sums in another order


def test_a_core_that_is_wrong_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * (1 + 1e-3))
    answer = wbc_command("doctor")
    assert answer.exit_code == 1
    assert "'hoap2_like': the compiled core and Pinocchio" in " ".join(answer.stderr.split())


@pytest.mark.slow
def test_what_is_kept_is_told_and_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    robot = wbc.Robot.load("hoap2_like")
    wbc.SelfCollision(robot)
    kept = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert kept
    (tmp_path / "mine.txt").write_text("not of the package")
    told = wbc_command("cache")
    assert told.exit_code == 0 and "MB kept" in told.output and str(tmp_path) in told.output
    assert all(file.exists() for file in kept)
    assert "MB deleted" in wbc_command("cache", "--clear").output
    assert not any(file.exists() for file in kept) and (tmp_path / "mine.txt").exists()
    wbc.SelfCollision(robot)  # made again
    monkeypatch.setenv(CACHE_VARIABLE, "off")
    assert "nothing is kept" in wbc_command("cache", "--clear").output
