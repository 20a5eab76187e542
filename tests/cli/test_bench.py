"""``wbc bench``: recorded, measured, written, compared and refused."""

import json
from pathlib import Path

import pytest
from qpbench.sequence import load_sequence
from typer.testing import CliRunner, Result

from tests.needs import BROWSER, SOFTWARE, needs_browser
from wbc.cli import app

SMALL = ("--job", "arm", "--ticks", 5, "--repeats", 3,
         "--solver", "active_set", "--solver", "proxqp")  # fmt: skip


def run(*options: object) -> Result:
    return CliRunner(env={"OMP_NUM_THREADS": "1"}).invoke(app, ["bench", *map(str, options)])


@pytest.mark.slow
def test_recorded_measured_written_and_compared(tmp_path: Path) -> None:
    places = [tmp_path / f"b.{ending}" for ending in ("json", "md", "html", "png")]
    folder = tmp_path / "sequences"
    result = run(
        *SMALL, "--sequences", folder, *(word for one in places for word in ("-o", one)),
        "--eps", 1e-3, "--eps", 1e-8,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "records arm velocity smooth" in result.output and "active_set" in result.stdout
    (file,) = folder.iterdir()
    assert len(load_sequence(file).qps) == 5
    told = json.loads(places[0].read_text())
    assert set(told["accuracies"]) == {"0.001", "1e-08"}
    assert told["accuracies"]["1e-08"]["solvers"]["active_set"]["all"]["success"] == 1.0
    page = places[1].read_text()
    assert "### All sequences, accuracy 0.001" in page and "| proxqp |" in page
    assert "| arm velocity smooth | 12 | 6 | 0 |" in page
    assert "data:image/png;base64," in places[2].read_text()
    assert places[3].stat().st_size > 5_000  # drawn coarsely

    slow = json.loads(places[0].read_text())
    for solver in ("active_set", "proxqp"):
        one = slow["accuracies"]["1e-08"]["solvers"][solver]["sequences"]["arm velocity smooth"]
        # A thousand times faster or slower than now: no noise of this machine.
        factor = 1e-3 if solver == "active_set" else 1e3
        one["passes"] = [factor * time for time in (1e-4, 1e-4, 1e-4)]
        one["reference"] = [1e-3, 1e-3, 1e-3]
    old = tmp_path / "old.json"
    old.write_text(json.dumps(slow))
    compared = run(*SMALL, "--sequences", folder, "--eps", 1e-8, "--compare", old)
    assert compared.exit_code == 3, compared.output
    lines = {line.split()[0]: line for line in compared.stdout.splitlines() if "1e-08 " in line}
    assert lines["active_set"].endswith("slower") and lines["proxqp"].endswith("faster")


@pytest.mark.slow
@needs_browser
def test_its_page_is_read_on_a_telephone(tmp_path: Path) -> None:
    """Tables scroll; it was laid out for a screen and shown at a quarter of its size."""
    playwright = pytest.importorskip("playwright.sync_api")
    page = tmp_path / "b.html"
    assert run("--job", "arm", "--ticks", 2, "--repeats", 1, "-o", page).exit_code == 0
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=list(SOFTWARE))
        size = {"width": 420, "height": 800}
        tab = browser.new_context(offline=True, viewport=size, is_mobile=True).new_page()
        tab.goto(page.as_uri())
        widths = tab.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        browser.close()
    assert widths == [420, 420]


def test_a_page_with_a_place_for_it_keeps_the_rest(tmp_path: Path) -> None:
    page = tmp_path / "RESULTS.md"
    page.write_text("# Ours\n\n<!-- solvers -->\nof yesterday\n<!-- /solvers -->\n\nby hand\n")
    for _ in range(2):
        assert run(*SMALL, "--quiet", "-o", page).exit_code == 0
    text = page.read_text()
    assert text.startswith("# Ours\n\n<!-- solvers -->\n\n## Solvers\n")
    assert text.endswith("<!-- /solvers -->\n\nby hand\n")
    assert "yesterday" not in text and text.count("### All sequences") == 1


def test_a_problem_file_is_recorded(tmp_path: Path) -> None:
    problem = tmp_path / "stand.yaml"
    problem.write_text(
        "robot: hoap2_like\nsupport: double\n"
        "tasks: {posture: {type: posture, weight: 1.0}, com: {type: com, target: start}}\n"
        "controller: {level: torque, solver: active_set}\nsimulation: {duration: 0.05}\n"
    )
    output = tmp_path / "b.json"
    lean = Path(__file__).parents[2] / "problems" / "rmp_static_lean.yaml"
    result = run(
        problem, lean, "--ticks", 4, "--repeats", 1, "--solver", "active_set", "-o", output,
        "--qpbenchmark", tmp_path / "set",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "rmp_static_lean.yaml: a pendulum's problem" in " ".join(result.output.split())
    (about,) = json.loads(output.read_text())["sequences"].values()
    assert (about["level"], about["QPs"], about["equalities"]) == ("torque", 4, 18)
    assert (tmp_path / "set" / "wbc_sequences.py").exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--job", "nobody"), "no job has that"),
        (("-o", "b.txt"), ".json, .md"),
        ((*SMALL[:-1], "nosuch"), "unknown solver of wbc bench 'nosuch'"),
        (("--compare", "nothing.json"), "cannot be read"),
        (("--sequences", "."), "has no file"),
        (("problems/rmp_static_lean.yaml",), "pendulum"),
    ],
)
def test_bad_input(tmp_path, monkeypatch, options, told) -> None:
    (tmp_path / "problems").symlink_to(Path(__file__).parents[2] / "problems")
    monkeypatch.chdir(tmp_path)
    result = run(*options)
    assert result.exit_code == 1 and told in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("text", "told"), [("{", "is not what"), ('{"format": "wbc bench 9"}', "'wbc bench 9', and")]
)
def test_figures_that_are_none(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "old.json"
    path.write_text(text)
    result = run("--compare", path)
    assert result.exit_code == 1 and told in " ".join(result.output.split())
