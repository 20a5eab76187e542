"""Bodies and pairs from the cache are those that are made, and of nothing else."""

from pathlib import Path

import numpy as np
import pytest

from tests import urdf
from tests.robot.formats import mjcf_texts as mjcf
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.files import cache_folder
from wbc.robot import Robot
from wbc.robot.collision import Selection, cached_pairs, chosen_pairs, robot_bodies, select_pairs

OBJ = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.{0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESH = urdf.collision('mesh filename="part.obj"')
THREE = urdf.robot(
    "three",
    *(urdf.link(name, MESH) for name in "abc"),
    urdf.joint("ab", "a", "b", at="0 0 .3", axis="1 0 0"),
    urdf.joint("bc", "b", "c", at="0 0 .3", axis="1 0 0", limit=urdf.limit(2)),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setenv("WBC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "part.obj").write_text(OBJ.format(1))
    (tmp_path / "r.urdf").write_text(THREE)
    return tmp_path


def same(one: Selection, other: Selection) -> bool:
    alike = (one.pairs, one.margins, one.excluded, one.finer) == (
        other.pairs, other.margins, other.excluded, other.finer)  # fmt: skip
    cores = zip(one.bodies, other.bodies, strict=True)
    return alike and all(
        a.shape.core.tobytes() == b.shape.core.tobytes()
        and a.shape.radius == b.shape.radius
        and (a.name, a.link, a.joint, a.bulge) == (b.name, b.link, b.joint, b.bulge)
        for a, b in cores
    )


def test_what_is_found_again_is_what_was_made_and_reads_no_mesh(folder: Path, monkeypatch) -> None:
    robot = Robot.load(folder / "r.urdf")
    first = chosen_pairs(robot, clearance=0.01)
    assert first.pairs == ((0, 2),)
    assert same(first, select_pairs(robot, robot_bodies(robot), clearance=0.01))
    again = Robot.load(folder / "r.urdf")
    monkeypatch.setattr(cached_pairs, "robot_bodies", None)
    monkeypatch.setattr(cached_pairs, "select_pairs", None)
    assert same(first, chosen_pairs(again, clearance=0.01))
    assert not {"collision_model", "collision_surfaces"} & vars(again).keys()  # no mesh was read


def test_whatever_it_depends_on_makes_another(folder: Path, monkeypatch) -> None:
    made = []
    monkeypatch.setattr(
        cached_pairs, "select_pairs", lambda *a, **k: made.append(k) or select_pairs(*a, **k)
    )

    def count(*arguments, **options) -> int:
        before = len(made)
        chosen_pairs(Robot.load(folder / "r.urdf"), *arguments, **options)
        return len(made) - before

    assert count() == 1 and count() == 0
    assert count(clearance=0.02) == 1 and count("hull") == 1
    assert count(exclude=[("a", "c")]) == 1 and count(exclude=iter([("a", "c")])) == 0
    (folder / "part.obj").write_text(OBJ.format(2))
    assert count() == 1 and count() == 0
    text = (folder / "r.urdf").read_text()
    (folder / "r.urdf").write_text(text.replace('upper="2"', 'upper="1.5"'))
    assert count() == 1 and count() == 0
    entries = sorted((folder / "cache" / "collision").iterdir())
    for entry in entries:  # damaged, all of them: made anew
        entry.write_bytes(entry.read_bytes()[:-3])
    assert count() == 1 and count() == 0
    monkeypatch.setenv("WBC_CACHE", "off")
    assert count() == 1 and count() == 1


def test_a_folder_that_cannot_be_written_to_is_left_alone(folder: Path, monkeypatch) -> None:
    (folder / "file").write_text("not a folder")
    monkeypatch.setenv("WBC_CACHE", str(folder / "file"))
    assert chosen_pairs(Robot.load(folder / "r.urdf")).pairs
    monkeypatch.delenv("WBC_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "home"))
    assert cache_folder() == folder / "home" / "wbc" / "collision"
    assert not (folder / "home").exists()  # nothing was made by asking


def test_mistakes_are_those_of_what_is_cached(folder: Path) -> None:
    robot = Robot.load(folder / "r.urdf")
    with pytest.raises(UnknownNameError):
        chosen_pairs(robot, include=[("nothing", "a")])
    with pytest.raises(InvalidInputError, match="expected a list of two links"):
        chosen_pairs(robot, exclude=3)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError):
        chosen_pairs(robot, "ball")


def test_mujoco_models_are_kept_too(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("WBC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "r.xml").write_text(mjcf.text(mjcf.LEGS))
    one = chosen_pairs(Robot.load(tmp_path / "r.xml"))
    entries = list((tmp_path / "cache" / "collision").iterdir())
    two = chosen_pairs(Robot.load(tmp_path / "r.xml"))
    assert same(one, two) and entries == list((tmp_path / "cache" / "collision").iterdir())
    assert np.isfinite(one.bodies[0].shape.core).all()
