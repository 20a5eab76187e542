"""Named robots, and those that other packages bring: found, and standing as they should.

The oracle for sizes and masses is the URDF's XML, read here with ElementTree.
"""

import importlib.metadata
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.robot.formats.mjcf_texts import LEGS, arm, text
from tests.standing import sole_corners
from tests.urdf import stone
from wbc.errors import MissingPackageError, ModelError, UnknownNameError
from wbc.polygon import convex_hull, polygon_margin
from wbc.problem.robot_spec import RobotSpec
from wbc.robot import Robot, robot_names
from wbc.robot.library import DATA_VARIABLE, ROBOTS, find_robot
from wbc.robot.packages import menagerie_names

Load = Callable[[str], Robot]
MASSES = {"hoap2_like": 7.1, "g1": 33.3, "g1_27": 33.3, "talos": 90.3, "icub": 28.3, "romeo": 40.5}
VELOCITIES = {"hoap2_like": 31, "g1": 35, "g1_27": 33, "talos": 36, "icub": 38, "romeo": 37}
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


def test_every_named_robot_is_checked_here() -> None:
    assert set(robot_names()) == set(MASSES) == set(VELOCITIES)


@pytest.mark.parametrize("name", robot_names())
def test_sizes_and_mass_are_those_of_the_file(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    root = ET.parse(robot.path).getroot()
    kinds = [joint.get("type") for joint in root.findall("joint")]
    moving = sum(kind in {"revolute", "prismatic", "continuous"} for kind in kinds)
    masses = [float(mass.get("value", "nan")) for mass in root.findall("link/inertial/mass")]
    assert robot.name == name
    assert robot.nv == 6 + moving - len(ROBOTS[name].locked) == VELOCITIES[name]
    assert robot.nq == robot.nv + 1
    assert robot.mass == pytest.approx(sum(masses), rel=1e-12)  # rounding of two sums
    assert robot.mass == pytest.approx(MASSES[name], abs=0.05)


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_has_all_limits_and_both_feet(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    assert robot.limits.missing == ()
    assert list(robot.feet) == ["left", "right"]
    s = robot.snapshot(robot.posture())
    left, right = (s.position(robot.feet[side].frame) for side in robot.feet)
    assert left[1] > 0.03 and right[1] < -0.03  # m: faces +x, feet apart
    forward = s.rotation(robot.feet["left"].frame)[:, 0]
    assert forward[0] > 0.99


@pytest.mark.parametrize("name", robot_names())
def test_standing_is_flat_on_the_ground_balanced_and_within_limits(name: str, robot_named) -> None:
    robot = robot_named(name)
    s = robot.snapshot(robot.posture("standing"))
    corners = sole_corners(s)
    # m; iCub's file rounds the turns of its frames to 5 digits, Romeo's posture has 7
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=2e-5 if name == "icub" else 1e-7)
    assert polygon_margin(convex_hull(corners[:, :2]), s.com[:2]) > 0.03  # m
    assert (robot.limits.past(s.joint_positions) <= 0.0).all()


@pytest.mark.parametrize("name", robot_names())
def test_standing_bends_both_knees_alike(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    q = robot.limits.joint_positions(robot.posture("standing"))
    knees = [k for k, n in enumerate(robot.joint_names) if "knee" in n.lower() or "_4_" in n]
    knees = [k for k in knees if "arm" not in robot.joint_names[k]]
    assert len(knees) == 2
    assert abs(q[knees[0]]) > 0.3
    assert q[knees[0]] == pytest.approx(q[knees[1]])


def test_notes_say_what_is_odd_in_the_files(robot_named: Load) -> None:
    told = robot_named("icub").notes
    assert any("taken as points" in note and "r_hip_1" in note for note in told)
    assert any("90 degrees" in note for note in told)
    (note,) = robot_named("romeo").notes
    assert "RShoulderYawLink, RElbowYawLink" in note  # izz ten times smaller than on the left
    for name in ("hoap2_like", "g1", "g1_27", "talos"):
        assert robot_named(name).notes == ()


def test_loading_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    for name in robot_names():
        Robot.load(name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["talos", "icub", "romeo"])
def test_half_sitting_is_read_from_the_srdf(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    states = ET.parse(robot.srdf).findall("group_state[@name='half_sitting']/joint")
    read = {joint.get("name"): joint.get("value", "") for joint in states}
    q = robot.limits.joint_positions(robot.postures["half_sitting"])
    found = dict(zip(robot.joint_names, q.tolist(), strict=True))
    known = [joint for joint in found if joint in read]
    assert len(known) > 25
    for joint in known:
        assert found[joint] == pytest.approx(float(read[joint]), abs=1e-6)  # digits of the limits


def test_the_waist_of_g1_27_is_bolted(g1: Robot, g1_27: Robot) -> None:
    bolted = set(g1.joint_names) - set(g1_27.joint_names)
    assert bolted == {"waist_roll_joint", "waist_pitch_joint"}
    same = g1_27.snapshot(g1_27.posture()), g1.snapshot(g1.posture())
    np.testing.assert_allclose(same[0].com, same[1].com, atol=1e-12)
    np.testing.assert_allclose(same[0].inertia, same[1].inertia, atol=1e-12)


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'talos'.*the path of a URDF or MJCF"):
        Robot.load("tallos")


def test_a_missing_package_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> None:
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr(importlib.metadata, "files", missing)
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    with pytest.raises(ModelError, match=r"pip install wbc\[robots\]"):
        find_robot("g1")
    assert find_robot("hoap2_like").path.is_file()


def test_the_data_may_be_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / ROBOTS["g1"].urdf
    file.parent.mkdir(parents=True)
    file.write_text("<robot/>")
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert find_robot("g1").path == file
    assert find_robot("talos").path.is_file()  # not there, but installed


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
    ("name", "said"), [("toy_amr", "toy_arm"), ("toy_arm/secne", "scene"), ("", "toy_arm")]
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
