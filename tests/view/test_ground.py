"""Sloped ground and boards in pictures, against points whose places are known."""

from dataclasses import replace

import numpy as np
import pytest

from wbc.rmp.ellipsoid import Ellipsoid
from wbc.robot.geometry import Mesh
from wbc.simulation import Step, Terrain
from wbc.validate import Array
from wbc.view.camera import Camera
from wbc.view.ground import ground_picture
from wbc.view.render import render
from wbc.view.scene import Scene

BALL = Ellipsoid(np.full(3, 0.5), np.eye(3), 1.0)  # a picture 1 m large, lines every 0.2 m
SLOPE = (0.25, -0.15)
BOX = Step(centre=(0.0, 0.0, 0.1), size=(0.4, 0.3, 0.2), yaw=0.4)


def scene_on(terrain: Terrain, *meshes: Mesh, ground: float = 0.0) -> Scene:
    centre = np.array((0.0, 0.0, 0.5))
    return Scene(meshes, BALL, centre, np.ones(3), ground, glass=False, terrain=terrain)


def camera_at(azimuth: float, elevation: float, size: int = 300) -> Camera:
    corners = np.array([(x, y, z) for x in (-0.6, 0.6) for y in (-0.6, 0.6) for z in (0.0, 0.6)])
    return Camera.framing(corners, azimuth, elevation, size, size)


def shades(picture: Array, camera: Camera, points: Array) -> Array:
    """How bright a picture is where points (k, 3) are seen."""
    column, row = camera.project(points)[0].astype(int).T
    return picture[row, column].mean(axis=-1)


@pytest.mark.parametrize("ground", [0.0, -0.2])
def test_grid_lines_lie_on_the_slope(ground: float) -> None:
    terrain, camera = Terrain(slope=SLOPE), camera_at(0.5, 0.5)
    picture, _ = ground_picture(scene_on(terrain, ground=ground), camera, 1)
    offsets = np.arange(-0.15, 0.16, 0.02)
    risen = np.array((0.0, 0.0, ground))
    lines = terrain.surface(np.column_stack((np.zeros(len(offsets)), offsets))) + risen
    between = terrain.surface(np.column_stack((np.full(len(offsets), 0.1), offsets))) + risen
    between = between[np.abs(np.abs(offsets) - 0.1) < 0.06]  # off the lines across
    assert shades(picture, camera, lines).max() < shades(picture, camera, between).min() - 0.02


@pytest.mark.parametrize("slope", [(0.0, 0.0), SLOPE])
def test_what_is_seen_of_a_board_is_on_it_and_above_the_plane(slope: tuple[float, float]) -> None:
    """Each point that the depth tells is on a face of the box, and none below the slope is told."""
    terrain, camera = Terrain(slope=slope, steps=(BOX,)), camera_at(-0.7, 0.4)
    _, depth = ground_picture(scene_on(terrain), camera, 2)
    fine = camera.enlarged(2)
    x, y = fine.slopes()
    rays = np.stack([*np.meshgrid(x, y), np.ones(depth.shape)], axis=-1) @ fine.axes
    seen = np.isfinite(depth)
    points = fine.eye + depth[seen][:, None] * rays[seen]
    assert 2000 < len(points) < 0.5 * depth.size
    c, s = np.cos(BOX.yaw), np.sin(BOX.yaw)
    px, py, pz = points.T
    turned = np.column_stack((c * px + s * py, c * py - s * px, pz))  # its middle is the origin
    outside = np.abs(turned) - (0.2, 0.15, 0.1)
    np.testing.assert_allclose(outside.max(axis=1), 0.0, atol=1e-9)
    above = pz - terrain.slope[0] * px - terrain.slope[1] * py
    assert above.min() > -1e-9
    assert (pz > 0.0999).mean() > 0.3  # the upper face


def test_boards_are_grey_and_the_ground_beside_them_as_without() -> None:
    terrain, camera = Terrain(steps=(BOX,)), camera_at(-0.7, 0.4)
    with_board = ground_picture(scene_on(terrain), camera, 1)[0]
    without = ground_picture(scene_on(Terrain()), camera, 1)[0]
    top = BOX.centre + np.array(((0.0, 0.0, 0.0), (0.05, 0.05, 0.0), (-0.1, 0.0, 0.0)))
    grey, plain = shades(with_board, camera, top), shades(without, camera, top)
    np.testing.assert_allclose(grey, grey[0], atol=2e-3)  # no lines on it
    assert grey[0] < plain.max() - 0.03
    changed = np.abs(with_board - without).max(axis=-1) > 0.0
    assert 0.02 < changed.mean() < 0.3


def plate(height: float, size: float = 0.3) -> Mesh:
    """A red square above the middle."""
    corners = size * np.array(((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1, 1, 0)))
    faces = np.array(((0, 1, 2), (0, 2, 3)))
    return Mesh("", 0.5 * corners + (0.0, 0.0, height), faces, (0.9, 0.0, 0.0))


@pytest.mark.parametrize(("height", "red"), [(0.05, False), (0.12, True)])
def test_a_board_hides_what_is_in_it(height: float, red: bool) -> None:
    camera = camera_at(0.4, 0.5)
    picture = render(scene_on(Terrain(steps=(BOX,)), plate(height, 0.1)), camera)
    pixels, _ = camera.project(np.array(((0.0, 0.0, height),)))
    column, row = pixels[0].astype(int)
    assert (picture.colours[row, column, 1] < 0.4) == red


def test_marks_on_a_board_are_seen_and_those_below_it_are_not() -> None:
    camera = camera_at(0.4, 0.2)
    hides = render(scene_on(Terrain(steps=(BOX,))), camera).depth
    for height, seen in ((0.1, True), (0.0, False)):
        pixels, depth = camera.project(np.array(((0.0, 0.0, height), (0.05, 0.05, height))))
        column, row = pixels.astype(int).T
        assert ((depth < hides[row, column]) == seen).all()


@pytest.mark.parametrize("slope", [(0.0, 0.0), SLOPE])
def test_the_shadow_falls_on_slopes_and_boards(slope: tuple[float, float]) -> None:
    """What the plate changes of the ground's picture is where its rays towards the sun say."""
    broad = Step(centre=(0.0, 0.0, 0.1), size=(3.0, 3.0, 0.5))
    for terrain in (Terrain(slope=slope), Terrain(slope=slope, steps=(broad,))):
        camera, scene = camera_at(0.4, 0.6), scene_on(terrain)
        shaded = ground_picture(replace(scene, meshes=[plate(0.5)]), camera, 1)[0]
        darker = (ground_picture(scene, camera, 1)[0] - shaded).mean(axis=-1)
        right, down, forward = camera.axes
        sun = -0.45 * right - 0.80 * down - 0.55 * forward
        sun = sun / np.linalg.norm(sun) + (0.0, 0.0, 1.5)
        # Where the ray from the plate's middle meets the plane, or the board at 0.1 m.
        plane = terrain.upright if not terrain.steps else np.array((0.0, 0.0, 1.0))
        above = 0.5 - (0.1 if terrain.steps else 0.0)
        fallen = np.array((0.0, 0.0, 0.5)) - above / (sun @ plane) * sun
        away = fallen + np.array((0.0, 0.45, 0.0))
        place, beside = (terrain.surface(one[None]) for one in (fallen, away))
        np.testing.assert_allclose(place[0], fallen, atol=1e-12)
        assert shades(darker[..., None], camera, place)[0] > 0.1
        assert shades(darker[..., None], camera, beside)[0] < 0.01
