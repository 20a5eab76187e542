"""URDFs are compared with MuJoCo's reading of them, where it is there and can read them."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf as toy
from wbc.errors import ModelError
from wbc.robot import Robot
from wbc.robot.formats import urdf, urdf_check

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.skipif(
    not urdf_check._reads_turned_inertias(), reason="this MuJoCo misreads inertias of URDFs"
)
LINK = (
    '<link name="{0}"><inertial><origin xyz=".01 .02 -.1" rpy=".1 .2 .3"/><mass value="{1}"/>'
    '<inertia ixx=".02" ixy=".001" ixz="-.002" iyy=".03" iyz=".003" izz=".025"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>'
    '<origin xyz=".1 -.05 -.2" rpy=".3 -.2 .5"/><axis xyz="{4}"/>'
    '<limit lower="-1" upper="1.5" velocity="3" effort="20"/></joint>'
)


def write(folder: Path, base: str = LINK.format("base", 5), middle: str = "revolute") -> Path:
    links = (LINK.format(f"l{k}", mass) for k, mass in ((1, 1), (2, 2), (3, 1)))
    joints = (
        JOINT.format("j1", "revolute", "base", "l1", "0 1 0"),
        JOINT.format("j2", middle, "l1", "l2", "1 2 -1"),
        JOINT.format("j3", "prismatic", "l2", "l3", "0 0 1"),
    )
    path = folder / "r.urdf"
    path.write_text(toy.robot("r", base, *links, *joints))
    return path


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that were compared at three postures."""
    found = list[Path]()
    real = urdf_check.compare_motion

    def spied(*given: Any) -> None:
        real(*given)
        found.append(given[0].path)

    monkeypatch.setattr(urdf_check, "compare_motion", spied)
    return found


@pytest.mark.parametrize("middle", ["revolute", "continuous", "fixed", "prismatic"])
@pytest.mark.parametrize("base", [LINK.format("base", 5), '<link name="base"/>'])
def test_both_readings_agree(tmp_path: Path, compared: list[Path], base: str, middle: str) -> None:
    path = write(tmp_path, base, middle)
    Robot.load(path, base="fixed")
    assert compared == [path]


def test_the_robots_of_the_library_are_compared(compared: list[Path]) -> None:
    robot = Robot.load("hoap2_like")
    assert compared == [robot.path]


def moved(joint: int, pose: pin.SE3) -> Callable[[pin.Model], None]:
    def fault(model: pin.Model) -> None:
        model.jointPlacements[joint] = model.jointPlacements[joint] * pose

    return fault


def fatter(model: pin.Model) -> None:
    body = model.inertias[4]
    model.inertias[4] = pin.Inertia(body.mass, body.lever, 1.0001 * np.array(body.inertia))


def wider(model: pin.Model) -> None:
    model.upperPositionLimit[7] += 0.01


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (moved(3, pin.SE3(np.eye(3), np.array([0, 0, 1e-6]))), "frame 'l2'"),
        (moved(2, pin.SE3(pin.exp3(np.full(3, 1e-6)), np.zeros(3))), "frame 'l1'"),
        (fatter, "mass matrix"),
        (wider, "the range of joint 'j1'"),
    ],
)
def test_a_wrong_reading_is_refused_by_name(tmp_path, monkeypatch, fault, said) -> None:
    """Each of these faults is put into what Pinocchio made of the file."""
    real = pin.buildModelFromXML

    def faulty(*given: object) -> pin.Model:
        model = real(*given)
        fault(model)
        return model

    monkeypatch.setattr(urdf.pin, "buildModelFromXML", faulty)
    with pytest.raises(ModelError, match=said):
        Robot.load(write(tmp_path), base="fixed")


def test_what_mujoco_cannot_read_is_not_compared(tmp_path: Path, compared: list[Path]) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace(LINK.format("l1", 1), '<link name="l1"/>'))
    assert Robot.load(path, base="fixed").joint_names == ("j1", "j2", "j3")
    assert compared == []


def test_without_mujoco_urdfs_are_read_all_the_same(tmp_path, monkeypatch, compared) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert Robot.load(write(tmp_path), base="fixed").nv == 9
    assert compared == []
