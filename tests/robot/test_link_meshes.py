"""Triangles of links against hand-made geometry and the volumes of solids."""

import coal
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import urdf
from wbc.robot import Robot
from wbc.robot.geometry import RobotMeshes, triangulated

Array = NDArray[np.float64]


def visual(shape: str, at: str = "0 0 0", rpy: str = "0 0 0", material: str = "") -> str:
    drawn = urdf.collision(shape, at, rpy).replace("collision", "visual")
    return drawn.replace("</visual>", f"{material}</visual>")


def material(rgba: str) -> str:
    return f'<material name="m {rgba}"><color rgba="{rgba}"/></material>'


TRUNK = (
    visual('box size="0.2 0.4 0.6"', "0.1 0 0", f"0 0 {np.pi / 2}", material("0.2 0.4 0.6 1"))
    + visual('sphere radius="9"', material=material("1 1 1 0"))
    + urdf.collision('sphere radius="0.5"')
)
ARM = visual('cylinder radius="0.1" length="0.8"', "0.5 0 0", f"0 {np.pi / 2} 0")


def two(trunk: str, arm: str) -> Robot:
    ends = {"at": "0 0 1", "axis": "0 0 1", "limit": urdf.limit(3)}
    links = urdf.link("trunk", trunk, 2, 1), urdf.link("arm", arm, 1, 1)
    return Robot.load(
        urdf.robot("two", *links, urdf.joint("elbow", "trunk", "arm", **ends)), feet={}
    )


@pytest.fixture
def robot() -> Robot:
    return two(TRUNK, ARM)


def enclosed_volume(vertices: Array, faces: Array) -> float:
    """Volume inside outward triangles: the sum of signed tetrahedra to the origin."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def test_links_at_a_known_placement(robot: Robot) -> None:
    q = np.array([10.0, 20.0, 30.0, 0.0, 0.0, 0.0, 1.0, np.pi / 2])
    trunk, arm = RobotMeshes(robot).at(q)  # the fully transparent ball is left out
    assert (trunk.name, arm.name) == ("trunk", "arm")
    assert trunk.colour == pytest.approx((0.2, 0.4, 0.6), abs=1e-6)  # read as single precision

    # The box is turned by a quarter about z: 0.4 along x, 0.2 along y, middle at x = 0.1.
    corners = {tuple(np.round(vertex, 9).tolist()) for vertex in trunk.vertices}
    expected = {
        (10.1 + 0.2 * i, 20.0 + 0.1 * j, 30.0 + 0.3 * k)
        for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)
    }  # fmt: skip
    assert corners == {tuple(np.round(vertex, 9).tolist()) for vertex in expected}

    # The cylinder lies along the arm, which the elbow has turned from x to y.
    np.testing.assert_allclose(arm.vertices.min(axis=0), [9.9, 20.1, 30.9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(arm.vertices.max(axis=0), [10.1, 20.9, 31.1], rtol=0, atol=1e-9)


def test_meshes_follow_the_base(robot: Robot) -> None:
    """A half turn about z of the whole robot turns every vertex so."""
    meshes = RobotMeshes(robot)
    still = meshes.at([0, 0, 0, 0, 0, 0, 1, 0.3])
    turned = meshes.at([1, 2, 3, 0, 0, 1, 0, 0.3])
    for before, after in zip(still, turned, strict=True):
        expected = before.vertices * [-1, -1, 1] + [1, 2, 3]
        np.testing.assert_allclose(after.vertices, expected, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(after.faces, before.faces)


def test_collision_shapes_are_drawn_if_there_is_nothing_else() -> None:
    ball = two(urdf.collision('sphere radius="0.5"'), "")
    (drawn,) = RobotMeshes(ball).at([0, 0, 0, 0, 0, 0, 1, 0])
    np.testing.assert_allclose(np.linalg.norm(drawn.vertices, axis=1), 0.5, rtol=1e-12)


def test_height_of_the_shipped_robot(hoap2: Robot) -> None:

    def heights(posture: str) -> Array:
        meshes = RobotMeshes(hoap2).at(hoap2.postures[posture])
        return np.concatenate([mesh.vertices[:, 2] for mesh in meshes])

    assert np.ptp(heights("neutral")) == pytest.approx(0.50, abs=1e-9)
    assert heights("standing").min() == pytest.approx(0.0, abs=1e-9)  # on the ground


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (coal.Box(0.2, 0.3, 0.5), 0.03),
        (coal.Sphere(0.3), 4 / 3 * np.pi * 0.3**3),
        (coal.Ellipsoid(0.1, 0.2, 0.3), 4 / 3 * np.pi * 0.006),
        (coal.Cylinder(0.2, 0.7), np.pi * 0.2**2 * 0.7),
        (coal.Capsule(0.2, 0.7), np.pi * 0.2**2 * (0.7 + 4 / 3 * 0.2)),
        (coal.Cone(0.2, 0.6), np.pi * 0.2**2 * 0.6 / 3),
    ],
    ids=lambda value: type(value).__name__,
)
def test_surfaces_are_closed_and_face_outwards(shape: object, volume: float) -> None:
    surface = triangulated(shape)
    # Chords cut off a few parts in a thousand; a hole or a wrong winding would cost far more.
    assert enclosed_volume(surface.vertices, surface.faces) == pytest.approx(volume, rel=5e-3)
    moved = surface.vertices + [1.0, 2.0, 3.0]  # the same everywhere only if closed
    assert enclosed_volume(moved, surface.faces) == pytest.approx(volume, rel=5e-3)


def tetrahedron() -> coal.BVHModelOBBRSS:
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(4, 4)
    mesh.addVertices(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    mesh.addTriangles(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    mesh.endModel()
    return mesh


def test_mesh_files_and_convex_shapes() -> None:
    mesh = tetrahedron()
    surface = triangulated(mesh)
    assert enclosed_volume(surface.vertices, surface.faces) == pytest.approx(1 / 6, rel=1e-12)
    mesh.buildConvexHull(True, "Qt")
    hull = triangulated(mesh.convex)
    assert len(hull.faces) == 4
    assert enclosed_volume(hull.vertices, hull.faces) == pytest.approx(1 / 6, rel=1e-12)


def test_what_ends_nowhere_has_no_surface() -> None:
    assert len(triangulated(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)).faces) == 0
