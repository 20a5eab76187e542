"""Shapes of compiled MJCF, and which of them are watched. Oracle: MuJoCo's compiled arrays."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import INERTIAL, LEGS, assert_agree, mujoco, text
from wbc.robot import Robot
from wbc.robot.collision import robot_bodies, select_pairs

HINGED = '<body name="arm" pos="0 .1 .2"><joint name="j1" axis="0 1 0" range="-1 1"/>'
CUBE = (
    "v {0} {0} {0}\nv -{0} {0} {0}\nv -{0} -{0} {0}\nv {0} -{0} {0}\n"
    "v {0} {0} -{0}\nv -{0} {0} -{0}\nv -{0} -{0} -{0}\nv {0} -{0} -{0}\n"
    "f 1 2 3 4\nf 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n"
)
FILE = '<asset><mesh name="m" file="m.obj" {}/></asset>'
SCALE = 'scale=".001 .002 .003"'
DEFAULT = f"<default><mesh {SCALE}/></default>"
CLASS = f'<default><default class="mm"><mesh {SCALE}/></default></default>'
MESHES = {
    "scale on the mesh": (FILE.format(SCALE), ""),
    "scale in the defaults": (DEFAULT + FILE.format(""), ""),
    "scale in a class": (CLASS + FILE.format('class="mm"'), ""),
    "another origin": (
        FILE.format(f'{SCALE} refpos="50 0 0" refquat="1 0 1 0"'),
        'pos="0 .1 0" euler="0 .3 0"',
    ),
    "mirrored": (FILE.format('scale=".001 -.002 .003"'), 'pos="1 0 0"'),
    "folder": ('<compiler assetdir="parts"/>' + FILE.format('scale=".01 .01 .01"'), ""),
}


def load(folder: Path, bodies: str, head: str, size: float) -> tuple[Robot, Any]:
    """Return the robot of a file that has a cube in a file of its own, twice, and its model."""
    (folder / "parts").mkdir()
    for place in (folder, folder / "parts"):
        (place / "m.obj").write_text(CUBE.format(size))
    path = folder / "robot.xml"
    path.write_text(text(bodies, head=head))
    return Robot.load(path, feet={}), mujoco.MjModel.from_xml_path(str(path))


@pytest.mark.parametrize(("assets", "place"), MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("own", ["", INERTIAL.format(1)], ids=["weighs", "does not"])
def test_meshes_are_where_mujoco_has_them(tmp_path, assets: str, place: str, own: str) -> None:
    bodies = f'{HINGED}{own}<geom type="mesh" mesh="m" {place}/></body>'
    robot, model = load(tmp_path, bodies, assets, 100)
    assert_agree(robot, model)
    (shape,) = robot.collision_model.geometryObjects
    pose = shape.placement
    vertices = np.array(shape.geometry.vertices()) @ pose.rotation.T + pose.translation
    wanted = np.zeros(9)
    mujoco.mju_quat2Mat(wanted, model.geom_quat[0])
    wanted = model.mesh_vert @ wanted.reshape(3, 3).T + model.geom_pos[0]
    np.testing.assert_allclose(vertices, wanted, atol=1e-6 * np.abs(wanted).max())  # float32 there


@pytest.mark.parametrize("kind", ["box", "capsule", "sphere"])
def test_shapes_fitted_to_a_mesh_are_read(tmp_path: Path, kind: str) -> None:
    bodies = f'{HINGED}<geom type="{kind}" mesh="m"/></body>'
    robot, model = load(tmp_path, bodies, FILE.format(""), 0.1)
    assert_agree(robot, model)
    (body,) = robot_bodies(robot)
    if kind == "box":
        half = float(np.abs(body.shape.core).max())
        assert half == pytest.approx(model.geom_size[0, 0], rel=1e-6)


GEOMS = (
    '<geom name="body" type="box" size=".1 .1 .2" {0}/>'
    '<body name="arm" pos="0 .2 .1"><joint name="j1" axis="1 0 0" range="-1 1"/>'
    + INERTIAL.format(1)
    + '<geom name="rod" type="capsule" size=".03" fromto="0 0 0 0 0 -.3" {0}/></body>'
)
GHOST = 'contype="0" conaffinity="0"'


def watched(contact: str, ghost: bool = True) -> tuple[set[frozenset[str]], dict[str, str]]:
    content = text(GEOMS.format(GHOST if ghost else "") + LEGS, tail=contact)
    robot = Robot.load(content)
    found = select_pairs(robot, robot_bodies(robot))
    links = [body.link for body in found.bodies]
    return {frozenset((links[a], links[b])) for a, b in found.pairs}, dict(found.excluded)


def test_pairs_of_shapes_that_touch_nothing_else_are_watched() -> None:
    pair = '<contact><pair geom1="rod" geom2="body"/></contact>'
    found, left_out = watched(pair)
    assert frozenset(("arm", "trunk")) in found
    assert frozenset(("arm", "left_foot")) not in found
    assert left_out["arm vs left_foot"] == "meets only what the MJCF pairs it with"
    found, _ = watched(pair, ghost=False)
    assert {frozenset(("arm", "trunk")), frozenset(("arm", "left_foot"))} <= found
    found, _ = watched("")
    assert found == {frozenset(("left_foot", "right_foot"))}


@pytest.mark.parametrize("pair", [("left_foot", "right_foot"), ("right_foot", "left_foot")])
def test_excluded_pairs_are_not_watched(pair: tuple[str, str]) -> None:
    first, second = pair
    found, left_out = watched(f'<contact><exclude body1="{first}" body2="{second}"/></contact>')
    assert frozenset(pair) not in found
    assert left_out["left_foot vs right_foot"] == "excluded in the MJCF"


def test_a_robot_with_meshes_is_pickled_whole(tmp_path: Path) -> None:
    bodies = HINGED + '<geom name="g" type="mesh" mesh="m"/></body>'
    robot, _ = load(tmp_path, bodies, FILE.format(""), 0.1)
    robot.path.unlink()  # nor is the file read again
    again = pickle.loads(pickle.dumps(robot))
    for kind in ("collision_model", "visual_model"):
        (mine,) = getattr(robot, kind).geometryObjects
        (copied,) = getattr(again, kind).geometryObjects
        assert mine.name == copied.name == "g"
        np.testing.assert_array_equal(mine.geometry.vertices(), copied.geometry.vertices())
