"""Results as files: strict JSON, NumPy archives, and never half of either."""

import json
from pathlib import Path

import numpy as np
import pytest

import wbc
from tests.problem.loading import problem_of
from wbc.errors import InvalidInputError
from wbc.problem import Result
from wbc.run.saving import json_text

TEXT = """\
robot: hoap2_like
support: left
tasks:
  shape: {type: inertia, components: [xx, xy], frame: base, target: {scale: 1.1}}
  size: {type: inertia, components: principal, target: {scale: 1.1}, weight: 0.1}
  left hand: {type: frame, frame: left_hand, control: pose, target: start}
stop: {duration: 0.1, balance: null}  # on one foot, the CoM in the middle
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return problem_of(tmp_path_factory.mktemp("run"), TEXT, {"tasks.shape.gain": 0.2}).run()


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def test_json_says_what_the_result_says(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.json")
    text = (tmp_path / "r.json").read_text()
    data = json.loads(text, parse_constant=refuse_constant)
    assert data["status"] == result.status.value == "timeout"
    assert data["ticks"] == 20
    np.testing.assert_array_equal(data["final"]["q"], result.q)
    assert list(data["final"]["joints"]) == list(result.robot.joint_names)
    np.testing.assert_array_equal(list(data["final"]["joints"].values()), result.q[7:])
    shape = data["inertia"]["shape"]
    assert shape["components"] == ["xx", "xy"]
    reached = result.robot.snapshot(result.q).inertia_in("base")[0, :2]
    np.testing.assert_allclose(shape["reached"], reached, atol=1e-15)
    np.testing.assert_allclose(shape["wanted"], 1.1 * np.array(shape["start"]), rtol=1e-12)
    assert data["inertia"]["size"]["axes"] == "principal"
    assert data["tasks"]["shape"]["rows"] == ["xx", "sqrt(2) xy"]
    assert data["tasks"]["left hand"]["units"] == ["m"] * 3 + ["rad"] * 3
    assert data["tasks"]["left hand"]["norm"] == result.tasks["left hand"].norm
    assert data["slip"]["frame"] == "left_sole"
    assert data["slip"]["largest"] == result.slip.value
    assert data["joint_limits"]["joint"] in result.robot.joint_names
    assert data["qp"]["failed_ticks"] == 0
    assert 0.0 < data["tick_time"]["wall"]["median"] <= data["tick_time"]["wall"]["p99"]
    assert data["problem"]["text"] == TEXT
    assert data["problem"]["overrides"] == {"tasks.shape.gain": 0.2}
    assert data["versions"]["wbc"] == wbc.__version__


def test_npz_holds_summary_and_histories(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.npz")
    result.save(tmp_path / "r.json")
    with np.load(tmp_path / "r.npz") as archive:  # allow_pickle is off
        assert json.loads(str(archive["summary"])) == json.loads((tmp_path / "r.json").read_text())
        arrays = {name: archive[name] for name in archive.files if name != "summary"}
    expected = result.history.arrays()
    assert tuple(arrays.pop("joint_names")) == result.robot.joint_names
    assert set(arrays) == set(expected)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, expected[name])
    assert arrays["errors/left hand"].shape == (20, 6)
    assert arrays["task_inertia/shape"].shape == (20, 6)
    assert arrays["slip/left_sole"].shape == (20,)


def test_what_is_not_finite_is_null_and_lists_are_short() -> None:
    values = {"a": [1.0, float("nan"), [2, float("inf")]], "b": -float("inf"), "c": "[\n1,\n 2]"}
    text = json_text(values)
    data = json.loads(text, parse_constant=refuse_constant)
    assert data == {"a": [1.0, None, [2, None]], "b": None, "c": "[\n1,\n 2]"}
    assert '"a": [' in text
    assert "[2, null]" in text


@pytest.mark.parametrize("name", ["r.txt", "r", "r.yaml"])
def test_other_endings_are_refused(result: Result, tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"\.json \(summary\), \.npz"):
        result.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_save_leaves_the_old_file(result, tmp_path, monkeypatch) -> None:
    file = tmp_path / "r.npz"
    file.write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OSError, match="No space left"):
        result.save(file)
    assert file.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"]
