"""The figure of an analyzed motion: what is plotted, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tests.view.reading import check_apart, plots
from wbc.errors import InvalidInputError
from wbc.motion import Motion, RmpSeries, analyze
from wbc.motion.uncertainty import BAND
from wbc.robot import Robot
from wbc.view.analysis import analysis_figure, snapshot_frames
from wbc.view.style import save

TIME = np.arange(200) / 100.0


def series_of(height: float, feet: str | None) -> RmpSeries:
    robot = Robot.load("hoap2_like")
    joints = np.tile(robot.limits.joint_positions(robot.postures["standing"]), (200, 1))
    base = np.tile(robot.postures["standing"][:7], (200, 1))
    base[:, 2] += height * np.cos(2.0 * np.pi * 1.5 * TIME)
    return analyze(Motion(robot, TIME, joints, base), feet=feet)


@pytest.fixture(scope="module")
def still() -> RmpSeries:
    return series_of(0.0, "auto")


def test_plots_hold_the_series(still: RmpSeries) -> None:
    figure = analysis_figure(still, title="Standing", snapshots=3)
    named = plots(figure)
    assert len(named) == 6
    radii = {line.get_label(): line for line in named["Reaction mass radii"].lines}
    np.testing.assert_allclose(radii["r₁"].get_ydata(), 1e3 * still.radii[:, 0])
    ground = {line.get_label(): line for line in named["Ground, along x of the world"].lines}
    np.testing.assert_allclose(ground["CoP"].get_ydata(), 1e3 * still.cop[:, 0])
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles == ["a)  0.00 s", "b)  1.00 s", "c)  1.99 s"]


def test_rounding_of_a_robot_that_stands_still_does_not_fill_the_axes(still: RmpSeries) -> None:
    figure = analysis_figure(still, title="Standing", snapshots=1)
    figure.canvas.draw()
    named = plots(figure)
    for title, least in (
        ("Ground, along x of the world", 2.0),  # mm
        ("Ground, along y of the world", 2.0),
        ("Leg from CoP to CoM", 0.2),  # deg
        ("Rotation", 0.02),  # rad/s
    ):
        low, high = named[title].get_ylim()
        assert high - low == pytest.approx(least)
        assert named[title].yaxis.get_offset_text().get_text() == ""


@pytest.mark.slow
@pytest.mark.parametrize("snapshots", [6, 10])
def test_no_text_overlaps(still: RmpSeries, snapshots: int) -> None:
    figure = analysis_figure(still, title="Standing", snapshots=snapshots)
    check_apart(figure, ticks=False)


@pytest.mark.slow
def test_flight_and_no_feet(tmp_path: Path) -> None:
    flying = series_of(0.2, None)
    assert flying.flight.any() and flying.cop_margin is None
    figure = analysis_figure(flying, title="Hopping", snapshots=2)
    margin = plots(figure)["CoP inside the support polygon by"]
    assert any("not judged" in text.get_text() for text in margin.texts)
    path = save(figure, tmp_path / "hop.png")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_snapshots() -> None:
    time = 7.0 + 0.01 * np.arange(101)
    assert snapshot_frames(time, 6) == [0, 20, 40, 60, 80, 100]
    assert snapshot_frames(time[:2], 6) == [0, 1]
    assert snapshot_frames(time, [7.501, 7.0, 7.5]) == [0, 50]
    for wrong in (0, 11, [], [6.9], [8.1], [7.0] * 11):
        with pytest.raises(InvalidInputError, match="snapshots"):
            snapshot_frames(time, wrong)


def test_bands_of_noise_are_drawn(still: RmpSeries) -> None:
    rng = np.random.default_rng(4)
    joints = still.q[:, 7:] + 1e-3 * rng.normal(size=(200, 25))
    base = still.q[:, :7].copy()
    base[:, :3] += 1e-3 * rng.normal(size=(200, 3))
    series = analyze(Motion(still.robot, TIME, joints, base))
    assert series.cop_outside.any() and not series.infeasible.any()
    figure = analysis_figure(series, title="Standing", snapshots=1)
    band, filled = plots(figure)["CoP inside the support polygon by"].collections
    half = BAND * series.uncertainty.cop_margin
    corners = band.get_paths()[0].vertices[:, 1]
    assert corners.max() == pytest.approx(1e3 * (series.cop_margin + half).max())
    assert corners.min() == pytest.approx(1e3 * (series.cop_margin - half).min())
    assert not filled.get_paths()  # nothing is infeasible beyond the noise
    assert any("95 % bands" in text.get_text() for text in figure.texts)
    unasked = analyze(Motion(still.robot, TIME, joints, base), noise=None)
    figure = analysis_figure(unasked, title="Standing", snapshots=1)
    (filled,) = plots(figure)["CoP inside the support polygon by"].collections
    assert filled.get_paths()
    assert not any("95 % bands" in text.get_text() for text in figure.texts)
