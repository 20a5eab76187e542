"""Camera, depth buffer and glass against ray tracing pixel by pixel; meshes for pictures."""

import numpy as np
import pytest

from wbc.gait.walls import WALL_THICKNESS, Wall
from wbc.rmp.ellipsoid import Ellipsoid
from wbc.robot.formats.triangles import Triangles
from wbc.robot.geometry import Mesh, ellipsoid
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.camera import NOTHING, Camera, rasterise
from wbc.view.render import lay_ellipsoid, render
from wbc.view.scene import Scene, principal_sections, silhouette, surface_points
from wbc.view.solids import board_surfaces, limit_triangles, simplified


def some_camera(width: int = 40, height: int = 30) -> Camera:
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return Camera.framing(box, 0.6, 0.3, width, height)


def rays(camera: Camera) -> Array:
    """Directions (height, width, 3) through the pixels' middles, one by one."""
    right, down, forward = camera.axes
    result = np.empty((camera.height, camera.width, 3))
    for row in range(camera.height):
        for column in range(camera.width):
            x = (column + 0.5 - camera.width / 2) / camera.focal
            y = (row + 0.5 - camera.height / 2) / camera.focal
            result[row, column] = x * right + y * down + forward
    return result


def some_ellipsoid(seed: int = 0) -> tuple[Ellipsoid, Array]:
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return Ellipsoid(np.sort(rng.uniform(0.2, 0.9, 3))[::-1], axes, 2.0), rng.uniform(-0.2, 0.2, 3)


def test_the_camera_stands_front_left_upright() -> None:
    camera = some_camera()
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), rtol=0, atol=1e-15)
    assert camera.eye[0] > 0 and camera.eye[1] > 0 and camera.eye[2] > 0
    assert camera.axes[0, 2] == 0.0  # level
    assert camera.axes[1, 2] < 0.0  # down
    # Seen from the front, the robot's left (+y) is on the right.
    (left, right), _ = camera.project(np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]))
    assert left[0] < right[0]


@pytest.mark.parametrize(("width", "height"), [(400, 300), (300, 400), (200, 900)])
def test_framing_holds_all_points_and_no_more(width: int, height: int) -> None:
    points = np.random.default_rng(1).normal(size=(200, 3)) * [0.3, 0.8, 1.5] + [5.0, -3.0, 2.0]
    pixels, depth = Camera.framing(points, 0.5, 0.2, width, height).project(points)
    assert (depth > 0).all()
    gaps = np.array([[0, 0], [width, height]]) - [pixels.min(axis=0), pixels.max(axis=0)]
    gaps = np.abs(gaps) / [width, height]
    # On the tight sides there is the margin of 3 %, and on the others at least that.
    assert gaps.min() == pytest.approx(0.03, abs=1e-9)
    tight = gaps.min(axis=0).argmin()
    np.testing.assert_allclose(gaps[:, tight], 0.03, rtol=0, atol=1e-9)


def first_hit(eye: Array, ray: Array, corners: Array) -> tuple[int, float]:
    """Nearest triangle on a ray and how far along: solve eye + t ray = a + u (b-a) + v (c-a)."""
    best, distance = NOTHING, np.inf
    for index, (a, b, c) in enumerate(corners):
        t, u, v = np.linalg.solve(np.column_stack([-ray, b - a, c - a]), eye - a)
        if u >= 0 and v >= 0 and u + v <= 1 and 0 < t < distance:
            best, distance = index, t
    return best, distance


def test_raster_against_ray_tracing() -> None:
    """Random triangles that cross each other, some partly outside the picture."""
    rng = np.random.default_rng(2)
    corners = rng.uniform(-1.6, 1.6, size=(25, 1, 3)) + rng.normal(scale=0.6, size=(25, 3, 3))
    camera = some_camera()
    found = rasterise(camera, corners)
    hits = [[first_hit(camera.eye, ray, corners) for ray in row] for row in rays(camera)]
    np.testing.assert_array_equal(found.triangle, [[index for index, _ in row] for row in hits])
    np.testing.assert_allclose(found.depth, [[t for _, t in row] for row in hits], rtol=1e-9)
    assert 0.2 < (found.triangle == NOTHING).mean() < 0.9


