"""Films by the command line: of results and of problems."""

import signal
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from tests.command import wbc_command
from tests.texts import STAND
from tests.urdf import arm_of_one_joint, limit
from wbc.problem import load_problem
from wbc.view.film import Film
from wbc.view.options import View

WAVE = """\
robot: hoap2_like
support: double
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0, 0, 0.01]}}
stop: {duration: 0.1, speed: null}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "wave.yaml"
    path.write_text(WAVE)
    return path


@pytest.fixture
def films(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    made: list[dict[str, Any]] = []

    def film(robot: object, history: object, path: Path, **named: Any) -> None:
        made.append({"ticks": len(history), **named})  # type: ignore[arg-type]

    monkeypatch.setattr("wbc.view.film.film_run", film)
    return made


def render(*arguments: object) -> Result:
    return wbc_command("render", *arguments)


def test_of_a_result_and_of_a_problem(file: Path, films: list[dict[str, Any]]) -> None:
    saved, film = file.with_suffix(".npz"), file.with_suffix(".gif")
    load_problem(file).run().save(saved)
    look = ("--speed", "0.5", "--fps", "10", "--size", "200x300", "--view-from", "left")
    answer = render(saved, "-o", film, *look)
    assert answer.exit_code == 0, answer.stderr
    assert answer.stdout == f"written  {film}\n"
    assert render(file, "-o", film, "-q").exit_code == 0
    first, second = films
    assert (first["ticks"], second["ticks"]) == (20, 20)
    assert first["title"] == "wave: completed"
    assert (first["speed"], first["fps"], first["size"]) == (0.5, 10, (200, 300))
    assert first["view"] == View.of("left")


def test_shapes_that_are_left_out_are_told(tmp_path: Path, films: list[dict[str, Any]]) -> None:
    gone = "<visual><geometry><mesh filename='gone.stl'/></geometry></visual>"
    (tmp_path / "arm.urdf").write_text(
        arm_of_one_joint(limit()).replace("</link>", gone + "</link>")
    )
    path = tmp_path / "arm.yaml"
    path.write_text(
        "robot: {model: arm.urdf, base: fixed}\n"
        "tasks: {posture: {type: posture, target: {j: 0.1}}}\nstop: {duration: 0.05, speed: null}\n"
    )
    load_problem(path).run().save(tmp_path / "r.npz")
    for source in (path, tmp_path / "r.npz"):
        told = wbc_command("render", source, "-o", tmp_path / "f.gif")
        assert "2 visual meshes not found and left out: gone.stl" in told.stderr
        assert not wbc_command("render", source, "-q", "-o", tmp_path / "f.gif").stderr
    assert len(films) == 4


def test_a_film_ended_by_sigterm_leaves_nothing_behind(file, monkeypatch) -> None:
    def draw(film: Film, row: int) -> None:
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(Film, "draw", draw)
    answer = render(file, "-o", file.with_suffix(".gif"), "-q")
    assert (answer.exit_code, answer.stderr) == (143, "error: interrupted\n")
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_mistakes_are_told_before_any_work(file: Path, films: list[dict[str, Any]]) -> None:
    film = file.with_suffix(".gif")
    for arguments, words in (
        ((file, "-o", "a.avi"), "written as .gif"),
        ((file, "-o", film, "--size", "large"), "expected width x height"),
        ((file, "-o", film, "--show", "legs"), "did you mean 'leg'"),
        ((file, "-o", file.parent / "no" / "a.gif"), "there is no folder"),
        ((file.with_suffix(".npz"), "-o", film), "cannot be read"),
        ((file, "-o", film, "--robot", "g1"), "--robot: only for"),
    ):
        answer = render(*arguments)
        assert answer.exit_code == 1
        assert words in answer.stderr, answer.stderr
    assert films == []


def test_of_a_pendulum_and_of_a_simulation(tmp_path, films, monkeypatch) -> None:
    def film(history: Any, path: Path, **named: Any) -> None:
        films.append({"ticks": len(history.time), **named})

    monkeypatch.setattr("wbc.view.pendulum_film.film_pendulum", film)
    pendulum = Path(__file__).parents[2] / "problems" / "rmp_spin.yaml"
    stand = tmp_path / "stand.yaml"
    stand.write_text(STAND + "simulation: {duration: 0.02, terrain: {slope: [0.05, 0]}}\n")
    for problem in (pendulum, stand):
        answer = render(problem, "-o", tmp_path / "a.gif", "-q")
        assert answer.exit_code == 0, answer.stderr
    spun, stood = films
    assert (spun["title"], stood["title"]) == ("rmp_spin: completed", "stand: stood")
    assert stood["ticks"] == 11  # states: one more than ticks
    assert stood["terrain"].slope == (0.05, 0.0)


@pytest.mark.parametrize("verb", ["render", "report", "export", "view", "run"])
def test_the_summary_of_a_result_is_told_from_a_problem(file: Path, verb: str) -> None:
    """`make demo` writes one; read as a problem it had 22 mistakes."""
    summary = file.with_name("result.json")
    load_problem(file).run().save(summary)
    ending = {"render": ".gif", "report": ".html", "export": ".mcap", "run": ".npz"}.get(verb)
    output = ("-o", str(file.with_suffix(ending))) if ending else ()
    answer = wbc_command(verb, summary, *output)
    assert answer.exit_code == 1
    said = answer.stderr
    assert said.count("\n") == 1
    assert "result.json: is the summary of a result, not a problem, and holds no motion" in said
    assert f"wbc run {file} -o {summary.with_suffix('.npz')}" in said
