"""Meshes of files and links against the robots they belong to, and volumes of solids."""

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from tests import urdf
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.formats.mesh_files import is_read_here, read_mesh
from wbc.robot.formats.triangles import with_meshes
from wbc.robot.formats.urdf import read_urdf
from wbc.robot.formats.xml import read_xml
from wbc.robot.geometry import RobotMeshes, triangulated

DATA = Robot.load("icub").path.parents[2]
FILES = (
    path
    for path in sorted(DATA.rglob("*.urdf"))
    if any(suffix in path.read_text().lower() for suffix in (".dae", ".obj"))
)
URDFS = list({path.parents[1]: path for path in FILES}.values())  # one of each folder of meshes
# Links whose meshes stand away from their joints in every viewer: mistakes of the files, or parts
# (a handle, a logo) that hang on the origin of another link.
APART = {
    "icub": {"r_shoulder_1"},  # its rpy is that of a link turned twice
    "anymal": {"handle", "remote", "hatch"},
}


def area(vertices, faces) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def numbers(element, key, default) -> np.ndarray:
    return np.array((default if element is None else element.get(key, default)).split(), float)


@pytest.mark.slow
@pytest.mark.parametrize("path", URDFS, ids=lambda path: f"{path.parents[1].name}/{path.name}")
def test_every_links_mesh_is_at_its_joint(path: Path) -> None:
    """Or nearly: within 13 cm, and 3 cm on average; turned by 90 degrees they are not."""
    boxes: dict[str, list[np.ndarray]] = {}
    for link in read_xml(path).findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            mesh = shape.find("geometry/mesh")
            file = "" if mesh is None else mesh.get("filename", "").partition("robots/")[2]
            if not file.lower().endswith((".dae", ".obj")) or not (DATA / file).is_file():
                continue
            vertices = read_mesh(DATA / file).vertices * numbers(mesh, "scale", "1 1 1")
            origin = shape.find("origin")
            R = pin.rpy.rpyToMatrix(numbers(origin, "rpy", "0 0 0"))
            boxes.setdefault(link.get("name"), []).append(
                vertices @ R.T + numbers(origin, "xyz", "0 0 0")
            )
    away = {}
    for link, clouds in boxes.items():
        points = np.concatenate(clouds)
        outside = np.maximum(np.maximum(points.min(axis=0), -points.max(axis=0)), 0.0)
        if link not in APART.get(path.stem, set()):
            away[link] = float(np.linalg.norm(outside))
    assert away
    assert max(away.values()) < 0.13, max(away, key=lambda link: away[link])
    assert np.mean(list(away.values())) < 0.03


def volumes(robot: Robot) -> dict[str, list[np.ndarray]]:
    """Vertices of each link's collision shapes in the world, in the neutral posture."""
    data, found = robot.model.createData(), {}
    pin.framesForwardKinematics(robot.model, data, robot.postures["neutral"])
    for shape in robot.collision_model.geometryObjects:
        place = data.oMi[shape.parentJoint] * shape.placement
        link = robot.model.frames[shape.parentFrame].name
        vertices = np.array(shape.geometry.vertices()) @ place.rotation.T + place.translation
        found.setdefault(link, []).append(vertices)
    return found


def test_icubs_left_is_the_mirror_image_of_its_right(robot_named) -> None:
    """Its files say Y_UP and mean it: limbs that are turned by 90 degrees are no mirror images."""
    shapes = volumes(robot_named("icub"))
    links = [link[2:] for link in shapes if link.startswith("l_") and link != "l_shoulder_1"]
    assert len(links) >= 10
    for link in links:
        left, right = (np.concatenate(shapes[side + link]) for side in ("l_", "r_"))
        mirrored = left * [1, -1, 1]
        np.testing.assert_allclose(mirrored.min(axis=0), right.min(axis=0), atol=2e-3)
        np.testing.assert_allclose(mirrored.max(axis=0), right.max(axis=0), atol=2e-3)


def test_the_sub_meshes_of_icubs_foot_keep_their_own_vertices(robot_named) -> None:
    robot = robot_named("icub")
    meshes = RobotMeshes(robot).at(robot.posture("standing"))
    left, right = (mesh for mesh in meshes if "foot" in mesh.name)
    for foot in (left, right):
        assert area(foot.vertices, foot.faces) == pytest.approx(0.045, abs=1e-4)
        assert abs(foot.vertices[:, 2].min()) < 1e-3  # it stands on the ground


@pytest.mark.slow
@pytest.mark.parametrize(
    ("urdf", "link", "mesh_area"),
    [
        ("go2_description/urdf/go2.urdf", "FL_thigh", 0.0998),
        ("laikago_description/urdf/laikago.urdf", "trunk", 0.4758),
        ("anymal_b_simple_description/robots/anymal.urdf", "base", 1.828),
    ],
)
def test_areas_of_other_robots(urdf: str, link: str, mesh_area: float) -> None:
    path = DATA / urdf
    read = read_urdf(read_xml(path), path, (DATA, DATA.parents[1]))
    shapes = with_meshes(read.geometry.surfaces(read.model, pin.GeometryType.VISUAL, [link]))
    (shape,) = shapes.geometryObjects
    surface = triangulated(shape.geometry)
    assert area(surface.vertices, surface.faces) == pytest.approx(mesh_area, rel=1e-3)


