"""Named robots and all of example-robot-data: sizes by ElementTree, and whether they stand."""

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
from wbc.constraints import PointContact, support
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


FOLDER = next(one for one in find_robot("g1").path.parents if one.name == "robots")


def files(names: str) -> list[str]:
    return names.split()


HUMANOIDS = files("""
alexander_description/urdf/alexander_v1.lowerBodyOnly bolt_description/robots/bolt
g1_description/urdf/g1_29dof_rev_1_0 g1_description/urdf/g1_29dof_with_hand_rev_1_0
human_description/robots/human icub_description/robots/icub icub_description/robots/icub_reduced
romeo_description/urdf/romeo_small talos_data/robots/talos_full_v2
talos_data/robots/talos_full_v2_box talos_data/robots/talos_reduced
talos_data/robots/talos_reduced_box talos_data/robots/talos_reduced_corrected
""")
QUADRUPEDS = files("""
a1_description/urdf/a1 anymal_b_simple_description/robots/anymal
anymal_b_simple_description/robots/anymal-kinova anymal_c_simple_description/urdf/anymal
b1_description/urdf/b1 b1_description/urdf/b1-z1 go1_description/urdf/go1 go2_description/urdf/go2
hyq_description/robots/hyq_no_sensors laikago_description/urdf/laikago
quadruped_description/urdf/quadruped solo_description/robots/solo solo_description/robots/solo12
""")
# Arms, hands, and two bodies on a column.
ARMS = files("""
allegro_hand_description/urdf/allegro_left_hand allegro_hand_description/urdf/allegro_right_hand
asr_twodof_description/urdf/TwoDofs baxter_description/urdf/baxter
double_pendulum_description/urdf/double_pendulum
double_pendulum_description/urdf/double_pendulum_continuous
double_pendulum_description/urdf/double_pendulum_simple finger_edu_description/robots/finger_edu
kinova_description/robots/kinova panda_description/urdf/panda
panda_description/urdf/panda_collision pr2_description/urdf/pr2 so_arm_description/urdf/so100
so_arm_description/urdf/so101 talos_data/robots/talos_left_arm
ur_description/urdf/ur10_joint_limited_robot ur_description/urdf/ur10_robot
ur_description/urdf/ur3_gripper ur_description/urdf/ur3_joint_limited_robot
ur_description/urdf/ur3_robot ur_description/urdf/ur5_gripper
ur_description/urdf/ur5_joint_limited_robot ur_description/urdf/ur5_robot
xarm_description/urdf/xarm7 z1_description/urdf/z1
""")
NO_FEET = {  # what floats, and why it has no feet
    "alex_description/urdf/alex_nub_hands": "are called hands or wheels",
    "alex_description/urdf/alex_sake_hands": "are called hands or wheels",
    "borinot_description/urdf/borinot_flying_arm_2": "are called hands or wheels",
    "centauro_description/urdf/centauro": "wheels are no soles",
    "hector_description/robots/quadrotor_base": "no limb ends below the base",
    "hextilt_description/urdf/hextilt_flying_arm_5": "are called hands or wheels",
    "iris_description/robots/iris": "no limb ends below the base",
    "iris_description/robots/iris_simple": "no limb ends below the base",
    "simple_humanoid_description/urdf/simple_humanoid": "no shapes to find soles from on l_ankle",
    "simple_humanoid_description/urdf/simple_humanoid_classical": "no shapes to find soles from",
    "tiago_description/robots/tiago": "wheels are no soles",
    "tiago_description/robots/tiago_dual": "wheels are no soles",
    "tiago_description/robots/tiago_no_hand": "wheels are no soles",
    "tiago_pro_description/robots/tiago_pro": "wheels are no soles",
}
REFUSED = {
    "alex_description/urdf/alex_psyonic_hands": "is coupled to 'index_q1'",
    "romeo_description/urdf/romeo": "has no mass",
    "romeo_description/urdf/romeo_laas_small": "has no mass",
    "ur_description/urdf/ur3": "no <link>",
}


def load(name: str, **given: object) -> Robot:
    return Robot.load(FOLDER / f"{name}.urdf", **given)


