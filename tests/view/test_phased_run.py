"""The figure of a run in phases: a portrait for each, and phases marked in every plot."""

from types import SimpleNamespace as Run

import numpy as np
import pytest
from matplotlib.figure import Figure

from wbc.robot import Robot
from wbc.view import run_figure
from wbc.view.series import shortened


def changed(run: Run, **changes: object) -> Run:
    return Run(**vars(run) | changes)


@pytest.fixture(scope="module")
def run(hoap2: Robot) -> Run:
    time = np.linspace(0.0, 3.0, 31)
    start = hoap2.postures["standing"]
    bent = hoap2.posture("standing", {"*_shoulder_pitch": -1.0})
    way = hoap2.difference(start, bent)
    q = np.array([hoap2.integrate(start, way, np.sin(t)) for t in time])
    phase = np.array(["down"] * 10 + ["over"] * 15 + ["up"] * 6)
    support = np.where(phase == "over", "right", "left,right")
    errors = {"com": np.full((31, 3), 1e-3), "foot": np.full((31, 6), np.nan)}
    balance = 0.03 - 0.01 * np.sin(time)
    return Run(time=time, q=q, errors=errors, phase=phase, support=support, balance=balance)


def titles(figure: Figure) -> list[str]:
    return [axes.get_title() for axes in figure.axes if axes.get_images()]


def plots(figure: Figure) -> list:  # type: ignore[type-arg]
    return [axes for axes in figure.axes if not axes.get_images()]


def test_every_phase_is_drawn_and_marked(hoap2: Robot, run: Run) -> None:
    figure = run_figure(hoap2, run, title="phases")
    assert titles(figure) == [
        "start\non left and right",
        "1  down, 1.0 s\non left and right",
        "2  over, 2.5 s\non right",
        "3  up, 3.0 s\non left and right",
    ]
    balance, moments, errors = plots(figure)
    words = [text.get_text() for text in balance.texts]
    assert words == ["least 20.0 mm", "1  down", "2  over", "3  up"]
    np.testing.assert_allclose(balance.lines[0].get_ydata(), 30.0 - 10.0 * np.sin(run.time))
    for axes in (balance, moments, errors):
        assert axes.get_xlim() == (0.0, 3.0)
        bands = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
        np.testing.assert_allclose(bands, [(0.0, 1.0), (2.5, 3.0)])  # every other phase
    assert [text.get_text() for text in errors.texts] == ["com"]  # the other was never active


def test_long_names_are_shortened(hoap2: Robot, run: Run) -> None:
    figure = run_figure(hoap2, changed(run, phase=["x" * 200] * 31), title="")
    assert titles(figure)[1].startswith(f"1  {'x' * 10}…{'x' * 9}, 3.0 s")
    assert plots(figure)[0].texts[-1].get_text() == f"1  {'x' * 10}…{'x' * 9}"
    cones = {shortened(f"front_left_sole corner 0 friction at {k} deg") for k in (0, 90, 180)}
    assert len(cones) == 3 and {len(one) for one in cones} == {20}
    wide = [axes.get_position().width for axes in figure.axes if axes.get_images()]
    np.testing.assert_allclose(wide, 0.25)  # two pictures are not drawn larger than four


@pytest.mark.filterwarnings("error")
def test_a_single_tick_is_drawn(hoap2: Robot, run: Run) -> None:
    errors = {"com": run.errors["com"][:1]}
    one = Run(time=run.time[:1], q=run.q[:1], errors=errors, phase=["down"], balance=[0.03])
    figure = run_figure(hoap2, one, title="")
    assert plots(figure)[0].texts[0].get_text() == "least 30.0 mm"


@pytest.mark.slow
def test_without_feet_there_is_no_plot_of_balance(hoap2: Robot, run: Run) -> None:
    for balance in (None, np.full(31, np.nan)):
        figure = run_figure(hoap2, changed(run, balance=balance, support=None), title="")
        moments, errors = plots(figure)
        assert moments.get_title(loc="left") == ""  # the names of the phases are there
        assert errors.get_title(loc="left") == "Task errors"
        assert titles(figure)[0] == "start\n"


def test_no_names_are_no_phases(hoap2: Robot, run: Run) -> None:
    figure = run_figure(hoap2, changed(run, phase=[""] * 31), title="")
    assert titles(figure) == ["before, t = 0 s", "after, t = 3 s"]
