"""A robot several times in one picture: where it was, on its ground."""

from pathlib import Path

import numpy as np
import pytest
from exposures import exposures_figure, together

from wbc.errors import InvalidInputError
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.robot import Robot
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.options import View
from wbc.view.portrait import Pose, portraits_of
from wbc.view.style import save

BOARD = Step(centre=(0.5, 0.0, 0.05), size=(0.4, 0.6, 0.05))
TERRAIN = Terrain(slope=(0.1, 0.0), steps=(BOARD,))
FROM_THE_LEFT = View.of("90,10", "robot,ground,soles,com")


@pytest.fixture(scope="module")
def walk(hoap2: Robot) -> dict[str, Array]:
    """Standing on the slope, and half a metre and a metre up."""
    start = rotated_to_plane(hoap2.posture("standing"), TERRAIN.normal)
    found = {}
    for name, ahead in (("0 s", 0.0), ("1 s", 0.5), ("2 s", 1.0)):
        found[name] = start.copy()
        found[name][[0, 2]] += (ahead, 0.1 * ahead)
    return found


def test_robots_stand_where_they_were(hoap2: Robot, walk: dict[str, Array]) -> None:
    poses = {name: Pose(q, terrain=TERRAIN) for name, q in walk.items()}
    portraits = portraits_of(hoap2, poses)
    scene = together(portraits)
    alone = portraits[0].scene
    assert len(scene.corners) == 3 * len(alone.corners)
    np.testing.assert_allclose(scene.corners[-len(alone.corners) :], alone.corners + (1, 0, 0.1))
    assert scene.size == alone.size < scene.spread == pytest.approx(1.0, abs=0.5)
    np.testing.assert_allclose(scene.centre, portraits[1].scene.centre, atol=1e-9)
    (board,) = scene.boards
    assert board.vertices[:, 2].max() == pytest.approx(0.05)
    assert not scene.glass


@pytest.mark.slow
def test_names_stand_above_the_robots_in_their_order(
    hoap2: Robot, walk: dict[str, Array], tmp_path: Path
) -> None:
    way = np.column_stack((np.linspace(0.0, 1.0, 50), np.zeros(50), np.full(50, 0.4)))
    figure = exposures_figure(hoap2, walk, path_of_com=way, terrain=TERRAIN, view=FROM_THE_LEFT)
    (axes,) = figure.axes
    places = {text.get_text(): text.get_position() for text in axes.texts}
    # From the left, ahead is to the left; uphill is higher, and rows count downwards.
    assert list(places) == ["0 s", "1 s", "2 s"]
    x, y = np.array(list(places.values())).T
    assert (np.diff(x) < 0.0).all() and (np.diff(y) < 0.0).all()
    told = [text.get_text() for text in figure.texts]
    assert told == ["quartered disc: CoM; orange: soles; black: path of the CoM on the ground"]
    path = save(figure, tmp_path / "walk.png")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_way_of_the_com_is_on_the_ground(hoap2: Robot, walk: dict[str, Array]) -> None:
    """Seen from the side, it is as steep as the slope, and jumps up and down at the board."""
    x = np.linspace(0.0, 1.0, 101)
    way = np.column_stack((x, np.zeros(101), np.full(101, 0.4)))
    figure = exposures_figure(hoap2, walk, path_of_com=way, terrain=TERRAIN, view=FROM_THE_LEFT)
    lines = max(figure.axes[0].collections, key=lambda one: len(one.get_segments()))
    points = np.array([line[0] for line in lines.get_segments()])
    metre = (points[0, 0] - points[-1, 0]) / (x[-2] - x[0])  # pixels, nearly: a long lens
    risen = (points[0, 1] - points[:, 1]) / metre
    on_board = (x[:-1] > 0.31) & (x[:-1] < 0.69) & (0.1 * x[:-1] < 0.05)
    on_slope = (x[:-1] < 0.29) | (x[:-1] > 0.71)
    np.testing.assert_allclose(risen[on_slope], 0.1 * x[:-1][on_slope], atol=4e-3)
    np.testing.assert_allclose(risen[on_board], 0.05, atol=4e-3)


@pytest.mark.parametrize("path", [[[0.0, 0.0]], [0.0, 0.0, 0.0], [["x", 0, 0]], [[np.nan, 0, 0]]])
def test_a_path_that_is_none_is_a_typed_error(hoap2, path) -> None:
    with pytest.raises(InvalidInputError, match="path_of_com"):
        exposures_figure(hoap2, {"stands": hoap2.posture("standing")}, path_of_com=path)