def assert_stands(robot: Robot) -> None:
    """Soles on the ground, all else above it, and the CoM over them."""
    s = robot.snapshot(robot.posture("standing"))
    corners = sole_corners(s)
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=1e-3)  # m
    assert polygon_margin(convex_hull(corners[:, :2]), s.com[:2]) > 0.0
    assert s.joint_placements[1][1:, 2].min() > 0.0
    assert s.com[2] > 0.08  # m
    assert (robot.limits.past(s.joint_positions) <= 1e-9).all()


def test_no_file_is_left_out() -> None:
    named = {*HUMANOIDS, *QUADRUPEDS, *ARMS, *NO_FEET, *REFUSED}
    assert named == {str(p.relative_to(FOLDER))[:-5] for p in FOLDER.rglob("*.urdf")}
    assert len(named) == sum(map(len, (HUMANOIDS, QUADRUPEDS, ARMS, NO_FEET, REFUSED)))


@pytest.mark.slow
@pytest.mark.parametrize("name", HUMANOIDS)
def test_humanoids_stand_on_two_feet(name: str) -> None:
    robot = load(name)
    assert list(robot.feet) == ["left", "right"]
    assert not robot.fixed_base
    assert_stands(robot)
    s = robot.snapshot(robot.posture())
    left, right = (s.position(foot.frame) for foot in robot.feet.values())
    np.testing.assert_allclose(s.rotation(robot.feet["left"].frame), np.eye(3), atol=0.02)
    assert left[1] - right[1] > 0.05  # m: it faces x
    if "bolt" not in name:  # which ends in balls
        longest = max(np.ptp(foot.polygon, axis=0)[0] for foot in robot.feet.values())
        assert 0.1 < longest < 0.35  # m


@pytest.mark.slow
@pytest.mark.parametrize("name", QUADRUPEDS)
def test_quadrupeds_stand_on_points(name: str) -> None:
    robot = load(name)
    assert list(robot.feet) == ["front_left", "front_right", "hind_left", "hind_right"]
    assert {len(foot.polygon) for foot in robot.feet.values()} == {1}
    assert_stands(robot)
    soles = [foot.frame for foot in robot.feet.values()]
    held = support(robot.snapshot(robot.posture()), soles)
    assert all(isinstance(contact, PointContact) for contact in held)
    here = robot.snapshot(robot.posture("standing"))
    middle = np.mean([here.position(sole) for sole in soles], axis=0)
    assert np.abs(here.com - middle)[:2].max() < 0.05  # it was 0.19 behind them
    assert here.rotation("base")[:, 2].max() > 0.999


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_bolted_down(name: str) -> None:
    robot = load(name)
    assert robot.fixed_base
    assert robot.feet == {}
    assert any("the base is fixed, since" in note for note in robot.notes)


@pytest.mark.parametrize("name", NO_FEET)
def test_what_has_no_feet_says_why(name: str, caplog: pytest.LogCaptureFixture) -> None:
    robot = load(name)
    assert robot.feet == {}
    assert not robot.fixed_base
    (note,) = (note for note in robot.notes if note.startswith("no feet were found: "))
    assert NO_FEET[name] in note
    assert note in caplog.text


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_loaded_says_why(name: str) -> None:
    with pytest.raises(ModelError, match=REFUSED[name]):
        load(name)


def test_feet_without_shapes_stand_by_their_polygons() -> None:
    """The humanoid of which the file draws no feet: 0.1 m below the ankle, CoM 0.03 m in front."""
    sole = {"polygon": [[-0.1, -0.05], [0.15, -0.05], [0.15, 0.05], [-0.1, 0.05]], "height": 0.1}
    feet = {side: {"link": f"{side[0]}_ankle", **sole} for side in ("left", "right")}
    file = FOLDER / "simple_humanoid_description/srdf/simple_humanoid.srdf"
    robot = load("simple_humanoid_description/urdf/simple_humanoid", feet=feet, srdf=file)
    assert_stands(robot)


def test_a_human_described_with_y_up_stands_upright() -> None:
    robot = load("human_description/robots/human")
    assert any("the base's y axis points up" in note for note in robot.notes)
    s = robot.snapshot(robot.posture())
    assert s.position("middle_head")[2] > 1.3  # m
    left, right = (s.position(f"{side}_hand") for side in ("left", "right"))
    assert left[1] - right[1] > 0.3  # it faces forwards


def test_other_formats_are_refused_by_name() -> None:
    file: Path = FOLDER / "cassie_description/robots/cassie.sdf"
    with pytest.raises(ModelError, match="sdf files are not read; export a URDF"):
        Robot.load(file)
