"""``wbc replay``: recorded runs and saved ticks, once more."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.test_app import GOOD, refused, wbc_command
from wbc.problem import load_problem
from wbc.problem.replay import replay_run

TORQUE = """\
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  com: {type: com, target: start}
  posture: {type: posture, target: start, weight: 0.1}
controller: {level: torque, dt: 0.004}
simulation:
  duration: 0.3
  pushes: [{impulse_ratio: 4.0, angle: 0.0, at: 0.02, duration: 0.05}]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "p.yaml"
    path.write_text(GOOD)
    return path


def test_a_recorded_run_is_the_same_and_a_changed_one_is_not(file: Path, tmp_path: Path) -> None:
    npz, summary = tmp_path / "r.npz", tmp_path / "r.json"
    assert wbc_command("run", file, "-q", "-o", npz, "-o", summary).exit_code == 0
    file.unlink()  # the text is in the result
    for path, what in ((npz, "ticks and the summary"), (summary, "the summary")):
        answer = wbc_command("replay", path)
        assert (answer.exit_code, answer.stderr) == (0, "")
        assert f"{what}: the same to the last bit" in answer.stdout
    arrays = dict(np.load(npz))
    arrays["q"][7, 9] = np.nextafter(arrays["q"][7, 9], 9.0)  # one bit
    np.savez(npz, **arrays)
    answer = wbc_command("replay", npz)
    assert answer.exit_code == 3
    assert "not the same: q: from tick 7 on" in answer.stdout
    np.savez(npz, **{**arrays, "time": np.array(0.0)})
    assert "time: expected a row of times, got ()" in refused("replay", npz)
    data = json.loads(summary.read_text())
    data["final"]["com"][0] += 1e-15
    data["versions"]["numpy"] = "1.0"
    summary.write_text(json.dumps(data))
    again = replay_run(summary)
    assert again.differences == ("final.com: another list",)
    assert again.versions[0].startswith("numpy 1.0, here ")
    assert wbc_command("replay", summary, "-q").stdout == ""


@pytest.mark.parametrize("level", ["velocity", "torque"])
def test_an_interrupted_run_is_compared_by_its_ticks(level: str, tmp_path: Path) -> None:
    npz, asked = tmp_path / "r.npz", iter(range(999))
    path = tmp_path / "p.yaml"
    path.write_text(TORQUE if level == "torque" else GOOD)
    if level == "torque":
        pytest.importorskip("mujoco")
    problem = load_problem(path)
    begin = problem.simulate if level == "torque" else problem.run
    result = begin(cancelled=lambda: next(asked) >= 3)
    assert result.status.value == "interrupted"
    result.save(npz)
    answer = wbc_command("replay", npz)
    assert answer.exit_code == 0, answer.stdout
    ticks = result.summary()["ticks"]
    assert f"{ticks} ticks until the interruption: the same" in answer.stdout
    begin().save(tmp_path / "whole.npz")
    asked = iter(range(999))
    again = replay_run(tmp_path / "whole.npz", cancelled=lambda: next(asked) >= 5)
    assert again.same and 0 < again.ticks < 10
    result.save(tmp_path / "r.json")
    assert "only its ticks can be compared" in refused("replay", tmp_path / "r.json")


def test_a_tick_that_gives_way_is_saved_and_asked_for_again(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    problem, tick = tmp_path / "p.yaml", tmp_path / "t.tick"
    problem.write_text(TORQUE)
    answer = wbc_command("sim", problem, "-q", "--save-tick", tick)
    assert answer.stderr.startswith("note: t = 0.")
    assert f"wbc replay {tick}" in answer.stderr
    again = wbc_command("replay", tick)
    assert again.exit_code == 0
    told = again.stdout.splitlines()
    assert "TorqueController('hoap2_like'" in told[0]
    assert told[1].startswith("answered  not everything could be kept")
    assert told[2] == "again     the same to the last bit"


def test_a_tick_or_stream_that_cannot_be_written_leaves_the_run_its_result(
    file: Path, tmp_path: Path, monkeypatch
) -> None:
    pytest.importorskip("mujoco")
    rerun = pytest.importorskip("rerun")
    problem, tick, out = tmp_path / "p.yaml", tmp_path / "t.tick", tmp_path / "out.json"
    problem.write_text(TORQUE)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", str(tick))

    def shut(*_: object, **__: object) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")

    monkeypatch.setattr("wbc.controllers.tick.Tick.save", full)
    monkeypatch.setattr(rerun.RecordingStream, "flush", shut)  # what it says of a full disk
    stream = tmp_path / "full.rrd"
    answer = wbc_command(
        "sim", problem, "-q", "-o", out, "--save-tick", tick, "--stream", f"rerun:{stream}"
    )
    assert answer.exit_code == 1
    told = answer.stderr.splitlines()
    assert told[0] == f"error: --save-tick {tick}: cannot be written: No space left on device"
    assert told[1].startswith(f"error: --stream rerun:{stream}: Rerun: {stream}: not all was sent:")
    assert json.loads(out.read_text())["format"] == "wbc result 1"


def test_what_cannot_be_replayed_is_one_line(file: Path, tmp_path: Path) -> None:
    assert "No such file" in refused("replay", tmp_path / "none.npz")
    assert "not the result of a run" in refused("replay", file)
    assert "--code: only for a saved tick" in refused("replay", file, "--code", file)
    (tmp_path / "x.tick").write_bytes(b"\xff\x00 no")
    assert "neither a result nor a saved tick" in refused("replay", tmp_path / "x.tick")
    assert "there is no folder" in refused("run", file, "--save-tick", tmp_path / "a" / "b")