def test_raster_of_nothing_of_a_point_and_of_what_is_behind_the_camera() -> None:
    camera = some_camera()
    around = camera.eye + np.array([[[0.0, 0, 3], [1, 3, -2], [-2, -2, -2]]])
    for corners in (np.empty((0, 3, 3)), np.zeros((1, 3, 3)), around):
        found = rasterise(camera, corners)
        assert (found.triangle == NOTHING).all() and np.isinf(found.depth).all()


@pytest.mark.parametrize("seed", range(5))
def test_curves_lie_on_the_ellipsoid(seed: int) -> None:
    ellipsoid, centre = some_ellipsoid(seed)
    shape = (ellipsoid.axes / ellipsoid.semi_axes**2) @ ellipsoid.axes.T
    eye = np.array([3.0, 2.0, 1.0])
    outline = silhouette(ellipsoid, centre, eye)
    directions = np.random.default_rng(seed).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sections = principal_sections(ellipsoid, centre)
    for points in (outline, surface_points(ellipsoid, centre, directions), *sections):
        offset = points - centre
        quadric = np.einsum("ki,ij,kj->k", offset, shape, offset)
        np.testing.assert_allclose(quadric, 1.0, rtol=0, atol=1e-12)
    # The eye sees the outline edge-on: the normal there is orthogonal to the line of sight.
    normal = (outline - centre) @ shape
    np.testing.assert_allclose(((outline - eye) * normal).sum(axis=1), 0.0, rtol=0, atol=1e-11)
    for k in range(3):
        across = (sections[k] - centre) @ ellipsoid.axes[:, k]
        np.testing.assert_allclose(across, 0.0, rtol=0, atol=1e-14)


def test_glass_tints_what_is_behind_it_and_nothing_else() -> None:
    ellipsoid, centre = some_ellipsoid()
    camera = some_camera()
    scene = Scene([], ellipsoid, centre, np.array([0.1, 0.5, 0.8]), -1.0)
    # In coordinates where the ellipsoid is the unit ball: where a ray passes nearest to the origin.
    start = ellipsoid.axes.T @ (camera.eye - centre) / ellipsoid.semi_axes
    ways = rays(camera) @ ellipsoid.axes / ellipsoid.semi_axes
    nearest = -(ways @ start) / (ways**2).sum(axis=-1)
    hit = np.linalg.norm(start + nearest[..., None] * ways, axis=-1) < 1.0
    assert 0.02 < hit.mean() < 0.9

    def tinted(wall: Array) -> Array:
        """How much a white wall at these depths (height, width) changes."""
        image = np.ones((camera.height, camera.width, 3))
        lay_ellipsoid(image, wall, scene, camera)
        return np.asarray(np.abs(image - 1.0).max(axis=-1))

    behind, inside = tinted(np.full(hit.shape, np.inf)), tinted(nearest)
    np.testing.assert_array_equal(behind > 0.0, hit)
    np.testing.assert_array_equal(inside > 0.0, hit)
    assert (inside[hit] < behind[hit]).all()  # one surface tints less than two
    assert (tinted(np.full(hit.shape, 0.1)) == 0.0).all()  # in front of both


def test_a_picture_shows_the_robot_before_its_shadow() -> None:
    """A red triangle upright over the ground: red where it is, darkened ground beside it."""
    ellipsoid, _ = some_ellipsoid()
    corners = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]])
    mesh = Mesh("wall", corners, np.array([[0, 1, 2]]), (0.9, 0.0, 0.0))
    scene = Scene([mesh], ellipsoid, np.array([0.0, 0.0, 20.0]), np.ones(3), 0.0)
    camera = Camera.framing(2.0 * corners - [0.0, 0.0, 0.6], 0.3, 0.3, 80, 80)
    picture = render(scene, camera)
    seen = np.isfinite(picture.depth)
    assert 0.02 < seen.mean() < 0.5
    assert picture.colours.min() >= 0.0 and picture.colours.max() <= 1.0
    column, row = camera.project(np.array([[0.0, 0.0, 0.4]]))[0][0].astype(int)
    red, green, _ = picture.colours[row, column]
    assert seen[row, column] and red > 0.5 and green < 0.3
    without = render(Scene([], ellipsoid, scene.centre, np.ones(3), 0.0), camera).colours
    darker = (without - picture.colours).max(axis=-1)[~seen]
    assert darker.max() > 0.02


