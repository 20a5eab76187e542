"""The ground of the page, marks and contact forces on it, against terrain and controller."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from tests.view.live.conftest import Stage, balanced, frame_at, rotation_of
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.live.collect import controller_info
from wbc.view.live.layers.forces import REACH, point_of_action
from wbc.view.live.layers.layer import GREEN, ORANGE, VERMILION, WORLD, wxyz
from wbc.view.live.messages import ControllerInfo, Frame

BOARD = Step(centre=(1.0, 0.0, 0.15), size=(0.6, 0.8, 0.02))
TERRAIN = Terrain(slope=(0.1, -0.05), steps=(BOARD,))


@pytest.fixture
def hill(stages: Callable[..., Stage]) -> Stage:
    return stages(terrain=TERRAIN)


@pytest.fixture(scope="module")
def start(robot: wbc.Robot) -> Array:
    """Standing on the slope."""
    return rotated_to_plane(robot.posture("standing"), TERRAIN.normal)


def test_the_grid_is_tilted_and_boards_are_where_they_are(hill: Stage) -> None:
    grid = hill.handle("/ground/grid")
    turn = rotation_of(grid)
    np.testing.assert_allclose(turn[:, 2] @ (1.0, 0.0, 0.1), 0.0, atol=1e-12)
    np.testing.assert_allclose(turn[:, 2] @ (0.0, 1.0, -0.05), 0.0, atol=1e-12)
    assert turn[2, 2] > 0.9
    board = hill.handle("/ground/board 0").vertices
    np.testing.assert_allclose(board.min(axis=0), (0.7, -0.4, 0.13), atol=1e-6)
    np.testing.assert_allclose(board.max(axis=0), (1.3, 0.4, 0.15), atol=1e-6)


def test_level_ground_is_level(stage: Stage) -> None:
    np.testing.assert_allclose(stage.handle("/ground/grid").wxyz, (1.0, 0.0, 0.0, 0.0))
    assert stage.server.scene.get_handle_by_name(f"{WORLD}/ground/board 0") is None


def test_marks_lie_on_the_slope(hill: Stage, robot: wbc.Robot, start: Array) -> None:
    standing = hill.show(balanced(robot, q=start), start)
    polygon = hill.handle("/soles_and_support/polygon").points.reshape(-1, 3)
    mark = hill.handle("/com/projection").position
    plumb = hill.handle("/com/plumb").points[0]
    cop = hill.handle("/leg_cop_cmp/cop").position
    for points in (polygon, mark[None], plumb[1:], cop[None]):
        above = points @ (-0.1, 0.05, 1.0)
        assert (above > -1e-6).all() and (above < 2e-3).all()
    np.testing.assert_allclose(cop[:2], standing.com[:2], atol=1e-9)
    leg = hill.handle("/leg_cop_cmp/leg").points[0]
    np.testing.assert_allclose(leg[0], cop, atol=1e-6)


def test_feet_stand_on_slopes_and_boards_without_a_controller(hill, robot, start) -> None:
    level = robot.posture("standing")
    level[[0, 2]] += (1.0, 0.15)
    flying = level + np.eye(robot.nq)[2] * 0.03
    for k, (q, stands) in enumerate(((start, True), (level, True), (flying, False))):
        hill.draw(Frame(float(k), q, np.zeros(robot.nv)))
        for foot in robot.feet:
            colour = tuple(hill.handle(f"/soles_and_support/{foot}").colors.ravel()[:3])
            assert (colour == ORANGE) == stands
        mark = hill.handle("/com/projection")
        assert mark.visible == stands
        if q is level:
            assert mark.position[2] == pytest.approx(0.15, abs=2e-3)


def test_quaternions_are_scipys_up_to_their_sign() -> None:
    for turn in Rotation.random(50, rng=np.random.default_rng(0)):
        x, y, z, w = turn.as_quat()
        assert abs(wxyz(turn.as_matrix()) @ [w, x, y, z]) > 1.0 - 1e-12
    half = Rotation.from_rotvec([np.pi, 0.0, 0.0])  # the scalar vanishes
    np.testing.assert_allclose(np.abs(wxyz(half.as_matrix())), [0.0, 1.0, 0.0, 0.0], atol=1e-12)


@pytest.fixture(scope="module")
def standing(robot: wbc.Robot) -> wbc.TorqueController:
    start = robot.snapshot(robot.posture("standing"))
    tasks = [wbc.ComTask(robot, start.com, weight=10.0), wbc.PostureTask(robot, start.q)]
    contacts = wbc.support(start, "double")
    return wbc.TorqueController(robot, tasks, contacts=contacts, torque_limits=None)


def test_arrows_carry_the_weight_from_inside_the_soles(stage, standing) -> None:
    robot, snapshot = standing.robot, stage.show(standing)
    arrows = stage.handle("/contact_forces/arrows")
    assert arrows.visible
    ways = arrows.points[:, 1] - arrows.points[:, 0]
    # Single precision; at rest the forces carry the weight, to what the tasks pull by.
    total = ways.sum(axis=0) / (REACH * stage.page._margins.size)
    np.testing.assert_allclose(total, [0.0, 0.0, 1.0], atol=1e-2)
    for foot, start in zip(robot.feet.values(), arrows.points[:, 0], strict=True):
        local = snapshot.rotation(foot.frame).T @ (start - snapshot.position(foot.frame))
        assert abs(local[2]) < 1e-5
        low, high = foot.polygon.min(axis=0) - 1e-5, foot.polygon.max(axis=0) + 1e-5
        assert (low <= local[:2]).all()
        assert (local[:2] <= high).all()
        cone = stage.handle(f"/contact_forces/cone {foot.frame}")
        assert cone.visible
        np.testing.assert_allclose(cone.position, start, atol=1e-6)


def test_the_cop_drawn_is_that_of_the_tick(stage: Stage, standing: wbc.TorqueController) -> None:
    tick = standing.step(stage.show(standing))
    assert tick.cop is not None
    np.testing.assert_allclose(stage.handle("/leg_cop_cmp/cop").position, tick.cop, atol=1e-6)
    assert stage.handle("/leg_cop_cmp/cmp").visible


def test_a_force_at_the_edge_of_its_cone_is_red(stage, standing) -> None:
    robot = standing.robot
    cast: ControllerInfo = controller_info(standing)
    frame = frame_at(standing, robot.posture("standing"), 0.0)
    left, right = (foot.frame for foot in robot.feet.values())
    mu = 0.6 * np.cos(np.pi / 4.0)  # of the pyramid inside the cone
    told = frame.told
    assert told is not None
    forces = {left: np.array([mu * 30.0, 0, 30.0, 0, 0, 0]), right: np.array([1.0, 0, 30, 0, 0, 0])}
    object.__setattr__(told, "forces", forces)
    stage.draw(cast, frame)
    colours = stage.handle("/contact_forces/arrows").colors
    np.testing.assert_array_equal(colours, [VERMILION, GREEN])


def test_the_kinematic_level_has_no_forces(stage: Stage, robot: wbc.Robot) -> None:
    stage.show(balanced(robot))
    assert not stage.handle("/contact_forces/arrows").visible


@pytest.mark.parametrize("seed", range(3))
def test_a_wrench_has_no_tilting_moment_about_where_it_acts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, wrench = rng.normal(size=3), rng.normal(size=6)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    wrench[:3] = rotation @ [*rng.normal(size=2), 5.0]
    point = point_of_action(place, wrench, rotation)
    moment = rotation.T @ (wrench[3:] + np.cross(place - point, wrench[:3]))
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-12)
    assert abs(rotation[:, 2] @ (point - place)) < 1e-12
