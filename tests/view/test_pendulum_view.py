"""Pictures of pendulums: what is plotted, that texts keep apart, and what is refused."""

import numpy as np
import pytest

from benchmarks.balance_figures import pushes_figure, regions_figure
from tests.view.reading import check_apart, plots
from wbc.problem.pendulum.result import PendulumHistory, Support
from wbc.validate import Array
from wbc.view import style
from wbc.view.pendulum import pendulum_figure

SOLE = np.array(((-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)))


def history(
    com: Array,
    *,
    flat: bool = False,
    duration: float = 2.0,
    flight: slice = slice(0, 0),
    names: tuple[str, ...] = ("stand", "wheel"),
) -> PendulumHistory:
    """Return a history of a CoM (n, 3) above a foot at the origin, but for moments in flight."""
    n = len(com)
    time = np.linspace(0.0, duration, n)
    rate = np.gradient(com, time, axis=0) if n > 1 else np.zeros((n, 3))
    foot = np.zeros((n, 3))
    foot[flight] = np.nan
    cmp = foot + np.column_stack((0.3 * np.sin(9.0 * time), np.zeros((n, 2))))
    ends = np.array(((-0.1, 0.0), (0.1, 0.0)))
    phase = tuple(names[k * len(names) // n] for k in range(n))
    parts = {"time": time, "phase": phase, "com": com, "com_velocity": rate, "foot": foot}
    parts |= {"cop": foot, "cmp": cmp, "axes": np.tile(np.eye(3), (n, 1, 1))}
    radii = np.tile((0.25, 0.0, 0.0) if flat else (0.25, 0.2, 0.15), (n, 1))
    momentum = np.column_stack((np.zeros(n), -3.0 * np.sin(time), np.zeros(n)))
    supports = (Support(0.0, duration, ends if flat else SOLE),)
    return PendulumHistory(flat=flat, radii=radii, momentum=momentum, supports=supports, **parts)


def leaning(length: Array | float = 0.7, sweep: float = 0.1) -> Array:
    angle = sweep * np.cos(np.linspace(0.0, 6.0, 120))
    return np.column_stack((length * np.sin(angle), np.zeros(120), length * np.cos(angle)))


def jumping() -> Array:
    z = 0.7 + 0.3 * np.sin(np.linspace(0.0, np.pi, 120))
    return np.column_stack((np.linspace(0.0, 0.4, 120), np.zeros(120), z))


CASES = {
    "planar": history(leaning(), flat=True),
    "solid": history(leaning()),
    "flight": history(jumping(), flight=slice(40, 80), names=("push off", "flight", "land")),
    "many phases": history(leaning(), names=("both 1", "left", "both 2", "right", "stop")),
    "far": history(leaning(2e6), flat=True),
    "still": history(np.tile((1e-17, 0.0, 0.7), (50, 1))),
    "one moment": history(np.array(((0.01, 0.0, 0.7),))),
    "all in flight": history(jumping(), flight=slice(None)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_texts_keep_apart_and_legends_hide_no_line(case: str) -> None:
    figure = pendulum_figure(CASES[case], "A title")
    check_apart(figure)
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    for axes in figure.axes:
        legend = axes.get_legend()
        if legend is None:
            continue
        # Another axis may lie over it, as with momentum and radii.
        place = axes.get_position().bounds
        lines = [line for a in figure.axes if a.get_position().bounds == place for line in a.lines]
        assert lines
        for line in lines:
            points = line.get_transform().transform(line.get_xydata())
            inside = axes.bbox.contains(*points[0]) if len(points) == 1 else True
            low = legend.get_window_extent(renderer).y0
            seen = points[np.isfinite(points).all(axis=1)]
            if line.get_label() == "CMP":  # goes beyond its plot, where it is cut off
                continue
            assert inside
            assert not len(seen) or seen[:, 1].max() <= low, line.get_label()


def test_plots_hold_the_history() -> None:
    planar = plots(pendulum_figure(CASES["planar"]))
    assert list(planar) == ["Phase portrait", "On the ground", "Momentum and masses"]
    ground = {line.get_label(): line for line in planar["On the ground"].lines}
    np.testing.assert_array_equal(ground["CoM"].get_ydata(), CASES["planar"].com[:, 0])
    momentum = planar["Momentum and masses"].lines[0]
    np.testing.assert_array_equal(momentum.get_ydata(), -CASES["planar"].momentum[:, 1])
    # The portrait's curve is that of the angle that the leg was given.
    portrait = {line.get_label(): line for line in planar["Phase portrait"].lines}
    time = np.linspace(0.0, 6.0, 120)
    x = portrait["stand"].get_xdata()
    drawn = np.isfinite(x)
    assert 50 < drawn.sum() < 70
    np.testing.assert_allclose(x[drawn], np.degrees(0.1 * np.cos(time))[drawn], atol=1e-9)
    # Differences of the CoM are of second order in time steps of 1/60 s.
    speed = -0.1 * 3.0 * np.sin(time)
    np.testing.assert_allclose(portrait["stand"].get_ydata()[1:-1], speed[1:-1], atol=2e-3)
    solid = plots(pendulum_figure(CASES["solid"]))
    ground = {line.get_label(): line for line in solid["On the ground"].lines}
    np.testing.assert_array_equal(ground["CoM"].get_xydata(), CASES["solid"].com[:, :2])


@pytest.mark.parametrize(
    ("com", "flight", "what"),
    [
        (leaning(), slice(0, 0), "leg from the vertical [°]"),
        (leaning(np.linspace(0.7, 0.5, 120), 1e-3), slice(0, 0), "height of the CoM [m]"),
        (jumping(), slice(40, 80), "height of the CoM [m]"),
        (jumping() * (1.0, 0.0, 0.0) + (0.0, 0.0, 0.7) + np.outer(np.sin(np.arange(120)),
         (0.0, 0.1, 0.0)), slice(40, 80), "sideways, y of the CoM [m]"),
    ],
)  # fmt: skip
def test_the_portrait_is_of_what_moves(com: Array, flight: slice, what: str) -> None:
    figure = pendulum_figure(history(com, flight=flight))
    assert plots(figure)["Phase portrait"].get_xlabel() == what


def test_ranges_show_all_but_neither_rounding_nor_a_far_off_cmp() -> None:
    still = plots(pendulum_figure(CASES["still"]))
    assert "Phase portrait" not in still
    low, high = still["Turning of the masses"].get_ylim()
    assert high - low >= 0.02  # and room for the legend
    far = history(leaning())
    far.cmp[:, 0] = 100.0
    ground = plots(pendulum_figure(far))["On the ground"]
    (left, right), (low, high) = ground.get_xlim(), ground.get_ylim()
    assert left < -0.1 and 0.1 < right < 1.0
    assert low < -0.05 and high > 0.05
    # At the same scale in both directions.
    assert (right - left) / 2.05 == pytest.approx((high - low) / 2.2)


ROUND = np.column_stack((np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6)))


def test_pushes_close_around_and_all_are_drawn() -> None:
    sizes = {f"bound {k}": np.full(12, 10.0 + k) for k in range(len(style.SERIES) + 2)}
    figure = pushes_figure(3.0 * ROUND, sizes)
    (axes,) = figure.axes
    assert [line.get_label() for line in axes.lines] == list(sizes)
    for line, size in zip(axes.lines, sizes.values(), strict=True):
        angle, radius = line.get_data()
        np.testing.assert_array_equal(radius, np.append(size, size[0]))
        np.testing.assert_allclose(np.cos(angle[:-1]), ROUND[:, 0], atol=1e-12)
        assert angle[0] == angle[-1]
    check_apart(pushes_figure(ROUND, {"CoP alone": np.full(12, 15.0), "QP": np.full(12, 25.0)}))


def test_regions_are_where_the_leans_are() -> None:
    x, y = np.radians((-10.0, 0.0, 10.0)), np.radians((-4.0, 0.0, 4.0, 8.0))
    times = np.arange(12.0).reshape(3, 4)
    times[0, 0] = np.nan
    figure = regions_figure(x, y, {"stabiliser": times, "LQR": 0.5 * times})
    check_apart(figure)
    first, second, _ = figure.axes
    np.testing.assert_allclose(first.images[0].get_extent(), (-15.0, 15.0, -6.0, 10.0))
    shown = first.images[0].get_array()
    assert shown[3, 2] == times[2, 3]
    assert np.ma.getmaskarray(shown)[0, 0] or np.isnan(shown[0, 0])
    # One scale for all.
    assert first.images[0].get_clim() == second.images[0].get_clim() == (0.0, 11.0)
    nothing = regions_figure(x, y, {"fell": np.full((3, 4), np.nan)})
    assert nothing.axes[0].images[0].get_clim() == (0.0, 1.0)