TETRAHEDRON = "0 0 0  2 0 0  0 3 0  0 0 4"
COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset>{asset}</asset>
<library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="a" count="12">{points}</float_array><technique_common>
    <accessor source="#a" count="4" stride="3"/></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  {part}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'
TRIANGLES = f'<triangles count="4">{VERTEX}<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>'
NODE = '<node><instance_geometry url="#g"/></node>'


def collada(tmp_path: Path, part=TRIANGLES, nodes=NODE, asset="", points=TETRAHEDRON) -> Path:
    path = tmp_path / "mesh.dae"
    path.write_text(COLLADA.format(part=part, nodes=nodes, asset=asset, points=points))
    return path


MESHLAB = "<contributor><authoring_tool>VCGLib | MeshLab</authoring_tool></contributor>"


@pytest.mark.parametrize(
    ("asset", "corner"),
    [
        ("<up_axis>Z_UP</up_axis>", [2, 3, 4]),
        ("<up_axis>Y_UP</up_axis>", [2, -4, 3]),
        ("", [2, -4, 3]),  # Collada's default
        ("<up_axis>X_UP</up_axis>", [-3, -4, 2]),
        ('<unit meter="0.01"/><up_axis>Z_UP</up_axis>', [0.02, 0.03, 0.04]),
        (MESHLAB + "<up_axis>Y_UP</up_axis>", [2, 3, 4]),  # it says so whatever is up
    ],
)
def test_up_axis_and_unit(asset: str, corner: list[float], tmp_path: Path) -> None:
    vertices = read_mesh(collada(tmp_path, asset=asset)).vertices
    np.testing.assert_allclose(vertices[1:].sum(axis=0), corner, atol=1e-12)


def test_nodes_place_what_is_inside_them(tmp_path: Path) -> None:
    nodes = (
        "<node><translate>1 0 0</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>"
        f"<node><matrix>1 0 0 0  0 1 0 0  0 0 1 5  0 0 0 1</matrix>{NODE}</node></node>{NODE}"
    )
    mesh = read_mesh(collada(tmp_path, nodes=nodes, asset="<up_axis>Z_UP</up_axis>"))
    assert mesh.vertices.shape == (8, 3)
    np.testing.assert_allclose(mesh.vertices[1], [1, 4, 10], atol=1e-12)  # (2, 0, 0) before
    assert mesh.faces.max() == 7
    solid = mesh.vertices[mesh.faces]
    volume = np.einsum("ki,ki->", solid[:, 0], np.cross(solid[:, 1], solid[:, 2])) / 6
    assert volume == pytest.approx(4.0 * (8 + 1))


QUADS = "<vcount>4 3</vcount><p>0 1 2 3 0 1 2</p>"


@pytest.mark.parametrize(
    ("part", "faces"),
    [
        (f'<polylist count="2">{VERTEX}{QUADS}</polylist>', [[0, 1, 2], [0, 2, 3], [0, 1, 2]]),
        (f"<polygons>{VERTEX}<p>3 2 1 0</p><p>0 1 2</p></polygons>",
         [[3, 2, 1], [3, 1, 0], [0, 1, 2]]),
        (f'<triangles>{VERTEX}<input semantic="NORMAL" source="#n" offset="1"/>'
         "<p>0 7 1 7 2 7</p></triangles><lines><p>0 1</p></lines>", [[0, 1, 2]]),
    ],
)  # fmt: skip
def test_polygons_become_fans(part: str, faces: list[list[int]], tmp_path: Path) -> None:
    mesh = read_mesh(collada(tmp_path, part=part))
    np.testing.assert_array_equal(mesh.faces, faces)


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ({"part": TRIANGLES.replace("1 2 3<", "1 2 9<")}, "corner without a vertex"),
        ({"part": TRIANGLES.replace("1 2 3<", "1 2 -3<")}, "corner without a vertex"),
        ({"part": TRIANGLES.replace("1 2 3<", "1 2<")}, "damaged"),
        ({"part": TRIANGLES.replace("#v", "#w")}, "damaged"),
        ({"points": TETRAHEDRON.replace("4", "nan")}, "not finite"),
        ({"points": TETRAHEDRON.replace("4", "four")}, "damaged"),
        ({"part": ""}, "no triangles"),
        ({"asset": "<up_axis>UP</up_axis>"}, "damaged"),
        ({"part": f"<tristrips>{VERTEX}<p>0 1 2 3</p></tristrips>"}, "tristrips"),
        ({"nodes": '<node id="n"><instance_node url="#n"/></node>'}, "inside each other"),
        ({"nodes": '<node><instance_controller url="#c"/></node>'}, "instance_controller"),
    ],
)
def test_damaged_collada_files(broken: dict[str, str], words: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=words):
        read_mesh(collada(tmp_path, **broken))