STEP = Step(centre=(1.0, 0.5, 0.3), size=(0.2, 0.4, 0.1), yaw=0.3)
TERRAIN = Terrain(steps=(STEP, Step(centre=(9.0, 0.0, 0.02), size=(0.6, 2.0, 0.02))))
BALL = ellipsoid(np.array([0.3, 0.2, 0.1]))
MESH = Mesh("ball", BALL.vertices, BALL.faces, (1.0, 0.0, 0.0))


def local(points: Array) -> Array:
    """World points (k, 3) in the axes of the first step, from the middle of its upper face."""
    c, s = np.cos(0.3), np.sin(0.3)
    x, y, z = (points - STEP.centre).T
    return np.column_stack((c * x + s * y, c * y - s * x, z))


def volume(surface: Triangles) -> float:
    """Enclosed by triangles of any winding around their middle [m^3]."""
    corners = (surface.vertices - surface.vertices.mean(axis=0))[surface.faces]
    return float(np.abs(np.linalg.det(corners)).sum() / 6.0)


def test_surfaces_of_boards_are_their_boxes() -> None:
    first, second = board_surfaces(TERRAIN)
    corners = local(first.vertices)
    assert len(corners) == 8
    np.testing.assert_allclose(np.abs(corners[:, :2]), [[0.1, 0.2]] * 8, atol=1e-12)
    np.testing.assert_allclose(np.sort(corners[:, 2]), [-0.1] * 4 + [0.0] * 4, atol=1e-12)
    assert volume(first) == pytest.approx(0.2 * 0.4 * 0.1)
    np.testing.assert_allclose(second.vertices.min(axis=0), [8.7, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(second.vertices.max(axis=0), [9.3, 1.0, 0.02], atol=1e-12)


def test_only_the_near_part_of_a_board_is_made() -> None:
    around = STEP.centre + (0.3 * np.cos(0.3), 0.3 * np.sin(0.3), 0.0)  # 0.3 m along the step's x
    (near,) = board_surfaces(TERRAIN, around, 0.25)
    corners = local(near.vertices)
    np.testing.assert_allclose(corners.min(axis=0), [0.05, -0.2, -0.1], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [0.1, 0.2, 0.0], atol=1e-12)
    assert board_surfaces(TERRAIN, np.array((-5.0, 0.0)), 0.5) == []


def test_only_the_near_part_of_a_wall_is_made() -> None:
    wall = Wall(point=(2.0, 0.0, 0.0), normal=(-1.0, 0.0, 0.0), size=(3.0, 2.0))
    (whole,) = board_surfaces(Terrain(walls=(wall,)))
    size = np.ptp(whole.vertices, axis=0)
    np.testing.assert_allclose(size, [WALL_THICKNESS, 3.0, 2.0], atol=1e-12)
    assert whole.vertices[:, 0].min() == pytest.approx(2.0)  # it is behind its face
    (near,) = board_surfaces(Terrain(walls=(wall,)), np.array((0.0, 1.2)), 0.5)
    np.testing.assert_allclose(np.sort(np.unique(near.vertices[:, 1].round(9))), [0.7, 1.5])
    assert board_surfaces(Terrain(walls=(wall,)), np.array((0.0, 5.0)), 0.5) == []


@pytest.mark.slow
@pytest.mark.parametrize("cell", [0.01, 0.03, 0.1])
def test_a_simplified_mesh_has_no_corner_moved_farther_than_a_cell(cell: float) -> None:
    made = simplified(MESH, cell)
    assert len(made.faces) < len(MESH.faces)
    apart = np.linalg.norm(made.vertices[:, None] - MESH.vertices[None], axis=-1).min(axis=1)
    assert apart.max() <= np.sqrt(3.0) * cell
    assert set(made.faces.ravel()) == set(range(len(made.vertices)))
    a, b, c = made.vertices[made.faces].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0.0
    assert (made.name, made.colour) == (MESH.name, MESH.colour)


def test_a_mesh_that_would_vanish_in_a_cell_stays() -> None:
    inside = Mesh("ball", MESH.vertices + 5.0, MESH.faces, MESH.colour)  # of one cell
    assert simplified(inside, 10.0) is inside


def test_many_triangles_are_limited_by_the_finest_grid_that_will_do() -> None:
    assert limit_triangles([MESH], len(MESH.faces))[0] is MESH
    few = limit_triangles([MESH, MESH], 3000)
    count = sum(len(mesh.faces) for mesh in few)
    assert 1000 < count <= 3000
