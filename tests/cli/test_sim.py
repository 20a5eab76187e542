"""``wbc sim`` as a user meets it: what it prints and writes, and exit codes."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.command import wbc_command
from tests.texts import STAND
from tests.urdf import stone
from wbc.cli.sim_report import _tracking
from wbc.controllers.closed_loop import LoopTick
from wbc.problem import History
from wbc.simulation import Terrain
from wbc.tracking.deviation import Deviation, PlanTracking

PUSHED = (
    STAND
    + """\
simulation:
  duration: 0.3
  pushes: [{impulse_ratio: 0.5, angle: 1.5, at: 0.1}]
"""
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "push.yaml"
    path.write_text(PUSHED)
    return path


def test_what_holds_it_back_is_named(file: Path) -> None:
    """A margin held a walk's hips half of the time and its trunk askew, without a word."""
    said = " ".join(wbc_command("sim", file).stdout.split())
    assert re.search(r"held back by right_sole corner 1 friction at 270 deg for 0\.1\d s, ", said)


@pytest.mark.slow
def test_it_stands_and_writes_what_others_read(file: Path, tmp_path: Path) -> None:
    npz, summary, table = (tmp_path / f"push.{end}" for end in ("npz", "json", "csv"))
    picture = tmp_path / "push.png"
    done = wbc_command("sim", file, "-o", npz, "-o", summary, "-o", table, "--plot", picture)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("stood for 0.300 s (150 ticks)")
    for words in ("push", "N s on base from 0.1 s for 0.1 s", "gave way", "CoP", "trunk", "torque"):
        assert words in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = json.loads(summary.read_text())
    assert found["status"] == "stood" and found["simulation"]["relaxed"] == 0.0
    arrays = np.load(npz)
    assert arrays["torque"].shape == (151, len(arrays["joint_names"]))
    assert len(table.read_text().splitlines()) == 152
    for recording in (npz, table):
        again = wbc_command("analyze", recording, "--robot", "hoap2_like")
        assert again.exit_code == 0, again.output
        assert "CoP inside the support" in again.stdout


def test_known_forces_and_lost_frames_are_said(file: Path) -> None:
    wrench = "{frame: base, force: [0, 5, 0], at: 0.1, duration: 0.05, told: false}"
    done = wbc_command(
        *("sim", file, "--set", "simulation.duration=0.2", "--set", "simulation.pushes=[]"),
        *("--set", f"simulation.wrenches=[{wrench}]"),
        *("--set", "simulation.sensors={dropout: 0.2, seed: 1}"),
    )
    assert done.exit_code == 0, done.output
    said = " ".join(done.stdout.split())
    assert "[0, 5, 0] N, [0, 0, 0] N m on base from 0.1 to 0.15 s, not told to the" in said
    lost = re.search(r"sensors (\d+) of 100 frames lost", said)
    assert lost and 8 <= int(lost[1]) <= 35  # 20 of 100, and five deviations


def test_a_fall_is_exit_code_three(file: Path) -> None:
    strong = "simulation.pushes[0].impulse_ratio=4", "simulation.duration=2"
    done = wbc_command("sim", file, "--set", strong[0], "--set", strong[1])
    assert done.exit_code == 3, done.output
    assert done.stdout.startswith("fell at t = ")
    assert "of the ticks: " in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sim", "--set", "simulation.duraton=1"), "simulation.duraton: unknown key; did you mean"),
        (("sim", "--set", "controller.level=velocity"), "belongs to the torque level"),
        (("sim", "--output", "push.txt"), "push.txt: a result is written as .json"),
        (("run",), "controller.level is torque: torques move a robot by physics"),
    ],
)
def test_bad_input_is_exit_code_one(file: Path, arguments: tuple[str, ...], words: str) -> None:
    done = wbc_command(arguments[0], file, *arguments[1:])
    assert done.exit_code == 1
    assert words in done.stderr
    assert "Traceback" not in done.output


def test_it_can_be_watched(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the page is given; that it shows it is tested with the viewer."""
    seen: list[object] = []

    class Page:
        url = "http://localhost:1"

        def wait(self) -> None:
            seen.append("waited")

    class RunViewer:
        viewer = Page()

        def __init__(self, robot: object, *, title: str, terrain: Terrain) -> None:
            seen.append((title, terrain.slope))

        def show(self, now: LoopTick, _: object) -> None:
            seen.append(round(now.time, 6))

        def replay(self, history: History) -> None:
            seen.append(len(history))

    monkeypatch.setattr("wbc.view.live.run_viewer.RunViewer", RunViewer)
    sloped = "simulation.terrain={slope: [0.05, 0]}"
    done = wbc_command("sim", file, "--view", "--set", "simulation.duration=0.15", "--set", sloped)
    assert done.exit_code == 0, done.output
    assert (seen[0], *seen[-2:]) == (("push", (0.05, 0.0)), 75, "waited")
    assert seen[1:-2] == [round(0.002 * k, 6) for k in range(75)]
    assert "played again at http://localhost:1" in done.stderr


@pytest.mark.parametrize("peak", [0.0, 1e-9])
def test_a_plan_whose_quantity_stays_has_no_peak_to_compare_with(peak: float) -> None:
    """A hop straight up has the momentum of rounding: it was missed by "1.88e+08 % of its peak"."""
    com, flat = Deviation(1e-3, 2e-3, 0.1, 0.01), Deviation(0.4, 0.9, 0.1, peak)
    table = _tracking(PlanTracking(com, com, flat, flat, 0.0, 1.0, 1.0, {}))
    assert list(table.columns[-1].cells) == ["10 %", "10 %", "it has none", "it has none"]


def test_a_robot_of_one_body_is_told_of(tmp_path: Path) -> None:
    (tmp_path / "body.urdf").write_text(stone())
    path = tmp_path / "body.yaml"
    path.write_text(
        "robot: {model: body.urdf, base: floating}\n"
        "support: floating\n"
        "tasks:\n  com: {type: com, target: {offset: [0, 0, 0]}}\n"
        "controller: {level: torque}\n"
        "simulation: {duration: 0.02}\n"
    )
    done = wbc_command("sim", path)
    assert "no joint has a bound" in done.output, done.output
