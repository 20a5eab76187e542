"""What pictures say of constraints, targets, obstacles and floating robots."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tests.texts import REACH
from tests.view.reading import plots
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.motion.dropouts import runs
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.robot.collision import Capsule, HalfSpace, Hull
from wbc.run import Result
from wbc.view import run_figure
from wbc.view.camera import Camera, rasterise
from wbc.view.history import read_history
from wbc.view.options import LAYERS, View
from wbc.view.portrait import Pose, captions, portraits_of
from wbc.view.render import render
from wbc.view.run import plot_clearance, plot_held_back
from wbc.view.solids import solid_surface


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("reach") / "p.yaml"
    path.write_text(REACH)
    return load_problem(path).run()


@pytest.fixture(scope="module")
def figure(result: Result) -> Figure:
    return run_figure(result.robot, result.history, title="reach")


def test_constraints_are_plotted(result: Result, figure: Figure) -> None:
    axes = plots(figure)["Clearance of the constraints"]
    zero, left = axes.lines
    assert list(zero.get_ydata()) == [0.0, 0.0]
    np.testing.assert_allclose(left.get_ydata(), 1e3 * result.history.clearance["room"])


def test_a_constraint_that_nothing_is_near_has_no_curve() -> None:
    axes = Figure().subplots()
    plot_clearance(axes, np.arange(3.0), {"room": np.full(3, np.inf)}, {})
    assert axes.get_ylim() == (-0.1, 1.0)


def test_a_row_that_held_back_for_one_tick_of_a_long_run_is_seen() -> None:
    figure = Figure(figsize=(4.0, 2.0))
    canvas = FigureCanvasAgg(figure)
    once = np.arange(20000) == 3001
    plot_held_back(figure.subplots(), 0.005 * np.arange(20000), {"knee": once})
    canvas.draw()
    red, _, blue = np.asarray(canvas.buffer_rgba())[..., :3].astype(float).transpose(2, 0, 1)
    assert np.count_nonzero(blue - red > 60) > 10  # pixels in the first colour, blue


def test_bars_are_as_long_as_rows_held_back(result: Result, figure: Figure) -> None:
    found = plots(figure)
    axes = next(one for title, one in found.items() if title.startswith("Held back by"))
    bars = axes.collections
    labels = [text.get_text() for text in axes.get_yticklabels()]
    longest = list(result.held_back.items())[: len(bars)]
    assert labels == [label.replace("_link", "") for label, _ in longest]
    for bar, (_, one) in zip(bars, longest, strict=True):
        widths = [np.ptp(path.vertices[:, 0]) for path in bar.get_paths()]
        assert sum(widths) == pytest.approx(one.ticks * result.dt)


def test_targets_and_obstacles_are_drawn_and_explained(result: Result, figure: Figure) -> None:
    run = read_history(result.robot, result.history)
    (portrait,) = portraits_of(result.robot, {"end": run.pose(-1)})
    assert len(portrait.scene.solids) == 2
    (aim,) = portrait.aims
    np.testing.assert_allclose(aim.point, portrait.snapshot.position("left_hand"), atol=1e-12)
    told = " ".join(captions([portrait], 9.0))
    assert "targets" in told and "obstacles" in told and "a₁" in told
    bare = portraits_of(result.robot, {"end": run.pose(-1)}, View.of(show="robot,com"))
    assert captions(bare, 9.0) == [LAYERS["com"]]
    assert not bare[0].scene.solids


def test_a_floating_robot_has_no_leg_and_no_ground(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(REACH.replace("double", "floating"))
    floating = load_problem(path, {"stop.duration": 0.01}).run()
    pose = read_history(floating.robot, floating.history).pose(0)
    assert (pose.stands, pose.grounded) == (False, False)
    (portrait,) = portraits_of(floating.robot, {"floats": pose})
    assert portrait.foot is None and not portrait.scene.grounded and not portrait.outlines
    (stands,) = portraits_of(floating.robot, {"stands": pose.q})
    assert stands.foot is not None and stands.scene.grounded


def test_an_obstacle_covers_what_is_behind_it_only() -> None:
    """Pixels change where a ray meets the ball before the robot, and nowhere else."""
    robot = Robot.load("hoap2_like")
    q = robot.posture("standing")
    there = np.column_stack((np.eye(3), (1.0, 0.3, 0.3)))
    ball = [(Capsule.sphere(np.zeros(3), 0.1), there)]
    view, scenes = View.of("front-left", "robot,obstacles"), []
    for obstacles in (ball, []):
        (portrait,) = portraits_of(robot, {"": Pose(q, obstacles=obstacles)}, view)
        scenes.append(portrait.scene)
    camera = Camera.framing(np.array([[-0.3, -0.3, 0.0], [0.9, 0.4, 0.6]]), 0.6, 0.2, 60, 60)
    with_ball, without = (render(scene, camera).colours for scene in scenes)
    changed = np.abs(with_ball - without).max(axis=-1) > 1e-9
    fine = camera.enlarged(2)
    seen = rasterise(fine, scenes[0].solid_corners).depth
    before = seen < rasterise(fine, scenes[1].corners).depth
    expected = before.reshape(60, 2, 60, 2).any(axis=(1, 3))
    np.testing.assert_array_equal(changed, expected)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Capsule.sphere([0.1, 0.2, 0.3], 0.5), 4 / 3 * np.pi * 0.5**3),
        (Capsule.of([0, 0, -1], [0, 0, 1], 0.2), np.pi * 0.2**2 * 2 + 4 / 3 * np.pi * 0.2**3),
        (Hull.box([1.0, 2.0, 3.0]), 6.0),
    ],
)
def test_surfaces_have_the_volume_of_their_shapes(shape: Capsule | Hull, volume: float) -> None:
    surface = solid_surface(shape, np.zeros(3), 1.0, 0.0)
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2) - surface.vertices.mean(axis=0)
    inside = np.abs(np.einsum("ki,ki->k", a, np.cross(b, c))).sum() / 6.0  # convex
    assert 0.95 * volume < inside < 1.0001 * volume  # 24 corners around: inside the round ones


def test_a_wall_is_drawn_near_the_robot_and_above_the_ground() -> None:
    wall = HalfSpace.of([-1.0, 0.0, 0.0], -2.0)  # all that is beyond x = 2
    corners = solid_surface(wall, np.array([0.0, 5.0, 1.0]), 1.5, 0.0).vertices
    np.testing.assert_allclose(corners[:, 0], 2.0)
    assert (corners[:, 1].min(), corners[:, 1].max()) == (3.5, 6.5)
    assert (corners[:, 2].min(), corners[:, 2].max()) == (0.0, 2.5)
    floor = solid_surface(HalfSpace.of([0, 0, 1.0], -0.5), np.zeros(3), 1.0, 0.0).vertices
    np.testing.assert_allclose(floor[:, 2], -0.5)


def test_views_by_words() -> None:
    assert View.of() == View()
    assert View.of("left").azimuth == pytest.approx(np.pi / 2)
    assert View.of("60,20").elevation == pytest.approx(np.deg2rad(20))
    assert View.of(show="robot,com").layers == {"robot", "com"}
    assert View.of(show="no-ellipsoid,no-masses").layers == set(LAYERS) - {"ellipsoid", "masses"}
    for words, said in (
        ({"view_from": "frontleft"}, "did you mean 'front-left'"),
        ({"view_from": "10"}, "from '10'; expected azimuth,elevation"),
        ({"show": "robt"}, "unknown layer 'robt'; did you mean 'robot'"),
        ({"view_from": "0,90"}, "within 89"),
    ):
        with pytest.raises((UnknownNameError, InvalidInputError), match=said):
            View.of(**words)


@pytest.mark.parametrize("seed", range(5))
def test_spans_are_the_runs_of_true(seed: int) -> None:
    on = np.random.default_rng(seed).random(50) < 0.5
    found = runs(on)
    again = np.zeros(50, dtype=bool)
    for first, end in found:
        again[first:end] = True
        assert end == 50 or not on[end]
    np.testing.assert_array_equal(again, on)
