"""Results of simulations and of pendulums: read back, reported and filmed as runs are."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from tests.problem.loading import problem_of
from tests.texts import STAND
from tests.view.reading import data_of, numbers
from wbc.errors import InvalidInputError
from wbc.problem import load_problem
from wbc.problem.pendulum.result import PendulumResult, SavedPendulum
from wbc.problem.replay import replay_run
from wbc.problem.saved import SavedRun, load_result
from wbc.robot import Robot
from wbc.simulation import SimulationResult, Step, Terrain
from wbc.simulation.terrain import LEVEL
from wbc.view.pendulum_film import PendulumFilm, film_pendulum
from wbc.view.report.replay import pendulum_replay, replay_rows
from wbc.view.report.report import report_text, write_pendulum_report

PENDULUM = Path(__file__).parents[2] / "problems" / "rmp_push_qp.yaml"
SMALL = (200, 200)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> SimulationResult:
    text = STAND + "simulation: {duration: 0.1, pushes: [{impulse: [0.5, 0, 0], at: 0.02}]}\n"
    return problem_of(tmp_path_factory.mktemp("sim"), text).simulate()


@pytest.fixture(scope="module")
def moved() -> PendulumResult:
    result = load_problem(PENDULUM, {"stop.duration": 0.5, "stop.accept": {}}).run()
    assert isinstance(result, PendulumResult)
    return result


def test_a_simulation_comes_back(simulated: SimulationResult, tmp_path: Path) -> None:
    simulated.save(tmp_path / "s.npz")
    saved = load_result(tmp_path / "s.npz")
    made = SavedRun.of(simulated, "s")
    assert isinstance(saved, SavedRun) and saved.simulation is not None
    assert made.simulation is not None
    for name, array in made.history.arrays().items():
        np.testing.assert_array_equal(saved.history.arrays()[name], array)
    for name in ("torque", "tilt", "push", "relaxed", "forces/left_sole"):
        np.testing.assert_array_equal(saved.simulation[name], made.simulation[name])
    assert len(saved.history.time) == len(simulated.arrays["torque"])


def test_a_saved_simulation_knows_its_terrain(simulated: SimulationResult, tmp_path: Path) -> None:
    board = Step(centre=(0.5, 0.1, 0.02), size=(0.6, 0.8, 0.02), yaw=0.2)
    terrain = Terrain(friction=0.4, slope=(0.1, 0.0), steps=(board,))
    replace(simulated, terrain=terrain).save(tmp_path / "s.npz")
    saved = load_result(tmp_path / "s.npz")
    assert isinstance(saved, SavedRun)
    assert saved.terrain.to_data() == terrain.to_data()
    assert SavedRun.of(simulated, "s").terrain is simulated.terrain
    with np.load(tmp_path / "s.npz") as archive:
        arrays = dict(archive)
    summary = json.loads(str(arrays["summary"]))
    del summary["simulation"]["terrain"]  # as files had it before
    np.savez(tmp_path / "old.npz", **{**arrays, "summary": np.array(json.dumps(summary))})
    old = load_result(tmp_path / "old.npz")
    assert isinstance(old, SavedRun) and old.terrain is LEVEL
    for wrong in ("hilly", {"slope": [0, 0]}, {"steps": [], "hills": 3}):
        summary["simulation"]["terrain"] = wrong
        np.savez(tmp_path / "bad.npz", **{**arrays, "summary": np.array(json.dumps(summary))})
        with pytest.raises(InvalidInputError, match="terrain"):
            load_result(tmp_path / "bad.npz")


@pytest.mark.slow
def test_a_report_of_a_simulation_says_what_only_physics_knows(simulated: SimulationResult) -> None:
    saved = SavedRun.of(simulated, "s")
    page = report_text(saved.robot, saved.history, saved.summary, "s", saved.simulation)
    titles = [plot["title"] for plot in data_of(page)["plots"]]
    assert {"Tilt of the trunk", "Normal force of each foot (dashed: commanded)"} <= set(titles)
    assert "0.5 N s on base from 0.02 s" in page
    assert "trunk tilted by at most" in page


def test_a_pendulum_comes_back(moved: PendulumResult, tmp_path: Path) -> None:
    moved.save(tmp_path / "p.npz")
    saved = load_result(tmp_path / "p.npz")
    assert isinstance(saved, SavedPendulum)
    for name, value in vars(moved.history).items():
        if name != "supports":
            np.testing.assert_array_equal(getattr(saved.history, name), value)
    (before,), (after,) = moved.history.supports, saved.history.supports
    assert (after.start, after.end) == (before.start, before.end)
    np.testing.assert_array_equal(after.polygon, before.polygon)
    assert saved.summary["reason"] == moved.reason
    with pytest.raises(InvalidInputError, match="has no robot to name"):
        load_result(tmp_path / "p.npz", Robot.load("hoap2_like"))


def test_a_plan_comes_back_and_is_replayed(tmp_path: Path) -> None:
    """Its own arrays were in the way of reports and films, and the time of its search differed."""
    planned = load_problem(PENDULUM.with_name("plan_lean.yaml")).run()
    planned.save(tmp_path / "p.npz")
    saved = load_result(tmp_path / "p.npz")
    assert isinstance(saved, SavedPendulum) and isinstance(planned, PendulumResult)
    np.testing.assert_array_equal(saved.history.com, planned.history.com)
    assert replay_run(tmp_path / "p.npz").same


@pytest.mark.parametrize("name", ["com", "support_times", "support_0"])
def test_half_a_pendulum_is_refused_by_what_it_lacks(moved, tmp_path, name: str) -> None:
    path = tmp_path / "p.npz"
    moved.save(path)
    with np.load(path) as archive:
        kept = {key: archive[key] for key in archive.files if key != name}
    np.savez(path, **kept)
    with pytest.raises(InvalidInputError, match=f"lacks the array '{name}'"):
        load_result(path)
    np.savez(path, **kept, **{name: np.zeros((2, 2))})
    if name == "com":
        with pytest.raises(InvalidInputError, match=r"array 'com': expected shape \(\d+, 3\)"):
            load_result(path)


def test_the_replay_of_a_pendulum_is_its_motion(moved: PendulumResult, tmp_path: Path) -> None:
    history = moved.history
    rows = replay_rows(history.time)
    data = pendulum_replay(history, rows)
    shape = (len(rows), -1)
    for name, expected in (("com", history.com), ("feet", history.foot)):
        found = numbers(data[name], shape)  # 32 bits
        np.testing.assert_allclose(found, expected[rows], rtol=1e-6, atol=1e-6)
    # A uniform ellipsoid has second moments M a^2 / 5, six masses M/6 at r have M r^2 / 3.
    semi_axes, radii = np.hsplit(numbers(data["sizes"], shape), 2)
    np.testing.assert_allclose(semi_axes**2 / 5.0, radii**2 / 3.0, rtol=1e-6)
    assert all(data["stands"])
    path = write_pendulum_report(history, moved.summary(), tmp_path / "p.html", title="<p>")
    page = path.read_text()
    assert [plot["times"] is None for plot in data_of(page)["plots"]] == [True, True, False]
    assert "margin to friction" in page and "&lt;p&gt;" in page
    assert "http://" not in page and "https://" not in page


def test_a_film_of_a_pendulum(moved: PendulumResult, tmp_path: Path) -> None:
    for name in ("a.gif", "b.gif"):
        film_pendulum(moved.history, tmp_path / name, title="p", fps=4, size=SMALL)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()
    with Image.open(tmp_path / "a.gif") as film:
        assert film.size == SMALL
    drawn = PendulumFilm(moved.history, "p", SMALL)
    first, last = (black_at_the_top(drawn, row) for row in (0, len(moved.history.time) - 1))
    assert last > first + 2.0  # the push is forwards: to the right


def black_at_the_top(drawn: PendulumFilm, row: int) -> float:
    """Return the mean column of the leg's pixels in the middle of the picture's height."""
    drawn.draw(row)
    canvas = FigureCanvasAgg(drawn.figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba()).astype(int)[90:140, :, :3]
    dark = (pixels.max(axis=-1) < 90).nonzero()
    return float(dark[1].mean())


FFMPEG = """#!{python}
import json, sys
given = sys.stdin.buffer.read()
with open(sys.argv[-1], "w") as file:
    json.dump({{"arguments": sys.argv[1:-1], "bytes": len(given)}}, file)
"""


def test_an_mp4_is_what_ffmpeg_makes_of_the_pictures(moved, tmp_path, monkeypatch) -> None:
    """A program in ffmpeg's place tells what it is given: every picture, whole, at the rate."""
    stub = tmp_path / "ffmpeg"
    stub.write_text(FFMPEG.format(python=sys.executable))
    stub.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    film_pendulum(moved.history, tmp_path / "a.mp4", title="p", fps=4, size=SMALL)
    told = json.loads((tmp_path / "a.mp4").read_text())
    pictures = 3 + round(0.7 * 4)  # 0, 0.25 and 0.5 s, and the rest at the end
    assert told["bytes"] == pictures * 4 * SMALL[0] * SMALL[1]
    words = " ".join(told["arguments"])
    assert "-s 200x200" in words and "-framerate 4" in words
    assert "-vcodec libx264" in words and "+bitexact" in words