def test_obj_with_several_materials_and_negative_numbers(tmp_path: Path) -> None:
    path = tmp_path / "mesh.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl a\nf 1/1 2/2 3/3 4/4\n"
        "v 0 0 1\nusemtl b\nf -1 1//2 2\n"
    )
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [4, 0, 1]])
    path.write_text("v 0 0 0\nv 1 0 0\nf 1 2 3\n")
    with pytest.raises(ModelError, match="corner without a vertex"):
        read_mesh(path)


HUGE = {
    "urdf": """<robot name="r"><link name="b"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        <TAG><geometry><mesh filename="ball.stl"/></geometry></TAG></link></robot>""",
    "xml": """<mujoco><asset><mesh name="m" file="ball.stl"/></asset><worldbody><body name="b">
        <freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <geom type="mesh" mesh="m"/></body></worldbody></mujoco>""",
}


@pytest.mark.parametrize("kind", HUGE)
def test_meshes_of_a_million_triangles_are_refused_by_their_size(tmp_path: Path, kind: str) -> None:
    (tmp_path / f"r.{kind}").write_text(HUGE[kind].replace("TAG", "collision"))
    with (tmp_path / "ball.stl").open("wb") as file:
        file.truncate(84 + 50 * 10**6)  # binary STL: 50 bytes a triangle
    with pytest.raises(ModelError, match=r"ball\.stl: 47 MB, larger than 32 MB"):
        _ = Robot.load(tmp_path / f"r.{kind}").collision_model


@pytest.mark.parametrize("kind", HUGE)
@pytest.mark.parametrize("count", [400_001, 4])
def test_triangles_of_binary_stl_are_counted_before_they_are_read(tmp_path, kind: str, count: int):
    """Below the size that is refused, too: 670,000 triangles fit into it."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    faces = [corners[[0, *face]].tobytes() for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    (tmp_path / f"r.{kind}").write_text(HUGE[kind].replace("TAG", "collision"))
    stl = b"\0" * 80 + count.to_bytes(4, "little")
    stl += (b"\0\0".join(faces) + b"\0\0") * (1 + count // 4)
    (tmp_path / "ball.stl").write_bytes(stl[: 84 + 50 * count])
    if count == 4:
        assert Robot.load(tmp_path / f"r.{kind}").collision_model.ngeoms == 1
        return
    said = r"ball\.stl: 400001 triangles, more than 400000; export the mesh with fewer"
    with pytest.raises(ModelError, match=said):
        _ = Robot.load(tmp_path / f"r.{kind}").collision_model


def test_binary_stl_files_are_what_coal_reads(tmp_path: Path, rng) -> None:
    """To the bit: corners in the order in which they come up, -0 as 0, without slivers."""
    points = rng.uniform(-1.0, 1.0, (40, 3)).astype("<f4")
    points[7], points[8] = 0.0, -0.0
    faces = np.concatenate(
        (rng.permuted(np.tile(np.arange(40), (90, 1)), axis=1)[:, :3], [[7, 8, 3]])
    )
    path = tmp_path / "m.stl"
    body = b"".join(b"\0" * 12 + points[face].tobytes() + b"\0\0" for face in faces)
    path.write_bytes(b"\0" * 80 + len(faces).to_bytes(4, "little") + body)
    ours = read_mesh(path)
    theirs = coal.MeshLoader(coal.NODE_TYPE.BV_OBBRSS).load(str(path), np.ones(3))
    np.testing.assert_array_equal(ours.vertices, np.array(theirs.vertices()))
    wanted = triangulated(theirs)

    def corners(vertices, faces) -> set[frozenset[bytes]]:
        return {frozenset((vertices[k] + 0.0).tobytes() for k in face) for face in faces}

    assert corners(*ours) == corners(wanted.vertices, wanted.faces)
    assert len(ours.faces) == len(wanted.faces) == len(faces) - 1
    text = tmp_path / "text.stl"  # of which the count is none
    text.write_text("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n")
    assert is_read_here(path) and not is_read_here(text)
    path.write_bytes(path.read_bytes() + b"\r\n")  # as some exporters end them
    np.testing.assert_array_equal(read_mesh(path).vertices, ours.vertices)


def test_triangles_of_obj_files_are_counted(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("wbc.robot.formats.mesh_files.MOST_TRIANGLES", 3)
    path = tmp_path / "mesh.obj"
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    path.write_text(corners + "f 1 2 3 4\nf 1 2 3\n")
    assert len(read_mesh(path).faces) == 3
    path.write_text(corners + "f 1 2 3 4\nf 4 3 2 1\n")
    with pytest.raises(ModelError, match="4 triangles, more than 3"):
        read_mesh(path)


def test_a_huge_mesh_to_look_at_is_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(HUGE["urdf"].replace("TAG", "visual"))
    with (tmp_path / "ball.stl").open("wb") as file:
        file.truncate(84 + 50 * 10**6)
    assert not Robot.load(tmp_path / "r.urdf").collision_model.ngeoms


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
