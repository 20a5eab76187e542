"""Films of runs: what they show, when, and always the same."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from tests.problem.loading import problem_of
from wbc.errors import InvalidInputError
from wbc.run import Result
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.view.film import film_format, film_rows, film_run, write_film
from wbc.view.options import View
from wbc.view.style import VERMILION

WAVE = """\
robot: hoap2_like
support: double
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0.1, 0, 0.1]},
         gain: 0.1}
stop: {duration: 0.3}
"""
SMALL = (180, 220)


def pixels(film: Image.Image, frame: int = 0) -> np.ndarray:
    film.seek(frame)
    return np.asarray(film.convert("RGB")).astype(int)


def marked(picture: np.ndarray) -> bool:
    """Whether a mark is seen in its colour."""
    mark = np.array([int(VERMILION[k : k + 2], 16) for k in (1, 3, 5)])
    return bool((np.abs(picture - mark).max(axis=-1) < 12).any())


def milliseconds(film: Image.Image) -> int:
    return sum(film.info["duration"] for k in range(film.n_frames) if film.seek(k) is None)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return problem_of(tmp_path_factory.mktemp("wave"), WAVE).run()


@pytest.mark.slow
def test_a_film_is_as_long_as_the_run_and_always_the_same(result: Result, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    for name in ("a.gif", "b.gif"):
        film_run(
            result.robot, result.history, tmp_path / name, title="wave", fps=10, size=SMALL,
            progress=lambda done, total: told.append((done, total)),
        )  # fmt: skip
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    assert told[10] == (11, 11)  # 0, 0.1, 0.2 and 0.295 s, and 0.7 s of rest
    with Image.open(tmp_path / "a.gif") as film:
        assert film.size == SMALL
        assert milliseconds(film) == 1100
        first, last = pixels(film), pixels(film, film.n_frames - 1)
    assert np.abs(first - last).max() > 50  # something moved
    assert (first[0, 0] == 255).all()
    assert marked(first)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gif", "b.gif"]


@pytest.mark.parametrize("fps", [15, 30, 40])
def test_a_gif_at_a_rate_that_it_does_not_have_takes_as_long_as_the_run(tmp_path, fps: int) -> None:
    def figure() -> SimpleNamespace:
        small = Figure((1, 1))
        words = small.text(0.1, 0.5, "")
        return SimpleNamespace(figure=small, draw=words.set_text)

    path = write_film(figure, np.linspace(0.0, 2.0, 201), tmp_path / "a.gif", fps, 1.0, None)
    with Image.open(path) as film:
        shown = milliseconds(film)
    assert shown == pytest.approx(2700, abs=110)  # with 0.7 s of rest, rounded to pictures


def test_layers_are_left_out(result: Result, tmp_path: Path) -> None:
    bare = View.of("left", "robot")
    short = SimpleNamespace(time=result.history.time[:1], q=result.history.q[:1], errors={})
    film_run(result.robot, short, tmp_path / "a.gif", title="x", fps=2, size=SMALL, view=bare)
    with Image.open(tmp_path / "a.gif") as film:
        assert not marked(pixels(film))


def test_a_film_has_the_ground_of_its_run(result: Result, tmp_path: Path) -> None:
    """Two ticks of it; where a slope is, level ground is not."""
    history = result.history
    brief = SimpleNamespace(time=history.time[:2], q=history.q[:2], errors={})
    pictures = []
    for name, terrain in (("level", LEVEL), ("slope", Terrain(slope=(0.0, 0.2)))):
        path = tmp_path / f"{name}.gif"
        film_run(result.robot, brief, path, title="x", fps=2, size=SMALL, terrain=terrain)
        with Image.open(path) as film:
            pictures.append(pixels(film))
    assert (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 2).mean() > 0.02


def test_rows_are_the_run_at_its_own_speed() -> None:
    time = np.arange(0.0, 2.0, 0.005)
    rows = film_rows(time, 20, 1.0)
    moving = rows[: -round(0.7 * 20)]
    np.testing.assert_allclose(time[moving], np.arange(len(moving)) / 20, atol=0.0051)
    assert rows[-1] == len(time) - 1
    slow = film_rows(time, 20, 0.25)
    assert len(slow) - 14 == pytest.approx(4 * len(moving), abs=4)
    assert set(film_rows(time[:1], 20, 1.0)) == {0}
    with pytest.raises(InvalidInputError, match="at most 1000000; let it be faster"):
        film_rows(time, 20, 1e-9)  # 150 GB of rows


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({"fps": 60}, "at most 50"),
        ({"fps": 0}, "fps"),
        ({"fps": 12.7}, "whole number"),
        ({"speed": 0.0}, "speed"),
        ({"size": (100, 100)}, "at least 150"),
        ({"size": (10**7, 10**7)}, "at most 65535"),
        ({"size": 480}, "expected shape"),
        ({"size": ("a", 3)}, "expected numbers"),
    ],
)
def test_bad_numbers_are_refused(result, tmp_path, named: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        film_run(result.robot, result.history, tmp_path / "a.gif", title="x", **named)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_places_are_checked(result, tmp_path, monkeypatch) -> None:
    with pytest.raises(InvalidInputError, match=r"written as \.gif or \.mp4"):
        film_format("a.avi")
    monkeypatch.setattr("wbc.view.film.FFMpegWriter.isAvailable", lambda: False)
    with pytest.raises(InvalidInputError, match="needs the program ffmpeg"):
        film_format("a.mp4")
    with pytest.raises(InvalidInputError, match="there is no folder"):
        film_run(result.robot, result.history, tmp_path / "no" / "a.gif", title="x")
