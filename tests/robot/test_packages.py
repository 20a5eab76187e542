"""Robots that other packages bring. The menagerie's own cache is a folder that the test makes."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.robot.formats.mjcf_texts import LEGS, arm, text
from tests.urdf import stone
from wbc.errors import MissingPackageError, ModelError, UnknownNameError
from wbc.problem.robot_spec import RobotSpec
from wbc.robot import Robot
from wbc.robot.library import find_robot
from wbc.robot.packages import menagerie_names

FAKE = """
from pathlib import Path
from types import SimpleNamespace
ROOT = Path({root!r})
NAMES = ["toy_arm", "toy_biped", "toy_gone"]
def names():
    return NAMES
def get(name):
    def xml(entry, cache=None):
        file = ROOT / name / f"{{entry}}.xml"
        if not file.is_file():
            raise OSError("no network")
        return file
    return SimpleNamespace(
        name=name, default_model=name, default_scene="scene", entry_names=(name, "scene"), xml=xml
    )
"""


@pytest.fixture
def menagerie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of the same interface, whose robots are in a folder."""
    for name, body in (("toy_arm", arm()), ("toy_biped", LEGS)):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.xml").write_text(text(body))
        scene = f'<mujoco><include file="{name}.xml"/></mujoco>'
        (tmp_path / name / "scene.xml").write_text(scene)
    package = tmp_path / "mujoco_menagerie"
    package.mkdir()
    (package / "__init__.py").write_text(FAKE.format(root=str(tmp_path)))
    monkeypatch.syspath_prepend(tmp_path)
    real = sys.modules.pop("mujoco_menagerie", None)
    yield tmp_path
    sys.modules.pop("mujoco_menagerie", None)
    if real is not None:
        sys.modules["mujoco_menagerie"] = real


def test_robots_of_the_menagerie_are_taken_by_name(menagerie: Path) -> None:
    robot = Robot.load("menagerie:toy_biped")
    assert (robot.name, list(robot.feet)) == ("toy_biped", ["left", "right"])
    assert robot.path == menagerie / "toy_biped" / "toy_biped.xml"  # the model, not the scene
    scene = Robot.load("menagerie:toy_biped/scene")
    assert (scene.path.name, scene.mass) == ("scene.xml", robot.mass)
    assert menagerie_names() == tuple(f"menagerie:toy_{one}" for one in ("arm", "biped", "gone"))
    spec = RobotSpec(model="menagerie:toy_arm/scene")  # as a problem file names it
    assert spec.load(Path("/nowhere")).joint_names == ("j1",)


@pytest.mark.parametrize(
    ("name", "said"),
    [("toy_amr", "toy_arm"), ("toy_arm/secne", "scene"), ("", "toy_arm")],
)
@pytest.mark.usefixtures("menagerie")
def test_names_that_the_menagerie_does_not_have_are_told(name: str, said: str) -> None:
    with pytest.raises(UnknownNameError, match=said):
        Robot.load(f"menagerie:{name}")


def test_what_cannot_be_downloaded_is_said(menagerie: Path) -> None:
    with pytest.raises(ModelError, match=r"'menagerie:toy_gone'.*cannot provide it: no network"):
        Robot.load("menagerie:toy_gone")


@pytest.mark.parametrize(
    ("package", "name", "extra"),
    [
        ("mujoco_menagerie", "menagerie:unitree_g1", "menagerie"),
        ("mujoco_menagerie", "menagerie:unitree_g1/scene", "menagerie"),
        ("robot_descriptions", "robot_descriptions:g1", "descriptions"),
    ],
)
def test_a_package_that_is_missing_is_named(monkeypatch, package: str, name: str, extra: str):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackageError, match=rf"pip install 'wbc\[{extra}\]'"):
        Robot.load(name)


def test_the_real_menagerie_reads_its_own_cache(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = pytest.importorskip("mujoco_menagerie")
    assert "menagerie:unitree_g1" in menagerie_names()
    known = real.get("unitree_g1")
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path))
    folder = real.Cache(dir=tmp_path).model_path(known)
    folder.mkdir(parents=True)
    (folder / known.entry(known.default_model).file).write_text(text(LEGS))
    (folder / ".complete").write_text("{}")
    assert Robot.load("menagerie:unitree_g1").joint_names == ("left_hip", "right_hip")
    assert find_robot("menagerie:unitree_g1").path.parent == folder


def test_robot_descriptions_are_taken_by_name(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    modules = {
        "": "",
        ".toy_description": f"URDF_PATH = {str(tmp_path / 'toy.urdf')!r}\nPACKAGE_PATH = ''\n",
        ".toy_mj_description": f"MJCF_PATH = {str(tmp_path / 'toy.xml')!r}\n",
        ".bare_description": "REPOSITORY_PATH = ''\n",
        ".lost_description": "raise OSError('no network')\n",
    }
    package = tmp_path / "robot_descriptions"
    package.mkdir()
    for module, content in modules.items():
        (package / f"{module[1:] or '__init__'}.py").write_text(content)
        monkeypatch.delitem(sys.modules, f"robot_descriptions{module}", raising=False)
    (tmp_path / "toy.urdf").write_text(stone(mass=1))
    (tmp_path / "toy.xml").write_text(text(arm()))
    monkeypatch.syspath_prepend(tmp_path)
    assert Robot.load("toy").mass == Robot.load("toy_description").mass == 1.0
    for name in ("toy_mj", "robot_descriptions:toy_mj", "robot_descriptions:toy_mj_description"):
        assert Robot.load(name, feet={}).joint_names == ("j1",)
    for name, error, said in (
        ("bare", ModelError, "neither a URDF nor an MJCF"),
        ("lost", ModelError, "no network"),
        ("tooy", UnknownNameError, "tooy"),
        ("robot_descriptions:toy_jm_description", UnknownNameError, "toy_mj_description"),
    ):
        with pytest.raises(error, match=said):
            Robot.load(name)
