"""The figure of a simulation: what it draws of the arrays, and what it refuses."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.view.reading import plots
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.view.camera import Camera
from wbc.view.render import Picture, render
from wbc.view.scene import Scene
from wbc.view.simulation import simulation_figure
from wbc.view.style import save

Arrays = dict[str, NDArray[np.float64]]
ROWS = 41


@pytest.fixture
def arrays(hoap2: Robot) -> Arrays:
    time = np.linspace(0.0, 2.0, ROWS)
    q = np.tile(hoap2.postures["standing"], (ROWS, 1))
    com = np.tile(hoap2.snapshot(q[0]).com, (ROWS, 1))
    push = np.zeros((ROWS, 3))
    push[5:8] = (0.0, 40.0, 0.0)
    torque = np.zeros((ROWS, hoap2.nv - 6))
    torque[:, 3] = 0.5 * hoap2.limits.effort[3]
    cop = com * (1.0, 1.0, 0.0)
    cop[-1] = np.nan  # in the air
    wrench = np.tile((0.0, 0.0, 30.0, 0.0, 0.0, 0.0), (ROWS, 1))
    found = {"time": time, "q": q, "com": com, "cop": cop, "planned_cop": cop, "torque": torque,
             "push": push, "relaxed": time > 1.9, "tilt": 0.1 * time,
             "cop_margin": np.full(ROWS, 0.02)}  # fmt: skip
    for foot in hoap2.feet.values():
        found |= {f"{part}forces/{foot.frame}": wrench for part in ("", "planned_")}
    return found


@pytest.mark.slow
def test_everything_is_drawn(hoap2: Robot, arrays: Arrays, tmp_path) -> None:
    figure = simulation_figure(hoap2, arrays, title="push: stood")
    titles = {axes.get_title() or axes.get_title(loc="left") for axes in figure.axes}
    # At the start, when the push ends, and a tenth, three tenths and all of the time after it.
    assert {f"t = {t:.2f} s" for t in (0.0, 0.35, 0.5, 0.85, 2.0)} <= titles
    drawn = plots(figure)
    torques = drawn["Torques that come nearest to their bounds"]
    np.testing.assert_allclose(torques.lines[1].get_ydata(), 50.0)
    words = [text.get_text() for text in torques.texts]
    assert hoap2.joint_names[3] in words and "something gave way" in words
    assert any("semi-axes a₁ ≥ a₂ ≥ a₃ in mm" in text.get_text() for text in figure.texts)
    margin = drawn["CoP inside the soles that bear load"]
    (name,) = margin.texts  # where its curve ends, at 20 mm
    place = margin.transAxes.transform(name.get_position())
    assert margin.transData.inverted().transform(place)[1] == pytest.approx(20.0, abs=0.5)
    lateral = drawn["CoM and CoP, y: to the left"]
    np.testing.assert_allclose(lateral.lines[-1].get_ydata(), 0.0, atol=1e-12)
    pushed = lateral.patches[0].get_extents().transformed(lateral.transData.inverted())
    np.testing.assert_allclose((pushed.x0, pushed.x1), (0.2, 0.35))
    path = save(figure, tmp_path / "push.png")
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_noise_of_a_robot_that_stands_does_not_fill_the_axes(hoap2: Robot, arrays: Arrays) -> None:
    noise = 1e-5 * np.random.default_rng(0).standard_normal((ROWS, 3))
    still = {**arrays, "com": arrays["com"] + noise, "tilt": 1e-4 * np.abs(noise[:, 0]),
             "plan_com": arrays["com"], "plan_cop": arrays["cop"], "plan_momentum": noise,
             "angular_momentum": noise}  # fmt: skip
    for tilt, highest in ((still["tilt"], 0.05), (0.1 * arrays["time"], 0.2)):
        figure = simulation_figure(hoap2, {**still, "tilt": tilt}, title="still")
        drawn = plots(figure)
        # Matplotlib leaves a twentieth free beyond what an axis must hold.
        np.testing.assert_allclose(drawn["Tilt of the trunk"].get_ylim(), (0.0, 1.05 * highest))
        low, high = drawn["CoM and CoP, y: to the left"].get_ylim()
        np.testing.assert_allclose((high - low, 0.5 * (high + low)), (2.2, 0.0), atol=0.05)
        apart = drawn["How far CoM and CoP are from the plan"]
        np.testing.assert_allclose(apart.get_ylim(), (0.0, 2.1))
    far = {**still, "com": arrays["com"] + 0.01 * arrays["time"][:, None]}  # 20 mm: as it is
    figure = simulation_figure(hoap2, far, title="moves")
    moves = next(one for one in figure.axes if one.get_title(loc="left").startswith("CoM and CoP"))
    assert moves.get_ylim()[1] == pytest.approx(21.0)


def test_without_pushes_the_robot_is_drawn_now_and_then(hoap2: Robot, arrays: Arrays) -> None:
    figure = simulation_figure(hoap2, {**arrays, "push": np.zeros((ROWS, 3))}, title="still")
    titles = {axes.get_title() for axes in figure.axes}
    assert {f"t = {t:.2f} s" for t in (0.0, 0.5, 1.0, 1.5, 2.0)} <= titles


def test_a_flight_without_forces_leaves_no_row_empty(hoap2: Robot, arrays: Arrays) -> None:
    figure = simulation_figure(
        hoap2, {**arrays, "cop": np.full((ROWS, 3), np.nan)}, title="in the air"
    )
    lowest = min(axes.get_position().y0 for axes in plots(figure).values())
    assert lowest * figure.get_figheight() < 1.5  # inches: room for its labels


@pytest.mark.slow
def test_the_ground_is_that_of_the_simulation(hoap2, arrays, monkeypatch) -> None:
    scenes: list[Scene] = []

    def remembered(scene: Scene, camera: Camera) -> Picture:
        scenes.append(scene)
        return render(scene, camera)

    monkeypatch.setattr("wbc.view.portrait.render", remembered)
    terrain = Terrain(slope=(0.1, 0.0))
    simulation_figure(hoap2, arrays, title="level")
    simulation_figure(hoap2, arrays, title="slope", terrain=terrain)
    assert [one.terrain for one in scenes] == [LEVEL] * 5 + [terrain] * 5


def test_what_is_no_simulation_is_refused(hoap2: Robot, arrays: Arrays) -> None:
    with pytest.raises(InvalidInputError, match="no array tilt; give what wbc sim writes"):
        simulation_figure(hoap2, {k: v for k, v in arrays.items() if k != "tilt"}, title="")
    with pytest.raises(InvalidInputError, match="simulation, torque: expected 41 rows, got 3"):
        simulation_figure(hoap2, {**arrays, "torque": arrays["torque"][:3]}, title="")
