"""``wbc push``: end to end, ended and gone on with, and refused."""

import json
from pathlib import Path

import pytest
from typer.testing import Result

from tests.command import signalling, wbc_command
from tests.texts import STAND
from wbc.cli.push import ratios_of
from wbc.errors import InvalidInputError
from wbc.problem.pushed_problem import PushedProblem

PUSHED = STAND + "simulation: {duration: 1.0}\n"
GRID = ("--directions", 2, "--ratios", "0.4,3.0", "--workers", 1)


def run(folder: Path, *options: object, text: str = PUSHED) -> Result:
    path = folder / "stand.yaml"
    path.write_text(text)
    return wbc_command("push", path, *options)


@pytest.mark.parametrize(
    ("text", "ratios"),
    [
        ("0.8:2.0:0.1", [round(0.8 + 0.1 * k, 9) for k in range(13)]),
        ("1:1.25:0.1", [1.0, 1.1, 1.2]),
        ("1.5:1.5:0.1", [1.5]),
        ("1.0,1.2,1.5", [1.0, 1.2, 1.5]),
    ],
)
def test_ratios(text: str, ratios: list[float]) -> None:
    assert ratios_of(text) == ratios


@pytest.mark.parametrize("text", ["", "1:2", "a:b:c", "0:2:0.1", "2:1:0.1", "1:2:0", "1:2:1e-9"])
def test_what_are_no_ratios_is_said(text: str) -> None:
    with pytest.raises(InvalidInputError, match="--ratios"):
        ratios_of(text)


@pytest.mark.slow
def test_pushed_written_and_drawn(tmp_path: Path) -> None:
    places = [tmp_path / f"r.{ending}" for ending in ("json", "npz", "csv")]
    result = run(
        tmp_path,
        *GRID,
        *(word for place in places for word in ("-o", place)),
        "--plot",
        tmp_path / "r.png",
    )
    assert result.exit_code == 0, result.output
    assert "survives 0.40 (least) and 0.40 (mean) M omega d" in " ".join(result.stdout.split())
    told = json.loads(places[0].read_text())
    assert [one["limit"] for one in told["maps"][0]["directions"]] == [0.4, 0.4]
    assert all(place.exists() for place in places)
    assert (tmp_path / "r.png").stat().st_size > 10_000
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["json", "npz"])
def test_pushes_of_an_output_are_not_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    place, once = tmp_path / f"r.{ending}", (*GRID[:3], "0.4", *GRID[4:])
    tried = signalling(monkeypatch, PushedProblem, "__call__", 100)
    assert run(tmp_path, *once, "-o", place).exit_code == 0 and len(tried) == 2
    first, before = run(tmp_path, *GRID, "-o", place), place.read_bytes()
    assert first.exit_code == 0 and len(tried) == 4  # those of the larger grid
    again = run(tmp_path, *GRID, "-o", place)
    assert again.exit_code == 0 and len(tried) == 4 and place.read_bytes() == before
    assert f"r.{ending} has 4 pushes of this grid already;" in " ".join(again.stderr.split())
    smaller = run(tmp_path, *once, "-o", place)
    assert "has 2 pushes of this grid and 2 beside it already" in " ".join(smaller.stderr.split())
    assert run(tmp_path, *GRID, "-o", place).exit_code == 0 and len(tried) == 4  # none was lost
    assert place.read_bytes() == before
    other = run(tmp_path, *once, "-o", place, "--duration", 0.05)  # not those of another push
    assert other.exit_code == 0 and len(tried) == 6
    place.write_bytes(b"[]")
    assert run(tmp_path, *once, "-o", place).exit_code == 0 and len(tried) == 8


@pytest.mark.slow
def test_who_is_not_at_rest_without_a_push_either_is_told(tmp_path: Path) -> None:
    text = STAND + "simulation: {duration: 0.25, start: {velocity: [0.4, 0, 0]}}\n"
    grid = ("--directions", 1, "--ratios", "3.0", "--workers", 1, "--at", 0.05)
    told = run(tmp_path, *grid, text=text)
    assert told.exit_code == 0
    assert "stand: nor does it survive without any push: not at rest in the end" in told.stderr
    assert "without any push" not in run(tmp_path, *GRID).stderr


@pytest.mark.slow
def test_ended_by_ctrl_c_it_goes_on_and_comes_to_the_same(tmp_path, monkeypatch) -> None:
    whole = tmp_path / "whole.json"
    assert run(tmp_path, *GRID, "-o", whole, "-q").exit_code == 0
    tried = signalling(monkeypatch, PushedProblem, "__call__", 2)
    parts = tmp_path / "parts.json"
    ended = run(tmp_path, *GRID, "-o", parts)
    assert ended.exit_code == 130
    assert "the same command goes on" in ended.output and "pushed in part" in ended.output
    assert not parts.exists() and len(tried) == 2
    assert len((tmp_path / "parts.json.partial").read_text().splitlines()) == 3

    other = run(tmp_path, *GRID, "-o", parts, "--duration", 0.05)
    assert other.exit_code == 1 and "push differs" in " ".join(other.output.split())
    assert run(tmp_path, *GRID, "-o", parts, "-q").exit_code == 0
    assert len(tried) == 4  # two in all, the two others now
    assert parts.read_text() == whole.read_text()
    assert not (tmp_path / "parts.json.partial").exists()


@pytest.mark.slow
def test_ended_without_an_output_it_goes_on_too(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    tried = signalling(monkeypatch, PushedProblem, "__call__", 1)
    ended = run(tmp_path, *GRID)
    assert ended.exit_code == 130
    said = " ".join(ended.stdout.split())
    assert "survives at least 0.40 (least) and 0.40 (mean) M omega d, in the 1 of 2" in said
    assert "untried" in said
    (kept,) = tmp_path.glob("stand-*.push.partial")
    assert kept.name in " ".join(ended.stderr.split())
    other = run(tmp_path, *GRID, "--duration", 0.05)  # another campaign, which is not in the way
    assert other.exit_code == 0 and len(tried) == 5
    again = run(tmp_path, *GRID)
    assert again.exit_code == 0 and len(tried) == 8
    assert f"goes on with what is in {kept.name}, pushes: 1" in again.stderr
    assert "survives 0.40 (least) and 0.40 (mean) M omega d" in " ".join(again.stdout.split())
    assert not list(tmp_path.glob("*.partial"))


@pytest.mark.slow
def test_compared_with_another_problem(tmp_path: Path) -> None:
    stiff = tmp_path / "stiff.yaml"
    stiff.write_text(PUSHED.replace("duration: 1.0", "duration: 0.8"))
    result = run(
        tmp_path, "--directions", 1, "--ratios", "0.3", "--compare", stiff, "--workers", 1,
        "--plot", tmp_path / "r.svg", "-o", tmp_path / "r.json",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "stand survives 1.00 times what stiff does" in " ".join(result.stdout.split())
    told = json.loads((tmp_path / "r.json").read_text())
    assert [one["problem"] for one in told["maps"]] == ["stand", "stiff"]
    assert told["compared"]["times"] == [1.0]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--directions", 0), "directions"),
        (("--ratios", "2:1:0.1"), "--ratios"),
        (("-o", "r.txt"), "r.txt"),
        (("--plot", "r.txt"), "r.txt"),
        (("--body", "nobody"), "nobody"),
        (("--at", 5.0), "before the push is over"),
    ],
)
def test_bad_input(tmp_path: Path, options: tuple[object, ...], text: str) -> None:
    result = run(tmp_path, *options)
    assert result.exit_code == 1
    assert text in " ".join(result.output.split())
