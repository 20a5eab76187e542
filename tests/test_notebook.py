"""What notebooks show, and results as data frames and Parquet files."""

import io
import json
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import wbc
from tests.problem.loading import problem_of
from wbc import extras
from wbc.errors import MissingPackageError, listed
from wbc.notebook import as_html
from wbc.problem import load_problem
from wbc.robot import Robot

PROBLEMS = Path(__file__).parents[1] / "problems"
STAND = """\
robot: hoap2_like
start: {posture: standing}
support: double
tasks: {com: {type: com, target: start}, posture: {type: posture, weight: 0.1}}
controller: {level: torque, dt: 0.004}
simulation: {duration: 0.05}
"""


class Cells(HTMLParser):
    """Takes what an HTML table says apart; tags must match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.pictures: list[bytes] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str]]) -> None:
        self.open.append(tag)
        if tag == "img":
            self.pictures.append(b64decode(dict(attrs)["src"].partition("base64,")[2]))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_names_are_text_and_long_lists_end() -> None:
    rows = [(f"<b>{k}", "1 & 2") for k in range(20)]
    told = Cells(as_html("a <title>", [("empty", "")], rows)).words
    assert told[:3] == ["a <title>", "<b>0", "1 & 2"]
    assert "empty" not in told and told[-1] == "and 8 more"
    assert listed("abcdef", 4) == "a, b, c, d and 2 more" and listed("ab") == "a, b"


def test_robot_and_ticks_show_what_one_asks_first(hoap2: Robot) -> None:
    shown = Cells(hoap2._repr_html_())
    assert {"7.10 kg", "left, right", "floating"} <= set(shown.words) and is_drawn(shown)
    start = hoap2.snapshot(hoap2.posture("standing"))
    tasks = [wbc.ComTask(hoap2, start.com + (0.1, 0, 0)), wbc.PostureTask(hoap2, start.q)]
    for kind in (wbc.KinematicController, wbc.TorqueController):
        controller = kind(hoap2, tasks, contacts=wbc.support(start, "double"))
        told = Cells(controller.step(start)._repr_html_()).words
        assert told[0].endswith("Tick: solved")
        assert "[-0.1  0.   0. ]" in told[told.index("error of com") + 1]


@pytest.fixture(scope="module")
def result() -> wbc.run.Result:
    return load_problem(PROBLEMS / "astronaut_expand.yaml", {"stop.duration": 0.05}).run()


def is_drawn(shown: Cells) -> bool:
    """Return whether there is one picture, and something is on it."""
    image = pytest.importorskip("matplotlib.image")
    (png,) = shown.pictures
    return image.imread(io.BytesIO(png), "png")[..., :3].std() > 0.02


def test_results_show_themselves(result) -> None:
    shown = Cells(result._repr_html_())
    assert shown.words[0].startswith("timeout: ") and "error of shape" in shown.words
    assert is_drawn(shown)
    pendulum = load_problem(PROBLEMS / "rmp_spin.yaml").run()
    shown = Cells(pendulum._repr_html_())
    assert len(shown.words) > 3 and is_drawn(shown)
    assert len(pendulum.to_frame()) == len(pendulum.history.time)


def test_an_inertia_that_is_not_reached_is_in_the_title(result, monkeypatch) -> None:
    monkeypatch.setattr(type(result), "reach", "as far as its other tasks allow")
    assert Cells(result._repr_html_()).words[0].endswith(", as far as its other tasks allow")


def test_without_matplotlib_there_is_the_table_alone(result, monkeypatch) -> None:
    monkeypatch.setattr("wbc.notebook.find_spec", lambda name: None)
    shown = Cells(result._repr_html_())
    assert shown.words and not shown.pictures


@pytest.mark.slow
def test_a_simulation_is_shown_and_framed(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    result = problem_of(tmp_path, STAND).simulate()
    shown = Cells(result._repr_html_())
    assert "CoP inside soles" in shown.words and is_drawn(shown)
    frame = result.to_frame()
    np.testing.assert_array_equal(frame["time [s]"], result.arrays["time"])


def test_frames_and_parquet_hold_what_the_table_does(result, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    parquet = pytest.importorskip("pyarrow.parquet")
    frame = result.to_frame()
    result.save(tmp_path / "r.csv")
    result.save(tmp_path / "r.parquet")
    table = pandas.read_csv(tmp_path / "r.csv")
    assert [*table] == [*frame]
    np.testing.assert_allclose(table.to_numpy(), frame.to_numpy(dtype=float), rtol=1e-8)
    found = parquet.read_table(tmp_path / "r.parquet")
    for name in frame:
        np.testing.assert_array_equal(found[name].to_numpy(), frame[name])
    told = json.loads(found.schema.metadata[b"wbc.summary"])
    assert told["robot"] == "hoap2_like"


def test_a_missing_package_is_named_with_its_extra(result, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    with pytest.raises(MissingPackageError, match=r"to_frame\(\) needs pandas.*wbc\[frames\]"):
        result.to_frame()
    with pytest.raises(MissingPackageError, match=r"\.parquet needs pyarrow.*wbc\[batch\]"):
        result.save(tmp_path / "r.parquet")
