"""Figures of robots and runs: files, what is plotted, and how bad input is refused."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace as Run
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import wbc.view
from wbc.errors import InvalidInputError, WbcError
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.robot import Robot
from wbc.simulation import Step, Terrain
from wbc.view import plot_robot, plot_run, robot_figure, run_figure
from wbc.view.portrait import Pose, portraits_of
from wbc.view.series import spread
from wbc.view.style import save

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture(scope="module")
def run(hoap2: Robot) -> Run:
    start = hoap2.postures["standing"]
    arms = {"left_shoulder_roll": 1.4, "right_shoulder_roll": -1.4}
    time = np.linspace(0.0, 2.0, 21)
    way = hoap2.difference(start, hoap2.posture("standing", arms))
    q = np.array([hoap2.integrate(start, way, part) for part in time / 2.0])
    fading = np.exp(-3.0 * time)[:, None]
    errors = {
        "inertia": fading * [0.3, 0.0, 0.4],
        "left foot": np.zeros((21, 6)),
        "head": np.where(time < 1.0, np.nan, 0.25),  # one number a time; inactive at first
    }
    return Run(time=time, q=q, errors=errors)


@pytest.fixture(scope="module")
def figure(hoap2: Robot, run: Run) -> Figure:
    return run_figure(hoap2, run, title="Reaching out")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", MAGIC)
def test_a_figure_is_written_in_each_format(figure: Figure, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    save(figure, path)
    content = path.read_bytes()
    assert content.startswith(MAGIC[suffix])
    assert len(content) > 50_000  # both robots, not an empty frame


def test_both_ends_are_drawn_with_their_semi_axes(hoap2: Robot, run: Run, figure: Figure) -> None:
    before, after, errors, moments = figure.axes
    assert (before.get_title(), after.get_title()) == ("before, t = 0 s", "after, t = 2 s")
    assert errors.get_yscale() == "log"
    for axes, q in ((before, run.q[0]), (after, run.q[-1])):
        # Second moment about each principal axis from the centroidal inertia.
        principal = np.linalg.eigvalsh(hoap2.snapshot(q).inertia)
        extents = np.sqrt(5.0 * (principal.sum() / 2.0 - principal) / hoap2.mass)
        texts = [text.get_text() for text in axes.texts]
        assert texts == [f"a{'₁₂₃'[k]} {1e3 * extents[k]:.0f} mm" for k in range(3)]
    labels = [text.get_text() for text in moments.texts]
    assert labels == ["about a₁", "about a₂", "about a₃"]


@pytest.mark.slow
def test_the_panels_show_the_robot_and_fill_it(figure: Figure) -> None:
    for axes in figure.axes[:2]:
        (image,) = axes.get_images()
        pixels = np.asarray(image.get_array())
        assert (pixels < 0.97).any(axis=-1).mean() > 0.15  # neither empty nor all background
        np.testing.assert_array_equal(pixels[0], 1.0)  # nothing is cut off at the top


def test_errors_are_norms_over_time(run: Run, figure: Figure) -> None:
    inertia, foot, head = (line.get_ydata() for line in figure.axes[2].lines)
    np.testing.assert_allclose(inertia, 0.5 * np.exp(-3.0 * run.time), rtol=1e-12)
    bottom = figure.axes[2].get_ylim()[0]
    np.testing.assert_array_equal(foot, bottom)  # zero, on a logarithmic scale
    assert 0.25 * inertia.min() < bottom < inertia.min()  # which is that of the others
    assert np.isnan(head[run.time < 1.0]).all()
    np.testing.assert_array_equal(head[run.time >= 1.0], 0.25)
    labels = [text.get_text() for text in figure.axes[2].texts]
    assert labels == ["inertia", "left foot", "head"]


def test_inertias_of_the_history_are_used_if_given(hoap2: Robot, run: Run) -> None:
    inertia = np.tile([0.3, 0.1, 0.0, 0.3, 0.0, 0.35], (2, 1))  # moments 0.2, 0.35, 0.4
    given = Run(time=run.time[:2], q=run.q[:2], errors={}, inertia=inertia)
    moments = run_figure(hoap2, given, title="given").axes[3]
    drawn = [line.get_ydata() for line in moments.lines]
    np.testing.assert_allclose(drawn, [[0.2] * 2, [0.35] * 2, [0.4] * 2], rtol=1e-12)


@pytest.mark.slow
def test_the_same_run_gives_the_same_file(hoap2: Robot, run: Run, tmp_path: Path) -> None:
    short = Run(time=run.time[:2], q=run.q[:2], errors={"inertia": run.errors["inertia"][:2]})
    paths = [tmp_path / "first.png", tmp_path / "second.png"]
    for path in paths:
        plot_run(hoap2, short, path, title="twice")
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_the_ground_is_under_a_robot_that_is_not_at_zero(hoap2: Robot) -> None:
    q = hoap2.postures["standing"].copy()
    sunk, flying = q.copy(), q.copy()
    sunk[2] -= 0.3
    flying[2] += 0.2
    portraits = portraits_of(hoap2, {"stands": q, "sunk": sunk, "flies": flying})
    assert [one.scene.ground for one in portraits] == pytest.approx([0.0, -0.3, 0.0], abs=1e-9)
    for one in portraits:
        np.testing.assert_allclose(one.foot[:2], one.snapshot.com[:2])


def test_legs_stand_on_the_slope_or_on_a_board(hoap2: Robot) -> None:
    """Where they are, also below z = 0: a robot there has not sunk in."""
    board = Step(centre=(1.0, 0.0, 0.2), size=(0.5, 0.5, 0.1))
    terrain = Terrain(slope=(0.1, 0.0), steps=(board,))
    start = rotated_to_plane(hoap2.posture("standing"), terrain.normal)
    poses = {}
    for name, x, z in (("down", -2.0, -0.2), ("up", 3.0, 0.3), ("on", 1.0, 0.2)):
        q = start.copy()
        q[[0, 2]] += (x, z)
        poses[name] = Pose(q, terrain=terrain)
    down, up, on = portraits_of(hoap2, poses)
    for one in (down, up):
        x, y, _ = one.snapshot.com
        np.testing.assert_allclose(one.foot, (x, y, 0.1 * x), atol=1e-12)
        np.testing.assert_allclose(one.scene.below_centre, one.foot, atol=1e-12)
        for outline in one.outlines:
            np.testing.assert_allclose(outline[:, 2], 0.1 * outline[:, 0], atol=1e-9)
    assert [one.scene.ground for one in (down, up, on)] == [0.0] * 3
    np.testing.assert_allclose(on.foot, (*on.snapshot.com[:2], 0.2), atol=1e-12)
    # The camera moves with the plane, so that robots on boards stand higher in their pictures.
    assert on.scene.below_centre[2] == pytest.approx(0.1 * on.snapshot.com[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.empty(0), "q": np.empty((0, 32))}, "it is empty"),
        ({"time": np.array([0.0, np.nan])}, "history: time: NaN"),
        ({"q": np.zeros((2, 7))}, r"history: q: expected shape \(2, 32\), got \(2, 7\)"),
        ({"errors": {"com": np.zeros((3, 1))}}, "errors of 'com'.*one row for each time"),
        ({"errors": {"com": ["a", "b"]}}, "errors of 'com': expected numbers"),
        ({"inertia": np.zeros((2, 3))}, r"history: inertia: expected shape \(2, 6\)"),
        ({"phase": ["down"]}, "history: phase: expected 2 words, got 1"),
        ({"support": ["left"]}, "history: support: expected 2 words, got 1"),
        ({"balance": [0.1]}, "history: balance: expected numbers, one row for each time"),
        ({"clearance": {"room": [1.0]}}, "clearance of 'room'"),
        ({"targets": {"hand": np.zeros((3, 3))}}, "targets of 'hand'"),
        ({"targets": {"hand": np.zeros((2, 3))}}, "points and targets"),
    ],
)
def test_a_history_that_does_not_fit_is_refused(hoap2, run, changes, message) -> None:
    values = {"time": run.time[:2], "q": run.q[:2], "errors": {}, "inertia": np.zeros((2, 6))}
    with pytest.raises(InvalidInputError, match=message):
        run_figure(hoap2, Run(**{**values, **changes}), title="")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"history": "result"}, "history: expected one, as result.history, got 'result'"),
        ({"robot": "g1"}, "expected a robot as Robot.load"),
        ({"path": 3}, "file to write: expected a path, got 3"),
        ({"view": "left"}, "view: expected a View, such as View.of"),
    ],
)
def test_what_cannot_be_drawn_or_drawn_into_is_refused(
    hoap2: Robot, run: Run, tmp_path: Path, given: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        plot_run(**{"robot": hoap2, "history": run, "path": tmp_path / "a.png", **given})


@pytest.mark.parametrize("name", ["run.gif", "run", "run.png.txt"])
def test_other_suffixes_are_refused_by_name(hoap2, run, tmp_path, name: str) -> None:
    for call in (
        lambda path: plot_run(hoap2, run, path, title=""),
        lambda path: plot_robot(hoap2, {"a": run.q[0]}, path),
    ):
        with pytest.raises(InvalidInputError, match=r"a picture is written as \.png, \.svg, \.pdf"):
            call(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_folders_and_unwritable_files(hoap2: Robot, run: Run, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"there is no folder .*nowhere; make it first"):
        plot_run(hoap2, run, tmp_path / "nowhere" / "run.png", title="")
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(InvalidInputError, match="cannot be written"):
        save(Figure(), tmp_path / "taken.png")


def test_nothing_to_draw(hoap2: Robot) -> None:
    with pytest.raises(InvalidInputError, match="give at least one"):
        robot_figure(hoap2, {})
    q: Any = hoap2.posture()
    with pytest.raises(InvalidInputError, match=r'expected names, as in \{"start": q\}, got array'):
        robot_figure(hoap2, q)  # numpy's "truth value of an array"


@pytest.mark.parametrize("seed", range(10))
def test_labels_are_spread_apart(seed: int) -> None:
    heights = np.random.default_rng(seed).uniform(0.0, 1.0, size=8)
    placed = spread(heights, 0.1)
    assert (np.diff(np.sort(placed)) >= 0.1 - 1e-12).all()
    assert placed.max() <= 1.0
    np.testing.assert_array_equal(np.argsort(placed), np.argsort(heights))
    alone = np.array([0.2, 0.9, 0.5])
    np.testing.assert_array_equal(spread(alone, 0.1), alone)


def test_without_matplotlib_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(WbcError, match=r"pip install 'wbc\[plot\]'"):
        _ = wbc.view.robot_figure


def test_matplotlib_is_left_as_it_was() -> None:
    """No pyplot, no backend, no settings: a program that uses wbc keeps its own."""
    code = (
        "import sys, matplotlib\n"
        "before = matplotlib.rcParams.copy()\n"  # a plain dict() would choose a backend
        "import wbc.view\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert matplotlib.rcParams.copy() == before\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_figure_of_many_is_no_wider_than_one_of_three(hoap2: Robot) -> None:
    """Eight side by side were 29 inches across, and no text could be read on a page."""
    q = hoap2.posture()
    many = robot_figure(hoap2, {str(k): q for k in range(8)})
    assert many.get_figwidth() == pytest.approx(3 * robot_figure(hoap2, {"one": q}).get_figwidth())
